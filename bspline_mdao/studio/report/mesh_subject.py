"""The report page of an unstructured mesh."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...base.text import counted
from ...core.background.end_planes import EndPlane
from ...core.background.mesh_model import MeshModel
from ...core.sliding.sliding_nodes import Slide
from ...errors import InputError
from ...grids.cells.mesh_quality import mesh_quality
from ...grids.cells.mixed_cells import face_keys
from ...grids.cells.mixed_quality import MixedQuality
from ...grids.cells.node_heights import NodeHeights
from ...grids.cells.quads import edges_of
from .charts import Chart
from .mesh_charts import section_charts
from .mesh_quality import judge
from .mesh_walls import MeshWalls, edge_lines
from .shape import Axes, Shape
from .subject import Judgement, Layer, Subject, WallQuality, off_surfaces, subject_of
from .tables import Table, number
from .walls import Walls, lines_near, net_lines

__all__ = ["MeshSubject"]

MOST_EDGES = 20_000
"""Largest number of edges of symmetry planes that are drawn; above it, the longest."""

NEAR, NEAR_LATTICE = 0.5, 0.2
"""How far planes of symmetry and the lattice are drawn around the walls, in units of the longest side of their box."""


@dataclass(frozen=True, eq=False)
class MeshHeights:
    """Heights of the nodes next to the walls of a mesh."""

    of: NodeHeights
    patches: tuple[str, ...]
    parts: tuple[np.ndarray, ...]  # which of the nodes are at each wall

    @property
    def baseline(self) -> np.ndarray:
        """Heights before (m)."""
        return self.of.baseline

    @property
    def wall_rows(self) -> np.ndarray:
        """Rows of the nodes of walls."""
        return self.of.rows

    def heights(self, nodes: np.ndarray) -> np.ndarray:
        """Heights with nodes (m)."""
        return self.of.ratios(nodes) * self.of.baseline

    def by_patch(self) -> Iterator[tuple[int, np.ndarray]]:
        """Number of each wall, and which of the nodes are at it."""
        yield from ((number, ids) for number, ids in enumerate(self.parts) if len(ids))


@subject_of.register(MeshModel)
class MeshSubject(Subject):
    """A mesh with its lattice."""

    space_title, label = "The mesh", "Mesh of the model"

    def __init__(self, model: MeshModel, slides: Sequence[Slide] = ()):
        if slides:
            raise InputError(f"report: {model.source} says itself which of its nodes slide; leave 'slides' out")
        self.model, self.unit = model, model.mesh.length_unit
        self.source, self.baseline_points = model.source, model.control_points

    @property
    def n_nodes(self) -> int:
        """Nodes of the mesh."""
        return self.model.n_nodes

    @property
    def size(self) -> str:
        """Nodes, cells and points of the lattice."""
        mesh, lattice = self.model.mesh, self.model.lattice
        cells = counted(mesh.n_cells, "cell") + (" in a plane" if mesh.n_copies > 1 else "")
        return f"{counted(mesh.n_stored, 'node')}, {cells}, {lattice.n_control:,} control points of the lattice"

    def nodes_at(self, control_points: np.ndarray | None = None) -> np.ndarray:
        """Nodes of the mesh."""
        model = self.model
        return model.mesh.points if control_points is None else model.node_map.at(control_points).nodes

    @property
    def layers(self) -> dict[str, str]:
        """Edges, lattice, and planes of symmetry."""
        plane = "Mesh in its plane" if self.model.mesh.n_copies > 1 else "Symmetry plane"
        return {"lines": "Edges", "control": "Lattice", "symmetry": plane, "worst": "Worst cells"}

    @property
    def pressure_faces(self) -> None:
        """None: this package has no flow for such a mesh."""

    def wall_quality(self, nodes: np.ndarray) -> WallQuality:
        """Non-orthogonality of the cells, as in ``checkMesh``."""
        faces, cells = self.model.mesh.cell_faces
        keys = face_keys(self.model.walls.faces, self.n_nodes)
        found = np.flatnonzero(np.isin(face_keys(faces, self.n_nodes), keys))
        angles = mesh_quality(self.model.mesh, nodes).cell_angles
        return WallQuality("Non-orthogonality (deg)", faces[found], angles[cells[found]])

    @property
    def across_symmetry(self) -> int | None:
        """Axis across the plane with the most nodes."""
        planes = self.model.planes
        if not planes:
            return None
        return int(np.argmax(np.abs(max(planes, key=lambda plane: len(plane.rows)).normal)))

    @cached_property
    def quality(self) -> MixedQuality:
        """Quality measures of the cells."""
        return MixedQuality.of(self.model.mesh, self.model.walls.faces)

    @cached_property
    def heights(self) -> MeshHeights | None:
        """Nodes next to walls, in the plane for a two-dimensional file."""
        found, walls = self.quality.heights, self.model.walls
        if not len(found.rows):
            return None
        is_stored = found.rows < self.model.mesh.n_stored
        faces = [walls.faces[walls.marker == number] for number in range(len(walls.names))]
        return MeshHeights(
            found, walls.names, tuple(np.flatnonzero(is_stored & np.isin(found.rows, part)) for part in faces)
        )

    def walls(self, most_triangles: int) -> MeshWalls:
        """Triangles and quads of the walls."""
        walls = self.model.walls
        return MeshWalls.of(self.model.mesh.points, walls.faces, walls.marker, most_triangles)

    def layers_of(self, shape: Shape, walls: Walls) -> Iterator[Layer]:
        """Edges of the planes of symmetry, and the lattice around the walls."""
        around = shape.nodes[walls.rows]
        if len(self._plane_edges):
            yield Layer("symmetry", edge_lines(shape.nodes, self._plane_edges))
        if shape.control_points is not None:
            net = self.model.splines_at(shape.control_points)[1].reshape(*self.model.lattice.shape, 3)
            lines = lines_near(net_lines([net]), around, NEAR_LATTICE)
            points = lines[~np.isnan(lines[:, 0])]
            yield Layer("control", lines, np.unique(points, axis=0))

    @cached_property
    def _plane_edges(self) -> np.ndarray:
        """The longest edges of the planes near the walls, shape (n, 2), of one plane for a two-dimensional file."""
        model, points = self.model, self.model.mesh.points
        faces = [self._faces_in(plane) for plane in model.planes[:1] if model.mesh.n_copies > 1] or [
            self._faces_in(plane) for plane in model.planes
        ]
        edges = edges_of(np.concatenate([np.zeros((0, 4), dtype=int), *faces]))
        walls = points[model.wall_rows]
        low, high = walls.min(axis=0), walls.max(axis=0)
        reach = NEAR * (high - low).max()
        is_near = ((points >= low - reach) & (points <= high + reach)).all(axis=1)
        edges = edges[is_near[edges].all(axis=1)]
        lengths = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
        return edges[np.argsort(-lengths, kind="stable")[:MOST_EDGES]]

    def _faces_in(self, plane: EndPlane) -> np.ndarray:
        """Faces of the mesh in a plane, shape (n, 4)."""
        markers, is_in = self.model.mesh.markers or {}, np.zeros(self.n_nodes, dtype=bool)
        if plane.markers:
            return np.concatenate([markers[name] for name in plane.markers])
        is_in[plane.rows] = True
        faces, _ = self.model.mesh.cell_faces
        return faces[is_in[faces].all(axis=1)]

    def judge(self, shapes: Sequence[Shape]) -> Judgement:
        """Faces by the measures of ``checkMesh``, cells by their pyramids, and what is proved about the lattice."""
        return judge(self.model, self.quality, shapes)

    def misses(self, shapes: Sequence[Shape]) -> list[tuple[str, str, list[float]]]:
        """Gaps of periodic sides of the lattice, and of all nodes that slide on surfaces."""
        model = self.model
        found: list[tuple[str, str, list[float]]] = []
        for sides in model.periodic:
            gaps = [sides.gap(shape.nodes) for shape in shapes]
            found.append((" and ".join(sides.markers), f"a {sides.motion}", gaps))
        if model.sliding_nodes is not None:
            found.append(off_surfaces(model.slides, model.slides.values(), model.sliding_nodes, shapes))
        return found

    def section_charts(self, shapes: Sequence[Shape], walls: Walls, axes: Axes) -> list[Chart]:
        """Cells around a section and at its edges, and the lattice there."""
        return section_charts(self.model, shapes, walls, axes, self.heights)

    @property
    def cards(self) -> list[tuple[str, str, str]]:
        """Nodes, cells, and the lattice."""
        mesh, lattice = self.model.mesh, self.model.lattice
        kinds = ", ".join(f"{n:,} {kind}" for kind, n in mesh.cell_counts.items())
        on_walls = len(mesh.stored_ids(self.model.wall_rows))
        return [
            ("nodes", f"{mesh.n_stored:,}", f"{on_walls:,} on walls"),
            ("cells", f"{mesh.n_cells:,}", kinds),
            ("lattice", f"{lattice.n_control:,}", f"control points, spans of {number(lattice.spacing, 3)} {self.unit}"),
        ]

    @property
    def contents(self) -> tuple[str, str, list[Table]]:
        """Cells, markers and lattice."""
        mesh, model, lattice = self.model.mesh, self.model, self.model.lattice
        planes = {name for plane in model.planes for name in plane.markers}
        markers = [
            (name, model.kinds.get(name, "–"), f"{len(faces):,}", _what_nodes_do(model.kinds.get(name), name in planes))
            for name, faces in (mesh.markers or {}).items()
        ]
        spans = [_spans_text(np.diff(line.breaks), self.unit) for line in lattice.lines]
        resting = len(mesh.stored_ids(model.rows_at_rest))
        rows = [
            *((f"cells: {kind}", f"{n:,}") for kind, n in mesh.cell_counts.items()),
            ("nodes", f"{mesh.n_stored:,}"),
            ("nodes on walls", f"{len(mesh.stored_ids(model.wall_rows)):,}"),
            ("nodes at rest on other markers", f"{resting:,}"),
            ("control points of the lattice", f"{' x '.join(map(str, lattice.shape))} = {lattice.n_control:,}"),
            *((f"spans of the lattice, direction {axis}", text) for axis, text in enumerate(spans, start=1)),
            ("stiffness of the walls against the lattice", number(model.settings.stiffness)),
        ]
        columns = ("marker", "kind", "faces", "its nodes")
        tables = [Table("The mesh and its lattice", ("what", "value"), rows), Table("Markers", columns, markers)]
        return "contents", "Mesh and lattice", tables


def _spans_text(widths: np.ndarray, unit: str) -> str:
    """Number and widths of the spans of a direction."""
    if len(widths) == 1:
        return f"1 of {widths[0]:.3g} {unit}"
    return f"{len(widths)} of {widths.min():.3g} to {widths.max():.3g} {unit}"


def _what_nodes_do(kind: str | None, is_plane: bool) -> str:
    """Motion of the nodes of a marker, by its kind, when walls move."""
    if kind == "wall":
        return "move as prescribed"
    return "stay in their plane" if is_plane else "move along" if kind == "inner" else "stay"
