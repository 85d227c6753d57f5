"""The regenerated surface: nodes of patches, each once, and the quads between them.

Theory: ``docs/theory/geometry.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, singledispatch
from typing import Any

import numpy as np

from ...base.display import OneLine
from ...base.matching import MARKERS, PATCHES, matching_names
from ...errors import InputError
from ...grids.cells.quads import edges_of, rings
from ...grids.topology.boundary_surface import BoundarySurface, quads_in_turn
from ...grids.topology.node_numbering import NodesByRow, face_layer_rows, face_rows, node_copies, source_rows
from ...grids.topology.topology import BoundaryFace, Topology, describe
from ..model.model import Model, nodes_at
from ..model.movable import Movable
from .allowed_directions import required_planes
from .boundary import matching_patches, wall_patches
from .frame import Plane
from .span_lines import span_lines

__all__ = ["SurfaceGrid", "surface_of"]

ON_PLANE = 1e-6
"""Distance, relative to the size of the surface, up to which a node lies in a plane of symmetry, a fit's error."""


@dataclass(frozen=True, eq=False)
class SurfaceGrid(OneLine):
    """Nodes of some patches of a grid, or of an unstructured mesh.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        The nodes on the baseline (m), each once, in the order of their rows in the grid.
    rows : ndarray of int, shape (n,)
        Row of each node in the grid vector.
    faces : tuple of ndarray of int, each of shape (ni, nj)
        Numbers of the nodes of every structured face, such that direction i x direction j points into the fluid. None
        if there is no structure.
    names, patches : tuple of str
        Name of every face, for messages, and its patch.
    planes : tuple of Plane
        Planes of symmetry of the grid.
    cells : tuple of ndarray of int, each of shape (n_quads, 4)
        Numbers of the nodes around each face of an unstructured patch, around the normal into the fluid; triangles
        have their last corner twice. One array for each of ``names``, instead of ``faces``.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(brick_grid((5, 5, 5, 5))), "body")
    >>> surface.patches, surface.points.shape
    (('body', 'body', 'body', 'body', 'body', 'body'), (98, 3))
    """

    points: np.ndarray
    rows: np.ndarray
    faces: tuple[np.ndarray, ...]
    names: tuple[str, ...]
    patches: tuple[str, ...]
    planes: tuple[Plane, ...] = ()
    cells: tuple[np.ndarray, ...] = ()

    @classmethod
    def of(cls, model: Movable, patches: str | Sequence[str] | None = None) -> SurfaceGrid:
        """Take the surface of a fitted grid, or of an unstructured mesh.

        Parameters
        ----------
        model : FittedModel, LocalModel or MeshModel
            The fitted grid, or the part that one of several processes needs; or a mesh, whose markers are patches.
        patches : str or sequence of str, optional
            Patches by name or pattern (``"wing*"``); all walls by default.

        Returns
        -------
        SurfaceGrid

        Raises
        ------
        InputError
            If a patch does not exist, no patch is a wall, or a symmetry patch is not planar.
        """
        return surface_of(model, patches)

    @classmethod
    def of_nodes(cls, topology: Topology, nodes: np.ndarray, patches: str | Sequence[str] | None = None) -> SurfaceGrid:
        """Take the surface of a grid that is not fitted.

        Parameters
        ----------
        topology : Topology
            Topology of the grid.
        nodes : ndarray, shape (n_nodes, 3)
            All nodes of the grid (m), blocks in order, each in C order.
        patches : str or sequence of str, optional
            Patches by name or pattern (``"wing*"``); all walls by default.

        Returns
        -------
        SurfaceGrid

        Raises
        ------
        InputError
            As for `of`.
        """
        return cls._of_faces(topology, nodes, _faces_of(topology, patches))

    @classmethod
    def _of_faces(
        cls, topology: Topology, nodes: np.ndarray | NodesByRow, found: Sequence[BoundaryFace]
    ) -> SurfaceGrid:
        whole = BoundarySurface.of(topology, nodes, found)
        names = tuple(f"{describe(face.window)}, {face.patch}" for face in found)
        patches, planes = tuple(str(face.patch) for face in found), _symmetry_planes(topology, nodes)
        return cls(nodes[whole.rows], whole.rows, whole.faces, names, patches, planes)

    @property
    def n_points(self) -> int:
        """Number of nodes."""
        return len(self.points)

    def on_planes(self, model: Movable) -> list[tuple[np.ndarray, np.ndarray]]:
        """Nodes of the surface on planes of symmetry of its model.

        Returns
        -------
        list of (ndarray of int, ndarray of shape (3,))
            For each face of symmetry with such nodes: their numbers, and the unit normal of the plane.
        """
        found = [(np.flatnonzero(np.isin(self.rows, rows)), normal) for rows, normal in model.nodes_on_planes()]
        return [(numbers, normal) for numbers, normal in found if len(numbers)]

    @cached_property
    def size(self) -> float:
        """Diagonal of the baseline's box (m)."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @cached_property
    def quads(self) -> np.ndarray:
        """Corners of the quads, shape (n_quads, 4), face by face in C order, around the normal into the fluid."""
        return np.concatenate(self.parts)

    @property
    def parts(self) -> tuple[np.ndarray, ...]:
        """Corners of the quads of each face, in the order of ``names``, each of shape (n_quads, 4)."""
        return self.cells or tuple(quads_in_turn(ids) for ids in self.faces)

    @property
    def lines(self) -> tuple[np.ndarray, ...]:
        """Numbers of the nodes in faces or lines, neighbours joined by edges; -1 between lines."""
        return tuple(map(rings, self.cells)) or self.faces

    @property
    def has_triangles(self) -> bool:
        """Whether some of its faces are triangles, through which no grid lines run."""
        return any((part == np.roll(part, 1, axis=1)).any() for part in self.cells)

    @property
    def is_section(self) -> bool:
        """Whether it is a section: between two planes of symmetry, and constant along the span."""
        return self.section_span is not None

    @cached_property
    def section_span(self) -> float | None:
        """Distance of the two planes of symmetry of a section (m); None if it is not a section."""
        ids, number = np.unique(self.quads, return_inverse=True)
        points, edges = self.points[ids], edges_of(number.reshape(-1, 4))
        near = [np.abs(points @ plane.normal - plane.offset) <= ON_PLANE * self.size for plane in self.planes]
        rows = [np.flatnonzero(is_near) for is_near in near]
        normals = [np.tile(plane.normal, (len(found), 1)) for plane, found in zip(self.planes, rows)]
        if not rows:
            return None
        lines = span_lines(points, edges, np.concatenate(rows), np.concatenate(normals))
        return None if lines is None else float(np.linalg.norm(points[lines[0, -1]] - points[lines[0, 0]]))

    def only(self, numbers: Sequence[int]) -> SurfaceGrid:
        """The surface with some of its faces, and all of its nodes."""

        def chosen(values: tuple[Any, ...]) -> tuple[Any, ...]:
            return tuple(values[number] for number in numbers) if values else ()

        return replace(
            self,
            names=chosen(self.names),
            patches=chosen(self.patches),
            faces=chosen(self.faces),
            cells=chosen(self.cells),
        )

    def part(self, patches: str | Sequence[str]) -> tuple[int, ...]:
        """Numbers of the faces of some patches, by name or pattern (``"wing*"``)."""
        wanted = matching_names(set(self.patches), patches, "surface", MARKERS if self.cells else PATCHES)
        if not wanted:
            raise InputError(f"surface: no patch is named; the patches are {', '.join(sorted(set(self.patches)))}")
        return tuple(number for number, patch in enumerate(self.patches) if patch in wanted)


@singledispatch
def surface_of(model: Movable, patches: str | Sequence[str] | None = None) -> SurfaceGrid:
    """Take the surface of a model, see `SurfaceGrid.of`."""
    raise InputError(f"the model of a surface is of type {type(model).__name__}; make it with fit_grid(grid)")


@surface_of.register
def _of_blocks(model: Model, patches: str | Sequence[str] | None = None) -> SurfaceGrid:
    """Take faces of blocks."""
    topology, found = model.topology, _faces_of(model.topology, patches)
    nodes = _nodes_at_faces(model, [*found, *(face for face in topology.boundary if face.kind == "symmetry")])
    return SurfaceGrid._of_faces(topology, nodes, found)


def _faces_of(topology: Topology, patches: str | Sequence[str] | None) -> list[BoundaryFace]:
    """Boundary faces of some patches, by default all walls."""
    wanted = wall_patches(topology) if patches is None else matching_patches(topology, patches)
    found = [face for face in topology.boundary if face.patch in wanted]
    if not found:
        raise InputError(f"{topology.source}: no patch is named; give names or patterns of patches, or none at all")
    return found


def _nodes_at_faces(model: Model, faces: Sequence[BoundaryFace]) -> NodesByRow:
    """Nodes of some faces on the baseline, of the layer next to them, and nodes that these are copies of."""
    layers = [rows.ravel() for face in faces for rows in face_layer_rows(model.topology, face.window)]
    rows = np.unique(np.concatenate(layers))
    rows = np.union1d(rows, source_rows(node_copies(model.topology), rows))
    return NodesByRow(rows, nodes_at(model, rows))


def _rows_of_symmetry(topology: Topology) -> list[np.ndarray]:
    """Rows of the nodes of each face of symmetry."""
    return [face_rows(topology, face.window).ravel() for face in topology.boundary if face.kind == "symmetry"]


def _symmetry_planes(topology: Topology, nodes: np.ndarray | NodesByRow) -> tuple[Plane, ...]:
    """Planes of the symmetry patches, each once."""
    whats = [f"{topology.source}: patch {face.patch}" for face in topology.boundary if face.kind == "symmetry"]
    found = required_planes([nodes[rows] for rows in _rows_of_symmetry(topology)], whats)
    signs = [np.sign(plane.normal[np.argmax(np.abs(plane.normal))]) for plane in found]
    planes = {
        id(plane): Plane(sign * plane.normal, float(sign * plane.offset), plane.roughness)
        for plane, sign in zip(found, signs)
    }
    return tuple(planes.values())
