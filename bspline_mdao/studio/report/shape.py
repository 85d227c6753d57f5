"""A shape of a grid or mesh, and the axes in which it is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

__all__ = ["Axes", "Shape"]


@dataclass(frozen=True)
class Axes:
    """Axes of the grid in which sections are drawn."""

    # downstream, span, up: numbers of the axes of the grid, from 0
    downstream: int
    span: int
    up: int
    is_guessed: bool = False  # whether no flow defines them
    unit: str = "m"  # unit of lengths along them

    @property
    def names(self) -> str:
        """Names of the axes, downstream first, such as ``xzy``."""
        return "".join("xyz"[axis] for axis in (self.downstream, self.span, self.up))


@dataclass(frozen=True, eq=False)
class Shape:
    """A shape of the grid."""

    label: str
    nodes: np.ndarray  # (n_nodes, 3), of the grid (m)
    control_points: np.ndarray | None  # (n_control_points, 3) (m); None if unknown
    pressures: Mapping[str, np.ndarray] = field(default_factory=dict)  # of wall faces, (n_faces,), by output
