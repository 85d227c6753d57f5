"""Topology of a grid: its interfaces, boundary and segments, the links between these, and numbers of shared points.

The links of a topology join whole faces, edges and corners of segments, so the same links number the nodes of a grid
and the control points of a control mesh, whatever the shapes, as long as linked sections agree.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ...base.display import OneLine
from ...errors import InputError
from .block_layout import BlockLayout
from .index_space import FACE_NAMES, Interface, Orientation, Section, Window, section_rows
from .periodic_pair import Motion


@dataclass(frozen=True)
class BoundaryFace:
    """A face window without an adjacent block."""

    window: Window  # the face window of a grid block
    # patch, kind: name and kind of its declared patch; None if nothing is declared
    patch: str | None = None
    kind: str | None = None


@dataclass(frozen=True)
class NearMiss:
    """Two face windows that nearly coincide and are therefore probably meant to, whether they are joined or not."""

    window: Window  # the face window
    other: Window  # the window that it nearly meets
    # distance of two nodes that nearly coincide, in metres, where it is largest relative to the local spacing
    gap: float
    spacing: float  # local spacing there, in metres


@dataclass(frozen=True)
class Link:
    """Two sections of segments that coincide."""

    # a, b: segment numbers
    a: int
    # a_section, b_section: sections (see `Section`), for example ``(0, None, None)``; faces, edges or corners
    a_section: Section
    b: int
    b_section: Section
    orientation: Orientation  # maps the directions of segment a to those of segment b


@dataclass(frozen=True)
class PeriodicLinks(OneLine):
    """Faces of segments that coincide up to a motion: both sides of a periodic pair."""

    motion: Motion  # maps the points of the faces a to the faces b
    links: tuple[Link, ...]


@dataclass(frozen=True)
class Collapse:
    """A section of a segment in which all points along one direction coincide."""

    segment: int  # segment number
    section: Section  # the face or edge (see `Section`)
    direction: int  # the direction of zero extent


@dataclass(frozen=True)
class Topology(OneLine):
    """Interfaces, boundary and collapsed parts of a grid, its segments, and the links that join them."""

    source: str  # origin of the grid, for messages
    shapes: tuple[tuple[int, ...], ...]  # number of nodes of each block
    interfaces: tuple[Interface, ...]  # pairs of face windows that coincide
    boundary: tuple[BoundaryFace, ...]  # declared patches, and other faces that are neither interfaces nor collapsed
    collapsed: tuple[Window, ...]  # faces and edges, or windows of them, of zero extent in at least one direction
    near_misses: tuple[NearMiss, ...]  # pairs of face windows that nearly coincide, and are not joined
    segments: tuple[Window, ...]  # parts of blocks, one spline volume each: whole blocks unless cut
    links: tuple[Link, ...]  # faces, edges and corners of segments that coincide
    collapses: tuple[Collapse, ...]  # sections of segments of zero extent
    warnings: tuple[str, ...] = ()  # what could not be used, or not as given, one line each
    joined_gaps: tuple[NearMiss, ...] = ()  # interfaces that are joined although some of their nodes do not coincide
    # pairs of blocks whose faces lie on the same points, from 0: the second duplicates the first
    repeated: tuple[tuple[int, int], ...] = ()
    periodic: tuple[PeriodicLinks, ...] = ()  # interfaces with a motion; their faces are boundary as well

    @property
    def alike(self) -> tuple[Link, ...]:
        """Links of sections with equal numbers of points, parameters and splines, including periodic sides."""
        return (*self.links, *(link for tied in self.periodic for link in tied.links))

    @property
    def n_nodes(self) -> int:
        """Number of nodes of all blocks; shared nodes are counted in each."""
        return self.layout.size

    @cached_property
    def layout(self) -> BlockLayout:
        """Layout of the nodes of the blocks in the grid vector."""
        return BlockLayout.of(self.shapes)

    @property
    def segment_names(self) -> tuple[str, ...]:
        """Names of the segments for messages: the block, and the index range if a block is cut."""
        return tuple(_segment_name(segment, self.shapes[segment.block]) for segment in self.segments)

    def node_ids(self) -> list[np.ndarray]:
        """Give each node of each segment a number, shared nodes the same (see `shared_ids`)."""
        return shared_ids([segment.shape for segment in self.segments], self.links, self.collapses, self.segment_names)


def describe(window: Window, shape: tuple[int, ...] | None = None) -> str:
    """Name a window for a message: block and index ranges, from 1; its face if it is a whole face of that shape."""
    faces = [] if shape is None else [Window.whole(window.block, shape).face(n) for n in range(len(FACE_NAMES))]
    for face, name in zip(faces, FACE_NAMES):
        if window == face:
            return f"block {window.block + 1} {name}"
    ranges = (f"{lo + 1}" if lo == hi else f"{lo + 1}-{hi + 1}" for lo, hi in zip(window.lo, window.hi))
    return f"block {window.block + 1} ({', '.join(ranges)})"


def _segment_name(segment: Window, shape: tuple[int, ...]) -> str:
    """Name a segment for messages, as its block if it is one."""
    if segment == Window.whole(segment.block, shape):
        return f"block {segment.block + 1}"
    return describe(segment)


def shared_ids(
    shapes: Sequence[tuple[int, ...]],  # shape of the index space of every segment
    links: Sequence[Link],  # coincident sections
    collapses: Sequence[Collapse] = (),  # sections without extent in one direction
    names: Sequence[str] | None = None,  # names of the segments for messages; "block 1", ... by default.
) -> list[np.ndarray]:
    """Number the points of index spaces, linked points alike."""
    # Returns list of ndarray of int32, each of the given shape of int, numbers 0, 1, 2, ... by first occurrence
    # (segments in order, each in C order).
    layout = BlockLayout.of(shapes)
    first = first_joined(layout.size, joined_pairs(shapes, links, collapses, names))
    is_first = first == np.arange(len(first))
    return layout.split((np.cumsum(is_first) - 1).astype(np.int32)[first])


def joined_pairs(
    shapes: Sequence[tuple[int, ...]],
    links: Sequence[Link],
    collapses: Sequence[Collapse] = (),
    names: Sequence[str] | None = None,
) -> list[np.ndarray]:
    """Pairs of points, each array of shape (2, n), that links and collapses join; arguments as in `shared_ids`."""
    # Points are numbered consecutively, segments in order, each in C order. All of them lie on faces of segments.
    starts = BlockLayout.of(shapes).starts
    pairs = [link_pairs(shapes, starts, link, names) for link in links]
    return pairs + [_collapse_pairs(shapes, starts, collapse) for collapse in collapses]


def link_pairs(
    shapes: Sequence[tuple[int, ...]], starts: np.ndarray, link: Link, names: Sequence[str] | None = None
) -> np.ndarray:
    """Points joined by a link, shape (2, n)."""
    a = section_rows(shapes[link.a], link.a_section, starts[link.a])
    b = link.orientation.apply(section_rows(shapes[link.b], link.b_section, starts[link.b]))
    if a.shape != b.shape:
        raise _disagreement(link, a.shape, b.shape, names or [f"block {s + 1}" for s in range(len(shapes))])
    return np.stack([a.ravel(), b.ravel()])


def _disagreement(link: Link, a_shape: tuple[int, ...], b_shape: tuple[int, ...], names: Sequence[str]) -> InputError:
    """Name the first direction in which two linked sections differ."""
    d = next(d for d in range(3) if a_shape[d] != b_shape[d])
    a, b = names[link.a], names[link.b]
    there = "ijk"[link.orientation.perm[d]]
    return InputError(
        f"{a} has {a_shape[d]} points in direction {'ijk'[d]} and {b} has {b_shape[d]} in direction {there}, "
        f"but they share an interface along these directions; give both the same number"
    )


def _collapse_pairs(shapes: Sequence[tuple[int, ...]], starts: np.ndarray, collapse: Collapse) -> np.ndarray:
    """Points joined by a collapse, shape (2, n): each with the first of its line."""
    rows = section_rows(shapes[collapse.segment], collapse.section, starts[collapse.segment])
    first = np.broadcast_to(rows.take([0], axis=collapse.direction), rows.shape)
    return np.stack([first.ravel(), rows.ravel()])


def first_joined(n: int, pairs: Sequence[np.ndarray]) -> np.ndarray:
    """Return the first point to which each of n points is joined by any chain of pairs, each of shape (2, m)."""
    first = np.arange(n)
    points, firsts = joined_points(pairs)
    first[points] = firsts
    return first


def joined_points(pairs: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the points in pairs, each of shape (2, m), ascending, and the first point to which each is joined."""
    a, b = np.concatenate([np.zeros((2, 0), dtype=np.int64), *pairs], axis=1)
    points, places = np.unique(np.concatenate([a, b]), return_inverse=True)
    graph = coo_array((np.ones(len(a), dtype=bool), np.split(places, [len(a)])), shape=(len(points), len(points)))
    _, labels = connected_components(graph.tocsr(), directed=False)
    _, firsts = np.unique(labels, return_index=True)
    return points, points[firsts[labels]]
