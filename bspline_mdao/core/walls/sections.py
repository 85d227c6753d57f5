"""Transfinite interpolation of the edges, faces and interiors of many pieces, and its transpose.

Values at the ends of a section, in each of its directions, are interpolated to its inner points by the Boolean sum of
projectors of Gordon and Hall, in proportion to arc lengths of the baseline.

W. J. Gordon and C. A. Hall, "Construction of curvilinear co-ordinate systems and applications to mesh generation",
International Journal for Numerical Methods in Engineering 7, 1973.

Theory: ``docs/theory/asked_walls.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from ...base.display import OneLine
from ...grids.topology.index_space import sections_of, whole_slices
from ...grids.topology.node_numbering import NodeNumbering

__all__ = ["Sections"]


@dataclass(frozen=True, eq=False)
class Sections(OneLine):
    """Edges, faces or interiors of pieces, one after the other in flat arrays."""

    shapes: np.ndarray  # (n, 3) of int, points of each section by direction
    starts: np.ndarray  # (n, 4) of int, first row of each section, and its first blend in each direction
    # of int, rows in the grid vector of its points in C order; -1 for inner points whose displacement is known
    rows: np.ndarray
    blends: np.ndarray  # places of its points between the two ends of each direction, from 0 to 1

    @classmethod
    def of(
        cls, pieces: Sequence[tuple[np.ndarray, np.ndarray]], n_free: int, is_done: np.ndarray, is_moving: np.ndarray
    ) -> Sections:
        """Gather the sections of some free directions."""
        # Sections whose points are all done are skipped, and so are sections with nothing that moves at their ends.
        # Gathered ones are marked as done, and as moving.
        found = []
        for ids, points in pieces:
            for section in sections_of(ids.shape, n_free):
                axes = sorted(range(3), key=lambda d: section[d] is None)  # the last direction is free
                here = ids[whole_slices(section)].transpose(axes).astype(np.int32)
                inside = _inside(here.shape)
                inner = here[inside].copy()
                is_fresh = _first_of_each(inner) & ~is_done[inner]
                if not is_fresh.any():
                    continue
                is_done[inner[is_fresh]] = True
                here[inside] = -1
                if not is_moving[here[here >= 0]].any():
                    continue
                here[inside] = np.where(is_fresh, inner, -1)
                is_moving[inner[is_fresh]] = True
                found.append((here, _blends(points[whole_slices(section)].transpose(*axes, 3))))
        return cls._joined(found)

    @classmethod
    def _joined(cls, found: list[tuple[np.ndarray, list[np.ndarray]]]) -> Sections:
        """Join sections, each with the rows of its points and its blends in every direction."""
        sizes = np.array([(here.size, sum(here.shape)) for here, _ in found], dtype=np.int64).reshape(-1, 2)
        firsts = np.cumsum(sizes, axis=0) - sizes
        starts = [(n, *(at + np.cumsum([0, *here.shape[:2]]))) for (here, _), (n, at) in zip(found, firsts.tolist())]
        return cls(
            np.array([here.shape for here, _ in found], dtype=np.int64).reshape(-1, 3),
            np.array(starts, dtype=np.int64).reshape(-1, 4),
            np.concatenate([np.zeros(0, dtype=np.int32), *(here.ravel() for here, _ in found)]),
            np.concatenate([np.zeros(0), *(line for _, lines in found for line in lines)]),
        )

    def part(self, is_wanted: np.ndarray) -> Sections:
        """The sections that contain wanted nodes, by rows; nodes that these depend on are also marked as wanted."""
        found = []
        for shape, (first, *starts) in zip(self.shapes[::-1], self.starts[::-1]):
            here = self.rows[first : first + np.prod(shape)].reshape(shape).copy()
            inside = _inside(here.shape)
            inner = here[inside].copy()
            is_kept = (inner >= 0) & is_wanted[inner]
            if is_kept.any():
                here[inside] = -1
                is_wanted[here[here >= 0]] = True
                here[inside] = np.where(is_kept, inner, -1)
                found.append((here, [self.blends[start : start + n] for start, n in zip(starts, shape)]))
        return self._joined(found[::-1])

    def among(self, numbering: NodeNumbering) -> Sections:
        """The same sections with the nodes of a numbering."""
        rows = np.where(self.rows >= 0, numbering.numbers_of(self.rows), -1).astype(np.int32)
        return replace(self, rows=rows)

    def fill(self, values: np.ndarray) -> None:
        """Interpolate values, shape (n_nodes, 3), at the inner points of all sections, in place."""
        _fill(self.shapes, self.starts, self.rows, self.blends, values)

    def fill_transpose(self, bars: np.ndarray) -> None:
        """Transpose of `fill`: add the values of inner points to the boundary of every section, in place."""
        _fill_transpose(self.shapes, self.starts, self.rows, self.blends, bars)

    @property
    def n_bytes(self) -> int:
        """Memory in bytes."""
        return self.shapes.nbytes + self.starts.nbytes + self.rows.nbytes + self.blends.nbytes


def _inside(shape: tuple[int, ...]) -> tuple[slice, ...]:
    """Slices that cut the inner points out of a section, between the ends of its free directions."""
    return tuple(slice(1, -1) if n > 1 else slice(None) for n in shape)


def _first_of_each(ids: np.ndarray) -> np.ndarray:
    """Mask of the first occurrence of each number: a folded section has points twice."""
    is_first = np.zeros(ids.size, dtype=bool)
    is_first[np.unique(ids, return_index=True)[1]] = True
    return is_first.reshape(ids.shape)


def _blends(points: np.ndarray) -> list[np.ndarray]:
    """Places of points, shape (n0, n1, n2, 3), between the ends of each direction: mean arc lengths of its edges."""
    blends = []
    for d in range(3):
        edges = points[
            tuple(
                slice(None) if axis == d else slice(None, None, max(n - 1, 1))
                for axis, n in enumerate(points.shape[:3])
            )
        ]
        sums = np.cumsum(np.linalg.norm(np.diff(edges, axis=d), axis=-1).sum(axis=tuple(a for a in range(3) if a != d)))
        n = points.shape[d]
        is_line = n > 1 and sums[-1] > 0.0
        blends.append(np.concatenate([[0.0], sums / sums[-1]]) if is_line else np.linspace(0.0, 1.0, n))
    return blends


@njit(cache=True, nogil=True, error_model="numpy")
def _fill(shapes, starts, rows, blends, values):
    """Boolean sum I - (I - P0) (I - P1) (I - P2) = P2 + P1 (I - P2) + P0 (I - P1) (I - P2) in every section."""
    # P_d, the interpolation along direction d, takes part if the direction has more than one point.
    for number in range(len(shapes)):
        ids, (b0, b1, b2), part = _section(number, shapes, starts, rows, blends)
        e0, e1, e2 = _ends(ids.shape)
        _exchange(ids, b1, b2, part, values, e0, e1, e2, False)
        n0, n1, n2 = ids.shape
        first, stop = part[2], max(n2 - 1, 1)
        line = np.empty((3, n2))
        for i in range(part[0], max(n0 - 1, 1)):
            for j in range(part[1], max(n1 - 1, 1)):
                s, t = b0[i], b1[j]
                for c in range(3):
                    low0, high0, low1, high1 = e0[0, j, c], e0[1, j, c], e1[0, i, c], e1[1, i, c]
                    low2, high2 = e2[0, i, j, c], e2[1, i, j, c]
                    for k in range(first, stop):
                        u = (1.0 - s) * low0[k] + s * high0[k] + ((1.0 - t) * low1[k] + t * high1[k])
                        line[c, k] = u + ((1.0 - b2[k]) * low2 + b2[k] * high2)
                at = ids[i, j]
                for k in range(first, stop):
                    if at[k] >= 0:
                        values[at[k], 0] = line[0, k]
                        values[at[k], 1] = line[1, k]
                        values[at[k], 2] = line[2, k]


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_transpose(shapes, starts, rows, blends, bars):
    """Transpose of `_fill`: values of inner points are added to the boundary of every section."""
    for number in range(len(shapes)):
        ids, (b0, b1, b2), part = _section(number, shapes, starts, rows, blends)
        e0, e1, e2 = _ends(ids.shape)
        n0, n1, n2 = ids.shape
        first, stop = part[2], max(n2 - 1, 1)
        line = np.empty((3, n2))
        for i in range(part[0], max(n0 - 1, 1)):
            for j in range(part[1], max(n1 - 1, 1)):
                at = ids[i, j]
                for k in range(first, stop):
                    is_set = at[k] >= 0
                    for c in range(3):
                        line[c, k] = bars[at[k], c] if is_set else 0.0
                s, t = b0[i], b1[j]
                for c in range(3):
                    low0, high0, low1, high1 = e0[0, j, c], e0[1, j, c], e1[0, i, c], e1[1, i, c]
                    for k in range(first, stop):
                        bar = line[c, k]
                        low0[k] += (1.0 - s) * bar
                        high0[k] += s * bar
                        low1[k] += (1.0 - t) * bar
                        high1[k] += t * bar
                for k in range(first, stop):
                    for c in range(3):
                        e2[0, i, j, c] += (1.0 - b2[k]) * line[c, k]
                        e2[1, i, j, c] += b2[k] * line[c, k]
        _exchange(ids, b1, b2, part, bars, e0, e1, e2, True)


@njit(cache=True, nogil=True, error_model="numpy")
def _section(number, shapes, starts, rows, blends):
    """Rows and blends of a section, and 1 for each direction that takes part, which is also its first inner point."""
    n0, n1, n2 = shapes[number]
    at, s0, s1, s2 = starts[number]
    ids = rows[at : at + n0 * n1 * n2].reshape((n0, n1, n2))
    blend = (blends[s0 : s0 + n0], blends[s1 : s1 + n1], blends[s2 : s2 + n2])
    return ids, blend, (int(n0 > 1), int(n1 > 1), int(n2 > 1))


@njit(cache=True, nogil=True, error_model="numpy")
def _ends(shape):
    """Zeros for the values to interpolate along each direction, at both of its ends."""
    n0, n1, n2 = shape
    return np.zeros((2, n1, 3, n2)), np.zeros((2, n0, 3, n2)), np.zeros((2, n0, n1, 3))


@njit(cache=True, nogil=True, error_model="numpy")
def _exchange(ids, b1, b2, part, values, e0, e1, e2, is_transpose):
    """Write U at the ends of direction 2, (I - P2) U at the ends of 1, and (I - P1) (I - P2) U at the ends of 0."""
    # The transpose adds the values at these ends to ``values``.
    n0, n1 = ids.shape[:2]
    for e in range(2):
        if part[2]:
            for i in range(part[0], max(n0 - 1, 1)):
                for j in range(part[1], max(n1 - 1, 1)):
                    for c in range(3):
                        if is_transpose:
                            values[ids[i, j, -e], c] += e2[e, i, j, c]
                        else:
                            e2[e, i, j, c] = values[ids[i, j, -e], c]
        if part[1]:
            for i in range(part[0], max(n0 - 1, 1)):
                _exchange_line(ids[i, -e], b2, part[2], values, 1.0, e1[e, i], is_transpose)
        if part[0]:
            for j in range(part[1], max(n1 - 1, 1)):
                _exchange_line(ids[-e, j], b2, part[2], values, 1.0, e0[e, j], is_transpose)
                if part[1]:
                    _exchange_line(ids[-e, 0], b2, part[2], values, b1[j] - 1.0, e0[e, j], is_transpose)
                    _exchange_line(ids[-e, -1], b2, part[2], values, -b1[j], e0[e, j], is_transpose)


@njit(cache=True, nogil=True, error_model="numpy")
def _exchange_line(at, b2, has_2, values, factor, line, is_transpose):
    """Add (I - P2) U times a factor to the inner points of a line of direction 2; the transpose adds to ``values``."""
    first, last = at[0], at[-1]
    for k in range(has_2, max(len(at) - 1, 1)):
        for c in range(3):
            if is_transpose:
                bar = factor * line[c, k]
                values[at[k], c] += bar
                if has_2:
                    values[first, c] -= (1.0 - b2[k]) * bar
                    values[last, c] -= b2[k] * bar
            else:
                u = values[at[k], c]
                if has_2:
                    u -= (1.0 - b2[k]) * values[first, c] + b2[k] * values[last, c]
                line[c, k] += factor * u
