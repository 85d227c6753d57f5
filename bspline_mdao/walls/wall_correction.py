"""A correction that puts wall nodes exactly where they are given, and fades over the volume.

Control points alone put wall nodes only nearly where they are given. The mismatch is known at wall nodes. All segments
are cut into *pieces*, some `PIECE` cells long along walls and as long as the segment in all other directions. The
correction follows in three steps:

1. The corners of the pieces follow a network of springs between the walls and the rest of the boundary, which stays.
2. Edges, faces and insides of the pieces follow, in this order, by transfinite interpolation, in proportion to arc
   lengths of the baseline: the Boolean sum of projectors of Gordon and Hall.
3. Copies of nodes take what the nodes have that they copy.

So the correction fades over whole blocks, and where blocks are thin, beyond them.

W. J. Gordon and C. A. Hall, "Construction of curvilinear co-ordinate systems and applications to mesh generation",
International Journal for Numerical Methods in Engineering 7, 1973.

Theory: ``docs/theory/asked_walls.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
from numba import njit
from scipy import sparse

from ..numerics.vectors import nearest_plane
from ..sparse.spring_network import SpringNetwork
from ..topology.held_nodes import HeldNodes
from ..topology.index_space import Window, block_rows, sections_of, whole_slices
from ..topology.sharing import direction_classes, node_sharing
from ..topology.topology import Topology

__all__ = ["WallCorrection"]

PIECE = 8
"""Cells of a piece along walls: the correction goes on beyond thin blocks at this resolution."""

INDEPENDENT = 1e-3
"""Least singular value of independent normals: planes that meet at a smaller angle (rad) are one but for round-off."""


@dataclass(frozen=True, eq=False)
class WallCorrection:
    """The linear map from the displacement of wall nodes to that of all nodes, and its transpose.

    It reproduces the displacement of the wall, is zero on all other boundaries but within a segment of where a wall
    ends on them, and keeps nodes in planes of symmetry if the displacement of the wall does. Made by
    `WallCorrection.of`.

    Parameters
    ----------
    rows : ndarray of int, shape (n_wall,)
        Rows of the wall nodes in the grid vector.
    wall_ids : ndarray of int, shape (n_corners_on_wall,)
        Which of them are corners of pieces.
    corner_rows : ndarray of int, shape (n_corners,)
        Rows of the corners that follow the network.
    corner_ids : ndarray of int, shape (n_corners,)
        Which of the network's free points they are.
    network : SpringNetwork
        Their displacement from that of the wall's corners.
    levels : tuple of Sections
        Edges, faces and insides of the pieces.
    copies : ndarray of int, shape (n_copies, 2)
        Rows that are copies, and the rows that they copy.
    n_nodes : int
        Rows of the grid vector.
    """

    rows: np.ndarray
    wall_ids: np.ndarray
    corner_rows: np.ndarray
    corner_ids: np.ndarray
    network: SpringNetwork
    levels: tuple[Sections, ...]
    copies: np.ndarray
    n_nodes: int

    @classmethod
    def of(cls, topology: Topology, nodes: np.ndarray, rows: np.ndarray) -> WallCorrection:
        """Prepare the map of a baseline grid.

        Parameters
        ----------
        topology : Topology
            Topology of the grid.
        nodes : ndarray, shape (n_nodes, 3)
            The baseline (m).
        rows : ndarray of int, shape (n_wall,)
            Rows in the grid vector of the nodes whose displacement is known, each shared node once.

        Returns
        -------
        WallCorrection
        """
        sharing, whole = node_sharing(topology), block_rows(topology.shapes)
        source = sharing.source_rows()
        wall = source[rows]
        place = np.full(topology.n_nodes, -1)
        place[wall] = np.arange(len(rows))
        is_done, is_moving = place >= 0, place >= 0
        windows = list(_pieces(topology, source, place >= 0))
        pieces = [(source[whole[w.block][w.slices]], nodes[whole[w.block][w.slices]]) for w in windows]
        corners = np.unique(np.concatenate([ids[_CORNERS].ravel() for ids, _ in pieces]))
        is_fixed = np.isin(corners, _fixed_rows(topology, source)) & (place[corners] < 0)
        flat = [whole[f.window.block][f.window.slices].ravel() for f in topology.boundary if f.kind == "symmetry"]
        normals = [(np.isin(corners, source[members]), nearest_plane(nodes[members])[0]) for members in flat]
        network = SpringNetwork.of(
            len(corners),
            _edge_lengths(pieces, corners),
            np.flatnonzero(place[corners] >= 0),
            np.flatnonzero(is_fixed),
            lambda ids: _directions(ids, normals),
        )
        is_done[corners] = is_moving[corners[network.ids]] = True
        levels = tuple(Sections.of(pieces, n_free, is_done, is_moving) for n_free in (1, 2, 3))
        wall_ids = place[corners[place[corners] >= 0]]
        free = corners[network.ids]
        return cls(wall, wall_ids, free, np.arange(len(free)), network, levels, sharing.copies, topology.n_nodes)

    def part(self, rows: np.ndarray) -> WallCorrection:
        """Return what the correction of some nodes depends on; of all others it is zero.

        Parameters
        ----------
        rows : ndarray of int
            Rows of nodes that are no copies.
        """
        is_wanted = np.zeros(self.n_nodes, dtype=bool)
        is_wanted[rows] = True
        levels = [level.part(is_wanted) for level in self.levels[::-1]][::-1]
        ids = np.flatnonzero(is_wanted[self.corner_rows])
        return replace(self, corner_rows=self.corner_rows[ids], corner_ids=self.corner_ids[ids], levels=tuple(levels))

    @property
    def needed(self) -> np.ndarray:
        """Rows of all nodes that take part, ascending."""
        inner = [level.rows[level.rows >= 0] for level in self.levels]
        return np.unique(np.concatenate([self.rows, self.corner_rows, *inner]))

    def among(self, held: HeldNodes) -> WallCorrection:
        """Return the same for nodes that are numbered as some hold them, all that are `needed` among them."""
        return replace(
            self,
            rows=held.numbers_of(self.rows),
            corner_rows=held.numbers_of(self.corner_rows),
            levels=tuple(level.among(held) for level in self.levels),
            copies=held.copies,
            n_nodes=held.n_nodes,
        )

    @property
    def n_bytes(self) -> int:
        """Memory that it takes (B)."""
        return sum(level.n_bytes for level in self.levels) + self.rows.nbytes + self.copies.nbytes

    def meet(self, nodes: np.ndarray, wall: np.ndarray) -> np.ndarray:
        """Correct nodes, shape (n_nodes, 3), in place, so that those of the wall are where they are given.

        Parameters
        ----------
        nodes : ndarray, shape (n_nodes, 3)
            Nodes (m), overwritten by the corrected ones.
        wall : ndarray, shape (n_wall, 3)
            Where the wall nodes are to be (m).

        Returns
        -------
        ndarray, shape (n_wall, 3)
            The mismatch before (m).
        """
        mismatch = wall - nodes[self.rows]
        if mismatch.any():
            nodes += self.forward(mismatch)
            nodes[self.rows] = wall  # to the last bit: up to round-off it is there already
            nodes[self.copies[:, 0]] = nodes[self.copies[:, 1]]
        return mismatch

    def forward(self, mismatch: np.ndarray) -> np.ndarray:
        """Displacements (m) of all nodes, shape (n_nodes, 3), from those of the wall nodes, shape (n_wall, 3)."""
        values = np.zeros((self.n_nodes, 3))
        values[self.rows] = mismatch
        values[self.corner_rows] = self.network.dot(mismatch[self.wall_ids])[self.corner_ids]  # step 1
        for level in self.levels:  # step 2
            _fill(*level.arrays, values)
        values[self.copies[:, 0]] = values[self.copies[:, 1]]
        return values

    def adjoint(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `forward`: (n_nodes, 3) to (n_wall, 3)."""
        bars = bar.copy()
        _add_at(bars, self.copies[:, 1], self.copies[:, 0])  # step 3, transposed, and so on backwards
        for level in self.levels[::-1]:
            _fill_transpose(*level.arrays, bars)
        wall_bar = bars[self.rows]
        corner_bars = np.zeros((len(self.network.ids), 3), dtype=bars.dtype)
        corner_bars[self.corner_ids] = bars[self.corner_rows]
        wall_bar[self.wall_ids] += self.network.transpose_dot(corner_bars)
        return wall_bar


