"""CGNS grids with structured zones, in HDF5 files: bases, zones and coordinates.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from ...base.text import counted
from ...errors import InputError
from ..topology.detection import find_topology
from ..topology.grid import Block, Grid, find_fault
from ..topology.index_space import Window
from ..topology.stored_grid import StoredBlock, StoredGrid
from ..topology.topology import Topology
from .adf import copied_cgns, is_adf, opened_cgns
from .cgns_connections import add_connections, read_connections
from .cgns_faces import add_boundaries, read_patches_of_zones
from .cgns_nodes import (
    add_node,
    children,
    damaged_is_input_error,
    first_child,
    follow_link,
    free_name,
    is_link,
    label,
    require_stored,
    set_attributes,
    set_root_attributes,
    value,
    word,
)
from .cgns_overset import blanking_of, with_overset_patches
from .cgns_periodic import read_periodic, with_periodic_patches
from .cgns_units import add_unit, read_unit
from .disk import deferred_interrupts, replaced_file, replaced_hdf5_file
from .element_order import HEXAHEDRA
from .formats import MODEL, MODEL_FORMAT

__all__ = ["CgnsDialect", "add_coordinates", "open_cgns", "read_cgns", "write_base", "write_cgns"]

LIBRARY_VERSION = 3.4
"""Version written into new files; older tools refuse 4.0."""

_AXES = ("CoordinateX", "CoordinateY", "CoordinateZ")

_Zone = tuple[str, h5py.Group, h5py.Group]
"""Name, base and node of a zone."""


@dataclass(frozen=True)
class CgnsDialect:
    """Origin of a CGNS grid: its file, and what was not read from it."""

    path: str  # absolute path of the file; writing starts from a copy of it
    # boundary conditions that are no patches, and connections that fit no zone, one line each
    ignored: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Name the format."""
        return f"CGNS ({'ADF' if os.path.isfile(self.path) and is_adf(self.path) else 'HDF5'})"


def read_cgns(
    path: str | os.PathLike,  # the file
) -> Grid:  # its ``dialect`` is a `CgnsDialect`
    """Read the structured zones of a CGNS file, in HDF5 or ADF."""
    # Zones come in the order of creation if the file keeps it, as in the CGNS library, and otherwise in the natural
    # order of their names (``Zone 9`` before ``Zone 10``). With more than one base the names are ``base/zone``; bases
    # of a lower cell dimension than the highest (surfaces of a volume grid) are left out, and the dialect says so.
    # Boundary conditions become patches, named after their family if they have one, by its path if it is in another;
    # their kind is the kind of the condition or, if it says nothing, of the name. One-to-one connections become
    # connections of the grid, periodic ones its pairs of sides; faces of overset connections become a patch, and their
    # points and holes the blanking. Linked nodes are followed. and holes the blanking. Linked nodes are followed.
    stored = open_cgns(path)
    with _opened(stored.source) as file:
        zones = _find_zones(file, stored.source)
        blocks = [_read_block(zones, number, stored.source) for number in range(len(zones))]
    fault = find_fault(blocks)
    if fault:
        raise InputError(f"{stored.source}: {fault}")
    fields = stored.patches, stored.source, stored.dialect, stored.connections, stored.unit, stored.periodic
    return Grid(tuple(blocks), *fields)


def open_cgns(
    path: str | os.PathLike,  # the file
) -> StoredGrid:  # with the contents of `read_cgns`
    """Open a CGNS file, to read its zones, or windows of them, later."""
    source = str(path)
    with _opened(source) as file:
        zones = _find_zones(file, source)
        names = [name for name, _, _ in zones]
        shapes: list[tuple[int, ...]] = [_checked_shape(base, zone, name, source) for name, base, zone in zones]
        patches, ignored = read_patches_of_zones([(base, zone) for _, base, zone in zones], shapes)
        ignored = _bases_left_out(file) + ignored
        unit = read_unit(source, [(base, zone) for _, base, zone in zones])
        nodes = [zone for _, _, zone in zones]
        connections, unfit = read_connections(nodes, names, shapes)
        patches, unused = with_overset_patches(patches, nodes, names, shapes)
        periodic, unclear = read_periodic(nodes, names, shapes, partial(_nodes_at, zones, source), unit)
        patches = with_periodic_patches(patches, periodic)
    blocks = tuple(
        StoredBlock(shape, name, partial(_read_part, source, number, name))
        for number, (name, shape) in enumerate(zip(names, shapes))
    )
    dialect = CgnsDialect(os.path.abspath(path), ignored + unfit + unused + unclear)
    return StoredGrid(blocks, patches, source, dialect, connections, unit, periodic)


