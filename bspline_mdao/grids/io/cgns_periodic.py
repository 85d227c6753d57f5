"""Periodic connections of CGNS zones: ``Periodic_t`` in a ``GridConnectivityProperty_t``.

It maps the nodes of this side to the nodes of the donor: a rotation about ``RotationCenter`` by ``RotationAngle`` about
x, then y, then z, and a ``Translation`` (SIDS, section 8.5.1). Programs differ in the direction, and in the unit of
angles if they state none, so the nodes decide: a motion is valid if it maps the nodes of one side onto the other's.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import h5py
import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ..topology.grid import Patch
from ..topology.index_space import Window
from ..topology.periodic_pair import Motion, PeriodicPair
from ..topology.rotation_fit import CLOSE
from .cgns_connections import ONE_TO_ONE, connections_of, donor_of, periodic_of, range_window
from .cgns_nodes import children, first_child, value, word

__all__ = ["read_periodic", "with_periodic_patches"]

MATCHING = "Abutting1to1"
"""Type of the connections (``GridConnectivity_t``) whose nodes match the donor's one to one."""


@dataclass(frozen=True)
class _Side:
    """A connection whose motion maps the nodes of one window onto another's, in the forward order.

    Both zones have each connection, in both directions, so the order makes each pair of windows unique.
    """

    window: Window
    other: Window
    motion: Motion
    nodes: np.ndarray  # (n, 3), nodes of the window (m)
    size: float  # size of both windows (m)

    def moves_as(self, other: _Side) -> bool:
        """Whether it is a part of the same pair of sides."""
        apart = self.motion.move(self.nodes) - other.motion.move(self.nodes)
        return float(np.abs(apart).max()) <= 2.0 * CLOSE * max(self.size, other.size)


def read_periodic(
    zones: Sequence[h5py.Group],  # the zones in block order
    names: Sequence[str],  # their names, ``base/zone`` if there is more than one base
    shapes: Sequence[tuple[int, ...]],  # node counts of the blocks
    nodes_at: Callable[[Window], np.ndarray],  # reads the nodes of a window, shape (..., 3)
    unit: str,  # unit of lengths
) -> tuple[tuple[PeriodicPair, ...], tuple[str, ...]]:
    """Read the sides that zones declare as periodic, one pair for each motion, and what could not be understood."""
    sides: dict[tuple[Window, Window], _Side] = {}
    ignored: list[str] = []
    for block, zone in enumerate(zones):
        for name, node in _periodic_connections(zone):
            found = _side(node, block, names, shapes, nodes_at)
            if isinstance(found, str):
                ignored.append(
                    f"{zone.name}: periodic connection '{name}' to '{word(node)[:32]}' {found}; whether its faces are "
                    f"periodic is guessed"
                )
            elif (found.other, found.window) not in sides:  # half a turn is its own inverse
                sides[found.window, found.other] = found
    groups: list[list[_Side]] = []
    for side in sides.values():
        alike = next((group for group in groups if group[0].moves_as(side)), None)
        groups += [] if alike is not None else [[]]
        (groups[-1] if alike is None else alike).append(side)
    pairs = (
        PeriodicPair(
            tuple(side.window for side in group),
            tuple(side.other for side in group),
            replace(group[0].motion, unit=unit or "m"),
        )
        for group in groups
    )
    return tuple(pairs), tuple(ignored)


def with_periodic_patches(patches: Sequence[Patch], pairs: Sequence[PeriodicPair]) -> tuple[Patch, ...]:
    """Add patches of kind other, ``periodic_1a`` and the like, on periodic sides that no patch covers."""
    taken, windows = {patch.name for patch in patches}, [window for patch in patches for window in patch.windows]
    added = []
    for number, pair in enumerate(pairs, start=1):
        for letter, side in zip("ab", (pair.windows, pair.others)):
            bare = tuple(window for window in side if not any(window.overlaps(other) for other in windows))
            name = f"periodic_{number}{letter}"
            while name in taken:
                name += "_declared"
            added += [Patch(name, "other", bare)] if bare else []
    return (*patches, *added)


