"""Planar grids, one node deep: lifted to one cell so that they can move, and written back planar.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.numerics.vectors import is_line, lengths, nearest_plane
from ...errors import InputError
from ..topology.grid import Block, Grid
from ..topology.index_space import Window

__all__ = ["PlaneDialect", "flattened", "lift_plane_grid"]

PLANAR = 1e-6
"""A grid is planar if its nodes leave the plane by less than this fraction of its size."""


@dataclass(frozen=True)
class PlaneDialect:
    """Dialect of a grid that was planar and is now one cell deep."""

    dialect: object | None  # format of the planar grid
    directions: tuple[int, ...]  # direction of each block in which the planar grid has a single node
    normal: tuple[float, ...]  # unit normal of the plane
    offset: float  # product of the normal and points of the plane (m)

    @property
    def ignored(self) -> tuple[str, ...]:
        """Other content of the file, one line each."""
        return tuple(getattr(self.dialect, "ignored", ()))

    def __str__(self) -> str:
        """Name the dialect."""
        return f"{self.dialect or 'no file'}, plane"


def lift_plane_grid(grid: Grid, height: float | None = None) -> Grid:
    """Make a planar grid, one node deep, one cell deep; all others are returned unchanged.

    The second layer of nodes is off the plane by the height, to the side that makes most blocks right-handed. Patches
    and connections are extended. Both sides can then be planes of symmetry; `bspline_mdao.write_grid` writes only the
    first layer, in the dialect of the planar grid, unless it writes for OpenFOAM.

    Parameters
    ----------
    grid : Grid
        The grid.
    height : float, optional
        Depth of the cell (m); the mean length of the edges of the grid by default.

    Returns
    -------
    Grid

    Raises
    ------
    InputError
        If the height is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import Grid
    >>> from bspline_mdao.files import lift_plane_grid
    >>> from bspline_mdao.grids.topology.grid import Block
    >>> x, y, z = np.meshgrid(range(4), range(5), [0.0], indexing="ij")
    >>> lift_plane_grid(Grid((Block(np.stack([x, y, z], axis=-1), "block 1"),))).shapes
    ((4, 5, 2),)
    """
    if height is not None and not height > 0.0:
        raise InputError(f"{grid.source}: a plane grid is lifted by {height}; give a height that is positive")
    nodes = np.concatenate([block.nodes.reshape(-1, 3) for block in grid.blocks])
    if any(shape.count(1) != 1 for shape in grid.shapes) or is_line(nodes):
        return grid
    normal, distances, _ = nearest_plane(nodes)
    if distances.max() > PLANAR * lengths(np.ptp(nodes, axis=0)):
        return grid
    directions = tuple(shape.index(1) for shape in grid.shapes)
    edges = [
        lengths(np.diff(b.nodes, axis=d)) for b, flat in zip(grid.blocks, directions) for d in range(3) if d != flat
    ]
    step = height or sum(part.sum() for part in edges) / sum(part.size for part in edges)
    turned = sum(float(_area(block, flat) @ normal) for block, flat in zip(grid.blocks, directions))
    shift = np.copysign(step, turned) * normal
    return replace(
        grid,
        blocks=tuple(_lifted(block, flat, shift) for block, flat in zip(grid.blocks, directions)),
        patches=tuple(replace(p, windows=tuple(_deep(w, directions) for w in p.windows)) for p in grid.patches),
        connections=tuple(
            replace(item, a=_deep(item.a, directions), b=_deep(item.b, directions)) for item in grid.connections
        ),
        periodic=tuple(
            replace(
                pair,
                windows=tuple(_deep(w, directions) for w in pair.windows),
                others=tuple(_deep(w, directions) for w in pair.others),
            )
            for pair in grid.periodic
        ),
        dialect=PlaneDialect(grid.dialect, directions, tuple(normal.tolist()), float(np.median(nodes @ normal))),
    )


def flattened(grid: Grid) -> Grid:
    """The planar grid of a lifted one: its first layer, without patches; other grids unchanged."""
    if not isinstance(grid.dialect, PlaneDialect):
        return grid
    blocks: list[Block] = []
    for block, flat in zip(grid.blocks, grid.dialect.directions):
        iblank = None if block.iblank is None else block.iblank.take([0], axis=flat)
        blocks.append(replace(block, nodes=block.nodes.take([0], axis=flat), iblank=iblank))
    nodes, normal = np.concatenate([block.nodes.reshape(-1, 3) for block in blocks]), np.array(grid.dialect.normal)
    off = float(np.abs(nodes @ normal - grid.dialect.offset).max())
    if off > PLANAR * lengths(np.ptp(nodes, axis=0)):
        raise InputError(
            f"{grid.source}: was plane, and its nodes have left the plane by {off:.3g} m; let both sides slide, as "
            f"planes of symmetry do, and deform it in the plane"
        )
    if np.abs(normal).max() == 1.0:  # two-dimensional files have no room for round-off
        for block in blocks:
            block.nodes[..., np.argmax(np.abs(normal))] = grid.dialect.offset * normal.sum()
    return replace(grid, blocks=tuple(blocks), patches=(), connections=(), periodic=(), dialect=grid.dialect.dialect)


def _lifted(block: Block, flat: int, shift: np.ndarray) -> Block:
    """A block with a second layer."""
    iblank = None if block.iblank is None else block.iblank.repeat(2, axis=flat)
    return replace(block, nodes=np.concatenate([block.nodes, block.nodes + shift], axis=flat), iblank=iblank)


def _area(block: Block, flat: int) -> np.ndarray:
    """Area vector of a planar block, along its flat direction if that makes it right-handed."""
    nodes = np.moveaxis(block.nodes, flat, 2)[:, :, 0]
    first, second = nodes[1:, 1:] - nodes[:-1, :-1], nodes[:-1, 1:] - nodes[1:, :-1]
    return (-1.0) ** (flat == 1) * 0.5 * np.cross(first, second).sum(axis=(0, 1))


def _deep(window: Window, directions: tuple[int, ...]) -> Window:
    """A window of a planar block in the lifted one; the plane as a whole is its first side."""
    flat = directions[window.block]
    is_side = all(lo < hi for d, (lo, hi) in enumerate(zip(window.lo, window.hi)) if d != flat)
    return window if is_side else replace(window, hi=tuple(1 if d == flat else n for d, n in enumerate(window.hi)))
