"""The result of improving a grid, or why it could not be improved.

Theory: ``docs/theory/adaptation.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...grids.cells.report import NamedCell, QualityReport
from ...grids.topology.grid import Grid
from ..design.interior_points import InteriorShift
from .loss import stretched

__all__ = ["LEAST_GAIN", "ORTHOGONAL", "BlockChange", "Improvement", "WorstOfBlock", "reason_of"]

ORTHOGONAL = 1e-6
"""Blocks whose worst cell is within this of orthogonal have nothing to gain."""

LEAST_GAIN = 1e-3
"""A round is accepted if its grid is better by this, in the measure of `.loss`, a thousandth of the ratio of Q."""


@dataclass(frozen=True)
class WorstOfBlock(NamedCell):
    """The cell of a block with the smallest Q, which is to be improved."""

    q: float
    is_fixed: bool


@dataclass(frozen=True)
class BlockChange(OneLine):
    """Change of the worst cells of a block."""

    # before, after: the worst cell of the block, before and after
    before: WorstOfBlock
    after: WorstOfBlock


@dataclass(frozen=True, eq=False)
class Improvement(OneLine):
    """A grid with improved worst cells, or the reason why nothing improved.

    Parameters
    ----------
    grid : Grid
        The grid; the given one if nothing could be improved.
    control_points : ndarray, shape (n_control_points, 3)
        Its control points (m).
    shift : InteriorShift
        The variables.
    values : ndarray, shape (n_values,)
        Their values.
    before, after : QualityReport
        The cells of the grid before and after; first cell heights are compared with the heights before.
    blocks : tuple of BlockChange
        The worst cells of every block.
    iterations, evaluations : int
        Counts of the optimizer, in all rounds.
    seconds : float
        Wall time of the improvement.
    reason : str
        Why nothing could be improved, or what limits the worst cell of the grid; empty if that has improved.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.adaptation import improve_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> found = improve_grid(fit_grid(brick_grid((5, 5, 5, 5))), iterations=2)
    >>> found.before.n_inverted, found.after.n_inverted
    (0, 0)
    """

    grid: Grid
    control_points: np.ndarray
    shift: InteriorShift
    values: np.ndarray
    before: QualityReport
    after: QualityReport
    blocks: tuple[BlockChange, ...]
    iterations: int
    evaluations: int
    seconds: float
    reason: str = ""

    @property
    def is_better(self) -> bool:
        """Whether the worst movable cells are better; if not, the grid is the given one."""
        return bool(self.values.any())

    @property
    def n_moved(self) -> int:
        """Number of moved control points."""
        return len(np.unique(self.shift.point_ids[self.values != 0.0]))


def reason_of(changes: Sequence[BlockChange]) -> str:
    """Say why the worst cell of a grid has not improved; empty if it has."""
    worst = min((change.before for change in changes), key=lambda cell: cell.q)
    least = min(change.after.q for change in changes)
    if stretched(np.array(least)) > stretched(np.array(worst.q)) + LEAST_GAIN / 2.0:
        return ""
    if 1.0 - worst.q <= ORTHOGONAL:
        return "all cells are orthogonal"
    if worst.is_fixed:
        return f"the worst, {worst}, has no node that an interior control point moves: all lie on what is fixed"
    return (
        f"the worst, {worst}, is not raised by any step that leaves the surface and the heights of first cells as they "
        f"are, and all other blocks as good"
    )
