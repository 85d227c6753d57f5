"""Grid files of all formats: the content tells which one is read, the grid or the name which one is written."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import InputError
from ..topology.grid import Grid, require_grid
from ..topology.topology import Topology
from .cgns import read_cgns, write_cgns
from .compression import read_raw
from .hdf5 import held_interrupts
from .openfoam import FOLDER, write_polymesh
from .patches import read_patches
from .plot3d import read_plot3d, write_plot3d
from .plot3d_dialect import Plot3dDialect
from .vtk import write_vtk

__all__ = ["read_grid", "write_grid"]

_HEAD = 4096  # bytes that tell the format
_HDF5 = b"\x89HDF\r\n\x1a\n"
_ADF = b"@(#)ADF Database"
_ASCII_SUFFIXES = (".fmt", ".p3dfmt", ".txt")
_PLOT3D_SUFFIXES = (".xyz", ".x", ".p3d", ".plot3d", ".g", ".grd", ".unf", *_ASCII_SUFFIXES)


def read_grid(path: str | os.PathLike, patches: str | os.PathLike | None = None) -> Grid:
    """Read a PLOT3D or CGNS grid, and a patches file where there is one.

    Parameters
    ----------
    path : path-like
        The grid; its format is found from its content, never from its name.
    patches : path-like, optional
        Patches in TOML or a neutral map file. They replace patches of the same name in a CGNS grid.

    Returns
    -------
    Grid
        The grid.

    Raises
    ------
    InputError
        When a file cannot be read, in one line.
    """
    head = read_raw(path, _HEAD)
    if head.startswith(_ADF) or head[4:].startswith(_ADF):
        raise InputError(f"{path}: is CGNS in the old ADF format; convert it with 'adf2hdf' of the CGNS tools")
    is_hdf5 = any(head[start : start + 8] == _HDF5 for start in (0, 512, 1024, 2048))
    if is_hdf5:
        with held_interrupts():
            grid = read_cgns(path)
    else:
        grid = read_plot3d(path)
    return grid if patches is None else read_patches(patches, grid)


def write_grid(path: str | os.PathLike, grid: Grid, topology: Topology | None = None) -> None:
    """Write a grid, whole or not at all.

    The suffixes ``.cgns`` and ``.vtm`` (ParaView) and the name ``polyMesh`` (OpenFOAM) choose these formats. Under a
    name of PLOT3D (``.xyz``, ``.x``, ``.p3d``, ``.plot3d``, ``.g``, ``.grd``, ``.unf``, ``.fmt``, ``.p3dfmt``,
    ``.txt``, no suffix, or that which the grid was read from) a grid read from PLOT3D is written in the dialect that
    it was read in; other grids become PLOT3D with 8-byte reals and a block count: ASCII for ``.fmt``, ``.p3dfmt`` and
    ``.txt``, else raw little-endian binary, either compressed where ``.gz`` follows.

    Parameters
    ----------
    path : path-like
        The file to make or replace; a folder for OpenFOAM.
    grid : Grid
        The grid.
    topology : Topology, optional
        See `write_polymesh` and `write_cgns`; other formats do without.

    Raises
    ------
    InputError
        When the format cannot hold the grid, the name promises another format, or the file cannot be written.
    """
    require_grid(grid)
    check_grid_name(path, grid)
    suffix = Path(path).suffix.lower()
    if Path(path).name == FOLDER:
        write_polymesh(path, grid, topology)
    elif suffix == ".cgns":
        write_cgns(path, grid, topology)
    elif suffix == ".vtm":
        write_vtk(path, grid)
    elif isinstance(grid.dialect, Plot3dDialect):
        write_plot3d(path, grid)
    else:
        write_plot3d(path, grid, _dialect_of_name(Path(path)))


def check_grid_name(path: str | os.PathLike, grid: Grid) -> None:
    """Refuse a name that promises another format than those that are written.

    Parameters
    ----------
    path : path-like
        The file to make or replace.
    grid : Grid
        The grid, or what has its source and dialect: one read from PLOT3D may keep the suffix of its file.

    Raises
    ------
    InputError
        When the suffix is of none of the formats; the message lists them.
    """
    name = Path(path)
    suffix = _plot3d_suffix(name)
    is_as_read = isinstance(grid.dialect, Plot3dDialect) and suffix == _plot3d_suffix(Path(grid.source))
    if name.name == FOLDER or is_as_read or suffix in ("", ".cgns", ".vtm", *_PLOT3D_SUFFIXES):
        return
    raise InputError(
        f"{path}: no '{suffix}' files are written; name it .vtm (ParaView), .cgns, {FOLDER} (OpenFOAM), or for PLOT3D "
        f"{', '.join(_PLOT3D_SUFFIXES)}"
    )


def _plot3d_suffix(path: Path) -> str:
    """Suffix of a name, before that of compression."""
    return (path.with_suffix("") if path.suffix.lower() == ".gz" else path).suffix.lower()


def _dialect_of_name(path: Path) -> Plot3dDialect:
    """Dialect for a grid that was not read from PLOT3D."""
    is_ascii = _plot3d_suffix(path) in _ASCII_SUFFIXES
    return Plot3dDialect("ascii" if is_ascii else "raw", is_gzipped=path.suffix.lower() == ".gz")
