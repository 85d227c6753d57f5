"""Quads of structured faces, in turn around their normal, and which way a face looks."""

from __future__ import annotations

import numpy as np

__all__ = ["corners_in_turn", "facing", "quads_in_turn"]


def quads_in_turn(ids: np.ndarray) -> np.ndarray:
    """Corners of the quads of a face of points, shape (ni, nj), around i x j; shape (n_quads, 4), in C order."""
    return corners_in_turn(ids).reshape(-1, 4)


def corners_in_turn(ids: np.ndarray) -> np.ndarray:
    """Corners of the quads of layers of points, shape (ni, nj, ...), around i x j; shape (ni - 1, nj - 1, ..., 4)."""
    return np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1)


def facing(layer: np.ndarray, inner: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Turn a face so that i x j points to the layer next to it, whatever the handedness of the block.

    Parameters
    ----------
    layer, inner : ndarray of int, shape (ni, nj)
        Points of the face, and those next to them in the block.
    points : ndarray, shape (n, 3)
        Coordinates (m).

    Returns
    -------
    ndarray of int, shape (ni, nj) or (nj, ni)
        The face, transposed where it looks the other way.
    """
    x = points[layer]
    area = np.cross(x[1:, 1:] - x[:-1, :-1], x[:-1, 1:] - x[1:, :-1])
    return layer if np.sum(area * (points[inner] - x)[:-1, :-1]) > 0.0 else layer.T
