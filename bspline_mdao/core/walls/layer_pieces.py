"""Pieces of the layer at a wall: nodes that one thread moves at a time, each piece over a part of the wall.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["Piece", "add_up", "cut"]

CHUNK_NODES = 2**12
"""Nodes per piece of work: few enough for two-byte numbers of the corners of their triangles."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Some nodes of the layer, with the wall's nodes that they depend on."""

    rows: np.ndarray  # (n,) of int, rows of the nodes, ascending
    starts: np.ndarray  # (n + 1,) of int, first closest point of each
    planes: np.ndarray  # (n,) of int, number of the projector of each
    # (n_closest, 3), corners of the triangle of each closest point, among the piece's nodes of the wall
    corners: np.ndarray
    # (n_closest, 2), weights of the first two corners (all three sum to one): barycentric coordinates, or the weights
    # for `by_corners`. Single precision suffices: a point slightly off the closest one does as well.
    barycentric: np.ndarray
    weights: np.ndarray  # (n_closest,), how much the node follows the wall at each, beta_f
    wall_ids: np.ndarray  # (n_corners,) of int, the piece's nodes of the wall, ascending
    by_corners: bool  # whether nodes turn about the corners of the triangles, and not about the closest points


def cut(
    rows: np.ndarray,
    counts: np.ndarray,
    places: np.ndarray,
    planes: np.ndarray,
    corners: np.ndarray,
    barycentric: np.ndarray,
    weights: np.ndarray,
    by_corners: np.ndarray,
) -> tuple[Piece, ...]:
    """Cut the nodes of a layer into pieces, each over a part of the wall."""
    starts = np.concatenate([[0], np.cumsum(counts)])
    order = np.argsort(places, kind="stable")
    parts = [(turns, order[by_corners[order] == turns]) for turns in (True, False)]
    cuts = [(turns, part[k : k + CHUNK_NODES]) for turns, part in parts for k in range(0, len(part), CHUNK_NODES)]
    pieces = []
    for turns, nodes in cuts:
        nodes = nodes[np.argsort(rows[nodes])]
        ends = np.cumsum(counts[nodes])
        closest = np.arange(ends[-1]) + np.repeat(starts[nodes] - ends + counts[nodes], counts[nodes])
        wall_ids, local = np.unique(corners[closest], return_inverse=True)
        pieces.append(
            Piece(
                rows[nodes].astype(np.int32),
                np.concatenate([[0], ends]).astype(np.int32),
                planes[nodes],
                local.reshape(-1, 3).astype(np.uint16),
                barycentric[closest].astype(np.float32),
                weights[closest].astype(np.float32),
                wall_ids,
                turns,
            )
        )
    return tuple(pieces)


def add_up(pieces: Sequence[Piece], sums: Sequence[np.ndarray], out: np.ndarray) -> None:
    """Add the sums of all pieces, in their order."""
    for piece, part in zip(pieces, sums):
        out[piece.wall_ids] += part
