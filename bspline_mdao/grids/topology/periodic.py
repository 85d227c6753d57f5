"""Pairs of boundary windows that a rotation or a translation maps onto each other: probably periodic planes.

Both sides of a periodic pair face each other: what leaves the grid through one enters through the other. Walls that
repeat, such as the walls of two blades, face the same way and are not a pair.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from ...base.numerics.vectors import lengths
from .faces import inward_directions
from .grid import Grid
from .index_space import Window, face_layers
from .periodic_pair import SMALLEST, Motion, PeriodicPair
from .rotation_fit import CLOSE, congruent_triangles, fit_rotation
from .shell import Shell

__all__ = ["find_periodic", "periodic_pairs"]

PLANAR = 1e-6
"""A window is planar if its nodes leave the plane by less than this fraction of the grid's size."""

SMOOTH = 0.7
"""Windows that meet are one surface if the product of their mean inward directions exceeds this."""

MOST_CORNERS, MOST_TRIED, MOST_OUTER = 1_000, 64, 24
"""Largest number of corners of windows to search for pairs, of motions to try, the most frequent first, and of corners
of a surface of several windows."""


def find_periodic(
    grid: Grid,  # the grid
    windows: Sequence[Window],  # windows of its boundary to search for pairs
) -> tuple[PeriodicPair, ...]:  # each window is in at most one of them
    """Find windows whose nodes a rotation about any axis, or a translation, maps onto the nodes of others."""
    return periodic_pairs([block.nodes for block in grid.blocks], windows, grid.length_unit)


def periodic_pairs(
    blocks: Sequence[np.ndarray | Shell],  # nodes of the blocks, or those on their faces (m)
    windows: Sequence[Window],  # windows of the boundary to search for pairs
    unit: str,  # unit of lengths
) -> tuple[PeriodicPair, ...]:  # each window is in at most one of them
    """See `find_periodic`."""
    # The two sides need not be cut into windows in the same way. Planar windows only count for rotations by other than
    # right angles: the sides of many boxes can be mapped onto each other as well. By a motion found from other windows
    # they repeat all the same. Windows of blocks one node deep have no cells behind them, and no inward direction.
    windows = [window for window in windows if blocks[window.block].shape[window.shape.index(1)] > 1]
    if len(windows) < 2 or 4 * len(windows) > MOST_CORNERS:
        return ()
    outline = [_face(blocks[window.block], window).reshape(-1, 3) for window in windows]
    middle = np.mean([nodes.mean(axis=0) for nodes in outline], axis=0)
    size = 2.0 * max(float(lengths(nodes - middle).max()) for nodes in outline)
    sides = [_Side.of(blocks[window.block], window, size) for window in windows]
    pairs, left = [], {n for n, side in enumerate(sides) if side.normal is None or _bounds(side, outline, size)}
    kept = [sides[n] for n in sorted(left)]
    everywhere = cKDTree(np.concatenate([np.zeros((0, 3)), *(side.nodes for side in kept)]))
    for motion in [*_rotations(kept, size), *_translations(kept, size)]:
        candidates = [n for n in sorted(left) if sides[n].may_repeat(motion)]
        if not candidates:
            continue
        there, back = (_laid(sides, candidates, m, size, everywhere) for m in (motion, motion.inverse()))
        if there and back and not there & back:
            first, second = (tuple(windows[n] for n in sorted(part)) for part in (there, back))
            nodes, others = (np.concatenate([sides[n].nodes for n in sorted(part)]) for part in (there, back))
            refined = replace(_refined(motion, nodes, others, size), unit=unit)
            pairs.append(PeriodicPair(first, second, refined))
            left -= there | back
    return tuple(_with_planar(pair, pairs, windows, sides, size) for pair in pairs)


def _with_planar(
    pair: PeriodicPair, pairs: Sequence[PeriodicPair], windows: list[Window], sides: list[_Side], size: float
) -> PeriodicPair:
    """Add windows that do not count for a motion on their own, such as planes ahead of a blade, but repeat by this."""
    taken = {window for other in pairs for window in (*other.windows, *other.others)}
    rest = [n for n, window in enumerate(windows) if window not in taken]
    if not rest:
        return pair
    everywhere = cKDTree(np.concatenate([sides[n].nodes for n in rest]))
    there, back = (_laid(sides, rest, m, size, everywhere) for m in (pair.motion, pair.motion.inverse()))
    if not (there and back) or there & back:
        return pair
    more = ([window for n, window in enumerate(windows) if n in part] for part in (there, back))
    first, second = (
        tuple(sorted({*side, *others}, key=windows.index)) for side, others in zip((pair.windows, pair.others), more)
    )
    return replace(pair, windows=first, others=second)


