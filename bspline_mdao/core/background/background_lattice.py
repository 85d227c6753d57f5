"""A B-spline volume around a mesh with coordinates as knots, so a node's parameters are its coordinates.

Control points at the Greville abscissae give the identity, so nothing has to be searched or fitted:

    y = x0 + A d ,    d: displacements of the control points; A: the basis functions at the nodes.

In cylindrical coordinates (`.lattice_frame`) both are components along directions that rotate with the angle.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...base.display import OneLine
from ..evaluation.evaluator import Evaluator
from ..evaluation.turned_evaluator import TurnedEvaluator
from ..splines.mesh import BSplineMesh
from ..splines.volume import Volume
from ..walls.embedded_points import ON_PLANE
from .lattice_frame import Directions, LatticeFrame
from .lattice_line import LatticeLine

__all__ = ["BackgroundLattice"]


@dataclass(frozen=True, eq=False)
class BackgroundLattice(OneLine):
    """A lattice around a mesh."""

    lines: tuple[LatticeLine, LatticeLine, LatticeLine]  # its directions
    frame: LatticeFrame  # their coordinate system

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of control points in each direction."""
        x, y, z = (line.n_control for line in self.lines)
        return x, y, z

    @property
    def n_control(self) -> int:
        """Number of control points."""
        return int(np.prod(self.shape))

    @property
    def spacing(self) -> float:
        """Width of the narrowest span (m), except the one across a section."""
        return float(min(np.diff(line.breaks).min() for line in self.lines if not line.is_tied))

    @cached_property
    def mesh(self) -> BSplineMesh:
        """The volume."""
        volume = Volume(tuple(line.knots for line in self.lines))
        return BSplineMesh((volume,), (np.arange(self.n_control).reshape(self.shape),), self.n_control)

    @cached_property
    def control_points(self) -> np.ndarray:
        """Control points (m), shape (n_control, 3): in Cartesian coordinates they give the identity."""
        return self.frame.to_space(self._control_coordinates)

    @cached_property
    def control_directions(self) -> Directions:
        """Directions of the coordinates at the control points."""
        return self.frame.directions_at(self._control_coordinates)

    @property
    def _control_coordinates(self) -> np.ndarray:
        net = np.meshgrid(*(line.control_coordinates for line in self.lines), indexing="ij")
        return np.stack([part.ravel() for part in net], axis=1)

    def evaluator(
        self,
        points: np.ndarray,  # (n, 3), in the box of the lattice (m)
        # numbers of points on a side of it to rounding, the axis across that side, and its end: 0 or -1
        on_sides: Sequence[tuple[np.ndarray, int, int]] = (),
    ) -> Evaluator | TurnedEvaluator:
        """Map vectors at control points to vectors at points."""
        basis = self.basis(points, on_sides)
        if self.frame.is_cartesian:
            return basis
        at_control, at_points = self.control_directions, self.frame.directions(points)
        return TurnedEvaluator(basis, at_control.local, at_control.space, at_points.local, at_points.space)

    def basis(self, points: np.ndarray, on_sides: Sequence[tuple[np.ndarray, int, int]] = ()) -> Evaluator:
        """A at points, see `evaluator`."""
        local = self.frame.to_local(points)
        parameters = np.stack([line.parameters(x) for line, x in zip(self.lines, local.T)], axis=1)
        for ids, axis, end in on_sides:
            parameters[ids, axis] = -end
        return Evaluator.build(self.mesh, [parameters], [np.arange(len(points))], len(points))

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distances of points, shape (n, 3), from the box of the lattice, 0 within (m)."""
        local = self.frame.to_local(points)
        ends = np.array([[-np.inf, np.inf] if line.is_periodic else line.breaks[[0, -1]] for line in self.lines])
        return np.linalg.norm(local - np.clip(local, ends[:, 0], ends[:, 1]), axis=1)

    def sides_at(self, points: np.ndarray) -> set[tuple[int, int]]:
        """Sides of the lattice reached by points, shape (n, 3): the direction across, and its end, 0 or -1."""
        local, found = self.frame.to_local(points), set()
        for axis, line in enumerate(self.lines):
            if line.is_periodic:
                continue
            if local[:, axis].min() - line.breaks[0] <= ON_PLANE * line.length:
                found.add((axis, 0))
            if line.breaks[-1] - local[:, axis].max() <= ON_PLANE * line.length:
                found.add((axis, -1))
        return found

    def elements(self, points: np.ndarray) -> np.ndarray:
        """Number of the lattice element that contains each point, shape (n, 3)."""
        spans = [line.spans(x) for line, x in zip(self.lines, self.frame.to_local(points).T)]
        return np.ravel_multi_index(spans, [len(line.breaks) - 1 for line in self.lines])

    def refinement(self, points: np.ndarray) -> np.ndarray:
        """Fraction of an unrefined element's wall in the elements that contain points."""
        free = [(line, x) for line, x in zip(self.lines, self.frame.to_local(points).T) if not line.is_tied]
        parts = [(np.diff(line.breaks) / line.scales)[line.spans(x)] for line, x in free]
        return np.prod(parts, axis=0) ** ((len(free) - 1.0) / len(free))
