"""Parameters of the point of one volume closest to each of many points, from given starts.

Volumes with bilinear and constant knots are followed point by point in numba, in parallel over the points. Knots that
are a user's Python functions can only be evaluated for many points at once: there all points take their steps together.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from ..splines.volume import Volume, evaluate, evaluate_gradients
from .closest_point import DAMPING_MAX, DAMPING_START, STATIONARY, next_damping, trial_step
from .point_mapping import bilinear_corners, map_point, map_point_scratch

__all__ = ["descend"]

MAX_STEPS = 60
"""Steps from one start. Ten are ample towards a point inside; far outside a curved face convergence is linear."""

AGREEING_STARTS = 3
"""Starts that end at the same distance after which the remaining ones are not tried."""

_POINTS_PER_TASK = 64


def descend(volume: Volume, net: np.ndarray, points: np.ndarray, starts: np.ndarray, target: float):
    """Closest points of a volume, each the best that its starts lead to.

    Parameters
    ----------
    volume : Volume
        Orders and knots.
    net : ndarray, shape (N0, N1, N2, 3)
        Control points.
    points : ndarray, shape (n, 3)
        Points to look for.
    starts : ndarray, shape (n, m, 3)
        Parameters to start from, the most promising first. A start is tried only where the earlier ones have not come
        within ``target``.
    target : float
        Distance at which a point counts as found; a few units of round-off of the coordinates.

    Returns
    -------
    parameters : ndarray, shape (n, 3)
        In [0, 1].
    distance : ndarray, shape (n,)
        From each point to the volume at its parameters.
    """
    parameters, distance = starts[:, 0].copy(), np.full(len(points), np.inf)
    corners = tuple(bilinear_corners(knots) for knots in volume.knots)
    if any(c is None for c in corners):
        _descend_together(volume, net, points, starts, target, parameters, distance)
    else:
        _descend_each(corners, np.ascontiguousarray(net), points, starts, target, parameters, distance)
    return parameters, distance


@njit(cache=True, parallel=True, error_model="numpy")
def _descend_each(corners, net, points, starts, target, parameters, distance):
    n = len(points)
    for task in prange((n + _POINTS_PER_TASK - 1) // _POINTS_PER_TASK):
        scratch = map_point_scratch(corners, net)
        here, there = (np.empty(3), np.empty((3, 3))), (np.empty(3), np.empty((3, 3)))
        xi, trial = np.empty(3), np.empty(3)
        for q in range(task * _POINTS_PER_TASK, min((task + 1) * _POINTS_PER_TASK, n)):
            n_agreeing = 0
            for m in range(starts.shape[1]):
                xi[:] = starts[q, m]
                found = _descend_from(corners, net, points[q], xi, trial, target, scratch, here, there)
                n_agreeing = _count_agreeing(found, distance[q], n_agreeing)
                if found < distance[q]:
                    distance[q] = found
                    parameters[q] = xi
                if distance[q] <= target or n_agreeing == AGREEING_STARTS:
                    break


@njit(cache=True)
def _count_agreeing(found, best, n_agreeing):
    """Number of starts so far that ended at the least distance."""
    if abs(found - best) <= 1e-6 * best:
        return n_agreeing + 1
    return 1 if found < best else n_agreeing


@njit(cache=True, error_model="numpy")
def _descend_from(corners, net, point, xi, trial, target, scratch, here, there):
    """Follow one point from one start, ``xi``, which is overwritten; return the distance reached."""
    distance = _residual(corners, net, point, xi, scratch, here)
    damping = DAMPING_START
    for _ in range(MAX_STEPS):
        if distance <= target or damping > DAMPING_MAX:
            break
        if trial_step(xi, here[0], here[1], damping, trial) <= STATIONARY:
            break
        tried = _residual(corners, net, point, trial, scratch, there)
        is_closer = tried < distance
        damping = next_damping(damping, is_closer)
        if is_closer:
            xi[:] = trial
            distance = tried
            here, there = there, here
    return distance


@njit(cache=True, error_model="numpy")
def _residual(corners, net, point, xi, scratch, out):
    """Write the residual and the Jacobian at ``xi`` to ``out``; return the distance."""
    residual, jacobian = out
    map_point(corners, net, xi, scratch, residual, jacobian)
    squares = 0.0
    for x in range(3):
        residual[x] -= point[x]
        squares += residual[x] * residual[x]
    return np.sqrt(squares)


def _descend_together(volume, net, points, starts, target, parameters, distance):
    """`_descend_each` for any knots: one start after the other, all points at once."""
    n_agreeing = np.zeros(len(points), dtype=np.int64)
    todo = np.arange(len(points))
    for m in range(starts.shape[1]):
        xi, found = _descend_all_from(volume, net, points[todo], starts[todo, m], target)
        n_agreeing[todo] = _count_all_agreeing(found, distance[todo], n_agreeing[todo])
        is_better = found < distance[todo]
        parameters[todo[is_better]], distance[todo[is_better]] = xi[is_better], found[is_better]
        todo = todo[(distance[todo] > target) & (n_agreeing[todo] < AGREEING_STARTS)]


@njit(cache=True)
def _count_all_agreeing(found, best, n_agreeing):
    for q in range(len(found)):
        n_agreeing[q] = _count_agreeing(found[q], best[q], n_agreeing[q])
    return n_agreeing


def _descend_all_from(volume, net, points, starts, target):
    xi, damping = starts.copy(), np.full(len(points), DAMPING_START)
    residual, jacobian = _residuals(volume, net, points, xi)
    todo = np.arange(len(points))
    for _ in range(MAX_STEPS):
        trial, is_done = _trial_steps(xi[todo], residual[todo], jacobian[todo], damping[todo], target)
        todo, trial = todo[~is_done], trial[~is_done]
        if not todo.size:
            break
        there = _residuals(volume, net, points[todo], trial)
        is_closer = np.linalg.norm(there[0], axis=1) < np.linalg.norm(residual[todo], axis=1)
        damping[todo] = _next_dampings(damping[todo], is_closer)
        closer = todo[is_closer]
        xi[closer], residual[closer], jacobian[closer] = trial[is_closer], there[0][is_closer], there[1][is_closer]
    return xi, np.linalg.norm(residual, axis=1)


def _residuals(volume, net, points, xi):
    return evaluate(volume, net, xi) - points, evaluate_gradients(volume, net, xi)


@njit(cache=True, error_model="numpy")
def _trial_steps(xi, residual, jacobian, damping, target):
    """Steps of many points, and which of them are done."""
    trial, is_done = np.empty_like(xi), np.empty(len(xi), dtype=np.bool_)
    for q in range(len(xi)):
        cosine = trial_step(xi[q], residual[q], jacobian[q], damping[q], trial[q])
        distance = np.sqrt(residual[q, 0] ** 2 + residual[q, 1] ** 2 + residual[q, 2] ** 2)
        is_done[q] = distance <= target or cosine <= STATIONARY or damping[q] > DAMPING_MAX
    return trial, is_done


@njit(cache=True)
def _next_dampings(damping, is_closer):
    for q in range(len(damping)):
        damping[q] = next_damping(damping[q], is_closer[q])
    return damping
