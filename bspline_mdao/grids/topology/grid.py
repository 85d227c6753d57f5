"""A multi-block structured grid in memory, and checks of its nodes.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...base.checks import as_array, require_kind
from ...base.display import OneLine, Plottable
from ...errors import InputError
from .block_layout import BlockLayout
from .index_space import Interface, Window
from .periodic_pair import PeriodicPair

PATCH_KINDS = ("wall", "symmetry", "farfield", "overset", "other")
"""Kinds of boundary conditions; overset marks outer boundaries of component grids inside others."""


@dataclass(frozen=True)
class Patch(OneLine):
    """A named piece of surface with one boundary condition.

    Parameters
    ----------
    name : str
        The name of the surface.
    kind : str
        One of `PATCH_KINDS`.
    windows : tuple of Window
        The face windows that it covers.

    Examples
    --------
    >>> from bspline_mdao.grids import Patch, Window
    >>> Patch("wing", "wall", (Window(0, (0, 0, 0), (8, 0, 4)),)).windows[0].shape
    (9, 1, 5)
    """

    name: str
    kind: str
    windows: tuple[Window, ...]

    def __post_init__(self) -> None:
        if self.kind not in PATCH_KINDS:
            raise InputError(
                f"patch {self.name}: kind {self.kind!r} is not known; give one of {', '.join(PATCH_KINDS)}"
            )
        object.__setattr__(self, "windows", tuple(self.windows))


@dataclass(frozen=True)
class Block(OneLine):
    """A structured block: its nodes, and PLOT3D blanking.

    Parameters
    ----------
    nodes : ndarray, shape (ni, nj, nk, 3), float64, C order
        Node coordinates, in metres.
    name : str
        Zone name; ``"block 3"`` and the like if the file has none.
    iblank : ndarray of int32, shape (ni, nj, nk), optional
        PLOT3D blanking.

    Raises
    ------
    InputError
        If nodes or blanking have the wrong shape, or are not numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import Grid
    >>> from bspline_mdao.grids import Block
    >>> nodes = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, n) for n in (5, 4, 3)], indexing="ij"), axis=-1)
    >>> Grid((Block(nodes, "box"),)).n_nodes
    60
    """

    nodes: np.ndarray
    name: str
    iblank: np.ndarray | None = None

    def __post_init__(self) -> None:
        nodes = as_array(self.nodes, f"{self.name}: nodes")
        if nodes.ndim != 4 or nodes.shape[3] != 3 or nodes.size == 0:
            raise InputError(
                f"{self.name}: nodes of shape {nodes.shape}; give shape (ni, nj, nk, 3) with a node or more in each "
                f"direction, z = 0 where the grid is plane"
            )
        object.__setattr__(self, "nodes", nodes)
        if self.iblank is None:
            return
        iblank = as_array(self.iblank, f"{self.name}: IBLANK")
        if iblank.shape != self.shape:
            raise InputError(f"{self.name}: IBLANK of shape {iblank.shape}; give shape {self.shape}")
        object.__setattr__(self, "iblank", iblank.astype(np.int32, copy=False))

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of nodes in each direction."""
        return self.nodes.shape[:3]


