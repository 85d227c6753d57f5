"""The perfect gas and its free stream.

States are primitive, ``(rho, u, v, w, p)``, relative to the density and the speed of sound of the free stream: in it
``rho = 1``, ``p = 1/GAMMA`` and the speed is the Mach number.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

import numpy as np

from ..loads.stream import stream_axes

GAMMA = 1.4
"""Ratio of the specific heats of air."""

N_STATES = 5
"""Numbers per cell."""


def free_stream(
    mach: float,  # mach number
    alpha: float,  # angle of attack (rad)
    axes: np.ndarray,  # (3, 3), rows are the directions downstream at zero angle, along the span, and up
) -> np.ndarray:  # (5,)
    """State of the free stream."""
    velocity = mach * stream_axes(alpha, axes)[0]
    return np.concatenate([[1.0], velocity, [1.0 / GAMMA]])


def free_stream_partials(mach: float, alpha: float, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Differentiate `free_stream` with respect to the Mach number and the angle (1/rad): two arrays of shape (5,)."""
    drag, lift = stream_axes(alpha, axes)
    return np.concatenate([[0.0], drag, [0.0]]), np.concatenate([[0.0], mach * lift, [0.0]])


def mach_numbers(states: np.ndarray) -> np.ndarray:
    """Local Mach numbers, shape (n,), of states, shape (n, 5)."""
    return np.sqrt(np.sum(states[:, 1:4] ** 2, axis=1) * states[:, 0] / (GAMMA * states[:, 4]))


def critical_pressure(
    mach: float,  # of the free stream
) -> float:
    """Pressure coefficient at which flow without losses is sonic: at lower pressures it is supersonic."""
    ratio = (2.0 + (GAMMA - 1.0) * mach**2) / (GAMMA + 1.0)
    return float(2.0 / (GAMMA * mach**2) * (ratio ** (GAMMA / (GAMMA - 1.0)) - 1.0))
