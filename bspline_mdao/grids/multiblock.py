"""A multi-block structured grid in memory."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import InputError
from .entities import Interface
from .index_space import Window

PATCH_KINDS = ("wall", "symmetry", "farfield", "other")
"""Boundary conditions that the project tells apart."""


@dataclass(frozen=True)
class Patch:
    """A named piece of surface with one boundary condition.

    Parameters
    ----------
    name : str
        The user's name for it.
    kind : str
        One of `PATCH_KINDS`.
    windows : tuple of Window
        The face windows that it covers.
    """

    name: str
    kind: str
    windows: tuple[Window, ...]


@dataclass(frozen=True)
class Block:
    """One structured block.

    Parameters
    ----------
    nodes : ndarray, shape (ni, nj, nk, 3), float64, C order
        Node coordinates, in metres.
    name : str
        Zone name; ``"block 3"`` and the like where the file has none.
    iblank : ndarray of int32, shape (ni, nj, nk), optional
        PLOT3D blanking.
    """

    nodes: np.ndarray
    name: str
    iblank: np.ndarray | None = None

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of nodes in each direction."""
        return self.nodes.shape[:3]


@dataclass(frozen=True)
class Grid:
    """A multi-block structured grid.

    Parameters
    ----------
    blocks : tuple of Block
        The blocks in file order.
    patches : tuple of Patch
        Declared patches (from CGNS boundary conditions, a TOML file or a NMF file).
    source : str
        Where the grid came from, for messages.
    dialect : object, optional
        How the file was written, so that it can be written back alike; None for a generated grid.
    connections : tuple of Interface
        One-to-one connections that the file declares, each once. The topology is found from the nodes; it tells where
        the two do not agree.
    """

    blocks: tuple[Block, ...]
    patches: tuple[Patch, ...] = ()
    source: str = "grid"
    dialect: object | None = field(default=None, compare=False)
    connections: tuple[Interface, ...] = ()

    @property
    def shapes(self) -> tuple[tuple[int, int, int], ...]:
        """Shape of every block."""
        return tuple(block.shape for block in self.blocks)

    @property
    def n_nodes(self) -> int:
        """Nodes of all blocks, interface nodes counted once for every block that holds them."""
        return sum(int(np.prod(shape)) for shape in self.shapes)

    def to_vector(self) -> np.ndarray:
        """All nodes as one flat vector, shape (3 n_nodes,): blocks in order, each in C order, xyz interleaved."""
        return np.concatenate([block.nodes.reshape(-1) for block in self.blocks])

    def with_vector(self, vector: np.ndarray) -> Grid:
        """The same grid with the nodes of ``vector``, shape (3 n_nodes,)."""
        if vector.shape != (3 * self.n_nodes,):
            raise InputError(
                f"{self.source}: a vector of shape {vector.shape} does not fit {self.n_nodes} nodes; "
                f"give shape ({3 * self.n_nodes},)"
            )
        blocks, start = [], 0
        for block in self.blocks:
            size = block.nodes.size
            blocks.append(replace(block, nodes=vector[start : start + size].reshape(block.nodes.shape)))
            start += size
        return replace(self, blocks=tuple(blocks))
