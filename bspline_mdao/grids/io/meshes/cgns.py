"""CGNS meshes in HDF5 with unstructured zones: elements, boundary conditions, nodes; written with new coordinates.

Nodes of several zones that coincide are one, so that they move together.

Format: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import h5py
import numpy as np
from numba import njit

from ....base.display import OneLine
from ....errors import InputError
from ...cells.mixed_cells import MixedMesh, face_keys, padded
from ..adf import copied_cgns, opened_cgns
from ..cgns_connections import PERIODIC_TYPE, connections_of, periodic_of
from ..cgns_families import Families
from ..cgns_nodes import (
    children,
    damaged_is_input_error,
    first_child,
    is_link,
    names_of_families,
    require_stored,
    value,
    whole_numbers,
    word,
)
from ..cgns_overset import OVERSET_TYPE, is_overset
from ..disk import deferred_interrupts, replaced_file
from .cgns_polyhedra import NFACE, NGON, Lists, Polygons
from .layer_of_cells import LayerPoints, SectionSpan

__all__ = ["CgnsMeshFile", "is_unstructured", "read_cgns_mesh"]

CELLS = {
    "tetra": (4, {10: 4, 11: 10, 29: 16, 30: 20, 45: 22, 46: 34, 47: 35}),
    "pyramid": (5, {12: 5, 21: 13, 13: 14, 31: 21, 32: 29, 33: 30, 48: 29, 49: 50, 50: 55}),
    "wedge": (6, {14: 6, 15: 15, 16: 18, 34: 24, 35: 38, 36: 40, 51: 33, 52: 66, 53: 75}),
    "hexahedron": (8, {17: 8, 18: 20, 19: 27, 37: 32, 38: 56, 39: 64, 54: 44, 55: 98, 56: 125}),
}
FACES = {
    "triangle": (3, {5: 3, 6: 6, 25: 9, 26: 10, 41: 12, 42: 15}),
    "quad": (4, {7: 4, 8: 8, 9: 9, 27: 12, 28: 16, 43: 16, 44: 25}),
}
NODE = 2
LINES = {NODE: 1, 3: 2, 4: 3, 24: 4, 40: 5}
"""Corners of cells and faces, which come first, and their nodes by CGNS's numbers of the elements of each degree; the
nodes of elements that are no part of a boundary in three dimensions."""

CORNERS = {number: n for n, numbers in (*CELLS.values(), *FACES.values()) for number in numbers} | LINES
NODES = {k: n for _, numbers in (*CELLS.values(), *FACES.values()) for k, n in numbers.items()} | LINES
KINDS = {
    dimension: {number: kind for kind, (_, numbers) in known.items() for number in numbers}
    for dimension, known in ((2, FACES), (3, CELLS))
}
MIXED = 20
"""Corners and nodes of elements by their numbers, the kinds of cells by the dimension, and the number of mixed
sections."""

AXES = ("CoordinateX", "CoordinateY", "CoordinateZ")


@dataclass(frozen=True, eq=False)
class CgnsMeshFile(OneLine):
    """A CGNS mesh and its file."""

    mesh: MixedMesh  # the mesh
    path: str  # the file
    places: tuple[tuple[str, ...], ...]  # places of the coordinates of every zone in the file
    numbers: np.ndarray  # (n_stored,) of int, node of the mesh for each node of the zones, zone after zone
    layer: LayerPoints | None = None  # nodes of a two-dimensional file

    def write(self, path: str | os.PathLike, points: np.ndarray) -> None:
        """Write a copy of the file with new nodes, shape (n, 3), at the precision of the file."""
        points = self.mesh.as_nodes(points)
        if self.layer is not None:
            points = self.layer.in_file(points)
        with replaced_file(path) as temporary:
            with damaged_is_input_error(self.path), deferred_interrupts():
                copied_cgns(self.path, temporary)
            with damaged_is_input_error(self.path), deferred_interrupts(), h5py.File(temporary, "r+") as file:
                first = 0
                for places in self.places:
                    n = file[places[0]].size
                    moved = points[self.numbers[first : first + n]]
                    for axis, place in enumerate(places):
                        file[place][...] = moved[:, axis].reshape(file[place].shape)
                    first += n


def is_unstructured(path: str | os.PathLike) -> bool:
    """Whether all zones of a CGNS file are unstructured; False if it has none, or cannot be read."""
    try:
        with deferred_interrupts(), damaged_is_input_error(str(path)), opened_cgns(str(path)) as file:
            zones = [zone for _, base in children(file, "CGNSBase_t") for _, zone in children(base, "Zone_t")]
            kinds = [first_child(zone, "ZoneType_t") for zone in zones]
            return bool(kinds) and all(kind is not None and word(kind) == "Unstructured" for kind in kinds)
    except InputError:  # the reader of grids reports what is wrong
        return False


def read_cgns_mesh(
    path: str | os.PathLike,  # the file
    span: SectionSpan | None = None,  # the two planes of a two-dimensional mesh; its own by default
) -> CgnsMeshFile:  # three-dimensional, if the file has zones of three and of two dimensions
    """Read the unstructured zones of a CGNS file, in HDF5 or ADF."""
    source = str(path)
    points: list[np.ndarray] = []
    seen, of_cells = [np.zeros((0, 4), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    of_polygons = [np.zeros(0, dtype=np.int64)]
    cells: dict[str, list[np.ndarray]] = {}
    markers: dict[str, list[np.ndarray]] = {}
    stated: dict[str, str] = {}
    places, first = [], 0
    with deferred_interrupts(), damaged_is_input_error(source), opened_cgns(source) as file:
        bases = [(tuple(int(size) for size in value(base)[:2]), base) for _, base in children(file, "CGNSBase_t")]
        n_dimensions, n_axes = max((sizes for sizes, _ in bases), default=(0, 0))
        zones = [
            (*found, base)
            for sizes, base in bases
            if sizes == (n_dimensions, n_axes)
            for found in children(base, "Zone_t")
        ]
        if n_dimensions not in KINDS or not zones:
            raise InputError(f"{source}: has no zones of two or three dimensions; give a CGNS mesh")
        families = Families()
        for name, zone, base in zones:
            zone_points, zone_places = _coordinates(zone, AXES[:n_axes], f"{source}: zone '{name}'")
            elements = _elements(zone, len(zone_points), n_dimensions, f"{source}: zone '{name}'")
            for kind, corners in elements.cells.items():
                cells.setdefault(kind, []).append(corners + first)
            for marker, faces in elements.markers(zone, names_of_families(base)).items():
                markers.setdefault(marker, []).append(faces + first)
            stated = {**_types(zone, base, families), **stated}
            if elements.polyhedra is not None:
                seen.append(elements.polyhedra[0] + first)
                for parts, found in zip((of_cells, of_polygons), elements.polyhedra[1:]):
                    parts.append(found + int(parts[-1].max(initial=-1)) + 1)
            points.append(zone_points)
            places.append(zone_places)
            first += len(zone_points)
    joined, numbers = np.concatenate(points), np.arange(first)
    if len(zones) > 1:
        joined, numbers = np.unique(joined, axis=0, return_inverse=True)
        numbers = numbers.ravel()
    corners_of, marked = (
        {name: numbers[np.concatenate(parts)] for name, parts in found.items()} for found in (cells, markers)
    )
    if n_dimensions == 2:
        layer = LayerPoints.of(joined, span, source)
        return CgnsMeshFile(
            layer.mesh(corners_of, marked, stated), os.path.abspath(path), tuple(places), numbers, layer
        )
    polyhedra = (numbers[np.concatenate(seen)], np.concatenate(of_cells)) if len(seen) > 1 else None
    polygons = np.concatenate(of_polygons) if len(seen) > 1 else None
    mesh = MixedMesh(joined, corners_of, marked, polyhedra, source, stated=stated, polygons=polygons)
    return CgnsMeshFile(mesh, os.path.abspath(path), tuple(places), numbers)


def _conditions(zone: h5py.Group) -> list[tuple[str, str, h5py.Group]]:
    """Name of every boundary condition of a zone, or of its family, its own name, and its node."""
    found = []
    for _, group in children(zone, "ZoneBC_t"):
        for name, condition in children(group, "BC_t"):
            family = first_child(condition, "FamilyName_t")
            found.append((name if family is None else word(family), name, condition))
    return found


def _types(zone: h5py.Group, base: h5py.Group, families: Families) -> dict[str, str]:
    """Types of boundary conditions by the markers that they make."""
    names = names_of_families(base)
    found: dict[str, str] = {}
    for label, name, condition in _conditions(zone):
        for marker in names.get(label, (label,)):
            found.setdefault(marker, families.meaning_of(base, name, condition).bc_type)
    return {name: kind for name, kind, _ in _declared_sides(zone)} | found


def _declared_sides(zone: h5py.Group) -> list[tuple[str, str, h5py.Group]]:
    """Name, type and node of the connections of a zone with faces on the boundary: periodic and overset ones."""
    found = []
    for name, node in connections_of(zone, "GridConnectivity_t"):
        if periodic_of(node) is not None:
            found.append((name, PERIODIC_TYPE, node))
        elif is_overset(node):
            found.append((name, OVERSET_TYPE, node))
    return found


def _coordinates(zone: h5py.Group, axes: tuple[str, ...], what: str) -> tuple[np.ndarray, tuple[str, ...]]:
    """Nodes of a zone, and the places of their coordinates."""
    kind = first_child(zone, "ZoneType_t")
    if kind is None or word(kind) != "Unstructured":
        raise InputError(f"{what} is structured; fit it, or take it as the grid that others ride on")
    found = children(zone, "GridCoordinates_t")
    arrays = dict(children(dict(found).get("GridCoordinates", found[0][1]), "DataArray_t")) if found else {}
    missing = [axis for axis in axes if axis not in arrays]
    if missing:
        raise InputError(f"{what} has no {missing[0]}; only Cartesian coordinates can be read")
    for axis in axes:
        require_stored(arrays[axis])
        if is_link(arrays[axis]):
            raise InputError(f"{what}: {axis} is a link to another file; copy it into this one")
    data = [arrays[axis][" data"] for axis in axes]
    for axis, stored in zip(axes, data):
        if stored.dtype.kind != "f":
            raise InputError(f"{what}: {axis} is of {stored.dtype}, which no moved node fits; write it as reals")
    n_points = int(whole_numbers(zone)[0])
    if any(stored.size != n_points for stored in data):
        sizes = ", ".join(f"{stored.size:,}" for stored in data)
        raise InputError(f"{what}: announces {n_points:,} nodes and holds {sizes} coordinates; write it again")
    return np.stack([np.asarray(x, dtype=float).ravel() for x in data], axis=1), tuple(x.name for x in data)


@dataclass(frozen=True, eq=False)
class _Elements:
    """Elements of a zone."""

    cells: dict[str, np.ndarray]  # corners of the cells of each kind, from 0
    faces: np.ndarray  # (n, 4) or (n, 2), corners of its faces; in two dimensions ends of lines
    numbers: np.ndarray  # (n,), their numbers in the zone, ascending
    # faces of each section that has some, as rows of `faces`; polygons only if they belong to one cell
    sections: dict[str, np.ndarray]
    # of int, faces of polyhedra, their cells and polygons, see `MixedMesh`
    polyhedra: tuple[np.ndarray, np.ndarray, np.ndarray] | None

    def markers(self, zone: h5py.Group, names: Mapping[str, tuple[str, ...]]) -> dict[str, np.ndarray]:
        """Faces of conditions by the names of their families, or else of sections; further faces of declared sides."""
        found: dict[str, list[np.ndarray]] = {}
        for label, _, condition in _conditions(zone):
            rows = self._rows_of(condition)
            for marker in names.get(label, (label,)) if len(rows) else ():
                found.setdefault(marker, []).append(rows)
        sides = {name: self._rows_of(node) for name, _, node in _declared_sides(zone)}
        if not found:
            declared = np.concatenate([np.zeros(0, dtype=np.int64), *sides.values()])
            left = {name: np.setdiff1d(rows, declared) for name, rows in self.sections.items()}
            found = {name: [rows] for name, rows in left.items() if len(rows)}
        taken = np.concatenate([np.zeros(0, dtype=np.int64), *(rows for parts in found.values() for rows in parts)])
        for name, rows in sides.items():
            bare = np.setdiff1d(rows, taken)
            found |= {name: [*found.get(name, []), bare]} if len(bare) else {}
        return {name: self.faces[np.concatenate(parts)] for name, parts in found.items()}

    def _rows_of(self, condition: h5py.Group) -> np.ndarray:
        """Faces of a condition: those that it lists, or whose corners it lists all."""
        children_of = dict(children(condition, "IndexRange_t") + children(condition, "IndexArray_t"))
        place = first_child(condition, "GridLocation_t")
        chosen = children_of.get("PointRange", children_of.get("ElementRange"))
        listed = children_of.get("PointList", children_of.get("ElementList"))
        if chosen is None and listed is None:
            return np.zeros(0, dtype=np.int64)
        are_nodes = place is not None and word(place) == "Vertex"
        sought = self.faces + 1 if are_nodes else self.numbers[:, None]
        if chosen is not None:
            low, high = whole_numbers(chosen)[:2].tolist()
            return np.flatnonzero(((low <= sought) & (sought <= high)).all(axis=1))
        return np.flatnonzero(np.isin(sought, whole_numbers(listed)).all(axis=1))


def _elements(zone: h5py.Group, n_points: int, n_dimensions: int, what: str) -> _Elements:
    """Read all sections of elements of a zone of two or three dimensions."""
    cells: dict[str, list[np.ndarray]] = {}
    known, sides = KINDS[n_dimensions], KINDS[2] if n_dimensions == 3 else LINES.keys() - {NODE}
    width = 4 if n_dimensions == 3 else 2
    faces, numbers = [np.zeros((0, width), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    names: list[str] = []
    lists: dict[int, list[Lists]] = {NGON: [], NFACE: []}
    parents: list[np.ndarray | None] = []
    n_elements = 0
    for name, section in children(zone, "Elements_t"):
        kind, where = int(whole_numbers(section)[0]), f"{what}, section '{name}'"
        parts = dict(children(section, "DataArray_t") + children(section, "IndexRange_t"))
        low, high = whole_numbers(parts["ElementRange"])[:2].tolist()
        n_elements += high - low + 1
        if kind in lists and n_dimensions == 2:
            raise InputError(f"{where}: has polygons; of two dimensions triangles and quads alone can be read")
        if kind in lists:
            found = Lists.read(parts, low, high, where)
            lists[kind].append(found)
            if kind == NGON:
                _require_nodes(found.values, n_points, where)
                pieces = Polygons.of(found, where)
                faces.append(pieces.quads)
                numbers.append(pieces.numbers[pieces.polygon])
                names += [name] * len(pieces.quads)
                parents.append(_parents(parts["ParentElements"]) if "ParentElements" in parts else None)
            continue
        stored = whole_numbers(parts["ElementConnectivity"])
        for number, rows, corners in _by_kind(kind, stored, low, high, where):
            _require_nodes(corners, n_points, where)
            if n_dimensions == 2 and number in KINDS[3]:
                raise InputError(f"{where}: has a {KINDS[3][number]} in a base of two dimensions; write it again")
            if number in known:
                cells.setdefault(known[number], []).append(corners - 1)
            elif number in sides:
                faces.append(padded(corners - 1) if n_dimensions == 3 else corners[:, :2] - 1)
                numbers.append(rows)
                names += [name] * len(rows)
    order = np.argsort(np.concatenate(numbers), kind="stable")
    of = np.array(names, dtype=object)[order]
    joined, joined_faces = {kind: np.concatenate(parts) for kind, parts in cells.items()}, np.concatenate(faces)[order]
    sections = {name: np.flatnonzero(of == name) for name in dict.fromkeys(names)}
    polyhedra = _polyhedra(lists, parents, what) if lists[NGON] else None
    n_cells = sum(map(len, joined.values())) + (0 if polyhedra is None else 1 + int(polyhedra[1].max(initial=-1)))
    n_announced = int(whole_numbers(zone)[1])
    if n_announced not in (n_cells, n_elements):  # some programs also count boundary elements
        raise InputError(f"{what}: announces {n_announced:,} cells and holds {n_cells:,}; write it again")
    if polyhedra is not None:
        keys = face_keys(polyhedra[0], n_points)
        found_keys, counts = np.unique(keys, return_counts=True)
        is_outer = np.isin(face_keys(joined_faces, n_points), found_keys[counts == 1])
        sections = {name: rows[is_outer[rows]] for name, rows in sections.items() if is_outer[rows].any()}
    return _Elements(joined, joined_faces, np.concatenate(numbers)[order], sections, polyhedra)


def _polyhedra(lists: dict[int, list[Lists]], parents: list, what: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faces of polyhedra, their cells and polygons: from the cells or, without these, from the polygons' parents."""
    polygons = Polygons.of(Lists.joined(lists[NGON]), what)
    if lists[NFACE]:
        return polygons.of_cells(Lists.joined(lists[NFACE]), what)
    order = sorted(range(len(parents)), key=lambda k: lists[NGON][k].numbers[:1].tolist())
    known = [parents[k] for k in order]
    if any(part is None or part.shape != (2, len(lists[NGON][k].numbers)) for k, part in zip(order, known)):
        raise InputError(f"{what}: has polygons but neither NFACE_n nor ParentElements; write it with its cells")
    return polygons.of_parents(np.concatenate(known, axis=1))


