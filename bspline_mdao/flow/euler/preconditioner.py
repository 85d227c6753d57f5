"""The preconditioner of linear systems with the Jacobian: an incomplete factor L U of a compact approximation of it.

The compact approximation uses only the two cells at a face: the mean state is halfway between them, and a fraction of
their difference is dissipated: all of it at shocks, where the Jacobian itself is as compact. Time steps are on its
diagonal. Pressures on walls are extrapolated from the first two cells, which takes a tenth fewer products than from
one.

Several processes solve for the cells next to other processes together, see `.interface_schur`.

Blocks are 5 x 5, and the pattern is symmetric. See `.factor_pattern` for it, `.block_factor` for the factor.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit

from ...base.numerics.vec5 import (
    add_scaled,
    block_product,
    load,
    load_halves,
    store,
    store_halves,
    subtract_scaled,
    zero_halves,
    zeros,
)
from .block_factor import BlockFactor
from .cell_sums import visit
from .factor_pattern import FactorPattern
from .flux import ROUNDING
from .gas import GAMMA
from .interface_schur import BorderedFactor
from .linearization import Linearization
from .reconstruction import FARFIELD, INNER
from .residual import Discretization

COMPACT_DISSIPATION = 0.75
"""Smallest fraction of the first difference that is dissipated in place of the third: with half of it the factor is
unstable on grids with the spacing of boundary layers."""

FLAT, FLAT_ROUNDING = 20.0, 0.03
"""Area ratio of the faces of flat cells to the middle face of their cells, above which the convective speed of entropy
and vorticity through them is rounded by less than in the flux, and the limit of this reduction."""

Factor = BlockFactor | BorderedFactor
"""Approximate solves with the Jacobian, and with its transpose."""


class PlacedBlocks(NamedTuple):
    """Blocks of the matrix to factor, and where kernels add blocks of cells and faces: see `FactorPattern`."""

    rank: np.ndarray
    places: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    diagonal: np.ndarray


class FaceDerivatives(NamedTuple):
    """Derivatives of the fluxes of all faces, as arguments of kernels: see `.face_jacobians.FaceJacobians`."""

    values: np.ndarray
    shock_rows: np.ndarray
    shocks: np.ndarray


def compact_factor(
    linearization: Linearization,
    pattern: FactorPattern,
    diagonal: np.ndarray,  # (n_cells, 5, 5), addition to the blocks on the diagonal
) -> Factor:
    """Factor the compact approximation of a Jacobian: all processes call it together."""
    scheme, sums = linearization.discretization.scheme, linearization.discretization.sums
    lower, upper = (zero_halves((pattern.n_entries, *diagonal.shape[1:])) for _ in range(2))
    placed = np.empty(diagonal.shape, np.float32)
    placed[pattern.rank] = diagonal
    dissipation = np.float32(max(COMPACT_DISSIPATION, 1.5 * scheme.dissipation))
    jacobians = linearization.jacobians
    derivatives = FaceDerivatives(jacobians.values, jacobians.shock_rows, jacobians.shocks)
    field = linearization.states, carried_excess(linearization)
    blocks = PlacedBlocks(pattern.rank, pattern.places, lower, upper, placed)
    around, rest = (sums.starts, sums.entries), (scheme, derivatives, dissipation, *field, blocks)
    visit(len(placed), lambda part: _place(around, part.start, part.stop, *rest))
    _place_behind(linearization.discretization.faces.n_inner, scheme, jacobians.values, blocks)
    if pattern.border and pattern.outer:
        return BorderedFactor.of(pattern, pattern.border, pattern.outer, lower, upper, placed)
    return BlockFactor.of(pattern, lower, upper, placed)


@njit(cache=True, error_model="numpy", nogil=True)
def _place(around, first, end, scheme, derivatives, dissipation, states, excess, blocks):
    """Add the blocks of all faces of a range of cells; a block between two cells is added at the later row."""
    # Own cells come after cells of other processes. Faces around a cell are as in `CellSums`.
    face_starts, faces = around
    cells, means, classes, roles = scheme.cells, scheme.means, scheme.classes, scheme.roles
    jacobians, shock_rows, shocks = derivatives
    rank, places, lower, upper, diagonal = blocks
    n_owned, half, carried = len(rank), np.float32(0.5), np.zeros((5, 5), np.float32)
    for cell in range(first, end):
        row = rank[cell]
        for at in range(face_starts[cell], face_starts[cell + 1]):
            f = faces[at] if faces[at] >= 0 else -1 - faces[at]
            if roles[f] != INNER:
                w = means[classes[f]]
                behind = w[0] + w[2] if places[f] < 0 else 0.0
                mean, jump = np.float32(w[1] + behind), np.float32(-1.0 if roles[f] == FARFIELD else 0.0)
                for n in range(5):
                    block = add_scaled(load(diagonal, 25 * row + 5 * n), mean, load(jacobians, 50 * f + 10 * n))
                    store(diagonal, 25 * row + 5 * n, add_scaled(block, jump, load(jacobians, 50 * f + 10 * n + 5)))
                continue
            part = dissipation
            if len(shock_rows) > 0 and shock_rows[f] >= 0:
                part += shocks[shock_rows[f], 0] * (np.float32(1.0) - dissipation)
            sign = np.float32(1.0 if faces[at] >= 0 else -1.0)  # rows of the right cell get the negative
            other = cells[f, 2] if faces[at] >= 0 else cells[f, 1]
            is_later = places[f] >= 0 and (other >= n_owned or rank[other] < row)
            place = 25 * places[f]
            if excess[f] > 0.0:
                _half_way(states[cells[f, 1]], states[cells[f, 2]], carried)
            for n in range(5):
                mean, jump = load(jacobians, 50 * f + 10 * n), load(jacobians, 50 * f + 10 * n + 5)
                if excess[f] > 0.0:
                    jump = add_scaled(jump, excess[f], load(carried, 5 * n))
                # for the row of this cell: from itself, and from the other
                diagonal_block = add_scaled(load(diagonal, 25 * row + 5 * n), sign * half, mean)
                store(diagonal, 25 * row + 5 * n, subtract_scaled(diagonal_block, part, jump))
                if is_later:
                    at_lower, at_upper = load_halves(lower, place + 5 * n), load_halves(upper, place + 5 * n)
                    at_lower = add_scaled(add_scaled(at_lower, sign * half, mean), part, jump)
                    at_upper = subtract_scaled(subtract_scaled(at_upper, sign * half, mean), -part, jump)
                    store_halves(lower, place + 5 * n, at_lower)
                    store_halves(upper, place + 5 * n, at_upper)


@njit(cache=True, error_model="numpy", nogil=True)
def _place_behind(first, scheme, jacobians, blocks):
    """Add the blocks of boundary faces at the second cells inwards, which also include those of the third cells."""
    # Separately, since a block may be where another row, and another thread, adds too.
    cells, means, classes = scheme.cells, scheme.means, scheme.classes
    rank, places, lower, upper, _ = blocks
    for f in range(first, len(cells)):
        if places[f] < 0:
            continue
        w, side = means[classes[f]], lower if rank[cells[f, 0]] < rank[cells[f, 1]] else upper
        behind = np.float32(w[0] + w[2])
        for n in range(5):
            at = 25 * places[f] + 5 * n
            store_halves(side, at, add_scaled(load_halves(side, at), behind, load(jacobians, 50 * f + 10 * n)))


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _half_way(left, right, block):
    """Write the derivatives of the conserved quantities halfway between two states."""
    velocity = 0.5 * (left[1] + right[1]), 0.5 * (left[2] + right[2]), 0.5 * (left[3] + right[3])
    _conserved(0.5 * (left[0] + right[0]), velocity, 1.0, block)


def carried_excess(linearization: Linearization) -> np.ndarray:
    """Half the speed, times the area, that is subtracted from the dissipation of every face, (n_faces,), float32."""
    # Across flat cells the rounding of the convective speed of entropy and vorticity is a thousand times the convection
    # along them. The Jacobian dissipates a third difference by it, which is almost zero for smooth fields; the first
    # difference of the compact approximation would tie all cells of a layer together.
    stencil, areas = linearization.discretization.stencil, linearization.areas
    n_seen, sizes = len(linearization.states), np.linalg.norm(areas, axis=1)
    largest, out = np.zeros((n_seen, 4)), np.zeros(len(areas), np.float32)
    _largest(stencil.cells, stencil.roles, sizes, largest)
    middle = 0.5 * (largest[:, 2] + largest[:, 3])
    _excess(stencil.cells, stencil.roles, areas, sizes, linearization.states, middle, out)
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def _largest(cells, roles, sizes, largest):
    """Find the four largest faces of every cell, in descending order."""
    for f in range(len(cells)):
        for k in range(1, 3 if roles[f] == INNER else 2):
            size, diagonal_block = sizes[f], largest[cells[f, k]]
            for n in range(4):
                if size > diagonal_block[n]:
                    size, diagonal_block[n] = diagonal_block[n], size


@njit(cache=True, error_model="numpy", nogil=True)
def _excess(cells, roles, areas, sizes, states, middle, out):
    for f in range(len(cells)):
        b, c = cells[f, 1], cells[f, 2]
        if roles[f] != INNER or sizes[f] <= FLAT * max(middle[b], middle[c]):
            continue
        part = max(FLAT_ROUNDING, ROUNDING * FLAT * max(middle[b], middle[c]) / sizes[f])
        w, v, s = states[b], states[c], areas[f]
        through = 0.5 * ((w[1] + v[1]) * s[0] + (w[2] + v[2]) * s[1] + (w[3] + v[3]) * s[2])
        sound = GAMMA * (w[4] + v[4]) / (w[0] + v[0]) * sizes[f] ** 2
        out[f] = 0.5 * (np.sqrt(through**2 + ROUNDING**2 * sound) - np.sqrt(through**2 + part**2 * sound))


def time_terms(
    discretization: Discretization, states: np.ndarray, areas: np.ndarray, is_long: bool = False
) -> np.ndarray:
    """Diagonal of the pseudo-time term at a CFL number of one, shape (n_cells, 5, 5)."""
    # Derivatives of the conserved quantities with respect to the states, times the volume of a cell divided by its time
    # step: half the sum of the wave speeds through its faces or, for long time steps, the same for a cube with the
    # middle ones. In a flat cell at a wall these are the speeds along the wall, so all cells of a layer advance with
    # the outer flow.
    out = np.zeros((len(states), 5, 5))
    _time_terms(discretization.stencil.cells, discretization.stencil.roles, areas, states, is_long, out)
    return out


def by_surface(
    product: Callable,  # product, solve: for arrays of shape (n_cells, 5); the result of the product is overwritten
    solve: Callable,
    sizes: np.ndarray,  # (n_cells, 1), surfaces of the cells (m^2), see `Discretization.sizes`
    blocks: np.ndarray | None = None,  # (n_cells, 5, 5), blocks on the diagonal, which the product omits
) -> tuple[Callable, Callable]:
    """Product with a matrix and approximate solution with it, in float32, for rows divided by the surfaces of cells."""
    single = sizes.ravel().astype(np.float32)
    inverse = 1.0 / single

    def divided(x: np.ndarray) -> np.ndarray:
        change = product(x)
        return _scaled_rows(inverse, change, change) if blocks is None else add_blocks(blocks, x, inverse, change)

    return divided, lambda y: solve(_scaled_rows(single, y, np.empty_like(y)))


def _scaled_rows(factors: np.ndarray, rows: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Write rows of float32, shape (n, 5), times a factor each; numpy takes three times as long for rows of five."""
    visit(len(rows), lambda part: _scale(factors[part], rows[part], out[part]))
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def _scale(factors, rows, out):
    for c in range(len(factors)):
        for n in range(5):
            out[c, n] = factors[c] * rows[c, n]


