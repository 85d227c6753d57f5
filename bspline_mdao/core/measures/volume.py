"""Volume enclosed by a surface whose open edges are closed by symmetry planes.

Theory: ``docs/theory/geometry.rst``, "Volume".
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from ...base.display import OneLine
from ...errors import InputError
from ...grids.cells.quads import add_to_nodes, area_vectors, area_vectors_vjp
from ..mesh.frame import Plane
from ..mesh.surface import SurfaceGrid
from .measure import relative_to_baseline, single_row

__all__ = ["EnclosedVolume", "apexes_of_caps", "open_edges", "planes_of_edges"]

_IN_PLANE = 1e-6
"""Distance from a plane, relative to the diagonal of the surface's box, at which an edge still lies in it: well above
the errors of fits and of grids in single precision, well below the width of a cell."""

_NONE = 1e-14
"""Volume, relative to the cubed diagonal of the surface's box, that may be round-off of the sum of cones."""


@dataclass(frozen=True, eq=False)
class EnclosedVolume(OneLine):
    """Volume between bilinear quads and the symmetry planes on which they end; make it by `of`.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    quads : ndarray of int, shape (n, 4)
        Quads of the surface, and triangles that close it.
    apexes : ndarray, shape (n_apexes, 3)
        Fixed points (m), numbered after the nodes: apexes of the triangles.
    origin : ndarray, shape (3,)
        Common apex of the cones on all quads (m).
    scale : float
        Divisor of the sum: the volume on the baseline (m^3), or 1; negative if normals point inwards.
    units : str or None
        Units.
    name : str
        Name of the output.

    Notes
    -----
    By the divergence theorem the volume is exactly the sum of the cones on all quads, each a third of the mean corner
    times the area vector. With the origin in a symmetry plane the opening there contributes nothing; between parallel
    planes the openings are closed by triangles. Nodes in these planes are assumed to stay there.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import EnclosedVolume, SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> volume = EnclosedVolume.of(surface, relative=True)
    >>> volume.evaluate(surface.points * [1.0, 1.1, 1.0]).round(6)  # of a body that is 10 % thicker
    array([1.1])
    """

    surface: SurfaceGrid
    quads: np.ndarray
    apexes: np.ndarray
    origin: np.ndarray
    scale: float
    units: str | None
    name: str
    shape = (1,)

    @classmethod
    def of(cls, surface: SurfaceGrid, relative: bool = False, name: str = "volume") -> EnclosedVolume:
        """Measure a closed surface, or one that ends on symmetry planes.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        relative : bool
            Whether to divide by the volume of the baseline.
        name : str
            Name of the output.

        Returns
        -------
        EnclosedVolume
            Positive on the baseline, for bodies in a flow and for ducts around it.

        Raises
        ------
        InputError
            If the surface is open elsewhere (the edge is named), or with ``relative``, if the baseline has no volume.

        Examples
        --------
        >>> from bspline_mdao import fit_grid
        >>> from bspline_mdao.generators import onera_m6_grid
        >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((17, 17, 13)), n_control=(9, 8, 7)))
        >>> EnclosedVolume.of(surface).evaluate(surface.points).round(4)
        array([0.0623])
        """
        edges, middle = open_edges(surface), surface.points.mean(axis=0)
        planes, numbers = planes_of_edges(surface, edges, name)
        apexes = apexes_of_caps(planes, middle, surface.size, name) if planes else middle[None]
        ids = surface.n_points + numbers
        caps = np.column_stack([edges[:, ::-1], ids, ids])
        quads = np.concatenate([surface.quads, caps]) if np.ptp(apexes, axis=0).any() else surface.quads
        measure = cls(surface, quads, apexes, apexes[0], 1.0, None if relative else "m**3", name)
        return _directed(measure, relative)

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Volume, shape (1,), from nodes, shape (n_points, 3)."""
        corners = self._corners(points)
        return np.array([np.sum(corners.mean(axis=1) * area_vectors(corners)) / (3.0 * self.scale)])

    def partials(self, points: np.ndarray) -> csr_array:
        """Derivatives of the volume, shape (1, 3 n_points)."""
        corners = self._corners(points)
        bar = area_vectors(corners)[:, None] / 4.0 + area_vectors_vjp(corners, corners.mean(axis=1))
        gradient = add_to_nodes(self.quads, bar, self.surface.n_points + len(self.apexes))
        return single_row(gradient[: self.surface.n_points] / (3.0 * self.scale))

    def _corners(self, points: np.ndarray) -> np.ndarray:
        return np.concatenate([points - self.origin, self.apexes - self.origin])[self.quads]


def _directed(measure: EnclosedVolume, relative: bool) -> EnclosedVolume:
    """Choose the side of the surface that encloses the volume."""
    least = _NONE * measure.surface.size**3
    if relative:
        return relative_to_baseline(measure, least)
    is_inward = measure.evaluate(measure.surface.points)[0] < -least
    return replace(measure, scale=-1.0) if is_inward else measure


def open_edges(surface: SurfaceGrid) -> np.ndarray:
    """Edges that bound only one quad, shape (n, 2): their nodes, in the quad's direction."""
    start, end = surface.quads.ravel(), np.roll(surface.quads, -1, axis=1).ravel()
    start, end = start[start != end].astype(np.int64), end[start != end].astype(np.int64)
    there, back = start * surface.n_points + end, end * surface.n_points + start
    is_open = ~np.isin(there, back)
    return np.stack([start, end], axis=1)[is_open]


