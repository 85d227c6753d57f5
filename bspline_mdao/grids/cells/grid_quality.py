"""Quality of all cells of a grid as a function of its nodes: Q of every cell, aggregates, derivatives.

Aggregates of the heights of the first cells at walls accompany the aggregates of all cells; `.aggregates` has the table
of both.

The grid is processed in chunks, and nothing is kept per cell. Chunks depend only on the shapes of the blocks, and their
results are joined in order, so nothing depends on the number of threads.

Processes may hold pieces of the grid. Nodes and cells are then local to a process, and aggregates are for the whole
grid: all processes make the same calls.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from ...base.display import OneLine
from ...base.numerics.processes import gathered, summed
from ...base.numerics.threads import run_tasks, thread_count
from ...errors import InputError
from ..topology.grid import Grid
from .aggregates import AGGREGATES, KreisselmeierSteinhauser, Part, PNorm
from .block_cells import (
    BlockCells,
    Chunk,
    block_cells,
    chunk_bounds,
    chunk_coefficients,
    chunk_coefficients_jvp,
    chunk_coefficients_vjp,
    chunk_jvp,
    chunk_vjp,
)
from .cell_loops import as_points
from .first_cells import FirstCells
from .hexahedron import CellQuality, cell_quality, mean_normal, summed_areas, unit_normal
from .lane_bounds import ROWS, bounds_of, weights_of
from .pieces import Pieces

__all__ = ["GridQuality", "GridValues"]


@dataclass(frozen=True)
class GridValues(OneLine):
    """Quality of a grid, or its change or adjoint."""

    # smooth bounds, by the names in `.aggregates.AGGREGATES`: lower bounds, except for ``height_high_ks``
    aggregates: Mapping[str, float]
    # Q of every cell: blocks in order, each in C order of its cells. In an adjoint None stands for zeros
    q: np.ndarray | None = None  # (n_cells,), or None
    # smallest corner triple product of a grid of solid blocks, if ``corner_ks`` was requested: above zero all cells
    # are valid
    min_corner: float | None = None


_Quality = TypeVar("_Quality", bound="GridQuality")


@dataclass(frozen=True, eq=False)
class GridQuality(OneLine):
    """Quality of the cells of a grid whose baseline has decided about handedness and collapsed corners.

    Made by `GridQuality.of_baseline`. Moved grids are judged by the decisions of the baseline, so that measures stay
    differentiable.

    Examples
    --------
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.grids import GridQuality, report_quality
    >>> grid = onera_m6_grid((9, 8, 7))
    >>> report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3)).n_inverted
    0
    """

    pieces: Pieces  # pieces of the grid that the processes hold: usually whole blocks in one process
    blocks: tuple[BlockCells, ...]  # those of this process that have cells
    first_cells: FirstCells  # the first cells at walls
    rho: float = 100.0  # sharpness of the Kreisselmeier-Steinhauser aggregates of cells
    p: int = 64  # power of the p-norms
    rho_height: float = 1000.0  # sharpness of the aggregates of heights
    # number of threads; None stands for ``NUMBA_NUM_THREADS``. Results do not depend on it
    n_threads: int | None = None
    # rule of every aggregate, with the sharpness from the settings
    _rules: Mapping[str, KreisselmeierSteinhauser | PNorm] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.pieces.n_cells_of_all:
            raise InputError("quality: no block of the grid has cells in two directions; nothing can be measured")
        of_cells, of_heights = KreisselmeierSteinhauser(self.rho), KreisselmeierSteinhauser(self.rho_height)
        rules = {"ks": of_cells, "pnorm": PNorm(self.p)}
        made = {name: of_heights if each.is_of_heights else rules[each.rule] for name, each in AGGREGATES.items()}
        object.__setattr__(self, "_rules", made)

    @classmethod
    def of_baseline(
        cls: type[_Quality],
        grid: Grid,  # the grid. Its walls are its patches of kind ``"wall"``
        **settings: Any,  # ``rho``, ``p``, ``rho_height`` and ``n_threads``
    ) -> _Quality:
        """Decide about the cells of a baseline grid, and about the first cells at its walls."""
        # `InputError` if all nodes of a block are at one point, or no block has cells
        return cls.of_pieces(Pieces.of_grid(grid), grid.to_vector().reshape(-1, 3), **settings)

    @classmethod
    def of_pieces(
        cls: type[_Quality],
        pieces: Pieces,  # the pieces, and the processes that hold them
        nodes: np.ndarray,  # (n_nodes, 3), nodes of the pieces of this process (m)
        **settings: Any,  # see `of_baseline`
    ) -> _Quality:  # decisions are made for the whole blocks
        """Decide about the cells of a baseline grid in pieces; all processes call it."""
        # `InputError` see `of_baseline`
        frames = pieces.frames(nodes)
        blocks = block_cells(pieces, nodes, frames)
        return cls(pieces, blocks, FirstCells.of_pieces(pieces, nodes, frames), **settings)

    @property
    def n_nodes(self) -> int:
        """Nodes of this process."""
        return self.pieces.n_nodes

    @property
    def n_cells(self) -> int:
        """Cells of this process."""
        return self.blocks[-1].cells.stop if self.blocks else 0

    @property
    def bytes_per_node(self) -> float:
        """Memory of the state, divided by the number of nodes (B), on this process."""
        return (sum(block.n_bytes for block in self.blocks) + self.first_cells.n_bytes) / max(1, self.n_nodes)

    @property
    def aggregates(self) -> tuple[str, ...]:
        """Names of the available aggregates: aggregates of heights only if the grid has walls."""
        return tuple(name for name, of in AGGREGATES.items() if self.first_cells.n_of_all or not of.is_of_heights)

    def cells(
        self,
        nodes: np.ndarray,  # (n_nodes, 3), nodes of all blocks (m)
    ) -> list[CellQuality]:  # one for each of ``blocks``
        """Measure every cell, block by block."""
        return list(self.cells_in_turn(nodes))

    def cells_in_turn(self, nodes: np.ndarray) -> Iterator[CellQuality]:
        """Measure every cell as `cells` does, one block after another, without keeping the results."""
        normals = self.normals(nodes)
        places = ((block, block.nodes_of(nodes), normals.get(block.window.block)) for block in self.blocks)
        return (cell_quality(x, block.degenerate_in_block, block.handedness, normal) for block, x, normal in places)

    def over_cells(self, nodes: np.ndarray, work: Callable[[Chunk, np.ndarray], Any]) -> list:
        """Results of work on chunks and their nodes, as records of solid cells; in order."""
        normals = self.normals(nodes)
        for block in self.blocks:
            if block.flat is not None and block.window.block not in normals:
                plane = np.moveaxis(block.nodes_of(nodes), block.flat, 2)[:, :, 0]
                normals[block.window.block] = mean_normal(plane)
        return self._over_chunks(lambda c: work(c, as_points(c.solid(nodes, normals.get(c.block.window.block)))))

    def normals(self, nodes: np.ndarray) -> dict[int, np.ndarray]:
        """Current mean normals of planar blocks that are split, by their numbers; all processes call it."""
        if not self.pieces.has_split_planes:
            return {}
        planes = [(block, block.flat) for block in self.blocks if block.flat is not None]
        views = [np.moveaxis(block.nodes_of(nodes), flat, 2)[:, :, 0] for block, flat in planes]
        areas = np.zeros((len(self.pieces.shapes), 3))
        for (block, _), plane in zip(planes, views):
            areas[block.window.block] += summed_areas(plane)
        areas = summed(self.pieces.comm, areas)
        return {block.window.block: unit_normal(areas[block.window.block]) for block, _ in planes}

    def require(self, names: Sequence[str], cells: bool = False) -> None:
        """Refuse names of aggregates that do not exist, or not for this grid; Q of every cell always exists."""
        missing = next((name for name in names if name not in self.aggregates), None)
        if missing in AGGREGATES:
            raise InputError(
                f"'{missing}': no wall of the grid has first cells to measure; declare the patches of kind wall"
            )
        if missing is not None:
            raise InputError(f"no aggregate '{missing}'; choose from {', '.join(AGGREGATES)}")

    def evaluate(
        self,
        nodes: np.ndarray,  # (n_nodes, 3), nodes of all blocks (m)
        names: Sequence[str] | None = None,  # requested aggregates; all available ones by default
        cells: bool = False,  # whether to return Q of every cell
    ) -> GridValues:
        """Aggregate the quality of a grid. `InputError` if there is no such aggregate."""
        names = self.aggregates if names is None else names
        self.require(names)
        q, bounds = np.empty(self.n_cells if cells else 0), self._bounds(names)
        measured, certified = _of_cells(names)

        def work(chunk: Chunk) -> list[Part]:
            found = bounds.copy()
            if measured or cells:
                chunk_bounds(chunk, nodes, found, q)
            sums = zip(found["reference"].tolist(), found["total"].tolist())
            parts = [self._rules[name].part_of(*of_one) for name, of_one in zip(measured, sums)]
            if certified:
                coefficients = chunk_coefficients(chunk, nodes)
                parts += [self._rules[name].part(coefficients) for name in certified]
            return parts

        parts = self._height_parts(nodes, names)
        if measured or certified or cells:
            for name, column in zip((*measured, *certified), zip(*self._over_chunks(work))):
                parts[name] = self._rules[name].join(column)
        whole, signs = self._joined(names, parts), _height_signs(names)
        found = {name: signs.get(name, 1.0) * self._rules[name].value(part) for name, part in whole.items()}
        has_corners = "corner_ks" in whole and not self.pieces.has_planes
        return GridValues(found, q if cells else None, whole["corner_ks"].extreme if has_corners else None)

    def jvp(
        self,
        # nodes and their change (m)
        nodes: np.ndarray,  # (n_nodes, 3)
        d_nodes: np.ndarray,  # (n_nodes, 3)
        values: GridValues,  # result of `evaluate` for the nodes
    ) -> GridValues:  # changes of the entries of ``values``
        """Change of the quality with the nodes."""
        d_q = np.empty(0 if values.q is None else self.n_cells)
        measured, certified = _of_cells(values.aggregates)
        weights = self._weights(values, dict.fromkeys(measured, 1.0))

        def work(chunk: Chunk) -> list[float]:
            found = weights.copy()
            if measured or values.q is not None:
                chunk_jvp(chunk, nodes, d_nodes, found, d_q)
            changes = found["total"].tolist()
            if certified:
                coefficients, change = chunk_coefficients(chunk, nodes), chunk_coefficients_jvp(chunk, nodes, d_nodes)
                for name in certified:
                    changes.append(_sum(self._rules[name].weights(coefficients, values.aggregates[name]), change))
            return changes

        found = self._height_changes(nodes, d_nodes, values.aggregates)
        if measured or certified or values.q is not None:
            rows = self._over_chunks(work)
            totals = np.array(rows).reshape(len(rows), len(measured) + len(certified)).sum(axis=0)
            found |= dict(zip((*measured, *certified), totals.tolist()))
        changes = summed(self.pieces.comm, np.array([found[name] for name in values.aggregates]))
        return GridValues(dict(zip(values.aggregates, changes.tolist())), None if values.q is None else d_q)

    def vjp(
        self,
        nodes: np.ndarray,  # (n_nodes, 3), nodes of all blocks (m)
        values: GridValues,  # result of `evaluate` for the nodes
        bar: GridValues,  # adjoints of some or all of its entries
    ) -> np.ndarray:  # (n_nodes, 3)
        """Adjoint of the nodes from the adjoint of the quality."""
        nodes_bar, q_bar = np.zeros((self.n_nodes, 3)), np.empty(0) if bar.q is None else np.ascontiguousarray(bar.q)
        seeds = {name: seed for name, seed in bar.aggregates.items() if seed != 0.0}
        measured, certified = _of_cells(seeds)
        weights = self._weights(values, {name: seeds[name] for name in measured})

        def work(chunk: Chunk) -> None:
            if measured or bar.q is not None:
                chunk_vjp(chunk, nodes, weights.copy(), q_bar, nodes_bar)
            if certified:
                coefficients = chunk_coefficients(chunk, nodes)
                for name in certified:
                    weight = seeds[name] * self._rules[name].weights(coefficients, values.aggregates[name])
                    chunk_coefficients_vjp(chunk, nodes, weight, nodes_bar)

        if measured or certified or bar.q is not None:
            for parity in (0, 1):  # neighbouring chunks share a layer of nodes
                self._over_chunks(work, parity)
        self._add_height_bars(nodes, values.aggregates, bar.aggregates, nodes_bar)
        return nodes_bar

    def _height_parts(self, nodes: np.ndarray, names: Iterable[str]) -> dict[str, Part]:
        """Parts of the aggregates of heights among the names; an upper bound takes the negative numbers."""
        signs = _height_signs(names)
        ratios = self.first_cells.ratios(nodes) if signs else np.empty(0)
        return {name: self._rules[name].part(sign * ratios) for name, sign in signs.items()}

    def _joined(self, names: Collection[str], parts: Mapping[str, Part]) -> dict[str, Part]:
        """Parts of the whole grid from the parts of this process and the others."""
        none = {name: self._rules[name].part(np.zeros(0)) for name in names}
        tables = gathered(self.pieces.comm, np.array([[parts.get(name, none[name]) for name in names]]))
        return {name: self._rules[name].join([Part(*row[n]) for row in tables]) for n, name in enumerate(names)}

    def _height_changes(self, nodes: np.ndarray, d_nodes: np.ndarray, values: Mapping[str, float]) -> dict[str, float]:
        """Changes of the aggregates of heights that have values."""
        weights = self._height_weights(nodes, values)
        d_ratios = self.first_cells.ratios_jvp(nodes, d_nodes) if weights else np.empty(0)
        return {name: float(_sum(weight, d_ratios)) for name, weight in weights.items()}

    def _add_height_bars(
        self, nodes: np.ndarray, values: Mapping[str, float], seeds: Mapping[str, float], nodes_bar: np.ndarray
    ) -> None:
        """Add the adjoint of the nodes from the adjoints of the aggregates of heights."""
        asked = {name: value for name, value in values.items() if seeds.get(name)}
        weights = self._height_weights(nodes, asked)
        if weights:
            bar: Any = sum(seeds[name] * weight for name, weight in weights.items())
            self.first_cells.ratios_vjp(nodes, bar, nodes_bar)

    def _height_weights(self, nodes: np.ndarray, values: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Derivatives, with respect to every ratio, of the aggregates of heights that have values."""
        signs = _height_signs(values)
        ratios = self.first_cells.ratios(nodes) if signs else np.empty(0)
        return {name: self._rules[name].weights(sign * ratios, sign * values[name]) for name, sign in signs.items()}

    def _bounds(self, names: Iterable[str]) -> np.ndarray:
        """Records of the bounds of measures among the names, without terms."""
        rules = [(AGGREGATES[name].measure, *self._rules[name].settings) for name in _of_cells(names)[0]]
        return bounds_of(rules, self.pieces.n_cells_of_all)

    def _weights(self, values: GridValues, seeds: Mapping[str, float]) -> np.ndarray:
        """Records of the weights of the bounds that have seeds."""
        return weights_of(self._bounds(seeds), [values.aggregates[name] for name in seeds], [*seeds.values()])

    def _over_chunks(self, work: Callable, parity: int | None = None) -> list:
        """Results of ``work`` for all chunks, or for every other one of each block, in order."""
        start, step = (0, 1) if parity is None else (parity, 2)
        chunks = [chunk for block in self.blocks for chunk in list(block.chunks())[start::step]]
        return run_tasks(work, chunks, thread_count(self.n_threads))


def _sum(weights: np.ndarray, changes: np.ndarray) -> float:
    """Sum of products, in an order that does not depend on the threads of BLAS."""
    weights *= changes
    return weights.sum()


def _of_cells(names: Iterable[str]) -> tuple[list[str], list[str]]:
    """Aggregates of measures of cells among the names, in their order, and those of coefficients."""
    of_cells = [name for name in names if not AGGREGATES[name].is_of_heights]
    return [n for n in of_cells if AGGREGATES[n].measure in ROWS], [
        n for n in of_cells if AGGREGATES[n].measure not in ROWS
    ]


def _height_signs(names: Iterable[str]) -> dict[str, float]:
    """Sign of each aggregate of heights among the names, in the order of the table: -1 for an upper bound."""
    return {n: -1.0 if a.is_upper else 1.0 for n, a in AGGREGATES.items() if a.is_of_heights and n in names}