def add_blocks(blocks: np.ndarray, x: np.ndarray, factors: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Add products of blocks, (n_cells, 5, 5), with states to an array in place, and scale its rows; all in float32."""
    visit(len(x), lambda part: _add_blocks(blocks[part], x[part], factors[part], out[part]))
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def _add_blocks(blocks, x, factors, out):
    for c in range(len(x)):
        product = block_product(blocks, 25 * c, load(x, 5 * c))
        total = add_scaled(product, np.float32(1.0), load(out, 5 * c))
        store(out, 5 * c, add_scaled(zeros(), factors[c], total))


@njit(cache=True, error_model="numpy", nogil=True)
def _time_terms(cells, roles, areas, states, is_long, out):
    rates, speeds = np.zeros(len(states)), np.zeros((len(states), 4))  # the four largest
    for f in range(len(cells)):
        s = areas[f]
        for k in range(1, 3 if roles[f] == INNER else 2):
            if cells[f, k] >= len(states):  # on another process
                continue
            w = states[cells[f, k]]
            sound = np.sqrt(GAMMA * w[4] / w[0] * (s[0] * s[0] + s[1] * s[1] + s[2] * s[2]))
            speed, largest = abs(w[1] * s[0] + w[2] * s[1] + w[3] * s[2]) + sound, speeds[cells[f, k]]
            rates[cells[f, k]] += 0.5 * speed
            for n in range(4):
                if speed > largest[n]:
                    speed, largest[n] = largest[n], speed
    for c in range(len(states)):
        rate = 1.5 * (speeds[c, 2] + speeds[c, 3]) if is_long else rates[c]
        _conserved(states[c, 0], states[c, 1:4], rate, out[c])


@njit(cache=True, error_model="numpy", nogil=True)
def _conserved(rho, u, rate, block):
    """Write the derivatives of the conserved quantities with respect to a state, times a rate."""
    block[0, 0], block[4, 4] = rate, rate / (GAMMA - 1.0)
    block[4, 0] = 0.5 * rate * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    for n in range(3):
        block[1 + n, 0], block[1 + n, 1 + n], block[4, 1 + n] = rate * u[n], rate * rho, rate * rho * u[n]
