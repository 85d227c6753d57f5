"""Derivatives of `vortex_state`.

Written by ``tools/differentiate.py``: change the kernel, then run that.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .gas import GAMMA
from .vortex_state import FULL_TURN


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"})
def vortex_state_jvp(stream, lift, circulation, offset, d_stream, d_lift, d_circulation):
    """Change of `vortex_state` with ``stream``, ``lift``, ``circulation``."""
    (rho, u, v, w, p) = stream
    (lift0, lift1, lift2) = lift
    (d_rho, d_u, d_v, d_w, d_p) = d_stream
    (d_lift0, d_lift1, d_lift2) = d_lift
    sound = GAMMA * p / rho
    d_sound = (GAMMA * d_p - sound * d_rho) / rho
    speed = u * u + v * v + w * w
    d_speed = 2.0 * u * d_u + 2.0 * v * d_v + 2.0 * w * d_w
    part = speed / sound
    d_part = (d_speed - part * d_sound) / sound
    beta_squared = 1.0 - part
    d_beta_squared = -d_part
    x = offset[0] * u + offset[1] * v + offset[2] * w
    d_x = offset[0] * d_u + offset[1] * d_v + offset[2] * d_w
    y = offset[0] * lift0 + offset[1] * lift1 + offset[2] * lift2
    d_y = offset[0] * d_lift0 + offset[1] * d_lift1 + offset[2] * d_lift2
    part_2 = np.sqrt(beta_squared)
    d_part_2 = 0.5 * d_beta_squared / part_2
    part_3 = x * x + beta_squared * y * y
    d_part_3 = 2.0 * x * d_x + y * (y * d_beta_squared + beta_squared * d_y) + beta_squared * y * d_y
    factor = circulation * part_2 / FULL_TURN / part_3
    d_factor = ((part_2 * d_circulation + circulation * d_part_2) / FULL_TURN - factor * d_part_3) / part_3
    u_there = u + factor * (y * u - x * lift0)
    d_u_there = d_u + (y * u - x * lift0) * d_factor + factor * (u * d_y + y * d_u - lift0 * d_x - x * d_lift0)
    v_there = v + factor * (y * v - x * lift1)
    d_v_there = d_v + (y * v - x * lift1) * d_factor + factor * (v * d_y + y * d_v - lift1 * d_x - x * d_lift1)
    w_there = w + factor * (y * w - x * lift2)
    d_w_there = d_w + (y * w - x * lift2) * d_factor + factor * (w * d_y + y * d_w - lift2 * d_x - x * d_lift2)
    rise = speed - (u_there * u_there + v_there * v_there + w_there * w_there)
    d_rise = d_speed - 2.0 * u_there * d_u_there - 2.0 * v_there * d_v_there - 2.0 * w_there * d_w_there
    part_4 = 0.5 * (GAMMA - 1.0) * rise / sound
    d_part_4 = (0.5 * (GAMMA - 1.0) * d_rise - part_4 * d_sound) / sound
    heat = 1.0 + part_4
    d_heat = d_part_4
    part_5 = heat ** (1.0 / (GAMMA - 1.0))
    d_part_5 = 1.0 / (GAMMA - 1.0) * part_5 * d_heat / heat
    part_6 = heat ** (GAMMA / (GAMMA - 1.0))
    d_part_6 = GAMMA / (GAMMA - 1.0) * part_6 * d_heat / heat
    d_density = part_5 * d_rho + rho * d_part_5
    d_pressure = part_6 * d_p + p * d_part_6
    return (d_density, d_u_there, d_v_there, d_w_there, d_pressure)
