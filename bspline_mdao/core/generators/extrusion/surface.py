"""Multi-block surface grids as one mesh of quads: shared nodes once, all quads around the outward normal.

Theory: ``docs/theory/extrusion.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from ....base.numerics.vectors import lengths
from ....errors import InputError
from ....grids.topology.block_layout import BlockLayout
from ....grids.topology.coincidence import find_coincidence
from ....grids.topology.grid import Grid, find_fault
from ....grids.topology.shell import Shell
from .sheets import lie_on, sides_apart

SMALLEST_AREA = 1e-12
"""Area of a quad, relative to its longest edge squared, that counts as zero: above round-off of 8-byte reals."""

FLAT = 1e-9
"""Volume behind a surface relative to its area times its size below which it has no inside."""


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """A surface grid as one mesh; made by `of`."""

    source: str  # where the grid came from, for messages
    points: np.ndarray  # (n, 3), nodes of the surface, each once (m)
    ids: tuple[np.ndarray, ...]  # int (ni, nj), for each block: number of the node at each place
    is_turned: np.ndarray  # bool (n_blocks,), blocks whose i x j points inwards
    quads: np.ndarray  # int (n_quads, 4), nodes around the outward normal; a node may occur twice in a row
    blocks: np.ndarray  # int (n_quads,), block of each quad
    is_sheet: np.ndarray  # bool (n_quads,), quads of wake sheets, which lie on each other

    @property
    def is_side(self) -> np.ndarray:
        """Whether nodes are at sides of blocks, or at the beginning of a wake sheet, bool (n,)."""
        found, of_wall = np.zeros((2, len(self.points)), bool)
        found[self.quads[self.is_sheet]] = True
        of_wall[self.quads[~self.is_sheet]] = True
        found &= of_wall
        for ids in self.ids:
            found[ids[_at_sides(ids)]] = True
        return found

    @property
    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """The node in each place of a side of a block, int (n_places,), and area vectors of the block there (m2)."""
        nodes, areas = [], []
        for block, ids in enumerate(self.ids):
            of_block = self.blocks == block
            corners = self.points[self.quads[of_block & ~self.is_sheet]]
            at = _quads(np.arange(ids.size).reshape(ids.shape))
            at = (at[:, ::-1] if self.is_turned[block] else at)[~self.is_sheet[of_block]]
            area = np.zeros((ids.size, 3))
            vectors = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
            for corner in at.T:
                np.add.at(area, corner, vectors)
            chosen = _at_sides(ids).ravel() & area.any(axis=1)
            nodes.append(ids.ravel()[chosen])
            areas.append(area[chosen])
        return np.concatenate(nodes), np.concatenate(areas)

    @classmethod
    def of(cls, grid: Grid, inward: bool = False) -> SurfaceMesh:
        """Join the blocks of a surface; normals of a closed one point outwards, unless it is ``inward``."""
        fault = find_fault(grid.blocks)
        if fault:
            raise InputError(f"{grid.source}: {fault}; repair the surface")
        surfaces = [_flat_block(grid, number) for number in range(len(grid.blocks))]
        coincidence = find_coincidence([Shell.of(nodes[:, :, None]) for nodes in surfaces])
        numbers = np.concatenate([ids.dense().ravel() for ids in coincidence.ids])
        inner = numbers < 0  # only nodes at the sides of blocks are shared
        numbers[inner] = np.arange(np.count_nonzero(inner)) + numbers.max(initial=0) + 1
        layout, places = BlockLayout.of([nodes.shape[:2] for nodes in surfaces]), np.arange(len(numbers))
        nodes = np.concatenate([nodes.reshape(-1, 3) for nodes in surfaces])
        corners = np.concatenate([_quads(part) for part in layout.split(places)])
        on = lie_on(nodes[corners], (~inner)[corners].any(axis=1))
        if (on >= 0).all():
            raise InputError(f"{grid.source}: all of the surface lies on itself; give it once, or a thickness")
        if (on >= 0).any():
            numbers = sides_apart(numbers, corners, on)
        _, first, flat = np.unique(numbers, return_index=True, return_inverse=True)
        ids = tuple(layout.split(flat.astype(np.int64)))
        points = nodes[first]
        parts = [_quads(part) for part in ids]
        blocks = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        quads = np.concatenate(parts)
        _require_areas(grid, points, quads, blocks, ids)
        turned = _turned_blocks(grid, quads, blocks, points)
        turned ^= _points_inwards(points, np.where(turned[blocks, None], quads[:, ::-1], quads)) != inward
        quads = np.where(turned[blocks, None], quads[:, ::-1], quads)
        return cls(grid.source, points, ids, turned, quads, blocks, on >= 0)


def _flat_block(grid: Grid, number: int) -> np.ndarray:
    """Nodes of a surface block, shape (ni, nj, 3)."""
    nodes = grid.blocks[number].nodes
    if sorted(nodes.shape[:3])[0] != 1 or sorted(nodes.shape[:3])[1] < 2:
        raise InputError(
            f"{grid.source}: block {number + 1} has {' x '.join(map(str, nodes.shape[:3]))} nodes; a surface is "
            f"extruded, whose blocks have one node in one direction and two or more in the others"
        )
    return np.ascontiguousarray(nodes.squeeze(nodes.shape[:3].index(1)), dtype=np.float64)


def _at_sides(ids: np.ndarray) -> np.ndarray:
    """Whether places are at the sides of a block, with its shape."""
    found = np.ones(ids.shape, bool)
    found[1:-1, 1:-1] = False
    return found


def _quads(ids: np.ndarray) -> np.ndarray:
    """Nodes of the quads of a block, around i x j."""
    return np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1).reshape(-1, 4)


def _require_areas(
    grid: Grid, points: np.ndarray, quads: np.ndarray, blocks: np.ndarray, ids: tuple[np.ndarray, ...]
) -> None:
    """Refuse quads without area."""
    corners = points[quads]
    area = lengths(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]))
    longest = lengths(corners - np.roll(corners, 1, axis=1)).max(axis=1)
    bad = np.flatnonzero(area <= SMALLEST_AREA * longest**2)
    if len(bad):
        block = int(blocks[bad[0]])
        i, j = np.unravel_index(bad[0] - np.searchsorted(blocks, block), [n - 1 for n in ids[block].shape])
        raise InputError(
            f"{grid.source}: cell ({i + 1}, {j + 1}) of block {block + 1} has no area, and {len(bad) - 1} more; "
            f"leave out blocks that are lines, and repair the surface"
        )


def half_edges(quads: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges of quads in their sense of rotation, without zero-length ones: from, to, and the quad of each."""
    start, end = quads.ravel(), np.roll(quads, -1, axis=1).ravel()
    real = start != end
    return start[real], end[real], np.repeat(np.arange(len(quads)), 4)[real]


