r"""Heights of the first cells at walls, and their ratios to the baseline.

The height at a wall node is the distance of the next node off the wall along the wall's unit normal there::

    next node  o             h = (x_next - x_wall) . n,   n = N / |N|
               |\
             h | \           N: area vectors of the wall's quads around the node, those of the same window of a
               |  \             face alone, summed; for a planar block, lines with the block's normal for depth
    -----------+---o---- wall

Every window of a face has its own entries. If two windows meet at a sharp edge, each side is measured along its own
normal, and all heights are smooth functions of the nodes. Entries that have no height on the baseline are left out:
where the line off the wall has collapsed or points into the wall, and where the wall has no normal.

If processes hold pieces of the grid, a window may be cut. Each of its nodes then has its entry on the first process
that has cells at it, and the area vectors around nodes on the cut are summed over the processes.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...base.display import OneLine
from ...base.numerics.processes import summed, together
from ..topology.block_layout import BlockLayout, has_cells
from ..topology.boundary_surface import quads_in_turn, volume_behind
from ..topology.grid import Grid, Patch
from ..topology.index_space import Window
from .hexahedron import COLLAPSE_TOLERANCE
from .pieces import Frame, Pieces
from .quads import add_to_nodes, area_vectors, area_vectors_jvp, area_vectors_vjp

__all__ = ["FirstCells", "WallNode"]

KNIFE_EDGE = 1e-6
"""Length of the summed area vectors, relative to the sum of their lengths, below which quads around a node have no
normal: areas that cancel, as where a surface is folded flat, leave only round-off."""


@dataclass(frozen=True)
class WallNode:
    """A node on a wall."""

    block: str  # name of the block
    # number of the node, from 1
    i: int
    j: int
    k: int

    def __str__(self) -> str:
        return f"node ({self.i}, {self.j}, {self.k}) of {self.block}"


@dataclass(frozen=True, eq=False)
class FirstCells(OneLine):
    """First cells at the walls of a grid, with what the baseline has decided; make it by `of_baseline`."""

    # Entries are in the order of the patches, their windows and, in each, the C order of its nodes. Entries, points and
    # rows are local to this process.

    pieces: Pieces  # pieces of the grid that the processes hold
    patches: tuple[str, ...]  # walls
    rows: np.ndarray  # int (n_points,), row in the grid of the wall's nodes, window by window
    # numbers of the points among the points of all walls: equal where windows are cut and processes share nodes
    keys: np.ndarray  # int (n_points,)
    # added to them: the normal of a planar block for the second line of its wall, which completes the quads
    depth: np.ndarray  # (n_points, 3)
    # corners of the wall's quads among the points, around the normal into the fluid
    quads: np.ndarray  # int (n_quads, 4)
    at: np.ndarray  # int (n,), point of every entry
    next_rows: np.ndarray  # int (n,), row in the grid of its next node off the wall
    patch_ids: np.ndarray  # int (n,), number of its patch
    baseline: np.ndarray  # (n,), height of every entry on the baseline (m)
    # nodes of each patch that have no height on the baseline, on all processes
    n_left_out: np.ndarray  # int (n_patches,)
    n_of_all: int  # number of entries on all processes
    cut_keys: np.ndarray  # keys of the points at which any window is cut: the same on all processes

    @classmethod
    def of_baseline(
        cls,
        grid: Grid,  # the grid. Its walls are its patches of kind ``"wall"``
    ) -> FirstCells:  # without entries if the grid has no walls
        """Find the first cells at the walls of a baseline grid.

        Examples
        --------
        >>> from bspline_mdao.generators import flat_plate_grid
        >>> grid = flat_plate_grid((9, 9, 9))
        >>> cells = FirstCells.of_baseline(grid)
        >>> cells.ratios(1.5 * grid.to_vector().reshape(-1, 3)).round(9).max()
        np.float64(1.5)
        """
        pieces, nodes = Pieces.of_grid(grid), grid.to_vector().reshape(-1, 3)
        return cls.of_pieces(pieces, nodes, pieces.frames(nodes))

    @classmethod
    def of_pieces(
        cls,
        pieces: Pieces,
        nodes: np.ndarray,  # (n_nodes, 3), nodes of this process (m)
        frames: Sequence[Frame],  # frame of the block of each of its pieces, see `Pieces.frames`
    ) -> FirstCells:  # without entries if it has no walls
        """Find the first cells at the walls of a baseline grid in pieces; all processes call it."""
        walls = [patch for patch in pieces.patches if patch.kind == "wall"]
        faces, cut_keys = [_Face.none()], [np.zeros(0, dtype=int)]
        volumes = np.zeros(max(1, sum(len(wall.windows) for wall in walls)))
        with together(pieces.comm):
            views = pieces.nodes_of(nodes)
            for part in _wall_parts(pieces, walls):
                cut_keys.append(part.keys[~part.is_first])
                if part.process == pieces.comm.rank:
                    n = part.piece
                    start = int(pieces.layout.starts[n])
                    faces.append(_Face.of(views[n], start, pieces.local[n], part, frames[n]))
                    volumes[part.number] += faces[-1].volume
        keys = np.unique(np.concatenate(cut_keys))
        if keys.size:
            volumes = summed(pieces.comm, volumes)
        starts = BlockLayout.of(face.rows.shape for face in faces).starts
        names = ("rows", "keys", "depth", "next_rows", "patch_ids", "baseline")
        cells = cls(
            pieces=pieces,
            patches=tuple(wall.name for wall in walls),
            quads=np.concatenate([face.quads(volumes, start) for face, start in zip(faces, starts)]),
            at=np.concatenate([face.at + start for face, start in zip(faces, starts)]),
            n_left_out=np.zeros(len(walls), dtype=int),
            n_of_all=0,
            cut_keys=np.unique(np.stack([2 * keys, 2 * keys + 1])),
            **{name: np.concatenate([getattr(face, name) for face in faces]) for name in names},
        )
        return cells._of_some_height(nodes)

    @property
    def n_bytes(self) -> int:
        """Memory of the state (B)."""
        return sum(value.nbytes for value in vars(self).values() if isinstance(value, np.ndarray))

    @property
    def places(self) -> np.ndarray:
        """Block, from 0, and number (i, j, k) there, from 1, of the wall node of every entry: shape (n, 4)."""
        number, index = self.pieces.layout.unravel(self.rows[self.at])
        local = np.array([(piece.block, *piece.lo) for piece in self.pieces.local], dtype=int).reshape(-1, 4)
        return np.column_stack([local[number, 0], local[number, 1:] + index + 1])

    def by_patch(self) -> Iterator[tuple[int, np.ndarray]]:
        """Number of every wall that has heights, and the numbers of its entries."""
        for number in range(len(self.patches)):
            ids = np.flatnonzero(self.patch_ids == number)
            if ids.size:
                yield number, ids

    @property
    def wall_rows(self) -> np.ndarray:
        """Row in the grid of the wall node of every entry, shape (n,)."""
        return self.rows[self.at]

    def heights(
        self,
        nodes: np.ndarray,  # (n_nodes, 3), nodes of all blocks (m)
    ) -> np.ndarray:  # (n,), height at every entry (m); negative where the next node is behind the wall
        """Heights of a grid."""
        edges, normals = self._edges_and_normals(nodes)
        return (edges * _units(normals)[0]).sum(axis=1)

    def ratios(self, nodes: np.ndarray) -> np.ndarray:
        """Heights of a grid divided by the heights of the baseline, shape (n,); see `heights`."""
        return self.heights(nodes) / self.baseline

    def ratios_jvp(
        self,
        # nodes and their change (m)
        nodes: np.ndarray,  # (n_nodes, 3)
        d_nodes: np.ndarray,  # (n_nodes, 3)
    ) -> np.ndarray:  # (n,)
        """Change of the ratios with the nodes."""
        edges, normals = self._edges_and_normals(nodes)
        units, inverse = _units(normals)
        d_edges = d_nodes[self.next_rows] - d_nodes[self.rows[self.at]]
        d_normals = self._summed(area_vectors_jvp(self._corners(nodes), d_nodes[self.rows[self.quads]]))
        along = (edges * units).sum(axis=1, keepdims=True)
        d_heights = (d_edges * units).sum(axis=1) + inverse * ((edges - along * units) * d_normals).sum(axis=1)
        return d_heights / self.baseline

    def ratios_vjp(
        self,
        nodes: np.ndarray,  # (n_nodes, 3), nodes of all blocks (m)
        bar: np.ndarray,  # (n,), adjoint of the ratios
        nodes_bar: np.ndarray,  # (n_nodes, 3), what the adjoint of the nodes is added to
    ) -> None:
        """Add the adjoint of the nodes from the adjoint of the ratios."""
        edges, normals = self._edges_and_normals(nodes)
        units, inverse = _units(normals)
        bar = (bar / self.baseline)[:, None]
        along = (edges * units).sum(axis=1, keepdims=True)
        normals_bar = np.zeros((self.rows.size, 3))
        normals_bar[self.at] = inverse[:, None] * bar * (edges - along * units)
        normals_bar = self._at_cuts(normals_bar)
        areas_bar = normals_bar[self.quads].sum(axis=1)
        corners_bar = area_vectors_vjp(self._corners(nodes), areas_bar)
        np.add.at(nodes_bar, self.rows, add_to_nodes(self.quads, corners_bar, self.rows.size))
        np.add.at(nodes_bar, self.next_rows, bar * units)
        np.add.at(nodes_bar, self.rows[self.at], -bar * units)

    def _of_some_height(self, nodes: np.ndarray) -> FirstCells:
        """Return the cells with their heights, without entries that have none: heights of at most ``baseline``."""
        heights, normals = self.heights(nodes), self._edges_and_normals(nodes)[1]
        areas = self._summed(np.linalg.norm(area_vectors(self._corners(nodes)), axis=1)[:, None] * np.ones(3))[:, 0]
        counts = (heights > self.baseline) & (np.linalg.norm(normals, axis=1) > KNIFE_EDGE * areas)
        kept = {name: getattr(self, name)[counts] for name in ("at", "next_rows", "patch_ids")}
        n_left_out = np.bincount(self.patch_ids[~counts], minlength=len(self.patches))
        numbers = summed(self.pieces.comm, np.append(n_left_out, np.count_nonzero(counts)))
        return replace(self, baseline=heights[counts], n_left_out=numbers[:-1], n_of_all=int(numbers[-1]), **kept)

    def _edges_and_normals(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Edges off the wall, and sums of the area vectors around it, both of shape (n, 3)."""
        return nodes[self.next_rows] - nodes[self.rows[self.at]], self._summed(area_vectors(self._corners(nodes)))

    def _corners(self, nodes: np.ndarray) -> np.ndarray:
        return (nodes[self.rows] + self.depth)[self.quads]

    def _summed(self, areas: np.ndarray) -> np.ndarray:
        """Sum area vectors, shape (n_quads, 3), around the node of every entry."""
        corners = np.broadcast_to(areas[:, None], (*self.quads.shape, 3))
        sums = add_to_nodes(self.quads, corners, self.rows.size)
        if self.cut_keys.size:
            points, numbers = self._shared
            around = np.zeros((self.cut_keys.size, 4, 3))  # a slot for each quad, to be summed as in an uncut window
            at = np.full(self.rows.size, -1)
            at[points] = numbers
            quad, corner = np.nonzero(at[self.quads] >= 0)
            around[at[self.quads[quad, corner]], corner] = areas[quad]
            around = summed(self.pieces.comm, around)
            sums[points] = (around[:, 2] + around[:, 1] + around[:, 3] + around[:, 0])[numbers]
        return sums[self.at]

    def _at_cuts(self, vectors: np.ndarray) -> np.ndarray:
        """Sum vectors of the points, shape (n_points, 3), over all processes that share them."""
        if self.cut_keys.size:
            points, numbers = self._shared
            totals = np.zeros((self.cut_keys.size, 3))
            np.add.at(totals, numbers, vectors[points])
            vectors[points] = summed(self.pieces.comm, totals)[numbers]
        return vectors

    @cached_property
    def _shared(self) -> tuple[np.ndarray, np.ndarray]:
        """Points at which a window is cut, and their numbers among all such."""
        points = np.flatnonzero(np.isin(self.keys, self.cut_keys))
        return points, np.searchsorted(self.cut_keys, self.keys[points])


