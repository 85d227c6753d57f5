"""Where the Jacobian of a B-spline volume is positive, element by element: the regions between knots.

Each derivative of the map is a sum of differences of control points with positive factors, and where knots are curved
also with small ones of either sign. `_box_is_valid` bounds these factors on a box of parameters that encloses an
element, and so the cone that each derivative is in; three cones that are narrow enough prove the Jacobian positive.
Boxes that stay open are halved. Where no knot is curved, an element that stays open in one piece is a Bézier
hexahedron, see `bspline_mdao.cells.bezier`.

Theory: ``docs/theory/validity.rst``.

References
----------
W. Dinkelbach, On nonlinear fractional programming, *Management Science* 13, 1967, pp. 492-498.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..cells.bernstein import INVALID, UNDECIDED, UNIT, VALID
from ..cells.bezier import bezier_bound
from ..splines.basis import basis_derivatives, raise_order
from ..splines.volume import point_and_gradient

__all__ = ["decide_elements"]

MAX_DEPTH = 15
"""Halvings of a box of parameters, one after the other: five in each direction."""

MAX_BOXES = 400
"""Boxes of an element, before it is left undecided."""

CLEARLY = 1e-9
"""A Jacobian in a point counts where it is above this fraction of the product of the derivatives, not rounding."""


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _knot(c, i, s, t):
    """Knot ``i`` of Eq. (5) at (s, t)."""
    low, high = (1.0 - s) * c[0, 0, i] + s * c[1, 0, i], (1.0 - s) * c[0, 1, i] + s * c[1, 1, i]
    return (1.0 - t) * low + t * high


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _slope(c, i, along, at):
    """Derivative of knot ``i`` in s (``along`` 0) or t (1), at a value of the other."""
    if along == 0:
        return (1.0 - at) * (c[1, 0, i] - c[0, 0, i]) + at * (c[1, 1, i] - c[0, 1, i])
    return (1.0 - at) * (c[0, 1, i] - c[0, 0, i]) + at * (c[1, 1, i] - c[1, 0, i])


@njit(cache=True, nogil=True, error_model="numpy")
def _range(c, i, s, t):
    """Smallest and largest value of knot ``i`` on a rectangle: both are at its corners."""
    low, high = np.inf, -np.inf
    for a in range(2):
        for b in range(2):
            value = _knot(c, i, s[a], t[b])
            low, high = min(low, value), max(high, value)
    return low - 4.0 * UNIT, high + 4.0 * UNIT


@njit(cache=True, nogil=True, error_model="numpy")
def _enclose(knots, orders, spans, box):
    """Shrink a box of parameters to one that holds what it holds of an element; False where that is nothing."""
    for _ in range(3):
        for e in range(3):
            if orders[e] == 1:
                continue
            s, t = box[(e + 1) % 3], box[(e + 2) % 3]
            box[e, 0] = max(box[e, 0], _range(knots[e], spans[e], s, t)[0])
            box[e, 1] = min(box[e, 1], _range(knots[e], spans[e] + 1, s, t)[1])
            if not box[e, 0] < box[e, 1]:
                return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _weights(c, p, span, box, e, weights, slopes, cross):
    """Ranges of basis functions and of derivatives of their partial sums, on what a box has of an element.

    The triangle of `bspline_mdao.splines.basis` in intervals. A share is a fraction of linear functions in each
    parameter, so that its extremes are at corners of the box; inside the element it is between 0 and 1.

    Parameters
    ----------
    c : ndarray, shape (2, 2, N + p)
        Knots of direction ``e`` on its edges.
    p, span : int
        Order and span.
    box : ndarray, shape (3, 2)
        Parameters.
    e : int
        Direction.
    weights : ndarray, shape (p, 2)
        Receives the ranges of the functions.
    slopes : ndarray, shape (p - 1, 2)
        Receives those of the factors of differences of control points in the derivative in parameter ``e``.
    cross : ndarray, shape (2, p - 1, 2)
        Receives those in the other two parameters, ``e + 1`` and ``e + 2``, which the knots depend on.

    Returns
    -------
    bool
        False where knots may coincide.
    """
    f, g = (e + 1) % 3, (e + 2) % 3
    weights[0] = 1.0
    cross[:] = 0.0
    sums = np.zeros((2, p, 2))  # derivatives of the sums of the first functions
    for r in range(1, p):
        received_low, received_high = 0.0, 0.0
        before = np.zeros((2, 2))
        for m in range(r):
            low, high = span + 1 - r + m, span + 1 + m
            least, most, narrow, wide = np.inf, -np.inf, np.inf, 0.0
            for i in range(2):
                for j in range(2):
                    a, b = _knot(c, low, box[f, i], box[g, j]), _knot(c, high, box[f, i], box[g, j])
                    if not b - a > 64.0 * UNIT:
                        return False
                    narrow, wide = min(narrow, b - a), max(wide, b - a)
                    least = min(least, (box[e, 0] - a) / (b - a))
                    most = max(most, (box[e, 1] - a) / (b - a))
            loss = 16.0 * UNIT / narrow
            least, most = min(max(least - loss, 0.0), 1.0), max(min(most + loss, 1.0), 0.0)
            if r == p - 1:
                slopes[m, 0] = r * weights[m, 0] / wide * (1.0 - 2.0 * loss)
                slopes[m, 1] = r * weights[m, 1] / narrow * (1.0 + 2.0 * loss)
            for along in range(2):
                o = g if along == 0 else f
                a_0, a_1 = _slope(c, low, along, box[o, 0]), _slope(c, low, along, box[o, 1])
                b_0, b_1 = _slope(c, high, along, box[o, 0]), _slope(c, high, along, box[o, 1])
                bottom, top = min(a_0, a_1, b_0, b_1), max(a_0, a_1, b_0, b_1)  # a mean of both, by the share
                bottom, top = bottom - 8.0 * UNIT * (bottom != 0.0), top + 8.0 * UNIT * (top != 0.0)
                change_low, change_high = _divided(bottom, top, narrow * (1.0 - loss), wide * (1.0 + loss))
                # the sum of the first m + 1 functions: (1 - share) of it and share of the sum before it remain
                s_low, s_high = sums[along, m, 0], sums[along, m, 1]
                n_low, n_high = _multiplied(change_low, change_high, weights[m, 0], weights[m, 1])
                k_low, k_high = _multiplied(s_low, s_high, 1.0 - most, 1.0 - least)
                q_low, q_high = _multiplied(before[along, 0], before[along, 1], least, most)
                before[along, 0], before[along, 1] = s_low, s_high
                sums[along, m, 0] = _out(k_low + q_low + n_low, -1.0)
                sums[along, m, 1] = _out(k_high + q_high + n_high, 1.0)
            passed_low, passed_high = least * weights[m, 0], most * weights[m, 1]
            kept_low, kept_high = (1.0 - most) * weights[m, 0], (1.0 - least) * weights[m, 1]
            weights[m, 0] = (kept_low + received_low) * (1.0 - 8.0 * UNIT)
            weights[m, 1] = min((kept_high + received_high) * (1.0 + 8.0 * UNIT), 1.0)
            received_low, received_high = passed_low, passed_high
        weights[r, 0] = received_low * (1.0 - 8.0 * UNIT)
        weights[r, 1] = min(received_high * (1.0 + 8.0 * UNIT), 1.0)
    for along in range(2):
        for m in range(p - 1):  # control points change by minus the change of the sums, times their differences
            cross[along, m, 0], cross[along, m, 1] = -sums[along, m, 1], -sums[along, m, 0]
    return True


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _out(x, side):
    """Move an end of a range outwards by its rounding error; an exact zero stays."""
    return x + side * 8.0 * UNIT * abs(x)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _multiplied(a, b, c, d):
    """Range of the product of numbers from [a, b] and from [c, d]."""
    low, high = min(a * c, a * d, b * c, b * d), max(a * c, a * d, b * c, b * d)
    return low - 2.0 * UNIT * abs(low), high + 2.0 * UNIT * abs(high)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _divided(bottom, top, narrow, wide):
    """Range of the change of minus a share: numbers from [bottom, top] by positive ones from [narrow, wide].

    A share falls where its knots rise: the sum of the first functions, of which it takes a part away, rises.
    """
    low = bottom / wide if bottom > 0.0 else bottom / narrow
    high = top / narrow if top > 0.0 else top / wide
    return low - 4.0 * UNIT * abs(low), high + 4.0 * UNIT * abs(high)


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(net, orders, ranges, slopes, cross, column, frame, vectors, low, high, wrong):
    """Collect the differences of control points that make up a derivative, in the frame, with ranges of their factors.

    Returns
    -------
    n, n_main : int
        Number of vectors, and of those along the direction itself, which come first.
    """
    n, n_main = 0, 0
    for turn in range(3):
        e = (column + turn) % 3
        if orders[e] == 1:
            continue
        f, g = (e + 1) % 3, (e + 2) % 3
        for m in range(orders[e] - 1):
            if turn == 0:
                factor_low, factor_high = slopes[e, m, 0], slopes[e, m, 1]
            else:
                along = 0 if f == column else 1
                factor_low, factor_high = cross[e, along, m, 0], cross[e, along, m, 1]
                if factor_low == 0.0 and factor_high == 0.0:
                    continue
            for a in range(orders[f]):
                for b in range(orders[g]):
                    p_low, p_high = ranges[f, a, 0] * ranges[g, b, 0], ranges[f, a, 1] * ranges[g, b, 1]
                    low[n], high[n] = _multiplied(factor_low, factor_high, p_low, p_high)
                    at = (m, a, b) if e == 0 else (b, m, a) if e == 1 else (a, b, m)
                    to = (at[0] + (e == 0), at[1] + (e == 1), at[2] + (e == 2))
                    for o in range(3):
                        value, size = 0.0, 0.0
                        for c in range(3):
                            edge = net[to[0], to[1], to[2], c] - net[at[0], at[1], at[2], c]
                            value += frame[o, c] * edge
                            size += abs(frame[o, c] * edge)
                        vectors[n, o], wrong[n, o] = value, 8.0 * UNIT * size
                    n += 1
        if turn == 0:
            n_main = n
    return n, n_main


@njit(cache=True, nogil=True, error_model="numpy")
def _largest_ratio(vectors, low, high, wrong, n, n_main, own, other, side):
    """Upper bound of ``side`` times the component ``other`` of sums of vectors by their component ``own``; or infinity.

    The largest fraction of two sums with factors from given ranges, by Dinkelbach's iteration: with the factors that
    are best for one value of the fraction, the next follows. Where factors may all vanish, on an edge that has
    collapsed, the largest fraction of a single vector serves.
    """
    floor, loss_own, loss_other = 0.0, 0.0, 0.0
    for m in range(n):
        value = vectors[m, own]
        floor += low[m] * value if value > 0.0 else high[m] * value
        factor = max(abs(low[m]), abs(high[m]))
        loss_own += factor * wrong[m, own]
        loss_other += factor * wrong[m, other]
    floor = floor - loss_own - 1e-13 * abs(floor)
    if floor > 0.0:
        ratio = -np.inf
        trial = 0.0
        for _ in range(12):
            above, below = 0.0, 0.0
            for m in range(n):
                gain = side * vectors[m, other] - trial * vectors[m, own]
                factor = high[m] if gain > 0.0 else low[m]
                above += factor * side * vectors[m, other]
                below += factor * vectors[m, own]
            ratio = above / below
            if abs(ratio - trial) <= 1e-9 * (1.0 + abs(ratio)):
                break
            trial = ratio
        ratio += 1e-8 * (1.0 + abs(ratio))
        excess, size = 0.0, 0.0  # that it is a bound is checked, not taken from the iteration
        for m in range(n):
            gain = side * vectors[m, other] - ratio * vectors[m, own]
            excess += (high[m] if gain > 0.0 else low[m]) * gain
            size += max(abs(low[m]), abs(high[m])) * (abs(vectors[m, other]) + abs(ratio * vectors[m, own]))
        if excess + 256.0 * UNIT * size <= 0.0:
            return ratio + (loss_other + abs(ratio) * loss_own) / floor
    ratio = -np.inf
    if n > n_main:
        return np.inf
    for m in range(n):
        if high[m] == 0.0:
            continue
        value, top = vectors[m, own] - wrong[m, own], side * vectors[m, other] + wrong[m, other]
        if vectors[m, own] == 0.0 and vectors[m, other] == 0.0 and wrong[m, own] == 0.0:
            continue  # has collapsed
        if not value > 0.0:
            return np.inf
        ratio = max(ratio, top / value if top > 0.0 else top / (vectors[m, own] + wrong[m, own]))
    return ratio


@njit(cache=True, nogil=True, error_model="numpy")
def _is_positive(columns):
    """Whether a matrix with ones on its diagonal, and ranges [own, other] (3, 3, 2) of its columns, is positive.

    ``det = 1 - a_2 b_1 - a_3 c_1 - b_3 c_2 + a_2 b_3 c_1 + a_3 b_1 c_2`` with columns a, b, c.
    """
    a, b, c = columns[0], columns[1], columns[2]
    least, size = 1.0, 1.0
    for first, second in (((a, 1), (b, 0)), ((a, 2), (c, 0)), ((b, 2), (c, 1))):
        x, y = first[0][first[1]], second[0][second[1]]
        most = max(x[0] * y[0], x[0] * y[1], x[1] * y[0], x[1] * y[1])
        least -= most
        size += abs(most)
    for x, y, z in ((a[1], b[2], c[0]), (a[2], b[0], c[1])):
        lowest = np.inf
        for i in range(8):
            lowest = min(lowest, x[i & 1] * y[(i >> 1) & 1] * z[i >> 2])
        least += lowest
        size += abs(lowest)
    return least > 64.0 * UNIT * size


@njit(cache=True, nogil=True, error_model="numpy")
def _box_is_valid(knots, orders, spans, net, box, gradient, work):
    """Whether the Jacobian is proved positive on what a box has of an element, ``gradient`` being that of its middle.

    In the frame of the gradient in the middle the three derivatives are near the axes. Each is a sum of differences of
    control points with factors that are positive, but for small ones through the knots, and so in a narrow cone.
    """
    ranges, slopes, cross, vectors, low, high, wrong, columns, frame = work
    for e in range(3):
        if orders[e] == 1:
            ranges[e, 0] = 1.0
        elif not _weights(knots[e], orders[e], spans[e], box, e, ranges[e], slopes[e], cross[e]):
            return False
    g = gradient
    determinant = 0.0
    for o in range(3):  # rows of the inverse, but for the determinant: cross products of the columns
        p, q = (o + 1) % 3, (o + 2) % 3
        frame[o, 0] = g[1, p] * g[2, q] - g[2, p] * g[1, q]
        frame[o, 1] = g[2, p] * g[0, q] - g[0, p] * g[2, q]
        frame[o, 2] = g[0, p] * g[1, q] - g[1, p] * g[0, q]
    determinant = g[0, 0] * frame[0, 0] + g[1, 0] * frame[0, 1] + g[2, 0] * frame[0, 2]
    for o in range(3):
        for c in range(3):
            frame[o, c] /= determinant
    columns[:] = 0.0
    for v in range(3):
        if orders[v] == 1:
            n, n_main = 1, 1
            low[0], high[0] = 1.0, 1.0
            for o in range(3):
                vectors[0, o], wrong[0, o] = 0.0, 0.0
                for c in range(3):
                    vectors[0, o] += frame[o, c] * g[c, v]
                    wrong[0, o] += 8.0 * UNIT * abs(frame[o, c] * g[c, v])
        else:
            n, n_main = _gather(net, orders, ranges, slopes, cross, v, frame, vectors, low, high, wrong)
        for o in range(3):
            if o == v:
                continue
            columns[v, o, 1] = _largest_ratio(vectors, low, high, wrong, n, n_main, v, o, 1.0)
            columns[v, o, 0] = -_largest_ratio(vectors, low, high, wrong, n, n_main, v, o, -1.0)
            if not (np.isfinite(columns[v, o, 0]) and np.isfinite(columns[v, o, 1])):
                return False
    return _is_positive(columns)


@njit(cache=True, nogil=True, error_model="numpy")
def _jacobian(knots, orders, spans, net, sign, normal, x, work, is_inside):
    """Jacobian at parameters ``x`` of the polynomial pieces of an element; also whether ``x`` is inside the element."""
    gradients, sums, point, gradient, T, d_T = work
    row = 0
    for e in range(3):
        p, s, t = orders[e], x[(e + 1) % 3], x[(e + 2) % 3]
        if p == 1:
            gradients[row] = 0.0
            gradients[row, 0] = 1.0
        else:
            for i in range(2 * p - 2):
                at = spans[e] - p + 2 + i
                T[i] = _knot(knots[e], at, s, t)
                d_T[i, e] = 0.0
                d_T[i, (e + 1) % 3], d_T[i, (e + 2) % 3] = _slope(knots[e], at, 0, t), _slope(knots[e], at, 1, s)
            if not (T[p - 2] + 1e-13 < x[e] < T[p - 1] - 1e-13):
                is_inside = False
            d_x = (1.0 * (e == 0), 1.0 * (e == 1), 1.0 * (e == 2))
            basis_derivatives(T, d_T, p, p - 2, x[e], d_x, gradients[row : row + p])
        row += p
    point_and_gradient(net, (0, 0, 0), (orders[0], orders[1], orders[2]), gradients, sums, point, gradient)
    for v in range(3):
        if orders[v] == 1:
            gradient[0, v], gradient[1, v], gradient[2, v] = normal[0], normal[1], normal[2]
    g = gradient
    value = (
        g[0, 0] * (g[1, 1] * g[2, 2] - g[2, 1] * g[1, 2])
        - g[1, 0] * (g[0, 1] * g[2, 2] - g[2, 1] * g[0, 2])
        + g[2, 0] * (g[0, 1] * g[1, 2] - g[1, 1] * g[0, 2])
    )
    return sign * value, is_inside


@njit(cache=True, nogil=True, error_model="numpy")
def _element(knots, orders, spans, net, sign, normal, max_boxes):
    """Decide about one element by boxes of parameters; see `decide_elements`."""
    p_max = max(orders[0], orders[1], orders[2])
    n_local, n_vectors = max(2 * p_max - 2, 1), 3 * p_max * p_max * p_max
    n_rows = orders[0] + orders[1] + orders[2]
    scratch = (
        np.empty((n_rows, 4)), np.empty((n_rows, 3)), np.empty(3), np.empty((3, 3)), np.zeros(n_local),
        np.zeros((n_local, 3)),
    )  # fmt: skip
    gradient = scratch[3]
    work = (
        np.empty((3, p_max, 2)), np.empty((3, p_max, 2)), np.empty((3, 2, p_max, 2)), np.empty((n_vectors, 3)),
        np.empty(n_vectors), np.empty(n_vectors), np.empty((n_vectors, 3)), np.empty((3, 3, 2)), np.empty((3, 3)),
    )  # fmt: skip
    x, boxes, depths = np.zeros(3), np.empty((MAX_DEPTH + 1, 3, 2)), np.zeros(MAX_DEPTH + 1, dtype=np.int64)
    boxes[0, :, 0], boxes[0, :, 1] = 0.0, 1.0
    top, n_boxes, size = 0, 0, np.ones(3)
    while top >= 0:
        box, depth = boxes[top], depths[top]
        if not _enclose(knots, orders, spans, box):
            top -= 1
            continue
        if depth == 0:
            for d in range(3):
                size[d] = box[d, 1] - box[d, 0]
        n_boxes += 1
        for d in range(3):
            x[d] = 0.5 * (box[d, 0] + box[d, 1]) if orders[d] > 1 else 0.0
        middle, is_inside = _jacobian(knots, orders, spans, net, sign, normal, x, scratch, True)
        largest = 1.0
        for d in range(3):
            largest *= np.sqrt(gradient[0, d] ** 2 + gradient[1, d] ** 2 + gradient[2, d] ** 2)
        if is_inside and middle <= -CLEARLY * largest:
            return INVALID
        if middle > CLEARLY * largest and _box_is_valid(knots, orders, spans, net, box, gradient, work):
            top -= 1
            continue
        if depth == MAX_DEPTH or n_boxes >= max_boxes:
            return UNDECIDED
        direction, longest = 0, -1.0
        for d in range(3):
            if orders[d] > 1 and (box[d, 1] - box[d, 0]) / size[d] > longest:
                direction, longest = d, (box[d, 1] - box[d, 0]) / size[d]
        for d in range(3):  # compiled in a tenth of the time of an assignment of arrays
            boxes[top + 1, d, 0], boxes[top + 1, d, 1] = box[d, 0], box[d, 1]
        depths[top], depths[top + 1] = depth + 1, depth + 1
        cut = 0.5 * (box[direction, 0] + box[direction, 1])
        boxes[top, direction, 1], boxes[top + 1, direction, 0] = cut, cut
        top += 1
    return VALID


@njit(cache=True, nogil=True, error_model="numpy")
def _lengths(net):
    """Longest edges of a net in each direction, shape (3,), and how far a point is from the first, in the sum norm."""
    lengths, extent = np.zeros(3), 0.0
    for i, j, k in np.ndindex(net.shape[:3]):
        far = 0.0
        for c in range(3):
            far += abs(net[i, j, k, c] - net[0, 0, 0, c])
        extent = max(extent, far)
        for d in range(3):
            a, b, e = i - (d == 0), j - (d == 1), k - (d == 2)
            if a >= 0 and b >= 0 and e >= 0:
                size = 0.0
                for c in range(3):
                    size += abs(net[i, j, k, c] - net[a, b, e, c])
                lengths[d] = max(lengths[d], size)
    return lengths, extent


@njit(cache=True, nogil=True, error_model="numpy")
def _extraction(T, p, span, out):
    """Bézier control points of a span from those of the spline, shape (p, p): blossoms at the ends of the span."""
    for i in range(p):
        row = out[i]
        row[:] = 1.0
        for r in range(1, p):
            raise_order(T, span, r, T[span] if r <= p - 1 - i else T[span + 1], row)


@njit(cache=True, nogil=True, error_model="numpy")
def _straight_element(knots, orders, spans, net, sign, normal, shortest, binomial):
    """Decide about one element of a volume with constant knots."""
    old, extent = net.copy(), _lengths(net)[1]
    for e in range(3):
        p = orders[e]
        if p == 1:
            continue
        matrix = np.empty((p, p))
        _extraction(knots[e][0, 0], p, spans[e], matrix)
        new = np.zeros_like(old)
        for i, j, k in np.ndindex(old.shape[:3]):
            for m in range(p):
                at = (m, j, k) if e == 0 else (i, m, k) if e == 1 else (i, j, m)
                n = i if e == 0 else j if e == 1 else k
                for c in range(3):
                    new[at[0], at[1], at[2], c] += matrix[m, n] * old[i, j, k, c]
        old = new
    width = 1.0
    for e in range(3):
        for i in range(max(orders[e] - 1, 0)):
            low, high = spans[e] - i, spans[e] + 1 + i
            width = min(width, knots[e][0, 0, high] - knots[e][0, 0, low] if i == 0 else width)
    error = 60.0 * UNIT * extent / width
    return bezier_bound(old, sign, binomial, normal, shortest, (error, error, error), 12)


@njit(cache=True, nogil=True, error_model="numpy")
def decide_elements(knots, orders, is_straight, B, sign, normal, shortest, binomial, status):
    """Decide about all elements of a volume.

    Parameters
    ----------
    knots : tuple of three ndarray, each of shape (2, 2, N + p)
        Knots of every direction on its four edges, Eq. (5).
    orders : tuple of three int
        Orders; 1 with a single layer of control points.
    is_straight : bool
        Whether no knot is curved.
    B : ndarray, shape (N0, N1, N2, 3)
        Control points (m).
    sign : float
        Handedness.
    normal : ndarray, shape (3,)
        Derivative in a direction of order 1.
    shortest : float
        Differences of control points up to this length (m) have collapsed.
    binomial : ndarray
        See `bspline_mdao.cells.bezier.bezier_bound`.
    status : ndarray of uint8, shape (N0 - p0 + 1, N1 - p1 + 1, N2 - p2 + 1)
        Receives what is known of each element; one that lies between two equal knots has none and counts as valid.
    """
    p_0, p_1, p_2 = orders
    spans = np.empty(3, dtype=np.int64)
    for i, j, k in np.ndindex(status.shape):
        spans[0], spans[1], spans[2] = i + p_0 - 1, j + p_1 - 1, k + p_2 - 1
        net = B[i : i + p_0, j : j + p_1, k : k + p_2].copy()
        origin = net[0, 0, 0].copy()
        for a, b, c in np.ndindex((p_0, p_1, p_2)):
            for n in range(3):
                net[a, b, c, n] -= origin[n]
        is_empty = False
        if is_straight:
            for e in range(3):
                T = knots[e][0, 0]
                is_empty = is_empty or (orders[e] > 1 and not T[spans[e]] < T[spans[e] + 1])
        if is_empty:
            found = VALID
        else:
            found = _element(knots, orders, spans, net, sign, normal, 1 if is_straight else MAX_BOXES)
            if is_straight and found == UNDECIDED:
                found = _straight_element(knots, orders, spans, net, sign, normal, shortest, binomial)[0]
        status[i, j, k] = found
