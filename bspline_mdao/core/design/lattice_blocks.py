"""Lattices of several volumes that share points: free-form boxes of several blocks.

Theory: ``docs/theory/free_form.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ...errors import InputError
from ..splines.mesh import BSplineMesh
from .embedding import FreeFormVolumes
from .lattice import lattice_points, uniform_volume
from .selection import Selection

__all__ = ["LatticeBlocks"]

SHARED = 1e-6
"""Points of blocks this near to each other, relative to the overall diagonal, are one: files have seven digits or
more."""


@dataclass(frozen=True, eq=False)
class LatticeBlocks(FreeFormVolumes):
    """Adjacent lattices that share the points where they meet and move together there.

    Parameters
    ----------
    blocks : sequence of array_like, each of shape (n0, n1, n2, 3)
        Points of each block on the baseline (m), at least two in each direction. Coincident points become one point,
        their mean if they differ by rounding.
    orders : int or sequence of three int, optional
        As for `Lattice`, for all blocks.
    parent, moves, continuity
        As for `Lattice`.

    Raises
    ------
    InputError
        As `Lattice`.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.design import Lattice, LatticeBlocks
    >>> inner = Lattice.box([[0.0, 0.0, 0.0], [1.0, 0.2, 1.0]], n=(4, 2, 3), margin=0.0).control_points
    >>> lattice = LatticeBlocks([inner, inner + [0.0, 0.0, 1.0]])
    >>> lattice.points.shape
    (40, 3)
    """

    blocks: Sequence[np.ndarray]
    orders: int | Sequence[int] | None = None
    parent: FreeFormVolumes | None = None
    moves: Selection | None = None
    continuity: int = 1

    def __post_init__(self) -> None:
        several = len(self.blocks) > 1
        blocks = [lattice_points(b, f"lattice{f', block {n}' * several}") for n, b in enumerate(self.blocks, 1)]
        if not blocks:
            raise InputError("lattice: no blocks; give the points of one at least")
        object.__setattr__(self, "blocks", tuple(blocks))
        self.mesh  # noqa: B018  # refuses orders that do not suit the number of points
        if self.parent is not None:
            self.require_inside(self.parent)

    @cached_property
    def _numbers(self) -> np.ndarray:
        """Number of each point of all blocks in order; coincident points share a number."""
        stacked = np.concatenate([block.reshape(-1, 3) for block in self.blocks])
        n, near = len(stacked), SHARED * float(np.linalg.norm(np.ptp(stacked, axis=0)))
        pairs = cKDTree(stacked).query_pairs(near, output_type="ndarray")
        _, labels = connected_components(coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n)))
        _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
        return np.argsort(np.argsort(first))[inverse]

    @cached_property
    def points(self) -> np.ndarray:  # type: ignore[override]
        """Their points on the baseline (m), each once, in the order of the blocks and in C order; shape (n, 3)."""
        stacked = np.concatenate([block.reshape(-1, 3) for block in self.blocks])
        sums = np.stack([np.bincount(self._numbers, column) for column in stacked.T], axis=1)
        return sums / np.bincount(self._numbers)[:, None]

    @cached_property
    def mesh(self) -> BSplineMesh:  # type: ignore[override]
        """The volumes, which share points."""
        shapes = [block.shape[:3] for block in self.blocks]
        parts = np.split(self._numbers, np.cumsum([np.prod(shape) for shape in shapes])[:-1])
        volumes = tuple(uniform_volume(shape, self.orders) for shape in shapes)
        ids = tuple(part.reshape(shape) for part, shape in zip(parts, shapes))
        return BSplineMesh(volumes, ids, int(self._numbers.max()) + 1)

    def chosen(self, where: Any) -> np.ndarray:
        """Whether each point is chosen: by a mask of all, or by a mapping of blocks to index expressions."""
        is_chosen = np.zeros(len(self.points), dtype=bool)
        if not isinstance(where, Mapping):
            is_chosen[where] = True
            return is_chosen
        for number, index in where.items():
            if number not in range(len(self.blocks)):
                raise IndexError(f"there is no block {number}")
            is_chosen[self.mesh.control_ids[number][index]] = True
        return is_chosen

    def place_of(self, point: int) -> str:
        """Describe a point by its block and its number there, from 1."""
        for number, ids in enumerate(self.mesh.control_ids, 1):
            found = np.argwhere(ids == point)
            if len(found):
                return f"{tuple((found[0] + 1).tolist())} of block {number}"
        raise IndexError(point)
