"""Ranges of knots, and of the Bézier control points of B-splines, on boxes inside the elements of a volume.

In an element, the region between neighbouring knots, each parameter is ``xi = (1 - u) T_s + u T_{s+1}`` with its
*fraction* ``u`` of the span, between 0 and 1. A box is a range of fractions in each direction. On a box the map is a
Bézier hexahedron whose control points depend only on the knots: they are blossoms at the ends of the box, by the de
Boor triangle. Its ratios of knot intervals are quotients of functions linear in each parameter, with extremes at the
corners of the box's parameters. If knots are curved, these parameters lie in ranges, which `enclose` finds, and so do
the control points.

Many boxes are treated at a time, one in each *lane*: the last index of all arrays. Inner loops run over lanes, so the
compiler vectorises them. Ranges are [low, high].

Theory: ``docs/theory/validity.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...grids.cells.bernstein import UNIT

__all__ = [
    "determinant", "enclose", "extraction", "knots_at_corners", "parameter_slopes", "plane_slope", "product_range",
    "span_width",
]  # fmt: skip

NARROWEST = 64.0 * UNIT
"""Knots up to this far apart may coincide."""


@njit(cache=True, nogil=True, error_model="numpy")
def enclose(
    knots,  # (3, 2, 2, n_local, L), local knots of every direction on its four edges, see `extraction`
    orders,  # tuple of three int
    fractions,  # (3, 2, L), boxes
    box,  # (3, 2, L), ranges of parameters that contain the parameters of the boxes; shrunk in place
    is_there,  # bool (L,), set to False if nothing of an element remains
):
    """Shrink ranges of parameters to what boxes of fractions can have."""
    for _ in range(3):
        for e in range(3):
            p, f, g = orders[e], (e + 1) % 3, (e + 2) % 3
            if p == 1:
                continue
            for l in range(box.shape[2]):
                low, high = np.inf, -np.inf
                for a in range(2):
                    for b in range(2):
                        s, t = box[f, a, l], box[g, b, l]
                        first = _blend(knots[e, 0, 0, p - 2, l], knots[e, 1, 0, p - 2, l], knots[e, 0, 1, p - 2, l],
                                       knots[e, 1, 1, p - 2, l], s, t)  # fmt: skip
                        last = _blend(knots[e, 0, 0, p - 1, l], knots[e, 1, 0, p - 1, l], knots[e, 0, 1, p - 1, l],
                                      knots[e, 1, 1, p - 1, l], s, t)  # fmt: skip
                        low = min(low, (1.0 - fractions[e, 0, l]) * first + fractions[e, 0, l] * last)
                        high = max(high, (1.0 - fractions[e, 1, l]) * first + fractions[e, 1, l] * last)
                box[e, 0, l] = max(box[e, 0, l], low - 8.0 * UNIT)
                box[e, 1, l] = min(box[e, 1, l], high + 8.0 * UNIT)
                is_there[l] = is_there[l] and box[e, 0, l] <= box[e, 1, l]


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy", forceinline=True)
def _blend(k_00, k_10, k_01, k_11, s, t):
    """Knot of Eq. (5) at (s, t)."""
    return (1.0 - t) * ((1.0 - s) * k_00 + s * k_10) + t * ((1.0 - s) * k_01 + s * k_11)


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def knots_at_corners(
    # see `enclose`
    knots,
    # direction, and number of local knots
    e,  # int
    n,  # int
    n_corners,  # int, 4, or 1 if the knots are constant
    box,
    # see `extraction`
    pole,
    at_pole,
    at_corners,  # (4, n_local, L), receives the knots
    # receives the derivatives in the first and the second of the other parameters, at both ends of the other. The
    # derivatives about a pole are taken on its opposite face
    slopes,  # (2, 2, n_local, L)
):
    """Knots of direction ``e`` at the corners of ranges of parameters, and their derivatives at the ends."""
    f, g = (e + 1) % 3, (e + 2) % 3
    is_f, is_g, opposite = e == 3 - pole[0] - pole[1] and pole[0] == f, e == 3 - pole[0] - pole[1] and pole[0] == g, 1.0
    opposite -= pole[2]
    for i in range(n):
        for l in range(box.shape[2]):
            k_00, k_10, k_01, k_11 = (
                knots[e, 0, 0, i, l],
                knots[e, 1, 0, i, l],
                knots[e, 0, 1, i, l],
                knots[e, 1, 1, i, l],
            )
            if n_corners == 1:
                at_corners[0, i, l] = k_00
                continue
            for a in range(2):
                s, t = box[f, a, l], box[g, a, l]
                s_x = opposite if is_g and at_pole[l] else s
                t_x = opposite if is_f and at_pole[l] else t
                slopes[0, a, i, l] = (1.0 - t_x) * (k_10 - k_00) + t_x * (k_11 - k_01)
                slopes[1, a, i, l] = (1.0 - s_x) * (k_01 - k_00) + s_x * (k_11 - k_10)
                for b in range(2):
                    at_corners[2 * a + b, i, l] = _blend(k_00, k_10, k_01, k_11, s, box[g, b, l])


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy", forceinline=True)
def product_range(a, b, c, d):
    """Range of the product of numbers from [a, b] and from [c, d]."""
    w, x, y, z = a * c, a * d, b * c, b * d
    return min(min(w, x), min(y, z)), max(max(w, x), max(y, z))


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy", forceinline=True)
def plane_slope(knots, e, i, j, q, x, l):
    """Derivative of local knot ``q`` of direction ``e`` towards edge ``(i, j)``, the other parameter being ``x``."""
    near, far = knots[e, i, j, q, l] - knots[e, 0, 0, q, l], knots[e, 1, 1, q, l] - knots[e, j, i, q, l]
    return (1.0 - x) * near + x * far


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def span_width(knots, orders, v, box, l):
    """Range of the width of the span of direction ``v`` on a box."""
    narrow, wide, q, f, g = np.inf, 0.0, max(orders[v] - 2, 0), (v + 1) % 3, (v + 2) % 3
    for a in range(2):
        for b in range(2):
            s, t = box[f, a, l], box[g, b, l]
            first = _blend(knots[v, 0, 0, q, l], knots[v, 1, 0, q, l], knots[v, 0, 1, q, l],
                           knots[v, 1, 1, q, l], s, t)  # fmt: skip
            last = _blend(knots[v, 0, 0, q + 1, l], knots[v, 1, 0, q + 1, l], knots[v, 0, 1, q + 1, l],
                          knots[v, 1, 1, q + 1, l], s, t)  # fmt: skip
            narrow, wide = min(narrow, last - first), max(wide, last - first)
    return narrow - 16.0 * UNIT, wide + 16.0 * UNIT


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def determinant(K, l):
    """Range of the determinant of ``1 - K``."""
    least, most = 1.0, 1.0
    for e in range(3):
        f = (e + 1) % 3
        low, high = product_range(K[e, f, 0, l], K[e, f, 1, l], K[f, e, 0, l], K[f, e, 1, l])
        least, most = least - high, most - low
    for turn in range(1, 3):
        low, high = product_range(K[0, turn, 0, l], K[0, turn, 1, l], K[turn, 3 - turn, 0, l], K[turn, 3 - turn, 1, l])
        low, high = product_range(low, high, K[3 - turn, 0, 0, l], K[3 - turn, 0, 1, l])
        least, most = least - high, most - low
    return least, most


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _slopes_of_planes(knots, orders, varies, fractions, box, out):
    """Ranges of the derivatives of the parameter ``e`` in the parameter ``v`` at a fixed fraction, (3, 3, 2, L)."""
    for e in range(3):
        for turn in range(1, 3):
            v, o, q = (e + turn) % 3, (e + 3 - turn) % 3, orders[e] - 2
            if not (varies[e, v] and orders[v] > 1):
                out[e, v] = 0.0
                continue
            i, j = (1, 0) if turn == 1 else (0, 1)  # the edge beyond the first, along `v`
            for l in range(box.shape[2]):
                low, high = np.inf, -np.inf
                for a in range(2):
                    first = plane_slope(knots, e, i, j, q, box[o, a, l], l)
                    last = plane_slope(knots, e, i, j, q + 1, box[o, a, l], l)
                    for b in range(2):
                        slope = (1.0 - fractions[e, b, l]) * first + fractions[e, b, l] * last
                        low, high = min(low, slope), max(high, slope)
                out[e, v, 0, l], out[e, v, 1, l] = low - 16.0 * UNIT, high + 16.0 * UNIT


@njit(cache=True, nogil=True, error_model="numpy")
def parameter_slopes(
    # see `enclose`
    knots,
    orders,
    varies,  # bool (3, 3), whether knots of the first direction vary with the second's parameter
    fractions,
    box,
    work,  # (3, 3, 2, L), receives the ranges of ``K``
    out,  # (3, 3, 2, L), receives centres and radii: parameter of the first index, fraction of the second
    is_there,  # bool (L,), set to False if the matrix may be singular
):
    """Ranges of the derivatives of the parameters in the fractions, as centres and radii."""
    # With the derivatives ``K`` of the parameters at fixed fractions they are ``(1 - K)^{-1}`` times span widths.
    K = work
    _slopes_of_planes(knots, orders, varies, fractions, box, K)
    for l in range(box.shape[2]):
        least, most = determinant(K, l)
        is_there[l] = is_there[l] and least > 1e-6
        for v in range(3):
            f, g = (v + 1) % 3, (v + 2) % 3
            narrow, wide = span_width(knots, orders, v, box, l)
            for e in range(3):
                o = 3 - e - v
                if e == v:
                    low, high = product_range(K[f, g, 0, l], K[f, g, 1, l], K[g, f, 0, l], K[g, f, 1, l])
                    low, high = 1.0 - high, 1.0 - low
                else:
                    low, high = product_range(K[e, o, 0, l], K[e, o, 1, l], K[o, v, 0, l], K[o, v, 1, l])
                    low, high = low + K[e, v, 0, l], high + K[e, v, 1, l]
                low, high = product_range(low, high, narrow / most, wide / least)
                out[e, v, 0, l] = 0.5 * (low + high)
                out[e, v, 1, l] = 0.5 * (high - low) + 32.0 * UNIT * max(abs(low), abs(high))


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _interval_fractions(at_corners, slopes, p, n_corners, fraction, coincide, e, arg, out, d_out, is_there):
    """Fractions of knot intervals at one end of a box, and their derivatives in the parameters of the knots."""
    # Interval ``m`` of order ``r + 1`` is number ``r (r - 1) / 2 + m``, and goes from local knot ``p - 1 - r + m`` to
    # ``p - 1 + m``.
    n_lanes = at_corners.shape[2]
    for r in range(1, p):
        for m in range(r):
            n, low, high = r * (r - 1) // 2 + m, p - 1 - r + m, p - 1 + m
            for l in range(n_lanes):
                least, most, narrow, wide = np.inf, -np.inf, np.inf, 0.0
                u = fraction[e, arg, l]
                for corner in range(n_corners):
                    a, b = at_corners[corner, low, l], at_corners[corner, high, l]
                    x = (1.0 - u) * at_corners[corner, p - 2, l] + u * at_corners[corner, p - 1, l]
                    part = (x - a) / (b - a)
                    least, most = min(least, part), max(most, part)
                    narrow, wide = min(narrow, b - a), max(wide, b - a)
                is_there[l] = is_there[l] and narrow > NARROWEST
                loss = 16.0 * UNIT / narrow
                is_zero = u == 0.0 and coincide[e, low, l] > 0.0
                is_one = u == 1.0 and coincide[e, high, l] > 0.0
                least = 1.0 if is_one else max(least - loss, 0.0)
                most = 0.0 if is_zero else min(most + loss, 1.0)
                least, most = min(least, most), max(least, most)
                out[arg, n, 0, l], out[arg, n, 1, l] = least, most
                if n_corners > 1:
                    narrow, wide = narrow * (1.0 - loss), wide * (1.0 + loss)
                    for d in range(2):
                        low_low, low_high, high_low, high_high = np.inf, -np.inf, np.inf, -np.inf
                        for end in range(2):
                            first, last = slopes[d, end, p - 2, l], slopes[d, end, p - 1, l]
                            x = (1.0 - u) * first + u * last
                            a, b = x - slopes[d, end, low, l], x - slopes[d, end, high, l]
                            low_low, low_high = min(low_low, a), max(low_high, a)
                            high_low, high_high = min(high_low, b), max(high_high, b)
                        low_low, low_high = low_low - 16.0 * UNIT, low_high + 16.0 * UNIT
                        high_low, high_high = high_low - 16.0 * UNIT, high_high + 16.0 * UNIT
                        bottom = min(
                            (1.0 - least) * low_low + least * high_low, (1.0 - most) * low_low + most * high_low
                        )
                        top = max(
                            (1.0 - least) * low_high + least * high_high, (1.0 - most) * low_high + most * high_high
                        )
                        if is_zero or is_one:
                            bottom, top = 0.0, 0.0
                        bottom = bottom / wide if bottom > 0.0 else bottom / narrow
                        top = top / narrow if top > 0.0 else top / wide
                        d_out[d, arg, n, 0, l], d_out[d, arg, n, 1, l] = bottom, top


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _raise(parts, d_parts, r, arg, n_changes, weights, sums):
    """Raise the ``r`` functions of order ``r`` to order ``r + 1``, with the changes of their partial sums."""
    for m in range(r - 1, -1, -1):
        n = r * (r - 1) // 2 + m
        for d in range(n_changes):
            for l in range(weights.shape[2]):
                s_0, s_1 = parts[arg, n, 0, l], parts[arg, n, 1, l]
                x_0, x_1 = sums[d, m, 0, l], sums[d, m, 1, l]
                y_0, y_1 = (sums[d, m - 1, 0, l], sums[d, m - 1, 1, l]) if m > 0 else (0.0, 0.0)
                low, high = product_range(
                    d_parts[d, arg, n, 0, l], d_parts[d, arg, n, 1, l], weights[m, 0, l], weights[m, 1, l]
                )
                kept = min((1.0 - s_0) * x_0 + s_0 * y_0, (1.0 - s_1) * x_0 + s_1 * y_0)
                most = max((1.0 - s_0) * x_1 + s_0 * y_1, (1.0 - s_1) * x_1 + s_1 * y_1)
                size = 8.0 * UNIT * (max(abs(x_0), abs(x_1)) + max(abs(y_0), abs(y_1)) + max(abs(low), abs(high)))
                sums[d, m, 0, l], sums[d, m, 1, l] = kept - high - size, most - low + size
        for l in range(weights.shape[2]):
            s_0, s_1, w_0, w_1 = parts[arg, n, 0, l], parts[arg, n, 1, l], weights[m, 0, l], weights[m, 1, l]
            low, high = (0.0, 0.0) if m + 1 == r else (weights[m + 1, 0, l], weights[m + 1, 1, l])
            weights[m + 1, 0, l] = (low + s_0 * w_0) * (1.0 - 8.0 * UNIT)
            weights[m + 1, 1, l] = (high + s_1 * w_1) * (1.0 + 8.0 * UNIT)
            weights[m, 0, l] = (1.0 - s_1) * w_0 * (1.0 - 8.0 * UNIT)
            weights[m, 1, l] = (1.0 - s_0) * w_1 * (1.0 + 8.0 * UNIT)


@njit(cache=True, nogil=True, error_model="numpy")
def extraction(
    # see `enclose`
    knots,
    orders,
    # whether knots of the first direction depend on the fraction of the second, also through other knots
    depends,  # bool (3, 3)
    coincide,  # (3, n_local, L), 1 if a local knot equals the end of the span on its side
    fractions,
    box,
    turns,  # (3, 3, 2, L), from `parameter_slopes`
    # direction about a pole, direction that ends there, and at which end; -1 without a pole
    pole,  # tuple of three int
    at_pole,  # bool (L,), which boxes have it as a side
    pole_turns,  # (3, 3, 2, L), for the knots along it, see `bspline_mdao.core.evaluation.poles.divided_turns`
    work,  # tuple of ndarray, scratch
    # receives centres and radii of the matrices to control points: ``[:, e, a, i]`` from point ``i`` to point ``a``
    points,  # (2, 3, p, p, L)
    # receives the matrices to the derivative in fraction ``v``, from the differences of neighbouring control points in
    # direction ``e``: ``[:, e, v, a, i]``; all derivatives have the degree of the points
    rows,  # (2, 3, 3, p, p - 1, L)
    is_there,  # bool (L,), set to False if knots may coincide
):
    """Matrices from control points of elements to Bézier control points on boxes, and to their derivatives."""
    at_corners, slopes, parts, d_parts, weights, sums, derivative, changes = work
    n_lanes = box.shape[2]
    for e in range(3):
        p = orders[e]
        if p == 1:
            points[0, e, 0, 0], points[1, e, 0, 0] = 1.0, 0.0
            continue
        n_corners, n_changes = (4, 2) if depends[e].any() else (1, 0)
        knots_at_corners(knots, e, 2 * p - 2, n_corners, box, pole, at_pole, at_corners, slopes)
        for arg in range(2):
            _interval_fractions(at_corners, slopes, p, n_corners, fractions, coincide, e, arg, parts, d_parts, is_there)
        for a in range(p):
            _start(weights, sums)
            for r in range(1, p):
                if r == p - 1 and a < p - 1:
                    _derivative_row(at_corners, p, n_corners, weights, derivative[a])
                _raise(parts, d_parts, r, 1 if r <= a else 0, n_changes, weights, sums)
            for m in range(p):
                for l in range(n_lanes):
                    low, high = weights[m, 0, l], weights[m, 1, l]
                    points[0, e, a, m, l] = 0.5 * (low + high)
                    points[1, e, a, m, l] = 0.5 * (high - low) + 24.0 * UNIT * high
            for d in range(n_changes):
                for m in range(p - 1):
                    for l in range(n_lanes):
                        low, high = sums[d, m, 0, l], sums[d, m, 1, l]
                        changes[d, a, m, 0, l] = -0.5 * (low + high)  # points change by minus the change of the sums
                        changes[d, a, m, 1, l] = 0.5 * (high - low) + 2.0 * UNIT * max(abs(low), abs(high))
        is_along = e == 3 - pole[0] - pole[1]
        _rows(e, p, depends[e], derivative, changes, pole_turns if is_along else turns, rows)


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _start(weights, sums):
    """Fill functions with the one of order 1, and changes of their sums with zeros."""
    for m in range(weights.shape[0]):
        for i in range(2):
            for l in range(weights.shape[2]):
                weights[m, i, l] = 1.0 if m == 0 else 0.0
                sums[0, m, i, l], sums[1, m, i, l] = 0.0, 0.0


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _derivative_row(at_corners, p, n_corners, weights, out):
    """Ranges of the factors of differences of control points in a derivative, from functions of one order less."""
    for m in range(p - 1):
        for l in range(out.shape[2]):
            least, most = np.inf, 0.0
            for corner in range(n_corners):
                width = at_corners[corner, p - 1, l] - at_corners[corner, p - 2, l]
                ratio = width / (at_corners[corner, p - 1 + m, l] - at_corners[corner, m, l])
                loss = 16.0 * UNIT / width
                least, most = min(least, ratio * (1.0 - loss)), max(most, ratio * (1.0 + loss))
            out[m, 0, l], out[m, 1, l] = (p - 1) * least * weights[m, 0, l], (p - 1) * most * weights[m, 1, l]


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _rows(e, p, depends, derivative, changes, turns, rows):
    """Write the matrices to derivatives: in a direction itself, its degree raised by one, and through its knots."""
    f, g = (e + 1) % 3, (e + 2) % 3
    for v in range(3):
        if v != e and not depends[v]:
            continue  # these stay zero
        for a in range(p):
            below = a / (p - 1)
            for m in range(p - 1):
                for l in range(rows.shape[5]):
                    centre, radius = 0.0, 0.0
                    if v == e:
                        low = (
                            below * derivative[max(a - 1, 0), m, 0, l]
                            + (1.0 - below) * derivative[min(a, p - 2), m, 0, l]
                        )
                        high = (
                            below * derivative[max(a - 1, 0), m, 1, l]
                            + (1.0 - below) * derivative[min(a, p - 2), m, 1, l]
                        )
                        centre, radius = 0.5 * (low + high), 0.5 * (high - low) + 8.0 * UNIT * high
                    if depends[v]:
                        for d in range(2):
                            c, r = changes[d, a, m, 0, l], changes[d, a, m, 1, l]
                            o = f if d == 0 else g
                            x, s = turns[o, v, 0, l], turns[o, v, 1, l]
                            centre += c * x
                            radius += abs(c) * s + r * (abs(x) + s) + 8.0 * UNIT * (abs(c * x) + abs(centre))
                    rows[0, e, v, a, m, l], rows[1, e, v, a, m, l] = centre, radius + 24.0 * UNIT * abs(centre)
