"""Rational tensor B-splines: the surfaces of CAD files, with matrices for their control points.

With the functions N of u and M of v and the weights w, the point at (u, v) is

    S = A / w,    A = sum_ij w_ij N_i M_j P_ij,    w = sum_ij w_ij N_i M_j ,

linear in the control points P for constant (u, v). Theory: ``docs/theory/cad.rst``.

References
----------
L. Piegl and W. Tiller, *The NURBS Book*, 2nd edition, Springer, 1997, section 4.5.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import NdBSpline
from scipy.sparse import csr_array

from ...base.display import OneLine

__all__ = ["Jets", "NurbsSurface"]


class Jets(NamedTuple):
    """Points of a surface and their derivatives in u and v."""

    points: np.ndarray  # (n, 3), in metres
    tangents: np.ndarray  # (n, 2, 3)
    second: np.ndarray  # (n, 2, 2, 3)


@dataclass(frozen=True, eq=False)
class NurbsSurface(OneLine):
    """A rational B-spline surface with parameters from 0 to 1."""

    knots: tuple[np.ndarray, np.ndarray]  # open knots in u and v, from 0 to 1
    degrees: tuple[int, int]
    control_points: np.ndarray  # (N_u, N_v, 3), in metres
    weights: np.ndarray  # (N_u, N_v), positive

    def at(self, control_points: np.ndarray) -> NurbsSurface:
        """Return the surface with other control points, shape (N_u N_v, 3), in C order."""
        return replace(self, control_points=control_points.reshape(self.control_points.shape))

    @property
    def n_control(self) -> int:
        """Number of control points."""
        return self.weights.size

    @cached_property
    def _spline(self) -> NdBSpline:
        """A and w together."""
        net = np.concatenate([self.weights[..., None] * self.control_points, self.weights[..., None]], axis=-1)
        return NdBSpline(self.knots, net, self.degrees)

    def points(self, uv: np.ndarray) -> np.ndarray:
        """Points at parameters, shape (n, 2): (n, 3), in metres."""
        found = self._spline(uv)
        return found[:, :3] / found[:, 3:]

    def jets(self, uv: np.ndarray) -> Jets:
        """Points and derivatives at parameters, shape (n, 2)."""
        orders = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        whole, u, v, uu, mixed, vv = (self._derivative(uv, order) for order in orders)
        weight = whole[:, 3:]
        point = whole[:, :3] / weight
        first = [(rate[:, :3] - rate[:, 3:] * point) / weight for rate in (u, v)]

        def second(rate: np.ndarray, i: int, j: int) -> np.ndarray:
            ways = (u, v)
            left = rate[:, :3] - ways[i][:, 3:] * first[j] - ways[j][:, 3:] * first[i] - rate[:, 3:] * point
            return left / weight

        cross = second(mixed, 0, 1)
        rows = [np.stack([second(uu, 0, 0), cross], axis=1), np.stack([cross, second(vv, 1, 1)], axis=1)]
        return Jets(point, np.stack(first, axis=1), np.stack(rows, axis=1))

    def _derivative(self, uv: np.ndarray, order: tuple[int, int]) -> np.ndarray:
        """A derivative of A and w, (n, 4)."""
        return self._spline(uv, nu=order)

    def matrix(self, uv: np.ndarray) -> csr_array:
        """Rational basis functions at parameters, shape (n, 2): (n, N_u N_v); rows sum to one."""
        found = NdBSpline.design_matrix(uv, self.knots, self.degrees)
        weighted = found.data * self.weights.ravel()[found.indices]
        sums = np.add.reduceat(weighted, found.indptr[:-1]) if len(uv) else np.ones(0)
        data = weighted / np.repeat(sums, np.diff(found.indptr))
        return csr_array((data, found.indices, found.indptr), shape=(len(uv), self.n_control))

    def lattice(self, least: int, per_span: int, most: int) -> tuple[np.ndarray, np.ndarray]:
        """Parameters in u and v: some in every span, at least ``least``, about ``most`` if there are many spans."""
        found = []
        for knots in self.knots:
            breaks = np.unique(knots)
            each = max(min(per_span, most // (len(breaks) - 1)), -(-least // (len(breaks) - 1)), 1)
            found.append(np.interp(np.arange(each * (len(breaks) - 1) + 1) / each, np.arange(len(breaks)), breaks))
        return found[0], found[1]