def _parents(node: h5py.Group) -> np.ndarray:
    """Cells on both sides of polygons, as stored."""
    return whole_numbers(node).reshape(node[" data"].shape)


def _require_nodes(corners: np.ndarray, n_points: int, what: str) -> None:
    """Refuse numbers of missing nodes."""
    if corners.size and not 1 <= corners.min() <= corners.max() <= n_points:
        raise InputError(f"{what}: has node {corners.max()} of {n_points:,}; write it again")


def _by_kind(
    kind: int, stored: np.ndarray, low: int, high: int, what: str
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Number, numbers in the zone and corners, from 1, of the elements of a section, kind after kind."""
    n = high - low + 1
    if kind in NODES:
        if len(stored) != n * NODES[kind]:
            raise InputError(f"{what}: announces {n:,} elements and holds another number; write it again")
        yield kind, np.arange(low, high + 1), stored.reshape(n, NODES[kind])[:, : CORNERS[kind]]
        return
    if kind != MIXED:
        raise InputError(f"{what}: has elements of kind {kind}; known are {', '.join(map(str, sorted(NODES)))}")
    if not 0 <= n <= len(stored):  # before an array of that size is allocated
        raise InputError(f"{what}: announces {n:,} mixed elements of {len(stored):,} numbers; write it again")
    steps = np.zeros(max(NODES) + 1, dtype=np.int64)
    steps[list(NODES)] = np.array(list(NODES.values())) + 1
    starts = np.empty(n, dtype=np.int64)
    if not _find_starts(stored, steps, starts):
        raise InputError(f"{what}: its mixed elements are damaged, or of another kind; write it again")
    kinds = stored[starts]
    for number in np.unique(kinds).tolist():
        rows = np.flatnonzero(kinds == number)
        yield number, low + rows, stored[starts[rows][:, None] + 1 + np.arange(CORNERS[number])]


@njit(cache=True)
def _find_starts(stored, steps, starts):
    """Write the start of each mixed element; False if they do not end with the numbers, or a kind is unknown."""
    at = 0
    for element in range(len(starts)):
        if at >= len(stored) or not 0 <= stored[at] < len(steps) or steps[stored[at]] == 0:
            return False
        starts[element] = at
        at += steps[stored[at]]
    return at == len(stored)
