"""The faces of a block and the layers of nodes next to them, from which the topology of a grid is found.

A topology needs no node inside a block, so the process that finds it holds shells instead of blocks. Values at the
nodes of faces (`OnFaces`) are indexed by windows as if there were an array of the block's shape.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .index_space import Window, window_rows

__all__ = ["FaceNodes", "OnFaces", "Shell"]

N_SAMPLES = 3000
"""Approximate number of values of a block from which the precision of its data is judged."""


@dataclass(frozen=True, eq=False)
class FaceNodes:
    """The nodes on the faces of a block, in its C order."""

    shape: tuple[int, ...]  # number of nodes of the block in each direction
    numbers: np.ndarray  # (n,) of int, their numbers in the C order of the block, ascending

    @classmethod
    def of(cls, shape: tuple[int, ...]) -> FaceNodes:
        """Number the nodes on the faces of a block; a direction of one node has no faces."""
        whole = Window.whole(0, shape)
        faces = [window_rows(whole.face(face), shape).ravel() for face in range(6) if shape[face // 2] > 1]
        return cls(tuple(shape), np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *faces])))

    def places(self, window: Window) -> np.ndarray:
        """Place of each node of a window among these, an array of the window's shape; -1 inside the block."""
        wanted = window_rows(window, self.shape)
        at = np.minimum(np.searchsorted(self.numbers, wanted), max(len(self.numbers) - 1, 0))
        return np.where(self.numbers[at] == wanted, at, -1) if len(self.numbers) else np.full(wanted.shape, -1)

    def face(self, face: int) -> np.ndarray:
        """Place of each node of a face (see `FACE_NAMES`), over the tangent directions in ascending order."""
        return self.places(Window.whole(0, self.shape).face(face)).squeeze(face // 2)


@dataclass(frozen=True, eq=False)
class OnFaces:
    """Values at the nodes on the faces of a block."""

    nodes: FaceNodes  # the nodes
    values: np.ndarray  # (n, ...), value at each of them
    inside: Any  # value everywhere else

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of nodes of the block in each direction."""
        return self.nodes.shape

    def at(self, window: Window) -> np.ndarray:
        """Values at a window of the block, an array of its shape."""
        places = self.nodes.places(window)
        if not len(self.values):
            return np.full(places.shape, self.inside)
        return np.where(places >= 0, self.values[places], self.inside)

    def face(self, face: int) -> np.ndarray:
        """Values at a face (see `FACE_NAMES`), over the tangent directions in ascending order."""
        return self.values[self.nodes.face(face)]

    def dense(self) -> np.ndarray:
        """Values at all nodes of the block, an array of its shape."""
        return self.at(Window.whole(0, self.shape))


@dataclass(frozen=True, eq=False)
class Shell:
    """Nodes on the faces of a block and next to them, and what the topology needs to know of all others."""

    nodes: FaceNodes  # the face nodes
    points: np.ndarray  # (n, 3), nodes on the faces (m)
    # layer of nodes next to each face, shape (n, m, 3), over its tangent directions in ascending order (m); None for a
    # direction of one node
    inner_layers: tuple[np.ndarray | None, ...]
    samples: np.ndarray  # (n_samples,), coordinates spread over the block (m)
    # extent, largest: largest extent of the block along a coordinate, and its largest absolute coordinate (m)
    extent: float
    largest: float

    @classmethod
    def of(cls, nodes: np.ndarray) -> Shell:
        """Take the shell of a block by its nodes, shape (ni, nj, nk, 3)."""
        shape = nodes.shape[:3]
        on_faces, flat = FaceNodes.of(shape), nodes.reshape(-1, 3)
        inner_layers = tuple(
            np.ascontiguousarray(np.moveaxis(nodes, d, 0)[-2 if side else 1]) if shape[d] > 1 else None
            for d in range(3)
            for side in (0, 1)
        )
        samples = flat[:: max(1, nodes.size // N_SAMPLES)].ravel()
        extent = float(np.ptp(flat, axis=0).max())
        largest = float(max(abs(flat.min()), abs(flat.max())))
        return cls(on_faces, flat[on_faces.numbers], inner_layers, samples.copy(), extent, largest)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of nodes of the block in each direction."""
        return self.nodes.shape

    def at(self, window: Window) -> np.ndarray:
        """Nodes of a window on a face, an array of its shape and 3 (m)."""
        return self.points[self.nodes.places(window)]

    def layers(self, window: Window) -> tuple[np.ndarray, np.ndarray]:
        """Nodes of a face window and the next layer, as `bspline_mdao.grids.topology.index_space.face_layers` (m)."""
        flat = window.shape.index(1)
        tangents = tuple(part for d, part in enumerate(window.slices) if d != flat)
        inner, face = self.inner_layers[2 * flat + (window.lo[flat] > 0)], self.at(window).squeeze(flat)
        return face, face if inner is None else inner[tangents]
