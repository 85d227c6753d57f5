"""Sum of the fluxes out of every cell: the residual of steady flow."""

from __future__ import annotations

from numba import njit

from .face_states import face_state, shock_sensor
from .flux import face_flux
from .stencil import INNER, SLIP


@njit(cache=True, error_model="numpy", nogil=True)
def residual(cells, weights, classes, roles, areas, states, stream, dissipation, threshold, out):
    """Add the fluxes through all faces to what flows out of the cells on their left, and into those on their right."""
    for f in range(len(cells)):
        s = (areas[f, 0], areas[f, 1], areas[f, 2])
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] == 0.0:
            continue
        near, role, w = cells[f], roles[f], weights[classes[f]]
        sigma = 0.0 * states[0, 4]
        if role == INNER and threshold > 0.0:
            sigma = shock_sensor(states, near, threshold)[0]
        mean, jump, _, _ = face_state(states, near, w, role, stream, dissipation, sigma)
        b, c = near[1], near[2]
        if role == SLIP:
            for n in range(3):
                out[b, 1 + n] += mean[4] * s[n]
            continue
        flux = face_flux(mean, jump, s, sigma)
        for n in range(5):
            out[b, n] += flux[n]
            if role == INNER:
                out[c, n] -= flux[n]
