"""A smooth surface through rows of points, for nodes that slide on a body that no formula has.

With the point S(u, v) that is nearest to p, its unit normal n and its fundamental forms I and II, the signed distance
is F = (p - S) . n, its gradient n and its Hessian, with the two tangents as columns of T,

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
"""Parameters may leave those of the points, from 0 to 1, by so much: the surface goes on smoothly."""

N_STARTS = 4
"""Places between two points, in both directions, of which the nearest is where the search starts."""

MAX_STEPS = 50
"""Newton's method takes some five; it is given up where it does not settle."""

ROUND_OFF = 1e-14
"""Steps of parameters that are rounding."""


@dataclass(frozen=True, eq=False, repr=False)
class SplineSurface(FixedSurface):
    """A smooth surface through rows of points, such as the side of a fuselage that a wing slides on.

    Parameters
    ----------
    points : array_like, shape (n, m, 3)
        Points in rows (m), 4 in each direction at least, without kinks: nodes of a face of a block, say. A bicubic
        spline with continuous curvature goes through them.

    Raises
    ------
    InputError
        If they are no such rows, or neighbours coincide all along a line.

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
                raise InputError(f"spline surface: lines {number} and {number + 1} of direction {direction} are one")

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
        """Distance from the surface; of complex points to first order, as a complex step wants it."""
        if np.iscomplexobj(points):
            real, step = self.levels(points.real), points.imag
            values = real.values + 1j * (real.gradients * step).sum(axis=1)
            return Levels(values, real.gradients + 1j * np.einsum("nij,nj->ni", real.hessians, step), real.hessians)
        tree, parameters = self._starts
        uv = parameters[tree.query(points)[1]]
        for _ in range(MAX_STEPS):
            tangents, second, away = self._at(uv, points)
            right = np.einsum("nic,nc->ni", tangents, away)
            matrix = tangents @ tangents.swapaxes(1, 2) - np.einsum("nijc,nc->nij", second, away)
            step = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
            uv = uv + np.clip(step, -MARGIN, MARGIN)
            if not np.abs(step).max(initial=0.0) > ROUND_OFF:
                break
        is_lost = (np.abs(step).max(axis=1) > np.sqrt(ROUND_OFF)) | (np.abs(uv - 0.5).max(axis=1) > 0.5 + MARGIN)
        if is_lost.any():
            place = points[np.argmax(is_lost)].round(6).tolist()
            raise MovementError(f"spline surface: no point of it is near {place}; give a surface that goes on there")
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
        """Tangents, (n, 2, 3), their derivatives, (n, 2, 2, 3), and the ways to points, (n, 3)."""
        spline = self._spline
        u, v = (spline(uv, nu=nu) for nu in ((1, 0), (0, 1)))
        uu, mixed, vv = (spline(uv, nu=nu) for nu in ((2, 0), (1, 1), (0, 2)))
        second = np.stack([np.stack([uu, mixed], axis=1), np.stack([mixed, vv], axis=1)], axis=1)
        return np.stack([u, v], axis=1), second, points - spline(uv)
