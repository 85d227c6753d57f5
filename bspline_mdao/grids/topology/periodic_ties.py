"""Points of periodic sides that are equal up to a motion, and their common displacement.

Points on both sides of periodic pairs, and points that several pairs join, as at the corners of a lattice of cells,
form groups: an original and its copies, each with the motion that maps the original onto it. All move together, each
rotated: u_copy = R u_original. A point that a motion maps onto itself, such as a point on the axis of a sector, moves
only in the directions that its rotation keeps.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from .block_layout import BlockLayout
from .index_space import Section
from .node_numbering import NodeNumbering, node_copies, rows_of_places, source_rows
from .periodic_pair import Motion
from .topology import Link, PeriodicLinks, Topology, describe, link_pairs

__all__ = ["NodeTies", "Ties", "control_ties", "gap_between", "row_ties", "rows_of_sides", "sides_of", "tied_sides"]

SAME = 1e-9
"""Entries of rotations closer than this are equal: periodic sides do not differ by smaller angles about an axis."""


@dataclass(frozen=True, eq=False)
class Ties(OneLine):
    """Originals and their copies."""

    # originals, copies: (n,) of int, an original may have several copies, and is not itself a copy
    originals: np.ndarray
    copies: np.ndarray
    turns: np.ndarray  # (n, 3, 3), rotation of the original's displacement into the copy's
    shifts: np.ndarray  # (n, 3), the copy is at ``turn x + shift`` (m)
    # on_axis: (m,) of int, originals, or points without copies, once for each direction in which they cannot move
    on_axis: np.ndarray
    across: np.ndarray  # (m, 3), these directions: unit vectors, orthogonal for the same point

    @classmethod
    def of(cls, pairs: Sequence[tuple[np.ndarray, np.ndarray, Motion]]) -> Ties:
        """Tie points a to points b, each of shape (n,), onto which a motion maps them."""
        points = np.unique(np.concatenate([ids for a, b, _ in pairs for ids in (a, b)]))
        steps = []
        for a, b, motion in pairs:
            a, b = (np.searchsorted(points, ids) for ids in (a, b))
            turn, shift = motion.turn(np.eye(3)).T, motion.move(np.zeros((1, 3)))[0]
            steps += [(a, b, turn, shift), (b, a, turn.T, -turn.T @ shift)]
        root = np.arange(len(points))
        turns, shifts = np.tile(np.eye(3), (len(points), 1, 1)), np.zeros((len(points), 3))
        is_changed = True
        while is_changed:
            is_changed = False
            for a, b, turn, shift in steps:
                at = np.flatnonzero(root[a] < root[b])
                at = at[np.unique(b[at], return_index=True)[1]]
                to, by = b[at], a[at]
                root[to], turns[to], shifts[to] = root[by], turn @ turns[by], shifts[by] @ turn.T + shift
                is_changed |= len(at) > 0
        on_axis, across = _on_axis(root, turns, steps[::2])
        copies = np.flatnonzero(root != np.arange(len(root)))
        return cls(points[root[copies]], points[copies], turns[copies], shifts[copies], points[on_axis], across)

    def __len__(self) -> int:
        return len(self.copies) + len(self.on_axis)

    @property
    def ids(self) -> np.ndarray:
        """All points, ascending."""
        return np.unique(np.concatenate([self.originals, self.copies, self.on_axis]))

    def groups_of(self, ids: np.ndarray) -> np.ndarray:
        """All points of the groups that contain some points."""
        of_these = np.isin(self.originals, ids) | np.isin(self.copies, ids)
        is_in = np.isin(self.originals, self.originals[of_these])
        return np.unique(np.concatenate([self.originals[is_in], self.copies[is_in]]))

    def without(self, ids: np.ndarray) -> Ties:
        """Leave out groups by their originals."""
        is_in = ~np.isin(self.originals, ids)
        ends = self.originals[is_in], self.copies[is_in]
        return Ties(*ends, self.turns[is_in], self.shifts[is_in], self.on_axis, self.across)

    def numbered(self, numbers: np.ndarray) -> Ties:
        """Renumber points by ``numbers[id]``; groups with a negative number are left out."""
        kept = self.without(self.originals[(numbers[self.copies] < 0) | (numbers[self.originals] < 0)])
        is_on_axis = numbers[self.on_axis] >= 0
        ends = numbers[kept.originals], numbers[kept.copies]
        return Ties(*ends, kept.turns, kept.shifts, numbers[self.on_axis[is_on_axis]], self.across[is_on_axis])

    def lay(self, points: np.ndarray) -> np.ndarray:
        """Place copies, in place, where the motions map their originals (m)."""
        points[self.copies] = np.einsum("nij,nj->ni", self.turns, points[self.originals]) + self.shifts
        return points

    def lay_jvp(self, change: np.ndarray) -> np.ndarray:
        """Change of `lay`, in place."""
        change[self.copies] = np.einsum("nij,nj->ni", self.turns, change[self.originals])
        return change

    def lay_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `lay_jvp`, in place."""
        np.add.at(bar, self.originals, np.einsum("nji,nj->ni", self.turns, bar[self.copies]))
        bar[self.copies] = 0.0
        return bar

    def raise_alike(self, values: np.ndarray) -> None:
        """Raise values of points, shape (n_points,), in place, to the largest of their groups."""
        np.maximum.at(values, self.originals, values[self.copies])
        values[self.copies] = values[self.originals]

    def alike(self, vectors: np.ndarray) -> np.ndarray:
        """Displacements of all points, in place, with each group's mean for its points: an orthogonal projection.

        Hence it is its own transpose.
        """
        n_each = np.bincount(np.searchsorted(self._roots, self.originals), minlength=len(self._roots)) + 1.0
        mean = vectors[self._roots]
        turned_back = np.einsum("nji,nj->ni", self.turns, vectors[self.copies])
        np.add.at(mean, np.searchsorted(self._roots, self.originals), turned_back)
        vectors[self._roots] = mean / n_each[:, None]
        off = np.einsum("nj,nj->n", vectors[self.on_axis], self.across)
        np.subtract.at(vectors, self.on_axis, off[:, None] * self.across)
        vectors[self.copies] = np.einsum("nij,nj->ni", self.turns, vectors[self.originals])
        return vectors

    @property
    def _roots(self) -> np.ndarray:
        return np.unique(self.originals)


