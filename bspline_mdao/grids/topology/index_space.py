"""Index spaces of structured blocks: windows, sections, and the maps between them.

A block of ``ni x nj x nk`` nodes has the index space ``(0..ni-1, 0..nj-1, 0..nk-1)``. A `Window` is a closed box in
it; a face, an edge, a corner or a sub-volume is a window that is flat in one, two, three or no directions::

            k
            |   jmax (behind)
          6-+-----7
         /  kmax /|          faces  imin imax jmin jmax kmin kmax  =  0 1 2 3 4 5
        4-------5 |          corners numbered  i + 2 j + 4 k
   imin |       | 3  imax
        | jmin  |/
        0-------1 --- i
          kmin

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from ...base.display import OneLine

FACE_NAMES = ("imin", "imax", "jmin", "jmax", "kmin", "kmax")
"""Face ``2 d + s`` is the low (s = 0) or high (s = 1) end of direction d."""


@dataclass(frozen=True)
class Window(OneLine):
    """A closed box ``lo <= index <= hi`` of the index space of one block.

    Parameters
    ----------
    block : int
        Block number, from 0.
    lo, hi : tuple of int
        Lowest and highest node index in each direction, inclusive, from 0.

    Examples
    --------
    >>> from bspline_mdao.grids import Window
    >>> window = Window(0, (0, 0, 0), (8, 0, 4))  # a part of the face j = 0
    >>> window.shape, window.slices[1]
    ((9, 1, 5), slice(0, 1, None))
    """

    block: int
    lo: tuple[int, ...]
    hi: tuple[int, ...]

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Number of nodes in each direction."""
        return tuple(h - l + 1 for l, h in zip(self.lo, self.hi))

    @property
    def slices(self) -> tuple[slice, ...]:
        """Slices that cut the window out of an array of the block's shape."""
        return tuple(slice(l, h + 1) for l, h in zip(self.lo, self.hi))

    @classmethod
    def whole(cls, block: int, shape: Sequence[int]) -> Window:
        """The window that covers a block of ``shape`` nodes."""
        return cls(block, (0, 0, 0), tuple(int(n) - 1 for n in shape[:3]))

    def contains(self, other: Window) -> bool:
        """Whether another window lies in this one."""
        ends = zip(self.lo, other.lo, other.hi, self.hi)
        return self.block == other.block and all(a <= b and c <= d for a, b, c, d in ends)

    def overlaps(self, other: Window) -> bool:
        """Whether two windows of a block share cells, or cells of one face if they are flat."""
        ends = zip(self.lo, self.hi, other.lo, other.hi)
        return self.block == other.block and all(max(a, c) < min(b, d) or a == b == c == d for a, b, c, d in ends)

    def is_on_face(self, shape: tuple[int, ...]) -> bool:
        """Whether the window lies on a face of a block of ``shape`` nodes, and is not a line or a point of it."""
        ends = tuple(zip(self.lo, self.hi, shape))
        n_flat = sum(lo == hi and n > 1 for lo, hi, n in ends)
        is_inside = all(0 <= lo <= hi < n for lo, hi, n in ends)
        return is_inside and n_flat <= 1 and any(lo == hi and lo in (0, n - 1) for lo, hi, n in ends)

    def face(self, face: int) -> Window:
        """Face number ``face`` (see `FACE_NAMES`) of this window."""
        d, side = divmod(face, 2)
        at = self.hi[d] if side else self.lo[d]
        return Window(self.block, _put(self.lo, d, at), _put(self.hi, d, at))


def by_blocks(windows: Iterable[Window]) -> dict[int, list[Window]]:
    """Sort windows by their blocks."""
    sorted_windows: dict[int, list[Window]] = {}
    for window in windows:
        sorted_windows.setdefault(window.block, []).append(window)
    return sorted_windows


def _put(index: tuple[int, ...], d: int, value: int) -> tuple[int, ...]:
    return index[:d] + (value,) + index[d + 1 :]


