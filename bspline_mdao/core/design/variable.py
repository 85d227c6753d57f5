"""The interface of every design variable: a map of points with values, and building blocks of such maps.

All points moved by design variables are rows of one array: first the surface control points, then auxiliary points,
such as points of reference axes and lattices, which move with the surface. A variable is a small object of settings;
bound to a `Layout` of rows it is a `DesignMap`. A user's own variable is any object with the four members of
`Variable`. Theory: ``docs/theory/parametrization.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.sparse import bsr_array, coo_array, csr_array

from ...base.display import OneLine
from ..mesh.moving_mesh import MovingMesh

__all__ = [
    "AuxiliaryPoints",
    "DesignMap",
    "Layout",
    "MapPartials",
    "Variable",
    "block_diagonal",
    "ones_like",
    "product_on_pattern",
    "rates_of",
    "sum_on_pattern",
]

_STEP = 1e-40
"""Complex step: nothing is subtracted, so it may be so small that its square vanishes relative to one."""


class AuxiliaryPoints(Protocol):
    """An object with points that move with the surface: a reference axis, a lattice."""

    @property
    def points(self) -> np.ndarray:
        """The points on the baseline, shape (n, 3), in metres."""


@dataclass(frozen=True, eq=False)
class Layout(OneLine):
    """The rows moved by variables."""

    mesh: MovingMesh  # its surface points are the first rows, in the order of ``mesh.surface_ids``
    auxiliary: tuple[AuxiliaryPoints, ...] = ()  # the rows of their points follow, in this order

    @cached_property
    def n_surface(self) -> int:
        """Number of surface control points."""
        return len(self.mesh.surface_ids)

    @cached_property
    def points(self) -> np.ndarray:
        """All rows on the baseline (m), shape (n_rows, 3), from which everything constant is computed."""
        return np.concatenate([self.mesh.points[self.mesh.surface_ids], *(item.points for item in self.auxiliary)])

    def rows(self, auxiliary: AuxiliaryPoints | None = None) -> slice:
        """Return the rows of one of the auxiliary objects; the surface rows by default."""
        if auxiliary is None:
            return slice(0, self.n_surface)
        start = self.n_surface
        for item in self.auxiliary:
            if item is auxiliary:
                return slice(start, start + len(item.points))
            start += len(item.points)
        raise KeyError(f"{auxiliary!r} has no rows; a variable lists what it needs in 'auxiliary'")


def ones_like(matrix: csr_array) -> csr_array:
    """Return the pattern of a matrix with ones as entries."""
    return csr_array((np.ones_like(matrix.data), matrix.indices, matrix.indptr), shape=matrix.shape)


def sum_on_pattern(*matrices: csr_array) -> csr_array:
    """Sum matrices, with an entry wherever one of them has one, so that no zero changes the pattern."""
    parts = [matrix.tocoo() for matrix in matrices]
    rows, columns, data = (np.concatenate([getattr(p, name) for p in parts]) for name in ("row", "col", "data"))
    return coo_array((data, (rows, columns)), shape=matrices[0].shape).tocsr()


def product_on_pattern(a: csr_array, b: csr_array) -> csr_array:
    """Multiply two matrices, with an entry wherever their entries meet, so that no zero changes the pattern."""
    pattern = ones_like(a) @ ones_like(b)
    return sum_on_pattern(0.0 * pattern, a @ b)


@dataclass(frozen=True, eq=False)
class MapPartials:
    """Derivatives of the moved rows, xyz interleaved, with constant patterns."""

    points: csr_array  # (3 n_rows, 3 n_rows), with respect to the rows before
    values: csr_array  # (3 n_rows, n_values), with respect to the values of the variable


class DesignMap(Protocol):
    """A design variable bound to rows: set up on the baseline, applied anywhere."""

    @property
    def initial(self) -> np.ndarray:
        """Values at which nothing moves, shape (n_values,)."""

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres; real or complex."""

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`."""


class Variable(Protocol):
    """A design variable, or several of one kind."""

    @property
    def name(self) -> str:
        """Name of the input of `SurfaceControl`."""

    @property
    def units(self) -> str | None:
        """Units of its values."""

    @property
    def auxiliary(self) -> tuple[AuxiliaryPoints, ...]:
        """The axes and lattices used by the variable."""

    def bind(self, layout: Layout) -> DesignMap:
        """Compute what depends only on the baseline. `InputError` if the surface cannot be moved that way."""


def block_diagonal(blocks: np.ndarray) -> csr_array:
    """Sparse matrix of one block per row of points, shape (n, 3, m): (3 n, m n), explicit zeros kept."""
    n = len(blocks)
    return bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=(3 * n, blocks.shape[2] * n)).tocsr()


def rates_of(function: Callable[[np.ndarray], np.ndarray], amounts: np.ndarray) -> np.ndarray:
    """Derivatives of an elementwise function of amounts, shape (n,), by a complex step; in the shape it returns."""
    return function(amounts + 1j * _STEP).imag / _STEP
