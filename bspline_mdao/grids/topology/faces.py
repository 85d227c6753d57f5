"""Faces of blocks as surfaces of quads, their collapsed parts, and sets of quads cut into rectangles.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.numerics.vectors import unit_vectors
from .index_space import Window, face_layers
from .shell import OnFaces, Shell

TINY = np.finfo(float).tiny
"""Length (m) below which a vector has no direction."""


@dataclass(frozen=True)
class Face:
    """One face of a block with the points on which its nodes lie."""

    # A face of a block that is one node deep is a line: its quads are segments, flat in one tangent direction.

    window: Window  # the whole face
    normal: int  # the direction in which the face is flat
    is_high: bool  # whether it is the high end of that direction
    ids: np.ndarray  # (n, m) of int, point of each node, over the tangent directions in ascending order

    @property
    def tangents(self) -> tuple[int, ...]:
        """Directions of the block along the face, ascending."""
        return tuple(d for d in range(3) if d != self.normal)

    @property
    def n_quads(self) -> tuple[int, ...]:
        """Number of quads in each tangent direction; one if the face is one node wide."""
        return tuple(max(n - 1, 1) for n in self.ids.shape)

    @property
    def is_line(self) -> bool:
        """Whether the face is one node wide."""
        return 1 in self.ids.shape

    def quads(self) -> np.ndarray:
        """Points at the corners of each quad, shape (n_quads, 4), corner p + 2 q at the end p, q of the tangents."""
        return quad_corners(self.ids).reshape(-1, 4)

    def part(self, rectangle: Rectangle) -> Window:
        """Return the window that covers a rectangle of quads."""
        lo, hi = list(self.window.lo), list(self.window.hi)
        for d, n, start, end in zip(self.tangents, self.ids.shape, rectangle.lo, rectangle.hi):
            lo[d], hi[d] = start, min(end + 1, n - 1)
        return Window(self.window.block, tuple(lo), tuple(hi))

    def covered(self, window: Window) -> np.ndarray:
        """Mask of the quads that a window covers, shape `n_quads`."""
        mask = np.zeros(self.n_quads, dtype=bool)
        d = self.normal
        if window.block == self.window.block and window.lo[d] == window.hi[d] == self.window.lo[d]:
            ends = [(window.lo[t], window.hi[t] if n > 1 else 1) for t, n in zip(self.tangents, self.ids.shape)]
            mask[tuple(slice(*end) for end in ends)] = True
        return mask


def inward_directions(nodes: np.ndarray | Shell, window: Window) -> np.ndarray:
    """Return unit vectors into a block, shape (n, m, 3), from the nodes of a face window to the next layer."""
    # They are zero if the two coincide.
    face, inner = nodes.layers(window) if isinstance(nodes, Shell) else face_layers(nodes, window)
    return unit_vectors(inner - face, np.zeros_like(face), TINY)


def quad_corners(values: np.ndarray) -> np.ndarray:
    """Values at the corners of each quad, shape ``(*n_quads, 4)``, from values at the nodes of a face, shape (n, m)."""
    ends = [(slice(None, -1), slice(1, None)) if n > 1 else (slice(None), slice(None)) for n in values.shape]
    return np.stack([values[ends[0][p], ends[1][q]] for q in range(2) for p in range(2)], axis=-1)


def block_faces(ids: Sequence[OnFaces]) -> list[Face]:
    """All faces of all blocks, from the points of their nodes; for a block one node deep these are its lines."""
    faces = []
    for block, block_ids in enumerate(ids):
        whole = Window.whole(block, block_ids.shape)
        for number in range(6):
            d, side = divmod(number, 2)
            if block_ids.shape[d] > 1:
                faces.append(Face(whole.face(number), d, bool(side), block_ids.face(number)))
    return faces


def collapsed_windows(faces: Sequence[Face]) -> dict[Window, tuple[int, ...]]:
    """Face windows, and adjacent edge windows, of zero extent, with the directions of zero extent."""
    found: dict[Window, tuple[int, ...]] = {}
    for face in faces:
        for axis, d in enumerate(face.tangents):
            for window in _collapsed_faces(face, axis):
                found[window] = tuple(sorted({*found.get(window, ()), d}))
    is_in_face = _containment(found)
    for face in faces:
        for axis, d in enumerate(face.tangents):
            found.update({edge: (d,) for edge in _collapsed_edges(face, axis) if not is_in_face(edge, d)})
    return found


def _containment(windows: dict[Window, tuple[int, ...]]) -> Callable[[Window, int], bool]:
    """Return a function that says whether an edge without extent along d lies in one of the collapsed windows."""
    ends: dict[tuple[int, int], list[tuple]] = {}
    for window, directions in windows.items():
        for d in directions:
            ends.setdefault((window.block, d), []).append((window.lo, window.hi))
    arrays = {key: np.array(values) for key, values in ends.items()}

    def contains(edge: Window, d: int) -> bool:
        lo, hi = arrays.get((edge.block, d), np.empty((0, 2, 3))).transpose(1, 0, 2)
        return bool(np.any(np.all((lo <= edge.lo) & (hi >= edge.hi), axis=1)))

    return contains


def _collapsed_quads(face: Face, axis: int) -> np.ndarray:
    """Mask of the quads without extent along one tangent axis."""
    lines = _zero_edges(face, axis)
    return lines[:, :-1] & lines[:, 1:] if lines.shape[1] > 1 else lines


def _zero_edges(face: Face, axis: int) -> np.ndarray:
    """Mask of the cell edges along one tangent axis, this axis first, whose ends are one point."""
    ids = np.moveaxis(face.ids, axis, 0)
    return ids[1:] == ids[:-1]


def _collapsed_faces(face: Face, axis: int) -> list[Window]:
    """Windows of a face of zero extent along one tangent axis."""
    if face.ids.shape[axis] == 1:
        return []
    mask = np.moveaxis(_collapsed_quads(face, axis), 0, axis)
    return [face.part(rectangle) for rectangle in decompose(mask)]


def _collapsed_edges(face: Face, axis: int) -> list[Window]:
    """Lines of zero length along one tangent axis that are not part of a collapsed face."""
    other = face.tangents[1 - axis]
    windows = []
    for q in np.flatnonzero(_zero_edges(face, axis).any(axis=0)):
        for rectangle in decompose(_zero_edges(face, axis)[:, [q]]):
            lo, hi = list(face.window.lo), list(face.window.hi)
            d = face.tangents[axis]
            lo[d], hi[d] = rectangle.lo[0], rectangle.hi[0] + 1
            lo[other] = hi[other] = int(q)
            windows.append(Window(face.window.block, tuple(lo), tuple(hi)))
    return windows


@dataclass(frozen=True)
class Rectangle:
    """Quads ``lo <= index <= hi`` of a face, inclusive."""

    lo: tuple[int, ...]
    hi: tuple[int, ...]


def decompose(
    mask: np.ndarray,  # (n, m) of bool, the mask
    limit: int | None = None,  # largest number of rectangles; the rest is left out
) -> list[Rectangle]:
    """Cut the True part of a mask into rectangles, the largest first."""
    if not mask.any():
        return []
    lines = [_breaks(mask, axis) for axis in range(2)]
    left = mask[np.ix_(lines[0][:-1], lines[1][:-1])].copy()
    found: list[Rectangle] = []
    while left.any() and (limit is None or len(found) < limit):
        (p0, q0), (p1, q1) = _largest(left, np.diff(lines[0]), np.diff(lines[1]))
        left[p0:p1, q0:q1] = False
        lo = (int(lines[0][p0]), int(lines[1][q0]))
        found.append(Rectangle(lo, (int(lines[0][p1]) - 1, int(lines[1][q1]) - 1)))
    return found


def _breaks(mask: np.ndarray, axis: int) -> np.ndarray:
    """Find the indices, with both ends, at which the mask changes along an axis."""
    mask = np.moveaxis(mask, axis, 0)
    changes = np.flatnonzero(np.any(mask[1:] != mask[:-1], axis=1)) + 1
    return np.concatenate(([0], changes, [len(mask)]))


def _largest(mask: np.ndarray, heights: np.ndarray, widths: np.ndarray) -> tuple[tuple[int, int], tuple[int, int]]:
    """Corners (start, end) of the True rectangle of largest area; rows and columns have heights and widths."""
    corners: Any = None
    best = 0
    ends = np.concatenate(([0], np.cumsum(widths)))
    for p0 in range(len(mask)):
        is_open = np.logical_and.accumulate(mask[p0:], axis=0)
        start = np.maximum.accumulate(np.where(is_open, 0, np.arange(1, mask.shape[1] + 1)), axis=1)
        area = np.where(is_open, ends[1:] - ends[start], 0) * np.cumsum(heights[p0:])[:, None]
        p1, q1 = np.unravel_index(np.argmax(area), area.shape)
        if area[p1, q1] > best:
            best, corners = area[p1, q1], ((p0, start[p1, q1]), (p0 + p1 + 1, q1 + 1))
    return corners