def planes_of_edges(
    surface: SurfaceGrid,
    edges: np.ndarray,  # int (n, 2), open edges of the surface
    what: str,  # name of the measure, for messages
) -> tuple[tuple[Plane, ...], np.ndarray]:
    """Find the symmetry plane in which each open edge lies."""
    # returns planes: the planes with edges
    # returns numbers int (n,): plane of each edge
    ends = surface.points[edges]
    distance = [np.abs(ends @ plane.normal - plane.offset).max(axis=1) for plane in surface.planes]
    near = np.reshape([_IN_PLANE * surface.size + 2.0 * plane.roughness for plane in surface.planes], (-1, 1))
    is_far = np.reshape(distance, (len(surface.planes), len(edges))) > near
    if is_far.all(axis=0).any():
        raise InputError(_complaint(surface, edges[np.argmax(is_far.all(axis=0))], what))
    used, numbers = np.unique(np.argmin(is_far, axis=0) if len(edges) else [], return_inverse=True)
    return tuple(surface.planes[int(number)] for number in used), numbers


def apexes_of_caps(
    planes: tuple[Plane, ...],  # planes at which a body ends
    middle: np.ndarray,  # (3,), point near which the points are wanted (m)
    size: float,  # size of the body (m)
    what: str,  # name of the measure, for messages
) -> np.ndarray:  # (n_planes, 3)
    """Give each plane the point from which triangles close its opening, a common one if they meet."""
    normals, offsets = np.array([plane.normal for plane in planes]), np.array([plane.offset for plane in planes])
    # the least-squares point nearest to the middle; normals within 1e-5 rad are parallel
    common = middle + np.linalg.pinv(normals, rcond=1e-5) @ (offsets - normals @ middle)
    off_plane = offsets - normals @ common
    if (np.abs(off_plane) > _IN_PLANE * size).any() and np.linalg.matrix_rank(normals, tol=1e-5) > 1:
        raise InputError(f"{what}: the planes of symmetry neither have a point in common nor are parallel")
    return common + off_plane[:, None] * normals


def _complaint(surface: SurfaceGrid, edge: np.ndarray, what: str) -> str:
    """Describe an open edge by its ends and the face that has it."""
    holders = [name for name, ids in zip(surface.names, surface.parts) if np.isin(edge, ids).all()]
    a, b = ("({:g}, {:g}, {:g})".format(*point) for point in surface.points[edge])
    return (
        f"{what}: the surface is open at the edge from {a} to {b} of {holders[0]}, and no plane of symmetry closes it; "
        f"add the patch that does"
    )
