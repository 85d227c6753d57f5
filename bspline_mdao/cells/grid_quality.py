"""Quality of all cells of a grid as a function of its nodes: Q of every cell, aggregates, derivatives.

Aggregates of the heights of the first cells at walls are beside those of all cells.

The grid is worked through in slabs whose corner measures fit the cache. Slabs depend on the shapes of the blocks alone
and their results are joined in order, so that nothing depends on the number of threads.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..numerics.threads import run_tasks, thread_count
from ..topology.grid import Grid
from .aggregates import KreisselmeierSteinhauser, PNorm
from .block_cells import BlockCells, Slab
from .first_cells import FirstCells
from .hexahedron import CellQuality, cell_quality
from .slab_measures import Measures, slab_jvp, slab_measures, slab_vjp

__all__ = ["AGGREGATES", "GridQuality", "GridValues"]

HEIGHT_SIGNS = {"height_low_ks": 1.0, "height_high_ks": -1.0}
"""Aggregates of the heights at walls by those of the baseline, and the sign that turns an upper bound into a lower."""

AGGREGATES = (
    *("quality_ks", "quality_pnorm", "corner_ks", "corner_pnorm", "jacobian_ks", "volume_ks"),
    *HEIGHT_SIGNS,
)
"""Measure and rule of the aggregates that there are."""


@dataclass(frozen=True)
class GridValues:
    """Quality of a grid, or its change or adjoint.

    Parameters
    ----------
    aggregates : dict of str to float
        Smooth bounds, by the names of `AGGREGATES`: lower ones, but for ``height_high_ks``.
    q : ndarray, shape (n_cells,), or None
        Q of every cell: blocks in order, each in C order of its cells. In an adjoint None stands for zeros.
    """

    aggregates: Mapping[str, float]
    q: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class GridQuality:
    """Quality of the cells of a grid whose baseline has decided about handedness and collapsed corners.

    Parameters
    ----------
    blocks : tuple of BlockCells
        The blocks that have cells.
    n_nodes : int
        Nodes of all blocks.
    first_cells : FirstCells
        The first cells at walls.
    rho : float
        Sharpness of the Kreisselmeier-Steinhauser aggregates of cells.
    p : int
        Power of the p-norms.
    rho_height : float
        Sharpness of the aggregates of heights.
    n_threads : int, optional
        Number of threads; None stands for ``NUMBA_NUM_THREADS``. Results do not depend on it.

    Raises
    ------
    InputError
        If no block has cells, or rho or p cannot be used.
    """

    blocks: tuple[BlockCells, ...]
    n_nodes: int
    first_cells: FirstCells
    rho: float = 100.0
    p: int = 64
    rho_height: float = 1000.0
    n_threads: int | None = None

    def __post_init__(self):
        if not self.blocks:
            raise InputError("quality: no block of the grid has cells in two directions; nothing can be measured")
        for name in AGGREGATES:
            self._rule(name)

    @classmethod
    def of_baseline(cls, grid: Grid, **settings) -> GridQuality:
        """Look at the cells of a baseline grid, and at the first cells of its walls.

        Parameters
        ----------
        grid : Grid
            The grid. Its walls are its patches of kind ``"wall"``.
        **settings
            ``rho``, ``p``, ``rho_height`` and ``n_threads``.

        Returns
        -------
        GridQuality

        Raises
        ------
        InputError
            If all nodes of a block are at one point, or no block has cells.
        """
        blocks, first_node, first_cell = [], 0, 0
        for number, block in enumerate(grid.blocks, start=1):
            if np.ptp(block.nodes.reshape(-1, 3), axis=0).max() == 0.0:
                raise InputError(f"{grid.source}: all nodes of block {number} are at one point; leave it out")
            if sum(n > 1 for n in block.shape) > 1:
                blocks.append(BlockCells.of_baseline(block.name, block.nodes, first_node, first_cell))
                first_cell += blocks[-1].n_cells
            first_node += int(np.prod(block.shape))
        return cls(tuple(blocks), first_node, FirstCells.of_baseline(grid), **settings)

    @property
    def n_cells(self) -> int:
        """Cells of all blocks."""
        return self.blocks[-1].cells.stop

    @property
    def bytes_per_node(self) -> float:
        """Memory that the state takes."""
        return (sum(block.n_bytes for block in self.blocks) + self.first_cells.n_bytes) / self.n_nodes

    @property
    def aggregates(self) -> tuple[str, ...]:
        """Names of the aggregates that the grid has: those of heights only where it has walls."""
        return tuple(name for name in AGGREGATES if name not in HEIGHT_SIGNS or self.first_cells.baseline.size)

    def cells(self, nodes: np.ndarray) -> list[CellQuality]:
        """Measure every cell, block by block.

        Parameters
        ----------
        nodes : ndarray, shape (n_nodes, 3)
            Nodes of all blocks (m).

        Returns
        -------
        list of CellQuality
            One per block that has cells.
        """
        return [cell_quality(block.nodes_of(nodes), block.left_out_of_block, block.handedness) for block in self.blocks]

    def require(self, names: Sequence[str]) -> None:
        """Refuse aggregates that there are not, or not on this grid.

        Raises
        ------
        InputError
            If there is one among the names.
        """
        missing = next((name for name in names if name not in self.aggregates), None)
        if missing in HEIGHT_SIGNS:
            raise InputError(
                f"'{missing}': no wall of the grid has first cells to measure; declare the patches of kind wall"
            )
        if missing is not None:
            raise InputError(f"no aggregate '{missing}'; choose from {', '.join(AGGREGATES)}")

    def evaluate(self, nodes: np.ndarray, names: Sequence[str] | None = None, cells: bool = False) -> GridValues:
        """Aggregate the quality of a grid.

        Parameters
        ----------
        nodes : ndarray, shape (n_nodes, 3)
            Nodes of all blocks (m).
        names : sequence of str, optional
            Aggregates wanted; all that the grid has by default.
        cells : bool
            Whether Q of every cell is wanted.

        Returns
        -------
        GridValues

        Raises
        ------
        InputError
            If there is no such aggregate.
        """
        names = self.aggregates if names is None else names
        self.require(names)
        q = np.empty(self.n_cells) if cells else None
        of_cells = [name for name in names if name not in HEIGHT_SIGNS]

        def work(slab: Slab):
            measures = slab_measures(slab, nodes)
            if cells:
                q[slab.in_grid] = measures.q
            return [self._rule(name).part(measures.of(name)) for name in of_cells]

        found = self._height_bounds(nodes, names)
        if of_cells or cells:
            for name, parts in zip(of_cells, zip(*self._over_slabs(work))):
                found[name] = self._rule(name).value(self._rule(name).join(parts))
        return GridValues({name: found[name] for name in names}, q)

    def jvp(self, nodes: np.ndarray, d_nodes: np.ndarray, values: GridValues) -> GridValues:
        """Change of the quality with the nodes.

        Parameters
        ----------
        nodes, d_nodes : ndarray, shape (n_nodes, 3)
            Nodes and their change (m).
        values : GridValues
            What `evaluate` gives for the nodes.

        Returns
        -------
        GridValues
            Changes of what ``values`` holds.
        """
        d_q = np.empty(self.n_cells) if values.q is not None else None
        of_cells = [name for name in values.aggregates if name not in HEIGHT_SIGNS]

        def work(slab: Slab):
            measures = slab_measures(slab, nodes)
            change = slab_jvp(slab, nodes, d_nodes, measures)
            if d_q is not None:
                d_q[slab.in_grid] = change.q
            return [_sum(self._weights(measures, values, name), change.of(name)) for name in of_cells]

        found = self._height_changes(nodes, d_nodes, values.aggregates)
        if of_cells or d_q is not None:
            found |= dict(zip(of_cells, np.sum(self._over_slabs(work), axis=0).tolist()))
        return GridValues({name: found[name] for name in values.aggregates}, d_q)

    def vjp(self, nodes: np.ndarray, values: GridValues, bar: GridValues) -> np.ndarray:
        """Adjoint of the nodes from that of the quality.

        Parameters
        ----------
        nodes : ndarray, shape (n_nodes, 3)
            Nodes of all blocks (m).
        values : GridValues
            What `evaluate` gives for the nodes.
        bar : GridValues
            Adjoints of some or all of that.

        Returns
        -------
        ndarray, shape (n_nodes, 3)
        """
        nodes_bar = np.zeros((self.n_nodes, 3))
        seeds = {name: seed for name, seed in bar.aggregates.items() if seed != 0.0 and name not in HEIGHT_SIGNS}

        def work(slab: Slab):
            measures = slab_measures(slab, nodes)
            adjoint = Measures.zeros_like(measures)
            for name, seed in seeds.items():
                adjoint.of(name)[...] += seed * self._weights(measures, values, name)
            if bar.q is not None:
                adjoint.q[...] += bar.q[slab.in_grid]
            slab_vjp(slab, nodes, measures, adjoint, nodes_bar)

        if seeds or bar.q is not None:
            for parity in (0, 1):  # neighbouring slabs share a layer of nodes
                self._over_slabs(work, parity)
        self._add_height_bars(nodes, values.aggregates, bar.aggregates, nodes_bar)
        return nodes_bar

    def _height_bounds(self, nodes, names):
        """Aggregates of heights, if any are asked for; an upper bound is a lower one of the negative numbers."""
        signs = {name: sign for name, sign in HEIGHT_SIGNS.items() if name in names}
        ratios = self.first_cells.ratios(nodes) if signs else None
        return {
            name: sign * self._rule(name).value(self._rule(name).part(sign * ratios)) for name, sign in signs.items()
        }

    def _height_changes(self, nodes, d_nodes, values):
        """Changes of the aggregates of heights that there are values of."""
        weights = self._height_weights(nodes, values)
        d_ratios = self.first_cells.ratios_jvp(nodes, d_nodes) if weights else None
        return {name: float(_sum(weight, d_ratios)) for name, weight in weights.items()}

    def _add_height_bars(self, nodes, values, seeds, nodes_bar):
        """Add the adjoint of the nodes from those of the aggregates of heights."""
        asked = {name: value for name, value in values.items() if seeds.get(name)}
        weights = self._height_weights(nodes, asked)
        if weights:
            bar = sum(seeds[name] * weight for name, weight in weights.items())
            self.first_cells.ratios_vjp(nodes, bar, nodes_bar)

    def _height_weights(self, nodes, values):
        """Derivative in every ratio of the aggregates of heights that there are values of."""
        signs = {name: sign for name, sign in HEIGHT_SIGNS.items() if name in values}
        ratios = self.first_cells.ratios(nodes) if signs else None
        return {name: self._rule(name).weights(sign * ratios, sign * values[name]) for name, sign in signs.items()}

    def _rule(self, name):
        if name in HEIGHT_SIGNS:
            return KreisselmeierSteinhauser(self.rho_height)
        return KreisselmeierSteinhauser(self.rho) if name.endswith("_ks") else PNorm(self.p)

    def _weights(self, measures, values, name):
        return self._rule(name).weights(measures.of(name), values.aggregates[name])

    def _over_slabs(self, work, parity: int | None = None) -> list:
        """Results of ``work`` for all slabs, or for every other one of each block, in order."""
        start, step = (0, 1) if parity is None else (parity, 2)
        slabs = [slab for block in self.blocks for slab in list(block.slabs())[start::step]]
        results = [None] * len(slabs)

        def task(number):
            results[number] = work(slabs[number])

        run_tasks(task, len(slabs), thread_count(self.n_threads))
        return results


def _sum(weights, changes):
    """Sum of products, in an order that does not depend on the threads of BLAS."""
    weights *= changes
    return weights.sum()
