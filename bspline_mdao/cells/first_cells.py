r"""Heights of the first cells at walls, and their ratios to those of the baseline.

The height at a wall node is the distance of the next node off the wall along the wall's unit normal there::

    next node  o             h = (x_next - x_wall) . n,   n = N / |N|
               |\
             h | \           N: area vectors of the wall's quads around the node, those of the same window of a
               |  \             face alone, summed; for a planar block, lines with the block's normal for depth
    -----------+---o---- wall

Every window of a face has entries of its own. Where two windows meet in a sharp edge, each side is measured along its
own normal, and all heights are smooth functions of the nodes. Entries that have no height on the baseline are left out:
where the line off the wall has collapsed or points into the wall, and where the wall has no normal.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from ..topology.boundary_surface import facing, quads_in_turn
from ..topology.grid import Grid
from ..topology.index_space import Window, block_rows
from .hexahedron import COLLAPSE_TOLERANCE, flat_direction, mean_normal
from .quads import add_to_nodes, area_vectors, area_vectors_jvp, area_vectors_vjp

__all__ = ["FirstCells", "WallNode"]

KNIFE_EDGE = 1e-6
"""Length of the summed area vectors, relative to the sum of their lengths, below which quads around a node have no
normal: areas that cancel, as where a surface is folded flat, leave round-off."""


@dataclass(frozen=True)
class WallNode:
    """A node on a wall.

    Parameters
    ----------
    block : str
        Name of the block.
    i, j, k : int
        Number of the node, from 1.
    """

    block: str
    i: int
    j: int
    k: int

    def __str__(self) -> str:
        return f"node ({self.i}, {self.j}, {self.k}) of {self.block}"


@dataclass(frozen=True, eq=False)
class FirstCells:
    """First cells at the walls of a grid, with what stays as it was on the baseline; make it by `of_baseline`.

    Entries are in the order of the patches, their windows and, in each, the C order of its nodes.

    Parameters
    ----------
    names, shapes : tuple
        Name, and nodes in each direction, of every block.
    patches : tuple of str
        Walls.
    rows : ndarray of int, shape (n_points,)
        Row in the grid of the wall's nodes, window by window.
    depth : ndarray, shape (n_points, 3)
        Added to them: the normal of a planar block for the second line of its wall, which makes quads of it.
    quads : ndarray of int, shape (n_quads, 4)
        Corners of the wall's quads among the points, around the normal into the fluid.
    at : ndarray of int, shape (n,)
        Point of every entry.
    next_rows : ndarray of int, shape (n,)
        Row in the grid of the node next to it.
    patch_ids : ndarray of int, shape (n,)
        Number of its patch.
    baseline : ndarray, shape (n,)
        Its height on the baseline (m).
    n_left_out : ndarray of int, shape (n_patches,)
        Nodes of each patch that have no height on the baseline.
    """

    names: tuple[str, ...]
    shapes: tuple[tuple[int, ...], ...]
    patches: tuple[str, ...]
    rows: np.ndarray
    depth: np.ndarray
    quads: np.ndarray
    at: np.ndarray
    next_rows: np.ndarray
    patch_ids: np.ndarray
    baseline: np.ndarray
    n_left_out: np.ndarray

    @classmethod
    def of_baseline(cls, grid: Grid) -> FirstCells:
        """Find the first cells at the walls of a baseline grid.

        Parameters
        ----------
        grid : Grid
            The grid. Its walls are its patches of kind ``"wall"``.

        Returns
        -------
        FirstCells
            Without entries where the grid has no walls.

        Examples
        --------
        >>> from bspline_mdao import flat_plate_grid
        >>> grid = flat_plate_grid((9, 9, 9))
        >>> cells = FirstCells.of_baseline(grid)
        >>> cells.ratios(1.5 * grid.to_vector().reshape(-1, 3)).round(9).max()
        np.float64(1.5)
        """
        walls = [patch for patch in grid.patches if patch.kind == "wall"]
        rows, nodes = block_rows(grid.shapes), grid.to_vector().reshape(-1, 3)
        faces = [_Face.none()]
        for number, patch in enumerate(walls):
            for window in patch.windows:
                start = sum(face.rows.size for face in faces)
                faces.append(_Face.of(nodes, rows[window.block], window, number, start) or _Face.none())
        joined = {field.name: np.concatenate([getattr(face, field.name) for face in faces]) for field in fields(_Face)}
        names, patches = (tuple(item.name for item in items) for items in (grid.blocks, walls))
        cells = cls(names, grid.shapes, patches, n_left_out=np.zeros(len(walls), dtype=int), **joined)
        return cells._of_some_height(nodes)

    @property
    def n_bytes(self) -> int:
        """Memory that the state takes (B)."""
        return sum(value.nbytes for value in vars(self).values() if isinstance(value, np.ndarray))

    def place(self, entry: int) -> WallNode:
        """Return the wall node of an entry, with its block and its number there."""
        row = int(self.rows[self.at[entry]])
        for name, shape in zip(self.names, self.shapes):
            if row < np.prod(shape):
                return WallNode(name, *(int(n) + 1 for n in np.unravel_index(row, shape)))
            row -= int(np.prod(shape))
        raise IndexError(entry)

    def heights(self, nodes: np.ndarray) -> np.ndarray:
        """Heights of a grid.

        Parameters
        ----------
        nodes : ndarray, shape (n_nodes, 3)
            Nodes of all blocks (m).

        Returns
        -------
        ndarray, shape (n,)
            Height at every entry (m); negative where the next node is behind the wall.
        """
        edges, normals = self._edges_and_normals(nodes)
        return (edges * _units(normals)[0]).sum(axis=1)

    def ratios(self, nodes: np.ndarray) -> np.ndarray:
        """Heights of a grid divided by those of the baseline, shape (n,); see `heights`."""
        return self.heights(nodes) / self.baseline

    def ratios_jvp(self, nodes: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
        """Change of the ratios with the nodes.

        Parameters
        ----------
        nodes, d_nodes : ndarray, shape (n_nodes, 3)
            Nodes and their change (m).

        Returns
        -------
        ndarray, shape (n,)
        """
        edges, normals = self._edges_and_normals(nodes)
        units, inverse = _units(normals)
        d_edges = d_nodes[self.next_rows] - d_nodes[self.rows[self.at]]
        d_normals = self._summed(area_vectors_jvp(self._corners(nodes), d_nodes[self.rows[self.quads]]))
        along = (edges * units).sum(axis=1, keepdims=True)
        d_heights = (d_edges * units).sum(axis=1) + inverse * ((edges - along * units) * d_normals).sum(axis=1)
        return d_heights / self.baseline

    def ratios_vjp(self, nodes: np.ndarray, bar: np.ndarray, nodes_bar: np.ndarray) -> None:
        """Add the adjoint of the nodes from that of the ratios.

        Parameters
        ----------
        nodes : ndarray, shape (n_nodes, 3)
            Nodes of all blocks (m).
        bar : ndarray, shape (n,)
            Adjoint of the ratios.
        nodes_bar : ndarray, shape (n_nodes, 3)
            What the adjoint of the nodes is added to.
        """
        edges, normals = self._edges_and_normals(nodes)
        units, inverse = _units(normals)
        bar = (bar / self.baseline)[:, None]
        along = (edges * units).sum(axis=1, keepdims=True)
        normals_bar = np.zeros((self.rows.size, 3))
        normals_bar[self.at] = inverse[:, None] * bar * (edges - along * units)
        areas_bar = normals_bar[self.quads].sum(axis=1)
        corners_bar = area_vectors_vjp(self._corners(nodes), areas_bar)
        np.add.at(nodes_bar, self.rows, add_to_nodes(self.quads, corners_bar, self.rows.size))
        np.add.at(nodes_bar, self.next_rows, bar * units)
        np.add.at(nodes_bar, self.rows[self.at], -bar * units)

    def _of_some_height(self, nodes: np.ndarray) -> FirstCells:
        """Return the cells with their heights, without entries that have none: those no higher than ``baseline``."""
        heights, normals = self.heights(nodes), self._edges_and_normals(nodes)[1]
        areas = self._summed(np.linalg.norm(area_vectors(self._corners(nodes)), axis=1)[:, None] * np.ones(3))[:, 0]
        counts = (heights > self.baseline) & (np.linalg.norm(normals, axis=1) > KNIFE_EDGE * areas)
        kept = {name: getattr(self, name)[counts] for name in ("at", "next_rows", "patch_ids")}
        n_left_out = np.bincount(self.patch_ids[~counts], minlength=len(self.patches))
        return replace(self, baseline=heights[counts], n_left_out=n_left_out, **kept)

    def _edges_and_normals(self, nodes):
        """Edges off the wall, and sums of the area vectors around it, both of shape (n, 3)."""
        return nodes[self.next_rows] - nodes[self.rows[self.at]], self._summed(area_vectors(self._corners(nodes)))

    def _corners(self, nodes):
        return (nodes[self.rows] + self.depth)[self.quads]

    def _summed(self, areas):
        """Sum area vectors, shape (n_quads, 3), around the node of every entry."""
        corners = np.broadcast_to(areas[:, None], (*self.quads.shape, 3))
        return add_to_nodes(self.quads, corners, self.rows.size)[self.at]


@dataclass(frozen=True, eq=False)
class _Face:
    """Entries of `FirstCells` of one window of a wall, before those without a height are left out."""

    rows: np.ndarray
    depth: np.ndarray
    quads: np.ndarray
    at: np.ndarray
    next_rows: np.ndarray
    patch_ids: np.ndarray
    baseline: np.ndarray

    @classmethod
    def none(cls) -> _Face:
        """A face without nodes, so that there is one to join."""
        ids = np.zeros(0, dtype=int)
        return cls(ids, np.zeros((0, 3)), np.zeros((0, 4), dtype=int), ids, ids, ids, np.zeros(0))

    @classmethod
    def of(cls, nodes: np.ndarray, block: np.ndarray, window: Window, patch: int, start: int) -> _Face | None:
        """Gather a window of a block, given by the rows of its nodes; None where no cells stand on it.

        ``patch`` is the number of its patch, and ``start`` that of its first point.
        """
        direction = next((d for d, n in enumerate(block.shape) if n > 1 and window.lo[d] == window.hi[d]), None)
        if direction is None or sum(n > 1 for n in block.shape) < 2:
            return None
        x, at = nodes[block[0, 0, 0] : block[-1, -1, -1] + 1].reshape(*block.shape, 3), window.lo[direction]
        others = tuple(s for d, s in enumerate(window.slices) if d != direction)
        rows, next_rows = (np.take(block, n, axis=direction)[others] for n in (at, at + (1 if at == 0 else -1)))
        depth, flat, axis = np.zeros((*rows.shape, 3)), flat_direction(x.shape), None
        if flat is not None:
            axis, normal = rows.shape.index(1), mean_normal(np.moveaxis(x, flat, 2)[:, :, 0])
            rows, next_rows = np.repeat(rows, 2, axis), np.repeat(next_rows, 2, axis)
            depth = np.concatenate([depth, depth + normal], axis)
        points = np.arange(rows.size).reshape(rows.shape)
        entries = (points if flat is None else points.take(0, axis)).ravel()
        layers = np.concatenate([(nodes[ids] + depth).reshape(-1, 3) for ids in (rows, next_rows)])
        least = COLLAPSE_TOLERANCE * np.linalg.norm(np.ptp(x.reshape(-1, 3), axis=0))
        return cls(
            rows=rows.ravel(),
            depth=depth.reshape(-1, 3),
            quads=start + quads_in_turn(facing(points, points + points.size, layers)),
            at=start + entries,
            next_rows=next_rows.ravel()[entries],
            patch_ids=np.full(entries.size, patch),
            baseline=np.full(entries.size, least),
        )


def _units(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors, shape (n, 3), and 1 / length, shape (n,); zeros where there is no length."""
    length = np.linalg.norm(normals, axis=1)
    inverse = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
    return normals * inverse[:, None], inverse
