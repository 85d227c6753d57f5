"""User-defined design variables: a function of the surface control points with its derivative.

Theory: ``docs/theory/parametrization.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import block_diag, coo_array, csr_array, eye_array, issparse, vstack

from ...base.display import OneLine
from ...errors import InputError
from .variable import AuxiliaryPoints, Layout, MapPartials, block_diagonal, sum_on_pattern

__all__ = ["UserVariable"]

STAYS = 1e-9
"""Distance, relative to the size of the mesh, by which the initial values may move points: round-off of the user's
formula, far below the width of any cell."""


@dataclass(frozen=True, eq=False)
class UserVariable(OneLine):
    """Move the surface control points by your own function.

    Parameters
    ----------
    name : str
        Name of the variable.
    initial : array_like, shape (n_values,)
        Values at which nothing moves.
    function : callable
        ``function(points, values)`` returns moved points, shape (n_surface, 3), from points of that shape (m), in the
        order of ``mesh.surface_ids``, and values, shape (n_values,). It must not change its arguments.
    derivative : callable
        ``derivative(points, values)`` returns ``(d_points, d_values)``. With respect to the points: a sparse or dense
        matrix, shape (3 n_surface, 3 n_surface), or blocks of shape (n_surface, 3, 3) if every point moves
        independently; with respect to the values: a sparse or dense matrix, shape (3 n_surface, n_values), or an array
        of shape (n_surface, 3, n_values). Coordinates are interleaved. A sparse matrix must have an entry wherever
        there is one for any points and values.
    units : str, optional
        Units of the values.

    Examples
    --------
    >>> swell = UserVariable(
    ...     "swell",
    ...     initial=[0.0],
    ...     function=lambda x, v: x * (1.0 + v[0]),
    ...     derivative=lambda x, v: (np.tile((1.0 + v[0]) * np.eye(3), (len(x), 1, 1)), x[:, :, None]),
    ... )
    """

    name: str
    initial: np.ndarray
    function: Callable[[np.ndarray, np.ndarray], np.ndarray]
    derivative: Callable[[np.ndarray, np.ndarray], tuple]
    units: str | None = None
    auxiliary: ClassVar[tuple[AuxiliaryPoints, ...]] = ()

    def bind(self, layout: Layout) -> _UserMap:
        """Call the function and its derivative once on the baseline.

        Raises
        ------
        InputError
            If their results are invalid, or the initial values move points.
        """
        initial = np.atleast_1d(np.array(self.initial, dtype=float))
        if initial.ndim != 1 or not np.isfinite(initial).all():
            raise InputError(f"'{self.name}': initial values of shape {initial.shape}; give a list of finite numbers")
        bound = _UserMap(self, layout, initial)
        surface = layout.points[layout.rows()]
        off = np.abs(bound.apply(layout.points, initial)[layout.rows()] - surface).max()
        if off > STAYS * layout.mesh.size:
            raise InputError(f"'{self.name}': the initial values move a point by {off:.3g} m; give those that do not")
        return bound


@dataclass(frozen=True, eq=False)
class _UserMap(OneLine):
    """The function on the surface rows; the others stay."""

    variable: UserVariable
    layout: Layout
    initial: np.ndarray

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres; complex if the function supports it."""
        surface = points[self.layout.rows()]
        moved = np.asarray(self.variable.function(surface, values))
        if moved.shape != surface.shape:
            raise self._error(f"the function returns points of shape {moved.shape}; return shape {surface.shape}")
        is_bad = ~np.isfinite(moved).all(axis=1)
        if is_bad.any():
            place = self.layout.mesh.place_of_surface_point(np.argmax(is_bad))
            raise self._error(f"the function moves {place} to {moved[is_bad][0]}; correct it")
        return np.concatenate([moved, points[self.layout.n_surface :]])

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`, with the baseline's entries."""
        found = self._derivatives(points[self.layout.rows()], values)
        filled = [sum_on_pattern(0.0 * pattern, matrix) for pattern, matrix in zip(self._pattern, found)]
        for pattern, matrix in zip(self._pattern, filled):
            if matrix.nnz > pattern.nnz:
                raise self._error(
                    f"the derivative has {matrix.nnz - pattern.nnz} entries that it had not on the baseline; let "
                    f"sparse matrices always have the same entries, zeros included"
                )
        return MapPartials(*filled)

    @cached_property
    def _pattern(self) -> tuple[csr_array, csr_array]:
        return self._derivatives(self.layout.points[self.layout.rows()], self.initial)

    def _derivatives(self, surface: np.ndarray, values: np.ndarray) -> tuple[csr_array, csr_array]:
        """Derivatives of all rows with respect to the rows and to the values, checked."""
        found = self.variable.derivative(surface, values)
        if not isinstance(found, tuple) or len(found) != 2:
            raise self._error("the derivative is no pair; return (d_points, d_values)")
        n_rest = 3 * (len(self.layout.points) - len(surface))
        d_points = self._matrix("d_points", found[0], (surface.size, surface.size), (len(surface), 3, 3))
        d_values = self._matrix("d_values", found[1], (surface.size, values.size), (*surface.shape, values.size))
        return (
            block_diag([d_points, eye_array(n_rest)], format="csr"),
            vstack([d_values, csr_array((n_rest, values.size))], format="csr"),
        )

    def _matrix(self, what: str, given: Any, shape: tuple[int, int], blocks: tuple[int, int, int]) -> csr_array:
        """One derivative as a sparse matrix, every entry of a dense one kept."""
        array = given if issparse(given) else np.asarray(given, dtype=float)
        if array.shape not in (shape, blocks):
            raise self._error(f"{what} of the derivative has shape {array.shape}; return shape {shape} or {blocks}")
        if array.shape == shape:
            matrix = csr_array(array) if issparse(array) else _dense(array)
        else:
            matrix = block_diagonal(array) if what == "d_points" else _dense(array.reshape(shape))
        is_bad = ~np.isfinite(matrix.data)
        if is_bad.any():
            row = np.searchsorted(matrix.indptr, np.argmax(is_bad), side="right") - 1
            place = self.layout.mesh.place_of_surface_point(row // 3)
            raise self._error(f"{what} of the derivative is not finite for {place}; correct it")
        return matrix

    def _error(self, what: str) -> InputError:
        return InputError(f"'{self.variable.name}': {what}")


def _dense(array: np.ndarray) -> csr_array:
    """Matrix with an entry everywhere."""
    rows, columns = np.indices(array.shape)
    return coo_array((array.ravel(), (rows.ravel(), columns.ravel())), shape=array.shape).tocsr()
