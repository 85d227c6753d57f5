"""Segments: blocks cut so that interfaces, patches and collapsed windows cover whole faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from .entities import Collapse, Interface, Link, Section
from .index_space import Orientation, Window, by_blocks

MAX_SEGMENTS = 64
"""Most segments of one block; interfaces and windows that would need more are not cut out."""

Cuts = list[tuple[set[int], set[int], set[int]]]


@dataclass(frozen=True)
class Segmentation:
    """Blocks cut into segments, and how the segments hang together by their faces.

    Parameters
    ----------
    segments : tuple of Window
        Blocks in order, the segments of each in C order.
    interfaces : tuple of Interface
        Those that cover whole faces of segments.
    links : tuple of Link
        Between segments across cut planes and interfaces.
    collapses : tuple of Collapse
        Sections of segments of zero extent.
    given_up : tuple of (Interface or Window)
        What was not cut out because a block would have had more than `MAX_SEGMENTS`.
    """

    segments: tuple[Window, ...]
    interfaces: tuple[Interface, ...]
    links: tuple[Link, ...]
    collapses: tuple[Collapse, ...]
    given_up: tuple[Interface | Window, ...]


def segment_blocks(
    shapes, interfaces: Sequence[Interface], patches: Sequence[Window], collapsed: dict[Window, tuple[int, ...]]
) -> Segmentation:
    """Cut blocks so that interfaces, patches and collapsed windows cover whole faces of segments.

    Parameters
    ----------
    shapes : sequence of (int, int, int)
        Number of nodes of each block.
    interfaces, patches
        Face windows of blocks.
    collapsed : dict of Window to tuple of int
        Windows of zero extent and the directions in which they have none.
    """
    cuts, given_up = find_cuts(shapes, interfaces, [*patches, *collapsed])
    segments = cut_blocks(cuts)
    kept = tuple(interface for interface in interfaces if interface not in given_up)
    pinched = {window: directions for window, directions in collapsed.items() if window not in given_up}
    links = (*cut_links(segments), *interface_links(shapes, segments, kept))
    return Segmentation(tuple(segments), kept, links, tuple(find_collapses(segments, pinched)), tuple(given_up))


def find_cuts(shapes, interfaces: Sequence[Interface], windows: Sequence[Window]):
    """Find the indices at which to cut every block, carried through interfaces until nothing changes.

    Where a block would fall into more than `MAX_SEGMENTS`, the smallest of the interfaces and windows that do not cover
    a whole face are given up, those at that block first, an eighth of them at a time.

    Returns
    -------
    cuts : list of tuple of set of int
        For each block and direction, with both ends.
    given_up : list of (Interface or Window)
        What is not cut out.
    """
    wanted, given_up = [*interfaces, *windows], []
    while True:
        cuts, crowded = _spread_cuts(shapes, wanted)
        if crowded is None:
            return cuts, given_up
        partial = [item for item in wanted if any(_cuts_block(shapes, window) for window in _windows(item))]
        partial.sort(key=lambda item: _priority(item, crowded))
        n_there = sum(window.block == crowded for item in partial for window in _windows(item)[:1])
        worst = partial[: max(1, n_there // 8)]
        given_up += worst
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


def interface_links(shapes, segments: Sequence[Window], interfaces: Sequence[Interface]) -> list[Link]:
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
                b, b_section = faces[carry(interface, window)]
                links.append(Link(a, a_section, b, b_section, interface.orientation))
    return links


def find_collapses(segments: Sequence[Window], windows: dict[Window, tuple[int, ...]]) -> list[Collapse]:
    """Sections of segments that lie in collapsed windows."""
    found = {}
    for window, directions in windows.items():
        for number, segment in enumerate(segments):
            section = section_in(segment, window)
            if section is not None:
                found.update({Collapse(number, section, d): None for d in directions if section[d] is None})
    return list(found)


def section_in(segment: Window, window: Window) -> Section | None:
    """Find the section of a segment that lies in a window; None if they do not meet or meet in part of a section."""
    section = []
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


def carry(interface: Interface, window: Window) -> Window:
    """Carry a part of side a of an interface to the part of side b that it meets."""
    lo, hi = [0, 0, 0], [0, 0, 0]
    for d, (p, flip) in enumerate(zip(interface.orientation.perm, interface.orientation.flip)):
        ends = sorted(_carried(interface, d, p, flip, index) for index in (window.lo[d], window.hi[d]))
        lo[p], hi[p] = ends
    return Window(interface.b.block, tuple(lo), tuple(hi))


def reverse(interface: Interface) -> Interface:
    """Exchange the sides of an interface."""
    return Interface(interface.b, interface.a, interface.orientation.inverse())


def _carried(interface: Interface, d: int, p: int, flip: bool, index: int) -> int:
    """Index along direction p of block b that meets ``index`` along direction d of block a."""
    if flip:
        return interface.b.hi[p] - (index - interface.a.lo[d])
    return interface.b.lo[p] + (index - interface.a.lo[d])


def _end(d: int, end: int) -> Section:
    """Return the face section at one end of a direction."""
    return tuple(end if direction == d else None for direction in range(3))


def _windows(item: Interface | Window) -> tuple[Window, ...]:
    return (item.a, item.b) if isinstance(item, Interface) else (item,)


def _cuts_block(shapes, window: Window) -> bool:
    """Whether a window has an end inside its block."""
    ends = zip(window.lo, window.hi, shapes[window.block])
    return any(index not in (0, n - 1) for lo, hi, n in ends for index in (lo, hi))


def _priority(item: Interface | Window, block: int):
    """Order in which to give up what cannot be cut out: at the crowded block first, small before large."""
    windows = _windows(item)
    return all(window.block != block for window in windows), np.prod(windows[0].shape), windows[0].block, windows[0].lo


def _spread_cuts(shapes, wanted: Sequence[Interface | Window]):
    """Cuts that the wanted interfaces and windows need, and the first block with too many segments, if any."""
    cuts: Cuts = [tuple({0, n - 1} for n in shape) for shape in shapes]
    for window in (window for item in wanted for window in _windows(item)):
        for d in range(3):
            cuts[window.block][d].update((window.lo[d], window.hi[d]))
    sides = [side for item in wanted if isinstance(item, Interface) for side in (item, reverse(item))]
    is_changed = True
    while is_changed:
        crowded = _crowded(cuts)
        if crowded is not None:
            return cuts, crowded
        changes = [_carry_cuts(cuts, side) for side in sides]
        is_changed = any(changes)
    return cuts, None


def _carry_cuts(cuts: Cuts, interface: Interface) -> bool:
    """Carry the cuts of side a over to side b; whether anything is new."""
    is_changed = False
    for d, (p, flip) in enumerate(zip(interface.orientation.perm, interface.orientation.flip)):
        if interface.a.lo[d] == interface.a.hi[d]:
            continue
        there = cuts[interface.b.block][p]
        inside = [c for c in cuts[interface.a.block][d] if interface.a.lo[d] < c < interface.a.hi[d]]
        carried = {_carried(interface, d, p, flip, c) for c in inside}
        is_changed |= not carried <= there
        there |= carried
    return is_changed


def _crowded(cuts: Cuts) -> int | None:
    """Find the first block cut into too many segments."""
    for block, directions in enumerate(cuts):
        if np.prod([max(len(cut) - 1, 1) for cut in directions]) > MAX_SEGMENTS:
            return block
    return None