@dataclass(frozen=True, eq=False)
class _WallPart:
    """Part of a window of a wall at which a piece of a block has cells."""

    # which process, and which of its pieces
    process: int
    piece: int
    # number of the window among the windows of all walls, and of its wall
    number: int
    patch: int
    direction: int  # direction of the block that leads off the wall
    window: Window  # the part
    keys: np.ndarray  # numbers of its nodes among the nodes of the windows of all walls
    is_first: np.ndarray  # nodes that no earlier part has


def _wall_parts(pieces: Pieces, walls: Sequence[Patch]) -> Iterator[_WallPart]:
    """Cut the windows of walls into parts, and yield those of this process and all parts of windows that are cut."""
    by_block = _pieces_by_block(pieces)
    windows = [(patch, window) for patch, wall in enumerate(walls) for window in wall.windows]
    starts = BlockLayout.of(window.shape for _, window in windows).starts.tolist()
    for number, ((patch, window), start) in enumerate(zip(windows, starts)):
        shape = pieces.shapes[window.block]
        direction = next((d for d, n in enumerate(shape) if n > 1 and window.lo[d] == window.hi[d]), None)
        if direction is not None and has_cells(shape):
            parts = [(process, n, _common(window, piece)) for process, n, piece in by_block[window.block]]
            parts = [place for place in parts if _has_quads(place[2], window)]
            for at, (process, n, part) in enumerate(parts):
                if process == pieces.comm.rank or len(parts) > 1:
                    keys = start + np.arange(math.prod(window.shape)).reshape(window.shape)
                    is_first = np.ones(part.shape, dtype=bool)
                    for *_, other in parts[:at]:
                        is_first[_within(_common(part, other), part)] = False
                    yield _WallPart(process, n, number, patch, direction, part, keys[_within(part, window)], is_first)


