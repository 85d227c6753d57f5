r"""Flux through one face: a central flux, and dissipation by Roe's matrix.

With the mean state :math:`\bar w = (\rho, u, p)` at the face, the jump :math:`\delta w` that is dissipated, and the
area vector S, all speeds are multiplied by the area: :math:`U = u \cdot S`, :math:`A = a |S|`,

.. math::
    G = \begin{pmatrix} \rho U \\ \rho U u + p S \\ \rho U H \end{pmatrix} - \frac12 \left(
        \lambda_0 \, \delta \begin{pmatrix} \rho \\ \rho u \\ \rho E \end{pmatrix}
        + Q \begin{pmatrix} \rho \\ \rho u \\ \rho H \end{pmatrix}
        + P \begin{pmatrix} 0 \\ S \\ U \end{pmatrix} \right),

    P = f \sigma \rho \, \delta U / |S|^2 + \Delta \, \delta p / A, \quad
    Q = \sigma \, \delta p / (\rho a^2) + \Delta \, \delta U / A,

with :math:`\sigma = (\lambda_+ + \lambda_-)/2 - \lambda_0` and :math:`\Delta = (\lambda_+ - \lambda_-)/2` of the
moduli :math:`\lambda = \sqrt{x^2 + (\epsilon A)^2}` of :math:`U` and :math:`U \pm A`, rounded by an entropy fix:
with f = 1 it is the product of Roe's absolute Jacobian with the jump, and differentiable everywhere. The factor
:math:`f = M^2 / \sqrt{1 + M^4}` of the local Mach number M prevents jumps of the normal velocity from being dissipated
at the speed of sound where the flow is slow, as near stagnation points, which causes most of the spurious drag. At
shocks the factor is blended into one, and the flux of the mean state into the products of means of mass flux, velocity
and total enthalpy: across a steady shock the first and the last are constant, so nothing is left to overshoot.

References
----------
P. L. Roe, "Approximate Riemann solvers, parameter vectors, and difference schemes", J. Comput. Phys. 43 (1981),
357-372. J. M. Weiss and W. A. Smith, "Preconditioning applied to variable and constant density flows", AIAA J. 33
(1995), 2050-2057, for this form of the product. F. Rieper, "A low-Mach number fix for Roe's approximate Riemann
solver", J. Comput. Phys. 230 (2011), 5263-5287, for the factor, there min(1, M).

Its derivatives are generated from it by ``tools/differentiate.py``, see `.flux_derivatives`.

Theory: ``docs/theory/euler.rst`` and ``docs/theory/euler_transonic.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .gas import GAMMA

ROUNDING = 0.05
"""Wave speeds below this fraction of the speed of sound are rounded: epsilon of the entropy fix, which keeps the flux
differentiable."""

CV = 1.0 / (GAMMA - 1.0)
"""Specific heat at constant volume relative to the gas constant: internal energy per volume divided by pressure."""


@njit(cache=True, error_model="numpy")
def face_flux(
    w: tuple,  # w, j: mean state and jump
    j: tuple,
    s: tuple,  # area vector, not zero
    shock: float = 0.0,  # sensor of shocks, from 0 to 1, by which f is blended into one
) -> tuple:
    """Flux of mass, momentum and energy through a face, as in the docstring of this module, with its names."""
    r, u, p = w[0], (w[1], w[2], w[3]), w[4]
    jr, ju, jp = j[0], (j[1], j[2], j[3]), j[4]
    U, jU, uu, ss, x = _dot(u, s), _dot(ju, s), _dot(u, u), _dot(s, s), 0.25 * shock
    through = r * U + x * jr * jU
    T = (r * p - x * jr * jp) / (r * r - x * jr * jr)
    H = GAMMA * CV * T + 0.5 * (uu + x * _dot(ju, ju))
    A = np.sqrt(GAMMA * p / r * ss)
    k = (ROUNDING * A) ** 2
    l0, lp, lm = np.sqrt(U * U + k), np.sqrt((U + A) ** 2 + k), np.sqrt((U - A) ** 2 + k)
    sigma, delta = 0.5 * (lp + lm) - l0, 0.5 * (lp - lm)
    m2 = uu * r / (GAMMA * p)
    low = m2 / np.sqrt(1.0 + m2 * m2)
    g = sigma * r * (low + shock * (1.0 - low))
    P = g * jU / ss + delta * jp / A
    Q = sigma * jp / (GAMMA * p) + delta * jU / A
    m = through - 0.5 * (l0 * jr + r * Q)
    push, drag = p - 0.5 * P, 0.5 * l0 * r
    loss = jp * CV + 0.5 * uu * jr + r * _dot(u, ju)
    energy = H * (through - 0.5 * r * Q) - 0.5 * (l0 * loss + P * U)
    return (
        m,
        m * u[0] + push * s[0] - drag * ju[0],
        m * u[1] + push * s[1] - drag * ju[1],
        m * u[2] + push * s[2] - drag * ju[2],
        energy,
    )


@njit(cache=True, error_model="numpy", inline="always")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


ZERO, STILL = (0.0,) * 5, (0.0,) * 3
"""No change of a state, nor of an area vector."""
