"""The state of a free stream disturbed by a vortex, see `.far_field`.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .gas import GAMMA

__all__ = ["FULL_TURN", "vortex_state"]

FULL_TURN = 2.0 * np.pi


@njit(cache=True, error_model="numpy", forceinline=True)
def vortex_state(
    stream,  # subsonic
    lift,  # its velocity, rotated into the direction of the lift
    circulation,  # divided by its speed
    offset,  # from the vortex (m)
):
    """State with the velocity added by the vortex, and the entropy and total enthalpy of the stream."""
    rho, u, v, w, p = stream
    speed, sound = u * u + v * v + w * w, GAMMA * p / rho
    beta_squared = 1.0 - speed / sound
    x = offset[0] * u + offset[1] * v + offset[2] * w
    y = offset[0] * lift[0] + offset[1] * lift[1] + offset[2] * lift[2]
    factor = circulation * np.sqrt(beta_squared) / FULL_TURN / (x * x + beta_squared * y * y)
    u_there = u + factor * (y * u - x * lift[0])
    v_there = v + factor * (y * v - x * lift[1])
    w_there = w + factor * (y * w - x * lift[2])
    rise = speed - (u_there * u_there + v_there * v_there + w_there * w_there)
    heat = 1.0 + 0.5 * (GAMMA - 1.0) * rise / sound
    density, pressure = rho * heat ** (1.0 / (GAMMA - 1.0)), p * heat ** (GAMMA / (GAMMA - 1.0))
    return density, u_there, v_there, w_there, pressure
