"""Connections of CGNS zones: the zones that they name, and one-to-one connections.

A ``GridConnectivity1to1_t`` names the donor zone, the range of nodes on this side (``PointRange``), the range that it
meets there (``PointRangeDonor``) and the ``Transform``: direction d here is along direction ``|T[d]|`` of the donor,
backwards if ``T[d]`` is negative (SIDS, section 8.2). Each connection is stored in both zones.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence

import h5py
import numpy as np

from ..topology.index_space import Interface, Orientation, Window
from .cgns_nodes import add_node, children, first_child, free_name, value, word

__all__ = [
    "ONE_TO_ONE",
    "PERIODIC_TYPE",
    "add_connections",
    "connections_of",
    "donor_of",
    "periodic_of",
    "range_window",
    "read_connections",
]

PERIODIC_TYPE = "Periodic"
"""Labels of connections with a ``Periodic_t``, besides their types."""

ONE_TO_ONE = "GridConnectivity1to1_t"
"""Label of one-to-one connections."""

_TRANSFORM = '"int[IndexDimension]"'


def read_connections(
    zones: Sequence[h5py.Group],  # the zones in block order
    names: Sequence[str],  # their names, ``base/zone`` if there is more than one base
    shapes: Sequence[tuple[int, ...]],  # node counts of the blocks
) -> tuple[tuple[Interface, ...], tuple[str, ...]]:
    """Read the one-to-one connections of all zones that are not periodic."""
    # Returns connections: each once, from the zone that comes first; ignored: what could not be understood, and
    # why.
    found: dict[Interface, None] = {}
    ignored: list[str] = []
    for block, zone in enumerate(zones):
        for name, node in connections_of(zone, ONE_TO_ONE):
            if periodic_of(node) is not None:
                continue
            donor = donor_of(node, names, block)
            connection = None if donor is None else _parse(node, block, donor, shapes)
            if connection is None:
                ignored.append(
                    f"{zone.name}: connection '{name}' to '{word(node)[:32]}' does not fit the zones; it was left out"
                )
            elif connection.reverse() not in found:
                found[connection] = None
    return tuple(found), tuple(ignored)


def connections_of(zone: h5py.Group, label: str) -> list[tuple[str, h5py.Group]]:
    """Name and node of the connections, or holes, of a zone with a label."""
    return [item for _, group in children(zone, "ZoneGridConnectivity_t") for item in children(group, label)]


def periodic_of(node: h5py.Group) -> h5py.Group | None:
    """Motion by which a connection is declared periodic; None for others."""
    declared = first_child(node, "GridConnectivityProperty_t")
    return None if declared is None else first_child(declared, "Periodic_t")


def donor_of(node: h5py.Group, names: Sequence[str], block: int) -> int | None:
    """Block that a connection of a block names as its donor; None if there is no such zone."""
    base, blocks = names[block][: names[block].rfind("/") + 1], {name: number for number, name in enumerate(names)}
    return blocks.get(base + word(node), blocks.get(word(node)))


def _parse(node: h5py.Group, block: int, donor: int, shapes: Sequence[tuple[int, ...]]) -> Interface | None:
    """Connection of a node; None if it does not fit the blocks."""
    ranges = dict(children(node, "IndexRange_t"))
    if not {"PointRange", "PointRangeDonor"} <= ranges.keys():
        return None
    a, b = (
        range_window(number, value(ranges[name]), shapes[number])
        for number, name in ((block, "PointRange"), (donor, "PointRangeDonor"))
    )
    transform = np.append(value(node["Transform"]).ravel() if "Transform" in node else [1, 2, 3], [3])[:3].astype(int)
    if a is None or b is None or sorted(np.abs(transform)) != [1, 2, 3]:
        return None
    orientation = Orientation(tuple(int(abs(t)) - 1 for t in transform), tuple(bool(t < 0) for t in transform))
    is_fitting = all(a.shape[d] == b.shape[p] for d, p in enumerate(orientation.perm))
    return Interface(a, b, orientation) if is_fitting else None


def range_window(block: int, ends: np.ndarray, shape: tuple[int, ...]) -> Window | None:
    """Window on a face of a block from the ends of a range, of which the second may be the lower."""
    ends = np.sort(np.asarray(ends).reshape(2, -1), axis=0) - 1
    lo, hi = (tuple(int(n) for n in end) + (0,) * (3 - len(end)) for end in ends)
    window = Window(block, lo, hi)
    return window if window.is_on_face(shape) else None


def add_connections(
    zones: Sequence[h5py.Group],  # the zone of every block
    interfaces: Sequence[Interface],  # the interfaces; both sides may lie in one block
) -> None:
    """Write interfaces into the zones on both sides."""
    sides = [side for interface in interfaces for side in (interface, interface.reverse())]
    for number, side in enumerate(sides, start=1):
        zone, donor = zones[side.a.block], zones[side.b.block]
        group = first_child(zone, "ZoneGridConnectivity_t")
        if group is None:
            group = add_node(zone, free_name(zone, "ZoneGridConnectivity"), "ZoneGridConnectivity_t")
        name = free_name(group, f"Interface{number}")
        node = add_node(group, name, ONE_TO_ONE, donor.name.rpartition("/")[2])
        _add_ranges(node, side, n_dimensions=zone[" data"].shape[1])


def _add_ranges(node: h5py.Group, side: Interface, n_dimensions: int) -> None:
    """Write the ranges of a connection, from the lowest node of this side, and the transform."""
    begin, end = [0, 0, 0], [0, 0, 0]
    for p, flip in zip(side.orientation.perm, side.orientation.flip):
        begin[p], end[p] = (side.b.hi[p], side.b.lo[p]) if flip else (side.b.lo[p], side.b.hi[p])
    transform = [-(p + 1) if flip else p + 1 for p, flip in zip(side.orientation.perm, side.orientation.flip)]
    for name, ends in (("PointRange", (side.a.lo, side.a.hi)), ("PointRangeDonor", (begin, end))):
        add_node(node, name, "IndexRange_t", np.array(ends, np.int32)[:, :n_dimensions] + 1)
    add_node(node, "Transform", _TRANSFORM, np.array(transform[:n_dimensions], np.int32))