@contextmanager
def _opened(source: str) -> Iterator[h5py.File]:
    """Open a file for reading; any error becomes an `InputError`."""
    with deferred_interrupts(), damaged_is_input_error(source), opened_cgns(source) as file:
        yield file


def _read_part(source: str, number: int, name: str, window: Window | None) -> Block:
    """Read a window of zone ``number``, from 0."""
    with _opened(source) as file:
        zones = _find_zones(file, source)
        if number >= len(zones) or zones[number][0] != name:
            raise InputError(f"{source}: has changed since it was opened; read it again")
        block = _read_block(zones, number, source, window)
    fault = find_fault([block], number + 1, (0, 0, 0) if window is None else window.lo)
    if fault:
        raise InputError(f"{source}: {fault}")
    return block


def _read_block(zones: Sequence[_Zone], number: int, source: str, window: Window | None = None) -> Block:
    """Read the nodes of a zone, or of a window of it, and their blanking, if the file has some."""
    name, base, zone = zones[number]
    shape = _zone_shape(zone, name, source)
    blanking = blanking_of(zone, [each for each, _, _ in zones], number, shape)
    if blanking is not None and window is not None:
        blanking = blanking[window.slices]
    return Block(_read_nodes(base, zone, name, source, window), name, blanking)


def _nodes_at(zones: Sequence[_Zone], source: str, window: Window) -> np.ndarray:
    """Read the nodes of a window."""
    name, base, zone = zones[window.block]
    return _read_nodes(base, zone, name, source, window)


def _find_zones(file: h5py.File, source: str) -> list[_Zone]:
    """Name, base and zone of every block, in block order."""
    bases = children(file, "CGNSBase_t")
    if not bases and file.attrs.get("format") == MODEL_FORMAT:
        raise InputError(
            f"{source}: is a fitted model, and a grid is read here; 'bspline-mdao refine {source} -o grid.cgns' writes "
            f"the grid of a model, and commands that take models know them by the suffix {MODEL}"
        )
    if not bases:
        raise InputError(f"{source}: is an HDF5 file without a CGNS base; give a CGNS or PLOT3D grid")
    cell_dimensions = [int(value(base)[0]) for _, base in bases]
    chosen = [item for item, cells in zip(bases, cell_dimensions) if cells == max(cell_dimensions)]
    zones = [
        (name if len(chosen) == 1 else f"{base_name}/{name}", base, zone)
        for base_name, base in chosen
        for name, zone in children(base, "Zone_t")
    ]
    if not zones:
        raise InputError(f"{source}: has no zones; give a CGNS file with a grid")
    for name, _, zone in zones:
        zone_type = first_child(zone, "ZoneType_t")
        if zone_type is not None and word(zone_type) != "Structured":
            raise InputError(
                f"{source}: zone '{name}' is not structured, it is a mesh{_of_hexahedra(zone)}; give a grid of "
                f"structured blocks; 'bspline-mdao ride MODEL.h5 {source}' takes the mesh along with the model of one"
            )
    return zones


def _bases_left_out(file: h5py.File) -> tuple[str, ...]:
    """Say which bases with zones are not read, because another one has cells of more dimensions."""
    bases = [(name, int(value(base)[0]), children(base, "Zone_t")) for name, base in children(file, "CGNSBase_t")]
    most = max(dimensions for _, dimensions, _ in bases)
    return tuple(
        f"base '{name}' ({counted(len(zones), 'zone')} of {dimensions}-dimensional cells) is not read, since another "
        f"one has {most}-dimensional cells; CGNS files that are written have it as it is"
        for name, dimensions, zones in bases
        if zones and dimensions < most
    )


def _of_hexahedra(zone: h5py.Group) -> str:
    """Give the number and degree of the hexahedra of an unstructured zone, if they are in this package's format."""
    found = []
    for _, section in children(zone, "Elements_t"):
        kind, ends = int(value(section)[0]), first_child(section, "IndexRange_t")
        if kind in HEXAHEDRA.values() and ends is not None:
            low, high = value(ends)[:2]
            degree = next(degree for degree, number in HEXAHEDRA.items() if number == kind)
            shape = f"of degree {degree}, curved as 'refine --degree {degree}' writes them" if degree > 1 else ""
            found.append(f"{int(high) - int(low) + 1:,} hexahedra {shape}".rstrip())
    return f" of {', '.join(found)}" if found else ""