@dataclass(frozen=True, eq=False)
class Sections:
    """Edges, faces or insides of pieces, one after the other in flat arrays.

    Parameters
    ----------
    shapes : ndarray of int, shape (n, 3)
        Points of each section by direction.
    starts : ndarray of int, shape (n, 4)
        First row of each section, and its first blend in each direction.
    rows : ndarray of int32
        Rows in the grid vector of its points in C order; -1 for inner points that have their displacement already.
    blends : ndarray
        Places of its points between the two ends of each direction, from 0 to 1.
    """

    shapes: np.ndarray
    starts: np.ndarray
    rows: np.ndarray
    blends: np.ndarray

    @classmethod
    def of(cls, pieces, n_free: int, is_done: np.ndarray, is_moving: np.ndarray) -> Sections:
        """Gather the sections of some free directions.

        Sections without a point that is not done are skipped, and so are those with nothing that moves at their ends.
        What is gathered is marked as done, and as moving.
        """
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
        """Return the sections that wanted nodes are in, by rows; what these depend on is marked as wanted as well."""
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

    def among(self, held: HeldNodes) -> Sections:
        """Return the same with nodes numbered as some hold them."""
        rows = np.where(self.rows >= 0, held.numbers_of(self.rows), -1).astype(np.int32)
        return replace(self, rows=rows)

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """Arrays in the order in which the kernels take them."""
        return self.shapes, self.starts, self.rows, self.blends

    @property
    def n_bytes(self) -> int:
        """Memory that it takes (B)."""
        return sum(array.nbytes for array in self.arrays)


