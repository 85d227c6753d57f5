"""Pressures and forces on the walls, and the entropy that leaves through the far field."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .discretization import Discretization
from .gas import GAMMA
from .stencil import MEAN

__all__ = ["EntropyDrag", "WallPressure"]


@dataclass(frozen=True, eq=False)
class WallPressure:
    """Pressure coefficients on the wall faces, from the pressures that their fluxes have.

    Parameters
    ----------
    cells : ndarray of int, shape (n_wall, 3)
        Cells that the pressure of a face is extrapolated from.
    weights : ndarray, shape (n_wall, 3)
        Their weights.
    """

    cells: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, discretization: Discretization) -> WallPressure:
        """Take cells and weights from the stencils of the walls."""
        stencil, wall = discretization.stencil, discretization.faces.faces_of("wall")
        weights = stencil.weights[stencil.classes[wall], MEAN]
        return cls(stencil.cells[wall, :3], weights[:, :3])

    def evaluate(self, states: np.ndarray, mach) -> np.ndarray:
        """Pressure coefficients, shape (n_wall,), of states, shape (n_cells, 5), at a Mach number."""
        pressures = np.sum(self.weights * states[self.cells, 4], axis=1)
        return (pressures - 1.0 / GAMMA) / (0.5 * mach**2)

    def jvp(self, states: np.ndarray, mach, d_states: np.ndarray, d_mach) -> np.ndarray:
        """Change of the coefficients with the states and the Mach number."""
        d_pressures = np.sum(self.weights * d_states[self.cells, 4], axis=1)
        return d_pressures / (0.5 * mach**2) - 2.0 * d_mach / mach * self.evaluate(states, mach)

    def vjp(self, states: np.ndarray, mach, bar: np.ndarray) -> tuple[np.ndarray, float]:
        """Apply the transpose of `jvp`: derivatives in the states and in the Mach number."""
        states_bar = np.zeros_like(states)
        np.add.at(states_bar[:, 4], self.cells, self.weights * bar[:, None] / (0.5 * mach**2))
        return states_bar, -2.0 / mach * (bar @ self.evaluate(states, mach))


@dataclass(frozen=True, eq=False)
class EntropyDrag:
    """Drag of the entropy that leaves through the far field (Oswatitsch), by the dynamic pressure (m^2).

    In flow without shocks there should be none. What there is comes from the errors of the discretization, those that
    wear trailing vortices down included: their part of the induced drag is in the entropy as well, so that the two do
    not add up to the drag of the pressures.

    Parameters
    ----------
    cells : ndarray of int, shape (n_far,)
        Cells at the far field.
    """

    cells: np.ndarray

    @classmethod
    def of(cls, discretization: Discretization) -> EntropyDrag:
        """Take the cells at the far field."""
        return cls(discretization.faces.left[discretization.faces.faces_of("farfield")])

    def evaluate(self, states: np.ndarray, areas: np.ndarray, mach):
        """Drag of states, shape (n_cells, 5), through faces with area vectors (m^2), shape (n_far, 3)."""
        w = states[self.cells]
        return np.sum(w[:, 0] * _dot(w[:, 1:4], areas) * _entropy(w)) / _scale(mach)

    def jvp(self, states, areas, mach, d_states, d_areas, d_mach):
        """Change of the drag with the states, the area vectors and the Mach number."""
        states_bar, areas_bar, mach_bar = self._gradients(states, areas, mach)
        return np.sum(states_bar * d_states[self.cells]) + np.sum(areas_bar * d_areas) + mach_bar * d_mach

    def vjp(self, states, areas, mach, bar: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Derivatives in the states, the area vectors and the Mach number, times a number."""
        gradient, areas_bar, mach_bar = self._gradients(states, areas, mach)
        states_bar = np.zeros_like(states)
        np.add.at(states_bar, self.cells, bar * gradient)
        return states_bar, bar * areas_bar, bar * mach_bar

    def _gradients(self, states, areas, mach):
        """Derivatives in the states of the cells, shape (n_far, 5), the area vectors and the Mach number."""
        w, scale = states[self.cells], _scale(mach)
        rho, entropy, through = w[:, 0], _entropy(w), _dot(w[:, 1:4], areas)
        by_state = np.empty_like(w)
        by_state[:, 0] = through * (entropy - GAMMA)
        by_state[:, 1:4] = (rho * entropy)[:, None] * areas
        by_state[:, 4] = rho * through / w[:, 4]
        areas_bar = (rho * entropy)[:, None] * w[:, 1:4] / scale
        return by_state / scale, areas_bar, -3.0 / mach * self.evaluate(states, areas, mach)


def _entropy(w: np.ndarray) -> np.ndarray:
    """Entropy above that of the free stream, by the specific heat at constant volume."""
    return np.log(GAMMA * w[:, 4]) - GAMMA * np.log(w[:, 0])


def _scale(mach):
    """Dynamic pressure times speed by the temperature of the stream and the specific heat at constant volume."""
    return 0.5 * mach**3 * GAMMA * (GAMMA - 1.0)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.sum(a * b, axis=1)