@dataclass(frozen=True, eq=False)
class _Side:
    """Nodes of a window, the directions from there into its block, its corners, and its normal if it is planar."""

    nodes: np.ndarray
    inwards: np.ndarray
    corners: np.ndarray
    normal: np.ndarray | None

    @classmethod
    def of(cls, block: np.ndarray | Shell, window: Window, size: float) -> _Side:
        """Take the nodes of a window of a block."""
        face, inwards = _face(block, window), inward_directions(block, window)
        corners = face[[0, 0, -1, -1], [0, -1, 0, -1]]
        off = face.reshape(-1, 3) - face.mean(axis=(0, 1))
        normal = np.linalg.eigh(off.T @ off)[1][:, 0]
        is_planar = np.abs(off @ normal).max() <= PLANAR * size
        return cls(face.reshape(-1, 3), inwards.reshape(-1, 3), corners, normal if is_planar else None)

    def may_repeat(self, motion: Motion) -> bool:
        """Whether a motion may map it onto a partner: planes at right angles, and parallel ones, are sides of boxes."""
        if self.normal is None:
            return True
        cosine = abs(float(motion.turn(self.normal[None])[0] @ self.normal))
        return not motion.is_of_box and SMALLEST < cosine < 1.0 - 0.5 * SMALLEST**2


def _face(block: np.ndarray | Shell, window: Window) -> np.ndarray:
    """Nodes of a face window of a block, shape (n, m, 3)."""
    return (block.layers(window) if isinstance(block, Shell) else face_layers(block, window))[0]


def _bounds(side: _Side, nodes: list[np.ndarray], size: float) -> bool:
    """Whether all nodes of the boundary are on one side of a planar window, as in the wedge between two of them."""
    heights = np.concatenate(nodes) @ side.normal - side.nodes.mean(axis=0) @ side.normal
    return bool(min(heights.max(), -heights.min()) <= CLOSE * size)


def _refined(motion: Motion, nodes: np.ndarray, others: np.ndarray, size: float) -> Motion:
    """The rotation from all nodes of a side, shape (n, 3), rather than from its corners."""
    if motion.is_translation:
        return motion
    met = cKDTree(others).query(motion.move(nodes))[1]
    refined = _rotation(nodes, others[met], size)
    if refined is None:
        return motion
    return refined if np.dot(refined.axis, motion.axis) * refined.angle * motion.angle > 0.0 else refined.inverse()


def _rotations(sides: list[_Side], size: float) -> list[Motion]:
    """Rotations that map three corners of a side onto corners, the most frequent ones first."""
    corners = np.concatenate([np.zeros((0, 3)), *(side.corners for side in sides)])
    _, first = np.unique(np.round(corners / (CLOSE * size)), axis=0, return_index=True)
    corners = corners[np.sort(first)]
    apart = cdist(corners, corners)
    found: dict[tuple[float, ...], list[Motion]] = {}
    for side, triangle in _triangles(sides, size):
        for laid in congruent_triangles(corners, apart, triangle, CLOSE * size):
            motion = _rotation(triangle, laid, size)
            if motion and side.may_repeat(motion):
                values = (*motion.axis, motion.angle, *(np.asarray(motion.point) / size))
                found.setdefault(tuple(np.round(values, 3).tolist()), []).append(motion)
    frequent = sorted(found.values(), key=len, reverse=True)
    return [motions[0] for motions in frequent[:MOST_TRIED]]


def _triangles(sides: list[_Side], size: float) -> Iterator[tuple[_Side, np.ndarray]]:
    """Yield sides, each with the largest triangle, shape (3, 3), of its corners, or of the whole surface's."""
    outlines = [(side, side.corners) for side in sides] + list(_joined(sides, CLOSE * size))
    for side, corners in outlines:
        threes = corners[list(combinations(range(len(corners)), 3))]
        areas = lengths(np.cross(threes[:, 1] - threes[:, 0], threes[:, 2] - threes[:, 0]))
        if areas.max() > (SMALLEST * size) ** 2:
            yield side, threes[np.argmax(areas)]


