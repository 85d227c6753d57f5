"""The command ``extrude``: a volume grid from a surface grid."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...base.text import counted
from ...core.generators.extrusion.extrude import extrude_surface
from ...core.generators.extrusion.rims import Plane
from ...errors import InputError
from ...grids.cells.grid_quality import GridQuality
from ...grids.cells.report import report_quality
from ...grids.io.files import check_grid_name, write_grid
from ...grids.topology.detection import find_topology
from .move import QUALITY
from .output import check_outputs, print_lines, print_table, print_title, written_json
from .sources import load_grid


def extrude_file(
    surface: Path,  # file of the surface grid
    output: Path,  # output, json: grid and numbers to write
    json: Path | None,
    first_cell: float,
    layers: int | None,
    growth: float | None,
    outer: float | None,
    symmetry: Sequence[str],
    constant: Sequence[str],
    splay: float,
    inward: bool,
    allow_invalid: bool,
    units: str | None,
) -> None:
    """Extrude a surface, show the quality of the volume grid and write it; see `extrude_surface`."""
    check_outputs([output, json], [surface])
    grid = extrude_surface(
        load_grid(str(surface), is_lifted=False, units=units),
        first_cell,
        layers=layers,
        growth=growth,
        outer=outer,
        symmetry=None if not symmetry else [_plane(text) for text in symmetry if text != "none"],
        constant=[_plane(text) for text in constant],
        splay=splay,
        inward=inward,
        allow_invalid=allow_invalid,
    )
    check_grid_name(output, grid)
    quality = GridQuality.of_baseline(grid)
    report = report_quality(quality, grid.to_vector().reshape(-1, 3))
    heights = quality.first_cells.baseline
    off = float(np.mean(np.abs(heights / first_cell - 1.0) > NEAR))
    numbers = {
        "surface": str(surface),
        "grid": str(output),
        "blocks": grid.shapes,
        "n_nodes": grid.n_nodes,
        "patches": {patch.name: patch.kind for patch in grid.patches},
        "quality": {name: getattr(report, name) for name in QUALITY},
        "heights": {"lowest": float(heights.min()), "highest": float(heights.max()), "off": off},
    }
    with written_json(json, numbers):
        write_grid(output, grid, find_topology(grid))
    print_title(f"{output}: {counted(len(grid.blocks), 'block')}, {counted(grid.n_nodes, 'node')} from {surface}")
    labels = {name: label.format(unit=grid.length_unit) for name, label in QUALITY.items()}
    print_table(["quality of the grid", "value"], [(labels[name], getattr(report, name)) for name in QUALITY])
    patches = ", ".join(f"{patch.name} ({patch.kind})" for patch in grid.patches)
    print_lines(
        [
            f"first cells {heights.min():.4g} to {heights.max():.4g} {grid.length_unit} high, "
            f"{100.0 * (1.0 - off):.1f} % of them within 1 % of what was asked",
            f"patches: {patches}",
        ]
    )


NEAR = 0.01
"""Relative difference of heights from what was asked that is named."""


def _plane(text: str) -> Plane:
    """The normal of a plane, as a user writes it."""
    if "," not in text:
        return text
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        raise InputError(f"{text}: is no normal of a plane; write x, y, z or three numbers, such as 0,1,1") from None
