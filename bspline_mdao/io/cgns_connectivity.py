"""One-to-one connectivity between CGNS zones: what a file declares, and what is written for the interfaces of a grid.

A ``GridConnectivity1to1_t`` names the donor zone, the range of nodes on this side (``PointRange``), the range that it
meets there (``PointRangeDonor``) and the ``Transform``: direction d here runs along direction ``|T[d]|`` of the donor,
backwards where ``T[d]`` is negative (SIDS, section 8.2). Each connection stands in both zones.
"""

from __future__ import annotations

from collections.abc import Sequence

import h5py
import numpy as np

from ..topology.index_space import Interface, Orientation, Window
from .cgns_nodes import add_node, children, first_child, free_name, value, word

__all__ = ["add_connections", "read_connections"]

_TRANSFORM = '"int[IndexDimension]"'


def read_connections(
    zones: Sequence[h5py.Group], names: Sequence[str], shapes: Sequence[tuple[int, int, int]]
) -> tuple[tuple[Interface, ...], tuple[str, ...]]:
    """Read the one-to-one connections of all zones, those that are not periodic.

    Parameters
    ----------
    zones : sequence of h5py.Group
        The zones in block order.
    names : sequence of str
        Their names, ``base/zone`` where there is more than one base.
    shapes : sequence of (int, int, int)
        Node counts of the blocks.

    Returns
    -------
    connections : tuple of Interface
        Each once, as the zone that comes first has it.
    ignored : tuple of str
        What could not be understood, and why.
    """
    blocks = {name: block for block, name in enumerate(names)}
    found, ignored = {}, []
    for block, zone in enumerate(zones):
        base = names[block][: names[block].rfind("/") + 1]
        for name, node in _connections(zone):
            donor = blocks.get(base + word(node), blocks.get(word(node)))
            connection = None if donor is None else _parse(node, block, donor, shapes)
            if connection is None:
                ignored.append(
                    f"{zone.name}: connection '{name}' to '{word(node)[:32]}' does not fit the zones; it was left out"
                )
            elif connection.reverse() not in found:
                found[connection] = None
    return tuple(found), tuple(ignored)


def _connections(zone: h5py.Group) -> list[tuple[str, h5py.Group]]:
    """Name and node of the connections of a zone that are not periodic."""
    everything = [
        item
        for _, group in children(zone, "ZoneGridConnectivity_t")
        for item in children(group, "GridConnectivity1to1_t")
    ]
    return [(name, node) for name, node in everything if not _is_periodic(node)]


def _is_periodic(node: h5py.Group) -> bool:
    property_ = first_child(node, "GridConnectivityProperty_t")
    return property_ is not None and first_child(property_, "Periodic_t") is not None


def _parse(node: h5py.Group, block: int, donor: int, shapes) -> Interface | None:
    """Connection of a node; None where it does not fit the blocks."""
    ranges = dict(children(node, "IndexRange_t"))
    if not {"PointRange", "PointRangeDonor"} <= ranges.keys():
        return None
    a, b = (
        _window(number, value(ranges[name]), shapes[number])
        for number, name in ((block, "PointRange"), (donor, "PointRangeDonor"))
    )
    transform = np.append(value(node["Transform"]).ravel() if "Transform" in node else [1, 2, 3], [3])[:3].astype(int)
    if a is None or b is None or sorted(np.abs(transform)) != [1, 2, 3]:
        return None
    orientation = Orientation(tuple(int(abs(t)) - 1 for t in transform), tuple(bool(t < 0) for t in transform))
    is_fitting = all(a.shape[d] == b.shape[p] for d, p in enumerate(orientation.perm))
    return Interface(a, b, orientation) if is_fitting else None


def _window(block: int, ends: np.ndarray, shape) -> Window | None:
    """Window on a face of a block from the ends of a range, which may run backwards."""
    ends = np.sort(np.asarray(ends).reshape(2, -1), axis=0) - 1
    lo, hi = (tuple(int(n) for n in end) + (0,) * (3 - len(end)) for end in ends)
    window = Window(block, lo, hi)
    return window if window.is_on_face(shape) else None


def add_connections(zones: Sequence[h5py.Group], interfaces: Sequence[Interface]) -> None:
    """Write interfaces into the zones on both of their sides.

    Parameters
    ----------
    zones : sequence of h5py.Group
        The zone of every block.
    interfaces : sequence of Interface
        The interfaces; both sides may lie in one block.
    """
    sides = [side for interface in interfaces for side in (interface, interface.reverse())]
    for number, side in enumerate(sides, start=1):
        zone, donor = zones[side.a.block], zones[side.b.block]
        group = first_child(zone, "ZoneGridConnectivity_t")
        if group is None:
            group = add_node(zone, free_name(zone, "ZoneGridConnectivity"), "ZoneGridConnectivity_t")
        name = free_name(group, f"Interface{number}")
        node = add_node(group, name, "GridConnectivity1to1_t", donor.name.rpartition("/")[2])
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
