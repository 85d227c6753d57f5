"""A smooth surface through rows of points, for nodes that slide on a body without a formula.

With the point S(u, v) nearest to p, its unit normal n and its fundamental forms I and II, the signed distance is
F = (p - S) . n, its gradient n and its Hessian, with the two tangents as columns of T,

    - T I^{-1} II (I - F II)^{-1} T^T .

Theory: ``docs/theory/sliding.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import NdBSpline, make_interp_spline
from scipy.spatial import cKDTree

from ...base.checks import as_array
from ...errors import InputError, MovementError
from .fixed_surface import FixedSurface, Levels

__all__ = ["SplineSurface"]

DEGREE = 3

MARGIN = 0.1
"""Parameters may leave the range of the points, 0 to 1, by this much: the surface continues smoothly."""

N_STARTS = 4
"""Samples between two points, in both directions; the search starts at the nearest."""

AWAY = 1.0
"""From parameters farther than this from the middle the search does not return to the patch."""

MAX_STEPS = 50
"""Most steps of Newton's method, which takes about five where it converges."""

ROUND_OFF = 1e-14
"""Steps of parameters that are rounding."""


@dataclass(frozen=True, eq=False, repr=False)
class SplineSurface(FixedSurface):
    """A smooth surface through rows of points, such as the side of a fuselage that a wing slides on.

    Parameters
    ----------
    points : array_like, shape (n, m, 3)
        Points in rows (m), at least 4 in each direction, without kinks, such as the nodes of a face of a block. A
        bicubic spline with continuous curvature goes through them.

    Raises
    ------
    InputError
        If they are not such rows, or neighbours coincide all along a line.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.movers import SplineSurface
    >>> x, y = np.meshgrid(np.linspace(-1.0, 1.0, 9), np.linspace(-1.0, 1.0, 11), indexing="ij")
    >>> saddle = SplineSurface(np.stack([x, y, 0.2 * x * y], axis=-1))
    >>> saddle.distances(np.array([[0.0, 0.0, 0.3]])).round(12)
    array([0.3])
    """

    points: np.ndarray

    def __post_init__(self) -> None:
        points = as_array(self.points, "spline surface: points")
        if points.ndim != 3 or points.shape[2] != 3 or min(points.shape[:2]) <= DEGREE or not np.isfinite(points).all():
            raise InputError(
                f"spline surface: points of shape {points.shape}; give shape (n, m, 3), rows of 4 points at least"
            )
        for direction, parameters in enumerate(self._parameters):
            if not (np.diff(parameters) > 0.0).all():
                number = int(np.argmin(np.diff(parameters))) + 1
                raise InputError(f"spline surface: lines {number} and {number + 1} of direction {direction} coincide")

    @cached_property
    def _parameters(self) -> tuple[np.ndarray, np.ndarray]:
        """Parameters of the lines of points: the mean length along the rows, from 0 to 1."""
        points, found = np.asarray(self.points, dtype=float), []
        for direction in (0, 1):
            steps = np.linalg.norm(np.diff(points, axis=direction), axis=-1).mean(axis=1 - direction)
            lengths = np.concatenate([[0.0], np.cumsum(steps)])
            found.append(lengths / max(lengths[-1], np.finfo(float).tiny))
        return found[0], found[1]

    @cached_property
    def _spline(self) -> NdBSpline:
        u, v = self._parameters
        along_u = make_interp_spline(u, np.asarray(self.points, dtype=float), k=DEGREE, axis=0)
        along_v = make_interp_spline(v, along_u.c, k=DEGREE, axis=1)
        return NdBSpline((along_u.t, along_v.t), np.moveaxis(along_v.c, 0, 1), DEGREE)

    @cached_property
    def _starts(self) -> tuple[cKDTree, np.ndarray]:
        """Points of the surface, and their parameters."""
        dense = [
            np.interp(np.arange(N_STARTS * (len(x) - 1) + 1) / N_STARTS, np.arange(len(x)), x) for x in self._parameters
        ]
        parameters = np.stack(np.meshgrid(*dense, indexing="ij"), axis=-1).reshape(-1, 2)
        return cKDTree(self._spline(parameters)), parameters

    def levels(self, points: np.ndarray) -> Levels:
        """Distance from the surface; for complex points to first order, as a complex step needs."""
        if np.iscomplexobj(points):
            real, step = self.levels(points.real), points.imag
            values = real.values + 1j * (real.gradients * step).sum(axis=1)
            return Levels(values, real.gradients + 1j * np.einsum("nij,nj->ni", real.hessians, step), real.hessians)
        uv, is_found = self.feet(points)
        is_lost = ~is_found | (np.abs(uv - 0.5).max(axis=1, initial=0.0) > 0.5 + MARGIN)
        if is_lost.any():
            place = points[np.argmax(is_lost)].round(6).tolist()
            raise MovementError(f"spline surface: no point of it is near {place}; give a surface that continues there")
        return self._distances(uv, points)

    def feet(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters of the points nearest to given ones, (n, 3), also beyond the edges, and whether found."""
        tree, parameters = self._starts
        uv = parameters[tree.query(points)[1]]
        steps, active = np.zeros_like(uv), np.arange(len(points))
        for _ in range(MAX_STEPS):
            tangents, second, away = self._at(uv[active], points[active])
            right = np.einsum("nic,nc->ni", tangents, away)
            matrix = tangents @ tangents.swapaxes(1, 2) - np.einsum("nijc,nc->nij", second, away)
            steps[active] = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
            uv[active] += np.clip(steps[active], -MARGIN, MARGIN)
            is_on_way = np.abs(steps[active]).max(axis=1) > ROUND_OFF
            active = active[is_on_way & (np.abs(uv[active] - 0.5).max(axis=1) < AWAY)]
            if not len(active):
                break
        return uv, np.abs(steps).max(axis=1, initial=0.0) <= np.sqrt(ROUND_OFF)

    def _distances(self, uv: np.ndarray, points: np.ndarray) -> Levels:
        """Signed distances of points from the surface at given parameters."""
        tangents, second, away = self._at(uv, points)
        normals = np.cross(tangents[:, 0], tangents[:, 1])
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        values = (away * normals).sum(axis=1)
        first_form = tangents @ tangents.swapaxes(1, 2)
        second_form = np.einsum("nijc,nc->nij", second, normals)
        rates = np.linalg.solve(first_form - values[:, None, None] * second_form, tangents)
        bending = np.linalg.solve(first_form, second_form)
        return Levels(values, normals, -tangents.swapaxes(1, 2) @ bending @ rates)

    def _at(self, uv: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Tangents, (n, 2, 3), their derivatives, (n, 2, 2, 3), and the vectors to points, (n, 3)."""
        spline = self._spline
        u, v = (spline(uv, nu=nu) for nu in ((1, 0), (0, 1)))
        uu, mixed, vv = (spline(uv, nu=nu) for nu in ((2, 0), (1, 1), (0, 2)))
        second = np.stack([np.stack([uu, mixed], axis=1), np.stack([mixed, vv], axis=1)], axis=1)
        return np.stack([u, v], axis=1), second, points - spline(uv)

    # what a surface of several patches needs of one

    @cached_property
    def widths(self) -> np.ndarray:
        """Parameters within which neighbours count, half a cell at each end: rows of low and high ends, (2, 2)."""
        return 0.5 * np.array([[x[1] - x[0], x[-1] - x[-2]] for x in self._parameters]).T

    @cached_property
    def edge(self) -> np.ndarray:
        """Parameters of points along all four edges, (n, 2)."""
        u, v = self._parameters
        ends = [
            np.stack(np.meshgrid(*pair, indexing="ij"), axis=-1).reshape(-1, 2) for pair in ((u, [0, 1]), ([0, 1], v))
        ]
        return np.concatenate(ends)

    def point(self, uv: np.ndarray) -> np.ndarray:
        """Points, (n, 3), at parameters, (n, 2)."""
        return self._spline(uv)

    def normal(self, uv: np.ndarray) -> np.ndarray:
        """Unit normals there, (n, 3)."""
        normals = np.cross(self._spline(uv, nu=(1, 0)), self._spline(uv, nu=(0, 1)))
        return normals / np.linalg.norm(normals, axis=1)[:, None]

    def cell(self, uv: np.ndarray) -> np.ndarray:
        """Lengths of the longer edges of the cells there (m), (n,)."""
        lengths = []
        for direction, x in enumerate(self._parameters):
            at = np.clip(np.searchsorted(x, uv[:, direction]) - 1, 0, len(x) - 2)
            nu = (1, 0) if direction == 0 else (0, 1)
            lengths.append(np.linalg.norm(self._spline(np.clip(uv, 0.0, 1.0), nu=nu), axis=1) * np.diff(x)[at])
        return np.maximum(*lengths)

    def is_within(self, uv: np.ndarray) -> np.ndarray:
        """Whether parameters are where the patch counts."""
        low, high = self.widths
        return ((uv > -low) & (uv < 1.0 + high)).all(axis=1)

    def weighted(self, uv: np.ndarray, points: np.ndarray, sign: float) -> tuple[Levels, Levels]:
        """Weights and signed distances of points, (n, 3), whose nearest ones have the given parameters."""
        at = self._distances(uv, points)
        rates, seconds = self._parameter_derivatives(uv, points)
        low, high = self.widths
        value, first, second = np.ones(uv.shape), np.zeros(uv.shape), np.zeros(uv.shape)
        for t, width, sense in ((uv, low, 1.0), (1.0 - uv, high, -1.0)):
            ends = _step(0.5 + 0.5 * t / width)
            of_end = ends[0], 0.5 * sense / width * ends[1], (0.5 / width) ** 2 * ends[2]
            second = second * of_end[0] + 2.0 * first * of_end[1] + value * of_end[2]
            value, first = value * of_end[0], first * of_end[0] + value * of_end[1]
        others = value[:, ::-1]
        slopes = first * others  # of the product of both directions in each parameter
        bends = np.stack([second[:, 0] * value[:, 1], second[:, 1] * value[:, 0]], axis=1)
        mixed = first[:, 0] * first[:, 1]
        curved = np.einsum("na,nak,nal->nkl", bends, rates, rates) + np.einsum("na,nakl->nkl", slopes, seconds)
        crossed = mixed[:, None, None] * np.einsum("nk,nl->nkl", rates[:, 0], rates[:, 1])
        hessians = curved + crossed + crossed.swapaxes(1, 2)
        weights = Levels(value.prod(axis=1), np.einsum("na,nak->nk", slopes, rates), hessians)
        return weights, Levels(sign * at.values, sign * at.gradients, sign * at.hessians)

    def _parameter_derivatives(self, uv: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and second derivatives of the nearest parameters in the points, (n, 2, 3) and (n, 2, 3, 3)."""
        spline, (tangents, second, away) = self._spline, self._at(uv, points)
        thirds = [spline(uv, nu=(3 - k, k)) for k in range(4)]
        third = np.array([[[thirds[a + b + c] for c in (0, 1)] for b in (0, 1)] for a in (0, 1)])  # (2, 2, 2, n, 3)
        matrix = tangents @ tangents.swapaxes(1, 2) - np.einsum("nabx,nx->nab", second, away)
        rates = np.linalg.solve(matrix, tangents)
        bends = np.einsum("nbcx,nax->nabc", second, tangents)
        change = bends + bends.transpose(0, 2, 1, 3) + bends.transpose(0, 2, 3, 1)
        change = change - np.einsum("abcnx,nx->nabc", third, away)
        along = np.einsum("nack,ncl->nakl", second, rates)
        right = along + along.swapaxes(2, 3) - np.einsum("nabc,nbk,ncl->nakl", change, rates, rates)
        n = len(uv)
        return rates, np.linalg.solve(matrix, right.reshape(n, 2, 9)).reshape(n, 2, 3, 3)


def _step(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A step from 0 at 0 to 1 at 1 with two continuous derivatives, and these."""
    t = np.clip(t, 0.0, 1.0)
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2), 30.0 * (t * (1.0 - t)) ** 2, 60.0 * t * (1.0 - t) * (1.0 - 2.0 * t)
