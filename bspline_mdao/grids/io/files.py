"""Grid files of all formats: read by content, written in the format of the name or of the grid.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Protocol

from ...base.numerics.processes import ONE, on_first
from ...errors import InputError
from ..topology.grid import Grid, require_grid
from ..topology.stored_grid import StoredGrid
from ..topology.topology import Topology
from .formats import COMPRESSED, FORMATS, MODEL, GridFormat, format_of_content, format_of_name
from .other_files import head_of_grid
from .patches import read_patches
from .plane_grids import PlaneDialect, flattened
from .plot3d_dialect import Plot3dDialect

__all__ = ["check_grid_name", "open_grid", "read_grid", "write_grid"]

_HEAD = 4096  # bytes searched for the signature of a format


class HasDialect(Protocol):
    """A grid, or an object with its source and dialect, such as the header of a model."""

    @property
    def source(self) -> str:
        """Origin of the grid."""

    @property
    def dialect(self) -> object | None:
        """Format details of its file."""


def read_grid(
    path: str | os.PathLike, patches: str | os.PathLike | None = None, blocks: Iterable[int] | None = None
) -> Grid:
    """Read a PLOT3D or CGNS grid, and optionally a patches file.

    Parameters
    ----------
    path : path-like
        The grid; its format is found from its content, never from its name.
    The grid; its format is found from its content, never from its name.
        Patches in TOML or a neutral map file. They replace patches of the same name in a CGNS grid.
    blocks : iterable of int, optional
        Numbers, from 0, of the blocks to read, in this order; all by default. Other blocks are skipped.

    Returns
    -------
    Grid
        The grid.

    Raises
    ------
    If a file cannot be read; the message is one line.
        When a file cannot be read, in one line.

    Examples
    --------
    >>> import tempfile
    >>> from bspline_mdao import read_grid, write_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_grid(f"{folder}/body.cgns", brick_grid((5, 5, 5, 5)))
    ...     grid = read_grid(f"{folder}/body.cgns")
    >>> len(grid.blocks), grid.blocks[0].nodes.shape, [patch.name for patch in grid.patches]
    (6, (5, 5, 5, 3), ['body', 'farfield'])
    """
    if blocks is not None:
        return open_grid(path, patches).grid(blocks)
    form = format_of_content(head_of_grid(path, _HEAD))
    grid = _function(form, form.reader)(path)
    return grid if patches is None else read_patches(patches, grid)


def open_grid(path: str | os.PathLike, patches: str | os.PathLike | None = None, comm: Any = ONE) -> StoredGrid:
    """Open a PLOT3D or CGNS grid, to read blocks or windows without the rest.

    Names, shapes and patches are known at once. Raw binary, Fortran records and HDF5 are read at the places of the
    nodes. Text is scanned once to find them. Compressed files are decompressed as a whole, by every process that reads.

    Parameters
    ----------
    path, patches : path-like
        As for `read_grid`.
    comm : communicator
        Processes that open it together: the first examines the file, and sends the result to the others.

    Returns
    -------
    StoredGrid

    Raises
    ------
    InputError
        If a file cannot be read, on all processes; the message is one line.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from bspline_mdao import open_grid, write_grid
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> path = pathlib.Path(tempfile.mkdtemp(), "plate.xyz")
    >>> write_grid(path, flat_plate_grid())
    >>> open_grid(path).grid([1]).shapes == (flat_plate_grid().shapes[1],)
    True
    """

    def look() -> StoredGrid:
        form = format_of_content(head_of_grid(path, _HEAD))
        grid = _function(form, form.opener)(path)
        return grid if patches is None else read_patches(patches, grid)

    return on_first(comm, look)


def write_grid(path: str | os.PathLike, grid: Grid, topology: Topology | None = None) -> None:
    """Write a grid completely or not at all.

    The name determines the format (`bspline_mdao.grids.io.formats.FORMATS`): ``.cgns``; ``.vtm`` (ParaView) and
    ``.dat`` (Tecplot), both with the quality and the place of every cell; a folder ``polyMesh`` (OpenFOAM); or a suffix
    of PLOT3D. With one of these, none, or the suffix of its own file, a grid from PLOT3D keeps its dialect. Other grids
    become PLOT3D with 8-byte reals and a block count: ASCII for ``.fmt``, ``.p3dfmt`` and ``.txt``, otherwise raw
    little-endian binary, both compressed if ``.gz``, ``.bz2`` or ``.xz`` follows.

    Parameters
    ----------
    path : path-like
        The file to create or replace; a folder for OpenFOAM.
    grid : Grid
        The grid.
    topology : Topology, optional
        See `write_polymesh` and `write_cgns`; other formats do not need it.

    Raises
    ------
    InputError
        If the format cannot store the grid, the name is of another format, or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from bspline_mdao import read_grid, write_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_grid(f"{folder}/body.xyz", brick_grid((5, 5, 5, 5)))  # the name gives the format
    ...     grid = read_grid(f"{folder}/body.xyz")
    >>> grid.n_nodes
    750
    """
    require_grid(grid)
    form = _format_to_write(path, grid)
    write = _function(form, form.writer)
    if not form.folder and isinstance(grid.dialect, PlaneDialect):
        grid, topology = flattened(grid), None
    if form.takes_topology:
        write(path, grid, topology)
    else:
        write(path, grid)


def check_grid_name(
    path: str | os.PathLike,  # the file to create or replace
    grid: HasDialect,  # the grid, or its header: a grid from PLOT3D may keep the suffix of its file
) -> None:
    """Refuse a name whose format cannot be written."""
    _format_to_write(path, grid)


def _format_to_write(path: str | os.PathLike, grid: HasDialect) -> GridFormat:
    """Return the format in which a grid is written under a name."""
    name, plot3d = Path(path), FORMATS[0]
    suffix = plot3d.suffix_of(name)
    dialect = grid.dialect.dialect if isinstance(grid.dialect, PlaneDialect) else grid.dialect
    if isinstance(dialect, Plot3dDialect) and suffix == plot3d.suffix_of(Path(grid.source)):
        return plot3d  # also if another format has the suffix, such as .dat
    named = format_of_name(name)
    if named is not None:
        return named
    others = sorted(
        FORMATS[1:], key=lambda form: (bool(form.folder), bool(form.reader))
    )  # formats that are only detected
    names = ", ".join(str(form).removeprefix("a folder ") for form in others)
    asked = "".join(name.suffixes[-2:]) if name.suffix.lower() in COMPRESSED else name.suffix
    advice = f"name it {names}, or for {plot3d.name} {', '.join(filter(None, plot3d.suffixes))}"
    if suffix == MODEL:
        raise InputError(
            f"{path}: a grid is written here, and {MODEL} is a fitted model; {advice}; 'bspline-mdao fit' makes a "
            f"model of the grid"
        )
    raise InputError(f"{path}: no '{asked}' files are written; {advice}")


def _function(form: GridFormat, name: str) -> Callable:
    """Return a function of the module of a format, imported on demand."""
    return getattr(importlib.import_module(f"{__package__}.{form.module}"), name)
