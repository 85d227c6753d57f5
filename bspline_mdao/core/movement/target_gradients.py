"""Fields whose gradients are as near as possible to target matrices, one for each element.

For a field u and the target G, the deviation of an element is the gradient of u - G x, with G constant. With the slopes
z_i of this difference, its gradient H(z) / J as in `bspline_mdao.core.movement.elasticity`, and one modulus E for each
element, the sum over elements and their 2 x 2 x 2 Gauss points of

    w = E / (16 J) T(H(z)) : H(z),        T(H) = alpha H + lambda tr(H) I + mu (H + H^T),

is least where the force F(u; G), its derivative with respect to u, vanishes at all free points. T weighs the deviation
of the gradient from G: all of it by alpha, and its elastic strain by lambda and mu. With alpha only, the matrix K of F
is a Laplacian for each component. F is linear in u and in G, and all derivatives follow from this one expression. J is
regularised as in elasticity.

The slopes are formed before they are multiplied: F is the difference of two forces that are larger by orders of
magnitude in thin elements. Fields and forces are sums of one or two parts, as for elastic elements.

Theory: ``docs/theory/rotations.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit

from ...base.display import OneLine
from ...base.numerics.vectors import add, dot, scaled
from ...base.sparse.solved_together import Task
from ...errors import MovementError
from ..mesh.moving_mesh import MovingMesh
from .equilibrium import ALL, REFINE_ABOVE, REFINE_PRODUCTS_ABOVE, Balance, Equilibrium, in_two
from .trilinear import (
    FAST,
    SLOPES,
    add_element,
    add_slopes_transposed,
    add_slopes_transposed_to_sum,
    adjugate,
    adjugate_jvp,
    adjugate_vjp,
    at_point,
    divisor_gradient,
    divisor_of,
    gradient,
    put_at_point,
    slopes_of,
    slopes_of_sum,
    sum_of,
    work_of,
)
from .young_modulus import InverseVolumeLaw

__all__ = [
    "TargetGradientElements",
    "TargetGradientField",
    "TargetGradientSystem",
    "times",
    "transposed_times",
]


@dataclass(frozen=True, eq=False)
class TargetGradientElements:
    """Elements at given points, see `bspline_mdao.core.movement.equilibrium.Balanced`. Made by `of`."""

    mesh: MovingMesh
    stiffness: InverseVolumeLaw  # the modulus as a function of the points
    law: tuple[float, float, float]  # alpha, lambda and mu
    points: np.ndarray  # (n_points, 3)
    modulus: np.ndarray  # (n_elements,)
    target: np.ndarray  # (n_elements, 3, 3), the target matrices G of the gradients

    @classmethod
    def of(
        cls, mesh: MovingMesh, stiffness: InverseVolumeLaw, law: tuple[float, float, float], points: np.ndarray
    ) -> TargetGradientElements:
        """Elements with a target of zero."""
        modulus = stiffness.modulus(mesh, points, points)
        return cls(mesh, stiffness, law, points, modulus, np.zeros((len(mesh.elements), 3, 3)))

    @property
    def _arguments(self) -> tuple:
        return self.points, self.mesh.elements, self.mesh.handedness, self.modulus, self.law

    def add_stiffness(
        self, element_rows: np.ndarray, slots: np.ndarray, data: np.ndarray, element_ids: slice | np.ndarray = ALL
    ) -> None:
        """Add the stiffness of all elements, or of some, to blocks."""
        points, elements, signs, modulus, law = self._arguments
        chosen = elements[element_ids], signs[element_ids], modulus[element_ids]
        _add_stiffness(points, *chosen, law, element_rows, slots, data)

    def force(self, displacement: np.ndarray) -> np.ndarray:
        """Force on all points: linear if the target is zero."""
        return _force(*self._arguments, self.target, displacement)

    def force_jvp(self, displacement: np.ndarray, d_points: np.ndarray, d_target: np.ndarray | None) -> np.ndarray:
        """Change of the force of a given displacement with the points, including the modulus, and the target."""
        d_modulus = self.stiffness.modulus_jvp(self.mesh, self.points, self.points, 0.0 * d_points, d_points)
        return _force_jvp(*self._arguments, self.target, displacement, d_points, d_modulus, d_target)

    def force_vjp(self, displacement: np.ndarray, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `force_jvp` and of `force`: for the points, the target and the displacement."""
        points_bar, modulus_bar, target_bar, displacement_bar = _force_vjp(
            *self._arguments, self.target, displacement, bar
        )
        law_bar = self.stiffness.modulus_vjp(self.mesh, self.points, self.points, modulus_bar)[1]
        return points_bar + law_bar, target_bar, displacement_bar


