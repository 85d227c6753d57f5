"""The rotation of every element in a displacement, from the mean of its gradient.

With the gradients H(u_g) / J_g of the displacement at the Gauss points g,

    M = I + 1/8 sum over g of H(u_g) / J_g

has the nearest rotation R, by Newton's iteration if the element is not folded much deeper than it was thick, and
otherwise by the largest eigenvector of Davenport's matrix, which gives the same rotation (`rotation_group`).

Theory: ``docs/theory/rotations.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ...base.numerics.rotation_group import NO_ROTATION, nearest_rotations, nearest_to_any, rotation_changes
from ...base.numerics.vectors import scaled
from .target_gradients import TargetGradientElements, times, transposed_times
from .trilinear import (
    FAST,
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

__all__ = ["ElementRotations"]


@dataclass(frozen=True, eq=False)
class ElementRotations:
    """Rotations of the elements in a displacement, and their derivative."""

    elements: TargetGradientElements  # the elements
    parts: np.ndarray  # (n_parts, n_points, 3), the displacement (m), as a sum
    # matrices, stiffness: (n_elements, 3, 3), the rotations, and tr(S) I - S for the symmetric factor of M = R S
    matrices: np.ndarray
    stiffness: np.ndarray

    @classmethod
    def of(cls, elements: TargetGradientElements, parts: np.ndarray) -> ElementRotations:
        """Rotations in a displacement, a sum of parts, shape (n_parts, n_points, 3)."""
        seen = np.eye(3) + _mean_gradients(*_arguments(elements), parts)
        matrices, stiffness, is_fine = seen.copy(), np.empty_like(seen), np.empty(len(seen), dtype=np.bool_)
        nearest_rotations(matrices, stiffness, is_fine, (0, len(seen)))
        lost = np.flatnonzero(~is_fine)
        matrices[lost] = nearest_to_any(seen[lost])
        left = matrices[lost].transpose(0, 2, 1) @ seen[lost]
        stiffness[lost] = np.einsum("nii->n", left)[:, None, None] * np.eye(3) - 0.5 * (left + left.transpose(0, 2, 1))
        return cls(elements, parts, matrices, stiffness)

    @property
    def turns(self) -> np.ndarray:
        """R - I, shape (n_elements, 3, 3); zero if it is rounding."""
        turns = self.matrices - np.eye(3)
        turns[np.abs(turns).max(axis=(1, 2)) < NO_ROTATION] = 0.0
        return turns

    def jvp(self, d_points: np.ndarray, d_parts: np.ndarray) -> np.ndarray:
        """Change of the rotations, shape (n_elements, 3, 3), with points and displacement, as a sum of parts."""
        change = _mean_gradients_jvp(*_arguments(self.elements), self.parts, d_points, d_parts)
        rotation_changes(self.matrices, self.stiffness, change, (0, len(change)))
        return change

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`: for the points, and for the displacement as a sum of two parts."""
        back = np.array(bar, order="C")
        rotation_changes(self.matrices, self.stiffness, back, (0, len(back)))
        return _mean_gradients_vjp(*_arguments(self.elements), self.parts, back)