def _periodic_connections(zone: h5py.Group) -> Iterator[tuple[str, h5py.Group]]:
    """Yield name and node of the connections of a zone that are declared periodic."""
    for label in (ONE_TO_ONE, "GridConnectivity_t"):
        yield from (item for item in connections_of(zone, label) if periodic_of(item[1]) is not None)


def _side(
    node: h5py.Group,
    block: int,
    names: Sequence[str],
    shapes: Sequence[tuple[int, ...]],
    nodes_at: Callable[[Window], np.ndarray],
) -> _Side | str:
    """Read a periodic connection of a block; or say why it cannot be used."""
    kind = first_child(node, "GridConnectivityType_t")
    if kind is not None and word(kind) != MATCHING:
        return f"is of type {word(kind)}, not {MATCHING}"
    donor, lists = donor_of(node, names, block), dict(children(node, "IndexRange_t") + children(node, "IndexArray_t"))
    a = _window_of(lists, "", block, shapes)
    b = None if donor is None else _window_of(lists, "Donor", donor, shapes)
    if a is None or b is None:
        return "does not fit the zones"
    nodes, others = (nodes_at(window).reshape(-1, 3) for window in (a, b))
    size = float(np.linalg.norm(np.ptp(np.concatenate([nodes, others]), axis=0)))
    declared = periodic_of(node)
    assert declared is not None
    tree = cKDTree(others)
    for motion in _candidates(declared, CLOSE * size):
        distance, met = tree.query(motion.move(nodes))
        if distance.max() > CLOSE * size:
            continue
        if motion.is_translation:  # arrays of single precision are then as exact as their nodes
            motion = Motion(shift=tuple((others[met] - nodes).mean(axis=0).tolist()))
        return _Side(a, b, motion, nodes, size) if motion.is_ahead else _Side(b, a, motion.inverse(), others, size)
    return "has a rotation or translation that does not map its nodes onto the donor's"


def _window_of(lists: dict[str, h5py.Group], side: str, block: int, shapes: Sequence[tuple[int, ...]]) -> Window | None:
    """Window of this side of a connection, or of its donor: a range of nodes, or the span of a list of nodes."""
    points = lists.get(f"PointRange{side}", lists.get(f"PointList{side}"))
    if points is None:
        return None
    indices = np.atleast_2d(value(points))
    return range_window(block, np.array([indices.min(axis=0), indices.max(axis=0)]), shapes[block])


def _candidates(declared: h5py.Group, near: float) -> Iterator[Motion]:
    """Yield the possible motions of a node, starting with the standard reading."""
    arrays = dict(children(declared, "DataArray_t"))
    center, angles, shift = (
        np.asarray(value(arrays[name]), dtype=float).ravel()[:3] if name in arrays else np.zeros(3)
        for name in ("RotationCenter", "RotationAngle", "Translation")
    )
    center, angles, shift = (np.append(each, np.zeros(3 - len(each))) for each in (center, angles, shift))
    units = first_child(arrays["RotationAngle"], "DimensionalUnits_t") if "RotationAngle" in arrays else None
    stated = "" if units is None else value(units).tobytes()[128:].decode("ascii", "replace").strip("\0 ").lower()
    known = {"radian": (1.0,), "degree": (np.pi / 180.0,)}.get(stated, (1.0, np.pi / 180.0))
    if not angles.any() and shift.any():
        yield from (Motion(shift=tuple((sign * shift).tolist())) for sign in (1.0, -1.0))
    for sign, scale in product((1.0, -1.0), known):
        rotation = Rotation.from_euler("xyz", sign * scale * angles)
        vector = rotation.as_rotvec()
        angle = float(np.linalg.norm(vector))
        total = center - rotation.apply(center) + sign * shift
        motion = Motion.about(vector / angle, angle, total, near) if angle else None
        if motion is not None:
            yield motion
