"""Faces of CGNS zones: boundary conditions and their patches.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence

import h5py
import numpy as np

from ..topology.grid import Grid, Patch
from ..topology.index_space import Window
from .cgns_families import BC_OVERSET, ORIGINAL_NAME, TYPES_THAT_SAY_NOTHING, Families
from .cgns_nodes import add_node, children, first_child, free_name, value, word
from .patch_guess import kind_of_name

_KIND_OF_PREFIX = (
    ("BCWall", "wall"),
    ("BCSymmetryPlane", "symmetry"),
    ("BCFarfield", "farfield"),
    ("BCInflow", "farfield"),
    ("BCOutflow", "farfield"),
    ("BCTunnel", "farfield"),
    (BC_OVERSET, "overset"),
)
_TYPE_OF_KIND = {
    "wall": "BCWall",
    "symmetry": "BCSymmetryPlane",
    "farfield": "BCFarfield",
    "overset": "UserDefined",
    "other": "UserDefined",
}
POINT_SIZE = 1e-9
"""A collapsed face smaller than this fraction of its coordinates is a point: far above 8-byte round-off."""

_NO_KIND = "BCGeneral"
"""Type of a patch of kind other whose name would be mistaken for another kind."""


def kind_of(bc_type: str, name: str) -> str:
    """Patch kind of a CGNS boundary condition; boundaries that fluid passes through count as far field."""
    # If the type says nothing, as ICEM writes it, the name of the family or of the condition decides.
    if bc_type in TYPES_THAT_SAY_NOTHING:
        return kind_of_name(name)
    return next((kind for prefix, kind in _KIND_OF_PREFIX if bc_type.startswith(prefix)), "other")


def read_patches_of_zones(
    zones: list[tuple[h5py.Group, ...]],  # the zones in block order
    shapes: list[tuple[int, ...]],  # node counts of the blocks
) -> tuple[tuple[Patch, ...], tuple[str, ...]]:
    """Collect the patches of all zones: one for every family, or for every name if there is no family."""
    # Returns patches: patches in order of their families, then of appearance, without degenerate lines and points;
    # ignored: what could not be used, and why, and conditions that contradict the names.
    windows: dict[tuple[str, str], list[Window]] = {}
    ignored: list[str] = []
    further: set[str] = set()
    known = Families()
    for block, ((base, zone), shape) in enumerate(zip(zones, shapes)):
        for name, condition in _conditions(zone):
            patch_name, bc_type, others = known.meaning_of(base, name, condition)
            further.update(others)
            if bc_type.startswith("BCDegenerate"):
                continue
            window = face_window(block, shape, condition)
            if window is None:
                ignored.append(
                    f"{zone.name}: boundary condition '{name}' is no rectangle of a face; its patch was left out"
                )
            else:
                windows.setdefault((patch_name, kind_of(bc_type, patch_name)), []).append(window)
    bases = {base.name: base for base, _ in zones}.values()
    families = [name for base in bases for name in known.of(base)]
    if further:
        listed = ", ".join(sorted(further)[:3])
        ignored.append(
            f"conditions have further families, {listed}{', ...' * (len(further) > 3)}; patches are named after the "
            f"first of each, and CGNS files that are written have them all"
        )
    ignored += [
        f"patch '{name}' is of kind {kind} by its condition, though its name says {kind_of_name(name)}"
        for name, kind in windows
        if kind_of_name(name) not in (kind, "other")
    ]
    order = sorted(windows, key=lambda key: families.index(key[0]) if key[0] in families else len(families))
    first = dict(reversed(order))  # for each name, the kind that comes first
    names = {key: key[0] if first[key[0]] == key[1] else f"{key[0]} ({key[1]})" for key in order}
    ignored += [
        f"patch '{name}' has conditions of several kinds; those of kind {kind} are the patch '{names[name, kind]}'"
        for name, kind in order
        if names[name, kind] != name
    ]
    return tuple(Patch(names[key], key[1], tuple(windows[key])) for key in order), tuple(ignored)


def _conditions(zone: h5py.Group) -> list[tuple[str, h5py.Group]]:
    """Name and node of every boundary condition of a zone."""
    return [bc for _, zone_bc in children(zone, "ZoneBC_t") for bc in children(zone_bc, "BC_t")]


def face_window(block: int, shape: tuple[int, ...], node: h5py.Group) -> Window | None:
    """Face window that a condition or connection covers on its own side; None if it covers none."""
    points = first_child(node, "IndexRange_t")
    is_range = points is not None
    lists = (found for name, found in children(node, "IndexArray_t") if not name.endswith("Donor"))
    points = points if is_range else next(lists, None)
    if points is None:
        return None
    location = first_child(node, "GridLocation_t")
    is_vertex = location is None or word(location) in ("", "Vertex")
    indices = np.atleast_2d(value(points)).astype(np.int64)
    n_listed = len(indices)
    lo, hi = indices.min(axis=0) - 1, indices.max(axis=0) - 1
    if not is_vertex:
        lo, hi = _to_nodes(word(location), lo, hi)
    lo, hi = (np.append(end, np.zeros(3 - len(end), np.int64)) for end in (lo, hi))
    window = Window(block, tuple(lo.tolist()), tuple(hi.tolist()))
    n_faces = np.prod([max(n - (0 if is_vertex else 1), 1) for n in window.shape])
    if not is_range and (n_listed != n_faces or len(np.unique(indices, axis=0)) != n_listed):
        return None
    return window if window.is_on_face(shape) else None


def _to_nodes(location: str, lo: np.ndarray, hi: np.ndarray) -> tuple[np.ndarray, ...]:
    """Node range of a range of cell faces: one more along the face, the same across it."""
    normal = {"IFaceCenter": 0, "JFaceCenter": 1, "KFaceCenter": 2}.get(location)
    across = np.arange(len(lo)) == normal if normal is not None else lo == hi
    return lo, np.where(across, hi, hi + 1)


def add_boundaries(
    base: h5py.Group,  # the base; it gets a family for every patch
    zones: list[h5py.Group],  # the zone of every block
    grid: Grid,  # the grid with its patches
    # windows of faces that have collapsed to lines or points; a patch that covers one is written instead
    collapsed: Sequence[Window],
) -> None:
    """Write the patches of a grid as families and boundary conditions, and its collapsed faces as degenerate ones."""
    for patch in grid.patches:
        name = add_family(base, patch.name, patch.kind)
        # ADflow reads the names of families only if conditions state their own types
        bc_type = "FamilySpecified" if _TYPE_OF_KIND[patch.kind] == "UserDefined" else _TYPE_OF_KIND[patch.kind]
        for window in patch.windows:
            condition = _add_condition(zones[window.block], bc_type, window)
            add_node(condition, "FamilyName", "FamilyName_t", name)
    declared = [window for patch in grid.patches for window in patch.windows]
    for window in collapsed:
        if not any(window.overlaps(other) for other in declared):
            nodes = grid.blocks[window.block].nodes[window.slices]
            _add_condition(zones[window.block], _degenerate_type(nodes), window)


def add_family(base: h5py.Group, name: str, kind: str) -> str:
    """Write the family of a patch with its kind; return its name in the file."""
    name, original = free_name(base, name), name
    family = add_node(base, name, "Family_t")
    if name != original:
        add_node(family, ORIGINAL_NAME, "Descriptor_t", original)
    is_misleading = kind == "other" != kind_of_name(name)
    add_node(family, "FamilyBC", "FamilyBC_t", _NO_KIND if is_misleading else _TYPE_OF_KIND[kind])
    if kind == "overset":
        add_node(family, BC_OVERSET, "UserDefinedData_t")
    return name


def _degenerate_type(nodes: np.ndarray) -> str:
    """Type of the condition on a collapsed face, from its nodes, shape (ni, nj, nk, 3)."""
    sizes = [np.linalg.norm(np.ptp(nodes, axis=d), axis=-1).max() for d in range(3) if nodes.shape[d] > 1]
    return "BCDegeneratePoint" if max(sizes) <= POINT_SIZE * np.abs(nodes).max() else "BCDegenerateLine"


def _add_condition(zone: h5py.Group, bc_type: str, window: Window) -> h5py.Group:
    """Write a boundary condition on a window of a face."""
    zone_bc = zone["ZoneBC"] if "ZoneBC" in zone else add_node(zone, "ZoneBC", "ZoneBC_t")
    condition = add_node(zone_bc, f"BC{len(children(zone_bc, 'BC_t')) + 1}", "BC_t", bc_type)
    n_dimensions = zone[" data"].shape[1]
    ends = np.array([window.lo, window.hi], np.int32)[:, :n_dimensions] + 1
    add_node(condition, "PointRange", "IndexRange_t", ends)
    return condition
