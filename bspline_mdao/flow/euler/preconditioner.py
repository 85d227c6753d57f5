"""The preconditioner of linear systems with the Jacobian: an incomplete factor L U of a compact neighbour of it.

The compact neighbour sees the two cells at a face alone: the mean state is half-way between them, and a part of their
difference is dissipated: all of it at shocks, where the Jacobian itself is as compact. Time steps are on its diagonal.

Each of several processes factors the part of its own cells: additive Schwarz without overlap.

Blocks are 5 x 5, and the pattern, with level of fill, is symmetric. Entry ``(row, column)`` of the strict lower
triangle holds the block of L there and the block of U at ``(column, row)``. Both triangles are made, and solved with,
row by row of this one pattern, forwards and transposed.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.sparse import csr_array

from ...sparse.blocks import Graph
from ...sparse.incomplete import IncompletePattern, incomplete_pattern, narrow_order
from .discretization import Discretization
from .gas import GAMMA
from .linearization import Linearization
from .reconstruction import FIRST, INNER, MEAN

BLOCK = 5

FILL = 1
"""Level of fill of the factor."""

COMPACT_DISSIPATION = 0.75
"""Part of the first difference, at least, that is dissipated in place of the third: with half of it the factor is
unstable on grids with the spacing of boundary layers."""


def factor_pattern(discretization: Discretization) -> FactorPattern:
    """Find the pattern of the factor, once per grid."""
    faces = discretization.faces
    return FactorPattern.of(faces.left[: faces.n_inner], faces.right, faces.n_cells, FILL)


def compact_factor(linearization: Linearization, pattern: FactorPattern, diagonal: np.ndarray) -> BlockFactor:
    """Factor the compact neighbour of a Jacobian.

    Parameters
    ----------
    linearization : Linearization
    pattern : FactorPattern
    diagonal : ndarray, shape (n_cells, 5, 5)
        What is added to the blocks on the diagonal.
    """
    stencil = linearization.discretization.stencil
    lower = np.zeros((len(pattern.columns), *diagonal.shape[1:]), np.float32)
    upper, placed = np.zeros_like(lower), np.empty(diagonal.shape, lower.dtype)
    placed[pattern.rank] = diagonal
    index = stencil.cells, stencil.weights, stencil.classes, stencil.roles
    dissipation = np.float32(max(COMPACT_DISSIPATION, 1.5 * linearization.discretization.dissipation))
    jacobians = linearization.jacobians
    at_shocks = jacobians.shock_rows, jacobians.shocks
    _place(*index, jacobians.values, dissipation, *at_shocks, pattern.rank, pattern.places, lower, upper, placed)
    return BlockFactor.of(pattern, lower, upper, placed)


@njit(cache=True, error_model="numpy", nogil=True)
def _place(
    cells, weights, classes, roles, jacobians, dissipation, shock_rows, shocks, rank, places, lower, upper, diagonal
):
    """Add the blocks of all faces at their places; those between own cells and others have none off the diagonal."""
    n_own = len(rank)
    for f in range(len(cells)):
        jacobian, b, c = jacobians[f], cells[f, 1], cells[f, 2]
        left, right = (rank[b] if b < n_own else -1), (rank[c] if c < n_own else -1)
        if roles[f] != INNER:
            w = weights[classes[f]]
            mean = w[MEAN, 0] + w[MEAN, 1] + w[MEAN, 2]
            diagonal[left] += mean * jacobian[:, :5] + w[FIRST, 1] * jacobian[:, 5:]
            continue
        at, part = places[f], dissipation
        if len(shock_rows) > 0 and shock_rows[f] >= 0:
            part += shocks[shock_rows[f], 0] * (np.float32(1.0) - dissipation)
        for n in range(5):
            for m in range(5):
                from_left = np.float32(0.5) * jacobian[n, m] - part * jacobian[n, 5 + m]
                from_right = np.float32(0.5) * jacobian[n, m] + part * jacobian[n, 5 + m]
                if left >= 0:
                    diagonal[left, n, m] += from_left
                if right >= 0:
                    diagonal[right, n, m] -= from_right
                if at < 0:
                    continue
                if left > right:
                    lower[at, n, m] += from_right
                    upper[at, n, m] -= from_left
                else:
                    lower[at, n, m] -= from_left
                    upper[at, n, m] += from_right


def time_terms(discretization: Discretization, states: np.ndarray, areas: np.ndarray) -> np.ndarray:
    """Diagonal of the pseudo-time term at a CFL number of one, shape (n_cells, 5, 5).

    Derivatives of the conserved quantities with respect to the states, times half the sum of the wave speeds through
    the faces of a cell, which is its volume divided by its time step.
    """
    out = np.zeros((len(states), 5, 5))
    _time_terms(discretization.stencil.cells, discretization.stencil.roles, areas, states, out)
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def _time_terms(cells, roles, areas, states, out):
    rates = np.zeros(len(states))
    for f in range(len(cells)):
        s = areas[f]
        for k in range(1, 3 if roles[f] == INNER else 2):
            if cells[f, k] >= len(states):  # of another process
                continue
            w = states[cells[f, k]]
            sound = np.sqrt(GAMMA * w[4] / w[0] * (s[0] * s[0] + s[1] * s[1] + s[2] * s[2]))
            rates[cells[f, k]] += 0.5 * (abs(w[1] * s[0] + w[2] * s[1] + w[3] * s[2]) + sound)
    for c in range(len(states)):
        rho, u, v, w, _ = states[c]
        block, rate = out[c], rates[c]
        block[0, 0], block[4, 4] = rate, rate / (GAMMA - 1.0)
        block[1, 0], block[2, 0], block[3, 0] = rate * u, rate * v, rate * w
        block[1, 1] = block[2, 2] = block[3, 3] = rate * rho
        block[4, 0] = 0.5 * rate * (u * u + v * v + w * w)
        block[4, 1], block[4, 2], block[4, 3] = rate * rho * u, rate * rho * v, rate * rho * w


@dataclass(frozen=True, eq=False)
class FactorPattern(IncompletePattern):
    """Pattern of the factor, and the places in it of the blocks that faces of the grid make.

    Parameters
    ----------
    order, rank, starts, columns : ndarray
        See `IncompletePattern`; points are cells.
    places : ndarray of int64, shape (n_pairs,)
        Entry of every pair of neighbours; -1 where one of them is a cell of another process.
    """

    places: np.ndarray

    @classmethod
    def of(cls, left: np.ndarray, right: np.ndarray, n: int, fill: int) -> FactorPattern:
        """Order the cells by reverse Cuthill and McKee and find the fill.

        Parameters
        ----------
        left, right : ndarray of int, shape (n_pairs,)
            Pairs of neighbours; pairs with cells of other processes, whose numbers are n or more, have no place: -1.
        n : int
            Number of cells.
        fill : int
            Level of fill.
        """
        places, is_own = np.full(len(left), -1), (left < n) & (right < n)
        left, right = left[is_own], right[is_own]
        ends = np.concatenate([left, right]), np.concatenate([right, left])
        both = csr_array((np.ones(2 * len(left), np.int8), ends), shape=(n, n))
        both.sum_duplicates()
        graph = Graph(both.indptr.astype(np.int64), both.indices.astype(np.int32))
        found = incomplete_pattern(graph, narrow_order(graph), fill)
        places[is_own] = _find(found.starts, found.columns, found.rank[left], found.rank[right])
        return cls(found.order, found.rank, found.starts, found.columns, places)


@dataclass(frozen=True, eq=False)
class BlockFactor:
    """Incomplete factor L U of a matrix of 5 x 5 blocks.

    Parameters
    ----------
    pattern : FactorPattern
    lower, upper : ndarray, shape (n_blocks, 5, 5)
        Blocks of L below its unit diagonal and of U above its diagonal.
    pivots : ndarray, shape (n, 5, 5)
        Inverses of the diagonal blocks of U.
    """

    pattern: FactorPattern
    lower: np.ndarray
    upper: np.ndarray
    pivots: np.ndarray

    @classmethod
    def of(cls, pattern: FactorPattern, lower, upper, diagonal) -> BlockFactor:
        """Factor a matrix whose blocks are in place, by rank; they are overwritten."""
        _factorize(pattern.starts, pattern.columns, lower, upper, diagonal)
        return cls(pattern, lower, upper, diagonal.astype(lower.dtype, copy=False))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solve ``L U x = right``, shape (n, 5)."""
        p = self.pattern
        return _solve(p.rank, p.starts, p.columns, self.lower, self.upper, self.pivots, right)

    def solve_transposed(self, right: np.ndarray) -> np.ndarray:
        """Solve ``U^T L^T x = right``, shape (n, 5)."""
        p = self.pattern
        return _solve_transposed(p.rank, p.starts, p.columns, self.lower, self.upper, self.pivots, right)


