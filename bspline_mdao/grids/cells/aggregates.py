"""Smooth lower bounds of the smallest of many numbers, computed in parts, and the table of those that measure a grid.

To add an aggregate of an existing measure, add its entry to `AGGREGATES`; all other code reads that table.

A rule turns an array into a `Part`, the exact extreme and a sum relative to it that cannot overflow. Parts of different
arrays are joined in the order given. The weight of a number in the result, its derivative, follows from the result
alone. Infinite numbers have no weight.

Theory: ``docs/theory/quality.rst``.

G. Kreisselmeier and R. Steinhauser, "Systematic control design by optimizing a vector performance index", IFAC
Proceedings Volumes 12(7), 1979, pp. 113-117.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...base.display import OneLine
from ...errors import InputError

__all__ = ["AGGREGATES", "Aggregate", "KreisselmeierSteinhauser", "PNorm", "Part"]


class Part(NamedTuple):
    """Extreme of an array, and the sum of its terms relative to the term of the extreme (0: nothing to sum)."""

    extreme: float
    total: float


@dataclass(frozen=True)
class KreisselmeierSteinhauser(OneLine):
    """``m - ln(sum exp(-rho (x - m))) / rho`` with m the smallest x: between ``m - ln(n) / rho`` and m; complex-safe.

    Examples
    --------
    >>> rule = KreisselmeierSteinhauser(rho=100.0)
    >>> round(rule.value(rule.part(np.array([0.5, 0.5, 0.9]))), 6)
    0.493069
    """

    rho: float  # sharpness

    def __post_init__(self) -> None:
        if not 0.0 < self.rho < np.inf:
            raise InputError(f"Kreisselmeier-Steinhauser aggregate: rho is {self.rho}; give a positive number")

    @property
    def settings(self) -> tuple[float, int]:
        """Sharpness and power in the form of `.lane_bounds`."""
        return self.rho, 0

    def part_of(self, smallest: float, total: float) -> Part:
        """Part from the smallest number and the sum of the terms relative to its term; NaN if the sum is NaN."""
        return Part(smallest + 0.0 * total, total)

    def part(self, x: np.ndarray) -> Part:
        """Sum over an array."""
        smallest = float(x.real.min(initial=np.inf))
        return Part(smallest, self._terms(x, smallest).sum() if np.isfinite(smallest) else 0.0)

    def join(self, parts: Sequence[Part]) -> Part:
        """Sum over all parts."""
        smallest = float(np.min([part.extreme for part in parts]))  # NaN if a part is NaN
        scales = (np.exp(-self.rho * (part.extreme - smallest)) * part.total for part in parts if part.total)
        return Part(smallest, sum(scales))

    def value(self, part: Part) -> float:
        """The bound; 1 if there is nothing to bound."""
        return (part.extreme - np.log(part.total) / self.rho).item() if part.total else 1.0

    def weights(self, x: np.ndarray, value: float) -> np.ndarray:
        """Derivative of the value with respect to every x."""
        return self._terms(x, value)

    def _terms(self, x: np.ndarray, reference: float) -> np.ndarray:
        terms = x - reference
        terms *= -self.rho
        return np.exp(terms, out=terms)


@dataclass(frozen=True)
class PNorm(OneLine):
    """``1 - |1 - x|_p`` of numbers that are at most 1: between ``1 - n^(1/p) (1 - m)`` and m, the smallest x."""

    p: int  # power, at least 2

    def __post_init__(self) -> None:
        if self.p < 2 or int(self.p) != self.p:
            raise InputError(f"p-norm aggregate: p is {self.p}; give a whole number from 2 on")

    @property
    def settings(self) -> tuple[float, int]:
        """Sharpness and power in the form of `.lane_bounds`."""
        return 0.0, self.p

    def part_of(self, smallest: float, total: float) -> Part:
        """Part from the smallest number, at most 1, and the sum of the terms relative to its term."""
        return Part(1.0 - smallest, total)

    def part(self, x: np.ndarray) -> Part:
        """Sum over an array."""
        largest = max(0.0, 1.0 - float(x.min(initial=1.0)))
        return Part(largest, _power(self._deficits(x, largest), self.p).sum() if largest > 0.0 else 0.0)

    def join(self, parts: Sequence[Part]) -> Part:
        """Sum over all parts."""
        largest = max(part.extreme for part in parts)
        return Part(largest, sum((part.extreme / largest) ** self.p * part.total for part in parts if part.total))

    def value(self, part: Part) -> float:
        """The bound."""
        return float(1.0 - part.extreme * part.total ** (1.0 / self.p))

    def weights(self, x: np.ndarray, value: float) -> np.ndarray:
        """Derivative of the value with respect to every x; 0 if all are 1 or more."""
        if value >= 1.0:
            return np.zeros_like(x)
        return _power(self._deficits(x, 1.0 - value), self.p - 1)

    def _deficits(self, x: np.ndarray, largest: float) -> np.ndarray:
        """Difference of each from 1, divided by the largest."""
        deficits = 1.0 - x
        deficits /= largest
        deficits[deficits < 1e-300 ** (1.0 / self.p)] = 0.0  # their powers would be denormal numbers, which are slow
        return deficits


def _power(x: np.ndarray, n: int) -> np.ndarray:
    """``x**n`` by repeated squaring, in place."""
    result = np.ones_like(x)
    while n:
        if n & 1:
            result *= x
        n >>= 1
        x *= x
    return result


@dataclass(frozen=True)
class Aggregate:
    """A smooth bound of a measure over a whole grid, for a constraint on the worst cell."""

    # bounded quantity: one of `bspline_mdao.grids.cells.lane_bounds.ROWS`, ``"coefficients"`` of the Jacobian, or
    # ``"height"`` for the heights of the first cells at walls
    measure: str
    rule: str  # `KreisselmeierSteinhauser` or `PNorm`; the latter only for values of at most 1
    meaning: str  # description for the documentation of the outputs
    # whether it bounds the largest number from above: minus the lower bound of the negative numbers
    is_upper: bool = False
    is_default: bool = False  # whether it is an output of the component by default
    # description for cells of mixed kinds (`bspline_mdao.grids.cells.mixed_quality`), which have no Q, no corners and
    # no Jacobians; empty if they do not have it
    of_mixed: str = ""

    @property
    def is_of_heights(self) -> bool:
        """Whether it needs walls."""
        return self.measure == "height"


AGGREGATES = {
    "quality_ks": Aggregate("q", "ks", "Kreisselmeier-Steinhauser bound of Q", is_default=True),
    "quality_pnorm": Aggregate("q", "pnorm", "p-norm bound of Q", is_default=True),
    "corner_ks": Aggregate("triples", "ks", "bound of the corner triple products of unit edges", is_default=True),
    "corner_pnorm": Aggregate("triples", "pnorm", "p-norm bound of the corner triple products of unit edges"),
    "jacobian_ks": Aggregate("jacobians", "ks", "bound of the corner Jacobians over the cell's volume in the baseline"),
    "certified_ks": Aggregate(
        "coefficients", "ks", "bound of the Jacobian everywhere in the cells, over the cell's volume in the baseline"
    ),
    "volume_ks": Aggregate(
        "volume",
        "ks",
        "bound of the cell volumes over the baseline's",
        is_default=True,
        of_mixed="bound of the volumes of pyramids from the centres of cells to their faces over the baseline's",
    ),
    "height_low_ks": Aggregate(
        "height",
        "ks",
        "lower bound of the first cells' heights at walls over the baseline's",
        of_mixed="lower bound of the heights of nodes next to walls over the baseline's",
    ),
    "height_high_ks": Aggregate(
        "height",
        "ks",
        "upper bound of the first cells' heights at walls over the baseline's",
        is_upper=True,
        of_mixed="upper bound of the heights of nodes next to walls over the baseline's",
    ),
}
"""The available aggregates, by name, and which of them cells of mixed kinds have."""
