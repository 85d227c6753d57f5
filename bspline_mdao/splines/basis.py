"""B-spline basis functions, Eqs. (2) and (4): values and derivatives in the parameter and in the knots.

On the span ``T[s] <= xi < T[s+1]`` (numbered from 0) only the ``p`` functions ``s-p+1 .. s`` differ from zero, and they
depend on the ``2p - 2`` *local knots* ``T[s-p+2] .. T[s+p-1]`` alone. They are found by the de Boor triangle: from one
order to the next each function passes the share ``(xi - a) / (b - a)`` of its value, [a, b] being its interval, to its
right-hand neighbour and keeps the rest. So no interval is empty, the sum stays one, and at an end of the parameter
range the end function is one to the last bit. The first and the last span continue beyond the ends, so that ``xi = 1``,
and a parameter that round-off has carried out of [0, 1], need no special care.

The functions with an ``out`` argument are called from other numba kernels, once per point; the ones without it take
arrays of points and an object of `bspline_mdao.splines.knots`.

References
----------
C. de Boor, *A Practical Guide to Splines*, Springer, 1978, chapter X.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .jets import JET_SIZES, jet_product, jet_quotient


@njit(cache=True, error_model="numpy")
def find_span(T, order, n_control, xi):
    """Span ``s`` that holds ``xi``: the last one of ``p-1 .. N-1`` with ``T[s] <= xi``, or ``p-1``.

    Parameters
    ----------
    T : ndarray, shape (N + p,)
        Knots, non-decreasing.
    order, n_control : int
        Order p and number of control points N.
    xi : float
        Parameter.
    """
    low, high = order - 1, n_control - 1
    while low < high:
        middle = (low + high + 1) // 2
        if T[middle] <= xi:
            low = middle
        else:
            high = middle - 1
    return low


@njit(cache=True, error_model="numpy")
def basis_values(T, order, s, xi, out):
    """Write the ``p`` basis functions that differ from zero on span ``s`` to ``out``, Eq. (2).

    Parameters
    ----------
    T : ndarray, shape (N + p,)
        Knots.
    order, s : int
        Order p and span.
    xi : float
        Parameter.
    out : ndarray, shape (>= p,)
        Receives ``N_{s-p+1} .. N_s``.
    """
    out[0] = 1.0
    for r in range(1, order):
        _raise_order(T, s + 1 - r, r, xi, out)


@njit(cache=True, error_model="numpy")
def _raise_order(T, first, r, xi, values):
    """Take the ``r`` functions of order ``r`` on a span to the ``r + 1`` of order ``r + 1``, in place."""
    received = 0.0
    for m in range(r):
        a, b = T[first + m], T[first + m + r]
        passed = (xi - a) / (b - a) * values[m]
        values[m] += received - passed
        received = passed
    values[r] = received


@njit(cache=True, error_model="numpy")
def basis_jacobian(T, order, s, xi, out):
    """Write the derivatives of the ``p`` functions on span ``s`` in the parameter and in the local knots to ``out``.

    The triangle of `basis_values` is differentiated step by step. Column 0 holds the values that this takes, until the
    last step turns them into derivatives in ``xi``.

    Parameters
    ----------
    T, order, s, xi
        As for `basis_values`.
    out : ndarray, shape (>= p, >= 2p - 1)
        ``out[i, 0]`` receives the derivative of ``N_{s-p+1+i}`` in ``xi``, ``out[i, 1 + m]`` the one in
        ``T[s-p+2+m]``.
    """
    out[:order, : 2 * order - 1] = 0.0
    out[0, 0] = 1.0
    for r in range(1, order):
        first = s + 1 - r
        for column in range(order - r, order + r):
            _raise_order_knot_derivative(T, first, r, xi, s - order + 1 + column, out, column)
        if r < order - 1:
            _raise_order(T, first, r, xi, out[:, 0])
    _raise_order_derivative(T, s + 2 - order, order - 1, out[:, 0])


@njit(cache=True, error_model="numpy")
def _raise_order_knot_derivative(T, first, r, xi, knot, out, column):
    """`_raise_order` of column 0, differentiated in ``T[knot]``; the derivatives are in ``out[:, column]``."""
    received = 0.0
    for m in range(r):
        a, b = T[first + m], T[first + m + r]
        d_a, d_b = 1.0 * (knot == first + m), 1.0 * (knot == first + m + r)
        share = (xi - a) / (b - a)
        d_share = (share * (d_a - d_b) - d_a) / (b - a)
        passed = share * out[m, column] + d_share * out[m, 0]
        out[m, column] += received - passed
        received = passed
    out[r, column] = received


@njit(cache=True, error_model="numpy")
def _raise_order_derivative(T, first, r, values):
    """Take the functions of order ``r`` to the derivatives of those of order ``r + 1`` in the parameter, in place."""
    received = 0.0
    for m in range(r):
        passed = r * values[m] / (T[first + m + r] - T[first + m])
        values[m] = received - passed
        received = passed
    values[r] = received


@njit(cache=True, error_model="numpy")
def basis_jets_at(T, order, s, xi, out, work):
    """Write the jets of the ``p`` functions on span ``s`` to ``out``: the triangle of `basis_values` in jet arithmetic.

    Parameters
    ----------
    T : ndarray, shape (N + p, n)
        Jets of the knots in ``(xi, s, t)``, see `bspline_mdao.splines.jets`; n = 1, 4 or 10 sets the degree.
    order, s, xi
        As for `basis_values`.
    out : ndarray, shape (>= p, n)
        Receives the jets of ``N_{s-p+1} .. N_s``, Eq. (4).
    work : ndarray, shape (3, n)
        Scratch.
    """
    passed, width, received = work[0], work[1], work[2]
    out[0] = 0.0
    out[0, 0] = 1.0
    for r in range(1, order):
        received[:] = 0.0
        for m in range(r):
            _interval_jets(T[s + 1 - r + m], T[s + 1 + m], xi, passed, width)
            jet_quotient(passed, width, passed)
            jet_product(passed, out[m], passed)
            for n in range(received.size):
                out[m, n] += received[n] - passed[n]
                received[n] = passed[n]
        out[r] = received


@njit(cache=True, error_model="numpy")
def _interval_jets(a, b, xi, left, width):
    """Write the jets of ``xi - a`` and ``b - a``."""
    for n in range(width.size):
        left[n], width[n] = -a[n], b[n] - a[n]
    left[0] += xi
    if width.size > 1:
        left[1] += 1.0


@njit(cache=True, error_model="numpy", nogil=True)
def _basis(T, order, xi, spans, values):
    n_control = T.shape[1] - order
    for q in range(xi.size):
        spans[q] = find_span(T[q], order, n_control, xi[q])
        basis_values(T[q], order, spans[q], xi[q], values[q])


@njit(cache=True, error_model="numpy")
def _basis_jacobians(T, order, xi, spans, jacobians):
    n_control = T.shape[1] - order
    for q in range(xi.size):
        spans[q] = find_span(T[q], order, n_control, xi[q])
        basis_jacobian(T[q], order, spans[q], xi[q], jacobians[q])


@njit(cache=True, error_model="numpy")
def _basis_jets(T, order, xi, spans, jets):
    n_control = T.shape[1] - order
    work = np.empty((3, T.shape[2]))
    for q in range(xi.size):
        spans[q] = find_span(T[q, :, 0], order, n_control, xi[q])
        basis_jets_at(T[q], order, spans[q], xi[q], jets[q], work)


def _as_points(*parameters) -> list[np.ndarray]:
    """Return the parameters as contiguous float arrays of one common length."""
    arrays = np.broadcast_arrays(*[np.atleast_1d(np.asarray(p, dtype=float)) for p in parameters])
    return [np.ascontiguousarray(a) for a in arrays]


def basis(knots, xi, s=0.0, t=0.0) -> tuple[np.ndarray, np.ndarray]:
    """Basis functions at points, Eq. (4).

    Parameters
    ----------
    knots : Knots
        Knots of this direction, see `bspline_mdao.splines.knots`.
    xi : array_like, shape (n,)
        Parameter of this direction.
    s, t : array_like, shape (n,), optional
        The other two parameters, in cyclic order. Constant knots do not look at them.

    Returns
    -------
    spans : ndarray of int, shape (n,)
        Span of each point; the functions that differ from zero are ``span - p + 1 .. span``.
    values : ndarray, shape (n, p)
        Their values.

    Examples
    --------
    >>> from bspline_mdao.splines.knots import ConstantKnots
    >>> spans, values = basis(ConstantKnots.uniform(n_control=5, order=3), [0.0, 0.5])
    >>> spans
    array([2, 3])
    >>> values
    array([[1.   , 0.   , 0.   ],
           [0.125, 0.75 , 0.125]])
    """
    xi, s, t = _as_points(xi, s, t)
    spans, values = np.empty(xi.size, dtype=np.int64), np.empty((xi.size, knots.order))
    _basis(knots.values(s, t), knots.order, xi, spans, values)
    return spans, values


def basis_jacobians(knots, xi, s=0.0, t=0.0) -> tuple[np.ndarray, np.ndarray]:
    """Differentiate the basis functions in the parameter and in the local knots.

    Parameters
    ----------
    knots, xi, s, t
        As for `basis`.

    Returns
    -------
    spans : ndarray of int, shape (n,)
        Span of each point.
    jacobians : ndarray, shape (n, p, 2p - 1)
        Derivatives in ``xi`` (column 0) and in ``T[span-p+2+m]`` (column ``1 + m``).
    """
    xi, s, t = _as_points(xi, s, t)
    p = knots.order
    spans, jacobians = np.empty(xi.size, dtype=np.int64), np.empty((xi.size, p, 2 * p - 1))
    _basis_jacobians(knots.values(s, t), p, xi, spans, jacobians)
    return spans, jacobians


def basis_jets(knots, xi, s=0.0, t=0.0, degree: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Basis functions with their derivatives in ``(xi, s, t)``, through the knots as well.

    Parameters
    ----------
    knots, xi, s, t
        As for `basis`.
    degree : int
        Highest derivative: 0, 1 or 2.

    Returns
    -------
    spans : ndarray of int, shape (n,)
        Span of each point.
    jets : ndarray, shape (n, p, 1 or 4 or 10)
        Jets of the functions, see `bspline_mdao.splines.jets`.
    """
    xi, s, t = _as_points(xi, s, t)
    spans, jets = np.empty(xi.size, dtype=np.int64), np.empty((xi.size, knots.order, JET_SIZES[degree]))
    _basis_jets(_knot_jets(knots, s, t, degree), knots.order, xi, spans, jets)
    return spans, jets


def _knot_jets(knots, s, t, degree: int) -> np.ndarray:
    """Jets of the knots in ``(xi, s, t)``, shape (n, N + p, size); they do not depend on ``xi``."""
    jets = np.zeros((s.size, knots.n_control + knots.order, JET_SIZES[degree]))
    jets[..., 0] = knots.values(s, t)
    if degree > 0:
        jets[..., 2:4] = knots.gradients(s, t)
    if degree > 1:
        jets[..., 7:10] = knots.hessians(s, t)
    return jets
