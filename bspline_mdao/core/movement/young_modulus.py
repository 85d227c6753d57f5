"""Stiffness laws: Young's modulus E of every element at the start of an increment, and the orthogonality measure Phi.

Section III.B of the paper, after Eq. (8). Theory: ``docs/theory/elasticity.rst``.

A law is any object with `StiffnessLaw.modulus` and its two derivative products. Its arguments are the initial points of
the whole move and the points before the increment. Only ratios of the modulus between elements matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from ...base.display import OneLine
from ...grids.cells.hexahedron import ElementMeasures, element_measures, element_measures_vjp
from ..mesh.moving_mesh import MovingMesh
from .trilinear import FLAT_CORNER, FLAT_ELEMENT, add_at_corners, regularised_array

__all__ = [
    "ConstantLaw",
    "InverseVolumeLaw",
    "OrthogonalityLaw",
    "RegularisedMeasures",
    "StiffnessLaw",
    "WallDistanceLaw",
]


class StiffnessLaw(Protocol):
    """Young's modulus of the elements as a differentiable function of the points.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import WallDistanceLaw, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> law = WallDistanceLaw(power=2.0)  # any object with its three methods is a law
    >>> law.modulus(mesh, mesh.points, mesh.points).shape == (len(mesh.elements),)
    True
    """

    def modulus(self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Modulus of every element, positive, shape (n_elements,).

        Parameters
        ----------
        mesh : MovingMesh
            Mesh to move; its baseline may decide about anything discrete.
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
        """Transpose of `modulus_jvp`: derivatives with respect to the initial points and the points."""


class _CornerLaw(OneLine):
    """A law in which the modulus of an element depends on its own corners: E = exp(a(initial) + b(points))."""

    def modulus(self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Modulus of every element."""
        raise NotImplementedError

    def _log_gradients(self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray) -> tuple:
        """Derivatives of a and of b with respect to the corners; None for one that does not depend on them."""
        raise NotImplementedError

    def modulus_jvp(
        self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray, d_initial: np.ndarray, d_points: np.ndarray
    ) -> np.ndarray:
        """Change of the modulus."""
        changes = zip(self._log_gradients(mesh, initial, points), (d_initial, d_points))
        change = sum(
            np.einsum("ecd,ecd->e", gradient, d[mesh.elements]) for gradient, d in changes if gradient is not None
        )
        return self.modulus(mesh, initial, points) * change

    def modulus_vjp(
        self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray, bar: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `modulus_jvp`."""
        log_bar = (bar * self.modulus(mesh, initial, points))[:, None, None]
        initial_bar, points_bar = (
            np.zeros_like(points)
            if gradient is None
            else add_at_corners(mesh.elements, log_bar * gradient, len(points))
            for gradient in self._log_gradients(mesh, initial, points)
        )
        return initial_bar, points_bar


@dataclass(frozen=True)
class OrthogonalityLaw(_CornerLaw):
    """The paper's law, E = Phi / (Phi^(0) V) with Phi = 1 / Q^2 and Q the product of corner triple products (III.B).

    Small elements are stiff, and so are elements that have lost orthogonality since the start of the move.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import LinearElasticity, OrthogonalityLaw, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> LinearElasticity(mesh, stiffness=OrthogonalityLaw()).stiffness
    OrthogonalityLaw()
    """

    def modulus(self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Modulus of every element, see `StiffnessLaw.modulus`."""
        at_start, now = RegularisedMeasures.at(mesh, initial), RegularisedMeasures.at(mesh, points)
        return np.exp(2.0 * (at_start.log_orthogonality - now.log_orthogonality) - now.log_volume)

    def _log_gradients(
        self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        at_start, now = RegularisedMeasures.at(mesh, initial), RegularisedMeasures.at(mesh, points)
        return at_start.gradient(2.0, 0.0), now.gradient(-2.0, -1.0)


@dataclass(frozen=True)
class InverseVolumeLaw(_CornerLaw):
    """E = V^-power Q^-shape: small elements, and optionally badly shaped ones, are stiff.

    Parameters
    ----------
    power : float
        Exponent of the volume.
    shape : float
        Exponent of the orthogonality Q, Eq. (9): none by default.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import InverseVolumeLaw, LinearElasticity, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> LinearElasticity(mesh, stiffness=InverseVolumeLaw(power=1.0)).stiffness
    InverseVolumeLaw(power=1, shape=0)
    """

    power: float = 1.0
    shape: float = 0.0

    def modulus(self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Modulus of every element, see `StiffnessLaw.modulus`."""
        measures = RegularisedMeasures.at(mesh, points)
        return np.exp(-self.power * measures.log_volume - self.shape * measures.log_orthogonality)

    def _log_gradients(self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray) -> tuple[None, np.ndarray]:
        return None, RegularisedMeasures.at(mesh, points).gradient(-self.shape, -self.power)


@dataclass(frozen=True)
class ConstantLaw(OneLine):
    """E = 1 in all elements.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import ConstantLaw, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> float(np.ptp(ConstantLaw().modulus(mesh, mesh.points, mesh.points)))  # of all elements the same
    0.0
    """

    def modulus(self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Modulus of every element, see `StiffnessLaw.modulus`."""
        return np.ones(len(mesh.elements))

    def modulus_jvp(
        self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray, d_initial: np.ndarray, d_points: np.ndarray
    ) -> np.ndarray:
        """No change: zeros, shape (n_elements,)."""
        return np.zeros(len(mesh.elements))

    def modulus_vjp(
        self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray, bar: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of a constant: zeros, shape (n_points, 3) each."""
        return np.zeros_like(points), np.zeros_like(points)


NEAR = 1e-6
"""Fraction of the mesh's size that keeps the wall distance from zero."""


@dataclass(frozen=True)
class WallDistanceLaw(OneLine):
    """E = d^-power, with d from the centre of an element to the surface point that is nearest on the baseline.

    Parameters
    ----------
    power : float
        Exponent.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import LinearElasticity, WallDistanceLaw, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> LinearElasticity(mesh, stiffness=WallDistanceLaw(power=2.0)).stiffness
    WallDistanceLaw(power=2)
    """

    power: float = 1.0

    def modulus(self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Modulus of every element, see `StiffnessLaw.modulus`."""
        _, square = self._distance(mesh, points)
        return square ** (-0.5 * self.power)

    def modulus_jvp(
        self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray, d_initial: np.ndarray, d_points: np.ndarray
    ) -> np.ndarray:
        """Change of the modulus."""
        arm, square = self._distance(mesh, points)
        d_arm = d_points[mesh.elements].mean(axis=1) - d_points[_nearest(mesh)]
        return -self.power * square ** (-0.5 * self.power - 1.0) * (arm * d_arm).sum(axis=1)

    def modulus_vjp(
        self, mesh: MovingMesh, initial: np.ndarray, points: np.ndarray, bar: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `modulus_jvp`."""
        arm, square = self._distance(mesh, points)
        arm_bar = (-self.power * bar * square ** (-0.5 * self.power - 1.0))[:, None] * arm
        at_corners = np.repeat(0.125 * arm_bar[:, None], 8, axis=1)
        points_bar = add_at_corners(mesh.elements, at_corners, len(points))
        np.subtract.at(points_bar, _nearest(mesh), arm_bar)
        return np.zeros_like(points), points_bar

    def _distance(self, mesh: MovingMesh, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vector from the nearest surface point, and its squared length."""
        arm = points[mesh.elements].mean(axis=1) - points[_nearest(mesh)]
        return arm, (arm * arm).sum(axis=1) + (NEAR * mesh.size) ** 2


@lru_cache(maxsize=8)
def _nearest(mesh: MovingMesh) -> np.ndarray:
    """Surface point nearest to every element on the baseline."""
    _, rows = cKDTree(mesh.points[mesh.surface_ids]).query(mesh.points[mesh.elements].mean(axis=1))
    return mesh.surface_ids[rows]


LEAST_ORTHOGONALITY = 1e-5
"""Number t_0 for Q, which keeps Phi = 1 / Q^2 below 4e10; otherwise K loses definiteness to round-off."""


@dataclass(frozen=True, eq=False)
class RegularisedMeasures:
    """Orthogonality and volume of all elements for the stiffness, always positive."""

    # Both are given as logarithms. Derivatives in both directions follow from the gradient of any combination of them
    # with respect to the corners.

    mesh: MovingMesh  # its baseline decides which corners are degenerate
    corners: np.ndarray  # (n_elements, 8, 3), points at the corners (m)
    measures: ElementMeasures  # triple products and volumes, not regularised
    squares: np.ndarray  # (n_elements, 3), mean squares of the four edges along each direction (m2)
    # (n_elements,), volume over the product of the three lengths: 1 in a box, less in any other element
    fullness: np.ndarray

    @classmethod
    def at(cls, mesh: MovingMesh, points: np.ndarray) -> RegularisedMeasures:
        """Measure the elements at points, shape (n_points, 3), in metres."""
        corners = points[mesh.elements]
        measures, squares = element_measures(corners, mesh.handedness, mesh.degenerate_corners), _mean_squares(corners)
        return cls(mesh, corners, measures, squares, measures.volume / np.sqrt(squares.prod(axis=1)))

    @property
    def log_orthogonality(self) -> np.ndarray:
        """Logarithm of Q, Eq. (9), with each factor and the product regularised, shape (n_elements,)."""
        factors, _ = regularised_array(self.measures.triples, FLAT_CORNER)
        return np.log(regularised_array(factors.prod(axis=1), LEAST_ORTHOGONALITY)[0])

    @property
    def log_volume(self) -> np.ndarray:
        """Logarithm of the volume, regularised relative to the product of the root-mean-square edge lengths."""
        return np.log(regularised_array(self.fullness, FLAT_ELEMENT)[0]) + 0.5 * np.log(self.squares).sum(axis=1)

    def gradient(self, orthogonality_factor: float, volume_factor: float) -> np.ndarray:
        """Gradient of a combination of both logarithms with respect to the corners, shape (n_elements, 8, 3)."""
        mesh = self.mesh
        number, slope = regularised_array(self.fullness, FLAT_ELEMENT)
        volume_bar = volume_factor * slope / (number * np.sqrt(self.squares.prod(axis=1)))
        triples_bar = orthogonality_factor * self._orthogonality_slopes()
        total = element_measures_vjp(self.corners, mesh.handedness, mesh.degenerate_corners, triples_bar, volume_bar)
        lengths_bar = volume_factor * (1.0 - self.fullness * slope / number)
        if lengths_bar.any():
            _add_length_gradients(self.corners, lengths_bar[:, None] / (4.0 * self.squares), total)
        return total

    def _orthogonality_slopes(self) -> np.ndarray:
        """Derivatives of the logarithm of Q with respect to the corner triple products."""
        factors, triple_slopes = regularised_array(self.measures.triples, FLAT_CORNER)
        product = factors.prod(axis=1)
        number, product_slope = regularised_array(product, LEAST_ORTHOGONALITY)
        return (product * product_slope / number)[:, None] * triple_slopes / factors


@njit(cache=True)
def _mean_squares(corners):
    """Mean squares of the four edges along each direction, shape (n_elements, 3)."""
    squares = np.zeros((len(corners), 3))
    for element in range(len(corners)):
        for direction in range(3):
            for start in range(8):
                end = start | 1 << direction
                for d in range(3):
                    squares[element, direction] += 0.25 * (corners[element, end, d] - corners[element, start, d]) ** 2
    return squares


@njit(cache=True)
def _add_length_gradients(corners, factors, gradient):
    """Add factors, shape (n_elements, 3), times the edges along each direction to the edges' ends."""
    for element in range(len(corners)):
        for direction in range(3):
            for start in range(8):
                end = start | 1 << direction
                for d in range(3):
                    pull = factors[element, direction] * (corners[element, end, d] - corners[element, start, d])
                    gradient[element, end, d] += pull
                    gradient[element, start, d] -= pull
