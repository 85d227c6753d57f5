"""A smooth loss that decreases as the worst cells of every block improve.

    g(Q) = asinh(Q / 0.001),    t_b = KS_rho(g of the cells of block b) - its value at the start,
    loss = sum_b  -t_b + kappa s ln(1 + exp(-t_b / s)) - 0.3 (mean Q of the cells)

The change of variable values the same ratio of gain equally whatever Q is, also through zero, since Q is a product of
eight corners. The second term charges blocks that get worse twenty times what others gain; the third keeps other cells
from losing more than necessary for the worst ones.

Theory: ``docs/theory/adaptation.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...grids.cells.aggregates import KreisselmeierSteinhauser

__all__ = ["MEAN", "WIDTH", "WorstCells", "price", "price_slope", "stretched"]

SMALL = 1e-3
"""Q below which gains count by difference instead of ratio."""

PRICE, WIDTH = 20.0, 5e-3
"""Cost of a block that gets worse, relative to its loss, and the width of the transition."""


MEAN = 0.3
"""Weight of the mean Q of a block's cells relative to the gain of its worst."""


def stretched(q: np.ndarray) -> np.ndarray:
    """Return ``asinh(Q / 0.001)``; complex-safe."""
    return np.arcsinh(q / SMALL)


@dataclass(frozen=True, eq=False)
class WorstCells:
    """The loss. Made by `WorstCells.at`."""

    groups: tuple[np.ndarray, ...]  # of int, numbers of the cells considered in every block
    rule: KreisselmeierSteinhauser  # smooth smallest number
    start: tuple[float, ...]  # value of the rule for each group at the start
    mean: float = MEAN  # weight of the mean Q of a block's cells

    @classmethod
    def at(
        cls,
        q: np.ndarray,  # (n_cells,), Q of every cell at the start
        # of int, numbers of the cells considered, block by block; a block without any is left out
        groups: Sequence[np.ndarray],
        sharpness: float,  # of the smooth minimum: it is below the smallest ``g`` by at most ln(n) / sharpness
        mean: float = MEAN,  # weight of the mean Q of a block's cells
    ) -> WorstCells:
        """Make the loss."""
        rule, kept = KreisselmeierSteinhauser(sharpness), tuple(ids for ids in groups if len(ids))
        return cls(kept, rule, tuple(rule.value(rule.part(stretched(q[ids]))) for ids in kept), mean)

    def value(self, q: np.ndarray) -> float:
        """Loss of a grid from Q of every cell, shape (n_cells,); complex-safe."""
        gains = zip(self.groups, self._gains(q))
        return sum(price(gain) - gain - self.mean * q[ids].mean() for ids, gain in gains)

    def gradient(self, q: np.ndarray) -> np.ndarray:
        """Derivative of `value` with respect to Q of every cell, shape (n_cells,)."""
        bar = np.zeros_like(q)
        for ids, start, gain in zip(self.groups, self.start, self._gains(q)):
            qualities = q[ids]
            weights = self.rule.weights(stretched(qualities), gain + start)
            slope = (price_slope(gain) - 1.0) * weights / np.hypot(qualities, SMALL)
            bar[ids] = slope - self.mean / len(ids)
        return bar

    def _gains(self, q: np.ndarray) -> list[float]:
        """Gain of every block."""
        parts = (self.rule.value(self.rule.part(stretched(q[ids]))) for ids in self.groups)
        return [value - start for value, start in zip(parts, self.start)]


def price(gain: float) -> float:
    """Price of a negative gain, zero beyond some `WIDTH`; complex-safe, without overflow."""
    low = min(0.0, np.real(gain))
    return PRICE * (WIDTH * np.log(np.exp(low / WIDTH) + np.exp((low - gain) / WIDTH)) - low)


def price_slope(gain: float) -> float:
    """Derivative of `price`."""
    return -PRICE / (1.0 + np.exp(min(gain / WIDTH, 700.0)))
