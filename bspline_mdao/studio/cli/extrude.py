"""The command ``extrude``: a volume grid from a surface grid."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...base.text import counted
from ...core.generators.extrusion.extrude import extrude_surface, plate_length
from ...core.generators.extrusion.rims import Plane
from ...core.generators.first_cell import first_cell_of
from ...errors import InputError
from .made_grid import MadeGrid, write_made_grid
from .output import check_outputs
from .sources import load_grid


def extrude_file(
    surface: Path,  # file of the surface grid
    output: Path,  # output, json: model or grid, and numbers to write
    json: Path | None,
    units: str | None,  # unit of lengths, if the file does not say it
    allow_invalid: bool,  # write a grid with inverted cells anyway
    **options: Any,  # see `_made`
) -> None:
    """Extrude a surface, fit the volume grid if asked, write it and show its quality."""
    check_outputs([output, json], [surface])
    write_made_grid(lambda: _made(surface, units, allow_invalid=allow_invalid, **options), output, json, allow_invalid)


def _made(
    surface: Path,
    units: str | None,
    first_cell: float | None,
    y_plus: float | None,
    reynolds: float | None,
    length: float | None,
    symmetry: Sequence[str],
    constant: Sequence[str],
    periodic: Sequence[str],
    **options: Any,  # see `extrude_surface`
) -> MadeGrid:
    """The grid, and a description of how it came from the surface."""
    sheet = load_grid(str(surface), is_lifted=False, units=units)
    plate = plate_length(sheet, length, reynolds)
    height = first_cell_of(plate, first_cell, y_plus, reynolds)
    grid = extrude_surface(
        sheet,
        height,
        symmetry=None if not symmetry else [_plane(text) for text in symmetry if text != "none"],
        constant=[_plane(text) for text in constant],
        periodic=[_plane(text) for text in periodic],
        **options,
    )
    numbers = {
        "surface": str(surface),
        "blocks": grid.shapes,
        "n_nodes": grid.n_nodes,
        "patches": {patch.name: patch.kind for patch in grid.patches},
    }
    patches = ", ".join(f"{patch.name} ({patch.kind})" for patch in grid.patches)
    lines = [f"patches: {patches}"]
    if reynolds:
        lines.append(f"y+ {y_plus:g} of a plate of {plate:.4g} {grid.length_unit} at a Reynolds number of {reynolds:g}")
    title = f"{surface}: {counted(len(grid.blocks), 'block')}, {counted(grid.n_nodes, 'node')}"
    cure = "see the page on extrusion for what helps"
    return MadeGrid(grid, title, lines, numbers, reynolds and reynolds / plate, cure, first_cell=height)


def _plane(text: str) -> Plane:
    """The normal of a plane, as a user writes it."""
    if "," not in text:
        return text
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        raise InputError(f"{text}: is no normal of a plane; write x, y, z or three numbers, such as 0,1,1") from None
