"""The command ``airfoil``: an O-grid about an airfoil, fitted or alone."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...base.numerics.progress import progress_bar
from ...base.text import counted
from ...core.evaluation.spline_validity import certify_splines
from ...core.fit.fitting import fit_grid
from ...core.generators.airfoil import Airfoil
from ...core.generators.airfoil_file import airfoil, read_airfoil
from ...core.generators.airfoil_grid import airfoil_grid, unit_of
from ...core.model.fitted_model import FittedModel
from ...errors import FitWarning, InputError
from ...grids.cells.certificate import Certificate
from ...grids.cells.grid_quality import GridQuality
from ...grids.cells.report import QualityReport, report_quality
from ...grids.cells.wall_spacing import WallSpacing, wall_spacings
from ...grids.io.files import check_grid_name, write_grid
from ...grids.io.formats import MODEL
from ...grids.topology.grid import Grid
from .fit import fit_numbers, show_fit
from .output import (
    check_outputs,
    counts_text,
    print_lines,
    print_title,
    print_warnings,
    show_spacings,
    spacing_numbers,
    written_json,
)

CELLS, DENSE, ENOUGH = 4, 2.5, 66
"""Cells by control points, around where these are few, and control points around that keep any section to 1e-5 chords:
with fewer the spline leaves the nose."""

THICK_BASE = 0.01
"""Height of a trailing edge in chords from which on closing it changes the flow, and is warned of."""


@dataclass(frozen=True)
class AirfoilOptions:
    """What else the command takes, see `airfoil_grid`."""

    around: int = 128
    away: int | None = None
    far: float = 50.0
    chord: float = 1.0
    first_cell: float | None = None
    y_plus: float | None = None
    reynolds: float | None = None
    symmetric: bool = False  # the file has one side of a symmetric section


def make_airfoil(
    name: str,  # digits, coefficients or a file
    output: Path,  # output, json: model or grid, and numbers to write
    json: Path | None,
    options: AirfoilOptions,
) -> None:
    """Make the grid, fit it if asked, write it and say what it is like."""
    file = name if Path(name).is_file() else None
    check_outputs([output, json], [file])
    if options.symmetric and not file:
        raise InputError(f"{name}: is no file, of which --symmetric says that it has one side; leave it out")
    with progress_bar() as progress, warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)  # it is in the report
        progress(0.0, "points")
        section = read_airfoil(name, options.symmetric) if file else airfoil(name)
        progress(0.1, "grid")
        grid = _grid(section, options)
        if output.suffix != MODEL:
            check_grid_name(output, grid)
        cells = report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3))
        spacings = wall_spacings(grid)
        model = _fitted(grid) if output.suffix == MODEL else None
        progress(0.8, "validity" if model else "writing")
        certificate = Certificate((), _splines(model)) if model else None
        numbers = _numbers(name, section, output, options, cells, spacings)
        with written_json(json, numbers | ({"fit": fit_numbers(model, certificate)} if model else {})):
            if model:
                model.save(output)
            else:
                write_grid(output, grid)
    _show(section, grid, options, cells, spacings)
    if model:
        show_fit(model, output, certificate)
    else:
        print_lines([f"{output} written"])


def _grid(section: Airfoil, options: AirfoilOptions) -> Grid:
    """The O-grid."""
    return airfoil_grid(
        section,
        options.around,
        options.away,
        far=options.far,
        chord=options.chord,
        first_cell=options.first_cell,
        y_plus=options.y_plus,
        reynolds=options.reynolds,
    )


def _fitted(grid: Grid) -> FittedModel:
    """Fit the grid with as many control points as keep the nose."""
    along, away, _ = grid.shapes[0]
    around = max((along - 1) // CELLS + 2, min(int((along - 1) / DENSE) + 2, ENOUGH))
    return fit_grid(grid, n_control=[(around, max((away - 1) // CELLS + 2, 4), 2)], order=(4, 4, 2))


def _splines(model: FittedModel) -> tuple:
    """What is proved about the splines."""
    return certify_splines(model.mesh, model.control_points, model.topology.segment_names)


def _numbers(
    name: str,
    section: Airfoil,
    output: Path,
    options: AirfoilOptions,
    cells: QualityReport,
    spacings: tuple[WallSpacing, ...],
) -> dict[str, Any]:
    """Collect the numbers of an airfoil and of the grid about it for JSON."""
    per_length = options.reynolds and options.reynolds / options.chord
    return {
        "airfoil": name,
        "output": str(output),
        "n_points": len(section.points),
        "thickness": section.thickness,
        "nose_radius": section.nose_radius,
        "base": section.base,
        "unit": unit_of(section)[0],
        "n_cells": cells.n_cells,
        "n_inverted": cells.n_inverted,
        "min_corner": cells.min_corner,
        "q_min": cells.q_min,
        "q_mean": cells.q_mean,
        "walls": spacing_numbers(spacings, per_length),
    }


def _show(
    section: Airfoil, grid: Grid, options: AirfoilOptions, cells: QualityReport, spacings: tuple[WallSpacing, ...]
) -> None:
    """Print what the airfoil and the grid are like."""
    nodes = counts_text(grid.shapes[0])
    print_title(f"{section.name}: O-grid of {nodes} nodes, far field at {options.far:g} chords")
    unit, base = unit_of(section)[0], section.base
    lines = [
        f"section: {100.0 * section.thickness:.4g} % thick, radius of the nose {100.0 * section.nose_radius:.3g} %, "
        f"one curve through {counted(len(section.points), 'point')}"
    ]
    if unit != 1.0:
        lines.append(f"the chord is {unit:.6g} long there: scaled to {options.chord:g} m, with the nose at the origin")
    closed = (
        f"the trailing edge is {100.0 * base:.3g} % thick: it is closed by a wedge off both sides, which moves no "
        f"point by more than {50.0 * base:.3g} % of the chord"
    )
    if 0.0 < base < THICK_BASE:
        lines.append(closed)
    print_lines(
        [
            *lines,
            f"cells: {cells.n_cells:,}, {cells.n_inverted:,} inverted; smallest corner {cells.min_corner:.3g}, at the "
            f"trailing edge as a rule, smallest Q {cells.q_min:.3g}, mean {cells.q_mean:.3g}",
        ]
    )
    show_spacings(spacings, options.reynolds and options.reynolds / options.chord, grid.length_unit)
    if base >= THICK_BASE:
        print_warnings([f"{closed}; that changes the flow behind it"])
    if cells.n_inverted:
        print_warnings([f"{counted(cells.n_inverted, 'inverted cell')}; give more cells --around"])