def _on_axis(root: np.ndarray, turns: np.ndarray, steps: Iterable[tuple]) -> tuple[np.ndarray, np.ndarray]:
    """Directions in which originals cannot move because a chain of motions maps them onto themselves."""
    found: dict[int, list[np.ndarray]] = {}
    for a, b, turn, _ in steps:
        off = np.einsum("nji,njk->nik", turns[b], turn @ turns[a]) - np.eye(3)
        for n in np.flatnonzero(np.abs(off).max(axis=(1, 2)) > SAME):
            found.setdefault(int(root[b[n]]), []).append(off[n])
    on_axis, across = [], []
    for point, parts in found.items():
        _, sizes, rows = np.linalg.svd(np.concatenate(parts))
        on_axis += [point] * int(np.count_nonzero(sizes > SAME))
        across.append(rows[sizes > SAME])
    return np.array(on_axis, dtype=np.int64), np.concatenate([np.zeros((0, 3)), *across])


def control_ties(topology: Topology, control_ids: Sequence[np.ndarray]) -> Ties | None:
    """Ties of the points of all segments by their numbers there; None if no sides are tied."""
    layout = BlockLayout.of(ids.shape for ids in control_ids)
    return _ties(topology, layout, layout.join(control_ids).__getitem__) if topology.periodic else None


def row_ties(topology: Topology) -> Ties | None:
    """Ties of the nodes of a grid by their rows, coincident nodes by the first; None if no sides are tied."""
    if not topology.periodic:
        return None
    copies = node_copies(topology)
    return _ties(topology, _nodes(topology), lambda places: source_rows(copies, rows_of_places(topology, places)))


def tied_sides(topology: Topology) -> frozenset[tuple[int, int]]:
    """Sides of segments that are tied to others: numbers of the segment, and of its face."""
    ends = (end for tied in topology.periodic for link in tied.links for end in _ends(link))
    return frozenset(
        (segment, 2 * d + (end == -1)) for segment, section in ends for d, end in enumerate(section) if end is not None
    )


def _ends(link: Link) -> tuple[tuple[int, Section], ...]:
    return (link.a, link.a_section), (link.b, link.b_section)


