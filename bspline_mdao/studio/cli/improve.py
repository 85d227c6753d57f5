"""The command ``improve``: a grid of the same surface with better worst cells."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

from ...base.numerics.progress import Progress, progress_bar
from ...core.adaptation.improve import ITERATIONS, improve_grid
from ...core.adaptation.improvement import BlockChange, Improvement
from ...core.fit.fitting import fit_grid
from ...core.model.fitted_model import FittedModel
from ...errors import FitWarning, InputError, MovementError
from ...grids.io.files import check_grid_name, write_grid
from ...grids.io.formats import MODEL
from .move import QUALITY
from .output import (
    check_outputs,
    height_numbers,
    print_lines,
    print_table,
    print_title,
    print_warnings,
    show_height_ratios,
    written_json,
)
from .sources import file_of, load_grid


@dataclass(frozen=True)
class ImproveOptions:
    """Options of the command ``improve``."""

    patches: Path | None = None  # patches of a grid that is not a model
    # control points per direction of blocks of such a grid, see `bspline_mdao.studio.cli.counts`
    n_control: dict[str | None, tuple[int, int, int]] | None = None
    reach: float = 0.4  # how far control points may move, relative to the distance to their nearest neighbours
    height_tolerance: float = 0.01  # relative change allowed for the heights of first cells at walls
    slide: tuple[str, ...] = ()  # patches whose nodes slide in their planes
    iterations: int = ITERATIONS  # iterations of the optimiser in each round
    units: str | None = None  # unit of lengths of such a grid, if its file does not say it


def improve(
    grid_name: str,  # file of a grid or of a fitted model, or ``@`` and the name of a built-in grid
    output: Path,  # output, json: grid and numbers to write
    json: Path | None,
    options: ImproveOptions,  # what may move, and how far
) -> None:
    """Improve the worst cells of a grid with a fixed surface and write the grid."""
    check_outputs([output, json], [file_of(grid_name), options.patches])
    with progress_bar() as progress:
        progress(0.0, "reading")
        model = _model(grid_name, options, lambda fraction, what: progress(0.2 * fraction, what))
        check_grid_name(output, model.header)
        found = improve_grid(
            model,
            reach=options.reach,
            height_tolerance=options.height_tolerance,
            sliding=options.slide,
            iterations=options.iterations,
            progress=lambda fraction, what: progress(0.2 + 0.7 * fraction, what),
        )
        if not found.is_better:
            raise MovementError(f"{grid_name}: cannot be improved: {found.reason}; nothing was written")
        progress(0.9, "writing")
        with written_json(json, improve_numbers(grid_name, output, found)):
            write_grid(output, found.grid, model.topology)
    show_improvement(grid_name, output, found, options)
    print_warnings(model.topology.warnings)


def _model(grid_name: str, options: ImproveOptions, progress: Progress) -> FittedModel:
    """The fitted model of a file, or a fit of a grid."""
    if Path(grid_name).suffix != MODEL:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FitWarning)  # the control mesh only measures displacements here
            return fit_grid(
                load_grid(grid_name, options.patches, units=options.units),
                n_control=options.n_control,
                progress=progress,
            )
    given = {"--patches": options.patches, "--n-control": options.n_control, "--units": options.units}
    if any(given.values()):
        what = next(name for name, value in given.items() if value)
        raise InputError(f"{grid_name}: a model has its own patches, control points and unit; leave out {what}")
    return FittedModel.load(grid_name)


def improve_numbers(grid_name: str, output: Path, found: Improvement) -> dict:
    """Collect the numbers of an improvement for JSON."""
    return {
        "from": grid_name,
        "grid": str(output),
        "n_control_points": found.shift.n_points,
        "n_values": found.shift.n_values,
        "n_moved": found.n_moved,
        "iterations": found.iterations,
        "evaluations": found.evaluations,
        "seconds": found.seconds,
        "before": {name: getattr(found.before, name) for name in QUALITY},
        "after": {name: getattr(found.after, name) for name in QUALITY},
        "blocks": [{"before": vars(c.before), "after": vars(c.after)} for c in found.blocks],
        "heights": height_numbers(found.after.heights, is_compared=True),
        "reason": found.reason,
    }


def show_improvement(grid_name: str, output: Path, found: Improvement, options: ImproveOptions) -> None:
    """Print the report of an improvement."""
    n_points = f"{found.n_moved:,} of {found.shift.n_points:,} control points moved"
    print_title(f"{grid_name}: {found.before.n_cells:,} cells, {n_points}")
    print_table(
        ["quality of the grid", "before", "after"],
        [
            (label.format(unit=found.grid.length_unit), getattr(found.before, name), getattr(found.after, name))
            for name, label in QUALITY.items()
        ],
    )
    print_table(
        ["block", "smallest Q before", "after", "where before", "after"],
        [_row(change) for change in sorted(found.blocks, key=lambda change: change.before.q)],
        most=20,
    )
    show_height_ratios(found.after.heights)
    if found.after.heights:
        print_lines([f"all heights are within {options.height_tolerance:g} of what they were, and nodes of walls stay"])
    if found.reason:
        print_lines([found.reason], style="yellow")
    print_lines([f"{output} written, {found.seconds:.2f} s for {found.evaluations:,} evaluations"])


def _row(change: BlockChange) -> tuple:
    """Row of the table of blocks."""
    before, after = change.before, change.after
    places = (f"({cell.i}, {cell.j}, {cell.k}){', fixed' if cell.is_fixed else ''}" for cell in (before, after))
    return before.block, before.q, after.q, *places
