"""Overlaps of CGNS zones: overset connections (``GridConnectivity_t`` of type ``Overset``) and ``OversetHoles_t``.

A connection on a range of a face declares it overset, as Cassiopee writes it. A connection on a list of nodes or of
cells names interpolated ones, and holes name removed ones, as SUmb and others write the result of their hole cutting.
These are the blanking of the zone, as in PLOT3D: 0 in holes, the negative of the donor's number where values are
interpolated, and 1 elsewhere. Cells blank a node if all cells around it are blanked.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import h5py
import numpy as np

from ..topology.grid import Patch
from ..topology.index_space import Window
from .cgns_connections import connections_of, donor_of
from .cgns_faces import face_window
from .cgns_nodes import children, first_child, value, word

__all__ = ["OVERSET_TYPE", "blanking_of", "is_overset", "with_overset_patches"]

OVERSET_TYPE = "Overset"
"""Type of the connections of overlapping zones."""

HOLES = "OversetHoles_t"
"""Label of holes of a zone."""

NAME = "overset"
"""Name of the patch of overset connections."""

CELLS = "CellCenter"
"""Location of points that are cells."""


def is_overset(connection: h5py.Group) -> bool:
    """Whether a connection (``GridConnectivity_t``) is between overlapping zones."""
    kind = first_child(connection, "GridConnectivityType_t")
    return kind is not None and word(kind) == OVERSET_TYPE


def with_overset_patches(
    patches: Sequence[Patch],
    zones: Sequence[h5py.Group],  # the zones in block order
    names: Sequence[str],  # their names, ``base/zone`` if there is more than one base
    shapes: Sequence[tuple[int, ...]],  # node counts of the blocks
) -> tuple[tuple[Patch, ...], tuple[str, ...]]:
    """Add a patch of the declared overset faces that no patch covers; report what could not be used."""
    covered = [window for patch in patches for window in patch.windows]
    found: list[Window] = []
    ignored: list[str] = []
    for block, zone in enumerate(zones):
        for name, node in _overset_connections(zone):
            window = _face_of(node, block, shapes[block])
            if window is not None:
                found += [] if any(window.overlaps(other) for other in (*covered, *found)) else [window]
            elif donor_of(node, names, block) is None:
                ignored.append(
                    f"{zone.name}: overset connection '{name}' is no rectangle of a face, and its donor "
                    f"'{word(node)[:32]}' is no zone; its points are not taken for interpolated ones"
                )
    taken, name = {patch.name for patch in patches}, NAME
    while name in taken:
        name += "_declared"
    return (*patches, *([Patch(name, "overset", tuple(found))] if found else [])), tuple(ignored)


def blanking_of(
    zone: h5py.Group,
    names: Sequence[str],  # names of all zones
    block: int,  # number of this one
    shape: tuple[int, ...],  # its node counts
) -> np.ndarray | None:
    """Blanking of the nodes of a zone, shape (ni, nj, nk), by its holes and connections; None if it has none."""
    n_axes = zone[" data"].shape[1]
    on_nodes = np.ones(shape, dtype=np.int32)
    in_cells = np.ones([n - 1 for n in shape[:n_axes]] + [1] * (3 - n_axes), dtype=np.int32)
    parts = [(node, 0) for _, node in connections_of(zone, HOLES)]
    for _, node in _overset_connections(zone):
        donor = donor_of(node, names, block)
        if donor is not None and _face_of(node, block, shape) is None:
            parts.append((node, -1 - donor))
    for node, blank in parts:
        array = in_cells if _location(node) == CELLS else on_nodes
        for window in (node for _, node in children(node, "IndexRange_t")):
            low, high = np.sort(value(window).reshape(2, -1).astype(np.int64), axis=0)
            array[tuple(slice(max(a - 1, 0), b) for a, b in zip(low, high))] = blank
        listed = dict(children(node, "IndexArray_t")).get("PointList")
        if listed is not None:
            rows = np.atleast_2d(value(listed)).astype(np.int64) - 1
            is_inside = ((rows >= 0) & (rows < array.shape[:n_axes])).all(axis=1)
            array[tuple(rows[is_inside].T)] = blank
    return np.minimum(on_nodes, _by_cells(in_cells, shape)) if parts else None


def _by_cells(cells: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Blanking of nodes by cells: 1 if a cell around it is in use, else the smallest of the cells' values."""
    least, most = np.full(shape, 1, dtype=np.int32), np.full(shape, np.iinfo(np.int32).min, dtype=np.int32)
    steps = [(0, 1) if n > m else (0,) for n, m in zip(shape, cells.shape)]
    for corner in product(*steps):
        around = tuple(slice(step, step + n) for step, n in zip(corner, cells.shape))
        np.minimum(least[around], cells, out=least[around])
        np.maximum(most[around], cells, out=most[around])
    return np.where(most == 1, 1, least)


def _overset_connections(zone: h5py.Group) -> list[tuple[str, h5py.Group]]:
    """Name and node of the overset connections of a zone."""
    return [(name, node) for name, node in connections_of(zone, "GridConnectivity_t") if is_overset(node)]


def _location(node: h5py.Group) -> str:
    """Location of the points of a connection: nodes by default."""
    location = first_child(node, "GridLocation_t")
    return "" if location is None else word(location)


def _face_of(node: h5py.Group, block: int, shape: tuple[int, ...]) -> Window | None:
    """Window of a face that a connection covers, by its nodes or the centres of its faces; None for others."""
    return None if _location(node) == CELLS else face_window(block, shape, node)
