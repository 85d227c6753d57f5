"""How the numbers of a run of cells lie in memory, and kernels that go through them edge by edge, corner by corner.

The numbers of up to `RUN` cells live in one flat array, the workspace, with rows of `RUN` numbers at fixed distances,
since that is what lets the compiler see that the rows do not overlap and take cells as vector lanes::

    edge m = 0..11: x, y, z, 1 / length, and three rows for the change of the edge or for its adjoint
    triple products of corners 0..7, Jacobians of corners 0..7, volume
    corners 0..7: x, y, z of the points, or of their changes or adjoints
"""

from __future__ import annotations

import numpy as np
from numba import njit

POINT = np.dtype([(name, np.float64) for name in "xyz"])
"""A point as a record, whose fixed stride lets loops over points vectorise."""

RUN = 32
"""Cells of a run: its numbers fit the first-level cache."""

EDGE = 7 * RUN
TRIPLE = 12 * EDGE
JACOBIAN = TRIPLE + 8 * RUN
VOLUME = JACOBIAN + 8 * RUN
POINTS = VOLUME + RUN
SIZE = POINTS + 24 * RUN


def as_points(nodes: np.ndarray) -> np.ndarray:
    """View coordinates ``(..., 3)`` as records of type `POINT`; copied where they are not contiguous.

    Parameters
    ----------
    nodes : ndarray, shape (..., 3)
        Coordinates (m).

    Returns
    -------
    ndarray of POINT, shape (...)
    """
    return np.ascontiguousarray(nodes, dtype=np.float64).view(POINT)[..., 0]


@njit(cache=True, inline="always")
def vector(work, at):
    """Three numbers, one from each of three rows."""
    return work[at], work[at + RUN], work[at + 2 * RUN]


@njit(cache=True, inline="always")
def set_vector(work, at, x, y, z):
    """Set three numbers, one in each of three rows."""
    work[at], work[at + RUN], work[at + 2 * RUN] = x, y, z


@njit(cache=True, inline="always")
def cross(u, v):
    """``u x v``."""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@njit(cache=True, inline="always")
def dot(u, v):
    """``u . v``."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def at_each_edge(task):
    """Kernel that runs a task for every edge, told where the edge and the corners at its ends are in the workspace.

    The places are constants, so that the compiler knows how far apart the rows are.
    """

    @njit(error_model="numpy", fastmath={"contract"})
    def run(work, n):
        task(work, 0, POINTS, POINTS + 3 * RUN, n)
        task(work, EDGE, POINTS + 6 * RUN, POINTS + 9 * RUN, n)
        task(work, 2 * EDGE, POINTS + 12 * RUN, POINTS + 15 * RUN, n)
        task(work, 3 * EDGE, POINTS + 18 * RUN, POINTS + 21 * RUN, n)
        task(work, 4 * EDGE, POINTS, POINTS + 6 * RUN, n)
        task(work, 5 * EDGE, POINTS + 3 * RUN, POINTS + 9 * RUN, n)
        task(work, 6 * EDGE, POINTS + 12 * RUN, POINTS + 18 * RUN, n)
        task(work, 7 * EDGE, POINTS + 15 * RUN, POINTS + 21 * RUN, n)
        task(work, 8 * EDGE, POINTS, POINTS + 12 * RUN, n)
        task(work, 9 * EDGE, POINTS + 3 * RUN, POINTS + 15 * RUN, n)
        task(work, 10 * EDGE, POINTS + 6 * RUN, POINTS + 18 * RUN, n)
        task(work, 11 * EDGE, POINTS + 9 * RUN, POINTS + 21 * RUN, n)

    return run


def at_each_corner(task):
    """Kernel that runs a task for every corner, told where its three edges are in the workspace."""

    @njit(error_model="numpy", fastmath={"contract"})
    def run(work, sign, n):
        task(work, 0, 4 * EDGE, 8 * EDGE, 0, sign, n)
        task(work, 0, 5 * EDGE, 9 * EDGE, 1, sign, n)
        task(work, EDGE, 4 * EDGE, 10 * EDGE, 2, sign, n)
        task(work, EDGE, 5 * EDGE, 11 * EDGE, 3, sign, n)
        task(work, 2 * EDGE, 6 * EDGE, 8 * EDGE, 4, sign, n)
        task(work, 2 * EDGE, 7 * EDGE, 9 * EDGE, 5, sign, n)
        task(work, 3 * EDGE, 6 * EDGE, 10 * EDGE, 6, sign, n)
        task(work, 3 * EDGE, 7 * EDGE, 11 * EDGE, 7, sign, n)

    return run
