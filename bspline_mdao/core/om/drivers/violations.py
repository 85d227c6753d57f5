"""Values of a design beyond their limits, and by how much: one rule for tables, reports and commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

__all__ = ["TOLERATED", "Violation", "in_words", "violations_of"]

TOLERATED = 1e-4
"""Fraction of a limit, or of the driver's unit if the limit is zero, by which a value may exceed it: NLopt and SciPy
end within 1e-6 of their unit, which equals the limit if scaling is right."""

LEAST = 1e-6
"""Fraction of the driver's unit that is always tolerated: the default tolerance of `NLoptDriver`."""

MOST_NAMED = 3
"""Number of values named, worst first; the rest are only counted."""


class Violation(NamedTuple):
    """A value beyond its limit."""

    name: str  # name of the value, such as ``thickness[4]``
    excess: float  # distance from the limit; NaN if the value is NaN
    side: str  # ``"below"`` or ``"above"``
    limit: float  # the limit
    tolerated: float  # distance up to which it counts as met

    def __str__(self) -> str:
        """Say which limit it exceeds and by how much."""
        if np.isnan(self.excess):
            return f"{self.name} is no number"
        return f"{self.name} is {self.excess:.3g} {self.side} {self.limit:.6g}"

    @property
    def size(self) -> float:
        """Distance from the limit relative to the tolerated distance; infinite for NaN."""
        return np.inf if np.isnan(self.excess) else self.excess / self.tolerated


def violations_of(
    names: Sequence[str],  # names of the values
    values: np.ndarray,  # values, lower, upper: (n,), values and limits, infinite or NaN if there is none
    lower: np.ndarray,
    upper: np.ndarray,
    unit: np.ndarray | float,  # what the driver sees as 1
    tolerance: float = TOLERATED,  # relative to limits, or to the unit if they are zero
) -> list[Violation]:
    """Find the values, shape (n,), that are beyond their limits."""
    found = []
    for side, excess, limits in (("below", lower - values, lower), ("above", values - upper, upper)):
        sizes = np.where(np.isfinite(limits) & (limits != 0.0), np.abs(limits), unit)
        tolerated = np.maximum(tolerance * sizes, LEAST * np.abs(unit))
        is_beyond = np.isfinite(limits) & ~(excess <= tolerated)  # NaN counts as beyond
        found += [
            Violation(names[n], float(excess[n]), side, float(limits[n]), float(tolerated[n]))
            for n in np.flatnonzero(is_beyond).tolist()
        ]
    return found


def in_words(violations: Sequence[Violation]) -> str:
    """Say that a design is infeasible, with its worst values and their excess; empty if it is feasible."""
    if not violations:
        return ""
    worst = sorted(violations, key=lambda each: each.size, reverse=True)
    rest = len(worst) - MOST_NAMED
    return f"infeasible: {', '.join(map(str, worst[:MOST_NAMED]))}{f', and {rest} more' if rest > 0 else ''}"