def rows_of_sides(topology: Topology) -> list[tuple[Motion, np.ndarray, np.ndarray]]:
    """Motions, rows of the nodes of one side, coincident nodes by the first, and rows of their partners."""
    copies, layout = node_copies(topology), _nodes(topology)
    found = []
    for tied in topology.periodic:
        rows = [source_rows(copies, rows_of_places(topology, side)) for side in _linked(layout, tied)]
        found.append((tied.motion, *np.unique(np.stack(rows), axis=1)))
    return found


def gap_between(topology: Topology, tied: PeriodicLinks, nodes: np.ndarray) -> float:
    """Largest distance of moved nodes of one side from the other (m), from all nodes of a grid, (n, 3)."""
    a, b = (nodes[rows_of_places(topology, side)] for side in _linked(_nodes(topology), tied))
    return float(np.linalg.norm(tied.motion.move(a) - b, axis=1).max())


def sides_of(topology: Topology, tied: PeriodicLinks) -> tuple[str, str]:
    """Name the faces of both sides for a message."""
    ends = zip(*(_ends(link) for link in tied.links))
    first, second = (", ".join(dict.fromkeys(_name(topology, *end) for end in side)) for side in ends)
    return first, second


def _name(topology: Topology, number: int, section: Section) -> str:
    """Name the face of a segment by its block, and by its nodes if it is a part of it."""
    segment = topology.segments[number]
    d = next(d for d, end in enumerate(section) if end is not None)
    return describe(segment.face(2 * d + (section[d] == -1)), topology.shapes[segment.block])


def _nodes(topology: Topology) -> BlockLayout:
    return BlockLayout.of(segment.shape for segment in topology.segments)


def _linked(layout: BlockLayout, tied: PeriodicLinks) -> np.ndarray:
    """Places in segments, in order, of points of both sides, shape (2, n)."""
    return np.concatenate([link_pairs(layout.shapes, layout.starts, link) for link in tied.links], axis=1)


def _ties(topology: Topology, layout: BlockLayout, number: Callable[[np.ndarray], np.ndarray]) -> Ties:
    """Ties of points by numbers that are given for their places in segments, in order."""
    pairs = []
    for tied in topology.periodic:
        a, b = np.unique(np.stack([number(side) for side in _linked(layout, tied)]), axis=1)
        pairs.append((a, b, tied.motion))
    return Ties.of(pairs)


@dataclass(frozen=True, eq=False)
class NodeTies(OneLine):
    """Ties of some nodes of a grid, and the nodes that coincide with some of these."""

    ties: Ties  # by the numbers of the nodes
    copies: np.ndarray  # (n, 2) of int, nodes, and the tied nodes with which they coincide

    @classmethod
    def of(cls, numbering: NodeNumbering) -> NodeTies | None:
        """Take the ties of nodes, only of complete groups. None if no sides are tied."""
        of_grid = row_ties(numbering.topology)
        if of_grid is None:
            return None
        numbers = np.full(numbering.topology.n_nodes, -1)
        numbers[of_grid.ids] = numbering.numbers_of(of_grid.ids)
        ties, copies = of_grid.numbered(numbers), numbering.copies
        return cls(ties, copies[np.isin(copies[:, 1], ties.ids)])

    def alike(self, vectors: np.ndarray) -> np.ndarray:
        """Displacements of the nodes, in place, see `Ties.alike`."""
        self.ties.alike(vectors)
        vectors[self.copies[:, 0]] = vectors[self.copies[:, 1]]
        return vectors

    def move_alike(self, nodes: np.ndarray, at_rest: np.ndarray) -> None:
        """Give moved nodes, in place, tied displacements from their rest positions; both (n_nodes, 3)."""
        change = self.alike(nodes - at_rest)
        rows = np.union1d(self.ties.ids, self.copies[:, 0])
        nodes[rows] = at_rest[rows] + change[rows]

    def move_alike_vjp(self, bar: np.ndarray, at_rest_bar: np.ndarray) -> None:
        """Transpose of `move_alike`, which is linear: in place for the moved nodes, and added for the nodes at rest."""
        at_rest_bar += bar
        self.alike_vjp(bar)
        at_rest_bar -= bar

    def alike_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `alike`, in place."""
        np.add.at(bar, self.copies[:, 1], bar[self.copies[:, 0]])
        bar[self.copies[:, 0]] = 0.0
        return self.ties.alike(bar)
