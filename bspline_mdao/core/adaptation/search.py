"""Search for values of interior control points that improve the worst cells of every block.

    x = x_0 + A E v

with the spline map A of the fit (whose residual is preserved), the displacements E of `InteriorPoints`, and v within
bounds. Rounds of L-BFGS-B lower the losses of `.loss` and `.heights`, and one for the grid's worst corner. Each round
is sharper than the previous, with free control points that move cells near the worst of a block. A result that makes a
block worse, inverts a cell or exceeds the height tolerance is rejected: the control points responsible are fixed, and
the round is run again.

Theory: ``docs/theory/adaptation.rst``.

References
----------
R. H. Byrd, P. Lu, J. Nocedal and C. Zhu, A limited memory algorithm for bound constrained optimization, *SIAM Journal
on Scientific Computing* 16(5), 1995.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from ...grids.cells.block_cells import BlockCells
from ...grids.cells.grid_quality import GridQuality, GridValues
from ...grids.cells.report import report_quality
from ..design.interior_points import InteriorShift
from ..model.fitted_model import FittedModel
from .heights import HeightLoss
from .improvement import LEAST_GAIN, ORTHOGONAL, BlockChange, Improvement, WorstOfBlock, reason_of
from .loss import MEAN, WIDTH, WorstCells, price, price_slope, stretched

__all__ = ["Search"]

ATTEMPTS = 6
"""Number of times a round is run, each without the control points that spoiled the previous run."""

FRACTION = 0.5
"""Cells are near the worst of their block if their distance from orthogonal is at least this fraction of the
worst's."""

STUCK = 1e-3
"""A cell that random steps change by less than this, in the measure of `.loss`, cannot be improved and is guarded."""

PROBES = 8
"""Number of random sign vectors used to estimate the scales of values."""

ROUND_OFF = 1e-9
"""Q may decrease by this and count as unchanged."""

CORNER = "corner_ks"
"""The smooth bound of the corners of all cells."""

CORNER_SHARPNESS = 300.0
"""Its sharpness."""

MOST_MARGIN = 3 * WIDTH
"""Largest required rise of that bound, so that the worst corner itself does not decrease."""


