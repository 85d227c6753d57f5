"""Grids and fields for Tecplot: ASCII data files, one ordered zone per block.

Tecplot's binary files need its own library; text is read by every version, and by ParaView and VisIt.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import IO

import numpy as np

from ..topology.grid import Grid, require_grid
from .disk import replaced_file
from .vtk import Fields, check_fields

__all__ = ["write_tecplot"]

PER_LINE = 10
"""Numbers per line: Tecplot reads at most 32,000 characters of one."""


def write_tecplot(
    path: str | os.PathLike, grid: Grid, node_fields: Fields | None = None, cell_fields: Fields | None = None
) -> None:
    """Write a grid for Tecplot, whole or not at all.

    Reals are written with all their digits. IBLANK is written as a node field, and the names of the patches, in order,
    as the auxiliary data ``patches``. NaN becomes -1, as the format has no representation for it.

    Parameters
    ----------
    path : path-like
        ``something.dat``.
    grid : Grid
        The grid.
    node_fields : mapping of str to sequence of ndarray, optional
        Values per block, shape (ni, nj, nk) or (ni, nj, nk, n_components).
    cell_fields : mapping of str to sequence of ndarray, optional
        The same for cells; a direction with one node has one layer of cells.

    Raises
    ------
    InputError
        If a field does not fit the grid or the file cannot be written.

    References
    ----------
    Tecplot 360 Data Format Guide, Tecplot Inc.: ordered zones, DATAPACKING=BLOCK, VARLOCATION.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from bspline_mdao.files import write_tecplot
    >>> from bspline_mdao.generators import brick_grid
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_tecplot(f"{folder}/body.dat", brick_grid((5, 5, 5, 5)))
    ...     Path(folder, "body.dat").exists()
    True
    """
    require_grid(grid)
    shapes = [block.shape for block in grid.blocks]
    on_nodes, on_cells = dict(node_fields or {}), dict(cell_fields or {})
    check_fields(on_nodes, shapes, "node")
    check_fields(on_cells, [tuple(max(n - 1, 1) for n in shape) for shape in shapes], "cell")
    if any(block.iblank is not None for block in grid.blocks) and "iblank" not in on_nodes:
        blanks = [np.ones(b.shape, dtype=np.int32) if b.iblank is None else b.iblank for b in grid.blocks]
        on_nodes["iblank"] = blanks
    names = ["x", "y", "z", *_names(on_nodes), *_names(on_cells, taken=_names(on_nodes))]
    first = 4 + len(_names(on_nodes))
    with replaced_file(Path(path)) as part, open(part, "w", encoding="utf-8", newline="\n") as file:
        file.write(f"TITLE = {_quoted(grid.source)}\n")
        file.write("VARIABLES = " + " ".join(map(_quoted, names)) + "\n")
        for number, patch in enumerate(grid.patches, 1):
            file.write(f"DATASETAUXDATA patch_{number} = {_quoted(patch.name)}\n")
        for number, block in enumerate(grid.blocks):
            i, j, k = block.shape
            cells = f", VARLOCATION=([{first}-{len(names)}]=CELLCENTERED)" if len(names) >= first else ""
            file.write(f"ZONE T={_quoted(block.name)}\nI={i}, J={j}, K={k}, DATAPACKING=BLOCK{cells}\n")
            fields = chain([block.nodes], *([values[number] for values in f.values()] for f in (on_nodes, on_cells)))
            for array in fields:
                for column in _columns(np.asarray(array)):
                    _write_numbers(file, column)


def _names(fields: Fields, taken: Sequence[str] = ()) -> list[str]:
    """Names of the variables of fields: one for each component; names for cells and nodes differ."""
    found = []
    for name, arrays in fields.items():
        shape = np.shape(arrays[0])
        parts = (
            [name] if len(shape) == 3 else [f"{name}_{'xyz'[c] if shape[3] == 3 else c + 1}" for c in range(shape[3])]
        )
        found += [f"{part} of cells" if part in taken else part for part in parts]
    return found


def _columns(array: np.ndarray) -> list[np.ndarray]:
    """Components of a field, each with i running fastest."""
    parts = [array] if array.ndim == 3 else list(np.moveaxis(array, -1, 0))
    return [part.ravel(order="F") for part in parts]


def _write_numbers(file: IO, values: np.ndarray) -> None:
    """Write numbers, some in each line."""
    is_whole = values.dtype.kind in "iu"
    values = values if is_whole else np.where(np.isfinite(values), values, -1.0)
    text = list(map(str if is_whole else repr, values.tolist()))
    lines = (" ".join(text[n : n + PER_LINE]) for n in range(0, len(text), PER_LINE))
    file.write("\n".join(lines) + "\n")


def _quoted(text: str) -> str:
    cleaned = text.replace('"', "'").replace("\n", " ")
    return f'"{cleaned}"'
