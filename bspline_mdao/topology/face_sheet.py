"""Faces of a grid as one surface: its nodes, each once, and the quads between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .entities import BoundaryFace
from .face_quads import facing, quads_in_turn
from .index_space import Window
from .sharing import block_rows, node_sharing
from .topology import Topology

__all__ = ["FaceSheet"]


@dataclass(frozen=True, eq=False)
class FaceSheet:
    """Nodes of some boundary faces.

    Parameters
    ----------
    rows : ndarray of int, shape (n,)
        Row of each node in the grid vector, ascending: the one that is evaluated.
    faces : tuple of ndarray of int, each of shape (ni, nj)
        Numbers of the nodes of every face, such that direction i x direction j points into the fluid.
    heights : ndarray, shape (n,)
        Shortest distance of each node to the next one into the fluid (m); 0 where there is none.
    """

    rows: np.ndarray
    faces: tuple[np.ndarray, ...]
    heights: np.ndarray

    @classmethod
    def of(cls, topology: Topology, nodes: np.ndarray, faces: Sequence[BoundaryFace]) -> FaceSheet:
        """Take faces of a grid by its nodes, shape (n_nodes, 3)."""
        blocks, source = block_rows(topology.shapes), node_sharing(topology).source_rows()
        layers = [_layers(blocks[face.window.block], face.window) for face in faces]
        rows = np.unique(np.concatenate([source[layer].ravel() for layer, _ in layers]))
        oriented = (facing(layer, inner, nodes) for layer, inner in layers)
        ids = tuple(np.searchsorted(rows, source[layer]) for layer in oriented)
        heights = np.full(len(rows), np.inf)
        for layer, inner in layers:
            lengths = np.linalg.norm(nodes[inner] - nodes[layer], axis=-1).ravel()
            np.minimum.at(heights, np.searchsorted(rows, source[layer].ravel()), np.where(lengths > 0, lengths, np.inf))
        return cls(rows, ids, np.where(np.isfinite(heights), heights, 0.0))

    @property
    def quads(self) -> np.ndarray:
        """Corners of the quads, shape (n_quads, 4), face by face in C order, around the normal into the fluid."""
        return np.concatenate([quads_in_turn(ids) for ids in self.faces])

    @property
    def quad_faces(self) -> np.ndarray:
        """Number of the face that each quad is in, shape (n_quads,)."""
        return np.repeat(np.arange(len(self.faces)), [(len(ids) - 1) * (ids.shape[1] - 1) for ids in self.faces])


def _layers(block: np.ndarray, window: Window) -> list[np.ndarray]:
    """Rows of the nodes of a face window, and of those next to them in its block, given by its rows."""
    direction = window.shape.index(1)
    at = window.lo[direction]
    slices = tuple(s for d, s in enumerate(window.slices) if d != direction)
    next_one = min(1, block.shape[direction] - 1) if at == 0 else at - 1
    return [np.take(block, n, axis=direction)[slices] for n in (at, next_one)]
