"""Cones that contain the derivatives of a B-spline volume on boxes, and whether they prove a positive Jacobian.

The derivatives in the fractions of `bspline_mdao.core.evaluation.knot_ranges` are sums of differences of neighbouring
control points. On a box their Bézier control vectors are known up to radii, which come from the ranges of the knots
and from rounding. In the frame of their means over the box the three derivatives are near the axes. The largest
fractions of two components of the control vectors bound the same fractions of the derivatives. If they are small
enough, the Jacobian is positive.

Arrays end with lanes, see `bspline_mdao.core.evaluation.knot_ranges`. Theory: ``docs/theory/validity.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...grids.cells.bernstein import UNIT
from .knot_ranges import product_range
from .poles import mean_weights, raise_divided

__all__ = ["are_positive", "control_vectors", "cut_direction", "frames", "load_edges", "worst_corner"]


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def load_edges(B, first, orders, shortest, lane, edges):
    """Write the differences of neighbouring control points of an element, shape (3, p0, p1, p2, 3, L), to a lane."""
    # Differences up to ``shortest`` (m), in the sum norm, have collapsed and are zero.
    for e in range(3):
        n_0, n_1, n_2 = orders[0] - (e == 0), orders[1] - (e == 1), orders[2] - (e == 2)
        for a in range(n_0):
            for b in range(n_1):
                for c in range(n_2):
                    at = first[0] + a, first[1] + b, first[2] + c
                    to = at[0] + (e == 0), at[1] + (e == 1), at[2] + (e == 2)
                    x = B[to[0], to[1], to[2], 0] - B[at[0], at[1], at[2], 0]
                    y = B[to[0], to[1], to[2], 1] - B[at[0], at[1], at[2], 1]
                    z = B[to[0], to[1], to[2], 2] - B[at[0], at[1], at[2], 2]
                    if abs(x) + abs(y) + abs(z) <= shortest:
                        x, y, z = 0.0, 0.0, 0.0
                    edges[e, a, b, c, 0, lane], edges[e, a, b, c, 1, lane], edges[e, a, b, c, 2, lane] = x, y, z


@njit(cache=True, nogil=True, error_model="numpy")
def frames(
    edges,  # see `load_edges`
    # see `bspline_mdao.core.evaluation.knot_ranges.extraction`, as for ``points`` and ``rows``
    orders,
    points,
    rows,
    depends,
    normal,  # (3,), derivative in a direction of order 1
    # see `bspline_mdao.core.evaluation.knot_ranges.extraction`. The derivative about a pole is divided by the fraction
    # of the box between box and pole
    pole,
    at_pole,
    work,  # tuple of ndarray, scratch
    frame,  # (3, 3, L), receives the inverses
    signs,  # (L,), receives the signs of their determinants
    is_there,  # bool (L,), set to False if there is no inverse
):
    """Inverses of the means of the derivatives over boxes, shape (3, 3, L)."""
    means, mean_rows, mean, weights = work
    n_lanes = frame.shape[2]
    for v in range(3):
        for x in range(3):
            for l in range(n_lanes):
                mean[x, v, l] = normal[x] if orders[v] == 1 else 0.0
    for n in range(4 if pole[0] >= 0 else 3):  # the last ones belong to the divided derivative
        e = n if n < 3 else pole[1]
        mean_weights(orders[e], n == 3, pole, at_pole, weights)
        for m in range(orders[e]):
            for l in range(n_lanes):
                means[n, m, l] = 0.0
            for a in range(orders[e]):
                for l in range(n_lanes):
                    means[n, m, l] += points[0, e, a, m, l] * weights[a, l]
    for e in range(3):
        for v in range(3):
            mean_weights(orders[e], v == pole[0] and e == pole[1], pole, at_pole, weights)
            for m in range(orders[e] - 1):
                for l in range(n_lanes):
                    mean_rows[v, m, l] = 0.0
                for a in range(orders[e]):
                    for l in range(n_lanes):
                        mean_rows[v, m, l] += rows[0, e, v, a, m, l] * weights[a, l]
        n_0, n_1, n_2 = orders[0] - (e == 0), orders[1] - (e == 1), orders[2] - (e == 2)
        for a in range(n_0):
            for b in range(n_1):
                for c in range(n_2):
                    m = a if e == 0 else b if e == 1 else c
                    i, j = (b, c) if e == 0 else (c, a) if e == 1 else (a, b)
                    for v in range(3):
                        if v != e and not depends[e, v]:
                            continue
                        f, g, is_about = (e + 1) % 3, (e + 2) % 3, v == e and v == pole[0]
                        f, g = 3 if is_about and f == pole[1] else f, 3 if is_about and g == pole[1] else g
                        for l in range(n_lanes):
                            weight = mean_rows[v, m, l] * means[f, i, l] * means[g, j, l]
                            mean[0, v, l] += weight * edges[e, a, b, c, 0, l]
                            mean[1, v, l] += weight * edges[e, a, b, c, 1, l]
                            mean[2, v, l] += weight * edges[e, a, b, c, 2, l]
    for l in range(n_lanes):
        for o in range(3):
            p, q = (o + 1) % 3, (o + 2) % 3
            frame[o, 0, l] = mean[1, p, l] * mean[2, q, l] - mean[2, p, l] * mean[1, q, l]
            frame[o, 1, l] = mean[2, p, l] * mean[0, q, l] - mean[0, p, l] * mean[2, q, l]
            frame[o, 2, l] = mean[0, p, l] * mean[1, q, l] - mean[1, p, l] * mean[0, q, l]
        determinant = mean[0, 0, l] * frame[0, 0, l] + mean[1, 0, l] * frame[0, 1, l] + mean[2, 0, l] * frame[0, 2, l]
        signs[l] = 1.0 if determinant > 0.0 else -1.0
        is_there[l] = is_there[l] and determinant != 0.0
        for o in range(3):
            for x in range(3):
                frame[o, x, l] /= determinant


@njit(cache=True, nogil=True, error_model="numpy")
def control_vectors(
    # see `frames`
    edges,
    orders,
    points,
    rows,
    depends,
    normal,
    pole,
    at_pole,
    frame,
    work,  # (2, 2, p0, p1, p2, 3, L), scratch
    vectors,  # (3, 2, p0, p1, p2, 3, L), receives centres and radii for each derivative
):
    """Centres and radii of the control vectors of the derivatives in the frames."""
    for v in range(3):
        _start(orders, v, normal, frame, vectors[v])
    has_pole = pole[0] >= 0
    for step in range(3):  # the contribution along a pole is already divided, and comes last
        e = step if not has_pole else 3 - pole[0] - pole[1] if step == 2 else pole[step]
        if orders[e] == 1:
            continue
        f, g = (e + 1) % 3, (e + 2) % 3
        n = orders[0] - (e == 0), orders[1] - (e == 1), orders[2] - (e == 2)
        _turn(edges[e], n, frame, work[0])
        _contract(work[0], n, f, orders[f], points[0, f], points[1, f], e < 0, work[1])
        _contract(work[1], n, g, orders[g], points[0, g], points[1, g], e < 0, work[0])
        for v in range(3):
            if v == e or (depends[e, v] and orders[v] > 1):
                _contract(work[0], n, e, orders[e], rows[0, e, v], rows[1, e, v], e >= 0, vectors[v])
        if has_pole and step == 1:
            raise_divided(vectors[pole[0]], orders, pole, at_pole)


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _start(orders, v, normal, frame, out):
    """Fill control vectors with zeros, or with the normal if the direction has one layer of points."""
    for a in range(orders[0]):
        for b in range(orders[1]):
            for c in range(orders[2]):
                for o in range(3):
                    for l in range(out.shape[5]):
                        value, size = 0.0, 0.0
                        if orders[v] == 1:
                            for x in range(3):
                                value += frame[o, x, l] * normal[x]
                                size += abs(frame[o, x, l] * normal[x])
                        out[0, a, b, c, o, l], out[1, a, b, c, o, l] = value, 8.0 * UNIT * size


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _turn(edges, n, frame, out):
    """Write ``n`` differences of control points in the frames, and bounds of their errors."""
    for a in range(n[0]):
        for b in range(n[1]):
            for c in range(n[2]):
                for o in range(3):
                    for l in range(out.shape[5]):
                        u = frame[o, 0, l] * edges[a, b, c, 0, l]
                        v = frame[o, 1, l] * edges[a, b, c, 1, l]
                        w = frame[o, 2, l] * edges[a, b, c, 2, l]
                        out[0, a, b, c, o, l] = u + v + w
                        out[1, a, b, c, o, l] = 8.0 * UNIT * (abs(u) + abs(v) + abs(w))


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _contract(source, n, axis, n_out, centre, radius, is_sum, out):
    """Contract one index of ``n`` vectors with matrices; both are known up to radii."""
    (p_0, p_1, p_2), L = out.shape[1:4], out.shape[5]
    x, y = source.reshape(2, 3 * p_0 * p_1 * p_2, L), out.reshape(2, 3 * p_0 * p_1 * p_2, L)
    steps = 3 * p_1 * p_2, 3 * p_2, 3
    f, g = (1, 2) if axis == 0 else (0, 2) if axis == 1 else (0, 1)
    for q in range(n[f]):
        for r in range(n[g]):
            base = q * steps[f] + r * steps[g]
            for i in range(n_out):
                for o in range(3):
                    to = base + i * steps[axis] + o
                    if not is_sum:
                        for l in range(L):
                            y[0, to, l], y[1, to, l] = 0.0, 0.0
                    for m in range(n[axis]):
                        at = base + m * steps[axis] + o
                        for l in range(L):
                            c, s, value = centre[i, m, l], radius[i, m, l], x[0, at, l]
                            y[0, to, l] += c * value
                            y[1, to, l] += s * abs(value) + (abs(c) + s) * x[1, at, l]


@njit(cache=True, nogil=True, error_model="numpy")
def are_positive(
    # from `control_vectors`. They become fractions: components are divided by the component in the derivative's own
    # direction. If that may not be positive, radii are infinite; if a vector has collapsed, its own radius is -1
    vectors,  # (3, 2, p0, p1, p2, 3, L)
    orders,  # tuple of three int
    columns,  # (3, 3, 2, L), receives the ranges of fractions: of derivative v, component o
    is_there,  # bool (L,), receives whether the Jacobian is proved positive, if it was True
):
    """Whether the Jacobian in the frames is positive on boxes."""
    n_lanes = columns.shape[3]
    for v in range(3):
        for o in range(3):
            for l in range(n_lanes):
                columns[v, o, 0, l], columns[v, o, 1, l] = np.inf, -np.inf
        for a in range(orders[0]):
            for b in range(orders[1]):
                for c in range(orders[2]):
                    _divide(vectors[v, 0, a, b, c], vectors[v, 1, a, b, c], v, columns[v])
    for l in range(n_lanes):
        least, size = 1.0, 1.0
        for v in range(3):
            for turn in range(1, 3):
                o = (v + turn) % 3
                is_there[l] = is_there[l] and columns[v, o, 0, l] > -1e100 and columns[v, o, 1, l] < 1e100
                if v < o:
                    low, high = product_range(
                        columns[v, o, 0, l], columns[v, o, 1, l], columns[o, v, 0, l], columns[o, v, 1, l]
                    )
                    least -= high
                    size += max(abs(low), abs(high))
        for turn in range(1, 3):
            q = 3 - turn
            low, high = product_range(
                columns[0, turn, 0, l], columns[0, turn, 1, l], columns[turn, q, 0, l], columns[turn, q, 1, l]
            )
            low, high = product_range(low, high, columns[q, 0, 0, l], columns[q, 0, 1, l])
            least += low
            size += max(abs(low), abs(high))
        is_there[l] = is_there[l] and least > 1e-12 * size


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _divide(centre, radius, leading, columns):
    """Divide the components of a control vector by its own one, and widen the ranges of fractions accordingly."""
    o_1, o_2 = (leading + 1) % 3, (leading + 2) % 3
    for l in range(columns.shape[2]):
        value, wrong = centre[leading, l], radius[leading, l] * (1.0 + 1e-12)
        floor = value - wrong
        has_collapsed = (
            value == 0.0 and wrong == 0.0 and centre[o_1, l] == 0.0 and centre[o_2, l] == 0.0
            and radius[o_1, l] == 0.0 and radius[o_2, l] == 0.0
        )  # fmt: skip
        for turn in range(1, 3):
            o = o_1 if turn == 1 else o_2
            fraction, off = 0.0, 0.0
            if not has_collapsed:
                fraction = centre[o, l] / value
                off = (radius[o, l] * (1.0 + 1e-12) + abs(fraction) * wrong) / floor + 8.0 * UNIT * abs(fraction)
                if not floor > 0.0:
                    fraction, off = 0.0, np.inf
                columns[o, 0, l] = min(columns[o, 0, l], fraction - off)
                columns[o, 1, l] = max(columns[o, 1, l], fraction + off)
            centre[o, l], radius[o, l] = fraction, off
        radius[leading, l] = -1.0 if has_collapsed else 0.0


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _influence(rows, orders, fractions, lane, out):
    """Change of the control points with the knots on a box in each of its directions, shape (3,)."""
    total = 1e-300
    for d in range(3):
        out[d] = 0.0
        for e in range(3):
            if e != d:
                for a in range(orders[e]):
                    for m in range(orders[e] - 1):
                        out[d] += abs(rows[0, e, d, a, m, lane]) + rows[1, e, d, a, m, lane]
        out[d] *= fractions[d, 1, lane] - fractions[d, 0, lane]
        total += out[d]
    for d in range(3):
        out[d] /= total


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def cut_direction(vectors, rows, orders, columns, fractions, has_frame, lane):
    """Direction in which a box is best halved."""
    # The direction in which the fractions of `are_positive` differ most, each times its factor; their radii count if
    # the knots change. Without a frame the box is halved along its longest side.
    scores, influence, most = np.zeros(3), np.zeros(3), np.zeros(3)
    _influence(rows, orders, fractions, lane, influence)
    for d in range(3):
        if not has_frame:
            scores[d] = fractions[d, 1, lane] - fractions[d, 0, lane]
    for v in range(3):
        for turn in range(1, 3):
            o, radius = (v + turn) % 3, 0.0
            partner = min(max(abs(columns[o, v, 0, lane]), abs(columns[o, v, 1, lane])), 1e6) + 1e-3
            for d in range(3):
                most[d] = 0.0
            for a in range(orders[0]):
                for b in range(orders[1]):
                    for c in range(orders[2]):
                        x = vectors[v, 0, a, b, c, o, lane]
                        radius = max(radius, min(vectors[v, 1, a, b, c, o, lane], 1e6))
                        if a > 0:
                            most[0] = max(most[0], abs(x - vectors[v, 0, a - 1, b, c, o, lane]))
                        if b > 0:
                            most[1] = max(most[1], abs(x - vectors[v, 0, a, b - 1, c, o, lane]))
                        if c > 0:
                            most[2] = max(most[2], abs(x - vectors[v, 0, a, b, c - 1, o, lane]))
            for d in range(3):
                if has_frame:
                    scores[d] += partner * (most[d] * (orders[d] - 1) + radius * influence[d])
    best = 0
    for d in range(3):
        if orders[d] > 1 and (orders[best] == 1 or scores[d] > scores[best]):
            best = d
    return best


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def worst_corner(vectors, orders, sign, pole, is_at_pole, lane, out):
    """Find the corner, off poles, with the smallest Jacobian by the fractions; False if that is positive."""
    least = 0.0
    is_there = False
    for n in range(8):
        corner = n & 1, (n >> 1) & 1, n >> 2
        i, j, k = (orders[0] - 1) * corner[0], (orders[1] - 1) * corner[1], (orders[2] - 1) * corner[2]
        has_collapsed = is_at_pole and corner[pole[1]] == pole[2]
        for v in range(3):
            has_collapsed = has_collapsed or vectors[v, 1, i, j, k, v, lane] < 0.0
        a_1, a_2 = vectors[0, 0, i, j, k, 1, lane], vectors[0, 0, i, j, k, 2, lane]
        b_0, b_2 = vectors[1, 0, i, j, k, 0, lane], vectors[1, 0, i, j, k, 2, lane]
        c_0, c_1 = vectors[2, 0, i, j, k, 0, lane], vectors[2, 0, i, j, k, 1, lane]
        value = sign * (1.0 - a_1 * b_0 - a_2 * c_0 - b_2 * c_1 + a_1 * b_2 * c_0 + a_2 * b_0 * c_1)
        for v in range(3):
            if not vectors[v, 1, i, j, k, (v + 1) % 3, lane] < np.inf:
                value = min(value, -1.0)  # its own component may not be positive
        if not has_collapsed and value <= least:
            least, is_there, out[0], out[1], out[2] = value, True, corner[0], corner[1], corner[2]
    return is_there
