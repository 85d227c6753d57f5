"""Grids for ParaView: a VTK multi-block index (``.vtm``) and one structured grid (``.vts``) per block.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from ...errors import InputError
from ..topology.grid import Block, Grid, require_grid
from .disk import replaced_file, replaced_folder

__all__ = ["Fields", "check_fields", "write_vtk"]

_TYPE_NAMES = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}

Fields = Mapping[str, Sequence[np.ndarray]]
"""Name of a field and its values on every block, shape of the block's nodes (or cells), or that and (n_components,)."""


def write_vtk(
    path: str | os.PathLike, grid: Grid, node_fields: Fields | None = None, cell_fields: Fields | None = None
) -> None:
    """Write a grid for ParaView.

    ``path`` becomes the index; the blocks go to files in a folder of the same name without ``.vtm``. IBLANK is written
    as a node field, and the names of the patches, in order, as the field data ``patches``. All files are complete
    before the first takes its place, and the index is the last.

    Parameters
    ----------
    path : path-like
        The index file, ``something.vtm``.
    grid : Grid
        The grid.
    node_fields : mapping of str to sequence of ndarray, optional
        Values per block, shape (ni, nj, nk) or (ni, nj, nk, n_components).
    cell_fields : mapping of str to sequence of ndarray, optional
        The same for cells; a direction with one node has one layer of cells.

    Raises
    ------
    InputError
        If a field does not fit the grid or a file cannot be written.

    References
    ----------
    VTK file formats: appended raw data in the XML formats StructuredGrid and vtkMultiBlockDataSet.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from bspline_mdao.files import write_vtk
    >>> from bspline_mdao.generators import brick_grid
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = write_vtk(f"{folder}/body.vtm", brick_grid((5, 5, 5, 5)))
    ...     sorted(path.name for path in Path(folder).iterdir())
    ['body', 'body.vtm']
    """
    require_grid(grid)
    path = Path(path)
    node_shapes = [block.shape for block in grid.blocks]
    cell_shapes = [tuple(max(n - 1, 1) for n in shape) for shape in node_shapes]
    node_fields, cell_fields = dict(node_fields or {}), dict(cell_fields or {})
    check_fields(node_fields, node_shapes, "node")
    check_fields(cell_fields, cell_shapes, "cell")
    folder = path.with_suffix("")
    if folder == path:
        raise InputError(
            f"{path}: the index needs a suffix, so that the folder of its blocks has another name; add .vtm"
        )
    names = [f"{number:04d}.vts" for number in range(1, len(grid.blocks) + 1)]
    with replaced_file(path) as new_index, replaced_folder(folder) as new_folder:
        for index, (block, name) in enumerate(zip(grid.blocks, names)):
            on_nodes = {field: np.asarray(values[index]) for field, values in node_fields.items()}
            if block.iblank is not None:
                on_nodes.setdefault("iblank", block.iblank)
            on_cells = {field: np.asarray(values[index]) for field, values in cell_fields.items()}
            _write_block(new_folder / name, block, on_nodes, on_cells, [patch.name for patch in grid.patches])
        _write_index(new_index, grid, folder.name, names)


def check_fields(fields: Fields, shapes: Sequence[tuple[int, ...]], kind: str) -> None:
    """Refuse fields that do not fit the blocks, or whose type VTK does not have."""
    for name, values in fields.items():
        if len(values) != len(shapes):
            raise InputError(f"{kind} field '{name}' has values on {len(values)} blocks, the grid has {len(shapes)}")
        for number, (array, shape) in enumerate(zip(values, shapes), 1):
            array = np.asarray(array)
            if array.shape[:3] != shape or array.ndim > 4:
                raise InputError(f"{kind} field '{name}': shape {array.shape} does not fit {shape} of block {number}")
            if array.dtype.str[1:] not in _TYPE_NAMES:
                raise InputError(
                    f"{kind} field '{name}': type {array.dtype} is not known to VTK; give reals or integers"
                )


def _write_block(path: Path, block: Block, node_fields: Mapping, cell_fields: Mapping, patches: Sequence[str]) -> None:
    """Write one block: an XML head, then every array as its length in bytes and its bytes."""
    extent = " ".join(f"0 {n - 1}" for n in block.shape)
    appended = _Appended()
    lines = [
        '<?xml version="1.0"?>',
        f'<VTKFile type="StructuredGrid" version="1.0" byte_order="{_BYTE_ORDER}" header_type="UInt64">',
        f'<StructuredGrid WholeExtent="{extent}">',
        *_names_element("patches", patches),
        f'<Piece Extent="{extent}">',
        "<PointData>",
        *(appended.declare(name, values) for name, values in node_fields.items()),
        "</PointData>",
        "<CellData>",
        *(appended.declare(name, values) for name, values in cell_fields.items()),
        "</CellData>",
        "<Points>",
        appended.declare("Points", block.nodes),
        "</Points>",
        "</Piece>",
        "</StructuredGrid>",
        '<AppendedData encoding="raw">',
    ]
    with open(path, "wb") as file:
        file.write("\n".join(lines).encode() + b"\n_")
        for array in appended.arrays:
            file.write(np.uint64(array.nbytes).tobytes())
            file.write(array.tobytes())
        file.write(b"\n</AppendedData>\n</VTKFile>\n")


def _names_element(name: str, names: Sequence[str]) -> list[str]:
    """Field data of names: the codes of their characters, each name ended by 0."""
    if not names:
        return []
    codes = " ".join(str(code) for text in names for code in (*text.encode(), 0))
    head = f'<Array type="String" Name={quoteattr(name)} NumberOfTuples="{len(names)}" format="ascii">'
    return ["<FieldData>", head, codes, "</Array>", "</FieldData>"]


_BYTE_ORDER = "LittleEndian" if sys.byteorder == "little" else "BigEndian"


class _Appended:
    """Arrays of the appended section, in order, and the start of the next one."""

    def __init__(self) -> None:
        self.arrays: list[np.ndarray] = []
        self.offset = 0

    def declare(self, name: str, values: np.ndarray) -> str:
        """Queue an array and return the element that refers to it."""
        n_components = values.shape[3] if values.ndim == 4 else 1
        # in VTK i runs fastest, and the components of a node are consecutive
        array = np.ascontiguousarray(values.transpose((2, 1, 0, *range(3, values.ndim))))
        array = array.astype(array.dtype.newbyteorder("="), copy=False)
        element = (
            f'<DataArray type="{_TYPE_NAMES[array.dtype.str[1:]]}" Name={quoteattr(name)} '
            f'NumberOfComponents="{n_components}" format="appended" offset="{self.offset}"/>'
        )
        self.arrays.append(array)
        self.offset += 8 + array.nbytes
        return element


def _write_index(path: Path, grid: Grid, folder: str, names: Sequence[str]) -> None:
    """Write the index, which names the files of the blocks."""
    lines = [
        '<?xml version="1.0"?>',
        f'<VTKFile type="vtkMultiBlockDataSet" version="1.0" byte_order="{_BYTE_ORDER}" header_type="UInt64">',
        "<vtkMultiBlockDataSet>",
    ]
    for index, (block, name) in enumerate(zip(grid.blocks, names)):
        file = quoteattr(f"{folder}/{name}")
        lines.append(f'<DataSet index="{index}" name={quoteattr(block.name)} file={file}/>')
    lines += ["</vtkMultiBlockDataSet>", "</VTKFile>", ""]
    path.write_text("\n".join(lines), encoding="utf-8")
