"""Pairs of sides of a grid that a motion maps onto each other, declared in files or found.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.display import OneLine
from .index_space import Window

__all__ = ["SMALLEST", "Motion", "PeriodicPair"]

ALIGNED = 1e-10
"""An axis whose component along a coordinate axis differs from 1 by less than this is that axis: 1.4e-5 rad."""

SMALLEST = 1e-3
"""Rotations by less than this angle (rad), and translations by less than this fraction of the grid's size, are none."""


@dataclass(frozen=True)
class Motion:
    """A rotation about an axis, or a translation."""

    axis: tuple[float, ...] = (0.0, 0.0, 0.0)  # direction of the axis, of length 1; zero for a translation
    angle: float = 0.0  # angle of the rotation (rad)
    point: tuple[float, ...] = (0.0, 0.0, 0.0)  # the point of the axis nearest to the origin (m)
    shift: tuple[float, ...] = (0.0, 0.0, 0.0)  # the translation (m)
    unit: str = "m"  # unit of lengths

    @classmethod
    def about(
        cls,
        axis: np.ndarray,  # (3,), direction of the axis, of length 1
        angle: float,  # angle of the rotation (rad), not zero
        shift: np.ndarray,  # (3,), shift of the rotation about an axis through the origin (m)
        near: float,  # length that counts as zero (m)
    ) -> Motion | None:  # None if it is a screw
        """Make a rotation about an axis that is displaced by a shift across it."""
        number = int(np.argmax(np.abs(axis)))
        sign = float(np.sign(axis[number]))  # the same axis for a rotation and its inverse
        axis, angle = axis * sign, angle * sign
        if 1.0 - axis[number] < ALIGNED:
            axis = np.eye(3)[number]
        if abs(shift @ axis) > near:
            return None
        across = shift - (shift @ axis) * axis
        point = 0.5 * (across + np.cross(axis, across) / np.tan(0.5 * angle))
        point[np.abs(point) < near] = 0.0
        return cls(tuple(axis.tolist()), float(angle), tuple(point.tolist()))

    def __str__(self) -> str:
        if self.is_translation:
            return f"translation by {_text(self.shift)} {self.unit}"
        axis = "xyz"[int(np.argmax(self.axis))] if max(self.axis) == 1.0 else f"the direction {_text(self.axis)}"
        through = f" through {_text(self.point)} {self.unit}" if any(self.point) else ""
        return f"rotation about {axis}{through} by {np.degrees(self.angle):.6g} deg"

    @property
    def is_translation(self) -> bool:
        """Whether it does not rotate."""
        return not any(self.axis)

    @property
    def is_ahead(self) -> bool:
        """Whether a pair is described by this motion, rather than by its inverse."""
        if not self.is_translation:
            return self.angle > 0.0
        shift = np.array(self.shift)
        return bool(shift[np.argmax(np.abs(shift) > SMALLEST * np.abs(shift).max())] > 0.0)

    @property
    def is_of_box(self) -> bool:
        """Whether it may map the planes of a box onto each other: translations, and rotations by right angles."""
        quarters = self.angle / (0.5 * np.pi)
        return abs(quarters - round(quarters)) < SMALLEST

    def inverse(self) -> Motion:
        """Return the motion from the others back to the windows."""
        return replace(self, angle=-self.angle, shift=tuple(0.0 - s for s in self.shift))

    def turn(self, vectors: np.ndarray) -> np.ndarray:
        """Rotate vectors, shape (n, 3)."""
        if self.is_translation:
            return vectors
        axis = np.asarray(self.axis)
        along = (vectors @ axis)[:, None] * axis
        return along + np.cos(self.angle) * (vectors - along) + np.sin(self.angle) * np.cross(axis, vectors)

    def move(self, points: np.ndarray) -> np.ndarray:
        """Move points, shape (n, 3), in metres."""
        return self.turn(points - self.point) + self.point + self.shift


def _text(vector: tuple[float, ...]) -> str:
    return f"({', '.join(f'{value:.6g}' for value in vector)})"


@dataclass(frozen=True)
class PeriodicPair(OneLine):
    """Windows of the boundary that a motion maps onto each other."""

    # windows, others: both sides, in the order of the boundary
    windows: tuple[Window, ...]
    others: tuple[Window, ...]
    motion: Motion  # maps the nodes of the windows to the nodes of the others
