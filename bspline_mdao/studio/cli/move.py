"""The command ``move``, and why it refuses a move.

Causes of inverted cells are checked in this order: a control mesh that is folded before anything moves; the residual of
the splines, if the grid of the splines alone stays valid; a control mesh that tangles; splines that fold over a valid
control mesh. Only cures that were tried are named, see `.cures`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ...base.numerics.progress import Progress, progress_bar, within
from ...base.text import counted
from ...core.cad.files import SUFFIXES
from ...core.cad.opencascade import require_opencascade
from ...core.cad.write_cad import write_cad
from ...core.design.deformation import Deformation
from ...core.design.named_deformations import PrescribedPoints, parse_deformation
from ...core.fit.surface_fit import SurfaceFollower, SurfaceMiss
from ...core.mesh.boundary import moving_mesh
from ...core.mesh.moving_mesh import MovingMesh
from ...core.mesh.surface import SurfaceGrid
from ...core.model.fitted_model import FittedModel
from ...core.movement.mover import MEND, IncrementReport, Movement
from ...core.sliding.sliding_nodes import SlidingNodes
from ...errors import InputError, MovementError
from ...grids.cells.certificate import Certificate, certify_cells
from ...grids.cells.grid_quality import GridQuality
from ...grids.cells.report import InvertedCell, QualityReport, inverted_cells, judge_move, patches_of, report_quality
from ...grids.io.disk import replaced_file
from ...grids.io.files import check_grid_name, write_grid
from ...grids.topology.grid import Grid
from ...grids.topology.index_space import Window
from ...grids.topology.periodic_gap import PeriodicGap, periodic_gaps
from ...grids.topology.periodic_ties import row_ties
from ...grids.topology.sharing import node_sharing
from ...grids.topology.topology import Topology, describe
from .cad import show_cad
from .cures import Trial, try_cures, verdict
from .mesh_periodic import block_numbers, gap_lines, split_lines
from .movers import MoverOptions
from .output import (
    MEANING_OF_INVALID,
    MEANING_OF_Q,
    certificate_numbers,
    check_outputs,
    height_numbers,
    height_warnings,
    print_lines,
    print_table,
    print_title,
    print_warnings,
    show_certificate,
    show_height_ratios,
    written_json,
)
from .remarks import show_remarks, still_lines
from .units import unit_warnings

QUALITY = {
    "q_min": "smallest Q",
    "q_mean": "mean Q",
    "min_corner": "smallest corner",
    "min_volume": "smallest volume ({unit}^3)",
    "n_inverted": "inverted cells",
}
"""Labels of the quality measures that are shown."""

INCREMENT_COLUMNS = ("number", "invalid", "new", "corner", "time (s)", "residual", "iterations", "digits")
"""Columns of the table of increments."""

FEW_DIGITS = 8.0
"""A warning is given if fewer digits of the displacements are correct."""


@dataclass(frozen=True)
class MoveOptions:
    """Options of the command ``move``."""

    deform: tuple[str, ...]  # deformations of the design surface, in order
    design: tuple[str, ...] = ()  # patches that are the design surface; all walls if empty
    # slide, fix, release: patches that slide in their planes, are fixed, and are free
    slide: tuple[str, ...] = ()
    fix: tuple[str, ...] = ()
    release: tuple[str, ...] = ()
    surface: Path | None = None  # file for the new control points of the design surface, or for the surface as CAD
    allow_invalid: bool = False  # write a grid with inverted cells anyway
    no_certify: bool = False  # do not prove which cells are valid everywhere
    mover: MoverOptions = field(default_factory=MoverOptions)  # mover and its settings


@dataclass(frozen=True)
class Moved:
    """A grid that was moved, and what is reported about it."""

    mesh: MovingMesh
    initial: np.ndarray
    surface: np.ndarray
    movement: Movement
    grid: Grid
    miss: SurfaceMiss | None
    before: QualityReport
    after: QualityReport
    newly_inverted: tuple[InvertedCell, ...]
    certificate: Certificate | None
    gaps: tuple[PeriodicGap, ...]
    slid_off: float | None  # largest distance (m) of sliding nodes from their surfaces; None if none slide
    periodic: list[dict]  # periodic sides, before and after
    split: tuple[float, str]  # largest difference of the deformation between walls on both sides of these, and where

    @property
    def largest_displacement(self) -> float:
        """Largest displacement of a surface control point (m)."""
        return float(np.linalg.norm(self.surface - self.initial[self.mesh.surface_ids], axis=1).max())


def move_model(
    model_file: Path,  # fitted model
    output: Path,  # output, json: grid and numbers to write
    json: Path | None,
    options: MoveOptions,  # deformation and how to move
) -> None:
    """Deform the design surface of a model, move the control mesh behind it and write the grid."""
    check_outputs([output, json, options.surface], [model_file, *filter(os.path.isfile, options.deform)])
    is_cad = options.surface is not None and options.surface.suffix.lower() in SUFFIXES
    if is_cad:
        require_opencascade()
    with progress_bar() as progress:
        progress(0.0, "reading")
        model = FittedModel.load(model_file)
        check_grid_name(output, model.header)
        moved = _move(model, model_file, options, progress)
        if moved.newly_inverted and not options.allow_invalid:
            progress(0.85, "searching for a cure")
            raise MovementError(complaint(model, moved, _trials(model, model_file, moved, options)))
        progress(0.9, "writing")
        with written_json(json, move_numbers(model_file, output, moved, options)):
            if options.surface is not None and is_cad:
                cad = write_cad(options.surface, model, moved.movement.points, options.design or None)
            elif options.surface:
                write_points(options.surface, moved.surface)
            write_grid(output, moved.grid, model.topology)
    show_move(model_file, output, moved, options)
    if is_cad:
        show_cad(cad)
    print_warnings(model.topology.warnings)


def moved_control_mesh(
    model: FittedModel, model_file: Path, options: MoveOptions, with_remarks: bool = False
) -> tuple[MovingMesh, Deformation, np.ndarray, Movement]:
    """Deform the design surface and move the control mesh behind it."""
    # Returns mesh; deformation; surface: (n_surface, 3), new control points of the design surface (m); movement.
    if not model.header.patches:
        raise InputError(
            f"{model_file}: its grid has no patches, so nothing says what moves; write them with "
            f"'bspline-mdao inspect GRID --draft patches.toml' and fit again with --patches patches.toml"
        )
    mesh = moving_mesh(model, options.design or None, options.fix, options.release, options.slide)
    mover = options.mover.make(mesh)
    initial = model.control_points
    deformation = parse_deformation(options.deform, model, mesh)
    if with_remarks:
        show_remarks(deformation, model, SurfaceGrid.of(model, options.design or None).is_section)
    surface = _surface_points(model, mesh, deformation, options.design)
    with within(0.1, 0.7):
        return mesh, deformation, surface, mover.move(initial, surface)


def _surface_points(
    model: FittedModel, mesh: MovingMesh, deformation: Deformation, patches: tuple[str, ...]
) -> np.ndarray:
    """Control points of the deformed surface: fitted to its nodes, as in components, or given."""
    if _is_given(deformation):
        return deformation.apply(model.control_points[mesh.surface_ids])
    surface = SurfaceGrid.of(model, patches or None)
    wall = deformation.apply_to_nodes(surface.points, surface.on_planes(model))
    return SurfaceFollower.of(model, mesh, surface).at(wall).control_points


def _is_given(deformation: Deformation) -> bool:
    """Whether control points come from a file, so nodes have no target."""
    return any(isinstance(point_map, PrescribedPoints) for point_map in deformation.maps)


def _move(model: FittedModel, model_file: Path, options: MoveOptions, progress: Progress) -> Moved:
    """Make the move and measure it."""
    mesh, deformation, surface, movement = moved_control_mesh(model, model_file, options, with_remarks=True)
    progress(0.7, "evaluating")
    baseline = model.regenerate()
    grid, miss, split = _grid(model, options, mesh, deformation, movement.points)
    progress(0.8, "quality")
    gaps = periodic_gaps(model.topology, baseline, grid)
    before, after = (each.to_vector().reshape(-1, 3) for each in (baseline, grid))
    off = SlidingNodes.of(model.topology, before, mesh.slides).off(after) if mesh.curved_slides else None
    periodic = block_numbers(model.topology, baseline, grid), split
    compared = _compared(baseline, grid, options)
    return Moved(mesh, model.control_points, surface, movement, grid, miss, *compared, gaps, off, *periodic)


def _grid(
    model: FittedModel, options: MoveOptions, mesh: MovingMesh, deformation: Deformation, points: np.ndarray
) -> tuple[Grid, SurfaceMiss | None, tuple[float, str]]:
    """Make the grid of moved control points, with the wall nodes at the targets of the same deformation."""
    # Returns grid; miss: how far the control points alone would have missed the targets, None if these come from a
    # file, and nodes have no target; split: see `Moved`.
    topology, slides = model.topology, mesh.slides
    if _is_given(deformation):
        return model.regenerate(points, slides), None, (0.0, "")
    surface = SurfaceGrid.of(model, options.design or None)
    wall = deformation.apply_to_nodes(surface.points, surface.on_planes(model))
    state = model.map_meeting(surface.rows, model, slides).at(points, wall)
    source = node_sharing(topology).source_rows()
    miss = SurfaceMiss.of(topology, source, surface.rows, wall - state.mismatch, wall)
    grid, unit = model.header.grid(topology.shapes, state.nodes), model.header.length_unit
    return grid, replace(miss, unit=unit), _split(topology, source[surface.rows], wall - surface.points)


def _split(topology: Topology, rows: np.ndarray, change: np.ndarray) -> tuple[float, str]:
    """Largest difference of the target motion (m) between wall nodes on both sides of periodic pairs, and where."""
    ties = row_ties(topology)
    if ties is None:
        return 0.0, ""
    of_grid, numbers = np.zeros((topology.n_nodes, 3)), np.full(topology.n_nodes, -1)
    of_grid[rows], numbers[rows] = change, rows
    on_walls = ties.numbered(numbers)
    if not len(on_walls.copies):
        return 0.0, ""
    turned = np.einsum("nij,nj->ni", on_walls.turns, of_grid[on_walls.originals])
    off = np.linalg.norm(turned - of_grid[on_walls.copies], axis=1)
    worst = int(np.argmax(off))
    (block,), (index,) = topology.layout.unravel(on_walls.copies[[worst]])
    return float(off[worst]), describe(Window(int(block), tuple(index.tolist()), tuple(index.tolist())))


def _compared(
    baseline: Grid, grid: Grid, options: MoveOptions
) -> tuple[QualityReport, QualityReport, tuple[InvertedCell, ...], Certificate | None]:
    """Quality before and after, the worst of the newly inverted cells, and what is proved about all."""
    quality = GridQuality.of_baseline(baseline)
    before, after = (g.to_vector().reshape(-1, 3) for g in (baseline, grid))
    newly_inverted = inverted_cells(quality, quality.cells(after), newly=True)
    certificate = None if options.no_certify else Certificate(certify_cells(quality, after))
    return report_quality(quality, before), report_quality(quality, after), newly_inverted, certificate


def write_points(path: Path, points: np.ndarray) -> None:
    """Write points (n, 3) in the format of ``--deform``."""
    with replaced_file(path) as part:
        np.savetxt(part, points, fmt="%.17g", delimiter=",", header="x,y,z")


def move_numbers(model_file: Path, output: Path, moved: Moved, options: MoveOptions) -> dict:
    """Collect the numbers of a move for JSON."""
    report = moved.movement.report
    return {
        "model": str(model_file),
        "grid": str(output),
        "deform": options.deform,
        "mover": options.mover.mover,
        "n_control_points": moved.mesh.n_points,
        "n_surface_control_points": len(moved.surface),
        "largest_displacement": moved.largest_displacement,
        "increments": [
            {
                **(vars(increment.solve) if increment.solve else {}),
                "n_invalid": increment.n_invalid,
                "n_tangled": increment.n_tangled,
                "place": increment.place,
                "min_corner": increment.min_corner,
                "corner_ratio": increment.corner_ratio,
            }
            for increment in report.increments
        ],
        "n_increments": report.n_increments,
        "n_elements": len(moved.mesh.elements),
        "n_invalid_before": moved.mesh.n_invalid,
        "following": [what for what, _ in moved.mesh.following],
        "sliding": [{"patch": slide.what, "surface": str(slide.surface)} for slide in moved.mesh.curved_slides],
        "sliding_off": moved.slid_off,
        "digits": report.digits,
        "seconds": report.seconds,
        "miss": vars(moved.miss) if moved.miss else None,
        "newly_inverted": [vars(cell) for cell in moved.newly_inverted],
        "before": {name: getattr(moved.before, name) for name in QUALITY},
        "after": {name: getattr(moved.after, name) for name in QUALITY},
        "certificate": moved.certificate and certificate_numbers(moved.certificate),
        "heights": height_numbers(moved.after.heights, is_compared=True),
        "periodic": moved.periodic,
        "periodic_gaps": [gap_numbers(gap) for gap in moved.gaps],
    }


def gap_numbers(gap: PeriodicGap) -> dict:
    """Collect the numbers of a gap between periodic faces for JSON; blocks and nodes are from 1."""
    return {
        "motion": str(gap.pair.motion),
        "gap": gap.gap,
        "block": gap.node.block + 1,
        "node": [n + 1 for n in gap.node.lo],
    }


def show_move(model_file: Path, output: Path, moved: Moved, options: MoveOptions) -> None:
    """Print the report of a move."""
    report, unit = moved.movement.report, moved.grid.length_unit
    sizes = f"{counted(moved.mesh.n_points, 'control point')}, {len(moved.surface):,} on the design surface"
    print_title(f"{model_file}: {sizes}")
    rows = [_row(number, increment) for number, increment in enumerate(report.increments, start=1)]
    solve = report.increments[-1].solve
    how = f"mover {options.mover.mover}{f', solver {solve.solver}' if solve else ''}"
    made = counted(report.n_increments, "increment")
    print_lines([f"surface moved by up to {moved.largest_displacement:.3g} {unit}; {how}", made])
    if moved.mesh.following:
        names = ", ".join(what for what, _ in moved.mesh.following)
        print_lines([f"the surface ends on curved faces, which follow it unless they are fixed (--fix): {names}"])
    print_lines([f"nodes of {slide.what} slide on {slide.surface}" for slide in moved.mesh.curved_slides])
    if moved.slid_off is not None:
        print_lines([f"they leave their places over these surfaces by {moved.slid_off:.2g} {unit} at most"])
    print_lines(gap_lines(moved.periodic, unit))
    print_lines(_of_elements(moved))
    print_table(INCREMENT_COLUMNS[: len(rows[0])], rows)
    print_table(
        ["quality of the grid", "before", "after"],
        [
            (label.format(unit=unit), getattr(moved.before, name), getattr(moved.after, name))
            for name, label in QUALITY.items()
        ],
    )
    print_lines([MEANING_OF_Q])
    if moved.certificate is not None:
        show_certificate(moved.certificate)
    show_height_ratios(moved.after.heights)
    if moved.miss:
        print_lines([f"the wall's nodes are where the deformation puts them; of control points alone, {moved.miss}"])
    print_warnings([*_warnings(moved), *unit_warnings(output, moved.grid)])
    print_lines([f"{output} written, {report.seconds:.2f} s for the move"])


def _of_elements(moved: Moved) -> list[str]:
    """Count the invalid elements of the control mesh before and after, with the meaning; empty if there are none."""
    mesh, last = moved.mesh, moved.movement.report.increments[-1]
    if not (mesh.n_invalid or last.n_invalid):
        return []
    counts = f"{mesh.n_invalid:,} of {counted(len(mesh.elements), 'element')} invalid before, {last.n_invalid:,} after"
    return [f"control mesh: {counts}, {last.n_tangled:,} of these new", MEANING_OF_INVALID]


def _row(number: int, increment: IncrementReport) -> tuple:
    """Row of the table of increments: the solver only if there is one."""
    row = number, increment.n_invalid, increment.n_tangled, increment.min_corner
    solve = increment.solve
    return (*row, solve.seconds, solve.residual, solve.iterations, f"{solve.digits:.0f}") if solve else row


def _warnings(moved: Moved) -> list[str]:
    """List what is wrong with a move that was made."""
    warnings = still_lines(moved.largest_displacement, moved.mesh.size)
    stranded = moved.mesh.stranded_blocks()
    if stranded:
        warnings.append(
            f"blocks that stay where they are, {len(stranded)} of {len(moved.mesh.blocks)}, such as "
            f"{stranded[0]}: no point there is shared with the part of the grid that moves; see 'bspline-mdao inspect'"
        )
    if moved.newly_inverted:
        worst = moved.newly_inverted[0]
        warnings.append(f"{counted(moved.after.n_inverted, 'inverted cell')} now, the worst {worst}")
    warnings += [*height_warnings(moved.after.heights), *map(str, moved.gaps)]
    (off, where), unit = moved.split, moved.grid.length_unit
    warnings += split_lines(off, moved.mesh.size, unit, f"{where}: the mean is taken")
    digits = moved.movement.report.digits
    if digits < FEW_DIGITS:
        warnings.append(
            f"about {digits:.0f} digits of the displacements are right: elements are too thin for their "
            f"length; derivatives are no better. Fit with more control points along them (fit --n-control), or take "
            f"another --mover"
        )
    last = moved.movement.report.increments[-1]
    if last.n_tangled:
        warnings.append(
            f"{counted(last.n_tangled, 'newly invalid element')} of the control mesh, the worst {last.place}"
        )
    return warnings


def complaint(
    model: FittedModel,  # what was moved
    moved: Moved,  # the move, which leaves cells inverted
    trials: Sequence[Trial],  # other options that were tried
) -> str:
    """Say which cells are inverted, why, and what cures it."""
    adjacent = ", ".join(f"'{name}'" for name in patches_of(moved.newly_inverted))
    where = f"the worst {moved.newly_inverted[0]}{f', and they lie on {adjacent}' if adjacent else ''}"
    return (
        f"the move leaves {counted(moved.after.n_inverted, 'cell')} inverted, {where}; {_cause(model, moved)}; nothing "
        f"was written; {verdict(trials)}, or --allow-invalid to see it"
    )


def _trials(model: FittedModel, model_file: Path, moved: Moved, options: MoveOptions) -> list[Trial]:
    """Try what may cure a move, releasing first the patches on which inverted cells lie."""
    baseline = model.regenerate()
    quality = GridQuality.of_baseline(baseline)

    def n_inverted(other: MoveOptions) -> int:
        mesh, deformation, _, movement = moved_control_mesh(model, model_file, other)
        grid = _grid(model, other, mesh, deformation, movement.points)[0]
        return judge_move(quality, grid.to_vector().reshape(-1, 3)).n_inverted

    return try_cures(options, model.topology, moved.mesh, patches_of(moved.newly_inverted), n_inverted)


def _cause(model: FittedModel, moved: Moved) -> str:
    """Find the first cause that applies, and which changes of the fit may help and were not tried."""
    mesh, report = moved.mesh, moved.movement.report
    if mesh.n_invalid:
        n = f"{mesh.n_invalid:,} of {counted(len(mesh.elements), 'element')}"
        is_mended = model.settings.method == "valid"
        other = "fewer control points (fit --n-control)" if is_mended else MEND
        return f"{n} of the control mesh invalid before the move; not tried here: {other}"
    missed = None if model.residual is None else np.linalg.norm(model.residual, axis=1).max()
    if missed and _is_the_residual(model, moved):
        worst = model.report.worst_local
        widths = f" (by the width of the cells {worst})" if worst else ""
        what = f"what they miss of the grid, up to {missed:.2g} {model.header.length_unit}{widths}, is in the way"
        return f"the splines' own grid is valid there, {what}; not tried here: more control points (fit --n-control)"
    first = report.first_tangled()
    if not first:
        return "the splines fold between control points, whose mesh stays valid"
    number, increment = first
    return f"the control mesh tangles in increment {number} of {report.n_increments}, {increment.place}"


def _is_the_residual(model: FittedModel, moved: Moved) -> bool:
    """Whether most newly inverted cells are valid in the grid of the splines alone."""
    quality = GridQuality.of_baseline(model.regenerate())
    after = quality.cells(moved.grid.to_vector().reshape(-1, 3))
    of_splines = quality.cells(model.evaluator().forward(moved.movement.points))
    n_inverted = n_valid = 0
    for block, cells, spline_cells in zip(quality.blocks, after, of_splines):
        inverted = np.setdiff1d(np.flatnonzero(~cells.is_valid), block.was_invalid, assume_unique=True)
        n_inverted += inverted.size
        n_valid += int(np.count_nonzero(spline_cells.is_valid.ravel()[inverted]))
    return 2 * n_valid > n_inverted
