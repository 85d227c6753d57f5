"""A correction that puts wall nodes exactly where they are given, and fades over the volume.

Control points put wall nodes only approximately where they are given. The mismatch is known at wall nodes. All segments
are cut into *pieces*, about `PIECE` cells long along walls and as long as the segment in all other directions. The
correction follows in three steps:

1. The corners of the pieces follow a network of springs between the walls and the rest of the boundary, which stays.
2. Edges, faces and interiors of the pieces follow, in this order, by transfinite interpolation (see `.sections`).
3. Copies of nodes take the values of their originals.

So the correction fades over whole blocks, and where blocks are thin, beyond them.

Theory: ``docs/theory/asked_walls.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
from numba import njit
from scipy import sparse

from ...base.display import OneLine
from ...base.numerics.mean_planes import mean_planes
from ...base.sparse.spring_network import SpringNetwork
from ...grids.topology.index_space import Window, sections_of, whole_slices
from ...grids.topology.node_numbering import NodeNumbering
from ...grids.topology.sharing import direction_classes, node_sharing
from ...grids.topology.topology import Topology
from .sections import Sections

__all__ = ["WallCorrection"]

PIECE = 8
"""Cells of a piece along walls: the correction continues beyond thin blocks at this resolution."""

INDEPENDENT = 1e-3
"""Least singular value of independent normals: planes at a smaller angle (rad) are one up to round-off."""


@dataclass(frozen=True, eq=False)
class WallCorrection(OneLine):
    """The linear map from displacements of wall nodes to displacements of all nodes, and its transpose.

    It reproduces the displacement of the wall and is zero on all other boundaries, except within a segment of where a
    wall ends on them. It keeps nodes in planes of symmetry if the displacement of the wall does. Made by
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
        Their displacement from the displacement of the wall's corners.
    levels : tuple of Sections
        Edges, faces and interiors of the pieces.
    copies : ndarray of int, shape (n_copies, 2)
        Rows that are copies, and the rows that they copy.
    n_nodes : int
        Rows of the grid vector.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import SurfaceGrid
    >>> from bspline_mdao.movers import WallCorrection
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> nodes, surface = model.regenerate().to_vector().reshape(-1, 3), SurfaceGrid.of(model)
    >>> correction = WallCorrection.of(model.topology, nodes, surface.rows)
    >>> wall = nodes[surface.rows] + [0.0, 0.01, 0.0]
    >>> _ = correction.meet(nodes, wall)
    >>> bool(np.abs(nodes[surface.rows] - wall).max() < 1e-13)
    True
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
    def of(
        cls,
        topology: Topology,  # topology of the grid
        nodes: np.ndarray,  # (n_nodes, 3), the baseline (m)
        # (n_wall,) of int, rows in the grid vector of the nodes with known displacement, shared ones once
        rows: np.ndarray,
    ) -> WallCorrection:
        """Prepare the map of a baseline grid."""
        sharing, whole = node_sharing(topology), topology.layout.numbers
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
        planes = mean_planes([nodes[members] for members in flat])
        normals = [(np.isin(corners, source[members]), plane.normal) for members, plane in zip(flat, planes)]
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

    def part(
        self,
        rows: np.ndarray,  # of int, rows of nodes that are not copies
    ) -> WallCorrection:
        """The part of the correction that some nodes depend on; it is zero for all others."""
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

    def among(self, numbering: NodeNumbering) -> WallCorrection:
        """The same correction for the nodes of a numbering, which must include all that are `needed`."""
        return replace(
            self,
            rows=numbering.numbers_of(self.rows),
            corner_rows=numbering.numbers_of(self.corner_rows),
            levels=tuple(level.among(numbering) for level in self.levels),
            copies=numbering.copies,
            n_nodes=numbering.n_nodes,
        )

    @property
    def n_bytes(self) -> int:
        """Memory in bytes."""
        return sum(level.n_bytes for level in self.levels) + self.rows.nbytes + self.copies.nbytes

    def meet(
        self,
        nodes: np.ndarray,  # (n_nodes, 3), nodes (m), overwritten by the corrected ones
        wall: np.ndarray,  # (n_wall, 3), where the wall nodes are to be (m)
    ) -> np.ndarray:  # (n_wall, 3), the mismatch before (m)
        """Correct nodes, shape (n_nodes, 3), in place; nodes of the wall get their given places."""
        mismatch = wall - nodes[self.rows]
        if mismatch.any():
            nodes += self.forward(mismatch)
            nodes[self.rows] = wall  # exactly: up to round-off the nodes are already there
            nodes[self.copies[:, 0]] = nodes[self.copies[:, 1]]
        return mismatch

    def forward(self, mismatch: np.ndarray) -> np.ndarray:
        """Displacements (m) of all nodes, shape (n_nodes, 3), from the wall nodes' displacements, shape (n_wall, 3)."""
        values = np.zeros((self.n_nodes, 3))
        values[self.rows] = mismatch
        values[self.corner_rows] = self.network.dot(mismatch[self.wall_ids])[self.corner_ids]  # step 1
        for level in self.levels:  # step 2
            level.fill(values)
        values[self.copies[:, 0]] = values[self.copies[:, 1]]
        return values

    def adjoint(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `forward`: (n_nodes, 3) to (n_wall, 3)."""
        bars = bar.copy()
        _add_at(bars, self.copies[:, 1], self.copies[:, 0])  # step 3, transposed, and so on backwards
        for level in self.levels[::-1]:
            level.fill_transpose(bars)
        wall_bar = bars[self.rows]
        corner_bars = np.zeros((len(self.network.ids), 3), dtype=bars.dtype)
        corner_bars[self.corner_ids] = bars[self.corner_rows]
        wall_bar[self.wall_ids] += self.network.transpose_dot(corner_bars)
        return wall_bar


_CORNERS = np.ix_(*[(0, -1)] * 3)


def _pieces(topology: Topology, source: np.ndarray, is_wall: np.ndarray) -> Iterator[Window]:
    """Cut all segments into pieces, alike if linked: in directions that run along walls and leave none."""
    classes, whole = direction_classes(topology), topology.layout.numbers
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
    n += n % 2 == 0 and n_cells % 2 == 1  # otherwise the middle cut would be nearer to one end
    low = np.arange(n // 2 + 1) * n_cells // n
    return np.concatenate([low, np.unique(n_cells - low)[n % 2 == 0 :]])


def _fixed_rows(topology: Topology, source: np.ndarray) -> np.ndarray:
    """Rows of all boundary nodes that stay: all except nodes that are only in planes of symmetry."""
    whole = topology.layout.numbers
    windows = [face.window for face in topology.boundary if face.kind != "symmetry"]
    return np.unique(np.concatenate([np.zeros(0, int), *(source[whole[w.block][w.slices]].ravel() for w in windows)]))


def _edge_lengths(pieces: Sequence[tuple[np.ndarray, np.ndarray]], corners: np.ndarray) -> dict[tuple[int, int], float]:
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


def _directions(ids: np.ndarray, planes: Sequence[tuple[np.ndarray, np.ndarray]]) -> sparse.csr_array:
    """Directions in which corners may move, as orthonormal columns: all, or directions of the planes they are in."""
    blocks = [sparse.csr_array(_complement([normal for is_in, normal in planes if is_in[n]])) for n in ids]
    return sparse.csr_array(sparse.block_diag(blocks, format="csr")) if blocks else sparse.csr_array((0, 0))


def _complement(normals: list[np.ndarray]) -> np.ndarray:
    """Orthonormal columns, shape (3, n), of the complement of some unit normals; exact for normals along axes."""
    matrix = np.array(normals).reshape(-1, 3)
    if (np.abs(matrix).max(axis=1) == 1.0).all():
        return np.delete(np.eye(3), np.flatnonzero((matrix != 0.0).any(axis=0)), axis=1)
    _, sizes, rows = np.linalg.svd(matrix)
    return rows[np.count_nonzero(sizes > INDEPENDENT) :].T


@njit(cache=True, nogil=True, error_model="numpy")
def _add_at(values, rows, terms):
    """Add rows of an array to others of its rows."""
    for n in range(len(rows)):
        for c in range(3):
            values[rows[n], c] += values[terms[n], c]
