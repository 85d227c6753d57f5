"""Derivatives of the residual at a state: Jacobians of all faces, and the products with them."""

from __future__ import annotations

import numpy as np
from numba import njit

from .face_states import face_state, face_weights, shock_sensor
from .flux import face_flux_jvp
from .stencil import INNER, SLIP

_ZERO, _STILL = (0.0,) * 5, (0.0,) * 3
_UNIT = tuple(tuple(float(n == m) for n in range(5)) for m in range(5))
_AXIS = tuple(unit[:3] for unit in _UNIT[:3])


@njit(cache=True, error_model="numpy", nogil=True)
def face_jacobians(
    cells, weights, classes, roles, areas, states, stream, dissipation, threshold, by_state, by_area, shares, sensors
):
    """Differentiate the flux of every face.

    By its mean state and jump (5, 10), and by its area vector (5, 3). `shares` (2, 4) are the weights of the cells in
    both with the sensor as it is; `sensors` (15) are the sensor, its derivatives in the four pressures and in the mean
    state of the first and the last cell, and those of the flux in it; without a threshold there are none.
    """
    for f in range(len(cells)):
        s = (areas[f, 0], areas[f, 1], areas[f, 2])
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] == 0.0:
            continue
        near, role, w = cells[f], roles[f], weights[classes[f]]
        sigma = 0.0
        if role == INNER and threshold > 0.0:
            sigma, by_pressure, by_mean = shock_sensor(states, near, threshold)
            sensors[f, 0] = sigma
            for k in range(4):
                sensors[f, 1 + k] = by_pressure[k]
            for n in range(5):
                sensors[f, 5 + n] = by_mean[n]
        face_weights(w, role, dissipation, sigma, shares[f])
        mean, jump, mean_slope, jump_slope = face_state(states, near, w, role, stream, dissipation, sigma)
        if role == SLIP:
            for n in range(3):
                by_state[f, 1 + n, 4] = s[n]
                by_area[f, 1 + n, n] = mean[4]
            continue
        _fill(mean, jump, s, sigma, by_state[f], by_area[f])
        if role == INNER and threshold > 0.0:
            column = face_flux_jvp(mean, jump, s, sigma, mean_slope, jump_slope, _STILL, 1.0)
            for n in range(5):
                sensors[f, 10 + n] = column[n]


@njit(cache=True, error_model="numpy", nogil=True)
def _fill(mean, jump, s, sigma, by_state, by_area):
    """Differentiate in one argument after the other: written out, what is multiplied by zero is not compiled."""
    _put(by_state, 0, face_flux_jvp(mean, jump, s, sigma, _UNIT[0], _ZERO, _STILL, 0.0))
    _put(by_state, 1, face_flux_jvp(mean, jump, s, sigma, _UNIT[1], _ZERO, _STILL, 0.0))
    _put(by_state, 2, face_flux_jvp(mean, jump, s, sigma, _UNIT[2], _ZERO, _STILL, 0.0))
    _put(by_state, 3, face_flux_jvp(mean, jump, s, sigma, _UNIT[3], _ZERO, _STILL, 0.0))
    _put(by_state, 4, face_flux_jvp(mean, jump, s, sigma, _UNIT[4], _ZERO, _STILL, 0.0))
    _put(by_state, 5, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[0], _STILL, 0.0))
    _put(by_state, 6, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[1], _STILL, 0.0))
    _put(by_state, 7, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[2], _STILL, 0.0))
    _put(by_state, 8, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[3], _STILL, 0.0))
    _put(by_state, 9, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[4], _STILL, 0.0))
    _put(by_area, 0, face_flux_jvp(mean, jump, s, sigma, _ZERO, _ZERO, _AXIS[0], 0.0))
    _put(by_area, 1, face_flux_jvp(mean, jump, s, sigma, _ZERO, _ZERO, _AXIS[1], 0.0))
    _put(by_area, 2, face_flux_jvp(mean, jump, s, sigma, _ZERO, _ZERO, _AXIS[2], 0.0))


@njit(cache=True, error_model="numpy", nogil=True)
def _put(jacobian, m, column):
    for n in range(5):
        jacobian[n, m] = column[n]


@njit(cache=True, error_model="numpy", nogil=True)
def state_jvp(cells, roles, by_state, shares, sensors, d_states, out):
    """Add the change of the residual with the states."""
    mean, jump, has_sensor = np.zeros(5, d_states.dtype), np.zeros(5, d_states.dtype), len(sensors) > 0
    for f in range(len(cells)):
        near, role = cells[f], roles[f]
        sense = 0.0
        for n in range(5):
            mean[n] = 0.0
            jump[n] = 0.0
        for k in range(4):
            at = near[k]
            for n in range(5):
                mean[n] += shares[f, 0, k] * d_states[at, n]
                jump[n] += shares[f, 1, k] * d_states[at, n]
        if has_sensor:
            for k in range(4):
                sense += sensors[f, 1 + k] * d_states[near[k], 4]
            for n in range(5):
                sense += 0.5 * sensors[f, 5 + n] * (d_states[near[0], n] + d_states[near[3], n])
        b, c = near[1], near[2]
        for n in range(5):
            flux = sensors[f, 10 + n] * sense if has_sensor else 0.0
            for m in range(5):
                flux += by_state[f, n, m] * mean[m] + by_state[f, n, 5 + m] * jump[m]
            out[b, n] += flux
            if role == INNER:
                out[c, n] -= flux


@njit(cache=True, error_model="numpy", nogil=True)
def state_vjp(cells, roles, by_state, shares, sensors, bar, out):
    """Add the transposed product of `state_jvp`."""
    through, mean, jump, has_sensor = np.zeros(5), np.zeros(5), np.zeros(5), len(sensors) > 0
    for f in range(len(cells)):
        near, role = cells[f], roles[f]
        b, c = near[1], near[2]
        sense = 0.0
        for n in range(5):
            through[n] = bar[b, n] - (bar[c, n] if role == INNER else 0.0)
            if has_sensor:
                sense += sensors[f, 10 + n] * through[n]
            mean[n] = 0.0
            jump[n] = 0.0
        for n in range(5):
            for m in range(5):
                mean[m] += by_state[f, n, m] * through[n]
                jump[m] += by_state[f, n, 5 + m] * through[n]
        for k in range(4):
            at = near[k]
            for n in range(5):
                out[at, n] += shares[f, 0, k] * mean[n] + shares[f, 1, k] * jump[n]
        if has_sensor:
            for k in range(4):
                out[near[k], 4] += sensors[f, 1 + k] * sense
            for n in range(5):
                out[near[0], n] += 0.5 * sensors[f, 5 + n] * sense
                out[near[3], n] += 0.5 * sensors[f, 5 + n] * sense
