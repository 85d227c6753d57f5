"""Parameters of the point of one volume closest to each of many points, from given starts.

Volumes with bilinear and constant knots are followed point by point in numba, on several threads. Knots that are a
user's Python functions can only be evaluated for many points at once: there all points take their steps together.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..numerics.threads import run_tasks
from ..splines.basis import bilinear_gradients
from ..splines.knots import BilinearKnots, ConstantKnots, Knots
from ..splines.volume import Volume, evaluate, evaluate_gradients, point_and_gradient
from .closest_point import advance, column_norm, is_collapsed, start

__all__ = ["descend"]

MAX_STEPS = 100
"""Steps from one start. Ten are ample towards a point inside; far outside a curved face convergence is linear."""

AGREEING_STARTS = 6
"""Starts that end at the same distance after which the remaining ones are not tried."""

N_TURNS = 16
"""Parameters tried along a collapsed direction."""

TURN = 1e-6
"""Cosine between the way to the point and the way off a face above which it is taken."""

SAME_PLACE = 1 + 1e-6
"""Ratio of distances up to which other parameters count as those of the same position."""

_POINTS_PER_TASK = 64


def descend(
    volume: Volume, net: np.ndarray, points: np.ndarray, starts: np.ndarray, target: float, n_threads: int
) -> tuple[np.ndarray, np.ndarray]:
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
    n_threads : int
        Number of threads.

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
        net = np.ascontiguousarray(net)

        def follow(number: int):
            task = slice(number * _POINTS_PER_TASK, (number + 1) * _POINTS_PER_TASK)
            _descend_each(corners, net, points[task], starts[task], target, parameters[task], distance[task])

        run_tasks(follow, -(-len(points) // _POINTS_PER_TASK), n_threads)
    return parameters, distance


def bilinear_corners(knots: Knots) -> np.ndarray | None:
    """Knots on the four edges, shape (2, 2, N + p), Eq. (5); None where they are a user's functions."""
    if isinstance(knots, BilinearKnots):
        return knots.corners
    if isinstance(knots, ConstantKnots):
        return np.ascontiguousarray(np.broadcast_to(knots.knots, (2, 2, knots.knots.size)))
    return None


@njit(cache=True, error_model="numpy")
def map_point_scratch(corners, control_points):
    """Scratch arrays of `map_point`."""
    n_knots = max(corners[0].shape[2], corners[1].shape[2], corners[2].shape[2])
    n_functions = corners[0].shape[2] + corners[1].shape[2] + corners[2].shape[2] - sum(control_points.shape[:3])
    return np.empty(n_knots), np.empty((n_knots, 3)), np.empty((n_functions, 4)), np.empty((n_functions, 3))


@njit(cache=True, error_model="numpy")
def map_point(corners, control_points, xi, scratch, position, jacobian):
    """Write one point of a volume with bilinear knots and its derivatives to ``position`` and ``jacobian``.

    Parameters
    ----------
    corners : tuple of three ndarrays, shape (2, 2, N_d + p_d)
        Knots of each direction, see `bilinear_corners`.
    control_points : ndarray, shape (N0, N1, N2, 3)
        Control points.
    xi : ndarray, shape (3,)
        Parameters.
    scratch : tuple
        From `map_point_scratch`.
    position, jacobian : ndarray, shapes (3,) and (3, 3)
        Overwritten; column d of the Jacobian belongs to parameter d. It is 0 in a degenerate direction, whose parameter
        is not free to change, even where the knots of others depend on it.
    """
    knots, d_T, gradients, sums = scratch
    n = control_points.shape
    p_0, p_1, p_2 = corners[0].shape[2] - n[0], corners[1].shape[2] - n[1], corners[2].shape[2] - n[2]
    rows_0, rows_1, rows_2 = gradients[:p_0], gradients[p_0 : p_0 + p_1], gradients[p_0 + p_1 :]
    i = bilinear_gradients(corners[0], p_0, 0, xi[0], xi[1], xi[2], knots, d_T, rows_0)
    j = bilinear_gradients(corners[1], p_1, 1, xi[1], xi[2], xi[0], knots, d_T, rows_1)
    k = bilinear_gradients(corners[2], p_2, 2, xi[2], xi[0], xi[1], knots, d_T, rows_2)
    first = i - p_0 + 1, j - p_1 + 1, k - p_2 + 1
    point_and_gradient(control_points, first, (p_0, p_1, p_2), gradients, sums, position, jacobian)
    for d in range(3):
        if n[d] == 1:
            jacobian[:, d] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _descend_each(corners, net, points, starts, target, parameters, distance):
    mapping = corners, net, map_point_scratch(corners, net)
    state = np.empty(3), np.empty((3, 3)), np.empty((8, 3)), np.empty(3)
    xi = np.empty(3)
    for q in range(len(points)):
        n_agreeing = 0
        for m in range(starts.shape[1]):
            xi[:] = starts[q, m]
            found = _descend_from(mapping, points[q], xi, target, state)
            n_agreeing = _count_agreeing(found, distance[q], n_agreeing)
            if found < distance[q]:
                distance[q] = found
                parameters[q] = xi
            if distance[q] <= target or n_agreeing == AGREEING_STARTS:
                break


