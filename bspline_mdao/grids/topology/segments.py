"""Segments: blocks cut so that interfaces, patches and collapsed windows cover whole faces, and the links between them.

Segments are linked across cut planes and interfaces. Edges and corners are linked if they coincide, but coincidence
alone does not make two points one: the two sides of a zero-thickness plate coincide, and stay apart except where a
chain of interfaces around the plate joins them. So edges, and then corners, are linked only if no two of the coincident
ones lie on faces that are kept apart by declaration and are still apart once all interfaces count.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product

import numpy as np

from .block_layout import BlockLayout
from .faces import block_faces
from .index_space import Interface, Orientation, Section, Window, by_blocks, sections_of, window_rows
from .matching import Quads
from .node_numbering import node_copies, source_rows
from .shell import OnFaces
from .topology import Collapse, Link, Topology

MAX_SEGMENTS = 64
"""Largest number of segments of one block; interfaces and windows that would need more are not cut out."""

Cuts = list[tuple[set[int], ...]]


@dataclass(frozen=True)
class Segmentation:
    """Blocks cut into segments, and how the segments are joined by their faces."""

    segments: tuple[Window, ...]  # blocks in order, the segments of each in C order
    interfaces: tuple[Interface, ...]  # interfaces that cover whole faces of segments
    links: tuple[Link, ...]  # between segments across cut planes and interfaces
    collapses: tuple[Collapse, ...]  # sections of segments of zero extent
    # what was not cut out because a block would have had more than `MAX_SEGMENTS`
    uncut: tuple[Interface | Window, ...]


def segment_blocks(
    shapes: Sequence[tuple[int, ...]],  # number of nodes of each block
    interfaces: Sequence[Interface],  # interfaces, patches: face windows of blocks
    patches: Sequence[Window],
    collapsed: dict[Window, tuple[int, ...]],  # windows of zero extent and the directions of zero extent
    periodic: Sequence[Interface] = (),  # pairs of face windows to cut in the same way, without links
) -> Segmentation:
    """Cut blocks so that interfaces, patches and collapsed windows cover whole faces of segments."""
    cuts, uncut = find_cuts(shapes, [*interfaces, *periodic], [*patches, *collapsed])
    segments = cut_blocks(cuts)
    kept = tuple(interface for interface in interfaces if interface not in uncut)
    kept_windows = {window: directions for window, directions in collapsed.items() if window not in uncut}
    links = (*cut_links(segments), *interface_links(shapes, segments, kept))
    return Segmentation(tuple(segments), kept, links, tuple(find_collapses(segments, kept_windows)), tuple(uncut))


def find_cuts(
    shapes: Sequence[tuple[int, ...]], interfaces: Sequence[Interface], windows: Sequence[Window]
) -> tuple[list, list]:  # cuts: for each block and direction, with both ends; uncut: windows that are not cut out
    """Find the indices at which to cut every block, propagated through interfaces until nothing changes."""
    # If a block would have more than `MAX_SEGMENTS`, the smallest of the interfaces and windows that do not cover a
    # whole face are not cut out, those at this block first, an eighth of them at a time.
    wanted: list[Interface | Window] = [*interfaces, *windows]
    uncut: list[Interface | Window] = []
    while True:
        cuts, full = _spread_cuts(shapes, wanted)
        if full is None:
            return cuts, uncut
        partial = [item for item in wanted if any(_cuts_block(shapes, window) for window in _windows(item))]
        partial.sort(key=lambda item: _priority(item, full))
        n_there = sum(window.block == full for item in partial for window in _windows(item)[:1])
        worst = partial[: max(1, n_there // 8)]
        uncut += worst
        wanted = [item for item in wanted if not any(item is other for other in worst)]


def cut_blocks(cuts: Cuts) -> list[Window]:
    """List the segments of all blocks: blocks in order, each in C order."""
    segments = []
    for block, directions in enumerate(cuts):
        intervals = [list(pairwise(sorted(cut))) if len(cut) > 1 else [(0, 0)] for cut in directions]
        for spans in product(*intervals):
            segments.append(Window(block, *zip(*spans)))
    return segments


def cut_links(segments: Sequence[Window]) -> list[Link]:
    """Links between the neighbours on both sides of every cut plane."""
    at = {(segment.block, segment.lo): number for number, segment in enumerate(segments)}
    links = []
    for number, segment in enumerate(segments):
        for d in range(3):
            lo = segment.lo[:d] + (segment.hi[d],) + segment.lo[d + 1 :]
            if segment.hi[d] > segment.lo[d] and (segment.block, lo) in at:
                links.append(Link(number, _end(d, -1), at[segment.block, lo], _end(d, 0), Orientation()))
    return links


def interface_links(
    shapes: Sequence[tuple[int, ...]], segments: Sequence[Window], interfaces: Sequence[Interface]
) -> list[Link]:
    """Links between the segment faces of every interface."""
    faces = {
        segment.face(face): (number, _end(face // 2, -(face % 2)))
        for number, segment in enumerate(segments)
        for face in range(6)
        if shapes[segment.block][face // 2] > 1
    }
    by_block = by_blocks(faces)
    links = []
    for interface in interfaces:
        for window in by_block[interface.a.block]:
            if interface.a.contains(window):
                a, a_section = faces[window]
                b, b_section = faces[interface.map_window(window)]
                links.append(Link(a, a_section, b, b_section, interface.orientation))
    return links


def find_collapses(segments: Sequence[Window], windows: dict[Window, tuple[int, ...]]) -> list[Collapse]:
    """Sections of segments that lie in collapsed windows."""
    found: dict[Collapse, None] = {}
    for window, directions in windows.items():
        for number, segment in enumerate(segments):
            section = section_in(segment, window)
            if section is not None:
                found.update({Collapse(number, section, d): None for d in directions if section[d] is None})
    return list(found)


def section_in(segment: Window, window: Window) -> Section | None:
    """Find the section of a segment that lies in a window; None if they do not meet or meet in part of a section."""
    section: list[int | None] = []
    for d in range(3):
        lo, hi = max(segment.lo[d], window.lo[d]), min(segment.hi[d], window.hi[d])
        if segment.block != window.block or lo > hi:
            return None
        if (lo, hi) == (segment.lo[d], segment.hi[d]):
            section.append(None)
        elif lo == hi and lo in (segment.lo[d], segment.hi[d]):
            section.append(0 if lo == segment.lo[d] else -1)
        else:
            return None
    return tuple(section)


def _end(d: int, end: int) -> Section:
    """Return the face section at one end of a direction."""
    return tuple(end if direction == d else None for direction in range(3))


def _windows(item: Interface | Window) -> tuple[Window, ...]:
    """Return both sides of an interface, or the window itself."""
    return (item.a, item.b) if isinstance(item, Interface) else (item,)


def _cuts_block(shapes: Sequence[tuple[int, ...]], window: Window) -> bool:
    """Whether a window has an end inside its block."""
    ends = zip(window.lo, window.hi, shapes[window.block])
    return any(index not in (0, n - 1) for lo, hi, n in ends for index in (lo, hi))


def _priority(item: Interface | Window, block: int) -> tuple:
    """Sort key of uncut windows: those at the block with too many segments first, small before large."""
    windows = _windows(item)
    return all(window.block != block for window in windows), np.prod(windows[0].shape), windows[0].block, windows[0].lo


def _spread_cuts(shapes: Sequence[tuple[int, ...]], wanted: Sequence[Interface | Window]) -> tuple[list, int | None]:
    """Cuts for the given interfaces and windows, and the first block with too many segments, if any."""
    cuts: Cuts = [tuple({0, n - 1} for n in shape) for shape in shapes]
    for window in (window for item in wanted for window in _windows(item)):
        for d in range(3):
            cuts[window.block][d].update((window.lo[d], window.hi[d]))
    sides = [side for item in wanted if isinstance(item, Interface) for side in (item, item.reverse())]
    is_changed = True
    while is_changed:
        full = _first_full_block(cuts)
        if full is not None:
            return cuts, full
        changes = [_map_cuts(cuts, side) for side in sides]
        is_changed = any(changes)
    return cuts, None


def _map_cuts(cuts: Cuts, interface: Interface) -> bool:
    """Add the cuts of side a to side b in place, and return whether any is new."""
    is_changed = False
    for d, p in enumerate(interface.orientation.perm):
        if interface.a.lo[d] == interface.a.hi[d]:
            continue
        there = cuts[interface.b.block][p]
        inside = [c for c in cuts[interface.a.block][d] if interface.a.lo[d] < c < interface.a.hi[d]]
        mapped = {interface.map_index(d, c) for c in inside}
        is_changed |= not mapped <= there
        there |= mapped
    return is_changed


def _first_full_block(cuts: Cuts) -> int | None:
    """Return the first block cut into more than `MAX_SEGMENTS`; None if there is none."""
    for block, directions in enumerate(cuts):
        if np.prod([max(len(cut) - 1, 1) for cut in directions]) > MAX_SEGMENTS:
            return block
    return None


def junction_links(
    shapes: Sequence[tuple[int, ...]],  # number of nodes of each block
    segmentation: Segmentation,  # segments, and the links between their faces
    # quads, separated: quads of all faces, and the pairs of them that coincide but are kept apart by declaration
    quads: Quads,
    separated: np.ndarray,
    ids: Sequence[OnFaces],  # point of each face node of each block
) -> list[Link]:
    """Links between coincident edges, then between coincident corners, that no chain of links joins yet."""
    found: list[Link] = []
    starts = BlockLayout.of(shapes).starts
    corners = _apart_corners(ids, starts, quads, separated)
    for n_free in (1, 0):  # edges before corners, many of which are linked by edges
        copies = _copies(shapes, segmentation, found)
        apart = _apart_pairs(source_rows(copies, corners))
        for group in _coincident_junctions(segmentation.segments, ids, starts, copies, n_free):
            found += _group_links(group, apart)
    return found


@dataclass(frozen=True)
class Junction:
    """An edge or a corner of a segment."""

    segment: int  # segment number
    section: Section  # the edge or corner
    points: np.ndarray  # (n,) of int, points on which its nodes lie
    # (n,) of int, rows of its nodes in the grid vector, shared nodes by the first, according to the links so far
    shared: np.ndarray
    is_reversed: bool  # whether an edge is listed from its high end, so that coincident edges list alike


def _copies(shapes: Sequence[tuple[int, ...]], segmentation: Segmentation, found: Sequence[Link]) -> np.ndarray:
    """Rows that are copies, and the rows that they copy, by the links so far: see `node_copies`."""
    links, nothing = (*segmentation.links, *found), ((),) * 4
    joined = Topology("grid", tuple(shapes), *nothing, segmentation.segments, links, segmentation.collapses)
    return node_copies(joined)


def _apart_corners(ids: Sequence[OnFaces], starts: np.ndarray, quads: Quads, separated: np.ndarray) -> np.ndarray:
    """Rows of the nodes that coincide at the corners of quads kept apart, shape (n, 2)."""
    rows = [replace(block_ids, values=start + block_ids.nodes.numbers) for start, block_ids in zip(starts, ids)]
    corners = Quads.of(block_faces(rows)).corners
    order = np.argsort(quads.corners[separated], axis=2, kind="stable")
    return np.take_along_axis(corners[separated], order, axis=2).transpose(0, 2, 1).reshape(-1, 2)


def _apart_pairs(shared: np.ndarray) -> set[tuple[int, ...]]:
    """Pairs of numbers, the lower first, that must not be joined."""
    pairs = np.unique(np.sort(shared[shared[:, 0] != shared[:, 1]], axis=1), axis=0)
    return set(map(tuple, pairs.tolist()))


def _coincident_junctions(
    segments: Sequence[Window], ids: Sequence[OnFaces], starts: np.ndarray, copies: np.ndarray, n_free: int
) -> list[list[Junction]]:
    """Edges (one free direction) or corners (none) on the same points, one for each that is already shared."""
    groups: dict[bytes, dict[bytes, Junction]] = {}
    for number, segment in enumerate(segments):
        for section in sections_of(segment.shape, n_free):
            window = _section_window(segment, section)
            points = ids[segment.block].at(window).ravel()
            if points.min() >= 0 and (n_free == 0 or np.ptp(points) > 0):
                rows = window_rows(window, ids[segment.block].shape, int(starts[segment.block])).ravel()
                junction = _junction(number, section, points, source_rows(copies, rows))
                groups.setdefault(junction.points.tobytes(), {}).setdefault(junction.shared.tobytes(), junction)
    return [list(group.values()) for group in groups.values() if len(group) > 1]


def _section_window(segment: Window, section: Section) -> Window:
    """Window of a section of a segment in its block."""
    ends = [
        (lo, hi) if end is None else (hi, hi) if end else (lo, lo)
        for lo, hi, end in zip(segment.lo, segment.hi, section)
    ]
    return Window(segment.block, *map(tuple, zip(*ends)))


def _junction(number: int, section: Section, points: np.ndarray, rows: np.ndarray) -> Junction:
    """Make a junction, oriented so that coincident ones list their points in the same order."""
    is_reversed = points.tolist() > points[::-1].tolist()
    step = -1 if is_reversed else 1
    return Junction(number, section, points[::step], rows[::step], is_reversed)


def _group_links(group: Sequence[Junction], apart: set[tuple[int, ...]]) -> list[Link]:
    """Links from the first of coincident junctions to the others, unless two are kept apart."""
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
