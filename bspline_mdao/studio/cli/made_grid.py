"""A grid that a command has made: fitted or alone, written, and shown with its cells and walls."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...base.numerics.progress import progress_bar
from ...base.text import counted
from ...core.fit.fitting import fit_grid
from ...core.model.fitted_model import FittedModel
from ...errors import FitWarning
from ...grids.cells.grid_quality import GridQuality
from ...grids.cells.report import QualityReport, report_quality
from ...grids.cells.wall_spacing import WallSpacing, wall_spacings
from ...grids.io.files import check_grid_name, write_grid
from ...grids.io.formats import MODEL
from ...grids.topology.detection import find_topology
from ...grids.topology.grid import Grid
from .fit import fit_numbers, show_fit, splines_certificate
from .output import print_lines, print_title, print_warnings, show_spacings, spacing_numbers, written_json

__all__ = ["MadeGrid", "write_made_grid"]


@dataclass(frozen=True)
class MadeGrid:
    """A grid that was made, and what is said about it."""

    grid: Grid
    title: str
    lines: Sequence[str]  # what it is about
    numbers: dict[str, Any]  # the same for JSON
    reynolds: float | None  # Reynolds number per unit of length, for y+
    cure: str  # what may help where cells are inverted
    warnings: Sequence[str] = ()


def write_made_grid(
    make: Callable[[], MadeGrid],
    output: Path,  # output, json: model or grid, and numbers to write
    json: Path | None,
    fit: Callable[[Grid], FittedModel] = fit_grid,
) -> None:
    """Make a grid, fit it where a model is asked for, write it and say what it is like."""
    with progress_bar() as progress, warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)  # it is in the report
        progress(0.0, "grid")
        made = make()
        grid, is_model = made.grid, output.suffix == MODEL
        if not is_model:
            check_grid_name(output, grid)
        cells = report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3))
        spacings = wall_spacings(grid)
        model = fit(grid) if is_model else None
        progress(0.8, "validity" if model else "writing")
        certificate = splines_certificate(model) if model else None
        numbers = made.numbers | {"output": str(output)} | _numbers(cells, spacings, made.reynolds)
        with written_json(json, numbers | ({"fit": fit_numbers(model, certificate)} if model else {})):
            if model:
                model.save(output)
            else:
                write_grid(output, grid, find_topology(grid))
    print_title(made.title)
    print_lines(
        [
            *made.lines,
            f"cells: {cells.n_cells:,}, {cells.n_inverted:,} inverted; smallest corner {cells.min_corner:.3g}, "
            f"smallest Q {cells.q_min:.3g}, mean {cells.q_mean:.3g}",
        ]
    )
    show_spacings(spacings, made.reynolds, grid.length_unit)
    inverted = [f"{counted(cells.n_inverted, 'inverted cell')}; {made.cure}"] if cells.n_inverted else []
    print_warnings([*made.warnings, *inverted])
    if model:
        show_fit(model, output, certificate)
    else:
        print_lines([f"{output} written"])


def _numbers(
    cells: QualityReport, spacings: tuple[WallSpacing, ...], reynolds: float | None
) -> dict[str, Any]:  # for JSON
    """Collect the numbers of cells and walls."""
    return {
        "n_cells": cells.n_cells,
        "n_inverted": cells.n_inverted,
        "min_corner": cells.min_corner,
        "q_min": cells.q_min,
        "q_mean": cells.q_mean,
        "walls": spacing_numbers(spacings, reynolds),
    }