@njit(cache=True, error_model="numpy")
def _find(starts, columns, left, right):
    """Find the entry of the pattern for each pair of rows."""
    places = np.empty(len(left), np.int64)
    for n in range(len(left)):
        row, column = max(left[n], right[n]), min(left[n], right[n])
        places[n] = starts[row] + np.searchsorted(columns[starts[row] : starts[row + 1]], column)
    return places


@njit(cache=True, error_model="numpy", nogil=True)
def _factorize(starts, columns, lower, upper, diagonal):
    """Factor row by row in place, the diagonal blocks into their inverses.

    For every entry j of row i of the pattern, ascending; fill outside of the pattern is dropped:

    1. ``L_ij = A_ij - sum_k L_ik U_kj`` and ``U_ji = A_ji - sum_k L_jk U_ki``, over the k < j in both rows.
    2. ``L_ij = L_ij U_jj^-1``.
    3. ``U_ii = A_ii - sum_j L_ij U_ji``, and its inverse when the row is done.
    """
    n = len(starts) - 1
    place_of = np.full(n, -1, np.int64)
    product = np.empty((BLOCK, BLOCK))
    for row in range(n):
        for entry in range(starts[row], starts[row + 1]):
            column = columns[entry]
            for other in range(starts[column], starts[column + 1]):
                place = place_of[columns[other]]
                if place >= 0:  # step 1
                    _subtract(lower[entry], lower[place], upper[other])
                    _subtract(upper[entry], lower[other], upper[place])
            product[:] = 0.0  # step 2
            _subtract(product, lower[entry], diagonal[column])
            lower[entry] = -product
            _subtract(diagonal[row], lower[entry], upper[entry])  # step 3
            place_of[column] = entry
        for entry in range(starts[row], starts[row + 1]):
            place_of[columns[entry]] = -1
        product[:] = diagonal[row]
        _invert(product, diagonal[row])