class Search:
    """State of the search: the last accepted values, and what they are compared with."""

    def __init__(self, model: FittedModel, shift: InteriorShift, tolerance: float):
        self.model, self.shift, self.tolerance = model, shift, tolerance
        grid = model.regenerate()
        self.evaluator, self.quality = model.evaluator(), GridQuality.of_baseline(grid, rho=CORNER_SHARPNESS)
        self.nodes = grid.to_vector().reshape(-1, 3)
        self.heights = HeightLoss(self.quality.first_cells, tolerance)
        self.q = self.cells(self.nodes)
        self.corners = self.corners_of(self.nodes)
        self.corner_bound = self.quality.evaluate(self.nodes, (CORNER,)).aggregates[CORNER]
        self.worst = self.worst_by_block(self.q)
        self.values, self.q_now = shift.initial, self.q
        self.is_fixed = np.zeros(shift.n_values, dtype=bool)
        self.iterations = self.evaluations = 0
        self.margin, self.mean = 0.0, MEAN
        self.moved_by_any = self.moved_cells(np.ones(shift.n_values, dtype=bool))
        self.scales = self.scales_of_heights()

    @property
    def slices(self) -> list[slice]:
        """Cells of every block."""
        return [block.cells for block in self.quality.blocks]

    def nodes_at(self, values: np.ndarray) -> np.ndarray:
        """Nodes of the grid (m); nodes that no control point moves keep every bit."""
        return self.nodes + self.evaluator.forward(self.shift.displacement(values))

    def cells(self, nodes: np.ndarray) -> np.ndarray:
        """Q of every cell."""
        q = self.quality.evaluate(nodes, (), cells=True).q
        assert q is not None
        return q

    def corners_of(self, nodes: np.ndarray) -> np.ndarray:
        """Smallest corner triple product of unit edges of every cell."""
        return np.concatenate([measures.min_corner.ravel() for measures in self.quality.cells_in_turn(nodes)])

    def worst_by_block(self, q: np.ndarray) -> np.ndarray:
        """Smallest Q of every block."""
        return np.array([q[cells].min() for cells in self.slices])

    def loss(self, values: np.ndarray, worst: WorstCells) -> tuple[float, np.ndarray]:
        """Loss of a grid, and its derivative with respect to the values."""
        self.evaluations += 1
        nodes = self.nodes_at(values)
        found = self.quality.evaluate(nodes, (CORNER,), cells=True)
        assert found.q is not None
        gain = found.aggregates[CORNER] - self.corner_bound - self.margin
        bar = self.quality.vjp(nodes, found, GridValues({CORNER: price_slope(gain)}, worst.gradient(found.q)))
        loss = worst.value(found.q) + price(gain) + self.heights.add(nodes, bar)
        return loss, self.shift.vjp(self.evaluator.adjoint(bar))

    def run_round(self, sharpness: float, iterations: int) -> None:
        """Accept the result of L-BFGS-B unless it spoils something; then prevent that and try again."""
        # The smooth bound of corners leaves some slack: if only the worst corner of the grid has decreased, that bound
        # is raised first. If a block has got worse, the mean of its cells is dropped. Control points that still spoil a
        # grid are fixed.
        for _ in range(ATTEMPTS):
            free = self.free_values()
            if not free.any():
                return
            values = self.minimised(sharpness, iterations, free)
            nodes = self.nodes_at(values)
            q, corners = self.cells(nodes), self.corners_of(nodes)
            has_low_corner = bool(corners.min() < self.corners.min() - ROUND_OFF)
            spoiled = self.spoiled_nodes(nodes, q, corners)
            if not spoiled.any() and not has_low_corner:
                if self.score(q) > self.score(self.q_now) + LEAST_GAIN:
                    self.values, self.q_now = values, q
                return
            if has_low_corner and self.margin < MOST_MARGIN:
                self.margin += WIDTH
            elif has_low_corner:
                spoiled |= self.nodes_of_cells(corners < self.corners.min() - ROUND_OFF)
            if self.mean and spoiled.any():
                self.mean = 0.0
            else:
                self.is_fixed |= self.values_that_move(spoiled)

    def minimised(self, sharpness: float, iterations: int, free: np.ndarray) -> np.ndarray:
        """Values found by L-BFGS-B from the last accepted ones, varying the free ones."""
        is_moved = self.moved_cells(free) & ~self.stuck_cells(free)
        worst = WorstCells.at(
            self.q_now, [np.flatnonzero(is_moved[s]) + s.start for s in self.slices], sharpness, self.mean
        )
        values, scales = self.values.copy(), self.scales[free]

        def loss(some: np.ndarray) -> tuple[float, np.ndarray]:
            values[free] = some * scales
            value, gradient = self.loss(values, worst)
            return value, gradient[free] * scales

        bounds = np.column_stack([self.shift.lower[free] / scales, self.shift.upper[free] / scales])
        settings = {"maxiter": iterations, "maxfun": 3 * iterations, "maxcor": 20}
        found = minimize(loss, values[free] / scales, jac=True, method="L-BFGS-B", bounds=bounds, options=settings)
        self.iterations += int(found.nit)
        values[free] = found.x * scales
        return values

    def scales_of_heights(self) -> np.ndarray:
        """Equivalent steps of the values for the optimizer: short if they affect first cell heights."""
        # The sum of squares of a column of the derivative of all heights is the mean square of its products with random
        # signs.
        first, random, squares = self.quality.first_cells, np.random.default_rng(0), np.zeros(self.shift.n_values)
        for _ in range(PROBES if first.at.size else 0):
            bar = np.zeros_like(self.nodes)
            first.ratios_vjp(self.nodes, random.choice([-1.0, 1.0], first.at.size), bar)
            squares += self.shift.vjp(self.evaluator.adjoint(bar)) ** 2 / PROBES
        return 1.0 / np.sqrt(1.0 + squares / self.tolerance**2)

    def free_values(self) -> np.ndarray:
        """Values that move cells near the worst of their block."""
        lacks = 1.0 - self.q_now
        near = np.zeros(lacks.size, dtype=bool)
        for cells in self.slices:
            moved = self.moved_by_any[cells]
            most = lacks[cells][moved].max(initial=0.0)
            near[cells] = moved & (lacks[cells] >= FRACTION * most) & (most > ORTHOGONAL)
        return self.values_that_move(self.nodes_of_cells(near)) & ~self.is_fixed

    def spoiled_nodes(self, nodes: np.ndarray, q: np.ndarray, corners: np.ndarray) -> np.ndarray:
        """Nodes of cells that make a block worse or are newly inverted, and nodes next to walls with wrong heights."""
        is_worse = (self.corners > 0.0) & ~(corners > 0.0)
        for cells, least in zip(self.slices, self.worst):
            is_worse[cells] |= q[cells] < least - ROUND_OFF
        is_spoiled = self.nodes_of_cells(is_worse)
        first = self.quality.first_cells
        is_off = np.abs(first.ratios(nodes) - 1.0) > self.tolerance if first.at.size else np.zeros(0, dtype=bool)
        is_spoiled[first.next_rows[is_off]] = True
        return is_spoiled

    def score(self, q: np.ndarray) -> float:
        """Score for comparing unspoiled grids: the worst of all blocks, with the grid's worst counted twice."""
        worst = stretched(self.worst_by_block(np.where(self.moved_by_any, q, np.inf)).clip(max=1.0))
        return float(worst.sum() + worst.min())

    def moved_cells(self, free: np.ndarray) -> np.ndarray:
        """Whether some of the values move a node of each cell."""
        points = np.zeros((self.shift.n_points, 3))
        points[self.shift.point_ids[free]] = 1.0
        return self.cells_of_nodes(self.evaluator.forward(points)[:, 0] > 0.0)

    def values_that_move(self, is_node: np.ndarray) -> np.ndarray:
        """Which values move some of the nodes."""
        weights = self.evaluator.adjoint(np.repeat(is_node[:, None].astype(float), 3, axis=1))[:, 0]
        return weights[self.shift.point_ids] > 0.0

    def stuck_cells(self, free: np.ndarray) -> np.ndarray:
        """Cells far from orthogonal that random steps of some values hardly change: most cells on walls."""
        nodes, random = self.nodes_at(self.values), np.random.default_rng(0)
        found, changes = self.quality.evaluate(nodes, (), cells=True), []
        for _ in range(2):
            step = np.where(free, random.uniform(-self.shift.reach, self.shift.reach, free.size), 0.0)
            change = self.quality.jvp(nodes, self.evaluator.forward(self.shift.displacement(step)), found).q
            assert change is not None
            changes.append(np.abs(change))
        return (np.max(changes, axis=0) < STUCK * np.hypot(self.q_now, 1e-3)) & (self.q_now < 0.98)

    def cells_of_nodes(self, is_node: np.ndarray) -> np.ndarray:
        """Whether each cell has one of the nodes."""
        parts = []
        for block in self.quality.blocks:
            inside = block.nodes_of(is_node)
            for d in range(3):
                if inside.shape[d] > 1:
                    before, after = (np.take(inside, range(n, inside.shape[d] - 1 + n), axis=d) for n in (0, 1))
                    inside = before | after
            parts.append(inside.ravel())
        return np.concatenate(parts)

    def nodes_of_cells(self, is_cell: np.ndarray) -> np.ndarray:
        """Whether each node belongs to one of the cells."""
        is_node = np.zeros(len(self.nodes), dtype=bool)
        for block in self.quality.blocks:
            marked = is_cell[block.cells].reshape([max(1, n - 1) for n in block.window.shape])
            for d in range(3):
                if block.window.shape[d] > 1:
                    ends = ([(n, 1 - n) if e == d else (0, 0) for e in range(3)] for n in (0, 1))
                    before, after = (np.pad(marked, widths) for widths in ends)
                    marked = before | after
            block.nodes_of(is_node)[...] = marked
        return is_node

    def result(self, seconds: float) -> Improvement:
        """Report the result."""
        nodes = self.nodes_at(self.values)
        changes = [
            BlockChange(self.worst_cell(block, self.q), self.worst_cell(block, self.q_now))
            for block in self.quality.blocks
        ]
        return Improvement(
            grid=self.model.header.grid(self.model.topology.shapes, nodes),
            control_points=self.shift.apply(self.model.control_points, self.values),
            shift=self.shift,
            values=self.values,
            before=report_quality(self.quality, self.nodes),
            after=report_quality(self.quality, nodes),
            blocks=tuple(changes),
            iterations=self.iterations,
            evaluations=self.evaluations,
            seconds=seconds,
            reason=reason_of(changes),
        )

    def worst_cell(self, block: BlockCells, q: np.ndarray) -> WorstOfBlock:
        """The worst cell of a block."""
        n = int(np.argmin(q[block.cells]))
        is_fixed = not self.moved_by_any[block.cells][n]
        i, j, k = block.number(n)
        return WorstOfBlock(block.name, i, j, k, float(q[block.cells][n]), is_fixed)
