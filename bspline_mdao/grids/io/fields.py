"""Files with fields: for ParaView and for Tecplot, with the quality and the place of every cell.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...errors import InputError
from ..cells.cell_fields import cell_fields, patch_numbers
from ..topology.block_layout import has_cells
from ..topology.grid import Grid, require_grid
from .tecplot import write_tecplot
from .vtk import write_vtk

__all__ = ["WRITERS", "quality_fields", "write_with_quality", "writer_of"]

WRITERS: dict[str, Callable] = {".vtm": write_vtk, ".dat": write_tecplot, ".tec": write_tecplot}
"""Functions that write a path, a grid, and fields of its nodes and cells, by suffix."""


def writer_of(path: str | os.PathLike) -> Callable:
    """Choose the function that writes fields, by the name of the file."""
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        raise InputError(
            f"{path}: no fields are written to '{suffix}' files; name it .vtm (ParaView) or .dat (Tecplot)"
        )
    return WRITERS[suffix]


def write_with_quality(path: str | os.PathLike, grid: Grid) -> None:
    """Write a grid with the quality and the place of its cells, see `quality_fields`."""
    require_grid(grid)
    writer_of(path)(path, grid, None, quality_fields(grid))


def quality_fields(grid: Grid) -> dict[str, list[np.ndarray]]:
    """Fields of the cells in files: those of `bspline_mdao.grids.cells.cell_fields`."""
    # Without measurable cells, only the numbers of blocks and patches.
    if any(has_cells(shape) for shape in grid.shapes):
        return cell_fields(grid)
    patches = patch_numbers(grid)
    blocks = [np.full(array.shape, number, dtype=np.int32) for number, array in enumerate(patches, 1)]
    return {"block": blocks, "patch": patches}
