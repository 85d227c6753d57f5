"""Fit errors of single grid lines: how many control points each direction needs, before there is a fit.

Least squares of a block are worst where its worst lines are, usually on its faces. The error of the volume along one
direction is the error of curves, with the knots and the order of this direction, on the lines along it. It is found
line by line, with both ends fixed as in the fit, from banded normal equations with a few unknowns.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numba import njit

from ..splines.basis import basis_values, find_span
from .edge_knots import edge_knots
from .fit_nodes import FitNodes
from .local_errors import NO_DIRECTION, cell_width

SHIFT = 1e-11
"""Addition to the diagonal of the normal equations, relative to its largest entry, for spans without nodes."""


def class_errors(
    classes: np.ndarray,  # int (n_segments, 3), see `bspline_mdao.grids.topology.sharing.direction_classes`
    wanted: Collection[int],  # classes to examine
    sharing: FitNodes,  # nodes of the segments of this process; all processes call this
    nodes: np.ndarray,  # (n_rows, 3), its nodes (m)
    parameters: Sequence[np.ndarray],  # each (L0, L1, L2, 3), parameters of the nodes of every segment
    # control points and orders
    n_control: np.ndarray,  # int (n_segments, 3)
    orders: np.ndarray,  # int (n_segments, 3)
) -> np.ndarray:  # (n_classes,), 0 for others. See `bspline_mdao.core.fit.local_errors` for the width
    """Largest error of the grid lines of each class of directions, relative to the width of the cells."""
    errors = np.zeros(classes.max() + 1)
    for s in sharing.here:
        directions = [d for d in range(3) if classes[s, d] in wanted and n_control[s, d] > 1]
        for d in directions:
            error = _direction_error(nodes[sharing.rows[s]], parameters[s], d, int(n_control[s, d]), int(orders[s, d]))
            errors[classes[s, d]] = max(errors[classes[s, d]], error)
    return errors if sharing.comm.size == 1 else np.max(sharing.comm.allgather(errors), axis=0)


def _direction_error(nodes: np.ndarray, parameters: np.ndarray, d: int, n_control: int, order: int) -> float:
    """Largest error of a segment's lines along a direction on its faces, relative to the width of the cells."""
    axes = (d + 1) % 3, (d + 2) % 3, d
    # contiguous along every direction: one compiled kernel serves all
    lines = np.ascontiguousarray(nodes.transpose(*axes, 3))
    along = [np.ascontiguousarray(parameters[..., e].transpose(axes)) for e in axes]
    corners = np.array([[edge_knots(along[2][a, b], n_control, order) for b in (0, -1)] for a in (0, -1)])
    return worst_of_lines(lines, *along, corners, order)


@njit(cache=True)
def worst_of_lines(
    lines,  # (n_0, n_1, L, 3), nodes (m), a line in each of ``lines[a, b]``
    # their parameters across the lines, and along them
    first,  # (n_0, n_1, L)
    second,  # (n_0, n_1, L)
    along,  # (n_0, n_1, L)
    corners,  # (2, 2, N + p), knots of the four lines at the corners
    order,  # int, order p
):
    """Largest error of the grid lines at the rim of a bundle, relative to the width of the cells."""
    n_0, n_1 = lines.shape[:2]
    worst = 0.0
    for a in range(n_0):
        for b in range(n_1):
            if a == 0 or b == 0 or a == n_0 - 1 or b == n_1 - 1:
                s, t = first[a, b].mean(), second[a, b].mean()
                low, high = (1 - t) * corners[0, 0] + t * corners[0, 1], (1 - t) * corners[1, 0] + t * corners[1, 1]
                squares = squared_errors(lines[a, b], along[a, b], (1 - s) * low + s * high, order)
                for q in range(lines.shape[2]):
                    width = cell_width(lines, a, b, q, NO_DIRECTION)
                    if width < np.inf:
                        worst = max(worst, squares[q] / width**2)
    return np.sqrt(worst)


@njit(cache=True)
def squared_errors(
    nodes,  # (L, 3), nodes of a line (m)
    parameters,  # (L,), their parameters
    knots,  # (N + p,)
    order,  # int, order p
):  # (L,)
    """Squared distances of nodes from the curve fitted to them by least squares with fixed ends."""
    n_control, n_nodes = knots.size - order, len(nodes)
    values, firsts = np.empty((n_nodes, order)), np.empty(n_nodes, dtype=np.int64)
    gram, points = np.zeros((n_control, order)), np.zeros((n_control, 3))  # gram[i, m] couples i and i - m
    for q in range(n_nodes):
        span = find_span(knots, order, n_control, parameters[q])
        basis_values(knots, order, span, parameters[q], values[q])
        firsts[q] = span - order + 1
        rest = nodes[q].copy()
        if firsts[q] == 0:
            rest -= values[q, 0] * nodes[0]
        if span == n_control - 1:
            rest -= values[q, order - 1] * nodes[-1]
        for m in range(order):
            row = firsts[q] + m
            points[row] += values[q, m] * rest
            for n in range(m + 1):
                gram[row, m - n] += values[q, m] * values[q, n]
    _solve_inside(gram, points)
    points[0], points[-1] = nodes[0], nodes[-1]
    squares = np.empty(n_nodes)
    for q in range(n_nodes):
        missed = nodes[q].copy()
        for m in range(order):
            missed -= values[q, m] * points[firsts[q] + m]
        squares[q] = missed[0] ** 2 + missed[1] ** 2 + missed[2] ** 2
    return squares


@njit(cache=True)
def _solve_inside(gram, points):
    """Solve banded equations for all but the first and the last point in place, by Cholesky."""
    last, width = len(points) - 1, gram.shape[1]
    shift = SHIFT * gram[:, 0].max()
    for i in range(1, last):
        for m in range(min(width - 1, i - 1), -1, -1):
            j = i - m
            total = gram[i, m]
            for k in range(max(1, i - width + 1, j - width + 1), j):
                total -= gram[i, i - k] * gram[j, j - k]
            gram[i, m] = total / gram[j, 0] if m else np.sqrt(max(total, 0.0) + shift)
        for k in range(max(1, i - width + 1), i):
            points[i] -= gram[i, i - k] * points[k]
        points[i] /= gram[i, 0]
    for i in range(last - 1, 0, -1):
        for k in range(i + 1, min(last, i + width)):
            points[i] -= gram[k, k - i] * points[k]
        points[i] /= gram[i, 0]
