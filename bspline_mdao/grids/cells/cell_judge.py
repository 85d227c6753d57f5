"""Quality of the cells of a mesh, whatever their kinds: bounds with derivatives, reports, inverted cells.

For grids of blocks this is `GridQuality` with its baseline and reports (`BlocksJudge`), for meshes of mixed cells
`.mixed_quality.MixedQuality`.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ...base.numerics.processes import from_all, together
from ..topology.block_layout import BlockLayout
from .block_cells import Chunk
from .cell_loops import block_numbers
from .grid_quality import GridQuality, GridValues
from .hexahedron import measured
from .report import QualityReport, inverted_cells, patches_of, report_quality

__all__ = ["BlocksJudge", "CellJudge"]


class CellJudge(Protocol):
    """Quality of cells as a function of nodes; the baseline has made all discrete decisions."""

    @property
    def baseline(self) -> np.ndarray:
        """Nodes of this process on the baseline (m), shape (n_nodes, 3)."""

    @property
    def n_cells(self) -> int:
        """Number of cells of this process."""

    @property
    def lines(self) -> Sequence[np.ndarray]:
        """Numbers of the nodes in blocks or lines, neighbours joined by edges, for checks of derivatives."""

    @property
    def aggregates(self) -> tuple[str, ...]:
        """Names of the available aggregates."""

    def require(self, names: Sequence[str], cells: bool = False) -> None:
        """Refuse unknown names of aggregates, or Q of every cell if cells have none."""

    def evaluate(self, nodes: np.ndarray, names: Sequence[str] | None = None, cells: bool = False) -> GridValues:
        """Aggregate the quality of the cells."""

    def jvp(self, nodes: np.ndarray, d_nodes: np.ndarray, values: GridValues) -> GridValues:
        """Change of the quality with the nodes."""

    def vjp(self, nodes: np.ndarray, values: GridValues, bar: GridValues) -> np.ndarray:
        """Adjoint of the nodes from the adjoint of the quality."""

    def report(self, nodes: np.ndarray, n_bins: int) -> Any:
        """Report for people."""

    def summary(self, nodes: np.ndarray) -> dict[str, float]:
        """Scalars to store for many grids: of the kind of cells, ``n_newly_inverted``, and ratios of heights."""

    def newly_inverted(self, nodes: np.ndarray) -> str:
        """Name the worst newly inverted cell, and its patch or marker; empty if none is."""


@dataclass(frozen=True, eq=False)
class BlocksJudge(GridQuality):
    """The cells of a grid of blocks, or of the pieces of it that processes hold."""

    baseline: np.ndarray = field(kw_only=True)  # (n_nodes, 3), nodes of this process on the baseline (m)

    @property
    def lines(self) -> Sequence[np.ndarray]:
        """The pieces."""
        return BlockLayout.of(piece.shape for piece in self.pieces.local).numbers

    def report(self, nodes: np.ndarray, n_bins: int) -> QualityReport:
        """See `report_quality`."""
        return report_quality(self, nodes, n_bins)

    def summary(self, nodes: np.ndarray) -> dict[str, float]:
        """Smallest Q, corner and volume, mean Q, inverted cells, and heights at walls relative to the baseline."""
        with together(self.pieces.comm):
            rows = np.array([(0, 0, 0.0, *3 * [np.inf]), *self.over_cells(nodes, _numbers_of)])
            (n_inverted, n_new, total), least = rows[:, :3].sum(axis=0).tolist(), rows[:, 3:].min(axis=0)
            ratios = self.first_cells.ratios(nodes)
            low, high = float(ratios.min(initial=np.inf)), float(ratios.max(initial=0.0))
        parts = from_all(self.pieces.comm, (int(n_inverted), int(n_new), total, low, high, *least.tolist()))
        counted, new, sums, lows, highs, q_min, min_corner, min_volume = zip(*parts)
        found = {
            "q_min": min(q_min),
            "q_mean": sum(sums) / self.pieces.n_cells_of_all,
            "min_corner": min(min_corner),
            "min_volume": min(min_volume),
            "n_inverted": sum(counted),
            "n_newly_inverted": sum(new),
        }
        return found | ({"height_min": min(lows), "height_max": max(highs)} if max(highs) else {})

    def newly_inverted(self, nodes: np.ndarray) -> str:
        """Name the worst newly inverted cell, its corner, and the patches of such cells."""
        inverted = inverted_cells(self, self.cells_in_turn(nodes), newly=True)
        if not inverted:
            return ""
        adjacent = ", ".join(f"'{name}'" for name in patches_of(inverted))
        return (
            f"{inverted[0]} is inverted, with corner triple product {inverted[0].corner:.2g}"
            f"{f'; the worst of such cells lie on {adjacent}' if adjacent else ''}"
        )


def _numbers_of(chunk: Chunk, points: np.ndarray) -> tuple[float, ...]:
    """Inverted cells, newly inverted cells, the sum of Q, and the smallest Q, corner and volume."""
    bits = chunk.degenerate_corners
    n_valid, total, *least = block_numbers(points, bits, chunk.block.sign)
    if n_valid == bits.size and np.isfinite([total, *least]).all():
        return 0, 0, total, *least
    q, corners, _, volume = measured(points, bits, chunk.block.handedness).reshape(4, -1)
    n_inverted = q.size - int(np.count_nonzero(corners > 0.0))
    n_new = n_inverted - int(np.count_nonzero(~(corners[chunk.was_invalid()] > 0.0)))
    return n_inverted, n_new, *(float(x) for x in (q.sum(), q.min(), corners.min(), volume.min()))
