"""Area of a surface, and of its projection along one direction.

Theory: ``docs/theory/geometry.rst``, "Areas".
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ...base.checks import as_direction
from ...base.display import OneLine
from ...errors import InputError
from ...grids.cells.quads import add_to_nodes, area_vectors, area_vectors_vjp
from ..mesh.frame import surface_frame
from ..mesh.surface import SurfaceGrid
from .measure import relative_to_baseline, single_row

__all__ = ["ProjectedArea", "SurfaceArea", "planform_normal"]

_COLLAPSED = 1e-12
"""Area, relative to the squared diagonal of the surface's box, up to which a quad is ignored: its area has no
derivative."""

_EDGE_ON = 1e-9
"""Component of the unit normal along the direction below which a quad is seen from neither side: its sign would be
round-off."""

_GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
"""The two Gauss points on [0, 1]; their weights are 1/2."""


@dataclass(frozen=True, eq=False)
class SurfaceArea(OneLine):
    """Area of bilinear quads, wetted area for a body; make it by `of`.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    quads : ndarray of int, shape (n, 4)
        Quads with an area on the baseline.
    scale : float
        Divisor of the area (m^2, or 1).
    units : str or None
        Units.
    name : str
        Name of the output.

    Notes
    -----
    Uses two Gauss points in each direction of every quad: exact for flat quads without a reflex corner, and accurate
    for twisted ones up to the fourth power of the change of the normal within the quad.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import SurfaceArea, SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> area = SurfaceArea.of(surface, relative=True)
    >>> area.evaluate(2.0 * surface.points)  # of a body twice as large
    array([4.])
    """

    surface: SurfaceGrid
    quads: np.ndarray
    scale: float
    units: str | None
    name: str
    shape = (1,)

    @classmethod
    def of(cls, surface: SurfaceGrid, relative: bool = False, name: str = "surface_area") -> SurfaceArea:
        """Return the measure of the area of a surface.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        relative : bool
            Whether to divide by the area of the baseline.
        name : str
            Name of the output.

        Returns
        -------
        SurfaceArea

        Examples
        --------
        >>> from bspline_mdao import fit_grid
        >>> from bspline_mdao.generators import flat_plate_grid
        >>> surface = SurfaceGrid.of(fit_grid(flat_plate_grid((9, 9, 9)), n_control=(5, 5, 5)))
        >>> SurfaceArea.of(surface).evaluate(surface.points).round(9)  # both sides of 1 m x 2 m
        array([4.])
        """
        has_area = _areas(surface.points[surface.quads]) > _COLLAPSED * surface.size**2
        measure = cls(surface, surface.quads[has_area], 1.0, None if relative else "m**2", name)
        return relative_to_baseline(measure, _COLLAPSED * surface.size**2) if relative else measure

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Area, shape (1,), from nodes, shape (n_points, 3)."""
        return np.array([_areas(points[self.quads]).sum() / self.scale])

    def partials(self, points: np.ndarray) -> csr_array:
        """Derivatives of the area, shape (1, 3 n_points)."""
        gradient = add_to_nodes(self.quads, _areas_gradient(points[self.quads]), self.surface.n_points)
        return single_row(gradient / self.scale)