@dataclass(frozen=True, eq=False)
class TargetGradientSystem(OneLine):
    """Elements with a target of zero, and the factor of their stiffness: one for all fields from the same points."""

    equilibrium: Equilibrium
    elements: TargetGradientElements
    factor: Any

    @classmethod
    def of(
        cls, equilibrium: Equilibrium, stiffness: InverseVolumeLaw, law: tuple[float, float, float], points: np.ndarray
    ) -> TargetGradientSystem:
        """Factorise the stiffness at points, shape (n_points, 3)."""
        elements = TargetGradientElements.of(equilibrium.mesh, stiffness, law, points)
        return cls(equilibrium, elements, equilibrium.factorized(elements))

    def field_task(self, surface_values: np.ndarray, target: np.ndarray | None = None) -> Task[TargetGradientField]:
        """Solve for the field with given values, shape (n_surface, 3), on the surface; zero if nothing is free."""
        elements = self.elements if target is None else replace(self.elements, target=target)
        nothing = np.zeros((1, 1, 1))
        prescribed = self.on_surface(surface_values)
        balance = yield from self.equilibrium.balance_task(elements, self.factor, prescribed, nothing, REFINE_ABOVE)
        if not np.isfinite(balance.parts).all():
            raise MovementError("movement: the displacements are not finite; take a smaller step")
        return TargetGradientField(self, elements, balance)

    def on_surface(self, surface_values: np.ndarray) -> np.ndarray:
        """Values of the surface points at all points, zero elsewhere, shape (n_points, 3)."""
        values = np.zeros((self.equilibrium.mesh.n_points, 3))
        values[self.equilibrium.mesh.surface_ids] = surface_values
        return values

    def response_task(self, prescribed: np.ndarray, load: np.ndarray) -> Task[np.ndarray]:
        """Parts of the field that is prescribed on the surface and balances a load, without a target."""
        of_factor = self.elements, self.factor
        balance = yield from self.equilibrium.balance_task(*of_factor, prescribed, load, REFINE_PRODUCTS_ABOVE)
        return balance.parts