def _checked_shape(base: h5py.Group, zone: h5py.Group, name: str, source: str) -> tuple[int, int, int]:
    """Node counts of a zone whose coordinates exist, have that shape, and are reals."""
    shape = _zone_shape(zone, name, source)
    for axis, node in enumerate(_coordinates(zone, int(value(base)[1]), name, source)):
        data = node[" data"]
        require_stored(node)
        if data.shape[::-1] + (1,) * (3 - data.ndim) != shape or data.dtype.kind != "f":
            raise InputError(
                f"{source}: zone '{name}': {_AXES[axis]} is no array of {shape} reals; write it without rind planes"
            )
    return shape


def _read_nodes(base: h5py.Group, zone: h5py.Group, name: str, source: str, window: Window | None = None) -> np.ndarray:
    """Nodes of a zone, or of a window of it, shape (ni, nj, nk, 3)."""
    shape = _checked_shape(base, zone, name, source)
    slices = tuple(map(slice, shape)) if window is None else window.slices
    nodes = np.zeros((*(part.stop - (part.start or 0) for part in slices), 3))
    for axis, node in enumerate(_coordinates(zone, int(value(base)[1]), name, source)):
        data = node[" data"]
        array = data[slices[: data.ndim][::-1]]
        with np.errstate(invalid="ignore"):  # a NaN is reported later
            nodes[..., axis] = array.T.reshape(nodes.shape[:3])
    return nodes


def _zone_shape(zone: h5py.Group, name: str, source: str) -> tuple[int, int, int]:
    """Node counts of a zone, 1 in missing directions."""
    sizes = np.asarray(value(zone))
    if sizes.ndim != 2 or sizes.shape[0] != 3 or not 1 <= sizes.shape[1] <= 3 or sizes[0].min() < 1:
        raise InputError(f"{source}: zone '{name}' has no node counts of a structured zone; write it again")
    # only arrays that are in the file can be this large, so nothing is reserved for a damaged count
    n_stored = sum(node[" data"].size for _, node in children(_grid_coordinates(zone), "DataArray_t"))
    if float(np.prod(sizes[0].astype(float))) > n_stored:
        raise InputError(f"{source}: zone '{name}' announces {sizes[0].tolist()} nodes and holds fewer; write it again")
    return tuple(int(n) for n in sizes[0]) + (1,) * (3 - sizes.shape[1])


def _grid_coordinates(zone: h5py.Group) -> h5py.Group:
    """Return the original grid: the node named GridCoordinates, or the first of its kind."""
    found = children(zone, "GridCoordinates_t")
    if not found:
        raise KeyError(f"zone {zone.name} has no coordinates")
    return dict(found).get("GridCoordinates", found[0][1])


def _coordinates(zone: h5py.Group, n_axes: int, name: str, source: str) -> list[h5py.Group]:
    """Nodes of the Cartesian coordinates of a zone, in the order x, y, z."""
    arrays = dict(children(_grid_coordinates(zone), "DataArray_t"))
    missing = [axis for axis in _AXES[: min(max(n_axes, 1), 3)] if axis not in arrays]
    if missing:
        raise InputError(f"{source}: zone '{name}' has no {missing[0]}; only Cartesian coordinates can be read")
    return [arrays[axis] for axis in _AXES if axis in arrays]


def write_cgns(
    path: str | os.PathLike,  # the file to create or replace
    grid: Grid,  # the grid
    # topology, found from its nodes by default; pass the baseline's for a moved grid
    topology: Topology | None = None,
) -> None:
    """Write a CGNS/HDF5 file, whole or not at all."""
    # A grid read from CGNS is written as a copy of its file with new coordinates, and with the one-to-one connections
    # that the file lacks: everything else stays, converted to HDF5 if it was in ADF. Links are replaced by their
    # targets, so no other file is changed. Any other grid makes a new file with one base, a zone for every block, its
    # patches as families, its interfaces as one-to-one connections and collapsed faces as degenerate boundary
    # conditions.
    fault = find_fault(grid.blocks)
    if fault:
        raise InputError(f"{grid.source}: {fault}; nothing was written")
    topology = topology or find_topology(grid)
    (_write_copy if isinstance(grid.dialect, CgnsDialect) else _write_new)(path, grid, topology)


def _write_copy(path: str | os.PathLike, grid: Grid, topology: Topology) -> None:
    """Write a copy of the file from which a grid was read, with its nodes."""
    source = grid.dialect.path
    if not os.path.isfile(source):
        raise InputError(f"{source}: is gone; it is needed to write the grid back as CGNS with all that it contained")
    with replaced_file(path) as temporary, damaged_is_input_error(source), deferred_interrupts():
        copied_cgns(source, temporary)
        _replace_coordinates(temporary, source, grid, topology)