def _turned_blocks(grid: Grid, quads: np.ndarray, blocks: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Blocks to turn over to make neighbours agree; the largest part of the surface stays unchanged."""
    start, end, quad = half_edges(quads)
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.lexsort((low, high))
    low, high, forward, quad = low[order], high[order], (start < end)[order], quad[order]
    same = (low[1:] == low[:-1]) & (high[1:] == high[:-1])
    thrice = np.flatnonzero(same[1:] & same[:-1])
    if len(thrice):
        raise InputError(_of_edge(grid, points, low[thrice[0]], high[thrice[0]], "more than two cells meet"))
    pair = np.flatnonzero(same)
    a, b, opposed = blocks[quad[pair]], blocks[quad[pair + 1]], forward[pair] != forward[pair + 1]
    n = len(grid.blocks)
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(n, n)).tocsr()
    graph = graph + graph.T
    count, labels = connected_components(graph, directed=False)
    agree = {}
    for x, y, is_opposed in set(zip(a.tolist(), b.tolist(), opposed.tolist())):
        agree[x, y] = agree[y, x] = is_opposed
    turned = np.zeros(n, dtype=bool)
    for part in range(count):
        order, before = breadth_first_order(graph, int(np.flatnonzero(labels == part)[0]), directed=False)
        for block in order[1:].tolist():
            turned[block] = turned[before[block]] ^ (not agree[int(before[block]), block])
    wrong = np.flatnonzero((turned[a] ^ turned[b]) == opposed)
    if len(wrong):
        edge = pair[wrong[0]]
        raise InputError(_of_edge(grid, points, low[edge], high[edge], "the surface turns over, as a Moebius strip"))
    # in each part, the orientation of most cells stays
    cells = np.bincount(blocks, minlength=n)
    for part in range(count):
        inside = labels == part
        if cells[inside & turned].sum() > cells[inside & ~turned].sum():
            turned[inside] ^= True
    return turned


def _of_edge(grid: Grid, points: np.ndarray, a: int, b: int, what: str) -> str:
    """Message about an edge of the surface."""
    x, y, z = 0.5 * (points[a] + points[b])
    return (
        f"{grid.source}: {what} at the edge around ({x:.6g}, {y:.6g}, {z:.6g}) {grid.length_unit}; a surface is "
        f"extruded to one side; give one without folds, branches and repeated blocks"
    )


def _points_inwards(points: np.ndarray, quads: np.ndarray) -> bool:
    """Whether the volume behind a surface is negative, seen from its rim, which a plane of symmetry closes."""
    start, end, _ = half_edges(quads)
    edges = np.sort(np.stack([start, end], axis=1), axis=1)
    unique, counts = np.unique(edges, axis=0, return_counts=True)
    rim = np.unique(unique[counts == 1])
    seen = points - (points[rim].mean(axis=0) if len(rim) else points.mean(axis=0))
    corners = seen[quads]
    area = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    volume = (corners.mean(axis=1) * area).sum() / 3.0
    return bool(volume < -FLAT * lengths(area).sum() * np.ptp(points, axis=0).max())
