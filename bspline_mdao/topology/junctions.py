"""Links between segments that share only an edge or a corner.

Coincidence alone does not make two points one: the two sides of a zero-thickness plate coincide, and stay apart except
where a chain of interfaces around the plate joins them. So edges, and then corners, are linked by coincidence only
where no two of those that coincide lie on faces kept apart by declaration and are still apart once all interfaces
count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from .entities import Link, Section
from .faces import block_faces
from .index_space import Orientation, Window
from .matching import Quads
from .sections import sections_of, whole_slices
from .segments import Segmentation
from .sharing import block_rows, shared_ids


@dataclass(frozen=True)
class Junction:
    """An edge or a corner of a segment.

    Parameters
    ----------
    segment : int
        Segment number.
    section : tuple of (int or None)
        The edge or corner.
    points : ndarray of int, shape (n,)
        Points on which its nodes lie.
    shared : ndarray of int, shape (n,)
        Numbers of its nodes, shared ones alike, by the links known so far.
    is_reversed : bool
        Whether an edge is listed from its high end, so that coincident edges list alike.
    """

    segment: int
    section: Section
    points: np.ndarray
    shared: np.ndarray
    is_reversed: bool


def junction_links(
    shapes, segmentation: Segmentation, quads: Quads, kept_apart: np.ndarray, ids: Sequence[np.ndarray]
) -> list[Link]:
    """Links between coincident edges, then between coincident corners, that no chain of links joins yet.

    Parameters
    ----------
    shapes : sequence of (int, int, int)
        Number of nodes of each block.
    segmentation : Segmentation
        Segments, and the links between their faces.
    quads, kept_apart
        Quads of all faces and the pairs of them that coincide but are kept apart by declaration.
    ids : sequence of ndarray
        Point of each face node of each block.
    """
    found: list[Link] = []
    corners = _apart_corners(shapes, quads, kept_apart)
    for n_free in (1, 0):
        shared = _shared_numbers(shapes, segmentation, found)
        apart = _apart_pairs(np.concatenate([numbers.ravel() for numbers in shared])[corners])
        for group in _coincident_junctions(segmentation.segments, ids, shared, n_free):
            found += _group_links(group, apart)
    return found


def _shared_numbers(shapes, segmentation: Segmentation, found: Sequence[Link]) -> list[np.ndarray]:
    """Give each node of each block a number by the links known so far, shared nodes alike."""
    shared = [np.empty(shape, dtype=np.int32) for shape in shapes]
    segments = segmentation.segments
    ids = shared_ids([segment.shape for segment in segments], [*segmentation.links, *found], segmentation.collapses)
    for segment, numbers in zip(segments, ids):
        shared[segment.block][segment.slices] = numbers
    return shared


def _apart_corners(shapes, quads: Quads, kept_apart: np.ndarray) -> np.ndarray:
    """Rows of the nodes that coincide at the corners of quads kept apart, shape (n, 2)."""
    rows = Quads.of(block_faces(block_rows(shapes)))
    order = np.argsort(quads.corners[kept_apart], axis=2, kind="stable")
    return np.take_along_axis(rows.corners[kept_apart], order, axis=2).transpose(0, 2, 1).reshape(-1, 2)


def _apart_pairs(shared: np.ndarray) -> set[tuple[int, int]]:
    """Pairs of numbers, the lower first, that must not become one."""
    pairs = np.unique(np.sort(shared[shared[:, 0] != shared[:, 1]], axis=1), axis=0)
    return set(map(tuple, pairs.tolist()))


def _coincident_junctions(segments, ids, shared, n_free: int) -> list[list[Junction]]:
    """Edges (one free direction) or corners (none) that lie on the same points, one of each that is shared already."""
    groups: dict[bytes, dict[bytes, Junction]] = {}
    for number, segment in enumerate(segments):
        for section in sections_of(segment.shape, n_free):
            junction = _junction(segment, number, section, ids, shared)
            if junction.points.min() >= 0 and (n_free == 0 or np.ptp(junction.points) > 0):
                groups.setdefault(junction.points.tobytes(), {}).setdefault(junction.shared.tobytes(), junction)
    return [list(group.values()) for group in groups.values() if len(group) > 1]


def _junction(segment: Window, number: int, section: Section, ids, shared) -> Junction:
    points, numbers = (array[segment.block][segment.slices][whole_slices(section)].ravel() for array in (ids, shared))
    is_reversed = points.tolist() > points[::-1].tolist()
    step = -1 if is_reversed else 1
    return Junction(number, section, points[::step], numbers[::step], is_reversed)


def _group_links(group: Sequence[Junction], apart: set[tuple[int, int]]) -> list[Link]:
    """Links from the first of coincident junctions to the others, none where two are kept apart."""
    for a, b in combinations(group, 2):
        if not apart.isdisjoint(zip(np.minimum(a.shared, b.shared).tolist(), np.maximum(a.shared, b.shared).tolist())):
            return []
    return [_junction_link(group[0], other) for other in group[1:]]


def _junction_link(a: Junction, b: Junction) -> Link:
    """Make the link of two coincident junctions: the free direction along the free one, the others in order."""
    a_order, b_order = (sorted(range(3), key=lambda d: j.section[d] is not None) for j in (a, b))
    perm, flip = [0, 0, 0], [False] * 3
    for d, p in zip(a_order, b_order):
        perm[d] = p
    flip[a_order[0]] = a.is_reversed != b.is_reversed
    return Link(a.segment, a.section, b.segment, b.section, Orientation(tuple(perm), tuple(flip)))