def _replace_coordinates(path: Path, source: str, grid: Grid, topology: Topology) -> None:
    """Put the nodes of a grid into a copy of its file, and add the connections that it lacks."""
    with h5py.File(path, "r+") as file, opened_cgns(source) as original:
        _resolve_links(file, original)
        zones = _find_zones(file, source)
        names = [name for name, _, _ in zones]
        if names != [block.name for block in grid.blocks]:
            raise InputError(f"{source}: has changed since the grid was read (zones {names[:3]}...); read it again")
        for block, (name, base, zone) in zip(grid.blocks, zones):
            if _zone_shape(zone, name, source) != block.shape:
                raise InputError(f"{source}: zone '{name}' has changed since the grid was read; read it again")
            for axis, node in enumerate(_coordinates(zone, int(value(base)[1]), name, source)):
                data = node[" data"]
                data[...] = block.nodes[..., axis].T.reshape(data.shape)
        nodes = [zone for _, _, zone in zones]
        declared = [side for item in read_connections(nodes, names, grid.shapes)[0] for side in (item.a, item.b)]
        lacking = [item for item in topology.interfaces if not any(item.a.overlaps(side) for side in declared)]
        add_connections(nodes, lacking)
        if grid.unit and not read_unit(source, [(base, zone) for _, base, zone in zones]):
            for base in {base.name: base for _, base, _ in zones}.values():
                add_unit(base, grid.unit)


def _resolve_links(group: h5py.Group, original: h5py.Group) -> None:
    """Replace links below ``group`` by copies of their targets; ``original`` is the same node of the source."""
    for name in list(group):
        if group.get(name, getclass=True) is not h5py.Group:
            continue
        target = follow_link(original[name])
        if is_link(original[name]):
            del group[name]
            original.file.copy(target, group, name)
            kind = target.attrs["type"]
            set_attributes(group[name], name, label(target), kind.decode() if isinstance(kind, bytes) else str(kind))
        _resolve_links(group[name], target)


def _write_new(path: str | os.PathLike, grid: Grid, topology: Topology) -> None:
    """Write a file of one base, with a zone for every block."""
    with replaced_hdf5_file(path) as file, deferred_interrupts():
        is_flat = all(block.shape[2] == 1 for block in grid.blocks)
        n_indices = 2 if is_flat else 3
        base = write_base(file, n_indices, grid.unit)
        zones = [_write_zone(base, block, n_indices) for block in grid.blocks]
        add_boundaries(base, zones, grid, [w for w in topology.collapsed if w.is_on_face(topology.shapes[w.block])])
        add_connections(zones, topology.interfaces)


def write_base(file: h5py.File, n_dimensions: int, unit: str = "") -> h5py.Group:
    """Write the CGNS library's root of an HDF5 file, and a base whose cells have 2 or 3 dimensions."""
    set_root_attributes(file)
    add_node(file, "CGNSLibraryVersion", "CGNSLibraryVersion_t", np.array([LIBRARY_VERSION], np.float32))
    base = add_node(file, "Base", "CGNSBase_t", np.array([n_dimensions, 3], np.int32))
    add_unit(base, unit)
    return base


def _write_zone(base: h5py.Group, block: Block, n_indices: int) -> h5py.Group:
    """Write a block as a zone of 2 or 3 index directions."""
    n_nodes = np.array(block.shape[:n_indices], np.int32)
    sizes = np.array([n_nodes, n_nodes - 1, np.zeros_like(n_nodes)])
    zone = add_node(base, free_name(base, block.name), "Zone_t", sizes)
    add_node(zone, "ZoneType", "ZoneType_t", "Structured")
    add_coordinates(zone, block.nodes.reshape(*block.shape[:n_indices], 3))
    return zone


def add_coordinates(
    zone: h5py.Group,  # the zone
    nodes: np.ndarray,  # (..., 3), nodes in the zone's index directions
) -> None:
    """Write the coordinates of a zone."""
    coordinates = add_node(zone, "GridCoordinates", "GridCoordinates_t")
    for axis, name in enumerate(_AXES):
        array = add_node(coordinates, name, "DataArray_t", np.ascontiguousarray(nodes[..., axis].T, np.float64))
        add_node(array, "DimensionalExponents", "DimensionalExponents_t", np.array([0, 1, 0, 0, 0], np.float32))
