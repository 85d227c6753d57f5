"""Kinks and curvature jumps across seams as functions of control points, with derivatives, for constraints.

At places along a seam, X is the derivative into a side and Y the one along the seam; N, which is ``X x Y`` or its
negative, points into the fluid. The kink is the angle between the normals of both sides. The curvature across the seam
is the normal curvature perpendicular to Y,

    k = N . (G^2 S_xx - 2 F G S_xy + F^2 S_yy) / (G W^(3/2)),   F = X . Y,  G = Y . Y,  W = X . X G - F^2.

If a whole seam has no kink, both sides share all curvatures (G2) wherever they share this one. Theory:
``docs/theory/linear_constraints.rst``.

References
----------
M. P. do Carmo, *Differential Geometry of Curves and Surfaces*, 1976, section 3-3: normal curvature from the
coefficients of the fundamental forms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array, vstack

from ...base.checks import require_kind
from ...base.display import OneLine
from ...base.numerics.vectors import dots
from ...errors import InputError
from ..mesh.boundary import require_mesh_of
from ..mesh.moving_mesh import MovingMesh
from ..mesh.seams import Seam, SideEdge, find_seams
from ..mesh.spline_sides import spline_sides
from ..model.fitted_model import FittedModel
from .measure import Combinations

__all__ = ["SeamSmoothness"]

DEGREES = 180.0 / np.pi

NO_PLANE = 1e-6
"""Sine between both derivatives of a side, or their length relative to the longest, at which it has no tangent
plane."""

LINES = 3
"""Number of control point lines from the seam on which second derivatives depend."""


class _Bend(NamedTuple):
    """Quantities that give the curvature of a side."""

    normal: np.ndarray
    f: np.ndarray
    g: np.ndarray
    w: np.ndarray
    xx: np.ndarray
    xy: np.ndarray
    yy: np.ndarray
    value: np.ndarray


@dataclass(frozen=True, eq=False)
class SeamSmoothness(OneLine):
    """Kinks, or jumps of curvature, at places along the smooth seams of a model. Made by `kinks` or `curvature_jumps`.

    Parameters
    ----------
    points : ndarray, shape (n_surface, 3)
        Surface control points of the baseline (m).
    derivatives : Combinations
        Eight derivatives at every place: Y, S_yy, and X, S_xx, S_xy of each side.
    signs : ndarray, shape (n,)
        Signs with which ``X x Y`` of the first side points into the fluid.
    of_curvature : bool
        Whether it measures curvature jumps instead of kinks.
    name : str
        Name of the output.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import ball_grid
    >>> from bspline_mdao.measures import SeamSmoothness
    >>> from bspline_mdao.movers import moving_mesh
    >>> model = fit_grid(ball_grid((9, 9, 9, 9)))
    >>> jumps = SeamSmoothness.curvature_jumps(model, moving_mesh(model))
    >>> jumps.shape, bool(abs(jumps.evaluate(jumps.points)).max() < 1e-6)  # both sides are mirror images
    ((60,), True)
    """

    points: np.ndarray
    derivatives: Combinations
    signs: np.ndarray
    of_curvature: bool
    name: str

    @classmethod
    def kinks(
        cls,
        model: FittedModel,
        mesh: MovingMesh,
        patches: str | Sequence[str] | None = None,
        *,
        n_places: int = 5,
        max_kink: float = 5.0,
        name: str = "seam_kinks",
    ) -> SeamSmoothness:
        """Return angles between the tangent planes of both sides (deg), positive where the surface has an edge.

        Parameters
        ----------
        model : FittedModel
            The model, whose splines are measured without the residual.
        mesh : MovingMesh
            Its control mesh, which numbers the surface control points.
        patches : str or sequence of str, optional
            Patches by name or pattern; all walls by default.
        n_places : int
            Number of places along each seam, evenly in its parameter, without its ends.
        max_kink : float
            Places with a larger kink on the baseline (deg) are left out.
        name : str
            Name of the output.

        Raises
        ------
        InputError
            If a patch does not exist, the mesh belongs to another model, or no place is smooth.
        """
        require_kind(model, FittedModel, "the model of seams", "make it with fit_grid(grid)")
        require_mesh_of(model, mesh, "seams: the mesh")
        if n_places < 1:
            raise InputError(f"seams: {n_places} places along each; ask for at least 1")
        t = np.arange(1, n_places + 1) / (n_places + 1)
        sides = spline_sides(model, None, patches)
        seams = find_seams([(side.surface, side.ids) for side in sides])
        found = [_of_seam(seam, t, mesh) for seam in seams]
        points = mesh.points[mesh.surface_ids]
        if not found:
            raise InputError(
                f"{model.header.source}: no two sides of blocks on the surface share an edge; leave it out"
            )
        kinds = [csr_array(vstack([of_one[k] for of_one, _ in found], format="csr")) for k in range(8)]
        signs = np.repeat([sign for _, sign in found], n_places)
        with np.errstate(invalid="ignore", divide="ignore"):
            every = cls(points, Combinations.of(kinds), signs, False, name)
            smooth = every._has_planes() & (np.abs(every.evaluate(points)) <= max_kink)
        if not smooth.any():
            raise InputError(
                f"{model.header.source}: no seam is smooth to {max_kink:g} deg on the baseline; raise max_kink"
            )
        return cls(points, Combinations.of([kind[smooth] for kind in kinds]), signs[smooth], False, name)

    @classmethod
    def curvature_jumps(
        cls,
        model: FittedModel,
        mesh: MovingMesh,
        patches: str | Sequence[str] | None = None,
        *,
        n_places: int = 5,
        max_kink: float = 5.0,
        name: str = "seam_curvature_jumps",
    ) -> SeamSmoothness:
        """Return the second side's curvature across the seam minus the first side's (1/m).

        Parameters and errors are as for `kinks`. Curvature is positive where the surface bends towards its normal.
        """
        found = cls.kinks(model, mesh, patches, n_places=n_places, max_kink=max_kink, name=name)
        return replace(found, of_curvature=True)

    @property
    def units(self) -> str:
        """Units of the numbers."""
        return "1/m" if self.of_curvature else "deg"

    @property
    def shape(self) -> tuple[int]:
        """One number for each place."""
        return (self.derivatives.n_places,)

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Kinks (deg) or jumps (1/m), shape (n,), from surface control points (n_surface, 3); real or complex."""
        vectors = self.derivatives.vectors(points)
        if self.of_curvature:
            first, second = self._bends(vectors)
            return second.value - first.value
        sine, cosine = self._sine_and_cosine(vectors)
        return 2.0 * DEGREES * np.arctan(sine / (np.sqrt(sine**2 + cosine**2) + cosine))

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`, shape (n, 3 n_surface)."""
        vectors = self.derivatives.vectors(points)
        return self.derivatives.chain(self._of_bends(vectors) if self.of_curvature else self._of_kinks(vectors))

    def _has_planes(self) -> np.ndarray:
        """Whether both sides have a tangent plane on the baseline."""
        y, _, *sides = self.derivatives.vectors(self.points)
        found = np.ones(len(y), dtype=bool)
        for x in (sides[0], sides[3]):
            size = np.sqrt(np.stack([dots(x, x), dots(y, y)]))
            normal = np.cross(x, y)
            area = np.sqrt(dots(normal, normal))
            found &= (area > NO_PLANE * size.prod(axis=0)) & (size.min(axis=0) > NO_PLANE * size.max())
        return found

    def _sine_and_cosine(self, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Both times the lengths of the normals; the sine is positive at an edge."""
        y = vectors[0]
        first, second = np.cross(vectors[2], y), np.cross(y, vectors[5])
        return self.signs * dots(np.cross(second, first), y) / np.sqrt(dots(y, y)), dots(first, second)

    def _of_kinks(self, vectors: np.ndarray) -> list[np.ndarray]:
        """Derivatives of kinks with respect to the vectors."""
        y, x1, x2 = vectors[0], vectors[2], vectors[5]
        first, second = np.cross(x1, y), np.cross(y, x2)
        sine, cosine = self._sine_and_cosine(vectors)
        scale = DEGREES / (sine**2 + cosine**2)
        of_sine = (scale * cosine * self.signs)[:, None] * y / np.sqrt(dots(y, y))[:, None]
        of_cosine = -(scale * sine)[:, None]
        # both normals are perpendicular to Y: the length and direction of Y do not affect the sine
        of_first = np.cross(of_sine, second) + of_cosine * second
        of_second = np.cross(first, of_sine) + of_cosine * first
        none = np.zeros_like(y)
        of_y = np.cross(of_first, x1) + np.cross(x2, of_second)
        return [of_y, none, np.cross(y, of_first), none, none, np.cross(of_second, y), none, none]

    def _bends(self, vectors: np.ndarray) -> tuple[_Bend, _Bend]:
        y, yy, *sides = vectors
        return _bend(self.signs, y, yy, *sides[:3]), _bend(-self.signs, y, yy, *sides[3:])

    def _of_bends(self, vectors: np.ndarray) -> list[np.ndarray]:
        """Derivatives of jumps with respect to the vectors."""
        y, yy, *sides = vectors
        first, second = self._bends(vectors)
        a = _of_bend(-np.ones(len(y)), self.signs, first, y, yy, *sides[:3])
        b = _of_bend(np.ones(len(y)), -self.signs, second, y, yy, *sides[3:])
        return [a[0] + b[0], a[1] + b[1], *a[2:], *b[2:]]


def _bend(signs: np.ndarray, y: np.ndarray, yy: np.ndarray, x: np.ndarray, xx: np.ndarray, xy: np.ndarray) -> _Bend:
    """Curvature of a side across the seam."""
    normal = signs[:, None] * np.cross(x, y)
    f, g = dots(x, y), dots(y, y)
    w = dots(x, x) * g - f * f
    second = dots(normal, xx), dots(normal, xy), dots(normal, yy)
    value = (g * g * second[0] - 2.0 * f * g * second[1] + f * f * second[2]) / (g * w**1.5)
    return _Bend(normal, f, g, w, *second, value)


def _of_bend(
    bar: np.ndarray,
    signs: np.ndarray,
    bend: _Bend,
    y: np.ndarray,
    yy: np.ndarray,
    x: np.ndarray,
    xx: np.ndarray,
    xy: np.ndarray,
) -> list[np.ndarray]:
    """Derivatives of a side's curvature with respect to Y, S_yy, X, S_xx and S_xy, times ``bar``."""
    normal, f, g, w, a, b, c, value = bend
    per = bar / (g * w**1.5)
    a_bar, b_bar, c_bar = per * g * g, -2.0 * per * f * g, per * f * f
    w_bar = -1.5 * bar * value / w
    e_bar = w_bar * g
    f_bar = per * (-2.0 * g * b + 2.0 * f * c) - 2.0 * w_bar * f
    g_bar = per * (2.0 * g * a - 2.0 * f * b) - bar * value / g + w_bar * dots(x, x)
    normal_bar = signs[:, None] * (a_bar[:, None] * xx + b_bar[:, None] * xy + c_bar[:, None] * yy)
    x_bar = np.cross(y, normal_bar) + 2.0 * e_bar[:, None] * x + f_bar[:, None] * y
    y_bar = np.cross(normal_bar, x) + 2.0 * g_bar[:, None] * y + f_bar[:, None] * x
    return [y_bar, c_bar[:, None] * normal, x_bar, a_bar[:, None] * normal, b_bar[:, None] * normal]


def _of_seam(seam: Seam, t: np.ndarray, mesh: MovingMesh) -> tuple[list[csr_array], float]:
    """Weights of surface control points in the eight derivatives, and the sign of ``X x Y`` of the first side."""
    first, second = (_of_edge(edge, t, mesh) for edge in (seam.first, seam.second))
    sign = seam.first.inward * seam.first.along * (1.0 if seam.first.axis == 0 else -1.0)
    return [first[0], first[1], *first[2:], *second[2:]], sign


def _of_edge(edge: SideEdge, t: np.ndarray, mesh: MovingMesh) -> list[csr_array]:
    """Weights in Y, S_yy, X, S_xx and S_xy: derivatives of nets with one control point equal to one."""
    side, shape = edge.side, edge.ids.shape
    lines = np.moveaxis(np.arange(edge.ids.size).reshape(shape), edge.axis, 0)
    near = (lines[::-1] if edge.end else lines)[:LINES].ravel()
    layer = np.zeros((edge.ids.size, len(near)))
    layer[near, np.arange(len(near))] = 1.0
    layer = layer.reshape(*shape, -1) if side.axes[0] < side.axes[1] else layer.reshape(*shape, -1).swapaxes(0, 1)
    net = np.zeros((*side.net.shape[:3], len(near)))
    net[(slice(None),) * side.direction + (-side.end,)] = layer
    units, uv = replace(side, net=net), edge.uv(t)
    gradients, hessians = units.gradients(*uv), units.hessians(*uv)
    x, y = (0, 1) if edge.axis == 0 else (1, 0)
    found = (
        edge.along * gradients[..., y],
        hessians[..., 2 * y],
        edge.inward * gradients[..., x],
        hessians[..., 2 * x],
        edge.inward * edge.along * hessians[..., 1],
    )
    rows = mesh.surface_rows[edge.ids.ravel()[near]]
    width = len(mesh.surface_ids)
    return [_sparse(weights, rows, width) for weights in found]


def _sparse(weights: np.ndarray, columns: np.ndarray, width: int) -> csr_array:
    line, column = weights.nonzero()
    return csr_array(coo_array((weights[line, column], (line, columns[column])), shape=(len(weights), width)))
