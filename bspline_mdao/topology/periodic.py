"""Pairs of boundary windows that a rotation or a translation lays onto each other: periodic planes, probably.

Both sides of a periodic pair look at each other: what leaves the grid through the one comes back through the other.
Walls that repeat, such as those of two blades, look the same way and are no pair.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from .faces import inward_directions
from .grid import Grid
from .index_space import Window, face_layers

__all__ = ["PeriodicPair", "find_periodic"]

CLOSE = 1e-5
"""Nodes of both sides lie on each other when they are closer than this part of the grid's size."""

PLANAR = 1e-6
"""A window is planar when its nodes leave the plane by less than this part of the grid's size."""

SMALLEST = 1e-3
"""Rotations by less than this angle (rad), and translations by less than this part of the grid's size, are none."""

MOST_CORNERS, MOST_TRIED = 1_000, 64
"""Most corners of windows among which pairs are looked for, and motions that are tried, the most frequent first."""


@dataclass(frozen=True)
class Motion:
    """A rotation about a coordinate axis, or a translation.

    Parameters
    ----------
    axis : str
        ``"x"``, ``"y"`` or ``"z"``; ``""`` of a translation.
    angle : float
        Angle of the rotation (rad).
    shift : tuple of float
        The translation (m).
    """

    axis: str = ""
    angle: float = 0.0
    shift: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __str__(self) -> str:
        if self.axis:
            return f"rotation about {self.axis} by {np.degrees(self.angle):.6g} deg"
        return f"translation by ({', '.join(f'{s:.6g}' for s in self.shift)}) m"

    @property
    def is_of_box(self) -> bool:
        """Whether it may lay the planes of a box onto each other: translations, and rotations by right angles."""
        quarters = self.angle / (0.5 * np.pi)
        return abs(quarters - round(quarters)) < SMALLEST

    def inverse(self) -> Motion:
        """Return the motion from the others back to the windows."""
        return Motion(self.axis, -self.angle, tuple(-s for s in self.shift))

    def turn(self, vectors: np.ndarray) -> np.ndarray:
        """Turn vectors, shape (n, 3)."""
        if not self.axis:
            return vectors
        a, b = (d for d in range(3) if d != "xyz".index(self.axis))
        cos, sin, turned = np.cos(self.angle), np.sin(self.angle), vectors.copy()
        turned[:, a], turned[:, b] = (
            cos * vectors[:, a] - sin * vectors[:, b],
            sin * vectors[:, a] + cos * vectors[:, b],
        )
        return turned

    def move(self, points: np.ndarray) -> np.ndarray:
        """Move points, shape (n, 3), in metres."""
        return self.turn(points) + self.shift


@dataclass(frozen=True)
class PeriodicPair:
    """Windows of the boundary that a motion lays onto each other.

    Parameters
    ----------
    windows, others : tuple of Window
        Both sides, in the order of the boundary.
    motion : Motion
        It takes the nodes of the windows to those of the others.
    """

    windows: tuple[Window, ...]
    others: tuple[Window, ...]
    motion: Motion


def find_periodic(grid: Grid, windows: Sequence[Window]) -> tuple[PeriodicPair, ...]:
    """Find windows whose nodes a rotation about a coordinate axis, or a translation, lays onto those of others.

    The two sides need not be cut into windows alike. Planar windows count for rotations other than by right angles
    alone: the sides of many a box are laid onto each other as well.

    Parameters
    ----------
    grid : Grid
        The grid.
    windows : sequence of Window
        Windows of its boundary among which pairs are looked for.

    Returns
    -------
    tuple of PeriodicPair
        Each window is in one of them at most.
    """
    # windows of blocks one node deep have no cells behind them, and no direction inwards
    windows = [window for window in windows if grid.shapes[window.block][window.shape.index(1)] > 1]
    sides = [_Side.of(grid, window) for window in windows]
    size = max((float(np.ptp(side.nodes, axis=0).max()) for side in sides), default=0.0)
    if len(sides) < 2 or 4 * len(sides) > MOST_CORNERS:
        return ()
    pairs, left = [], set(range(len(sides)))
    for motion in [*_rotations(sides, size), *_translations(sides, size)]:
        candidates = [n for n in sorted(left) if not (motion.is_of_box and sides[n].is_planar(size))]
        if not candidates:
            continue
        there, back = (_laid(sides, candidates, m, size) for m in (motion, motion.inverse()))
        if there and back and not there & back:
            first, second = (tuple(windows[n] for n in sorted(part)) for part in (there, back))
            pairs.append(PeriodicPair(first, second, motion))
            left -= there | back
    return tuple(pairs)


