"""A shape of a grid or mesh, and the axes in which it is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

__all__ = ["Axes", "Shape"]


@dataclass(frozen=True)
class Axes:
    """Axes of the grid that sections are drawn in."""

    # downstream, span, up: numbers of the axes of the grid, from 0
    downstream: int
    span: int
    up: int
    is_guessed: bool = False  # whether no flow says so
    unit: str = "m"  # unit of lengths along them

    @property
    def names(self) -> str:
        """Names of the axes, downstream first, such as ``xzy``."""
        return "".join("xyz"[axis] for axis in (self.downstream, self.span, self.up))


@dataclass(frozen=True, eq=False)
class Shape:
    """A shape of the grid.

    Parameters
    ----------
    label : str
        What it is called.
    nodes : ndarray, shape (n_nodes, 3)
        Nodes of the grid (m).
    control_points : ndarray, shape (n_control_points, 3), or None
        Control points (m); None where they are not known.
    pressures : mapping of str to ndarray, shape (n_faces,)
        Pressure coefficients of the wall faces, by the name of the output.
    """

    label: str
    nodes: np.ndarray
    control_points: np.ndarray | None
    pressures: Mapping[str, np.ndarray] = field(default_factory=dict)
