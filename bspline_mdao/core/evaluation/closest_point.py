"""Parameters of the point of one volume closest to each of many points, from given starts.

The step is damped Newton in the unit cube: Levenberg (1944) and Marquardt (1963) for three unknowns with bounds. The
columns of the Jacobian are scaled to unit length first, so a step does not depend on the aspect ratio of the cell.
Damping keeps it finite where columns vanish or become parallel (collapsed faces, singular lines). Parameters at an
active bound are not moved.

Steps that do not come closer are followed for a while before the descent returns to the closest parameters so far and
increases the damping: near a singular line Newton's path to the point leads over larger distances (Grippo, Lampariello
and Lucidi 1986, a nonmonotone search).

At a point outside, the residual does not vanish and the curvature of the mapping matters. Its part of the Hessian is
estimated from the steps by the structured secant update of Dennis, Gay and Welsch (1981), and used while steps reduce
the distance by less than half. Without it, convergence there is linear, and slow beyond the radius of curvature.

Volumes with bilinear and constant knots are followed point by point in numba, on several threads. Knots that are a
user's Python functions can only be evaluated efficiently for many points at once, so there all points step together.
Theory: ``docs/theory/inversion.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...base.numerics.rows import copy_row, subtract_row
from ...base.numerics.threads import run_tasks
from ..splines.basis import bilinear_gradients
from ..splines.knots import BilinearKnots, ConstantKnots, Knots
from ..splines.volume import Volume, evaluate, evaluate_gradients, point_and_gradient

MAX_STEPS = 100
"""Most steps from one start. Ten are ample for a point inside; far outside a curved face convergence is linear."""

AGREEING_STARTS = 6
"""Number of starts ending at the same distance after which the remaining ones are skipped."""

N_TURNS = 16
"""Parameters tried along a collapsed direction."""

TURN = 1e-6
"""Cosine between the direction to the point and a direction off a face above which the latter is taken."""

SAME_PLACE = 1 + 1e-6
"""Ratio of distances up to which other parameters count as the same position."""

_POINTS_PER_TASK = 64

DAMPING_START = 1e-10
"""Damping of the first step, relative to the unit diagonal of the scaled normal matrix: almost none."""

DAMPING_MIN = 1e-14
"""Least damping, with which the normal matrix of a rank-deficient Jacobian can still be factored."""

DAMPING_RESTART = 1e-3
"""Damping after the first step that does not come closer; each further one multiplies it by ten."""

DAMPING_MAX = 1e12
"""Damping at which steps are below round-off."""

PATIENCE = 4
"""Steps in a row that need not come closer, until one has halved the distance."""

STATIONARY = 1e-9
"""Cosine of the angle between the residual and every free column below which the point is the closest one."""

DEFINITE = 1e-3
"""Least pivot of the scaled Hessian with curvature; below it the step is taken without curvature."""

COLLAPSED = 1e-12
"""Norm of a column, relative to the longest one, below which the position does not depend on its parameter."""


def descend(
    volume: Volume,  # orders and knots
    net: np.ndarray,  # (N0, N1, N2, 3), control points
    points: np.ndarray,  # (n, 3), points to find
    # starting parameters, the most promising first. A start is tried only if the earlier ones have not come within
    # ``target``
    starts: np.ndarray,  # (n, m, 3)
    target: float,  # distance at which a point counts as found; a few units of round-off of the coordinates
    n_threads: int,  # number of threads
) -> tuple[np.ndarray, np.ndarray]:
    """Closest points of a volume, each the best of its starts."""
    # returns parameters (n, 3): in [0, 1]
    # returns distance (n,): from each point to the volume at its parameters
    parameters, distance = starts[:, 0].copy(), np.full(len(points), np.inf)
    corners = tuple(bilinear_corners(knots) for knots in volume.knots)
    if any(c is None for c in corners):
        _descend_simultaneously(volume, net, points, starts, target, parameters, distance)
    else:
        net = np.ascontiguousarray(net)

        def follow(first: int) -> None:
            task = slice(first, first + _POINTS_PER_TASK)
            _descend_each(corners, net, points[task], starts[task], target, parameters[task], distance[task])

        run_tasks(follow, range(0, len(points), _POINTS_PER_TASK), n_threads)
    return parameters, distance


def bilinear_corners(knots: Knots) -> np.ndarray | None:
    """Knots on the four edges, shape (2, 2, N + p), Eq. (5); None if they are a user's functions."""
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
def map_point(
    corners,  # tuple of three ndarrays (2, 2, N_d + p_d), knots of each direction, see `bilinear_corners`
    control_points,  # (N0, N1, N2, 3)
    xi,  # (3,), parameters
    scratch,  # tuple, from `map_point_scratch`
    # overwritten; column d of the Jacobian belongs to parameter d. It is 0 in a degenerate direction, whose parameter
    # is not free to change, even if other directions' knots depend on it
    position,  # (3,)
    jacobian,  # (3, 3)
):
    """Write one point of a volume with bilinear knots and its derivatives to ``position`` and ``jacobian``."""
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
            copy_row(starts[q, m], xi)
            found = _descend_from(mapping, points[q], xi, target, state)
            n_agreeing = _count_agreeing(found, distance[q], n_agreeing)
            if found < distance[q]:
                distance[q] = found
                copy_row(xi, parameters[q])
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
        subtract_row(point, residual)
        if advance(xi, residual, jacobian, kept, progress, target):
            if progress[0] <= target or not _cross_over(mapping, point, xi, residual, jacobian, kept):
                break
            start(progress)
    copy_row(kept[0], xi)
    return progress[0]


