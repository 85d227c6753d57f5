"""The mesh that a mover moves: hexahedra, and the directions in which each of their points may move.

A control mesh and a fine grid are the same thing to a mover. `bspline_mdao.core.mesh.boundary` makes either from a
fitted model or a grid and its patches. Which elements are still valid is given exactly by `Tangling`, for messages, and
by `ElementCorners` as a smooth function of the points, for a constraint: the aggregate ``corner_ks`` of grids, over the
elements of a mesh whose blocks share points.

Theory: ``docs/theory/movers.rst``, ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ...base.display import OneLine
from ...errors import InputError
from ...grids.cells.aggregates import KreisselmeierSteinhauser
from ...grids.cells.hexahedron import (
    CellQuality,
    cell_quality,
    collapsed_corners,
    element_measures,
    element_measures_vjp,
)
from ...grids.cells.quads import rings
from ...grids.topology.block_layout import BlockLayout
from ...grids.topology.periodic_ties import Ties
from ..sliding.fixed_surface import Plane
from ..sliding.sliding_nodes import Slide
from ..splines.volume import Volume
from .sliding_points import SlidingPoints, SlidPoints

__all__ = ["ElementCorners", "MovingMesh", "Tangling", "require_mesh"]


@dataclass(frozen=True)
class Tangling(OneLine):
    """Elements that are valid on the baseline but no longer."""

    n_tangled: int  # their number
    place: str  # the worst of them; empty if there is none
    min_corner: float  # smallest corner triple product of unit edges of the elements that are valid on the baseline
    # smallest ratio of an element's smallest corner triple product to its value on the baseline, of the same elements:
    # 1 if nothing has changed, 0 or less if the mesh tangles
    corner_ratio: float
    # invalid elements, whatever they are on the baseline, counted as in the report of a fit
    n_invalid: int


@dataclass(frozen=True, eq=False)
class MovingMesh(OneLine):
    """Blocks of hexahedra that share points, and the directions in which each point may move.

    Parameters
    ----------
    blocks : tuple of ndarray of int32, each of shape (N0, N1, N2)
        Numbers of the points of every block.
    names : tuple of str
        Name of every block for messages, such as ``"block 3"``.
    points : ndarray, shape (n_points, 3)
        Points of the baseline (m). They decide, once and for all, about everything discrete: collapsed corners,
        handedness and planes of symmetry. Points that are moved are given in every move.
    surface_ids : ndarray of int32, shape (n_surface,)
        Points of the design surface, ascending; all three coordinates are given.
    is_free : ndarray of bool, shape (n_points, 3)
        Directions of its frame in which each point may move; none on the surface and where a point is fixed.
    frames : ndarray, shape (n_points, 3, 3), or None
        Rows are the orthonormal directions of each point that ``is_free`` refers to; the coordinate axes by default.
    in_plane_rows : ndarray of int, shape (n_in_plane,)
        Rows of ``surface_ids`` of the surface points that lie on a symmetry plane, or on another plane that they have
        to stay in, once for each plane.
    in_plane_normals : ndarray, shape (n_in_plane, 3)
        Unit normals of these planes.
    parameters : tuple of ndarray, each of shape (N0, N1, N2, 3), or None
        Parameters of every point of every block, if the mesh is a control mesh.
    volumes : tuple of Volume, or None
        Splines of every block, if the mesh is a control mesh.
    planes : tuple of (ndarray, float)
        Unit normals and offsets (m) of the planes of no declared kind in which points slide because the design surface
        ends on them; the surface itself may leave them.
    obstacles : tuple of (str, ndarray of int)
        Patches that are fixed although the design surface ends on them: their name for messages, and their points.
        Elements next to them tangle first.
    following : tuple of (str, ndarray of int)
        Curved patches that are free because the design surface ends on them, in the same format.
    surface_faces : ndarray of int, shape (n_faces, 4), or None
        Faces of the design surface by rows of ``surface_ids``, around the normal into the fluid, if the surface is not
        the blocks'; triangles have their last corner twice.
    markers : tuple of (str, ndarray of int, ndarray of int)
        Points in no block: their marker, for messages, the points, and their numbers in the marker.
    copies : ndarray of int, shape (n_copies, 2)
        Rows of ``surface_ids`` of surface points, and of points that move as they do: both planes of a section, or
        periodic sides.
    copy_turns : ndarray, shape (n_copies, 3, 3), or None
        Rotation by which the displacement of each copy is turned; none by default.
    ties : Ties, or None
        Points of periodic sides that are the same up to a motion; None if there are none.
    slides : tuple of Slide
        Patches that slide on non-planar fixed surfaces, and planes that end on them; empty if there are none.
    sliding_points : SlidingPoints, optional
        Map that takes the points themselves to these surfaces after a move, if the mesh is a grid. For a control mesh
        the nodes of its grid are taken there instead.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> mesh.n_points, mesh.points[mesh.surface_ids].shape, mesh.n_invalid
    (78, (26, 3), 0)
    """

    blocks: tuple[np.ndarray, ...]
    names: tuple[str, ...]
    points: np.ndarray
    surface_ids: np.ndarray
    is_free: np.ndarray
    frames: np.ndarray | None = None
    in_plane_rows: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    in_plane_normals: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    parameters: tuple[np.ndarray, ...] | None = None
    volumes: tuple[Volume, ...] | None = None
    planes: tuple[tuple[np.ndarray, float], ...] = ()
    obstacles: tuple[tuple[str, np.ndarray], ...] = ()
    following: tuple[tuple[str, np.ndarray], ...] = ()
    surface_faces: np.ndarray | None = None
    markers: tuple[tuple[str, np.ndarray, np.ndarray], ...] = ()
    copies: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), dtype=int))
    copy_turns: np.ndarray | None = None
    ties: Ties | None = None
    slides: tuple[Slide, ...] = ()
    sliding_points: SlidingPoints | None = None

    @property
    def n_points(self) -> int:
        """Number of points."""
        return len(self.points)

    @cached_property
    def size(self) -> float:
        """Diagonal of the baseline's box (m)."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @cached_property
    def surface_rows(self) -> np.ndarray:
        """Row of each point in ``surface_ids``, shape (n_points,); -1 for points that are not on the surface."""
        rows = np.full(self.n_points, -1)
        rows[self.surface_ids] = np.arange(len(self.surface_ids))
        return rows

    @cached_property
    def surface_ties(self) -> Ties | None:
        """The ties of the surface points, by their rows in ``surface_ids``."""
        return None if self.ties is None else self.ties.numbered(self.surface_rows)

    @cached_property
    def fixed_ids(self) -> np.ndarray:
        """Points that may not move and are not on the design surface, ascending."""
        is_fixed = self.is_free.sum(axis=1) == 0
        is_fixed[self.surface_ids] = False
        return np.flatnonzero(is_fixed).astype(np.int32)

    @cached_property
    def plane_normals(self) -> np.ndarray:
        """Unit normals of the planes in which points slide, shape (n_planes, 3), once for parallel planes.

        All directions if nodes slide on non-planar surfaces, which in general allow no rigid motion.
        """
        if self.curved_slides:
            return np.eye(3)
        rows = np.flatnonzero(self.is_free.sum(axis=1) == 2)
        directions = np.argmin(self.is_free[rows], axis=1)
        normals = np.eye(3)[directions] if self.frames is None else self.frames[rows, directions]
        normals = np.concatenate([normals, self.in_plane_normals])
        first = np.take_along_axis(normals, np.abs(normals).argmax(axis=1)[:, None], axis=1)
        _, which = np.unique(np.round(normals * np.sign(first), 5), axis=0, return_index=True)
        return normals[np.sort(which)]

    @cached_property
    def elements(self) -> np.ndarray:
        """Corners of the elements, shape (n_elements, 8), int32, block by block in C order.

        Corner ``a + 2 b + 4 d`` is at the ends a, b, d = 0, 1 of the directions i, j, k.
        """
        return np.concatenate([_hexahedra(ids) for ids in self.blocks])

    @cached_property
    def degenerate_corners(self) -> np.ndarray:
        """Corners with a collapsed edge on the baseline, as bits, shape (n_elements,), uint8."""
        return np.concatenate([bits.ravel() for bits in self._degenerate_corners])

    @cached_property
    def handedness(self) -> np.ndarray:
        """Sign of each element's block on the baseline, shape (n_elements,), int8."""
        signs = [np.full(quality.q.size, quality.handedness, dtype=np.int8) for quality in self._baseline_quality]
        return np.concatenate(signs)

    @cached_property
    def is_valid(self) -> np.ndarray:
        """Whether each element is valid on the baseline, shape (n_elements,)."""
        return np.concatenate([quality.is_valid.ravel() for quality in self._baseline_quality])

    @property
    def n_invalid(self) -> int:
        """Number of elements that are invalid on the baseline."""
        return int(np.count_nonzero(~self.is_valid))

    @property
    def curved_slides(self) -> tuple[Slide, ...]:
        """Elements of `slides` on non-planar surfaces."""
        return tuple(slide for slide in self.slides if not isinstance(slide.surface, Plane))

    def stranded_blocks(self) -> tuple[str, ...]:
        """Names of the blocks that no chain of shared points joins to the design surface, so nothing moves them."""
        n_blocks = len(self.blocks)
        block = np.repeat(np.arange(n_blocks), [ids.size for ids in self.blocks])
        points = np.concatenate([ids.ravel() for ids in self.blocks]) + n_blocks
        n = n_blocks + self.n_points
        graph = coo_array((np.ones(len(points), dtype=bool), (block, points)), shape=(n, n))
        part = connected_components(graph.tocsr(), directed=False)[1]
        moving = np.unique(part[self.surface_ids + n_blocks])
        return tuple(name for name, number in zip(self.names, part[:n_blocks]) if number not in moving)

    @cached_property
    def surface_lines(self) -> list[np.ndarray]:
        """Rows of ``surface_ids`` in blocks or lines, neighbours joined by edges; -1 for no such point."""
        if self.surface_faces is not None:
            return [rings(self.surface_faces)]
        return [self.surface_rows[ids] for ids in self.blocks]

    @property
    def point_lines(self) -> list[np.ndarray]:
        """Numbers of points in blocks or lines, neighbours joined by edges."""
        if self.surface_faces is None:
            return list(self.blocks)
        around = rings(self.surface_faces)
        return [*self.blocks, np.where(around < 0, -1, self.surface_ids[around])]

    def once(self, rows: np.ndarray) -> np.ndarray:
        """Rows of ``surface_ids`` with originals in place of `copies`, each once, in their order."""
        original = np.arange(len(self.surface_ids))
        original[self.copies[:, 1]] = self.copies[:, 0]
        _, first = np.unique(original[rows], return_index=True)
        return original[rows][np.sort(first)]

    def with_copies(self, displacement: np.ndarray) -> np.ndarray:
        """Displacements of the surface, shape (n_surface, 3), in place: copies move as their originals do."""
        moved = displacement[self.copies[:, 0]]
        displacement[self.copies[:, 1]] = (
            moved if self.copy_turns is None else np.einsum("nij,nj->ni", self.copy_turns, moved)
        )
        return displacement

    def slide(self, displacement: np.ndarray) -> np.ndarray:
        """Project displacements, shape (n_points, 3), onto allowed ones: zero on the surface and where fixed.

        Points of periodic sides take the mean of both sides. The projection is orthogonal, hence its own transpose.
        """
        if self.frames is None:
            slid = displacement * self.is_free
        else:
            in_frames = np.einsum("nij,nj->ni", self.frames, displacement) * self.is_free
            slid = np.einsum("nij,ni->nj", self.frames, in_frames)
        return slid if self.ties is None else self.ties.alike(slid)

    def slid(self, initial: np.ndarray, points: np.ndarray) -> SlidPoints | None:
        """Points after a move and sliding, from points before and after it, (n_points, 3) (m); None if none slide."""
        return None if self.sliding_points is None else self.sliding_points.at(initial, points)

    def alike(self, displacement: np.ndarray) -> np.ndarray:
        """Displacements of the surface, shape (n_surface, 3), averaged over both periodic sides where it ends on them.

        The projection is orthogonal, hence its own transpose.
        """
        return displacement if self.surface_ties is None else self.surface_ties.alike(displacement.copy())

    def place(self, element: int) -> str:
        """Name an element for a message."""
        (block,), (index,) = BlockLayout.of(map(np.shape, self.blocks)).cells.unravel(np.array([element]))
        return _place("element", index, self.names[block])

    def place_of_point(self, point: int) -> str:
        """Name a point for a message, by the first marker or block that holds it."""
        for name, ids, numbers in self.markers:
            if (ids == point).any():
                return f"node {numbers[np.argmax(ids == point)]} of marker '{name}'"
        for name, ids in zip(self.names, self.blocks):
            found = np.argwhere(ids == point)
            if len(found):
                return _place("point", found[0], name)
        raise IndexError(point)

    def place_of_surface_point(self, row: int | np.integer) -> str:
        """Name a surface point for a message, by its row in ``surface_ids``."""
        return self.place_of_point(self.surface_ids[row])

    def tangled(self, points: np.ndarray) -> Tangling:
        """Find the elements that are valid on the baseline but not with these points, shape (n_points, 3)."""
        n_tangled, place, least, ratio, n_invalid = 0, "", np.inf, np.inf, 0
        for name, ids, degenerate_corners, baseline in zip(
            self.names, self.blocks, self._degenerate_corners, self._baseline_quality
        ):
            quality = cell_quality(points[ids], degenerate_corners)
            corner = quality.min_corner if quality.handedness == baseline.handedness else -np.abs(quality.min_corner)
            corner = np.where(np.isnan(corner), -np.inf, corner)
            n_invalid += int(np.count_nonzero(corner <= 0.0))
            corner = np.where(baseline.is_valid, corner, np.inf)
            n_tangled += int(np.count_nonzero(corner <= 0.0))
            ratio = min(ratio, float(np.min(corner / np.where(baseline.is_valid, baseline.min_corner, 1.0))))
            worst = np.unravel_index(np.argmin(corner), corner.shape)
            if corner[worst] < least:
                least = float(corner[worst])
                place = "" if least > 0.0 else _place("element", worst, name) + self._obstacle(ids, worst)
        return Tangling(n_tangled, place, least, ratio, n_invalid)

    def _obstacle(self, ids: np.ndarray, element: tuple[Any, ...]) -> str:
        """The `obstacles` that an element of a block lies on, in words; empty if none."""
        corners = ids[tuple(slice(n, n + 2) for n in element)]
        nearby = [what for what, points in self.obstacles if np.isin(corners, points).any()]
        return f" on {nearby[0]}, which is fixed where the surface ends on it" if nearby else ""

    @cached_property
    def _degenerate_corners(self) -> list:
        return [collapsed_corners(self.points[ids]) for ids in self.blocks]

    @cached_property
    def _baseline_quality(self) -> list[CellQuality]:
        pairs = zip(self.blocks, self._degenerate_corners)
        return [cell_quality(self.points[ids], degenerate_corners) for ids, degenerate_corners in pairs]


