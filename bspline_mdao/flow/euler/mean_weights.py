"""Derivatives of the residual with respect to the weights of mean states.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .flux import STILL, ZERO
from .flux_derivatives import face_flux_jvp, face_flux_vjp
from .gas import N_STATES
from .linearization import Linearization, through_face
from .reconstruction import face_state, shock_sensor

__all__ = ["mean_jvp", "mean_vjp"]


def mean_jvp(
    tangent: Linearization,  # where it is differentiated
    ids: np.ndarray,  # (n,) of int, numbers of inner faces
    d_weights: np.ndarray,  # (n, 4), change of the weights of their four cells
) -> np.ndarray:  # (n_cells, 5)
    """Change of the residual with the weights of some mean states."""
    discretization, flux = tangent.discretization, np.zeros((len(tangent.areas), N_STATES))
    flux[ids] = mean_changes(*_at(tangent, ids), d_weights)
    return discretization.sums.of_faces(flux, discretization.faces.n_cells)


def mean_vjp(tangent: Linearization, ids: np.ndarray, bar: np.ndarray) -> np.ndarray:
    """Transposed product of `mean_jvp`: rows of the residual, shape (n_cells, 5), to weights, shape (n, 4)."""
    return mean_bars(*_at(tangent, ids), np.ascontiguousarray(tangent.discretization.halo.pad(bar)))


def _at(tangent: Linearization, ids: np.ndarray) -> tuple:
    """What the kernels take."""
    discretization, stencil = tangent.discretization, tangent.discretization.stencil
    settings = discretization.dissipation, discretization.shock_threshold
    return *stencil.part(ids), tangent.areas[ids], tangent.states, *settings


@njit(cache=True, error_model="numpy")
def mean_changes(cells, means, classes, differences, lines, roles, areas, states, dissipation, threshold, d_weights):
    """Change of the fluxes of inner faces, shape (n, 5), with the weights of their mean states, shape (n, 4)."""
    out = np.zeros((len(cells), 5))
    for f in range(len(cells)):
        s = (areas[f, 0], areas[f, 1], areas[f, 2])
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] == 0.0:
            continue
        weights = means[classes[f]], differences[lines[f]]
        mean, jump, sigma = _states(states, cells[f], *weights, roles[f], dissipation, threshold)
        d_mean = (
            _along(states, cells[f], d_weights[f], sigma, 0),
            _along(states, cells[f], d_weights[f], sigma, 1),
            _along(states, cells[f], d_weights[f], sigma, 2),
            _along(states, cells[f], d_weights[f], sigma, 3),
            _along(states, cells[f], d_weights[f], sigma, 4),
        )
        flux = face_flux_jvp(mean, jump, s, sigma, d_mean, ZERO, STILL, 0.0)
        for n in range(5):
            out[f, n] = flux[n]
    return out


@njit(cache=True, error_model="numpy")
def mean_bars(cells, means, classes, differences, lines, roles, areas, states, dissipation, threshold, bar):
    """What the weights of the mean states of inner faces, shape (n, 4), get of rows of the residual."""
    out = np.zeros((len(cells), 4))
    for f in range(len(cells)):
        s = (areas[f, 0], areas[f, 1], areas[f, 2])
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] == 0.0:
            continue
        near = cells[f]
        weights = means[classes[f]], differences[lines[f]]
        mean, jump, sigma = _states(states, near, *weights, roles[f], dissipation, threshold)
        mean_bar, _, _, _ = face_flux_vjp(mean, jump, s, sigma, through_face(bar, near, roles[f]))
        for k in range(4):
            for n in range(5):
                out[f, k] += (1.0 - sigma) * states[near[k], n] * mean_bar[n]
    return out


@njit(cache=True, error_model="numpy")
def _states(states, cells, means, differences, role, dissipation, threshold):
    """Mean state, jump and sensor of an inner face."""
    sigma = shock_sensor(states, cells, threshold)[0] if threshold > 0.0 else 0.0
    mean, jump, _, _ = face_state(states, cells, means, differences, role, ZERO, dissipation, sigma)
    return mean, jump, sigma


@njit(cache=True, error_model="numpy", inline="always")
def _along(states, cells, d_weights, sigma, n):
    """Change of a number of the mean state: that of two cells, at shocks, has no weights that change."""
    change = 0.0
    for k in range(4):
        change += d_weights[k] * states[cells[k], n]
    return (1.0 - sigma) * change