@dataclass(frozen=True, eq=False)
class _Side:
    """Nodes of a window, the directions from there into its block, and its corners."""

    nodes: np.ndarray
    inwards: np.ndarray
    corners: np.ndarray

    @classmethod
    def of(cls, grid: Grid, window: Window) -> _Side:
        """Take the nodes of a window of a grid."""
        nodes = grid.blocks[window.block].nodes
        face, inwards = face_layers(nodes, window)[0], inward_directions(nodes, window)
        return cls(face.reshape(-1, 3), inwards.reshape(-1, 3), face[[0, 0, -1, -1], [0, -1, 0, -1]])

    def is_planar(self, size: float) -> bool:
        """Whether all nodes lie in a plane."""
        off = self.nodes - self.nodes.mean(axis=0)
        normal = np.linalg.eigh(off.T @ off)[1][:, 0]
        return bool(np.abs(off @ normal).max() <= PLANAR * size)


def _rotations(sides: list[_Side], size: float) -> list[Motion]:
    """Rotations about coordinate axes that lay corners onto corners."""
    corners = np.concatenate([side.corners for side in sides])
    found = []
    for axis, letter in enumerate("xyz"):
        a, b = np.delete(corners, axis, axis=1).T
        radius = np.hypot(a, b)
        pairs = cKDTree(np.stack([corners[:, axis], radius], axis=1)).query_pairs(CLOSE * size, output_type="ndarray")
        pairs = pairs[radius[pairs].min(axis=1, initial=np.inf) > SMALLEST * size]
        angle = np.arctan2(b, a)
        turns = (np.diff(angle[pairs], axis=1).ravel() + np.pi) % (2.0 * np.pi) - np.pi
        turns = np.abs(turns[np.abs(turns) > SMALLEST])
        found += [Motion(letter, angle=float(turn)) for turn in _frequent(turns[:, None], CLOSE).ravel()]
    return found


def _translations(sides: list[_Side], size: float) -> list[Motion]:
    """Translations that lay corners onto corners of windows that are not planar."""
    curved = [side.corners for side in sides if not side.is_planar(size)]
    if len(curved) < 2:
        return []
    shifts = np.concatenate([(b[None] - a[:, None]).reshape(-1, 3) for a, b in combinations(curved, 2)])
    shifts = shifts[np.abs(shifts).max(axis=1) > SMALLEST * size]
    first = np.argmax(np.abs(shifts) > SMALLEST * size, axis=1)
    shifts *= np.sign(shifts[np.arange(len(shifts)), first])[:, None]
    return [Motion(shift=tuple(shift.tolist())) for shift in _frequent(shifts, CLOSE * size)]


def _frequent(values: np.ndarray, tolerance: float) -> np.ndarray:
    """Values, shape (m, n), that occur more than once among those of shape (l, n), the most frequent first."""
    if not len(values):
        return values
    _, first, counts = np.unique(np.round(values / (10.0 * tolerance)), axis=0, return_index=True, return_counts=True)
    order = np.argsort(-counts, kind="stable")[:MOST_TRIED]
    return values[first[order[counts[order] > 1]]]


def _laid(sides: list[_Side], candidates: list[int], motion: Motion, size: float) -> set[int]:
    """Sides all of whose nodes the motion lays onto nodes of others that look at them."""
    nodes, inwards = (np.concatenate([getattr(sides[n], name) for n in candidates]) for name in ("nodes", "inwards"))
    owner = np.repeat(np.arange(len(candidates)), [len(sides[n].nodes) for n in candidates])
    tree = cKDTree(nodes)
    found = set()
    for place, n in enumerate(candidates):
        moved = motion.move(sides[n].corners)
        if np.isinf(tree.query(moved, distance_upper_bound=CLOSE * size)[0]).any():
            continue
        distance, met = tree.query(motion.move(sides[n].nodes), distance_upper_bound=CLOSE * size)
        if np.isinf(distance).any() or (owner[met] == place).mean() > 0.5:
            continue
        facing = np.sum(motion.turn(sides[n].inwards) * inwards[met], axis=1)
        if np.median(facing) < 0.0:
            found.add(n)
    return found