@dataclass(frozen=True)
class Orientation:
    """A signed permutation of directions that maps one index space onto another."""

    # Direction ``d`` of the first space runs along direction ``perm[d]`` of the second, backwards if ``flip[d]``.

    perm: tuple[int, ...] = (0, 1, 2)  # A permutation of (0, 1, 2)
    # whether each direction of the first space runs backwards in the second
    flip: tuple[bool, ...] = (False, False, False)

    def apply(self, array: np.ndarray) -> np.ndarray:
        """View ``array``, indexed by the second space, in the index order of the first."""
        view = array.transpose(self.perm + tuple(range(3, array.ndim)))
        return view[tuple(slice(None, None, -1) if f else slice(None) for f in self.flip)]

    def inverse(self) -> Orientation:
        """The orientation that maps the second space back onto the first."""
        perm, flip = [0, 0, 0], [False] * 3
        for d, (p, f) in enumerate(zip(self.perm, self.flip)):
            perm[p], flip[p] = d, f
        return Orientation(tuple(perm), tuple(flip))


@dataclass(frozen=True)
class Interface(OneLine):
    """Two face windows whose nodes coincide one to one."""

    # a, b: face windows of grid blocks; both may lie in one block (O and C grids), even in one face (a fold)
    a: Window
    b: Window
    # maps the directions of a's block to those of b's, the flat one to the flat one, backwards if leaving block a
    # means entering block b against its index
    orientation: Orientation

    def map_window(self, window: Window) -> Window:
        """Return the part of side b that meets a part of side a."""
        lo, hi = [0, 0, 0], [0, 0, 0]
        for d, p in enumerate(self.orientation.perm):
            lo[p], hi[p] = sorted(self.map_index(d, index) for index in (window.lo[d], window.hi[d]))
        return Window(self.b.block, tuple(lo), tuple(hi))

    def map_index(self, d: int, index: int) -> int:
        """Return the index along direction ``orientation.perm[d]`` of block b that meets an index along d of a."""
        p = self.orientation.perm[d]
        steps = index - self.a.lo[d]
        return self.b.hi[p] - steps if self.orientation.flip[d] else self.b.lo[p] + steps

    def reverse(self) -> Interface:
        """Return the interface with its sides exchanged."""
        return Interface(self.b, self.a, self.orientation.inverse())


Section = tuple[int | None, ...]
"""A face, an edge or a corner of a block or a segment: per direction 0 (low end), -1 (high end) or None (all)."""


def sections_of(shape: tuple[int, ...], n_free: int) -> list[Section]:
    """List the sections with a given number of free directions; a direction of one node has one end and is never free.

    Examples
    --------
    >>> sections_of((5, 1, 4), n_free=1)
    [(0, 0, None), (None, 0, 0), (None, 0, -1), (-1, 0, None)]
    """
    ends = [(0,) if n == 1 else (0, None, -1) for n in shape]
    return [section for section in product(*ends) if section.count(None) == n_free]


def inner_slices(section: Section) -> tuple[slice, ...]:
    """Return slices that cut the inner points of a section out of an array of its block or segment."""
    return tuple(slice(1, -1) if end is None else slice(end, end + 1 or None) for end in section)


def whole_slices(section: Section) -> tuple[slice, ...]:
    """Return slices that cut all points of a section out of an array of its block or segment."""
    return tuple(slice(None) if end is None else slice(end, end + 1 or None) for end in section)


def section_rows(shape: tuple[int, ...], section: Section, start: int = 0) -> np.ndarray:
    """Number the points of a section in the C order of the whole index space, from ``start``."""
    strides = (shape[1] * shape[2], shape[2], 1)
    axes = [np.arange(n) if end is None else np.array([end % n]) for n, end in zip(shape, section)]
    i, j, k = np.ix_(*axes)
    return start + i * strides[0] + j * strides[1] + k * strides[2]


def window_rows(window: Window, shape: Sequence[int], start: int = 0) -> np.ndarray:
    """Number the nodes of a window of a block, from ``start``: an array of the window's shape."""
    i, j, k = np.ix_(*[np.arange(lo, hi + 1) for lo, hi in zip(window.lo, window.hi)])
    return start + (i * shape[1] + j) * shape[2] + k


def face_layers(
    values: np.ndarray,  # (ni, nj, nk, ...), values at the nodes of the block
    window: Window,  # window of a face of the block; in a block one node deep, both layers are this one
) -> tuple[np.ndarray, ...]:  # face, inner: (n, m, ...), over the tangent directions in ascending order
    """Take the values at a face window of a block, and at the layer of nodes next to it."""
    flat = window.shape.index(1)
    at = window.lo[flat]
    tangents = tuple(s for d, s in enumerate(window.slices) if d != flat)
    inner = min(1, values.shape[flat] - 1) if at == 0 else at - 1
    face, inner = (np.take(values, n, axis=flat)[tangents] for n in (at, inner))
    return face, inner
