"""Moments about axes: the bending moment at the root of a wing, and hinge moments of control surfaces.

The faces of a control surface are determined on the baseline and kept.

Theory: ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from ...base.display import OneLine

__all__ = ["AxisMoment", "HingeLoads", "hinge_moment", "hinge_moment_rates"]


@dataclass(frozen=True, eq=False)
class AxisMoment(OneLine):
    """Coefficient of the moment of some forces about an axis, positive by the right-hand rule from its first point."""

    points: csr_array  # (n_forces, n_nodes), weights of the nodes of a grid in the points of application
    weights: np.ndarray  # (n_forces,), fraction of each force that counts
    # (2, n_nodes), weights of the nodes in the two points of the axis; none if it does not move with the grid
    ends: csr_array
    offsets: np.ndarray  # (2, 3), added to these (m)
    volume: float  # reference area times reference chord (m^3)

    @classmethod
    def about_fixed(cls, points: csr_array, weights: np.ndarray, axis: Sequence, volume: float) -> AxisMoment:
        """Take a fixed axis, given by two points (m), shape (2, 3)."""
        none = csr_array((2, points.shape[1]))
        return cls(points, weights, none, np.array(axis, dtype=float), volume)

    @classmethod
    def bending(
        cls,
        points: csr_array,  # (n_forces, n_nodes), see above
        nodes: np.ndarray,  # (n_nodes, 3), baseline nodes (m), which determine the side of each force
        axes: np.ndarray,  # (3, 3), rows are the directions downstream, along the span, and up
        reference: ArrayLike,  # the reference point (m)
        volume: float,  # see above
    ) -> AxisMoment:
        """Take the moment that bends a wing upwards about its plane of symmetry."""
        # The axis points downstream, through span 0 and the height of the reference point; forces on both halves of a
        # whole wing add up.
        middle = np.asarray(reference, dtype=float) * (1.0 - np.abs(axes[1]))
        sides = np.sign(points @ nodes @ axes[1])
        return cls.about_fixed(points, sides, [middle, middle + np.linalg.det(axes) * axes[0]], volume)

    def evaluate(self, forces: np.ndarray, nodes: np.ndarray) -> float:
        """Coefficient of forces divided by the dynamic pressure (m^2), shape (n_forces, 3); real or complex."""
        # Nodes are the grid's (m), shape (n_nodes, 3).
        start, direction, _ = self._axis(nodes)
        arms = self.points @ nodes - start
        return self.weights @ np.cross(arms, forces) @ direction / self.volume

    def jvp(self, forces: np.ndarray, nodes: np.ndarray, d_forces: np.ndarray, d_nodes: np.ndarray) -> float:
        """Derivative of `evaluate` along a direction in both arguments."""
        start, direction, length = self._axis(nodes)
        d_ends = self.ends @ d_nodes
        d_line = d_ends[1] - d_ends[0]
        d_direction = (d_line - direction * (direction @ d_line)) / length
        arms, d_arms = self.points @ nodes - start, self.points @ d_nodes - d_ends[0]
        d_moment = self.weights @ (np.cross(arms, d_forces) + np.cross(d_arms, forces))
        return (d_moment @ direction + self.weights @ np.cross(arms, forces) @ d_direction) / self.volume

    def vjp(self, forces: np.ndarray, nodes: np.ndarray, bar: float) -> tuple[np.ndarray, np.ndarray]:
        """Apply the transpose of `jvp`: derivatives with respect to the forces and the nodes, times a number."""
        start, direction, length = self._axis(nodes)
        arms, parts = self.points @ nodes - start, bar / self.volume * self.weights[:, None]
        arms_bar = parts * np.cross(forces, direction)
        direction_bar = np.sum(parts * np.cross(arms, forces), axis=0)
        line_bar = (direction_bar - direction * (direction @ direction_bar)) / length
        ends_bar = np.stack([-line_bar - arms_bar.sum(axis=0), line_bar])
        return parts * np.cross(direction, arms), self.points.T @ arms_bar + self.ends.T @ ends_bar

    def _axis(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """First point, direction, and length of the vector between the points."""
        start, end = self.ends @ nodes + self.offsets
        length = np.sqrt(np.sum((end - start) ** 2))
        return start, (end - start) / length, length


@dataclass(frozen=True, eq=False)
class HingeLoads(OneLine):
    """Force and moment of a control surface, from which its moment about any axis follows."""

    # values are the force (m^2) and the moment about the origin below (m^3), divided by the dynamic pressure, shape
    # (6,)

    name: str  # name of the six values
    points: csr_array  # (n_forces, n_nodes), weights of the nodes of a grid in the points of application
    weights: np.ndarray  # (n_forces,), fraction of each force that counts
    origin: np.ndarray  # (3,), reference point of the moment (m)

    @property
    def outputs(self) -> tuple[str, ...]:
        """The name."""
        return (self.name,)

    def evaluate(self, forces: np.ndarray, nodes: np.ndarray, alpha: float) -> dict[str, Any]:
        """Loads of forces divided by the dynamic pressure (m^2), shape (n_forces, 3), on nodes (m); real or complex."""
        return {self.name: self._loads(forces, self.points @ nodes - self.origin)}

    def jvp(
        self,
        forces: np.ndarray,
        nodes: np.ndarray,
        alpha: float,
        d_forces: np.ndarray,
        d_nodes: np.ndarray,
        d_alpha: float,
    ) -> dict[str, Any]:
        """Derivative of `evaluate` along a direction in all of its arguments."""
        of_forces = self._loads(d_forces, self.points @ nodes - self.origin)
        turned = self.weights @ np.cross(self.points @ d_nodes, forces)
        return {self.name: of_forces + np.concatenate([np.zeros(3), turned])}

    def vjp(
        self, forces: np.ndarray, nodes: np.ndarray, alpha: float, bars: dict
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Apply the transpose of `jvp`."""
        force_bar, moment_bar = np.reshape(bars[self.name], (2, 3))
        arms, weights = self.points @ nodes - self.origin, self.weights[:, None]
        arms_bar = weights * np.cross(forces, moment_bar)
        return weights * (force_bar + np.cross(moment_bar, arms)), self.points.T @ arms_bar, 0.0

    def _loads(self, forces: np.ndarray, arms: np.ndarray) -> np.ndarray:
        return np.concatenate([self.weights @ forces, self.weights @ np.cross(arms, forces)])


def hinge_moment(
    loads: np.ndarray,  # (6,), force (m^2) and moment about the origin (m^3)
    axis: np.ndarray,  # (2, 3), two points of the axis (m)
    origin: np.ndarray,  # (3,), m
) -> complex:
    """Moment (m^3) of `HingeLoads` about an axis, by the right-hand rule from its first point to its second."""
    line = axis[1] - axis[0]
    return (loads[3:] - np.cross(axis[0] - origin, loads[:3])) @ line / np.sqrt(np.sum(line**2))


def hinge_moment_rates(loads: np.ndarray, axis: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of `hinge_moment` with respect to the loads, shape (6,), and to the points of the axis, (2, 3)."""
    line = axis[1] - axis[0]
    length = np.sqrt(np.sum(line**2))
    line, arm = line / length, axis[0] - origin
    moment = loads[3:] - np.cross(arm, loads[:3])
    of_second = (moment - line * (moment @ line)) / length
    return np.concatenate([np.cross(arm, line), line]), np.stack([-of_second - np.cross(loads[:3], line), of_second])
