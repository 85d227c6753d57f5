"""Decomposition of a set of quads into rectangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Rectangle:
    """Quads ``lo <= index <= hi`` of a face, inclusive."""

    lo: tuple[int, int]
    hi: tuple[int, int]


def decompose(mask: np.ndarray, limit: int | None = None) -> list[Rectangle]:
    """Cut the True part of a mask into rectangles, the largest first.

    Parameters
    ----------
    mask : ndarray of bool, shape (n, m)
        The set.
    limit : int, optional
        Stop after so many rectangles; the rest is left out.
    """
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


def _largest(mask: np.ndarray, heights: np.ndarray, widths: np.ndarray):
    """Corners (start, end) of the True rectangle of largest area; rows and columns have heights and widths."""
    best, corners = 0, None
    ends = np.concatenate(([0], np.cumsum(widths)))
    for p0 in range(len(mask)):
        is_open = np.logical_and.accumulate(mask[p0:], axis=0)
        start = np.maximum.accumulate(np.where(is_open, 0, np.arange(1, mask.shape[1] + 1)), axis=1)
        area = np.where(is_open, ends[1:] - ends[start], 0) * np.cumsum(heights[p0:])[:, None]
        p1, q1 = np.unravel_index(np.argmax(area), area.shape)
        if area[p1, q1] > best:
            best, corners = area[p1, q1], ((p0, start[p1, q1]), (p0 + p1 + 1, q1 + 1))
    return corners