@njit(cache=True)
def _count_agreeing(found, best, n_agreeing):
    """Count the starts so far that ended at the least distance."""
    if abs(found - best) <= 1e-6 * best:
        return n_agreeing + 1
    return 1 if found < best else n_agreeing


@njit(cache=True, error_model="numpy")
def _descend_from(mapping, point, xi, target, state):
    """Follow one point from one start, ``xi``, which is overwritten; return the distance reached."""
    corners, net, scratch = mapping
    residual, jacobian, kept, progress = state
    start(progress)
    for _ in range(MAX_STEPS):
        map_point(corners, net, xi, scratch, residual, jacobian)
        residual -= point
        if advance(xi, residual, jacobian, kept, progress, target):
            if progress[0] <= target or not _cross_over(mapping, point, xi, residual, jacobian, kept):
                break
            start(progress)
    xi[:] = kept[0]
    return progress[0]


@njit(cache=True, error_model="numpy")
def _cross_over(mapping, point, xi, residual, jacobian, kept):
    """Move ``xi`` to other parameters of the same position, if a way from there into the volume comes closer.

    The same position has other parameters where a volume closes on itself (the seam of an O-grid), and on a collapsed
    face: there the parameter along the collapsed direction, like the angle at a pole, does not move the position but
    turns the way off the face. A descent that has ended on the wrong side of the seam or the pole goes on over there.
    """
    corners, net, scratch = mapping
    nearby = SAME_PLACE * _length(kept[1])
    best, direction, there = TURN, -1, 0.0
    for d in range(3):
        is_turn = is_collapsed(kept[2:5], d)
        if net.shape[d] == 1 or not (is_turn or kept[0, d] == 0.0 or kept[0, d] == 1.0):
            continue
        xi[:] = kept[0]
        for m in range(N_TURNS if is_turn else 1):
            xi[d] = (m + 0.5) / N_TURNS if is_turn else 1.0 - kept[0, d]
            map_point(corners, net, xi, scratch, residual, jacobian)
            residual -= point
            inward = _inward_cosine(xi, residual, jacobian)
            if _length(residual) <= nearby and inward > best:
                best, direction, there = inward, d, xi[d]
    xi[:] = kept[0]
    if direction >= 0:
        xi[direction] = there
    return direction >= 0


@njit(cache=True)
def _length(vector):
    return np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)


@njit(cache=True)
def _inward_cosine(xi, residual, jacobian):
    """Largest cosine between the way to the point and the ways from the bounds into the volume."""
    best = 0.0
    length = _length(residual)
    for d in range(3):
        norm = column_norm(jacobian, d) * length
        if 0.0 < xi[d] < 1.0 or norm == 0.0 or is_collapsed(jacobian, d):
            continue
        slope = jacobian[0, d] * residual[0] + jacobian[1, d] * residual[1] + jacobian[2, d] * residual[2]
        best = max(best, -slope / norm if xi[d] <= 0.0 else slope / norm)
    return best


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
    n = len(points)
    xi, kept, progress = starts.copy(), np.empty((n, 8, 3)), np.empty((n, 3))
    _start_all(progress)
    is_free = np.array(volume.n_control) > 1
    todo = np.arange(n)
    for _ in range(MAX_STEPS):
        residual = evaluate(volume, net, xi[todo]) - points[todo]
        jacobian = evaluate_gradients(volume, net, xi[todo]) * is_free
        todo = todo[~_advance_all(todo, xi, residual, jacobian, kept, progress, target)]
        if not todo.size:
            break
    return kept[:, 0], progress[:, 0]


@njit(cache=True)
def _start_all(progress):
    for q in range(len(progress)):
        start(progress[q])


@njit(cache=True, error_model="numpy")
def _advance_all(ids, xi, residual, jacobian, kept, progress, target):
    """`advance` for the points ``ids``, whose residuals and Jacobians alone are given."""
    is_done = np.empty(len(ids), dtype=np.bool_)
    for q in range(len(ids)):
        i = ids[q]
        is_done[q] = advance(xi[i], residual[q], jacobian[q], kept[i], progress[i], target)
    return is_done