@njit(cache=True, error_model="numpy")
def _cross_over(mapping, point, xi, residual, jacobian, kept):
    """Move ``xi`` to other parameters of the same position if a direction from there into the volume comes closer."""
    # The same position has other parameters where a volume closes on itself (the seam of an O-grid), and on a collapsed
    # face. There the parameter along the collapsed direction, like the angle at a pole, does not move the position but
    # turns the direction off the face. A descent that ended on the wrong side of the seam or pole continues from there.
    corners, net, scratch = mapping
    nearby = SAME_PLACE * _length(kept[1])
    best, direction, there = TURN, -1, 0.0
    for d in range(3):
        is_turn = is_collapsed(kept[2:5], d)
        if net.shape[d] == 1 or not (is_turn or kept[0, d] == 0.0 or kept[0, d] == 1.0):
            continue
        copy_row(kept[0], xi)
        for m in range(N_TURNS if is_turn else 1):
            xi[d] = (m + 0.5) / N_TURNS if is_turn else 1.0 - kept[0, d]
            map_point(corners, net, xi, scratch, residual, jacobian)
            subtract_row(point, residual)
            inward = _inward_cosine(xi, residual, jacobian)
            if _length(residual) <= nearby and inward > best:
                best, direction, there = inward, d, xi[d]
    copy_row(kept[0], xi)
    if direction >= 0:
        xi[direction] = there
    return direction >= 0


@njit(cache=True)
def _length(vector):
    return np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)


@njit(cache=True)
def _inward_cosine(xi, residual, jacobian):
    """Largest cosine between the direction to the point and the directions from the bounds into the volume."""
    best = 0.0
    length = _length(residual)
    for d in range(3):
        norm = column_norm(jacobian, d) * length
        if 0.0 < xi[d] < 1.0 or norm == 0.0 or is_collapsed(jacobian, d):
            continue
        slope = jacobian[0, d] * residual[0] + jacobian[1, d] * residual[1] + jacobian[2, d] * residual[2]
        best = max(best, -slope / norm if xi[d] <= 0.0 else slope / norm)
    return best


def _descend_simultaneously(
    volume: Volume,
    net: np.ndarray,
    points: np.ndarray,
    starts: np.ndarray,
    target: float,
    parameters: np.ndarray,
    distance: np.ndarray,
) -> None:
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


def _descend_all_from(
    volume: Volume, net: np.ndarray, points: np.ndarray, starts: np.ndarray, target: float
) -> tuple[np.ndarray, np.ndarray]:
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
    """`advance` for the points ``ids``; residuals and Jacobians are given only for these."""
    is_done = np.empty(len(ids), dtype=np.bool_)
    for q in range(len(ids)):
        i = ids[q]
        is_done[q] = advance(xi[i], residual[q], jacobian[q], kept[i], progress[i], target)
    return is_done


@njit(cache=True)
def start(progress):
    """Initialise the progress of a descent, see `advance`."""
    progress[0], progress[1], progress[2] = np.inf, DAMPING_START, 0.0


