"""Truncated Taylor series ("jets") of functions of three variables, for use inside numba kernels.

A jet is a short array: the value, then the gradient, then the upper half of the Hessian::

    degree 0:  f
    degree 1:  f, f_0, f_1, f_2
    degree 2:  f, f_0, f_1, f_2, f_00, f_01, f_02, f_11, f_12, f_22

Its length says its degree. Sums of jets are sums of arrays; products and quotients are below.
"""

from __future__ import annotations

from numba import njit

JET_SIZES = (1, 4, 10)
"""Length of a jet of degree 0, 1 and 2."""


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
