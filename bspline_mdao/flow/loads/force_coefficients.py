"""Coefficients of lift, drag and moment of forces at given points.

Theory: ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np
from scipy.sparse import csr_array

from ...errors import InputError
from .stream import stream_axes

__all__ = ["ForceCoefficients", "check_references", "seen_areas"]


def check_references(area: object, chord: object, reference: Sequence[float]) -> None:
    """Refuse an invalid reference area (m^2), chord (m) and reference point of moments (m)."""
    for name, value, unit in (("area", area, "square metres"), ("chord", chord, "metres")):
        if not isinstance(value, Real) or not 0.0 < float(value) < np.inf:
            raise InputError(f"flow: reference {name} {value}; give a positive number of {unit}")
    if np.shape(reference) != (3,) or not np.isfinite(reference).all():
        raise InputError(f"flow: moment reference {reference}; give the coordinates x, y and z of a point")


def seen_areas(areas: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Areas of walls as seen along directions (m, 3), shape (m,), from area vectors of their faces (n, 3)."""
    return 0.5 * np.abs(areas @ directions.T).sum(axis=0)


@dataclass(frozen=True, eq=False)
class ForceCoefficients:
    """Coefficients of lift, ``CL``, drag, ``CD``, and moments about the axes x, y and z of the grid, ``CM``."""

    points: csr_array  # (n_forces, n_nodes), weights of the nodes of a grid in the points of application
    axes: np.ndarray  # (3, 3), rows are the directions downstream, along the span, and up
    # area, chord: reference area (m^2) and chord (m)
    area: float
    chord: float
    reference: Sequence[float]  # reference point of moments (m)

    outputs = ("CL", "CD", "CM")

    def __post_init__(self) -> None:
        check_references(self.area, self.chord, self.reference)

    def evaluate(
        self,
        forces: np.ndarray,  # (n_forces, 3), forces divided by the dynamic pressure (m^2)
        nodes: np.ndarray,  # (n_nodes, 3), nodes of the grid (m)
        alpha: float,  # angle of attack (rad)
    ) -> dict[str, np.ndarray]:
        """Coefficients by name; real or complex."""
        moment = np.cross(self._arms(nodes), forces).sum(axis=0)
        return self._coefficients(self._directions(alpha) @ forces.sum(axis=0), moment)

    def jvp(
        self,
        forces: np.ndarray,
        nodes: np.ndarray,
        alpha: float,
        d_forces: np.ndarray,
        d_nodes: np.ndarray,
        d_alpha: float,
    ) -> dict[str, np.ndarray]:
        """Derivatives of `evaluate` along a direction in all of its arguments."""
        d_moment = np.cross(self._arms(nodes), d_forces) + np.cross(self.points @ d_nodes, forces)
        turned = d_alpha * (self._slopes(alpha) @ forces.sum(axis=0))
        return self._coefficients(self._directions(alpha) @ d_forces.sum(axis=0) + turned, d_moment.sum(axis=0))

    def vjp(
        self, forces: np.ndarray, nodes: np.ndarray, alpha: float, bars: dict
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Apply the transpose of `jvp` to derivatives with respect to some of the coefficients, by name."""
        # Returns derivatives with respect to the forces, shape (n_forces, 3), the nodes, shape (n_nodes, 3), and the
        # angle (1/rad).
        force_bar = np.hstack([bars.get("CL", 0.0), bars.get("CD", 0.0)]) / self.area
        moment_bar = bars.get("CM", np.zeros(3)) / (self.area * self.chord)
        forces_bar = force_bar @ self._directions(alpha) + np.cross(moment_bar, self._arms(nodes))
        nodes_bar = self.points.T @ np.cross(forces, moment_bar)
        return forces_bar, nodes_bar, force_bar @ self._slopes(alpha) @ forces.sum(axis=0)

    def _arms(self, nodes: np.ndarray) -> np.ndarray:
        return self.points @ nodes - np.asarray(self.reference)

    def _directions(self, alpha: float) -> np.ndarray:
        """Directions of lift and of drag, shape (2, 3)."""
        return stream_axes(alpha, self.axes)[::-1]

    def _slopes(self, alpha: float) -> np.ndarray:
        """Derivatives of the directions with respect to the angle."""
        drag, lift = stream_axes(alpha, self.axes)
        return np.stack([-drag, lift])

    def _coefficients(self, force: np.ndarray, moment: np.ndarray) -> dict[str, np.ndarray]:
        return {"CL": force[0] / self.area, "CD": force[1] / self.area, "CM": moment / self.chord / self.area}
