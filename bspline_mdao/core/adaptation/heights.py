"""A loss that preserves the first cell heights at walls: negligible near the baseline's, steep at a tolerance.

    loss = sum_n ((h_n / h_n0 - 1) / (0.9 tolerance))^12

Theory: ``docs/theory/adaptation.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...grids.cells.first_cells import FirstCells

__all__ = ["HeightLoss"]

WEIGHT, POWER, INSIDE = 1.0, 12, 0.9
"""Factor and power of the loss, and the fraction of the tolerance at which one height costs the factor."""


@dataclass(frozen=True, eq=False)
class HeightLoss:
    """The loss."""

    first_cells: FirstCells  # the first cells, with their heights on the baseline
    tolerance: float  # allowed change of heights, relative to the baseline

    def add(
        self,
        nodes: np.ndarray,  # (n_nodes, 3), nodes of all blocks (m)
        nodes_bar: np.ndarray,  # (n_nodes, 3), receives the derivative with respect to the nodes by addition
    ) -> float:
        """Loss of a grid; its derivative is added to ``nodes_bar``."""
        if not self.first_cells.at.size:
            return 0.0
        limit = INSIDE * self.tolerance
        off = (self.first_cells.ratios(nodes) - 1.0) / limit
        self.first_cells.ratios_vjp(nodes, WEIGHT * POWER / limit * off ** (POWER - 1), nodes_bar)
        return float(WEIGHT * np.sum(off**POWER))
