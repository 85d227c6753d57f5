"""The command ``extrude``: a volume grid from a surface grid."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...base.text import counted
from ...core.generators.extrusion.extrude import extrude_surface
from ...core.generators.extrusion.rims import Plane
from ...errors import InputError
from ...grids.cells.first_cells import FirstCells
from .made_grid import MadeGrid, write_made_grid
from .output import check_outputs
from .sources import load_grid

NEAR = 0.01
"""Relative difference of heights from what was asked that is named."""


def extrude_file(
    surface: Path,  # file of the surface grid
    output: Path,  # output, json: model or grid, and numbers to write
    json: Path | None,
    units: str | None,  # unit of lengths, where the file does not say it
    **options: Any,  # see `_made`
) -> None:
    """Extrude a surface, fit the volume grid if asked, write it and show its quality."""
    check_outputs([output, json], [surface])
    write_made_grid(lambda: _made(surface, units, **options), output, json)


def _made(
    surface: Path,
    units: str | None,
    first_cell: float,
    symmetry: Sequence[str],
    constant: Sequence[str],
    **options: Any,  # see `extrude_surface`
) -> MadeGrid:
    """The grid, and what it has become of the surface."""
    grid = extrude_surface(
        load_grid(str(surface), is_lifted=False, units=units),
        first_cell,
        symmetry=None if not symmetry else [_plane(text) for text in symmetry if text != "none"],
        constant=[_plane(text) for text in constant],
        **options,
    )
    heights = FirstCells.of_baseline(grid).baseline
    off = float(np.mean(np.abs(heights / first_cell - 1.0) > NEAR))
    numbers = {
        "surface": str(surface),
        "blocks": grid.shapes,
        "n_nodes": grid.n_nodes,
        "patches": {patch.name: patch.kind for patch in grid.patches},
        "heights": {"lowest": float(heights.min()), "highest": float(heights.max()), "off": off},
    }
    patches = ", ".join(f"{patch.name} ({patch.kind})" for patch in grid.patches)
    lines = [
        f"patches: {patches}",
        f"first cells {heights.min():.4g} to {heights.max():.4g} {grid.length_unit} high, {100.0 * (1.0 - off):.1f} % "
        f"of them within 1 % of what was asked",
    ]
    title = f"{surface}: {counted(len(grid.blocks), 'block')}, {counted(grid.n_nodes, 'node')}"
    return MadeGrid(grid, title, lines, numbers, None, "see the page on extrusion for what helps")


def _plane(text: str) -> Plane:
    """The normal of a plane, as a user writes it."""
    if "," not in text:
        return text
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        raise InputError(f"{text}: is no normal of a plane; write x, y, z or three numbers, such as 0,1,1") from None
