"""Displacements as sums of two numbers: the second holds what rounding leaves of the first.

Theory: ``docs/theory/elasticity.rst``.
"""

from __future__ import annotations

import numpy as np

__all__ = ["corrected", "in_two", "less"]


def in_two(parts: np.ndarray) -> np.ndarray:
    """The same sum of parts, as one of two."""
    return parts if len(parts) == 2 else np.stack([parts[0], np.zeros_like(parts[0])])


def corrected(parts: np.ndarray, correction: np.ndarray) -> np.ndarray:
    """Add a correction to a sum of two parts: two again, the second below the last digit of the first."""
    first, lost = _sum(parts[0], correction)
    return np.stack(_sum(first, lost + parts[1]))


def less(load: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Difference of two sums of parts, exact until it is rounded once, shape (n_points, 3)."""
    first, lost = _sum(load[0], -force[0])
    return first + (lost + (load[1:].sum(axis=0) - force[1:].sum(axis=0)))


def _sum(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum, and exactly what its rounding leaves [Knuth, The Art of Computer Programming 2, 4.2.2]."""
    total = a + b
    of_b = total - a
    return total, (a - (total - of_b)) + (b - of_b)