def _pieces_by_block(pieces: Pieces) -> dict[int, list[tuple[int, int, Window]]]:
    """Process, number there and window of the pieces of every block."""
    by_block = defaultdict(list)
    for process, windows in enumerate(pieces.partition.pieces):
        for number, piece in enumerate(windows):
            by_block[piece.block].append((process, number, piece))
    return by_block


def _has_quads(part: Window, window: Window) -> bool:
    """Whether a part of a face window extends in all directions in which the window does."""
    ends = zip(part.lo, part.hi, window.lo, window.hi)
    return all(lo < hi or lo == hi == first == last for lo, hi, first, last in ends)


def _common(a: Window, b: Window) -> Window:
    """Intersection of two windows of a block; its ends are reversed if it is empty."""
    return Window(a.block, tuple(map(max, a.lo, b.lo)), tuple(map(min, a.hi, b.hi)))


def _within(part: Window, window: Window) -> tuple[slice, ...]:
    """Slices that cut a part out of an array of a window's shape."""
    return tuple(slice(lo - first, max(lo, hi + 1) - first) for lo, hi, first in zip(part.lo, part.hi, window.lo))


@dataclass(frozen=True, eq=False)
class _Face:
    """Entries of `FirstCells` of one part of a wall, before entries without a height are left out."""

    # Points are numbered within the face; ``points`` has their numbers along its two directions. ``volume`` is
    # `bspline_mdao.grids.topology.boundary_surface.volume_behind` of the window with number ``number``.

    rows: np.ndarray
    keys: np.ndarray
    depth: np.ndarray
    points: np.ndarray
    at: np.ndarray
    next_rows: np.ndarray
    patch_ids: np.ndarray
    baseline: np.ndarray
    number: int
    volume: float

    @classmethod
    def none(cls) -> _Face:
        """A face without nodes, so there is at least one to join."""
        ids = np.zeros(0, dtype=int)
        return cls(ids, ids, np.zeros((0, 3)), ids.reshape(0, 0), ids, ids, ids, np.zeros(0), 0, 0.0)

    @classmethod
    def of(cls, x: np.ndarray, start: int, piece: Window, part: _WallPart, frame: Frame) -> _Face:
        """Gather a part of a wall at a piece with nodes (ni, nj, nk, 3), the first of which has row ``start``."""
        d, block = part.direction, np.arange(math.prod(piece.shape)).reshape(piece.shape)
        at, others = part.window.lo[d] - piece.lo[d], _without(_within(part.window, piece), d)
        inner = at + (1 if part.window.lo[d] == 0 else -1)
        rows, next_rows = (np.take(block, n, axis=d)[others] for n in (at, inner))
        keys, is_first = 2 * part.keys.take(0, axis=d), part.is_first.take(0, axis=d)
        depth, axis = np.zeros((*rows.shape, 3)), None
        if frame.normal is not None:  # a second line completes the quads
            axis = rows.shape.index(1)
            rows, next_rows = np.repeat(rows, 2, axis), np.repeat(next_rows, 2, axis)
            keys, depth = np.concatenate([keys, keys + 1], axis), np.concatenate([depth, depth + frame.normal], axis)
        points = np.arange(rows.size).reshape(rows.shape)
        entries = (points if axis is None else points.take(0, axis)).ravel()[is_first.ravel()]
        layers = np.concatenate([(x.reshape(-1, 3)[ids] + depth).reshape(-1, 3) for ids in (rows, next_rows)])
        return cls(
            rows=start + rows.ravel(),
            keys=keys.ravel(),
            depth=depth.reshape(-1, 3),
            points=points,
            at=entries,
            next_rows=start + next_rows.ravel()[entries],
            patch_ids=np.full(entries.size, part.patch),
            baseline=np.full(entries.size, COLLAPSE_TOLERANCE * frame.size),
            number=part.number,
            volume=volume_behind(points, points + points.size, layers),
        )

    def quads(self, volumes: np.ndarray, start: int) -> np.ndarray:
        """Corners of the quads around the normal into the fluid, by the volumes behind all windows."""
        return start + quads_in_turn(self.points if volumes[self.number] > 0.0 else self.points.T)


def _without(slices: tuple[slice, ...], direction: int) -> tuple[slice, ...]:
    return slices[:direction] + slices[direction + 1 :]


def _units(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors, shape (n, 3), and 1 / length, shape (n,); zeros for zero length."""
    length = np.linalg.norm(normals, axis=1)
    inverse = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
    return normals * inverse[:, None], inverse
