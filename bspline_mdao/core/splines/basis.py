"""B-spline basis functions, Eqs. (2) and (4): values and derivatives in the parameters and in the knots.

On the span ``T[s] <= xi < T[s+1]`` (numbered from 0) only the ``p`` functions ``s-p+1 .. s`` differ from zero. They
depend only on the ``2p - 2`` *local knots* ``T[s-p+2] .. T[s+p-1]`` and are found by the de Boor triangle: from one
order to the next each function, whose interval is [a, b], passes the fraction ``(xi - a) / (b - a)`` of its value to
its right-hand neighbour and keeps the rest. So no interval is empty, the sum stays one, and at an end of the parameter
range the end function is one to the last bit. The first and the last span continue beyond the ends. Hence ``xi = 1``,
and a parameter that round-off has moved out of [0, 1], need no special care.

The triangle is here three times: in numbers (`raise_order`), with first derivatives in any variables that parameter
and knots depend on (`basis_derivatives`), and with second derivatives in three (`basis_jets_at`).
Theory: ``docs/theory/splines.rst``.

The functions with an ``out`` argument are called from other numba kernels, once per point. Those without it take
arrays of points and an object of `bspline_mdao.core.splines.knots`.

References
----------
C. de Boor, *A Practical Guide to Splines*, Springer, 1978, chapter X.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from ...base.numerics.rows import copy_row
from .knots import BilinearKnots, ConstantKnots, Knots, bilinear_knots, bilinear_slopes

JET_SIZES = (1, 4, 10)
"""Length of a *jet*, a truncated Taylor series in three variables, of degree 0, 1 and 2: the value, then the gradient,
then the upper half of the Hessian. ``f, f_0, f_1, f_2, f_00, f_01, f_02, f_11, f_12, f_22``. Sums of jets are sums of
arrays."""


@njit(cache=True, error_model="numpy")
def find_span(
    T,  # (N + p,), knots, non-decreasing
    # order p and number of control points N
    order,  # int
    n_control,  # int
    xi,  # parameter
):
    """Span ``s`` that holds ``xi``: the last one of ``p-1 .. N-1`` with ``T[s] <= xi``, or ``p-1``."""
    low, high = order - 1, n_control - 1
    while low < high:
        middle = (low + high + 1) // 2
        if T[middle] <= xi:
            low = middle
        else:
            high = middle - 1
    return low


@njit(cache=True, error_model="numpy")
def basis_values(
    T,  # (N + p,), knots
    # order p and span
    order,  # int
    s,  # int
    xi,  # parameter
    out,  # (>= p,), receives ``N_{s-p+1} .. N_s``
):
    """Write the ``p`` basis functions that differ from zero on span ``s`` to ``out``, Eq. (2)."""
    out[0] = 1.0
    for r in range(1, order):
        raise_order(T, s, r, xi, out)


@njit(cache=True, error_model="numpy")
def raise_order(T, s, r, xi, values):
    """Take the ``r`` functions of order ``r`` on span ``s`` to the ``r + 1`` of order ``r + 1``, in place."""
    received = 0.0
    for m in range(r):
        a, b = T[s + 1 - r + m], T[s + 1 + m]
        passed = (xi - a) / (b - a) * values[m]
        values[m] += received - passed
        received = passed
    values[r] = received


@njit(cache=True, error_model="numpy", forceinline=True)
def basis_derivatives(
    T,  # (N + p,), knots
    d_T,  # (N + p, n), derivatives of the knots in the variables; only the rows of the local knots are read
    # order p and span
    order,  # int
    s,  # int
    xi,  # parameter
    # derivatives of the parameter in the variables; as a tuple its length is known to the compiler
    d_xi,  # tuple of n floats, or ndarray (n,)
    out,  # (>= p, 1 + n), receives the functions (column 0) and their derivatives
):
    """Write the ``p`` functions on span ``s`` and their derivatives in any number of variables to ``out``, Eq. (4)."""
    # The triangle of `basis_values`, differentiated step by step: the parameter and the knots may depend on the
    # variables. With ``d_T`` one in one entry of each column they are the derivatives in single knots.
    out[0, 0], out[0, 1:] = 1.0, 0.0
    for r in range(1, order):
        out[r] = 0.0
        for m in range(r - 1, -1, -1):  # downwards: what is passed on goes to the next place
            low, high = s + 1 - r + m, s + 1 + m
            per_width = 1.0 / (T[high] - T[low])
            fraction, value = (xi - T[low]) * per_width, out[m, 0]
            for n in range(len(d_xi)):
                d_fraction = (d_xi[n] - d_T[low, n] - fraction * (d_T[high, n] - d_T[low, n])) * per_width
                passed = fraction * out[m, 1 + n] + d_fraction * value
                out[m, 1 + n] -= passed
                out[m + 1, 1 + n] += passed
            out[m, 0] -= fraction * value
            out[m + 1, 0] += fraction * value


@njit(cache=True, error_model="numpy", inline="always")
def jet_product(a, b, out):
    """Write the jet of ``a b`` to ``out``, which may be ``a`` or ``b`` (so the highest derivatives go first)."""
    if out.size > 4:
        i = 4
        for k in range(1, 4):
            for l in range(k, 4):
                out[i] = a[0] * b[i] + a[k] * b[l] + a[l] * b[k] + a[i] * b[0]
                i += 1
    if out.size > 1:
        for k in range(1, 4):
            out[k] = a[0] * b[k] + a[k] * b[0]
    out[0] = a[0] * b[0]


@njit(cache=True, error_model="numpy", inline="always")
def jet_quotient(a, b, out):
    """Write the jet of ``a / b`` to ``out``, which may be ``a``: Leibniz' rule for ``out b = a``, solved."""
    reciprocal = 1.0 / b[0]
    out[0] = a[0] * reciprocal
    if out.size > 1:
        for k in range(1, 4):
            out[k] = (a[k] - out[0] * b[k]) * reciprocal
    if out.size > 4:
        i = 4
        for k in range(1, 4):
            for l in range(k, 4):
                out[i] = (a[i] - out[k] * b[l] - out[l] * b[k] - out[0] * b[i]) * reciprocal
                i += 1


