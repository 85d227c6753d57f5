"""An incomplete factor of a compact neighbour of the Jacobian, with time steps on its diagonal.

The compact neighbour sees the two cells at a face alone: the mean state is half-way between them, and a share of their
difference is dissipated: all of it at shocks, where the Jacobian itself is as compact.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .block_ilu import BlockFactor, FactorPattern
from .discretization import Discretization, Linearization
from .gas import GAMMA
from .stencil import FIRST, INNER, MEAN

FILL = 1
"""Level of fill of the factor."""

COMPACT_DISSIPATION = 0.5
"""Share of the first difference that stands in for that of the third."""


def factor_pattern(discretization: Discretization) -> FactorPattern:
    """Find where the factor has blocks: once per grid."""
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
    upper, placed = np.zeros_like(lower), np.empty_like(diagonal)
    placed[pattern.rank] = diagonal
    index = stencil.cells, stencil.weights, stencil.classes, stencil.roles
    dissipation = max(COMPACT_DISSIPATION, 1.5 * linearization.discretization.dissipation)
    sensor = linearization.sensors[:, 0]
    _place(*index, linearization.by_state, dissipation, sensor, pattern.rank, pattern.places, lower, upper, placed)
    return BlockFactor.of(pattern, lower, upper, placed)


@njit(cache=True, error_model="numpy", nogil=True)
def _place(cells, weights, classes, roles, by_state, dissipation, sensor, rank, places, lower, upper, diagonal):
    """Add the blocks of all faces at their places."""
    for f in range(len(cells)):
        left, right, jacobian = rank[cells[f, 1]], rank[cells[f, 2]], by_state[f]
        if roles[f] != INNER:
            w = weights[classes[f]]
            mean = w[MEAN, 0] + w[MEAN, 1] + w[MEAN, 2]
            diagonal[left] += mean * jacobian[:, :5] + w[FIRST, 1] * jacobian[:, 5:]
            continue
        at, shock = places[f], sensor[f] if len(sensor) > 0 else 0.0
        share = dissipation + shock * (1.0 - dissipation)
        for n in range(5):
            for m in range(5):
                from_left = 0.5 * jacobian[n, m] - share * jacobian[n, 5 + m]
                from_right = 0.5 * jacobian[n, m] + share * jacobian[n, 5 + m]
                diagonal[left, n, m] += from_left
                diagonal[right, n, m] -= from_right
                if left > right:
                    lower[at, n, m] += from_right
                    upper[at, n, m] -= from_left
                else:
                    lower[at, n, m] -= from_left
                    upper[at, n, m] += from_right


def time_terms(discretization: Discretization, states: np.ndarray, areas: np.ndarray) -> np.ndarray:
    """Diagonal of the pseudo-time term at a CFL number of one, shape (n_cells, 5, 5).

    The conserved quantities by the states, times half the sum of the wave speeds through the faces of a cell: its
    volume by its time step.
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
