"""The command ``airfoil``: an O-grid about an airfoil, fitted or alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ...base.text import counted
from ...core.fit.fitting import fit_grid
from ...core.generators.airfoil import Airfoil
from ...core.generators.airfoil_file import airfoil, read_airfoil
from ...core.generators.airfoil_grid import airfoil_grid, unit_of
from ...core.model.fitted_model import FittedModel
from ...errors import InputError
from ...grids.topology.grid import Grid
from .made_grid import MadeGrid, write_made_grid
from .output import check_outputs, counts_text

CELLS, DENSE, ENOUGH = 4, 2.5, 66
"""Cells by control points, around where these are few, and control points around that keep any section to 1e-5 chords:
with fewer the spline leaves the nose."""

THICK_BASE = 0.01
"""Height of a trailing edge in chords from which on closing it changes the flow, and is warned of."""


@dataclass(frozen=True)
class AirfoilOptions:
    """What else the command takes, see `airfoil_grid`."""

    around: int
    away: int | None
    far: float
    chord: float
    first_cell: float | None
    y_plus: float | None
    reynolds: float | None
    symmetric: bool  # the file has one side of a symmetric section


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

    def outline() -> Airfoil:
        return read_airfoil(name, options.symmetric) if file else airfoil(name)

    write_made_grid(lambda: _made(name, outline, options), output, json, _fitted)


def _made(name: str, outline: Callable[[], Airfoil], options: AirfoilOptions) -> MadeGrid:
    """The grid, and what the section is like."""
    section = outline()
    grid, base, (unit, origin) = _grid(section, options), section.base, unit_of(section)
    numbers = {
        "airfoil": name,
        "n_points": len(section.points),
        "thickness": section.thickness,
        "nose_radius": section.nose_radius,
        "base": base,
        "unit": unit,
    }
    lines = [
        f"section: {100.0 * section.thickness:.4g} % thick, radius of the nose {100.0 * section.nose_radius:.3g} %, "
        f"one curve through {counted(len(section.points), 'point')}"
    ]
    if unit != 1.0 or origin.any():
        lines.append(f"the chord is {unit:.6g} long there: scaled to {options.chord:g} m, with the nose at the origin")
    closed = (
        f"the trailing edge is {100.0 * base:.3g} % thick: it is closed by a wedge off both sides, which moves no "
        f"point by more than {50.0 * base:.3g} % of the chord"
    )
    if 0.0 < base < THICK_BASE:
        lines.append(closed)
    return MadeGrid(
        grid,
        f"{section.name}: O-grid of {counts_text(grid.shapes[0])} nodes, far field at {options.far:g} chords",
        lines,
        numbers,
        options.reynolds and options.reynolds / options.chord,
        "give more cells --around",
        [f"{closed}; that changes the flow behind it"] if base >= THICK_BASE else [],
    )


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