@dataclass(frozen=True)
class Grid(Plottable):
    """A multi-block structured grid: blocks, declared patches and connections, and the format of its file.

    Parameters
    ----------
    blocks : tuple of Block
        The blocks in file order.
    patches : tuple of Patch
        Declared patches (from CGNS boundary conditions, a TOML file or a NMF file).
    source : str
        Origin of the grid, for messages.
    dialect : object, optional
        Details of the file's format, so that it can be written in the same way; None for a generated grid.
    connections : tuple of Interface
        One-to-one connections that the file declares, each once. The topology is found from the nodes; a warning says
        where the two disagree.
    unit : str
        Unit of lengths, such as ``"mm"``; empty if unknown. Numbers are never rescaled.
    periodic : tuple of PeriodicPair
        Sides that the file declares as periodic: their windows, and the motion that maps one side onto the other.

    Examples
    --------
    >>> from bspline_mdao.generators import brick_grid
    >>> grid = brick_grid((5, 5, 5, 5))
    >>> grid.n_nodes, grid.shapes[0], grid.to_vector().shape
    (750, (5, 5, 5), (2250,))
    >>> grid.with_vector(2.0 * grid.to_vector()).blocks[0].nodes.shape  # another grid, twice as large
    (5, 5, 5, 3)
    """

    blocks: tuple[Block, ...]
    patches: tuple[Patch, ...] = ()
    source: str = "grid"
    dialect: Any = field(default=None, compare=False)
    connections: tuple[Interface, ...] = ()
    unit: str = ""
    periodic: tuple[PeriodicPair, ...] = ()

    @property
    def length_unit(self) -> str:
        """Unit in which lengths are shown: metres if unknown."""
        return self.unit or "m"

    def __post_init__(self) -> None:
        for name, kind in (("blocks", Block), ("patches", Patch)):
            items = getattr(self, name)
            items = tuple(items) if isinstance(items, Iterable) else (items,)
            strangers = [type(item).__name__ for item in items if not isinstance(item, kind)]
            if strangers:
                raise InputError(
                    f"{self.source}: one of the {name} is of type {strangers[0]}; give {kind.__name__} objects"
                )
            object.__setattr__(self, name, items)
        if not self.blocks:
            raise InputError(f"{self.source}: has no blocks; give one or more")

    def __repr__(self) -> str:
        n_blocks, n_patches = len(self.blocks), len(self.patches)
        sizes = f"{n_blocks} block{'s' * (n_blocks != 1)}, {self.n_nodes:,} nodes"
        return f"Grid({self.source}: {sizes}, {n_patches} patch{'es' * (n_patches != 1)})"

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Number of nodes of every block in each direction."""
        return tuple(block.shape for block in self.blocks)

    @cached_property
    def layout(self) -> BlockLayout:
        """Layout of the nodes of the blocks in the grid vector."""
        return BlockLayout.of(self.shapes)

    @property
    def n_nodes(self) -> int:
        """Nodes of all blocks; interface nodes are counted once for every block that contains them."""
        return self.layout.size

    def to_vector(self) -> np.ndarray:
        """All nodes as one flat vector, shape (3 n_nodes,): blocks in order, each in C order, xyz interleaved."""
        return self.layout.join([block.nodes for block in self.blocks]).reshape(-1)

    def with_vector(self, vector: np.ndarray) -> Grid:
        """The same grid with the nodes of ``vector``, shape (3 n_nodes,)."""
        vector = as_array(vector, f"{self.source}: the vector of nodes")
        if vector.shape != (3 * self.n_nodes,):
            raise InputError(
                f"{self.source}: a vector of shape {vector.shape} does not fit {self.n_nodes} nodes; "
                f"give shape ({3 * self.n_nodes},)"
            )
        parts = self.layout.split(vector.reshape(-1, 3))
        return replace(self, blocks=tuple(replace(block, nodes=x) for block, x in zip(self.blocks, parts)))


def require_grid(grid: Any) -> None:
    """Refuse anything but a grid of real numbers."""
    require_kind(grid, Grid, "the grid", "read one with read_grid(path), or make a Grid of Blocks")
    if any(np.iscomplexobj(block.nodes) for block in grid.blocks):
        raise InputError(f"{grid.source}: has complex nodes; give real ones")


def find_fault(
    blocks: Iterable[Block],  # the blocks of a grid
    first: int = 1,  # number of the first of them, from 1
    lo: tuple[int, ...] = (0, 0, 0),  # index of their first node in the whole block, if they are windows
) -> str | None:  # block, indices (from 1) and value; None if all nodes are valid
    """Name the first node that is not finite or too far away, or has an invalid IBLANK."""
    for number, block in enumerate(blocks, first):
        name = f"block {number}" + (f" '{block.name}'" if block.name != f"block {number}" else "")
        is_sound = np.abs(block.nodes) <= MAX_COORDINATE
        if not is_sound.all():
            *index, axis = np.argwhere(~is_sound)[0].tolist()
            return f"{name}: node {_index_text(index, lo)} has {'xyz'[axis]} = {block.nodes[(*index, axis)]:.6g}"
        if block.iblank is not None:
            is_sound = np.abs(block.iblank.astype(np.int64)) <= MAX_IBLANK
            if not is_sound.all():
                index = np.argwhere(~is_sound)[0].tolist()
                return f"{name}: node {_index_text(index, lo)} has an IBLANK that is no block number"
    return None


MAX_COORDINATE = 1e15
"""Metres; a larger coordinate is a damaged number, and its powers would overflow later."""


MAX_IBLANK = 1_000_000
"""IBLANK is 0, 1 or the negative of a block number."""


def _index_text(index: list[int], lo: tuple[int, ...]) -> str:
    """Write an index from 1."""
    return "(" + ", ".join(str(i + start + 1) for i, start in zip(index, lo)) + ")"
