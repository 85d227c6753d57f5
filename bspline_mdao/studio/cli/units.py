"""The option ``--units`` of commands that read grids, and remarks on units where grids are written."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ...grids.io.formats import POLYMESH
from ...grids.topology.length_unit import LENGTH_UNITS, metres_of

if TYPE_CHECKING:
    from ...grids.cells.mixed_cells import MixedMesh
    from ...grids.topology.grid import Grid

__all__ = ["unit_warnings", "units_option"]

units_option = click.option(
    "--units",
    type=click.Choice(LENGTH_UNITS),
    help="Unit of length of a grid whose file does not state it, for display; coordinates do not change. Metres by "
    "default.",
)


def unit_warnings(output: Path, grid: Grid | MixedMesh) -> list[str]:
    """Warn that OpenFOAM takes lengths in another unit for metres."""
    if output.name != POLYMESH or grid.length_unit == "m":
        return []
    return [
        f"OpenFOAM takes lengths for metres, and these are in {grid.unit}: scale the points by "
        f"{metres_of(grid.unit):g} there (transformPoints)"
    ]
