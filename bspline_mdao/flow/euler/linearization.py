"""Derivatives of the residual at a state: Jacobians of all faces, and the products with them."""

from __future__ import annotations

import numpy as np
from numba import njit

from .face_states import face_state, shock_sensor
from .flux import face_flux_jvp
from .stencil import FIRST, INNER, MEAN, SLIP, THIRD

_ZERO, _STILL = (0.0,) * 5, (0.0,) * 3
_UNIT = tuple(tuple(float(n == m) for n in range(5)) for m in range(5))
_AXIS = tuple(unit[:3] for unit in _UNIT[:3])


@njit(cache=True, nogil=True)
def face_jacobians(
    cells, weights, classes, roles, areas, states, stream, dissipation, threshold, by_state, by_area, jumps, sensors
):
    """Differentiate the flux of every face.

    By its mean state and jump (5, 10), and by its area vector (5, 3). `jumps` (4) are the weights of the jump with the
    sensor as it is; `sensors` (9) are the derivatives of the sensor in the four pressures, and of the flux in it.
    """
    for f in range(len(cells)):
        s = (areas[f, 0], areas[f, 1], areas[f, 2])
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] == 0.0:
            continue
        near, role, w = cells[f], roles[f], weights[classes[f]]
        sigma = 0.0
        if role == INNER and threshold > 0.0:
            sigma, gradient = shock_sensor(states, near, w, threshold)
            sensors[f, 0], sensors[f, 1], sensors[f, 2], sensors[f, 3] = gradient
        mean, jump, slope = face_state(states, near, w, role, stream, dissipation, sigma)
        if role == SLIP:
            for n in range(3):
                by_state[f, 1 + n, 4] = s[n]
                by_area[f, 1 + n, n] = mean[4]
            continue
        _fill(mean, jump, s, by_state[f], by_area[f])
        _weigh(w, role, dissipation, sigma, jumps[f])
        for n in range(5):
            for m in range(5):
                sensors[f, 4 + n] += by_state[f, n, 5 + m] * slope[m]


@njit(cache=True, nogil=True)
def _fill(mean, jump, s, by_state, by_area):
    """Differentiate in one argument after the other: written out, what is multiplied by zero is not compiled."""
    _put(by_state, 0, face_flux_jvp(mean, jump, s, _UNIT[0], _ZERO, _STILL))
    _put(by_state, 1, face_flux_jvp(mean, jump, s, _UNIT[1], _ZERO, _STILL))
    _put(by_state, 2, face_flux_jvp(mean, jump, s, _UNIT[2], _ZERO, _STILL))
    _put(by_state, 3, face_flux_jvp(mean, jump, s, _UNIT[3], _ZERO, _STILL))
    _put(by_state, 4, face_flux_jvp(mean, jump, s, _UNIT[4], _ZERO, _STILL))
    _put(by_state, 5, face_flux_jvp(mean, jump, s, _ZERO, _UNIT[0], _STILL))
    _put(by_state, 6, face_flux_jvp(mean, jump, s, _ZERO, _UNIT[1], _STILL))
    _put(by_state, 7, face_flux_jvp(mean, jump, s, _ZERO, _UNIT[2], _STILL))
    _put(by_state, 8, face_flux_jvp(mean, jump, s, _ZERO, _UNIT[3], _STILL))
    _put(by_state, 9, face_flux_jvp(mean, jump, s, _ZERO, _UNIT[4], _STILL))
    _put(by_area, 0, face_flux_jvp(mean, jump, s, _ZERO, _ZERO, _AXIS[0]))
    _put(by_area, 1, face_flux_jvp(mean, jump, s, _ZERO, _ZERO, _AXIS[1]))
    _put(by_area, 2, face_flux_jvp(mean, jump, s, _ZERO, _ZERO, _AXIS[2]))


@njit(cache=True, nogil=True)
def _put(jacobian, m, column):
    for n in range(5):
        jacobian[n, m] = column[n]


@njit(cache=True, nogil=True)
def _weigh(weights, role, dissipation, sigma, jumps):
    """Weights of the cells in the jump."""
    for k in range(4):
        if role == INNER:
            third = dissipation * weights[THIRD, k]
            jumps[k] = third + sigma * (weights[FIRST, k] - third)
        else:
            jumps[k] = weights[FIRST, k]


@njit(cache=True, nogil=True)
def state_jvp(cells, weights, classes, roles, by_state, jumps, sensors, d_states, out):
    """Add the change of the residual with the states."""
    mean, jump = np.zeros(5, d_states.dtype), np.zeros(5, d_states.dtype)
    for f in range(len(cells)):
        near, w, role = cells[f], weights[classes[f], MEAN], roles[f]
        sense = 0.0
        for n in range(5):
            mean[n] = 0.0
            jump[n] = 0.0
        for k in range(4):
            at = near[k]
            for n in range(5):
                mean[n] += w[k] * d_states[at, n]
                jump[n] += jumps[f, k] * d_states[at, n]
            sense += sensors[f, k] * d_states[at, 4]
        b, c = near[1], near[2]
        for n in range(5):
            flux = sensors[f, 4 + n] * sense
            for m in range(5):
                flux += by_state[f, n, m] * mean[m] + by_state[f, n, 5 + m] * jump[m]
            out[b, n] += flux
            if role == INNER:
                out[c, n] -= flux


@njit(cache=True, nogil=True)
def state_vjp(cells, weights, classes, roles, by_state, jumps, sensors, bar, out):
    """Add the transposed product of `state_jvp`."""
    through, mean, jump = np.zeros(5), np.zeros(5), np.zeros(5)
    for f in range(len(cells)):
        near, w, role = cells[f], weights[classes[f], MEAN], roles[f]
        b, c = near[1], near[2]
        sense = 0.0
        for n in range(5):
            through[n] = bar[b, n] - (bar[c, n] if role == INNER else 0.0)
            sense += sensors[f, 4 + n] * through[n]
            mean[n] = 0.0
            jump[n] = 0.0
        for n in range(5):
            for m in range(5):
                mean[m] += by_state[f, n, m] * through[n]
                jump[m] += by_state[f, n, 5 + m] * through[n]
        for k in range(4):
            at = near[k]
            for n in range(5):
                out[at, n] += w[k] * mean[n] + jumps[f, k] * jump[n]
            out[at, 4] += sensors[f, k] * sense
