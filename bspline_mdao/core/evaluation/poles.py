"""Sides of B-spline volumes that have collapsed to a pole: lines about which the volume turns.

There the derivative about the pole is zero, and so is the Jacobian. With curved knots this derivative comes from three
kinds of differences of control points, which all fade towards the pole in proportion to the fraction of a box between
box and pole: differences about the pole, which have collapsed there; differences towards it, because its side has a
constant parameter; and differences along it, because knots along it do not vary about it *on* it. So this factor is
divided out exactly, and the remaining factor is examined instead.

Theory: ``docs/theory/validity.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...grids.cells.bernstein import UNIT
from .knot_ranges import determinant, plane_slope, product_range, span_width

__all__ = ["NO_POLE", "divided_turns", "mean_weights", "next_to_pole", "poles_of", "raise_divided"]

NO_POLE = (-1, -1, -1)


def poles_of(
    knots: tuple[np.ndarray, ...],  # each (2, 2, N + p), knots of every direction on its four edges, Eq. (5)
    B: np.ndarray,  # (N0, N1, N2, 3), control points (m)
    shortest: float,  # differences of control points up to this length (m), in the sum norm, have collapsed
) -> list[tuple[int, int, int]]:  # direction about the pole, direction that ends there, and at which end, 0 or 1
    """Find the sides of a volume that are poles and whose knots along the pole vary elsewhere."""
    found = []
    for about in range(3):
        for towards in ((about + 1) % 3, (about + 2) % 3):
            along = 3 - about - towards
            if min(B.shape[:3]) == 1 or not (knots[along] != knots[along][0, 0]).any():
                continue
            for end in (0, 1):
                side = np.take(B, -end, axis=towards)  # the directions `about` and `along` remain, in ascending order
                edges = np.abs(np.diff(side, axis=0 if about < along else 1)).sum(axis=-1)
                on_side = np.take(knots[along], end, axis=0 if towards == (along + 1) % 3 else 1)
                if edges.max() <= shortest and np.ptp(on_side, axis=0).max() <= 8.0 * UNIT:
                    found.append((about, towards, end))
    return found


def next_to_pole(pole: tuple[int, int, int], shape: tuple[int, ...]) -> np.ndarray:
    """Which elements of a volume, in an array of a shape, touch a pole."""
    _, towards, end = pole
    at = np.arange(shape[towards]) == (shape[towards] - 1) * end
    return np.broadcast_to(at.reshape([-1 if e == towards else 1 for e in range(3)]), shape)


@njit(cache=True, nogil=True, error_model="numpy")
def divided_turns(
    # see `bspline_mdao.core.evaluation.knot_ranges.extraction`
    knots,
    orders,
    depends,
    pole,
    at_pole,
    # from `bspline_mdao.core.evaluation.knot_ranges.parameter_slopes`
    K,  # (3, 3, 2, L)
    turns,  # (3, 3, 2, L)
    fractions,
    box,
    # receives centres and radii like ``turns``. The change of a knot along the pole with the parameter about it is
    # proportional to the distance from the pole; that factor is in here. Where the fraction is the one about the pole,
    # it is divided by the fraction of the box between box and pole
    out,  # (3, 3, 2, L)
):
    """Derivatives of parameters in the fractions for the knots along a pole, divided about it."""
    v, d, end = pole
    o = 3 - v - d
    q = orders[d] - 2 if end == 1 else orders[d] - 1  # the knot of the span that is not on the pole
    ranges = np.empty((3, 3, 2))
    for l in range(box.shape[2]):
        for e in range(3):
            for x in range(3):
                centre, radius = turns[e, x, 0, l], turns[e, x, 1, l]
                ranges[e, x, 0], ranges[e, x, 1] = centre - radius, centre + radius
        if at_pole[l]:
            extent = fractions[d, 1, l] - fractions[d, 0, l]
            narrow, wide = span_width(knots, orders, d, box, l)
            for x in range(3):
                ranges[v, x, 0], ranges[v, x, 1] = product_range(
                    ranges[v, x, 0], ranges[v, x, 1], extent * narrow if x == v else 0.0, extent * wide
                )
            slopes_o = _slope_range(knots, d, o, q, box[v, 0, l], box[v, 1, l], l)
            low, high = product_range(slopes_o[0], slopes_o[1], K[o, v, 0, l], K[o, v, 1, l])
            slopes_v = _slope_range(knots, d, v, q, box[o, 0, l], box[o, 1, l], l)
            least, most = determinant(K, l)
            narrow, wide = span_width(knots, orders, v, box, l)
            low, high = product_range(
                low + slopes_v[0], high + slopes_v[1], extent * narrow / most, extent * wide / least
            )
            is_any = depends[d].any()
            ranges[d, v, 0], ranges[d, v, 1] = low if is_any else 0.0, high if is_any else 0.0
        for e in range(3):
            for x in range(3):
                low, high = ranges[e, x, 0], ranges[e, x, 1]
                out[e, x, 0, l] = 0.5 * (low + high)
                out[e, x, 1, l] = 0.5 * (high - low) + 32.0 * UNIT * max(abs(low), abs(high))


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _slope_range(knots, e, v, q, first, last, l):
    """Range of the derivative of local knot ``q`` of direction ``e`` in parameter ``v`` over a range of the other's."""
    i, j = (1, 0) if v == (e + 1) % 3 else (0, 1)
    a, b = plane_slope(knots, e, i, j, q, first, l), plane_slope(knots, e, i, j, q, last, l)
    return min(a, b) - 16.0 * UNIT, max(a, b) + 16.0 * UNIT


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def mean_weights(order, is_divided, pole, at_pole, out):
    """Weights of a polynomial's coefficients in its mean; for a divided one, in the mean before the division."""
    for a in range(order):
        from_far = a if pole[2] == 1 else order - 1 - a
        divided = 1.0 / (order - 1 - from_far) if from_far < order - 1 else 0.0
        for l in range(out.shape[1]):
            out[a, l] = divided if is_divided and at_pole[l] else 1.0 / order


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def raise_divided(vectors, orders, pole, at_pole):
    """Divide control vectors (2, p0, p1, p2, 3, L) that are zero on a pole, and restore their degree."""
    # With the fraction ``t`` between pole and far side, ``sum_a c_a B_a^n`` with ``c_n = 0`` is ``t`` times a
    # polynomial of coefficients ``c_a n / (n - a)`` of degree ``n - 1``, whose coefficients of degree n are
    # ``c_a + a / (n - a + 1) c_{a-1}``.
    d, n = pole[1], orders[pole[1]] - 1
    x = vectors.reshape(2, 3 * orders[0] * orders[1] * orders[2], vectors.shape[5])
    steps = 3 * orders[1] * orders[2], 3 * orders[2], 3
    f, g = (1, 2) if d == 0 else (0, 2) if d == 1 else (0, 1)
    for q in range(orders[f]):
        for r in range(orders[g]):
            for number in range(n, 0, -1):
                a, below = (number, number - 1) if pole[2] == 1 else (n - number, n - number + 1)
                for c in range(3):
                    to = q * steps[f] + r * steps[g] + a * steps[d] + c
                    at = q * steps[f] + r * steps[g] + below * steps[d] + c
                    for l in range(x.shape[2]):
                        weight = number / (n - number + 1) if at_pole[l] else 0.0
                        change = weight * x[0, at, l]
                        x[1, to, l] += weight * x[1, at, l] + 8.0 * UNIT * (abs(change) + abs(x[0, to, l]))
                        x[0, to, l] += change