@njit(cache=True, error_model="numpy")
def basis_jets_at(
    T,  # (N + p, n), jets of the knots in ``(xi, s, t)``, see `JET_SIZES`; n = 1, 4 or 10 sets the degree
    order,
    s,
    xi,
    out,  # (>= p, n), receives the jets of ``N_{s-p+1} .. N_s``, Eq. (4)
    work,  # (3, n), scratch
):
    """Write the jets of the ``p`` functions on span ``s`` to ``out``: `basis_values` in jet arithmetic."""
    # order, s, xi: as for `basis_values`
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
        copy_row(received, out[r])


@njit(cache=True, error_model="numpy")
def _interval_jets(a, b, xi, left, width):
    """Write the jets of ``xi - a`` and ``b - a``."""
    for n in range(width.size):
        left[n], width[n] = -a[n], b[n] - a[n]
    left[0] += xi
    if width.size > 1:
        left[1] += 1.0


@njit(cache=True, error_model="numpy", nogil=True)
def _values_at_points(T, order, xi, spans, values):
    """`basis_values` at points with knots of shape (n, N + p), or (1, N + p) for all."""
    n_control = T.shape[1] - order
    for q in range(xi.size):
        knots = T[min(q, T.shape[0] - 1)]
        spans[q] = find_span(knots, order, n_control, xi[q])
        basis_values(knots, order, spans[q], xi[q], values[q])


@njit(cache=True, error_model="numpy", nogil=True)
def _values_at_points_bilinear(corners, order, xi, s, t, spans, values):
    """`_values_at_points` with bilinear knots, which are evaluated point by point to stay in the cache."""
    knots = np.empty(corners.shape[2])
    for q in range(xi.size):
        bilinear_knots(corners, s[q], t[q], knots)
        spans[q] = find_span(knots, order, knots.size - order, xi[q])
        basis_values(knots, order, spans[q], xi[q], values[q])