@dataclass(frozen=True, eq=False)
class TargetGradientField:
    """A solution for a field, and its derivative."""

    system: TargetGradientSystem
    elements: TargetGradientElements
    balance: Balance

    @property
    def values(self) -> np.ndarray:
        """The field at all points, shape (n_points, 3)."""
        return self.balance.parts.sum(axis=0)

    def jvp_task(
        self, d_points: np.ndarray, d_surface_values: np.ndarray, d_target: np.ndarray | None
    ) -> Task[np.ndarray]:
        """Change of the field, shape (n_parts, n_points, 3): as a sum of parts."""
        if d_target is None:
            d_target = np.zeros_like(self.elements.target)
        d_force = self.elements.force_jvp(in_two(self.balance.parts), d_points, d_target)
        return (yield from self.system.response_task(self.system.on_surface(d_surface_values), -d_force))

    def vjp_task(self, bar: np.ndarray) -> Task[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Transpose of `jvp_task`, for a sum of parts: for the points, the values on the surface, and the target."""
        adjoint = yield from self.system.response_task(np.zeros_like(bar[0]), -bar)
        points_bar, target_bar, prescribed_bar = self.elements.force_vjp(self.balance.parts, adjoint)
        total = bar.sum(axis=0) + prescribed_bar
        return points_bar, total[self.system.equilibrium.mesh.surface_ids], target_bar


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _stress(z, a, law):
    """T(H(z)), three rows: the only statement of the law."""
    h = gradient(z, a)
    alpha, pressure, mu = law[0] + law[2], law[1] * (h[0][0] + h[1][1] + h[2][2]), law[2]
    return (
        (alpha * h[0][0] + mu * h[0][0] + pressure, alpha * h[0][1] + mu * h[1][0], alpha * h[0][2] + mu * h[2][0]),
        (alpha * h[1][0] + mu * h[0][1], alpha * h[1][1] + mu * h[1][1] + pressure, alpha * h[1][2] + mu * h[2][1]),
        (alpha * h[2][0] + mu * h[0][2], alpha * h[2][1] + mu * h[1][2], alpha * h[2][2] + mu * h[2][2] + pressure),
    )


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def times(h, v):
    """Product of a matrix of three rows with a vector."""
    return dot(h[0], v), dot(h[1], v), dot(h[2], v)


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def transposed_times(h, v):
    """Product of the transpose of a matrix of three rows with a vector."""
    return add(add(scaled(v[0], h[0]), scaled(v[1], h[1])), scaled(v[2], h[2]))


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _fluxes(tau, a, factor):
    """Derivatives of the work ``factor tau : H(v)`` with respect to the slopes v_i."""
    return scaled(factor, times(tau, a[0])), scaled(factor, times(tau, a[1])), scaled(factor, times(tau, a[2]))


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _subtract_target(f_s, target, z_s):
    """``z_i -= G f_i`` at all Gauss points."""
    for i in range(3):
        for d in range(3):
            for g in range(8):
                z_s[i, d, g] -= target[d, 0] * f_s[i, 0, g] + target[d, 1] * f_s[i, 1, g] + target[d, 2] * f_s[i, 2, g]


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _element_force(f_s, z_s, sign, weight, law, out):
    """Fluxes at the Gauss points: their transposed slopes are the force."""
    for g in range(8):
        f = at_point(f_s, g)
        a = adjugate(f)
        divisor, _, _ = divisor_of(f, a, sign)
        put_at_point(_fluxes(_stress(at_point(z_s, g), a, law), a, weight / divisor), g, out)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _element_force_jvp(f_s, z_s, df_s, dz_s, sign, weight, d_weight, law, out):
    """Change of the fluxes."""
    for g in range(8):
        f, z, df, dz = at_point(f_s, g), at_point(z_s, g), at_point(df_s, g), at_point(dz_s, g)
        a, da = adjugate(f), adjugate_jvp(f, df)
        divisor, jacobian_slope, length_slope = divisor_of(f, a, sign)
        d_divisor = work_of(divisor_gradient(f, a, jacobian_slope, length_slope), df)
        factor, tau = weight / divisor, _stress(z, a, law)
        d_tau = sum_of(_stress(z, da, law), _stress(dz, a, law))
        changes = sum_of(_fluxes(tau, a, (d_weight - factor * d_divisor) / divisor), _fluxes(d_tau, a, factor))
        put_at_point(sum_of(changes, _fluxes(tau, da, factor)), g, out)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _element_force_vjp(f_s, z_s, v_s, sign, weight, law, f_bar, z_bar):
    """Derivatives of the work of z on v with respect to f and z; returns the work over the weight."""
    total = 0.0 * weight
    for g in range(8):
        f, z, v = at_point(f_s, g), at_point(z_s, g), at_point(v_s, g)
        a = adjugate(f)
        divisor, jacobian_slope, length_slope = divisor_of(f, a, sign)
        tau_z, tau_v, factor = _stress(z, a, law), _stress(v, a, law), weight / divisor
        fluxes = _fluxes(tau_v, a, factor)
        work = work_of(fluxes, z)
        a_bar = (
            scaled(factor, add(transposed_times(tau_z, v[0]), transposed_times(tau_v, z[0]))),
            scaled(factor, add(transposed_times(tau_z, v[1]), transposed_times(tau_v, z[1]))),
            scaled(factor, add(transposed_times(tau_z, v[2]), transposed_times(tau_v, z[2]))),
        )
        divisor_slope = -work / divisor
        divisor_bar = divisor_gradient(f, a, divisor_slope * jacobian_slope, divisor_slope * length_slope)
        put_at_point(sum_of(adjugate_vjp(f, a_bar), divisor_bar), g, f_bar)
        put_at_point(fluxes, g, z_bar)
        total += work
    return total / weight


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _target_vjp(f_s, z_bar, target, f_bar, target_bar):
    """Transpose of the change of `_subtract_target` with f, added to ``f_bar``, and with G."""
    for d in range(3):
        for c in range(3):
            total = 0.0 * target[d, c]
            for i in range(3):
                for g in range(8):
                    total -= z_bar[i, d, g] * f_s[i, c, g]
                    f_bar[i, c, g] -= target[d, c] * z_bar[i, d, g]
            target_bar[d, c] = total


@njit(cache=True)
def _force(points, elements, signs, modulus, law, target, displacement):
    """Force on every point, as a sum of as many parts as the displacement."""
    total = np.zeros_like(displacement)
    f, z, fluxes = np.empty((3, 3, 8)), np.empty((3, 3, 8)), np.empty((3, 3, 8))
    for e in range(len(elements)):
        corners = elements[e]
        size = 0.0
        for d in range(3):
            for c in range(8):
                for part in range(len(displacement)):
                    size += abs(displacement[part, corners[c], d])
            for c in range(3):
                size += abs(target[e, d, c])
        if size == 0.0:  # at rest, like most elements if only the surface is displaced
            continue
        slopes_of(points, corners, f)
        slopes_of_sum(displacement, corners, z)
        _subtract_target(f, target[e], z)
        _element_force(f, z, float(signs[e]), 0.125 * modulus[e], law, fluxes)
        add_slopes_transposed_to_sum(fluxes, corners, total)
    return total


@njit(cache=True)
def _force_jvp(points, elements, signs, modulus, law, target, displacement, d_points, d_modulus, d_target):
    """Change of `_force` for changes of the points, the modulus and the target."""
    total = np.zeros_like(displacement)
    f, z, fluxes = np.empty((3, 3, 8)), np.empty((3, 3, 8)), np.empty((3, 3, 8))
    df, dz = np.empty((3, 3, 8)), np.empty((3, 3, 8))
    for e in range(len(elements)):
        corners = elements[e]
        slopes_of(points, corners, f)
        slopes_of_sum(displacement, corners, z)
        slopes_of(d_points, corners, df)
        _subtract_target(f, target[e], z)
        dz[:] = 0.0
        _subtract_target(df, target[e], dz)
        _subtract_target(f, d_target[e], dz)
        weight, d_weight = 0.125 * modulus[e], 0.125 * d_modulus[e]
        _element_force_jvp(f, z, df, dz, float(signs[e]), weight, d_weight, law, fluxes)
        add_slopes_transposed_to_sum(fluxes, corners, total)
    return total


@njit(cache=True)
def _force_vjp(points, elements, signs, modulus, law, target, displacement, bar):
    """Transpose of `_force_jvp` and of `_force`: for the points, the modulus, the target and the displacement."""
    points_bar, displacement_bar = np.zeros_like(points), np.zeros_like(points)
    modulus_bar, target_bar = np.empty_like(modulus), np.empty_like(target)
    f, z, v = np.empty((3, 3, 8)), np.empty((3, 3, 8)), np.empty((3, 3, 8))
    f_bar, z_bar = np.empty((3, 3, 8)), np.empty((3, 3, 8))
    for e in range(len(elements)):
        corners = elements[e]
        slopes_of(points, corners, f)
        slopes_of_sum(displacement, corners, z)
        slopes_of_sum(bar, corners, v)
        _subtract_target(f, target[e], z)
        modulus_bar[e] = 0.125 * _element_force_vjp(f, z, v, float(signs[e]), 0.125 * modulus[e], law, f_bar, z_bar)
        _target_vjp(f, z_bar, target[e], f_bar, target_bar[e])
        add_slopes_transposed(f_bar, corners, points_bar)
        add_slopes_transposed(z_bar, corners, displacement_bar)
    return points_bar, modulus_bar, target_bar, displacement_bar


@njit(cache=True)
def _add_stiffness(points, elements, signs, modulus, law, rows, slots, data):
    """Add the stiffness of all elements to blocks, see `bspline_mdao.core.movement.elasticity.add_stiffness`."""
    alpha, lame, mu = law
    f, stiffness = np.empty((3, 3, 8)), np.empty((8, 8, 3, 3))
    gradients, weighted = np.empty((8, 3, 8)), np.empty((8, 3, 8))
    for e in range(len(elements)):
        slopes_of(points, elements[e], f)
        _shape_gradients(f, float(signs[e]), 0.125 * modulus[e], gradients, weighted)
        for b in range(8):
            for c in range(b + 1):
                block, trace = stiffness[b, c], 0.0
                for i in range(3):
                    for j in range(3):
                        block[i, j] = _product(weighted[b, i], gradients[c, j])
                    trace += block[i, i]
                for i in range(3):
                    for j in range(i):
                        lower, upper = block[i, j], block[j, i]
                        block[i, j], block[j, i] = lame * lower + mu * upper, lame * upper + mu * lower
                    block[i, i] = (lame + mu) * block[i, i] + (alpha + mu) * trace
        add_element(stiffness, rows[e], slots[e], data)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _shape_gradients(f_s, sign, weight, gradients, weighted):
    """Gradients of the shape functions of all corners, shape (8, 3, 8 Gauss points), times J, and times weight / J."""
    for g in range(8):
        f = at_point(f_s, g)
        a = adjugate(f)
        divisor, _, _ = divisor_of(f, a, sign)
        for c in range(8):
            for d in range(3):
                value = a[0][d] * SLOPES[g, 0, c] + a[1][d] * SLOPES[g, 1, c] + a[2][d] * SLOPES[g, 2, c]
                gradients[c, d, g], weighted[c, d, g] = value, weight / divisor * value


@njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _product(p, q):
    """Sum of products at the eight Gauss points."""
    return (
        (p[0] * q[0] + p[1] * q[1])
        + (p[2] * q[2] + p[3] * q[3])
        + (p[4] * q[4] + p[5] * q[5])
        + (p[6] * q[6] + p[7] * q[7])
    )
