"""Curved hexahedra as an unstructured zone of a CGNS/HDF5 file.

Sections of HEXA_8, HEXA_27, HEXA_64 or HEXA_125 come first, then one of QUAD_4, QUAD_9, QUAD_16 or QUAD_25 for every
patch, to which a boundary condition at face centres refers. Format: ``docs/theory/high_order.rst``.
"""

from __future__ import annotations

import os

import h5py
import numpy as np

from ...errors import InputError
from ..cells.curved_grid import CurvedGrid
from .cgns import add_coordinates, write_base
from .cgns_faces import add_family
from .cgns_nodes import add_node, children, damaged_is_input_error, first_child, free_name, value, word
from .disk import deferred_interrupts, replaced_hdf5_file
from .element_order import HEXAHEDRA, QUADRANGLES, cgns_order

__all__ = ["read_cgns_elements", "write_cgns_elements"]


def write_cgns_elements(
    path: str | os.PathLike,  # the file to create or replace
    grid: CurvedGrid,  # the elements
) -> None:
    """Write curved hexahedra as CGNS/HDF5, whole or not at all."""
    n_numbers = grid.elements.size + sum(patch.faces.size for patch in grid.patches)
    whole_number = np.int32 if max(n_numbers, len(grid.nodes)) < 2**31 else np.int64
    with replaced_hdf5_file(path) as file, deferred_interrupts():
        base = write_base(file, n_dimensions=3)
        sizes = np.array([[len(grid.nodes)], [len(grid.elements)], [0]], whole_number)
        zone = add_node(base, "Zone", "Zone_t", sizes)
        add_node(zone, "ZoneType", "ZoneType_t", "Unstructured")
        add_coordinates(zone, grid.nodes)
        numbers = _numbers(grid.elements, cgns_order(grid.degree))
        last = _add_section(zone, "Hexahedra", HEXAHEDRA[grid.degree], numbers.astype(whole_number), 0)[1]
        conditions = add_node(zone, "ZoneBC", "ZoneBC_t")
        for patch in grid.patches:
            numbers = _numbers(patch.faces, cgns_order(grid.degree, 2)).astype(whole_number)
            family, name = add_family(base, patch.name, patch.kind), free_name(zone, patch.name)
            ends = _add_section(zone, name, QUADRANGLES[grid.degree], numbers, last)
            condition = add_node(conditions, name, "BC_t", "FamilySpecified")
            add_node(condition, "PointRange", "IndexRange_t", np.array(ends, whole_number)[:, None])
            add_node(condition, "GridLocation", "GridLocation_t", "FaceCenter")
            add_node(condition, "FamilyName", "FamilyName_t", family)
            last = ends[1]


def read_cgns_elements(
    path: str | os.PathLike,  # the file
) -> CurvedGrid | None:  # its elements, numbered as in the file, without patches; None if the file holds something else
    """Read the hexahedra of a CGNS/HDF5 file, if it has one unstructured zone of cells of this kind and one degree."""
    source = str(path)
    with deferred_interrupts(), damaged_is_input_error(source), h5py.File(source, "r") as file:
        zones = [zone for _, base in children(file, "CGNSBase_t") for _, zone in children(base, "Zone_t")]
        kinds = [first_child(zone, "ZoneType_t") for zone in zones]
        if [None if kind is None else word(kind) for kind in kinds] != ["Unstructured"]:
            return None
        sections = [(int(value(section)[0]), section) for _, section in children(zones[0], "Elements_t")]
        solids = [(kind, section) for kind, section in sections if kind not in QUADRANGLES.values()]
        degrees = {degree for degree, number in HEXAHEDRA.items() for kind, _ in solids if kind == number}
        if len(degrees) != 1 or any(kind not in HEXAHEDRA.values() for kind, _ in solids):
            return None
        (degree,) = degrees
        coordinates = dict(children(dict(children(zones[0], "GridCoordinates_t"))["GridCoordinates"], "DataArray_t"))
        axes = [coordinates.get(f"Coordinate{axis}") for axis in "XYZ"]
        if None in axes:
            return None
        nodes = np.stack([value(axis).ravel() for axis in axes], axis=1).astype(float)
        numbers = [value(dict(children(part, "DataArray_t"))["ElementConnectivity"]) for _, part in solids]
        listed = np.concatenate(numbers).astype(np.int64).reshape(-1, (degree + 1) ** 3) - 1
        if not len(listed) or listed.min() < 0 or listed.max() >= len(nodes) or not np.isfinite(nodes).all():
            raise InputError(f"{source}: has elements of nodes that it does not have; write it again")
        elements = np.empty_like(listed)
        elements[:, cgns_order(degree)] = listed
        places = np.zeros((len(elements), 4), dtype=np.int64)
        places[:, 1] = np.arange(len(elements))
        return CurvedGrid(degree, nodes, elements.reshape(-1, *(degree + 1,) * 3), (), places, source)


def _numbers(lattices: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Node numbers from 1, in the order of the format, shape (n, n_nodes)."""
    return lattices.reshape(len(lattices), -1)[:, order] + 1


def _add_section(zone: h5py.Group, name: str, kind: int, numbers: np.ndarray, last: int) -> tuple[int, int]:
    """Write elements of one type after element ``last``; return the numbers of the first and the last of them."""
    ends = last + 1, last + len(numbers)
    section = add_node(zone, name, "Elements_t", np.array([kind, 0], np.int32))
    add_node(section, "ElementRange", "IndexRange_t", np.array(ends, numbers.dtype))
    add_node(section, "ElementConnectivity", "DataArray_t", numbers.reshape(-1))
    return ends
