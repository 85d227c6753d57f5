"""Nodes that slide on fixed surfaces, and the correction that fades from them over the blocks.

    y <- y + E (q(y_s; x0_s) - y_s)     y_s: nodes that slide; q: the points of their surfaces nearest to them, as high
                                        above these as on the baseline x0; E: `.wall_correction`

`.grid_map` does the same for one baseline, and also meets given nodes. Here the baseline may change.

Theory: ``docs/theory/sliding.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ..sliding.sliding_nodes import SlidingNodes, SlidNodes
from .wall_correction import WallCorrection

__all__ = ["SlidingCorrection"]


@dataclass(frozen=True, eq=False)
class SlidingCorrection(OneLine):
    """Map that takes nodes to the surfaces that they slide on, and others along."""

    correction: WallCorrection  # E, of the sliding nodes only
    sliding: SlidingNodes

    def apply(self, nodes: np.ndarray, baseline: np.ndarray | None = None) -> SlidNodes:
        """Take nodes, shape (n_nodes, 3), to the surfaces, in place, for a baseline, by default the first one (m)."""
        rows = self.correction.rows
        asked, sliding = nodes[rows], self.sliding
        slid = sliding.at(asked) if baseline is None else sliding.from_baseline(asked, baseline[rows])
        asked[sliding.places] = slid.points
        self.correction.meet(nodes, asked)
        return slid

    def jvp(self, slid: SlidNodes, change: np.ndarray, d_baseline: np.ndarray) -> None:
        """Change of the nodes, in place, with a change of the baseline, both of shape (n_nodes, 3)."""
        rows, places = self.correction.rows, self.sliding.places
        asked = np.zeros((len(rows), 3))
        asked[places] = (
            slid.jvp(change[rows][places]) - change[rows][places] + slid.baseline_jvp(d_baseline[rows][places])
        )
        change += self.correction.forward(asked)

    def vjp(self, slid: SlidNodes, bar: np.ndarray, baseline_bar: np.ndarray) -> None:
        """Transpose of `jvp`: adds to the derivatives in the nodes and in the baseline, both of shape (n_nodes, 3)."""
        rows = self.correction.rows[self.sliding.places]
        asked_bar = self.correction.adjoint(bar)[self.sliding.places]
        bar[rows] += slid.vjp(asked_bar) - asked_bar
        baseline_bar[rows] += slid.baseline_vjp(asked_bar)
