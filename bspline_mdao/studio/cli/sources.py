"""The grid of a command: from a file, or a built-in one by name.

Readers and generators are imported when they are called: help shows the names, and should not wait for NumPy.
"""

from __future__ import annotations

from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

from ...core.generators.built_in import generator_of

if TYPE_CHECKING:
    from ...grids.topology.grid import Grid
    from ...grids.topology.stored_grid import StoredGrid


def file_of(grid_name: str) -> str | None:
    """Return the name of the file of a grid; None for a built-in grid."""
    return None if grid_name.startswith("@") else grid_name


def load_grid(
    grid_name: str,  # file; or a built-in grid as ``@NAME``, or ``@NAME:IxJxK`` with the nodes per block
    patches: Path | None = None,  # TOML or NMF file
    is_lifted: bool = True,  # make a planar grid one cell deep
    units: str | None = None,  # unit of its lengths, if its file does not say it
) -> Grid:
    """Read or generate a grid, and declare its patches."""
    from ...grids.io.files import read_grid  # they need NumPy and HDF5, for which help should not wait
    from ...grids.io.patches import read_patches
    from ...grids.io.plane_grids import lift_plane_grid
    from ...grids.topology.length_unit import in_unit

    grid = in_unit(read_grid(grid_name) if file_of(grid_name) else _generate(grid_name), units)
    grid = lift_plane_grid(grid) if is_lifted else grid
    return read_patches(patches, grid) if patches else grid


def stored_grid(
    grid_name: str,  # grid_name, patches, is_lifted, units: see `load_grid`
    patches: Path | None,
    comm: Any,  # the processes, all of which call this
    is_lifted: bool = True,
    units: str | None = None,
) -> StoredGrid:
    """Open a grid for several processes, which read what they need of a file; each makes a built-in grid itself."""
    from ...base.numerics.processes import together
    from ...grids.io.files import open_grid
    from ...grids.topology.length_unit import in_unit
    from ...grids.topology.stored_grid import StoredGrid

    if file_of(grid_name):
        stored = open_grid(grid_name, None, comm)
        if not (is_lifted and all(1 in shape for shape in stored.shapes)):  # others may be planar, and are small
            return in_unit(open_grid(grid_name, patches, comm) if patches else stored, units)
    with together(comm):
        return StoredGrid.of(load_grid(grid_name, patches, units=units))


def _generate(grid_name: str) -> Grid:
    """Make a built-in grid."""
    generator, shape = generator_of(grid_name)
    return resolve_name(generator)(shape)
