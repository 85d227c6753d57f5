"""The grid of a design, as ``move`` makes it, with its measures, fast enough for interactive use.

What many moves from the same points share is made once: the factor of the mover, the map to the grid with exact walls,
control points that follow walls, and what the baseline determines about cells.

The grid of a design of sliders only is bitwise equal to the grid of ``move --deform`` with the same words. With control
points pulled by hand, it is equal to the grid of ``move --deform FILE`` with the control points of its surface.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...base.display import OneLine
from ...core.design.deformation import Deformation
from ...core.design.named_deformations import parse_deformation
from ...core.fit.surface_fit import SurfaceFollower
from ...core.mesh.boundary import moving_mesh
from ...core.mesh.control_net import surface_normals
from ...core.mesh.moving_mesh import MovingMesh
from ...core.mesh.surface import SurfaceGrid
from ...core.model.fitted_model import FittedModel
from ...core.model.movable import ControlPointMap
from ...core.movement.default_mover import default_mover
from ...core.movement.mover import Mover
from ...core.walls.grid_map import GridMap
from ...errors import InputError, MovementError
from ...grids.cells.cell_loops import as_points
from ...grids.cells.grid_quality import GridQuality
from ...grids.cells.hexahedron import measured
from .drawn import Drawn
from .history import Design
from .numbers import Lift, Thickness
from .part import Part, corners_of
from .study_variables import StudyVariables
from .variables import Slider, sliders_of, words_of

__all__ = ["LiveModel", "Shape"]

MOST_WORST = 10
"""Largest number of cells that are pointed out."""

N_WATCHED = 200
"""Cells with the smallest corners, and with the smallest Q, of the baseline that every part includes: 0.1 % of
200,000, which costs a tenth of what is drawn."""


@dataclass(frozen=True, eq=False)
class Shape(OneLine):
    """The grid of a design and its measures."""

    design: Design
    control_points: np.ndarray  # (n_control_points, 3), of the whole mesh (m)
    wall: np.ndarray | None  # (n, 3), target nodes of walls (m); None if control points define them
    part: Part | None  # the part of the grid that was made; None for all of it
    nodes: np.ndarray  # (n_nodes, 3), the grid (m); NaN outside the part
    # (n_cells,), orthogonality and smallest corner triple product of every cell, not positive if it is inverted;
    # infinite outside the part
    q: np.ndarray
    corners: np.ndarray
    new: np.ndarray  # int, cells that are inverted and were not before
    worst: np.ndarray  # int, cells with the smallest corners, the worst first, at most `MOST_WORST`
    heights: np.ndarray  # (n_entries,), heights of first cells relative to the baseline
    thickness: np.ndarray  # (n_stations,), thickness-to-chord ratios of sections; empty if none is measured
    lift: float | None  # lift coefficient of the lattice; None without a wing, OpenAeroStruct, or a request for it
    seconds: Mapping[str, float]  # CPU seconds of each part

    @property
    def n_inverted(self) -> int:
        """Number of cells that are inverted and were not before."""
        return len(self.new)

    def largest_displacement(self, baseline: np.ndarray) -> float:
        """Largest displacement (m) from nodes of the baseline, shape (n_nodes, 3)."""
        rows = slice(None) if self.part is None else self.part.rows
        return float(np.linalg.norm(self.nodes[rows] - baseline[rows], axis=1).max())


class LiveModel:
    """A fitted model, ready to be deformed many times."""

    def __init__(
        self,
        model: FittedModel,
        mesh: MovingMesh | None = None,  # its control mesh; by default of all walls
        mover: Mover | None = None,  # moves the inner control mesh; the default one if None
        patches: Sequence[str] | None = None,  # patches that are the design surface, as in the mesh
        asked: Sequence[str] = (),  # further deformations, such as ``bend=60deg@0.7``, each with a slider up to it
        study: StudyVariables | None = None,  # variables that are the sliders, instead of deformations by name
    ) -> None:
        self.study = study
        self.model, self.mesh = model, moving_mesh(model) if mesh is None else mesh
        self.mover: Any = default_mover(model, self.mesh) if mover is None else mover
        self.surface = SurfaceGrid.of(model, patches or None)
        of_names = sliders_of(model, self.mesh, self.surface.is_section, asked) if study is None else ()
        self.sliders: tuple[Slider, ...] = of_names if study is None else study.sliders
        self.thickness = Thickness.of(self.surface)
        self.lift = Lift.of(model)
        self.baseline = model.regenerate().to_vector().reshape(-1, 3)
        self.quality = GridQuality.of_baseline(model.regenerate())
        self._start: Any = None  # factors of the mover, once made
        q, corners = self._measured(self.baseline)
        self._was_valid = corners > 0.0
        self._watched = np.concatenate([_lowest(q, N_WATCHED), _lowest(corners, N_WATCHED)])

    def warm(self, part: Part | None = None) -> None:
        """Make once what moves share, so the first requested one is as fast as the others."""
        slider = self.sliders[0] if self.sliders else None
        if slider is not None:
            with suppress(InputError, MovementError):  # reported when the shape is requested
                self.completed(self.at(self.neutral.with_value(0, slider.neutral + slider.step), part=part))

    @property
    def missing(self) -> tuple[tuple[str, str], ...]:
        """What is not measured of the model, and why."""
        return ("thickness of sections", self.thickness.why_not), ("lift", self.lift.why_not)

    @property
    def neutral(self) -> Design:
        """The design that is the model itself."""
        return Design(tuple(slider.neutral for slider in self.sliders))

    @property
    def first(self) -> Design:
        """The initial design: the model itself, or the start of a study."""
        return self.neutral if self.study is None else Design(self.study.first)

    def is_baseline(self, design: Design) -> bool:
        """Whether a design moves nothing."""
        return not design.pulls and (self.study.is_baseline(design.values) if self.study else design == self.neutral)

    def words(self, design: Design) -> str:
        """Write the sliders of a design in the words of ``move --deform``; variables of a study have none."""
        return words_of(self.sliders, design.values) if self.study is None else ""

    @cached_property
    def normals(self) -> np.ndarray:
        """Normals of the surface at its control points, into the fluid, shape (n_surface, 3); zero if unknown."""
        try:
            return surface_normals(self.mesh)
        except InputError:
            return np.zeros((len(self.mesh.surface_ids), 3))

    @cached_property
    def wall_map(self) -> GridMap:
        """Map to the grid with exact walls."""
        return self.model.map_meeting(self.surface.rows, self.model, self.mesh.slides)

    @cached_property
    def free_map(self) -> ControlPointMap:
        """Map to the grid from control points only."""
        return self.model.map_sliding(self.mesh.slides, self.model)

    @cached_property
    def follower(self) -> SurfaceFollower:
        """Control points that follow walls."""
        return SurfaceFollower.of(self.model, self.mesh, self.surface)

    @cached_property
    def _on_planes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        return self.surface.on_planes(self.model)

    def deformed(self, design: Design) -> tuple[np.ndarray, np.ndarray | None]:
        """Control points of a design's surface, (n_surface, 3), and nodes of its walls, (n, 3) or None (m).

        The second is None if control points alone define the walls. Raises `InputError` or `MovementError` if the
        surface cannot be deformed so.
        """
        words, points, wall = self.words(design), self.model.control_points[self.mesh.surface_ids], None
        if self.study is not None:
            points = self.study.surface(design.values)
        elif words:
            deformation = parse_deformation(words, self.model, self.mesh)
            wall = deformation.apply_to_nodes(self.surface.points, self._on_planes)
            points = self.follower.at(wall).control_points
        if not design.pulls:
            return points, wall
        pulled = np.zeros_like(points)
        for row, displacement in design.pulls:
            pulled[row] = displacement
        return points + self.allowed(pulled), None

    def allowed(self, displacement: np.ndarray) -> np.ndarray:
        """Displacements (n_surface, 3) of control points that stay in planes of symmetry, equal for all copies."""
        slid = Deformation(self.mesh, ()).slide(displacement)
        return self.mesh.with_copies(slid) if len(self.mesh.copies) else slid

    def part_of(self, cells: np.ndarray) -> Part:
        """Take cells, the cells at walls and the worst of the baseline."""
        cells = np.concatenate([cells, Drawn.of(self.model.topology).cells, self._watched])
        return Part.of(self.model, self.surface, self.mesh.slides, cells, self.quality.blocks)

    def at(self, design: Design, with_lift: bool = True, part: Part | None = None) -> Shape:
        """Make the grid of a design, or a part of it, and measure it.

        ``with_lift`` solves the flow as well, which takes as long as a small grid. Raises `InputError` or
        `MovementError` if the surface, or the grid behind it, cannot be deformed so.
        """
        clock = _Clock()
        surface, wall = self.deformed(design)
        clock.stop("surface")
        points = self._moved(surface, is_at_rest=self.is_baseline(design))
        clock.stop("movement")
        return self._shape(design, points, wall, with_lift and part is None, part, clock)

    def completed(self, shape: Shape) -> Shape:
        """Make the whole grid of a shape made in part, and solve the flow about it."""
        if shape.part is None:
            return shape if shape.lift is not None else replace(shape, lift=self.lift.at(shape.nodes))
        return self._shape(shape.design, shape.control_points, shape.wall, True, None, _Clock())

    def _shape(
        self,
        design: Design,
        points: np.ndarray,
        wall: np.ndarray | None,
        with_lift: bool,
        part: Part | None,
        clock: _Clock,
    ) -> Shape:
        """Make the grid from the control points of the whole mesh, and measure it."""
        of = self if part is None else part
        if wall is not None:
            nodes = of.wall_map.at(points, wall).nodes
        elif self.is_baseline(design):
            nodes = self.baseline if part is None else self.baseline[part.rows]
        else:
            nodes = of.free_map.at(points).nodes
        nodes = nodes if part is None else part.spread(nodes)
        clock.stop("grid")
        q, corners = self._measured(nodes) if part is None else part.measured(nodes)
        inverted, worst = np.flatnonzero(~(corners > 0.0)), _lowest(corners)
        if part is not None:
            inverted, worst = part.cells[inverted], part.cells[worst]
            q, corners = part.among_all(q, self.quality.n_cells), part.among_all(corners, self.quality.n_cells)
        clock.stop("quality")
        heights = self.quality.first_cells.ratios(nodes) if self.quality.first_cells.n_of_all else np.zeros(0)
        clock.stop("heights")
        thickness = self.thickness.at(nodes)
        clock.stop("thickness")
        lift = self.lift.at(nodes) if with_lift else None
        clock.stop("lift")
        new = inverted[self._was_valid[inverted]]
        made = wall, part, nodes, q, corners, new, worst
        return Shape(design, points, *made, heights, thickness, lift, clock.seconds)

    def _moved(self, surface: np.ndarray, is_at_rest: bool) -> np.ndarray:
        """Move the control mesh behind its surface, with the factor of the move before."""
        initial = self.model.control_points
        if is_at_rest:
            return initial
        is_shared = getattr(self._start, "points", None) is not None
        movement = self.mover.move(initial, surface, self._start) if is_shared else self.mover.move(initial, surface)
        self._start = getattr(movement, "start", None)
        return movement.points

    def _measured(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Q and smallest corner of every cell."""
        q, corners = np.empty(self.quality.n_cells), np.empty(self.quality.n_cells)
        for block in self.quality.blocks:
            for chunk in block.chunks():
                points, bits = as_points(chunk.solid(nodes, block.normal)), chunk.degenerate_corners
                found = measured(points, bits, block.handedness).reshape(4, -1)
                q[chunk.in_grid], corners[chunk.in_grid] = found[:2]
        return q, corners

    def middles(self, nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """Centres of some cells (m), shape (n, 3)."""
        return nodes[corners_of(self.model, cells)].mean(axis=1)

    def place_of(self, cell: int) -> str:
        """Name the place of a cell: ``(i, j, k) of block 2``, from 1."""
        (block,), (index,) = self.model.topology.layout.cells.unravel(np.array([cell]))
        return f"({', '.join(str(n + 1) for n in index.tolist())}) of block {block + 1}"


def _lowest(measure: np.ndarray, most: int = MOST_WORST) -> np.ndarray:
    """Cells with the smallest values of a measure, the worst first; NaN is worst."""
    values = np.where(np.isnan(measure), -np.inf, measure)
    n = min(most, len(values))
    found = np.argpartition(values, n - 1)[:n]
    return found[np.argsort(values[found], kind="stable")]


class _Clock:
    """CPU seconds of successive parts."""

    def __init__(self, now: Callable[[], float] = time.process_time) -> None:
        self.now, self._began = now, now()
        self.seconds: dict[str, float] = {}

    def stop(self, part: str) -> None:
        """End a part."""
        ended = self.now()
        self.seconds[part], self._began = ended - self._began, ended