@njit(cache=True, error_model="numpy", nogil=True, forceinline=True, fastmath={"contract"})
def _subtract(block, left, right):
    """Subtract the product of two blocks from a block."""
    for a in range(BLOCK):
        l0, l1, l2, l3, l4 = left[a, 0], left[a, 1], left[a, 2], left[a, 3], left[a, 4]
        for b in range(BLOCK):
            block[a, b] -= l0 * right[0, b] + l1 * right[1, b] + l2 * right[2, b] + l3 * right[3, b] + l4 * right[4, b]


@njit(cache=True, error_model="numpy", nogil=True)
def _invert(block, inverse):
    """Invert a block, which is overwritten, by Gauss and Jordan with exchanges of rows."""
    for a in range(BLOCK):
        for b in range(BLOCK):
            inverse[a, b] = 1.0 if a == b else 0.0
    for k in range(BLOCK):
        pivot = k
        for a in range(k + 1, BLOCK):
            if abs(block[a, k]) > abs(block[pivot, k]):
                pivot = a
        for b in range(BLOCK):
            block[k, b], block[pivot, b] = block[pivot, b], block[k, b]
            inverse[k, b], inverse[pivot, b] = inverse[pivot, b], inverse[k, b]
        inverse_pivot = 1.0 / block[k, k]
        for b in range(BLOCK):
            block[k, b] *= inverse_pivot
            inverse[k, b] *= inverse_pivot
        for a in range(BLOCK):
            factor = block[a, k] if a != k else 0.0
            for b in range(BLOCK):
                block[a, b] -= factor * block[k, b]
                inverse[a, b] -= factor * inverse[k, b]


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})
def _solve(rank, starts, columns, lower, upper, pivots, right):
    """Solve with L, then with U."""
    n = len(rank)
    x = np.empty((n, BLOCK), right.dtype)
    for point in range(n):
        x[rank[point]] = right[point]
    for row in range(n):
        for entry in range(starts[row], starts[row + 1]):
            block, z = lower[entry], x[columns[entry]]
            for a in range(BLOCK):
                total = 0.0
                for b in range(BLOCK):
                    total += block[a, b] * z[b]
                x[row, a] -= total
    y = np.empty(BLOCK, right.dtype)
    for row in range(n - 1, -1, -1):
        for a in range(BLOCK):
            total = 0.0
            for b in range(BLOCK):
                total += pivots[row, a, b] * x[row, b]
            y[a] = total
        for entry in range(starts[row], starts[row + 1]):
            block, z = upper[entry], x[columns[entry]]
            for a in range(BLOCK):
                total = 0.0
                for b in range(BLOCK):
                    total += block[a, b] * y[b]
                z[a] -= total
        x[row] = y
    return x[rank]


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})
def _solve_transposed(rank, starts, columns, lower, upper, pivots, right):
    """Solve with the transpose of U, then with that of L."""
    n = len(rank)
    x = np.empty((n, BLOCK), right.dtype)
    for point in range(n):
        x[rank[point]] = right[point]
    y = np.empty(BLOCK, right.dtype)
    for row in range(n):
        for entry in range(starts[row], starts[row + 1]):
            block, z = upper[entry], x[columns[entry]]
            for a in range(BLOCK):
                factor = z[a]
                for b in range(BLOCK):
                    x[row, b] -= block[a, b] * factor
        y[:] = 0.0
        for a in range(BLOCK):
            for b in range(BLOCK):
                y[b] += pivots[row, a, b] * x[row, a]
        x[row] = y
    for row in range(n - 1, -1, -1):
        for entry in range(starts[row], starts[row + 1]):
            block, z = lower[entry], x[columns[entry]]
            for a in range(BLOCK):
                factor = x[row, a]
                for b in range(BLOCK):
                    z[b] -= block[a, b] * factor
    return x[rank]