@njit(cache=True, error_model="numpy", nogil=True)
def _gradients_at_points(T, slopes, order, direction, xi, spans, out):
    """`basis_derivatives` in (xi, eta, zeta) at points; knots of shape (n, N + p) and slopes (n, N + p, 2), or one."""
    d_T, d_xi = np.zeros((T.shape[1], 3)), (1.0 * (direction == 0), 1.0 * (direction == 1), 1.0 * (direction == 2))
    for q in range(xi.size):
        at = min(q, T.shape[0] - 1)
        spans[q] = find_span(T[at], order, T.shape[1] - order, xi[q])
        copy_row(slopes[at, :, 0], d_T[:, (direction + 1) % 3])
        copy_row(slopes[at, :, 1], d_T[:, (direction + 2) % 3])
        basis_derivatives(T[at], d_T, order, spans[q], xi[q], d_xi, out[q])


@njit(cache=True, error_model="numpy", nogil=True)
def _gradients_at_points_bilinear(corners, order, direction, xi, s, t, spans, out):
    """`_gradients_at_points` with bilinear knots."""
    knots, d_T = np.empty(corners.shape[2]), np.empty((corners.shape[2], 3))
    for q in range(xi.size):
        spans[q] = bilinear_gradients(corners, order, direction, xi[q], s[q], t[q], knots, d_T, out[q])


@njit(cache=True, error_model="numpy")
def bilinear_gradients(
    corners,  # (2, 2, N + p), knots on the four edges, Eq. (5)
    # order p, and the direction of the knots: 0, 1 or 2
    order,  # int
    direction,  # int
    # parameters of this direction and of the next two in cyclic order
    xi,
    s,
    t,
    # scratch
    knots,  # (>= N + p,)
    d_T,  # (>= N + p, 3)
    out,  # (>= p, 4), receives the functions and their derivatives in (xi, eta, zeta)
):  # int, span
    """Write functions of bilinear knots and their gradients at one point, for use inside numba kernels."""
    second, third = (direction + 1) % 3, (direction + 2) % 3
    bilinear_knots(corners, s, t, knots)
    span = find_span(knots, order, corners.shape[2] - order, xi)
    first, end = span - order + 2, span + order
    d_T[first:end, direction] = 0.0
    bilinear_slopes(corners, s, t, first, end, d_T[:, second], d_T[:, third])
    d_xi = 1.0 * (direction == 0), 1.0 * (direction == 1), 1.0 * (direction == 2)
    basis_derivatives(knots, d_T, order, span, xi, d_xi, out)
    return span


@njit(cache=True, error_model="numpy", nogil=True)
def _jets_at_points(T, order, xi, spans, jets):
    n_control = T.shape[1] - order
    work = np.empty((3, T.shape[2]))
    for q in range(xi.size):
        spans[q] = find_span(T[q, :, 0], order, n_control, xi[q])
        basis_jets_at(T[q], order, spans[q], xi[q], jets[q], work)


def _as_points(*parameters: ArrayLike) -> list[np.ndarray]:
    """Return the parameters as contiguous float arrays of one common length."""
    arrays = np.broadcast_arrays(*[np.atleast_1d(np.asarray(p, dtype=float)) for p in parameters])
    return [np.ascontiguousarray(a) for a in arrays]


