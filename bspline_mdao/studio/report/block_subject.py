"""The report page of a grid of blocks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np

from ...base.text import counted
from ...core.mesh.surface import SurfaceGrid
from ...core.model.fitted_model import FittedModel
from ...core.sliding.fixed_surface import Plane
from ...core.sliding.sliding_nodes import Slide, SlidingNodes
from ...errors import InputError
from ...grids.cells.cell_faces import CellFaces
from ...grids.cells.first_cells import FirstCells
from ...grids.cells.grid_quality import GridQuality
from ...grids.cells.report import WorstCell, report_quality
from ...grids.topology.periodic_gap import PeriodicGap, pair_gaps
from ...grids.topology.periodic_ties import gap_between, sides_of
from ...grids.topology.sharing import boundary_sections
from ...grids.topology.topology import describe
from .charts import Chart, quality_chart
from .shape import Axes, Shape
from .subject import Judgement, Layer, Mark, Subject, WallQuality, off_surfaces, subject_of
from .tables import Table, fit_table, number, quality_table, worst_table
from .walls import DrawnWalls, Walls, boundary_faces, every_line, lines_near, net_lines

__all__ = ["BlockSubject"]

MOST_POINTS = 20_000
"""Of the lines of symmetry planes."""

NEAR = 0.5
"""How far symmetry planes are drawn around the walls, in units of the longest side of their box."""


@subject_of.register(FittedModel)
class BlockSubject(Subject):
    """A fitted grid."""

    def __init__(self, model: FittedModel, slides: Sequence[Slide] = ()):
        self.model, self.slides = model, slides
        self.source, self.unit = model.header.source, model.header.length_unit
        self.baseline_points = model.control_points

    @property
    def n_nodes(self) -> int:
        """Nodes of all blocks."""
        return self.model.n_nodes

    @property
    def is_section(self) -> bool:
        """See `SurfaceGrid.is_section`."""
        has_walls = any(face.kind == "wall" for face in self.model.topology.boundary)
        return has_walls and SurfaceGrid.of(self.model).is_section

    @property
    def size(self) -> str:
        """Blocks, nodes and control points."""
        blocks, points = counted(len(self.model.topology.shapes), "block"), self.model.mesh.n_control_points
        return f"{blocks}, {self.n_nodes:,} nodes, {points:,} control points"

    def nodes_at(self, control_points: np.ndarray | None = None) -> np.ndarray:
        """See `FittedModel.regenerate`."""
        return self.model.regenerate(control_points, self.slides).to_vector().reshape(-1, 3)

    @property
    def layers(self) -> dict[str, str]:
        """Lines of the grid, control mesh, and blocks."""
        names = "Grid lines", "Control mesh", "Symmetry plane", "Worst cells", "Blocks"
        return dict(zip(("lines", "control", "symmetry", "worst", "blocks"), names))

    @cached_property
    def _faces(self) -> CellFaces | None:
        """Faces of the cells, as a flow numbers them; None if blocks have no cells for a flow."""
        try:
            return CellFaces.of(self.model.topology, self.nodes_at())
        except InputError:
            return None

    @property
    def pressure_faces(self) -> np.ndarray | None:
        """Wall faces of `EulerFlow`."""
        return None if self._faces is None else self._faces.corners_of("wall")

    def wall_quality(self, nodes: np.ndarray) -> WallQuality | None:
        """Q of Eq. (9)."""
        faces = self._faces
        if faces is None or not len(walls := faces.faces_of("wall")):
            return None
        q = np.concatenate([cells.q.ravel() for cells in self._quality.cells(nodes)])
        return WallQuality("Orthogonality Q", faces.corners[walls], q[faces.left[walls]])

    @cached_property
    def across_symmetry(self) -> int | None:
        """Axis across the symmetry plane with the most nodes."""
        grid = self.model.regenerate()
        planes = [window for patch in grid.patches if patch.kind == "symmetry" for window in patch.windows]
        if not planes:
            return None
        largest = max(planes, key=lambda window: np.prod(window.shape))
        return int(np.argmin(np.ptp(grid.blocks[largest.block].nodes[largest.slices].reshape(-1, 3), axis=0)))

    @cached_property
    def _quality(self) -> GridQuality:
        return GridQuality.of_baseline(self.model.regenerate())

    @property
    def heights(self) -> FirstCells | None:
        """First cells at walls."""
        cells = self._quality.first_cells
        return cells if len(cells.baseline) else None

    def walls(self, most_triangles: int) -> DrawnWalls:
        """Every n-th line of the walls."""
        return DrawnWalls.of(self.model.topology, self.nodes_at(), most_triangles)

    def layers_of(self, shape: Shape, walls: Walls) -> Iterator[Layer]:
        """Control mesh on the walls, planes of symmetry, and edges of blocks."""
        if shape.control_points is not None:
            nets = self._wall_nets(walls.are_walls)
            lines = net_lines([shape.control_points[net] for net in nets])
            yield Layer("control", lines, shape.control_points[np.unique(np.concatenate([n.ravel() for n in nets]))])
        planes = boundary_faces(self.model.topology, shape.nodes, "symmetry") if walls.are_walls else ()
        if planes:
            nets = [shape.nodes[face] for face in every_line(planes, MOST_POINTS)]
            yield Layer("symmetry", lines_near(net_lines(nets), shape.nodes[walls.rows], NEAR))
        yield Layer("blocks", self._edges(shape.nodes))

    def _wall_nets(self, are_walls: bool) -> list[np.ndarray]:
        """Numbers of the control points on walls, each array of shape (N, M)."""
        sections = boundary_sections(self.model.topology, self.model.mesh.control_ids)
        return [
            np.squeeze(ids)
            for face, ids in sections
            if (face.kind == "wall" or not are_walls) and np.squeeze(ids).ndim == 2
        ]

    def _edges(self, nodes: np.ndarray) -> np.ndarray:
        """Edges of all blocks, as lines with gaps."""
        parts = []
        for block in self.model.topology.layout.split(nodes):
            for direction in range(3):
                corners = np.moveaxis(block, direction, 2)[[0, 0, -1, -1], [0, -1, 0, -1]]
                step = _thinned(corners.shape[1])
                gap = np.full((4, 1, 3), np.nan)
                parts.append(np.concatenate([corners[:, step], gap], axis=1).reshape(-1, 3))
        return np.concatenate(parts)

    def judge(self, shapes: Sequence[Shape]) -> Judgement:
        """Q of Eq. (9), and the cells with the smallest corners."""
        reports = [report_quality(self._quality, shape.nodes) for shape in shapes]
        last = reports[-1]
        card = "smallest Q", number(last.q_min, 3), f"{last.n_inverted:,} of {last.n_cells:,} cells inverted"
        marks = [[_mark(cell) for cell in report.worst] for report in reports]
        tables = [quality_table(shapes, reports, self.unit)]
        if self.heights is not None:
            tables.append(worst_table(shapes[-1], last.worst, self.unit))
        return Judgement(card, marks, [quality_chart(shapes, reports)], tables)

    def misses(self, shapes: Sequence[Shape]) -> list[tuple[str, str, list[float]]]:
        """Gaps of all periodic sides, tied or not, and of all nodes that slide on surfaces."""
        model, baseline = self.model, self.model.regenerate()
        topology, found = model.topology, []
        for tied in topology.periodic:
            gaps = [gap_between(topology, tied, shape.nodes) for shape in shapes]
            found.append((" and ".join(sides_of(topology, tied)), f"a {tied.motion}", gaps))
        grids = (model.header.grid(topology.shapes, shape.nodes) for shape in shapes)
        for of_shapes in zip(*(pair_gaps(topology, baseline, grid) for grid in grids)):
            found.append((*_sides(of_shapes[0]), [gap.gap for gap in of_shapes]))
        curved = [slide for slide in self.slides if not isinstance(slide.surface, Plane)]
        if curved:
            sliding = SlidingNodes.of(topology, baseline.to_vector().reshape(-1, 3), self.slides)
            found.append(off_surfaces([slide.what for slide in curved], curved, sliding, shapes))
        return found

    def section_charts(self, shapes: Sequence[Shape], walls: Walls, axes: Axes) -> list[Chart]:
        """None: cells are drawn as lines on planes of symmetry."""
        return []

    @property
    def cards(self) -> list[tuple[str, str, str]]:
        """Nodes, control points, and the error of the fit."""
        model, n_points = self.model, self.model.mesh.n_control_points
        rms = f"{number(model.report.rms, 3)} {self.unit}"
        return [
            ("nodes", f"{self.n_nodes:,}", counted(len(model.topology.shapes), "block")),
            ("control points", f"{n_points:,}", f"one for {self.n_nodes / n_points:.0f} nodes"),
            ("RMS of the fit", rms, f"{number(100 * model.report.relative_rms, 2)} % of the mean edge"),
        ]

    @property
    def contents(self) -> tuple[str, str, list[Table]]:
        """Quality of the fit."""
        return "fit", "Fit", [fit_table(self.model)]


def _sides(gap: PeriodicGap) -> tuple[str, str]:
    """Sides of a pair, and how they meet."""
    pair = gap.pair
    return f"{describe(pair.windows[0])} and {describe(pair.others[0])}", f"a {pair.motion}"


def _mark(cell: WorstCell) -> Mark:
    return Mark(cell.place, f"{cell}<br>Q {cell.q:.3g}, corner {cell.corner:.3g}")


def _thinned(n: int, most: int = 40) -> np.ndarray:
    """At most about so many of n places, including both ends."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int))
