"""The command ``airfoil``: an O- or C-grid about an airfoil, fitted or not."""

from __future__ import annotations

import math
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
from ...grids.topology.length_unit import in_unit
from .made_grid import MadeGrid, write_made_grid
from .output import check_outputs, counts_text

CELLS, DENSE, ENOUGH = 4, 2.5, 66
"""Cells per control point, around the airfoil if these are few, and control points around that fit any section to 1e-5
chords: with fewer the spline leaves the nose."""

INCLINED = 0.5
"""Angle of the chord line in degrees that is worth a line: camber moves the nose by less."""

THICK_BASE = 0.01
"""Height of a trailing edge in chords above which closing it changes the flow, and a warning is given."""


@dataclass(frozen=True)
class AirfoilOptions:
    """Further options of the command, see `airfoil_grid`."""

    around: int
    away: int | None
    far: float
    chord: float
    first_cell: float | None
    y_plus: float | None
    reynolds: float | None
    topology: str
    wake: int | None
    base: str | None
    symmetric: bool  # the file has one side of a symmetric section
    units: str | None = None  # unit of the grid, of the chord and of the first cells; metres by default


def make_airfoil(
    name: str,  # digits, coefficients or a file
    output: Path,  # output, json: model or grid, and numbers to write
    json: Path | None,
    options: AirfoilOptions,
    allow_invalid: bool,  # write a grid with inverted cells anyway
) -> None:
    """Make the grid, fit it if asked, write it and describe it."""
    file = name if Path(name).is_file() else None
    check_outputs([output, json], [file])
    if options.symmetric and not file:
        raise InputError(f"{name}: is not a file, so --symmetric does not apply; leave it out")

    def outline() -> Airfoil:
        return read_airfoil(name, options.symmetric) if file else airfoil(name, blunt=options.base == "wall")

    write_made_grid(lambda: _made(name, outline, options), output, json, allow_invalid, _fitted)


def _made(name: str, outline: Callable[[], Airfoil], options: AirfoilOptions) -> MadeGrid:
    """The grid, and a description of the section."""
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
        chord = f"{options.chord:g} {grid.length_unit}"
        lines.append(f"the chord is {unit:.6g} long there: scaled to {chord}, with the nose at the origin")
    along = section.tail - section.nose
    incidence = math.degrees(math.atan2(-along[1], along[0]))
    if abs(incidence) > INCLINED:
        way = "up" if incidence > 0.0 else "down"
        lines.append(
            f"the chord is inclined by {abs(incidence):.3g} deg there, nose {way}, and stays so: angles of attack add "
            f"to it"
        )
    is_warned, said = _of_base(base, options)
    lines += [] if is_warned else said
    return MadeGrid(
        grid,
        f"{section.name}: {options.topology}-grid of {_nodes_text(grid)} nodes, far field at {options.far:g} chords",
        lines,
        numbers,
        options.reynolds and options.reynolds / options.chord,
        f"give {'--topology C, or ' if options.topology == 'O' else ''}more cells --around",
        [*(said if is_warned else []), *([section.few_points] if section.few_points else [])],
    )


def _of_base(base: float, options: AirfoilOptions) -> tuple[bool, list[str]]:
    """Treatment of a blunt trailing edge, and whether to warn of it."""
    if not base:
        return False, []
    thick = f"the trailing edge is {100.0 * base:.3g} % thick: it is"
    if options.topology == "C" and options.base != "closed":
        return False, [f"{thick} kept, a wall with a block behind it; --base closed closes it"]
    closed = f"closed by a wedge off both sides, which moves no point by more than {50.0 * base:.3g} % of the chord"
    changed = "; that changes the flow behind it" if base >= THICK_BASE else ""
    return bool(changed), [f"{thick} {closed}{changed}{'' if options.base else '; --topology C keeps it'}"]


def _grid(section: Airfoil, options: AirfoilOptions) -> Grid:
    """The grid."""
    grid = airfoil_grid(
        section,
        options.around,
        options.away,
        far=options.far,
        chord=options.chord,
        first_cell=options.first_cell,
        y_plus=options.y_plus,
        reynolds=options.reynolds,
        topology=options.topology,
        n_wake=options.wake,
        base=options.base,
    )
    return in_unit(grid, options.units)


def _nodes_text(grid: Grid) -> str:
    """Nodes of each block."""
    return ", ".join(counts_text(shape) for shape in grid.shapes)


def _fitted(grid: Grid) -> FittedModel:
    """Fit the grid with enough control points to keep the nose."""
    walls = {window.block for patch in grid.patches if patch.name == "airfoil" for window in patch.windows}
    counts = [
        (_around(along) if block in walls else _others(along), _others(away), 2)
        for block, (along, away, _) in enumerate(grid.shapes)
    ]
    return fit_grid(grid, n_control=counts, order=(4, 4, 2))


def _around(nodes: int) -> int:
    """Control points around the airfoil."""
    return max((nodes - 1) // CELLS + 2, min(int((nodes - 1) / DENSE) + 2, ENOUGH))


def _others(nodes: int) -> int:
    """Control points along the wake, and from the airfoil outward."""
    return max((nodes - 1) // CELLS + 2, 4)
