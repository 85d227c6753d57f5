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
from .reconstruction import area_of, face_state, has_area, shock_sensor

__all__ = ["mean_jvp", "mean_vjp"]


def mean_jvp(
    tangent: Linearization,  # point of differentiation
    ids: np.ndarray,  # (n,) of int, numbers of inner faces
    d_weights: np.ndarray,  # (n, 4), change of the weights of their four cells
) -> np.ndarray:  # (n_cells, 5)
    """Change of the residual with the weights of some mean states."""
    discretization, flux = tangent.discretization, np.zeros((len(tangent.areas), N_STATES))
    flux[ids] = mean_changes(*_at(tangent, ids), d_weights)
    return discretization.sums.of_faces(flux, discretization.faces.n_cells)


def mean_vjp(tangent: Linearization, ids: np.ndarray, bar: np.ndarray) -> np.ndarray:
    """Transposed product of `mean_jvp`: from rows of the residual, shape (n_cells, 5), to weights, shape (n, 4)."""
    return mean_bars(*_at(tangent, ids), np.ascontiguousarray(tangent.discretization.halo.pad(bar)))


def _at(tangent: Linearization, ids: np.ndarray) -> tuple:
    """Arguments of the kernels."""
    return tangent.discretization.scheme.part(ids), tangent.areas[ids], tangent.states


@njit(cache=True, error_model="numpy")
def mean_changes(scheme, areas, states, d_weights):
    """Change of the fluxes of inner faces, shape (n, 5), with the weights of their mean states, shape (n, 4)."""
    out = np.zeros((len(areas), 5))
    for f in range(len(areas)):
        s = area_of(areas, f)
        if not has_area(s):
            continue
        mean, jump, sigma = _states(scheme, f, states)
        near = scheme.cells[f]
        d_mean = (
            _along(states, near, d_weights[f], sigma, 0),
            _along(states, near, d_weights[f], sigma, 1),
            _along(states, near, d_weights[f], sigma, 2),
            _along(states, near, d_weights[f], sigma, 3),
            _along(states, near, d_weights[f], sigma, 4),
        )
        flux = face_flux_jvp(mean, jump, s, sigma, d_mean, ZERO, STILL, 0.0)
        for n in range(5):
            out[f, n] = flux[n]
    return out


@njit(cache=True, error_model="numpy")
def mean_bars(scheme, areas, states, bar):
    """Adjoints of the weights of the mean states of inner faces, shape (n, 4), from rows of the residual."""
    out = np.zeros((len(areas), 4))
    for f in range(len(areas)):
        s = area_of(areas, f)
        if not has_area(s):
            continue
        near, (mean, jump, sigma) = scheme.cells[f], _states(scheme, f, states)
        mean_bar, _, _, _ = face_flux_vjp(mean, jump, s, sigma, through_face(scheme, f, bar))
        for k in range(4):
            for n in range(5):
                out[f, k] += (1.0 - sigma) * states[near[k], n] * mean_bar[n]
    return out


@njit(cache=True, error_model="numpy")
def _states(scheme, f, states):
    """Mean state, jump and sensor of an inner face."""
    sigma = shock_sensor(states, scheme.cells[f], scheme.threshold) if scheme.threshold > 0.0 else 0.0
    mean, jump, _, _ = face_state(scheme, f, states, ZERO, sigma)
    return mean, jump, sigma


@njit(cache=True, error_model="numpy", inline="always")
def _along(states, cells, d_weights, sigma, n):
    """Change of a component of the mean state: at shocks, the mean of two cells, its weights do not change."""
    change = 0.0
    for k in range(4):
        change += d_weights[k] * states[cells[k], n]
    return (1.0 - sigma) * change