@dataclass(frozen=True, eq=False)
class ElementCorners(OneLine):
    """Smooth lower bound of the corner triple products of the elements that are valid on the baseline.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> corners = ElementCorners.of(mesh, rho=100.0)
    >>> corners.value(mesh.points) < mesh.tangled(mesh.points).min_corner
    True
    """

    elements: np.ndarray  # int (n_e, 8), corners of these elements
    handedness: np.ndarray  # (n_e,), sign of the block of each on the baseline
    degenerate_corners: np.ndarray  # uint8 (n_e,), corners with a collapsed edge on the baseline, as bits: not counted
    n_points: int  # points of the mesh
    rule: KreisselmeierSteinhauser  # how corners become one number

    @classmethod
    def of(
        cls,
        mesh: MovingMesh,  # the mesh; its points determine which elements are valid
        rho: float,  # sharpness: the bound is below the smallest corner by at most ``ln(8 n_e) / rho``
    ) -> ElementCorners:
        """Take the elements of a mesh."""
        valid = np.flatnonzero(mesh.is_valid)
        fields = (mesh.elements[valid], mesh.handedness[valid], mesh.degenerate_corners[valid])
        return cls(*fields, mesh.n_points, KreisselmeierSteinhauser(rho))

    def value(self, points: np.ndarray) -> float:
        """Bound with points (n_points, 3); 1 where no element is valid on the baseline."""
        return self.rule.value(self.rule.part(self._triples(points)))

    def gradient(self, points: np.ndarray) -> np.ndarray:
        """Derivative of the bound with respect to points (n_points, 3), with their shape."""
        triples = self._triples(points)
        weights = self.rule.weights(triples, self.rule.value(self.rule.part(triples)))
        place = points[self.elements], self.handedness, self.degenerate_corners
        bars = element_measures_vjp(*place, weights, np.zeros(len(weights))).reshape(-1, 3)
        ids = self.elements.ravel()
        return np.stack([np.bincount(ids, bars[:, c], minlength=self.n_points) for c in range(3)], axis=1)

    def _triples(self, points: np.ndarray) -> np.ndarray:
        return element_measures(points[self.elements], self.handedness, self.degenerate_corners).triples


def _hexahedra(ids: np.ndarray) -> np.ndarray:
    low, high = slice(None, -1), slice(1, None)
    corners = [ids[i, j, k] for k in (low, high) for j in (low, high) for i in (low, high)]
    return np.stack(corners, axis=-1).reshape(-1, 8).astype(np.int32)


def _place(what: str, index: Iterable[Any], name: str) -> str:
    i, j, k = (int(n) + 1 for n in index)
    return f"{what} ({i}, {j}, {k}) of {name}"


def require_mesh(mesh: Any, what: str) -> MovingMesh:
    """The argument, if it is a control mesh that is ready to move."""
    if not isinstance(mesh, MovingMesh):
        raise InputError(f"{what}: the mesh is of type {type(mesh).__name__}; make it with moving_mesh(model)")
    return mesh
