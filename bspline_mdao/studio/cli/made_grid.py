"""A grid made by a command: fitted or not, written, and shown with its cells and walls."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...base.numerics.progress import progress_bar
from ...base.text import counted
from ...core.fit.fitting import fit_grid
from ...core.model.fitted_model import FittedModel
from ...errors import FitWarning, InputError
from ...grids.cells.first_cells import FirstCells
from ...grids.cells.grid_quality import GridQuality
from ...grids.cells.report import QualityReport, report_quality
from ...grids.cells.wall_spacing import WallSpacing, wall_spacings
from ...grids.io.files import check_grid_name, write_grid
from ...grids.io.formats import MODEL
from ...grids.topology.detection import find_topology
from ...grids.topology.grid import Grid
from .fit import fit_numbers, show_fit, splines_certificate
from .output import print_lines, print_title, print_warnings, show_spacings, spacing_numbers, written_json
from .units import unit_warnings

__all__ = ["MadeGrid", "write_made_grid"]

NEAR = 0.01
"""Relative difference between heights and their target above which it is reported."""


@dataclass(frozen=True)
class MadeGrid:
    """A grid that was made, and its description."""

    grid: Grid
    title: str
    lines: Sequence[str]  # its description
    numbers: dict[str, Any]  # the same for JSON
    reynolds: float | None  # Reynolds number per unit of length, for y+
    cure: str  # what may help if cells are inverted
    warnings: Sequence[str] = ()
    first_cell: float | None = None  # target height of the first cells, to compare with the actual heights


def write_made_grid(
    make: Callable[[], MadeGrid],
    output: Path,  # output, json: model or grid, and numbers to write
    json: Path | None,
    allow_invalid: bool,  # write a grid with inverted cells anyway
    fit: Callable[[Grid], FittedModel] = fit_grid,
) -> None:
    """Make a grid, fit it if a model is requested, write it and describe it."""
    with progress_bar() as progress, warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)  # it is in the report
        progress(0.0, "grid")
        made = make()
        grid, is_model = made.grid, output.suffix == MODEL
        if not is_model:
            check_grid_name(output, grid)
        quality = GridQuality.of_baseline(grid)
        cells = report_quality(quality, grid.to_vector().reshape(-1, 3))
        if cells.n_inverted and not allow_invalid:
            raise InputError(
                f"{made.title}: {counted(cells.n_inverted, 'inverted cell')}, the worst {cells.inverted[0]}; nothing "
                f"was written; {made.cure}, or --allow-invalid to write it"
            )
        heights, spacings = _heights(quality.first_cells, made), wall_spacings(grid, quality.first_cells)
        model = fit(grid) if is_model else None
        progress(0.8, "validity" if model else "writing")
        certificate = splines_certificate(model) if model else None
        numbers = made.numbers | heights | {"output": str(output)} | _numbers(cells, spacings, made.reynolds)
        with written_json(json, numbers | ({"fit": fit_numbers(model, certificate)} if model else {})):
            if model:
                model.save(output)
            else:
                write_grid(output, grid, find_topology(grid))
    print_title(made.title)
    print_lines(
        [
            *made.lines,
            *_heights_lines(heights, grid.length_unit),
            f"cells: {cells.n_cells:,}, {cells.n_inverted:,} inverted; smallest corner {cells.min_corner:.3g}, "
            f"smallest Q {cells.q_min:.3g}, mean {cells.q_mean:.3g}",
        ]
    )
    show_spacings(spacings, made.reynolds, grid.length_unit)
    inverted = [f"{counted(cells.n_inverted, 'inverted cell')}; {made.cure}"] if cells.n_inverted else []
    print_warnings([*made.warnings, *inverted, *unit_warnings(output, grid)])
    if model:
        show_fit(model, output, certificate)
    else:
        print_lines([f"{output} written"])


def _heights(cells: FirstCells, made: MadeGrid) -> dict[str, Any]:
    """Numbers of the heights of first cells, if a height was requested."""
    heights = cells.baseline
    if made.first_cell is None or not len(heights):
        return {}
    off = float(np.mean(np.abs(heights / made.first_cell - 1.0) > NEAR))
    return {
        "heights": {
            "asked": made.first_cell,
            "lowest": float(heights.min()),
            "highest": float(heights.max()),
            "off": off,
        }
    }


def _heights_lines(numbers: dict[str, Any], unit: str) -> list[str]:
    """The same as text."""
    return [
        f"first cells {found['lowest']:.4g} to {found['highest']:.4g} {unit} high, {100.0 * (1.0 - found['off']):.1f} "
        f"% of them within 1 % of the {found['asked']:.4g} {unit} asked for"
        for found in numbers.values()
    ]


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
