"""Interfaces whose two sides lie on top of each other: blocks given twice, blocks that are folded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from .entities import Interface
from .index_space import Orientation, Window
from .multiblock import Grid


def overlapping(grid: Grid, interfaces: Sequence[Interface]) -> Iterator[Interface]:
    """Pick the interfaces most of whose cells lie on the same side from both blocks.

    Parameters
    ----------
    grid : Grid
        The grid.
    interfaces : sequence of Interface
        Its interfaces; those of blocks one node deep have no sides.
    """
    for interface in interfaces:
        a, b = interface.a, interface.b
        if min(*grid.blocks[a.block].shape, *grid.blocks[b.block].shape) > 1:
            normals = _normals(grid.blocks[a.block].nodes[a.slices])
            heights_a = _dot(normals, _inward(grid, a, Orientation()))
            heights_b = _dot(normals, _inward(grid, b, interface.orientation))
            if np.mean(heights_a * heights_b > 0.0) > 0.5:
                yield interface


def _inward(grid: Grid, window: Window, orientation: Orientation) -> np.ndarray:
    """Unit vectors from the nodes of a face window to those of the next layer, turned by an orientation."""
    nodes, d = grid.blocks[window.block].nodes, window.shape.index(1)
    first, second = (-1, -2) if window.lo[d] else (0, 1)
    across = tuple(s for e, s in enumerate(window.slices) if e != d)
    layers = np.moveaxis(nodes, d, 0)
    steps = layers[second][across] - layers[first][across]
    return orientation.apply(np.expand_dims(_unit(steps), d))


def _normals(face: np.ndarray) -> np.ndarray:
    """Unit normals at the nodes of a face window, from central differences."""
    along = [np.gradient(face, axis=d) for d in range(3) if face.shape[d] > 1]
    return _unit(np.cross(*along))


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors of length one; zero where they have no length."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...c,...c->...", a, b)