def basis(knots: Knots, xi: ArrayLike, s: ArrayLike = 0.0, t: ArrayLike = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Basis functions at points, Eq. (4).

    Parameters
    ----------
    knots : BilinearKnots, ConstantKnots or FunctionKnots
        Knots of this direction.
    xi : array_like, shape (n,)
        Parameter of this direction.
    s, t : array_like, shape (n,)
        The other two parameters, in cyclic order. Constant knots ignore them.

    Returns
    -------
    spans : ndarray of int, shape (n,)
        Span of each point; the functions that differ from zero are ``span - p + 1 .. span``.
    values : ndarray, shape (n, p)
        Their values.

    Examples
    --------
    >>> from bspline_mdao.splines import ConstantKnots, basis
    >>> spans, values = basis(ConstantKnots.uniform(n_control=5, order=3), [0.0, 0.5])
    >>> spans
    array([2, 3])
    >>> values
    array([[1.   , 0.   , 0.   ],
           [0.125, 0.75 , 0.125]])
    """
    xi, s, t = _as_points(xi, s, t)
    spans, values = np.empty(xi.size, dtype=np.int64), np.empty((xi.size, knots.order))
    if isinstance(knots, BilinearKnots):
        _values_at_points_bilinear(knots.corners, knots.order, xi, s, t, spans, values)
    elif isinstance(knots, ConstantKnots):
        _values_at_points(knots.knots[None], knots.order, xi, spans, values)
    else:
        for at in _chunks(xi.size):
            _values_at_points(knots.values(s[at], t[at]), knots.order, xi[at], spans[at], values[at])
    return spans, values


def basis_gradients(
    knots: Knots,  # Knots, knots of the direction
    direction: int,  # 0, 1 or 2
    parameters: np.ndarray,  # (n, 3), parameters of the points
) -> tuple[np.ndarray, np.ndarray]:
    """Basis functions of one direction and their derivatives in all parameters, through curved knots, Eq. (4)."""
    # returns spans int (n,): span of each point
    # returns gradients (n, p, 4): values, and derivatives in xi, eta and zeta
    xi, s, t = _as_points(*(parameters[:, (direction + offset) % 3] for offset in range(3)))
    p, spans, gradients = knots.order, np.empty(xi.size, dtype=np.int64), np.empty((xi.size, knots.order, 4))
    if isinstance(knots, BilinearKnots):
        _gradients_at_points_bilinear(knots.corners, p, direction, xi, s, t, spans, gradients)
    elif isinstance(knots, ConstantKnots):
        no_slopes = np.zeros((1, knots.knots.size, 2))
        _gradients_at_points(knots.knots[None], no_slopes, p, direction, xi, spans, gradients)
    else:
        for at in _chunks(xi.size):
            T, slopes = knots.values(s[at], t[at]), knots.gradients(s[at], t[at])
            _gradients_at_points(T, slopes, p, direction, xi[at], spans[at], gradients[at])
    return spans, gradients


def _chunks(n: int) -> list[slice]:
    """Points at a time if the knots are a user's functions, small enough for these knots to stay in the cache."""
    return [slice(start, start + 4096) for start in range(0, n, 4096)]


def basis_jets(
    knots: Knots, xi: ArrayLike, s: ArrayLike = 0.0, t: ArrayLike = 0.0, degree: int = 2
) -> tuple[np.ndarray, np.ndarray]:
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
        Values, first derivatives in xi, s and t, then second derivatives in xi xi, xi s, xi t, s s, s t and t t.

    Examples
    --------
    >>> from bspline_mdao.splines import ConstantKnots, basis_jets
    >>> spans, jets = basis_jets(ConstantKnots.uniform(n_control=5, order=3), [0.5], degree=1)
    >>> jets[0, :, 1].sum().item()  # values add up to 1, and so derivatives to 0
    0.0
    """
    xi, s, t = _as_points(xi, s, t)
    spans, jets = np.empty(xi.size, dtype=np.int64), np.empty((xi.size, knots.order, JET_SIZES[degree]))
    _jets_at_points(_knot_jets(knots, s, t, degree), knots.order, xi, spans, jets)
    return spans, jets


def _knot_jets(knots: Knots, s: np.ndarray, t: np.ndarray, degree: int) -> np.ndarray:
    """Jets of the knots in ``(xi, s, t)``, shape (n, N + p, size); they do not depend on ``xi``."""
    jets = np.zeros((s.size, knots.n_control + knots.order, JET_SIZES[degree]))
    jets[..., 0] = knots.values(s, t)
    if degree > 0:
        jets[..., 2:4] = knots.gradients(s, t)
    if degree > 1:
        jets[..., 7:10] = knots.hessians(s, t)
    return jets
