"""Vectors in a plane, shape (n, 2): real or complex, nothing is conjugated."""

from __future__ import annotations

import numpy as np

__all__ = ["cross", "length", "turned"]


def length(vectors: np.ndarray) -> np.ndarray:
    """Lengths, shape (n,)."""
    return np.sqrt((vectors * vectors).sum(axis=-1))


def cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """``u x v``, shape (n,): positive where v is to the left of u."""
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def turned(vectors: np.ndarray) -> np.ndarray:
    """Vectors turned left by a right angle: ``cross(u, v) = turned(u) . v = -turned(v) . u``."""
    return np.stack([-vectors[:, 1], vectors[:, 0]], axis=1)