def _arguments(elements: TargetGradientElements) -> tuple:
    return elements.points, elements.mesh.elements, elements.mesh.handedness


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _element_gradient(f_s, u_s, sign, mean):
    """Mean of H(u) / J over the Gauss points."""
    mean[:] = 0.0
    for g in range(8):
        f = at_point(f_s, g)
        a = adjugate(f)
        divisor, _, _ = divisor_of(f, a, sign)
        h = gradient(at_point(u_s, g), a)
        for d in range(3):
            for c in range(3):
                mean[d, c] += 0.125 * sign / divisor * h[d][c]


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _element_gradient_jvp(f_s, u_s, df_s, du_s, sign, change):
    """Change of the mean."""
    change[:] = 0.0
    for g in range(8):
        f, u, df, du = at_point(f_s, g), at_point(u_s, g), at_point(df_s, g), at_point(du_s, g)
        a, da = adjugate(f), adjugate_jvp(f, df)
        divisor, jacobian_slope, length_slope = divisor_of(f, a, sign)
        d_divisor = work_of(divisor_gradient(f, a, jacobian_slope, length_slope), df)
        h, by_adjugate, by_field = gradient(u, a), gradient(u, da), gradient(du, a)
        for d in range(3):
            for c in range(3):
                total = by_adjugate[d][c] + by_field[d][c] - h[d][c] * d_divisor / divisor
                change[d, c] += 0.125 * sign / divisor * total


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _element_gradient_vjp(f_s, u_s, sign, bar, f_bar, u_bar):
    """Derivatives of the product of the mean with a matrix in the slopes of the points and of the field."""
    b = (
        (bar[0, 0], bar[0, 1], bar[0, 2]),
        (bar[1, 0], bar[1, 1], bar[1, 2]),
        (bar[2, 0], bar[2, 1], bar[2, 2]),
    )
    for g in range(8):
        f, u = at_point(f_s, g), at_point(u_s, g)
        a = adjugate(f)
        divisor, jacobian_slope, length_slope = divisor_of(f, a, sign)
        factor = 0.125 * sign / divisor
        pulls = scaled(factor, times(b, a[0])), scaled(factor, times(b, a[1])), scaled(factor, times(b, a[2]))
        a_bar = (
            scaled(factor, transposed_times(b, u[0])),
            scaled(factor, transposed_times(b, u[1])),
            scaled(factor, transposed_times(b, u[2])),
        )
        slope = -work_of(pulls, u) / divisor
        by_divisor = divisor_gradient(f, a, slope * jacobian_slope, slope * length_slope)
        put_at_point(sum_of(adjugate_vjp(f, a_bar), by_divisor), g, f_bar)
        put_at_point(pulls, g, u_bar)


@njit(cache=True)
def _mean_gradients(points, elements, signs, parts):
    """Mean gradient of a field, a sum of parts, in every element, shape (n_elements, 3, 3)."""
    means = np.empty((len(elements), 3, 3))
    f, u = np.empty((3, 3, 8)), np.empty((3, 3, 8))
    for e in range(len(elements)):
        slopes_of(points, elements[e], f)
        slopes_of_sum(parts, elements[e], u)
        _element_gradient(f, u, float(signs[e]), means[e])
    return means


@njit(cache=True)
def _mean_gradients_jvp(points, elements, signs, parts, d_points, d_parts):
    """Change of the mean gradients."""
    changes = np.empty((len(elements), 3, 3))
    f, u, df, du = np.empty((3, 3, 8)), np.empty((3, 3, 8)), np.empty((3, 3, 8)), np.empty((3, 3, 8))
    for e in range(len(elements)):
        corners = elements[e]
        slopes_of(points, corners, f)
        slopes_of_sum(parts, corners, u)
        slopes_of(d_points, corners, df)
        slopes_of_sum(d_parts, corners, du)
        _element_gradient_jvp(f, u, df, du, float(signs[e]), changes[e])
    return changes


@njit(cache=True)
def _mean_gradients_vjp(points, elements, signs, parts, bar):
    """Transpose of `_mean_gradients_jvp`: for the points, and for the field as a sum of two parts."""
    points_bar, field_bar = np.zeros_like(points), np.zeros((2, *points.shape))
    f, u, f_bar, u_bar = np.empty((3, 3, 8)), np.empty((3, 3, 8)), np.empty((3, 3, 8)), np.empty((3, 3, 8))
    for e in range(len(elements)):
        corners = elements[e]
        slopes_of(points, corners, f)
        slopes_of_sum(parts, corners, u)
        _element_gradient_vjp(f, u, float(signs[e]), bar[e], f_bar, u_bar)
        add_slopes_transposed(f_bar, corners, points_bar)
        add_slopes_transposed_to_sum(u_bar, corners, field_bar)
    return points_bar, field_bar
