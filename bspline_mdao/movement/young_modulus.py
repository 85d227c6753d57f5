"""Stiffness laws: Young's modulus of every element at the start of an increment.

A law is any object with `StiffnessLaw.modulus` and its two derivative products; it is asked with the initial points of
the whole move and the points before the increment. Only ratios of the modulus between elements matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree

from ..mesh.moving_mesh import MovingMesh
from .element_corners import add_at_corners, contract
from .element_measures import FlooredMeasures

__all__ = ["ConstantLaw", "InverseVolumeLaw", "OrthogonalityLaw", "StiffnessLaw", "WallDistanceLaw"]


class StiffnessLaw(Protocol):
    """Young's modulus of the elements as a differentiable function of the points."""

    def modulus(self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Modulus of every element, positive, shape (n_elements,).

        Parameters
        ----------
        mesh : MovingMesh
            What is moved; its baseline may decide what is discrete.
        initial, points : ndarray, shape (n_points, 3)
            Points before the whole move and before the increment (m).
        """

    def modulus_jvp(
        self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray, d_initial: np.ndarray, d_points: np.ndarray
    ) -> np.ndarray:
        """Change of the modulus."""

    def modulus_vjp(
        self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray, bar: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `modulus_jvp`: derivatives by the initial points and the points."""


class _CornerLaw:
    """A law in which the modulus of an element depends on its own corners: E = exp(a(initial) + b(points))."""

    def modulus_jvp(self, mesh, initial, points, d_initial, d_points):
        """Change of the modulus."""
        changes = zip(self._log_gradients(mesh, initial, points), (d_initial, d_points))
        change = sum(contract(gradient, mesh.elements, d) for gradient, d in changes if gradient is not None)
        return self.modulus(mesh, initial, points) * change

    def modulus_vjp(self, mesh, initial, points, bar):
        """Transpose of `modulus_jvp`."""
        log_bar = (bar * self.modulus(mesh, initial, points))[:, None, None]
        return tuple(
            np.zeros_like(points)
            if gradient is None
            else add_at_corners(mesh.elements, log_bar * gradient, len(points))
            for gradient in self._log_gradients(mesh, initial, points)
        )


@dataclass(frozen=True)
class OrthogonalityLaw(_CornerLaw):
    """The paper's law, E = Phi / (Phi^(0) V) with Phi = 1 / Q^2 and Q the product of corner triple products (III.B).

    Small elements are stiff, and so are those that have lost orthogonality since the start of the move.
    """

    def modulus(self, mesh, initial, points):
        """See `StiffnessLaw.modulus`."""
        at_start, now = FlooredMeasures(mesh, initial), FlooredMeasures(mesh, points)
        return np.exp(2.0 * (at_start.log_orthogonality - now.log_orthogonality) - now.log_volume)

    def _log_gradients(self, mesh, initial, points):
        at_start, now = FlooredMeasures(mesh, initial), FlooredMeasures(mesh, points)
        return at_start.gradient(2.0, 0.0), now.gradient(-2.0, -1.0)


@dataclass(frozen=True)
class InverseVolumeLaw(_CornerLaw):
    """E = V^-power: small elements are stiff.

    Parameters
    ----------
    power : float
        Exponent.
    """

    power: float = 1.0

    def modulus(self, mesh, initial, points):
        """See `StiffnessLaw.modulus`."""
        return np.exp(-self.power * FlooredMeasures(mesh, points).log_volume)

    def _log_gradients(self, mesh, initial, points):
        return None, FlooredMeasures(mesh, points).gradient(0.0, -self.power)


@dataclass(frozen=True)
class ConstantLaw:
    """E = 1 in all elements."""

    def modulus(self, mesh, initial, points):
        """See `StiffnessLaw.modulus`."""
        return np.ones(len(mesh.elements))

    def modulus_jvp(self, mesh, initial, points, d_initial, d_points):
        """Zero."""
        return np.zeros(len(mesh.elements))

    def modulus_vjp(self, mesh, initial, points, bar):
        """Zero."""
        return np.zeros_like(points), np.zeros_like(points)


NEAR = 1e-6
"""The wall distance is kept from zero by this part of the mesh's size."""


@dataclass(frozen=True)
class WallDistanceLaw:
    """E = d^-power, d from the centre of an element to the surface point that is nearest on the baseline.

    Parameters
    ----------
    power : float
        Exponent.
    """

    power: float = 1.0

    def modulus(self, mesh, initial, points):
        """See `StiffnessLaw.modulus`."""
        _, square = self._distance(mesh, points)
        return square ** (-0.5 * self.power)

    def modulus_jvp(self, mesh, initial, points, d_initial, d_points):
        """Change of the modulus."""
        arm, square = self._distance(mesh, points)
        d_arm = d_points[mesh.elements].mean(axis=1) - d_points[_nearest(mesh)]
        return -self.power * square ** (-0.5 * self.power - 1.0) * (arm * d_arm).sum(axis=1)

    def modulus_vjp(self, mesh, initial, points, bar):
        """Transpose of `modulus_jvp`."""
        arm, square = self._distance(mesh, points)
        arm_bar = (-self.power * bar * square ** (-0.5 * self.power - 1.0))[:, None] * arm
        at_corners = np.repeat(0.125 * arm_bar[:, None], 8, axis=1)
        points_bar = add_at_corners(mesh.elements, at_corners, len(points))
        np.subtract.at(points_bar, _nearest(mesh), arm_bar)
        return np.zeros_like(points), points_bar

    def _distance(self, mesh, points):
        """Vector from the nearest surface point, and its squared length."""
        arm = points[mesh.elements].mean(axis=1) - points[_nearest(mesh)]
        return arm, (arm * arm).sum(axis=1) + (NEAR * mesh.size) ** 2


@lru_cache(maxsize=8)
def _nearest(mesh: MovingMesh) -> np.ndarray:
    """Surface point nearest to every element on the baseline."""
    _, rows = cKDTree(mesh.points[mesh.surface_ids]).query(mesh.points[mesh.elements].mean(axis=1))
    return mesh.surface_ids[rows]