_CORNERS = np.ix_(*[(0, -1)] * 3)


def _pieces(topology: Topology, source: np.ndarray, is_wall: np.ndarray) -> Iterator[Window]:
    """Cut all segments into pieces, alike where they are linked: in directions that run along walls and leave none."""
    classes, whole = direction_classes(topology), block_rows(topology.shapes)
    along: set[int] = set()
    leaving: set[int] = set()
    for number, side in np.ndindex(len(classes), 6):
        face = topology.segments[number].face(side)
        if is_wall[source[whole[face.block][face.slices]]].all():
            leaving.add(classes[number, side // 2])
            along.update(np.delete(classes[number], side // 2))
    for number, segment in enumerate(topology.segments):
        cuts = [
            lo + _cuts(hi - lo) if classes[number, d] in along - leaving and lo < hi else [lo, hi]
            for d, (lo, hi) in enumerate(zip(segment.lo, segment.hi))
        ]
        for spans in product(*(list(pairwise(cut)) if cut[0] < cut[-1] else [(cut[0], cut[0])] for cut in cuts)):
            yield Window(segment.block, *zip(*(tuple(map(int, span)) for span in spans)))


def _cuts(n_cells: int) -> np.ndarray:
    """Cut a number of cells into pieces of about `PIECE`, in the same places from both ends.

    Examples
    --------
    >>> _cuts(21)
    array([ 0,  7, 14, 21])
    """
    n = -(-n_cells // PIECE)
    n += n % 2 == 0 and n_cells % 2 == 1  # else the middle cut would be nearer to one end
    low = np.arange(n // 2 + 1) * n_cells // n
    return np.concatenate([low, np.unique(n_cells - low)[n % 2 == 0 :]])


def _fixed_rows(topology: Topology, source: np.ndarray) -> np.ndarray:
    """Rows of all boundary nodes but those of planes of symmetry alone: they stay."""
    whole = block_rows(topology.shapes)
    windows = [face.window for face in topology.boundary if face.kind != "symmetry"]
    return np.unique(np.concatenate([np.zeros(0, int), *(source[whole[w.block][w.slices]].ravel() for w in windows)]))


def _edge_lengths(pieces, corners: np.ndarray) -> dict[tuple[int, int], float]:
    """Lengths of the edges of all pieces (m) by their ends, numbers of corners."""
    lengths = {}
    for ids, points in pieces:
        for section in sections_of(ids.shape, n_free=1):
            edge = ids[whole_slices(section)].ravel()
            ends = tuple(np.sort(np.searchsorted(corners, edge[[0, -1]])).tolist())
            length = np.linalg.norm(np.diff(points[whole_slices(section)].reshape(-1, 3), axis=0), axis=1).sum()
            if length > 0.0:
                lengths[ends] = float(length)
    return lengths


def _directions(ids: np.ndarray, planes) -> sparse.csr_array:
    """Directions in which corners may move as orthonormal columns: all, or those of the planes that they are in."""
    blocks = [_complement([normal for is_member, normal in planes if is_member[n]]) for n in ids]
    return sparse.csr_array(sparse.block_diag(blocks, format="csr")) if blocks else sparse.csr_array((0, 0))


def _complement(normals: list[np.ndarray]) -> np.ndarray:
    """Orthonormal columns, shape (3, n), of what is normal to some unit normals; exact for those along axes."""
    matrix = np.array(normals).reshape(-1, 3)
    if (np.abs(matrix).max(axis=1) == 1.0).all():
        return np.delete(np.eye(3), np.flatnonzero((matrix != 0.0).any(axis=0)), axis=1)
    _, sizes, rows = np.linalg.svd(matrix)
    return rows[np.count_nonzero(sizes > INDEPENDENT) :].T


def _inside(shape: tuple[int, ...]) -> tuple[slice, ...]:
    """Slices that cut the inner points out of a section: those between the ends of its free directions."""
    return tuple(slice(1, -1) if n > 1 else slice(None) for n in shape)


def _first_of_each(ids: np.ndarray) -> np.ndarray:
    """Mask of the first occurrence of each number: a folded section holds points twice."""
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
    """Boolean sum I - (I - P0) (I - P1) (I - P2) = P2 + P1 (I - P2) + P0 (I - P1) (I - P2) in every section.

    P_d, the interpolation along direction d, takes part where the direction has more than one point.
    """
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
    """Transpose of `_fill`: what the inner points have is added to the boundary of every section."""
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
    """Rows and blends of a section, and for each direction 1 where it takes part: also its first inner point."""
    n0, n1, n2 = shapes[number]
    at, s0, s1, s2 = starts[number]
    ids = rows[at : at + n0 * n1 * n2].reshape((n0, n1, n2))
    blend = (blends[s0 : s0 + n0], blends[s1 : s1 + n1], blends[s2 : s2 + n2])
    return ids, blend, (int(n0 > 1), int(n1 > 1), int(n2 > 1))


@njit(cache=True, nogil=True, error_model="numpy")
def _ends(shape):
    """Zeros for what is interpolated along each direction, at both of its ends."""
    n0, n1, n2 = shape
    return np.zeros((2, n1, 3, n2)), np.zeros((2, n0, 3, n2)), np.zeros((2, n0, n1, 3))


@njit(cache=True, nogil=True, error_model="numpy")
def _exchange(ids, b1, b2, part, values, e0, e1, e2, is_transpose):
    """Write U at the ends of direction 2, (I - P2) U at those of 1, and (I - P1) (I - P2) U at those of 0.

    The transpose adds what is at these ends to ``values``.
    """
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


@njit(cache=True, nogil=True, error_model="numpy")
def _add_at(values, rows, terms):
    """Add rows of an array to others of its rows."""
    for n in range(len(rows)):
        for c in range(3):
            values[rows[n], c] += values[terms[n], c]
