"""Vectors in the plane, shape (n, 2), and in space, shape (n, 3): real or complex, nothing is conjugated."""

from __future__ import annotations

import numpy as np

__all__ = ["cross", "lengths", "turned", "unit_vectors"]


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Lengths, shape (...), of vectors, shape (..., d)."""
    return np.sqrt((vectors * vectors).sum(axis=-1))


def unit_vectors(vectors: np.ndarray, otherwise: np.ndarray, least: float) -> np.ndarray:
    """Vectors, shape (..., d), of length 1; ``otherwise``, of the same, where they are not longer than ``least``."""
    length = lengths(vectors)[..., None]
    return np.where(length > least, vectors / np.maximum(length, least), otherwise)


def cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """``u x v`` in the plane, shape (n,): positive where v is to the left of u."""
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def turned(vectors: np.ndarray) -> np.ndarray:
    """Vectors of the plane turned left by a right angle: ``cross(u, v) = turned(u) . v = -turned(v) . u``."""
    return np.stack([-vectors[:, 1], vectors[:, 0]], axis=1)