@njit(cache=True, error_model="numpy")
def advance(
    xi,  # (3,), parameters reached; overwritten with the next ones to evaluate, at the end with the closest ones
    # ``mapping(xi) - point`` and its derivatives in the parameters (columns)
    residual,  # (3,)
    jacobian,  # (3, 3)
    # scratch of the descent: parameters, residual and Jacobian at the closest point so far, and the curvature there
    kept,  # (8, 3)
    progress,  # (3,), least distance so far, damping, and steps without success
    target,  # distance that is close enough
):  # bool, whether the descent has ended
    """Judge the parameters that a descent has reached, and step on from there or from the closest ones."""
    # 1. Keep the parameters if they are the closest so far, with less damping; else count the step and damp more.
    # 2. After too many steps without success, return to the closest ones.
    # 3. Take a damped Newton step in the parameters that are not at an active bound.
    # 4. End where the distance is small enough, steps are below round-off, or the residual is normal to the volume.
    _judge(xi, residual, jacobian, kept, progress)  # step 1
    is_back = progress[2] > PATIENCE  # step 2
    is_at_best = is_back or progress[2] == 0.0
    if is_back:
        copy_row(kept[0], xi)
        copy_row(kept[1], residual)
        for x in range(3):
            copy_row(kept[2 + x], jacobian[x])
    cosine = _trial_step(xi, residual, jacobian, kept[5:], progress[1])  # step 3
    is_small = progress[0] <= target  # step 4
    is_done = is_small or progress[1] > DAMPING_MAX or (is_at_best and cosine <= STATIONARY)
    if is_done:
        copy_row(kept[0], xi)
    return is_done


@njit(cache=True)
def _judge(xi, residual, jacobian, kept, progress):
    """Keep the closest parameters; count the steps that do not come closer, and damp after too many."""
    distance = np.sqrt(residual[0] ** 2 + residual[1] ** 2 + residual[2] ** 2)
    if distance < progress[0]:
        if distance < 0.5 * progress[0] or progress[2] <= PATIENCE:
            progress[2] = 0.0
        if distance > 0.5 * progress[0]:
            _update_curvature(xi, residual, jacobian, kept)
        else:
            kept[5:] = 0.0
        progress[0], progress[1] = distance, max(0.05 * progress[1], DAMPING_MIN)
        copy_row(xi, kept[0])
        copy_row(residual, kept[1])
        for x in range(3):
            copy_row(jacobian[x], kept[2 + x])
        return
    progress[2] += 1.0
    if progress[2] > PATIENCE:
        progress[1] = max(10.0 * progress[1], DAMPING_RESTART)


@njit(cache=True, error_model="numpy")
def _update_curvature(xi, residual, jacobian, kept):
    """Update the estimate of ``sum_x residual_x Hessian_x`` by the step from the kept parameters to ``xi``."""
    step = xi.copy()
    subtract_row(kept[0], step)
    change = np.empty(3)  # change in the gradient of half the squared distance
    excess = np.empty(3)  # the part of it due to curvature
    for d in range(3):
        gradient, moved = 0.0, 0.0
        for x in range(3):
            gradient += jacobian[x, d] * residual[x]
            moved += kept[2 + x, d] * residual[x]
        change[d], excess[d] = gradient, gradient - moved
        for x in range(3):
            change[d] -= kept[2 + x, d] * kept[1, x]
    _secant_update(kept[5:], step, change, excess)


@njit(cache=True, error_model="numpy")
def _secant_update(curvature, step, change, excess):
    """Update the matrix, after sizing, so that it maps ``step`` to ``excess`` (Dennis, Gay and Welsch, section 4)."""
    slope, sized, wanted = 0.0, 0.0, 0.0
    for d in range(3):
        slope += change[d] * step[d]
        wanted += excess[d] * step[d]
        for e in range(3):
            sized += step[d] * curvature[d, e] * step[e]
    if slope <= 0.0:
        return
    if sized != 0.0:
        curvature *= min(1.0, abs(wanted / sized))
    missing = excess.copy()
    for d in range(3):
        for e in range(3):
            missing[d] -= curvature[d, e] * step[e]
    along = (missing[0] * step[0] + missing[1] * step[1] + missing[2] * step[2]) / slope
    for d in range(3):
        for e in range(3):
            curvature[d, e] += (missing[d] * change[e] + change[d] * missing[e] - along * change[d] * change[e]) / slope