@dataclass(frozen=True, eq=False)
class ProjectedArea(OneLine):
    """Projected area of a body in one direction. Made by `of`.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    direction : ndarray, shape (3,)
        Unit vector towards the observer.
    weights : ndarray, shape (n_quads,)
        Weight of each quad's area: 1 if it faces the observer on the baseline, 0 if it faces away, 1/2 if it is seen
        edge on.
    scale : float
        Divisor of the area (m^2, or 1).
    units : str or None
        Units.
    name : str
        Name of the output.

    Notes
    -----
    The sum of the signed projections of the quads that face the observer on the baseline: the area within their
    outline, which follows the same grid lines wherever the surface moves. Parts behind each other each count. For a
    closed body, or one cut by planes along the direction, it is half the sum over both sides.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import ProjectedArea, SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> area = ProjectedArea.of(surface, relative=True)  # as seen from above
    >>> area.evaluate(surface.points * [2.0, 1.0, 1.0]).round(6)
    array([2.])
    """

    surface: SurfaceGrid
    direction: np.ndarray
    weights: np.ndarray
    scale: float
    units: str | None
    name: str
    shape = (1,)

    @classmethod
    def of(
        cls,
        surface: SurfaceGrid,
        direction: np.ndarray | None = None,
        relative: bool = False,
        name: str = "projected_area",
    ) -> ProjectedArea:
        """Return the measure of the area of a surface seen from one direction.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        direction : ndarray, shape (3,), optional
            Towards the observer, of any length; by default `planform_normal`, which makes it the planform area.
        relative : bool
            Whether to divide by the area of the baseline.
        name : str
            Name of the output.

        Returns
        -------
        ProjectedArea

        Raises
        ------
        InputError
            If the direction has zero length, or nothing is seen from there.

        Examples
        --------
        >>> from bspline_mdao import fit_grid
        >>> from bspline_mdao.generators import onera_m6_grid
        >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4)))
        >>> ProjectedArea.of(surface, name="planform_area").evaluate(surface.points).round(4)
        array([1.1592])
        """
        direction = planform_normal(surface) if direction is None else as_direction(direction, f"{name}: direction")
        normals = area_vectors(surface.points[surface.quads])
        facing = normals @ direction
        is_edge_on = np.abs(facing) <= _EDGE_ON * np.linalg.norm(normals, axis=1)
        weights = 0.5 + 0.5 * np.sign(np.where(is_edge_on, 0.0, facing))
        if not np.dot(weights, facing) > _COLLAPSED * surface.size**2:
            raise InputError(f"{name}: nothing of the surface faces the direction {direction}; choose another one")
        measure = cls(surface, direction, weights, 1.0, None if relative else "m**2", name)
        return relative_to_baseline(measure, _COLLAPSED * surface.size**2) if relative else measure

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Area, shape (1,), from nodes, shape (n_points, 3)."""
        normals = area_vectors(points[self.surface.quads])
        return np.array([self.weights @ (normals @ self.direction) / self.scale])

    def partials(self, points: np.ndarray) -> csr_array:
        """Derivatives of the area, shape (1, 3 n_points)."""
        quads = self.surface.quads
        gradient = area_vectors_vjp(points[quads], self.weights[:, None] * (self.direction / self.scale))
        return single_row(add_to_nodes(quads, gradient, self.surface.n_points))


def planform_normal(surface: SurfaceGrid) -> np.ndarray:
    """Unit normal of a planform: the shortest direction of the surface across the span (`surface_frame`)."""
    return surface_frame(surface.points, surface.planes).axes[1]


def _tangents(corners: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Pairs of tangents along s and t at the four Gauss points, and the contribution of each corner."""
    for s in _GAUSS:
        for t in _GAUSS:
            along_s = np.array([t - 1, 1 - t, t, -t])
            along_t = np.array([s - 1, -s, s, 1 - s])
            yield np.einsum("c,ncd->nd", along_s, corners), np.einsum("c,ncd->nd", along_t, corners), along_s, along_t


def _areas(corners: np.ndarray) -> np.ndarray:
    """Areas, shape (n,), of quads, shape (n, 4, 3)."""
    normals = (np.cross(e_s, e_t) for e_s, e_t, _, _ in _tangents(corners))
    return 0.25 * sum(np.sqrt((normal * normal).sum(axis=-1)) for normal in normals)


def _areas_gradient(corners: np.ndarray) -> np.ndarray:
    """Derivatives of the areas with respect to the corners, shape (n, 4, 3)."""
    gradient = np.zeros_like(corners)
    for e_s, e_t, along_s, along_t in _tangents(corners):
        normal = np.cross(e_s, e_t)
        unit = 0.25 * normal / np.maximum(np.linalg.norm(normal, axis=-1), np.finfo(float).tiny)[:, None]
        gradient += along_s[:, None] * np.cross(e_t, unit)[:, None] + along_t[:, None] * np.cross(unit, e_s)[:, None]
    return gradient