def _joined(sides: list[_Side], near: float) -> Iterator[tuple[_Side, np.ndarray]]:
    """Yield one of the sides that together form a surface, and corners of the whole; of a single side, its own."""
    corners = np.concatenate([np.zeros((0, 3)), *(side.corners for side in sides)])
    owner = np.repeat(np.arange(len(sides)), 4)
    inwards = np.reshape([side.inwards.mean(axis=0) for side in sides], (-1, 3))
    meets = cdist(corners, corners) <= near
    shared = np.zeros((len(sides), len(sides)), dtype=int)
    np.add.at(shared, (owner[:, None], owner[None, :]), meets)
    n_parts, parts = connected_components((shared >= 2) & (inwards @ inwards.T > SMOOTH), directed=False)
    for part in range(n_parts):
        members = np.flatnonzero(parts == part)
        ids = np.flatnonzero(np.isin(owner, members))
        outer = ids[meets[np.ix_(ids, ids)].sum(axis=1) == 1]
        if len(members) > 1 and 3 <= len(outer) <= MOST_OUTER:
            yield sides[members[0]], corners[outer]


def _rotation(points: np.ndarray, laid: np.ndarray, size: float) -> Motion | None:
    """Forward rotation that best maps points, shape (n, 3), onto others, or back; None for a half turn or a screw."""
    motion = fit_rotation(points, laid, size)
    if motion is None or abs(motion.angle) >= np.pi - SMALLEST:
        return None
    return motion if motion.is_ahead else motion.inverse()


def _translations(sides: list[_Side], size: float) -> list[Motion]:
    """Translations that map corners onto corners of windows that are not planar."""
    curved = [side.corners for side in sides if side.normal is None]
    if len(curved) < 2:
        return []
    shifts = np.concatenate([(b[None] - a[:, None]).reshape(-1, 3) for a, b in combinations(curved, 2)])
    shifts = shifts[np.abs(shifts).max(axis=1) > SMALLEST * size]
    first = np.argmax(np.abs(shifts) > SMALLEST * size, axis=1)
    shifts *= np.sign(shifts[np.arange(len(shifts)), first])[:, None]
    return [Motion(shift=tuple(shift.tolist())) for shift in _frequent(shifts, CLOSE * size)]


def _frequent(values: np.ndarray, tolerance: float) -> np.ndarray:
    """Values, shape (m, n), that occur more than once among values of shape (l, n), the most frequent first."""
    if not len(values):
        return values
    _, first, counts = np.unique(np.round(values / (10.0 * tolerance)), axis=0, return_index=True, return_counts=True)
    order = np.argsort(-counts, kind="stable")[:MOST_TRIED]
    return values[first[order[counts[order] > 1]]]


def _laid(sides: list[_Side], candidates: list[int], motion: Motion, size: float, everywhere: cKDTree) -> set[int]:
    """Sides whose nodes the motion all maps onto nodes of others that face them."""
    # First, in one go, select sides whose corners it maps onto any of the nodes: few of the tried motions map any.
    corners = motion.move(np.concatenate([sides[n].corners for n in candidates]))
    is_near = np.isfinite(everywhere.query(corners, distance_upper_bound=CLOSE * size)[0]).reshape(-1, 4).all(axis=1)
    if not is_near.any():
        return set()
    nodes, inwards = (np.concatenate([getattr(sides[n], name) for n in candidates]) for name in ("nodes", "inwards"))
    owner = np.repeat(np.arange(len(candidates)), [len(sides[n].nodes) for n in candidates])
    tree = cKDTree(nodes)
    found = set()
    for place, n in enumerate(candidates):
        if not is_near[place]:
            continue
        distance, met = tree.query(motion.move(sides[n].nodes), distance_upper_bound=CLOSE * size)
        if np.isinf(distance).any() or (owner[met] == place).mean() > 0.5:
            continue
        facing = np.sum(motion.turn(sides[n].inwards) * inwards[met], axis=1)
        if np.median(facing) < 0.0:
            found.add(n)
    return found
