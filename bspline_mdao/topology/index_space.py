"""Index spaces of structured blocks: windows, faces and the maps between them.

A block of ``ni x nj x nk`` nodes owns the index space ``(0..ni-1, 0..nj-1, 0..nk-1)``. A `Window` is a closed box in
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
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

FACE_NAMES = ("imin", "imax", "jmin", "jmax", "kmin", "kmax")
"""Face ``2 d + s`` is the low (s = 0) or high (s = 1) end of direction d."""


@dataclass(frozen=True)
class Window:
    """A closed box ``lo <= index <= hi`` of the index space of one block.

    Parameters
    ----------
    block : int
        Block number, from 0.
    lo, hi : tuple of int
        Lowest and highest node index in each direction, inclusive, from 0.
    """

    block: int
    lo: tuple[int, int, int]
    hi: tuple[int, int, int]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of nodes in each direction."""
        return tuple(h - l + 1 for l, h in zip(self.lo, self.hi))

    @property
    def slices(self) -> tuple[slice, slice, slice]:
        """Slices that cut the window out of an array of the block's shape."""
        return tuple(slice(l, h + 1) for l, h in zip(self.lo, self.hi))

    @classmethod
    def whole(cls, block: int, shape) -> Window:
        """The window that covers a block of ``shape`` nodes."""
        return cls(block, (0, 0, 0), tuple(int(n) - 1 for n in shape[:3]))

    def contains(self, other: Window) -> bool:
        """Whether another window lies in this one."""
        ends = zip(self.lo, other.lo, other.hi, self.hi)
        return self.block == other.block and all(a <= b and c <= d for a, b, c, d in ends)

    def overlaps(self, other: Window) -> bool:
        """Whether two windows of a block share cells, or cells of one face where they are flat."""
        ends = zip(self.lo, self.hi, other.lo, other.hi)
        return self.block == other.block and all(max(a, c) < min(b, d) or a == b == c == d for a, b, c, d in ends)

    def is_on_face(self, shape) -> bool:
        """Whether the window lies in a block of ``shape`` nodes, on one of its faces, and is no line or point of it."""
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
    """Sort windows into the blocks that hold them."""
    sorted_windows: dict[int, list[Window]] = {}
    for window in windows:
        sorted_windows.setdefault(window.block, []).append(window)
    return sorted_windows


def _put(index: tuple[int, int, int], d: int, value: int) -> tuple[int, int, int]:
    return index[:d] + (value,) + index[d + 1 :]


@dataclass(frozen=True)
class Orientation:
    """A signed permutation of directions that carries one index space onto another.

    Direction ``d`` of the first space runs along direction ``perm[d]`` of the second, backwards where ``flip[d]``.

    Parameters
    ----------
    perm : tuple of int
        A permutation of (0, 1, 2).
    flip : tuple of bool
        Whether each direction of the first space runs backwards in the second.
    """

    perm: tuple[int, int, int] = (0, 1, 2)
    flip: tuple[bool, bool, bool] = (False, False, False)

    def apply(self, array: np.ndarray) -> np.ndarray:
        """View ``array``, indexed by the second space, in the index order of the first."""
        view = array.transpose(self.perm + tuple(range(3, array.ndim)))
        return view[tuple(slice(None, None, -1) if f else slice(None) for f in self.flip)]

    def inverse(self) -> Orientation:
        """The orientation that carries the second space back onto the first."""
        perm, flip = [0, 0, 0], [False] * 3
        for d, (p, f) in enumerate(zip(self.perm, self.flip)):
            perm[p], flip[p] = d, f
        return Orientation(tuple(perm), tuple(flip))