@njit(cache=True, error_model="numpy")
def _trial_step(xi, residual, jacobian, curvature, damping):
    """Move ``xi`` by one step; return the largest cosine between residual and free columns, 0 at the closest point."""
    norms, slopes = _free_columns(xi, residual, jacobian)
    step, is_definite = _solve(_scaled_products(jacobian, curvature, norms), slopes, damping)
    if not is_definite:
        step, _ = _solve(_scaled_products(jacobian, 0.0 * curvature, norms), slopes, damping)
    for d in range(3):
        if norms[d] > 0.0:
            xi[d] = min(max(xi[d] + step[d] / norms[d], 0.0), 1.0)
    length = np.sqrt(residual[0] ** 2 + residual[1] ** 2 + residual[2] ** 2)
    return max(abs(slopes[0]), abs(slopes[1]), abs(slopes[2])) / max(length, 1e-300)


@njit(cache=True, inline="always")
def _column_product(jacobian, d, e):
    return jacobian[0, d] * jacobian[0, e] + jacobian[1, d] * jacobian[1, e] + jacobian[2, d] * jacobian[2, e]


@njit(cache=True)
def column_norm(jacobian, d):
    """Length of column ``d``."""
    return np.sqrt(_column_product(jacobian, d, d))


@njit(cache=True)
def is_collapsed(jacobian, d):
    """Whether the position does not depend on parameter ``d``, as on a collapsed face, up to round-off."""
    longest = max(column_norm(jacobian, 0), column_norm(jacobian, 1), column_norm(jacobian, 2))
    return column_norm(jacobian, d) <= COLLAPSED * longest


@njit(cache=True)
def _free_column(xi, residual, jacobian, d):
    """Norm of a column and slope of the distance along it; both 0 if it vanishes or a bound is active."""
    slope = jacobian[0, d] * residual[0] + jacobian[1, d] * residual[1] + jacobian[2, d] * residual[2]
    if is_collapsed(jacobian, d) or (xi[d] <= 0.0 and slope >= 0.0) or (xi[d] >= 1.0 and slope <= 0.0):
        return 0.0, 0.0
    norm = column_norm(jacobian, d)
    return norm, slope / norm


@njit(cache=True)
def _free_columns(xi, residual, jacobian):
    n0, s0 = _free_column(xi, residual, jacobian, 0)
    n1, s1 = _free_column(xi, residual, jacobian, 1)
    n2, s2 = _free_column(xi, residual, jacobian, 2)
    return (n0, n1, n2), (s0, s1, s2)


@njit(cache=True)
def _scaled_product(jacobian, curvature, norms, d, e):
    """Entry of the Hessian in scaled parameters; of the unit matrix for a parameter that is not moved."""
    if norms[d] == 0.0 or norms[e] == 0.0:
        return 1.0 if d == e else 0.0
    return (_column_product(jacobian, d, e) + curvature[d, e]) / (norms[d] * norms[e])


@njit(cache=True)
def _scaled_products(jacobian, curvature, norms):
    """Entries (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2) of the Hessian in scaled parameters."""
    return (
        _scaled_product(jacobian, curvature, norms, 0, 0),
        _scaled_product(jacobian, curvature, norms, 1, 1),
        _scaled_product(jacobian, curvature, norms, 2, 2),
        _scaled_product(jacobian, curvature, norms, 0, 1),
        _scaled_product(jacobian, curvature, norms, 0, 2),
        _scaled_product(jacobian, curvature, norms, 1, 2),
    )


@njit(cache=True, error_model="numpy")
def _solve(products, slopes, damping):
    """Solve ``(H + damping I) step = -slopes`` by L D L^T; return whether its pivots are safely positive."""
    h00, h11, h22, h01, h02, h12 = products
    d0 = h00 + damping
    l10, l20 = h01 / d0, h02 / d0
    d1 = max(h11 + damping - h01 * l10, damping)
    l21 = (h12 - h02 * l10) / d1
    d2 = max(h22 + damping - h02 * l20 - d1 * l21 * l21, damping)
    y0 = -slopes[0]
    y1 = -slopes[1] - l10 * y0
    y2 = -slopes[2] - l20 * y0 - l21 * y1
    step2 = y2 / d2
    step1 = y1 / d1 - l21 * step2
    step0 = y0 / d0 - l10 * step1 - l20 * step2
    return (step0, step1, step2), min(d0, d1, d2) > DEFINITE
