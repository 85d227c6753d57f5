"""The condition at walls, and the resulting flux through a face: kernels take fluxes of all faces from here.

Nothing flows through a wall, and inviscid flow slips along it. So its flux is due to the pressure only, ``(0, p S,
0)``, with the pressure p of the mean state, which is extrapolated to the wall, see `.reconstruction`. Planes of
symmetry are such walls. The fluxes through all other faces are in `.flux`.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from numba import njit

from .flux import face_flux
from .flux_derivatives import face_flux_jvp, face_flux_vjp
from .gas import N_STATES
from .reconstruction import SLIP

__all__ = ["flux_through", "flux_through_jvp", "flux_through_vjp", "state_jacobian"]

_UNIT = tuple(tuple(float(n == m) for n in range(N_STATES)) for m in range(N_STATES))


@njit(cache=True, error_model="numpy", forceinline=True)
def is_wall(role):
    """Whether nothing flows through a face."""
    return role == SLIP


@njit(cache=True, error_model="numpy", forceinline=True)
def flux_through(role, mean, jump, s, sigma):
    """Flux through a face of a role, see `face_flux`."""
    if is_wall(role):
        p, zero = mean[4], 0.0 * mean[4]
        return zero, p * s[0], p * s[1], p * s[2], zero
    return face_flux(mean, jump, s, sigma)


@njit(cache=True, error_model="numpy", forceinline=True)
def flux_through_jvp(role, mean, jump, s, sigma, d_mean, d_jump, ds, d_sigma):
    """Change of the flux, see `face_flux_jvp`."""
    if is_wall(role):
        p, dp, zero = mean[4], d_mean[4], 0.0 * d_mean[4]
        return zero, dp * s[0] + p * ds[0], dp * s[1] + p * ds[1], dp * s[2] + p * ds[2], zero
    return face_flux_jvp(mean, jump, s, sigma, d_mean, d_jump, ds, d_sigma)


@njit(cache=True, error_model="numpy", forceinline=True)
def flux_through_vjp(role, mean, jump, s, sigma, bar):
    """Transpose of `flux_through_jvp`, see `face_flux_vjp`."""
    if is_wall(role):
        p, push, none = mean[4], bar[1] * s[0] + bar[2] * s[1] + bar[3] * s[2], 0.0 * mean[4]
        by_state, by_area = (none, none, none, none, push), (p * bar[1], p * bar[2], p * bar[3])
        return by_state, (none, none, none, none, none), by_area, none
    return face_flux_vjp(mean, jump, s, sigma, bar)


@njit(cache=True, error_model="numpy", nogil=True)
def state_jacobian(role, mean, jump, s, sigma, jacobian):
    """Fill in the derivatives of the flux with respect to mean state and jump, shape (5, 10)."""
    # Row by row, and written out: multiplications by zero are not compiled.
    if is_wall(role):
        jacobian[:] = 0.0
        for n in range(3):
            jacobian[1 + n, 4] = s[n]
        return
    _put(jacobian[0], face_flux_vjp(mean, jump, s, sigma, _UNIT[0]))
    _put(jacobian[1], face_flux_vjp(mean, jump, s, sigma, _UNIT[1]))
    _put(jacobian[2], face_flux_vjp(mean, jump, s, sigma, _UNIT[2]))
    _put(jacobian[3], face_flux_vjp(mean, jump, s, sigma, _UNIT[3]))
    _put(jacobian[4], face_flux_vjp(mean, jump, s, sigma, _UNIT[4]))


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _put(row, bars):
    for m in range(N_STATES):
        row[m], row[N_STATES + m] = bars[0][m], bars[1][m]
