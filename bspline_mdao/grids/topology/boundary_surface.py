"""Faces of a grid as one surface: its unique nodes, and the quads between them.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .node_numbering import NodesByRow, face_layer_rows, node_copies, source_rows
from .topology import BoundaryFace, Topology


@dataclass(frozen=True, eq=False)
class BoundarySurface:
    """Unique nodes of some boundary faces, and the quads between them."""

    rows: np.ndarray  # (n,) of int, row of each node in the grid vector, ascending: the row that is evaluated
    # tuple of ndarray of int, each of shape (ni, nj) of int, numbers of the nodes of every face, such that direction i
    # x direction j points into the fluid
    faces: tuple[np.ndarray, ...]
    # (n,), shortest distance of each node to the next one into the fluid (m); 0 if there is none
    heights: np.ndarray

    @classmethod
    def of(cls, topology: Topology, nodes: np.ndarray | NodesByRow, faces: Sequence[BoundaryFace]) -> BoundarySurface:
        """Take faces of a grid by its nodes, shape (n_nodes, 3), or by the nodes of the faces and their next layers."""
        # Nothing as large as the grid is allocated.
        copies = node_copies(topology)
        layers = [face_layer_rows(topology, face.window) for face in faces]
        sources = [source_rows(copies, layer) for layer, _ in layers]
        rows = np.unique(np.concatenate([source.ravel() for source in sources]))
        oriented = (facing(layer, inner, nodes) for layer, inner in layers)
        ids = tuple(np.searchsorted(rows, source_rows(copies, layer)) for layer in oriented)
        heights = np.full(len(rows), np.inf)
        for (layer, inner), source in zip(layers, sources):
            lengths = np.linalg.norm(nodes[inner] - nodes[layer], axis=-1).ravel()
            np.minimum.at(heights, np.searchsorted(rows, source.ravel()), np.where(lengths > 0, lengths, np.inf))
        return cls(rows, ids, np.where(np.isfinite(heights), heights, 0.0))

    @property
    def quads(self) -> np.ndarray:
        """Corners of the quads, shape (n_quads, 4), face by face in C order, around the normal into the fluid."""
        return np.concatenate([quads_in_turn(ids) for ids in self.faces])

    @property
    def quad_faces(self) -> np.ndarray:
        """Number of the face that each quad is in, shape (n_quads,)."""
        return np.repeat(np.arange(len(self.faces)), [(len(ids) - 1) * (ids.shape[1] - 1) for ids in self.faces])


def quads_in_turn(ids: np.ndarray) -> np.ndarray:
    """Return the corners around i x j, shape (n_quads, 4), of the quads of a face of points, shape (ni, nj)."""
    return corners_in_turn(ids).reshape(-1, 4)


def corners_in_turn(ids: np.ndarray) -> np.ndarray:
    """Return the corners around i x j, shape (ni - 1, nj - 1, ..., 4), of the quads of points (ni, nj, ...)."""
    return np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1)


def facing(
    layer: np.ndarray,  # layer, inner: (ni, nj) of int, points of the face, and the points next to them in the block
    inner: np.ndarray,
    points: np.ndarray | NodesByRow,  # (n, 3), coordinates (m)
) -> np.ndarray:  # (ni, nj) or (nj, ni) of int, the face, transposed if it is oriented the other way
    """Turn a face so that i x j points to the layer next to it, whatever the handedness of the block."""
    return layer if volume_behind(layer, inner, points) > 0.0 else layer.T


def volume_behind(layer: np.ndarray, inner: np.ndarray, points: np.ndarray | NodesByRow) -> float:
    """Twice the volume (m^3) between a face and its next layer, negative if i x j points away; see `facing`."""
    x = points[layer]
    area = np.cross(x[1:, 1:] - x[:-1, :-1], x[:-1, 1:] - x[1:, :-1])
    return float(np.sum(area * (points[inner] - x)[:-1, :-1]))
