r"""Flux through one face: a central one, and dissipation by the matrix of Roe.

With the mean state :math:`\bar w = (\rho, u, p)` at the face, the jump :math:`\delta w` that is dissipated, and the
area vector S, all speeds are times the area: :math:`U = u \cdot S`, :math:`A = a |S|`,

.. math::
    G = \begin{pmatrix} \rho U \\ \rho U u + p S \\ \rho U H \end{pmatrix} - \frac12 \left(
        \lambda_0 \, \delta \begin{pmatrix} \rho \\ \rho u \\ \rho E \end{pmatrix}
        + Q \begin{pmatrix} \rho \\ \rho u \\ \rho H \end{pmatrix}
        + P \begin{pmatrix} 0 \\ S \\ U \end{pmatrix} \right),

    P = f \sigma \rho \, \delta U / |S|^2 + \Delta \, \delta p / A, \quad
    Q = \sigma \, \delta p / (\rho a^2) + \Delta \, \delta U / A,

with :math:`\sigma = (\lambda_+ + \lambda_-)/2 - \lambda_0` and :math:`\Delta = (\lambda_+ - \lambda_-)/2` of the
moduli :math:`\lambda = \sqrt{x^2 + (\epsilon A)^2}` of :math:`U` and :math:`U \pm A`, rounded off by an entropy fix:
with f = 1 the product of Roe's absolute Jacobian with the jump, and differentiable everywhere. The factor
:math:`f = M^2 / \sqrt{1 + M^4}` of the local Mach number M keeps jumps of the normal velocity from being dissipated at
the speed of sound where the flow is slow, as about stagnation points: that costs most of the spurious drag. At shocks
it is blended into one, and the flux of the mean state into the products of means of mass flux, velocity and total
enthalpy: across a steady shock the first and the last are constant, so that nothing is left to overshoot.

References
----------
P. L. Roe, "Approximate Riemann solvers, parameter vectors, and difference schemes", J. Comput. Phys. 43 (1981),
357-372. J. M. Weiss and W. A. Smith, "Preconditioning applied to variable and constant density flows", AIAA J. 33
(1995), 2050-2057, for this form of the product. F. Rieper, "A low-Mach number fix for Roe's approximate Riemann
solver", J. Comput. Phys. 230 (2011), 5263-5287, for the factor, there min(1, M).

Theory: ``docs/theory/euler.rst`` and ``docs/theory/euler_transonic.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .gas import GAMMA

ROUNDING = 0.05
"""Wave speeds below this part of the speed of sound are rounded off: epsilon of the entropy fix, which keeps the flux
differentiable."""

_CV = 1.0 / (GAMMA - 1.0)
"""Specific heat at constant volume relative to the gas constant: internal energy per volume divided by pressure."""


@njit(cache=True, error_model="numpy")
def face_flux(w, j, s, shock=0.0):
    """Flux of mass, momentum and energy through a face, as in the docstring of this module, with its names.

    Parameters
    ----------
    w, j : tuple of five
        Mean state and jump.
    s : tuple of three
        Area vector, not zero.
    shock : float
        Sensor of shocks, from 0 to 1, by which f is blended into one.
    """
    r, u, p = w[0], (w[1], w[2], w[3]), w[4]
    jr, ju, jp = j[0], (j[1], j[2], j[3]), j[4]
    U, jU, q2, s2, x = _dot(u, s), _dot(ju, s), _dot(u, u), _dot(s, s), 0.25 * shock
    through = r * U + x * jr * jU
    T = (r * p - x * jr * jp) / (r * r - x * jr * jr)
    H = GAMMA * _CV * T + 0.5 * (q2 + x * _dot(ju, ju))
    A = np.sqrt(GAMMA * p / r * s2)
    k = (ROUNDING * A) ** 2
    l0, lp, lm = np.sqrt(U * U + k), np.sqrt((U + A) ** 2 + k), np.sqrt((U - A) ** 2 + k)
    sigma, delta = 0.5 * (lp + lm) - l0, 0.5 * (lp - lm)
    m2 = q2 * r / (GAMMA * p)
    low = m2 / np.sqrt(1.0 + m2 * m2)
    g = sigma * r * (low + shock * (1.0 - low))
    P = g * jU / s2 + delta * jp / A
    Q = sigma * jp / (GAMMA * p) + delta * jU / A
    m = through - 0.5 * (l0 * jr + r * Q)
    push, drag = p - 0.5 * P, 0.5 * l0 * r
    energy = H * (through - 0.5 * r * Q) - 0.5 * (l0 * (jp * _CV + 0.5 * q2 * jr + r * _dot(u, ju)) + P * U)
    return (
        m,
        m * u[0] + push * s[0] - drag * ju[0],
        m * u[1] + push * s[1] - drag * ju[1],
        m * u[2] + push * s[2] - drag * ju[2],
        energy,
    )


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract", "nnan", "nsz"})
def face_flux_jvp(w, j, s, shock, dw, dj, ds, dshock):
    """Change of the flux with the mean state, the jump, the area vector and the sensor of shocks.

    Inlined, and allowed to take 0 x for 0: for constant directions most of it goes.
    """
    r, u, p = w[0], (w[1], w[2], w[3]), w[4]
    jr, ju, jp = j[0], (j[1], j[2], j[3]), j[4]
    dr, du, dp = dw[0], (dw[1], dw[2], dw[3]), dw[4]
    djr, dju, djp = dj[0], (dj[1], dj[2], dj[3]), dj[4]
    U, jU, q2, s2 = _dot(u, s), _dot(ju, s), _dot(u, u), _dot(s, s)
    dU, djU = _dot(du, s) + _dot(u, ds), _dot(dju, s) + _dot(ju, ds)
    dq2, ds2 = 2.0 * _dot(u, du), 2.0 * _dot(s, ds)
    x, dx = 0.25 * shock, 0.25 * dshock
    through, dthrough = r * U + x * jr * jU, dr * U + r * dU + x * (djr * jU + jr * djU) + dx * jr * jU
    product, dproduct = r * p - x * jr * jp, dr * p + r * dp - x * (djr * jp + jr * djp) - dx * jr * jp
    square, dsquare = r * r - x * jr * jr, 2.0 * (r * dr - x * jr * djr) - dx * jr * jr
    H = GAMMA * _CV * product / square + 0.5 * (q2 + x * _dot(ju, ju))
    dH = GAMMA * _CV * (dproduct - product / square * dsquare) / square
    dH += 0.5 * (dq2 + dx * _dot(ju, ju)) + x * _dot(ju, dju)
    A = np.sqrt(GAMMA * p / r * s2)
    dA = 0.5 * A * (dp / p - dr / r + ds2 / s2)
    k, dk = (ROUNDING * A) ** 2, ROUNDING**2 * A * dA
    l0, lp, lm = np.sqrt(U * U + k), np.sqrt((U + A) ** 2 + k), np.sqrt((U - A) ** 2 + k)
    dl0, dlp, dlm = (U * dU + dk) / l0, ((U + A) * (dU + dA) + dk) / lp, ((U - A) * (dU - dA) + dk) / lm
    sigma, delta = 0.5 * (lp + lm) - l0, 0.5 * (lp - lm)
    dsigma, ddelta = 0.5 * (dlp + dlm) - dl0, 0.5 * (dlp - dlm)
    m2 = q2 * r / (GAMMA * p)
    dm2 = (dq2 * r + q2 * dr) / (GAMMA * p) - m2 * dp / p
    c = 1.0 / np.sqrt(1.0 + m2 * m2)
    factor, dfactor = m2 * c + shock * (1.0 - m2 * c), (1.0 - shock) * c**3 * dm2 + (1.0 - m2 * c) * dshock
    g, dg = sigma * r * factor, (dsigma * r + sigma * dr) * factor + sigma * r * dfactor
    P = g * jU / s2 + delta * jp / A
    dP = (dg * jU + g * (djU - jU * ds2 / s2)) / s2
    dP += (ddelta * jp + delta * djp - delta * jp * dA / A) / A
    Q = sigma * jp / (GAMMA * p) + delta * jU / A
    dQ = (dsigma * jp + sigma * djp - sigma * jp * dp / p) / (GAMMA * p)
    dQ += (ddelta * jU + delta * djU - delta * jU * dA / A) / A
    m = through - 0.5 * (l0 * jr + r * Q)
    dm = dthrough - 0.5 * (dl0 * jr + l0 * djr + dr * Q + r * dQ)
    push, drag = p - 0.5 * P, 0.5 * l0 * r
    dpush, ddrag = dp - 0.5 * dP, 0.5 * (dl0 * r + l0 * dr)
    loss = jp * _CV + 0.5 * q2 * jr + r * _dot(u, ju)
    dloss = djp * _CV + 0.5 * (dq2 * jr + q2 * djr) + dr * _dot(u, ju) + r * (_dot(du, ju) + _dot(u, dju))
    denergy = dH * (through - 0.5 * r * Q) + H * (dthrough - 0.5 * (dr * Q + r * dQ))
    denergy -= 0.5 * (dl0 * loss + l0 * dloss + dP * U + P * dU)
    return (
        dm,
        dm * u[0] + m * du[0] + dpush * s[0] + push * ds[0] - ddrag * ju[0] - drag * dju[0],
        dm * u[1] + m * du[1] + dpush * s[1] + push * ds[1] - ddrag * ju[1] - drag * dju[1],
        dm * u[2] + m * du[2] + dpush * s[2] + push * ds[2] - ddrag * ju[2] - drag * dju[2],
        denergy,
    )


ZERO, STILL = (0.0,) * 5, (0.0,) * 3
"""No change of a state, nor of an area vector."""

_UNIT = tuple(tuple(float(n == m) for n in range(5)) for m in range(5))


@njit(cache=True, error_model="numpy", nogil=True)
def state_jacobian(mean, jump, s, sigma, jacobian):
    """Fill in the derivatives of the flux with respect to mean state and jump, shape (5, 10).

    One after the other, and written out: what is multiplied by zero is not compiled.
    """
    _put(jacobian, 0, face_flux_jvp(mean, jump, s, sigma, _UNIT[0], ZERO, STILL, 0.0))
    _put(jacobian, 1, face_flux_jvp(mean, jump, s, sigma, _UNIT[1], ZERO, STILL, 0.0))
    _put(jacobian, 2, face_flux_jvp(mean, jump, s, sigma, _UNIT[2], ZERO, STILL, 0.0))
    _put(jacobian, 3, face_flux_jvp(mean, jump, s, sigma, _UNIT[3], ZERO, STILL, 0.0))
    _put(jacobian, 4, face_flux_jvp(mean, jump, s, sigma, _UNIT[4], ZERO, STILL, 0.0))
    _put(jacobian, 5, face_flux_jvp(mean, jump, s, sigma, ZERO, _UNIT[0], STILL, 0.0))
    _put(jacobian, 6, face_flux_jvp(mean, jump, s, sigma, ZERO, _UNIT[1], STILL, 0.0))
    _put(jacobian, 7, face_flux_jvp(mean, jump, s, sigma, ZERO, _UNIT[2], STILL, 0.0))
    _put(jacobian, 8, face_flux_jvp(mean, jump, s, sigma, ZERO, _UNIT[3], STILL, 0.0))
    _put(jacobian, 9, face_flux_jvp(mean, jump, s, sigma, ZERO, _UNIT[4], STILL, 0.0))


@njit(cache=True, error_model="numpy", nogil=True)
def area_jacobian(mean, jump, s, sigma, jacobian):
    """Fill in the derivatives of the flux with respect to the area vector, shape (5, 3)."""
    _put(jacobian, 0, face_flux_jvp(mean, jump, s, sigma, ZERO, ZERO, _UNIT[0][:3], 0.0))
    _put(jacobian, 1, face_flux_jvp(mean, jump, s, sigma, ZERO, ZERO, _UNIT[1][:3], 0.0))
    _put(jacobian, 2, face_flux_jvp(mean, jump, s, sigma, ZERO, ZERO, _UNIT[2][:3], 0.0))


@njit(cache=True, error_model="numpy", nogil=True)
def _put(jacobian, m, column):
    for n in range(5):
        jacobian[n, m] = column[n]


@njit(cache=True, error_model="numpy", inline="always")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
