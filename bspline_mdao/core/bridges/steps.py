"""The steps from design variables to grid quality and surface measures, see `.chain`.

Each is the function called by the component of the same name in `bspline_mdao.core.om`: `SurfaceControl`,
`SurfaceControlFit`, `ControlMeshMove`, `GridEvaluate`, `SurfaceEvaluate`, `SurfaceMeasure` and `Quality`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...base.display import OneLine
from ...errors import MovementError
from ...grids.cells.cell_judge import CellJudge
from ...grids.cells.grid_quality import GridValues
from ...names import CONTROL_POINTS, GRID, SURFACE, SURFACE_CONTROL_POINTS
from ..design.parametrization import Parametrization
from ..evaluation.node_map import NodeState
from ..fit.surface_fit import Follower
from ..measures.measure import Measure
from ..movement.moved_together import TOGETHER, goes_together, jvps_together, moved_together, vjps_together
from ..movement.mover import Movement, Mover, differentiable
from .chain import Arrays, Shapes

__all__ = ["ControlStep", "FollowStep", "MapStep", "MeasureStep", "MoveStep", "QualityStep"]


@dataclass(frozen=True, eq=False)
class ControlStep(OneLine):
    """Surface points from design variables."""

    parametrization: Parametrization
    name: str = SURFACE_CONTROL_POINTS  # name of what moves: control points, or nodes

    @cached_property
    def inputs(self) -> Shapes:
        """The variables."""
        return {name: values.shape for name, values in self.parametrization.initial.items()}

    @property
    def outputs(self) -> Shapes:
        """The surface points."""
        return {self.name: self._surface.shape}

    @cached_property
    def _surface(self) -> np.ndarray:
        mesh = self.parametrization.mesh
        return mesh.points[mesh.surface_ids]

    def at(self, values: Arrays) -> _Controlled:
        """Move the points."""
        require_finite(values)
        return _Controlled(self, values, {self.name: self.parametrization.apply(self._surface, values)})

    def partials(self, values: Arrays) -> dict:
        """Sparse derivatives with respect to every variable."""
        return self.parametrization.partials(self._surface, values).values


@dataclass(frozen=True, eq=False)
class _Controlled:
    of: ControlStep
    at: Arrays
    values: Arrays

    @cached_property
    def _partials(self) -> dict:
        return self.of.partials(self.at)

    def jvp(self, changes: Arrays) -> Arrays:
        change = sum(matrix @ changes[name] for name, matrix in self._partials.items())
        return {self.of.name: np.reshape(change, (-1, 3))}

    def vjp(self, bars: Arrays) -> Arrays:
        bar = bars[self.of.name].ravel()
        return {name: matrix.T @ bar for name, matrix in self._partials.items()}


@dataclass(frozen=True, eq=False)
class FollowStep(OneLine):
    """Surface control points that follow surface nodes."""

    follower: Follower
    n_surface: int  # number of control points

    @property
    def inputs(self) -> Shapes:
        """The nodes."""
        return {SURFACE: self.follower.baseline.shape}

    @property
    def outputs(self) -> Shapes:
        """The control points."""
        return {SURFACE_CONTROL_POINTS: (self.n_surface, 3)}

    def at(self, values: Arrays) -> _Single:
        """Let the control points follow."""
        require_finite(values)
        followed = self.follower.at(values[SURFACE])
        names = SURFACE, SURFACE_CONTROL_POINTS
        return _Single(*names, followed.control_points, followed.jvp, followed.vjp)


@dataclass(frozen=True, eq=False)
class _Single:
    """One array from one array."""

    wrt: str
    name: str
    value: np.ndarray
    forward: Callable[[np.ndarray], np.ndarray]
    transposed: Callable[[np.ndarray], np.ndarray]

    @property
    def values(self) -> Arrays:
        return {self.name: self.value}

    def jvp(self, changes: Arrays) -> Arrays:
        return {self.name: self.forward(changes[self.wrt])}

    def vjp(self, bars: Arrays) -> Arrays:
        return {self.wrt: self.transposed(bars[self.name])}


class MoveStep(OneLine):
    """Control points that follow their surface, always from the baseline points: one factor serves all."""

    def __init__(self, mover: Mover) -> None:
        self.mover: Mover = differentiable(mover)
        self._start: Any = None

    @property
    def inputs(self) -> Shapes:
        """The surface control points."""
        return {SURFACE_CONTROL_POINTS: (len(self.mover.mesh.surface_ids), 3)}

    @property
    def outputs(self) -> Shapes:
        """The control points."""
        return {CONTROL_POINTS: self.mover.mesh.points.shape}

    @property
    def n_together(self) -> int:
        """How many moves together are worth their memory: one if each has its own factors."""
        return TOGETHER if goes_together(self.mover) else 1

    def at(self, values: Arrays) -> _Moved:
        """Move the control mesh."""
        return self.at_all([values])[0]

    def at_all(self, values: Sequence[Arrays]) -> list[_Moved]:
        """Move the control mesh with several surfaces."""
        surfaces = [each[SURFACE_CONTROL_POINTS] for each in values]
        found = []
        for movement in moved_together(self.mover, self.mover.mesh.points, surfaces, self._start):
            if isinstance(movement, MovementError):
                raise movement
            self._start = getattr(movement, "start", None)
            found.append(_Moved(self, movement))
        return found

    def jvps(self, places: Sequence[_Moved], changes: Sequence[Arrays]) -> list[Arrays]:
        """Changes of the control points of several moves."""
        still = [np.zeros_like(self.mover.mesh.points)] * len(places)
        surfaces = [change[SURFACE_CONTROL_POINTS] for change in changes]
        found = jvps_together([place.movement for place in places], still, surfaces)
        return [{CONTROL_POINTS: change} for change in found]

    def vjps(self, places: Sequence[_Moved], bars: Sequence[Arrays]) -> list[Arrays]:
        """Transpose of `jvps`."""
        of_points = [np.ascontiguousarray(bar[CONTROL_POINTS]) for bar in bars]
        found = vjps_together([place.movement for place in places], of_points)
        return [{SURFACE_CONTROL_POINTS: bar} for _, bar in found]


@dataclass(frozen=True, eq=False)
class _Moved:
    of: MoveStep
    movement: Movement

    @property
    def values(self) -> Arrays:
        return {CONTROL_POINTS: self.movement.points}

    def jvp(self, changes: Arrays) -> Arrays:
        return self.of.jvps([self], [changes])[0]

    def vjp(self, bars: Arrays) -> Arrays:
        return self.of.vjps([self], [bars])[0]


@dataclass(frozen=True, eq=False)
class MapStep(OneLine):
    """Nodes from points, by a map as defined in `bspline_mdao.core.evaluation.node_map`."""

    node_map: Any
    inputs: Shapes
    name: str  # of the nodes
    n_nodes: int

    @property
    def outputs(self) -> Shapes:
        """The nodes."""
        return {self.name: (self.n_nodes, 3)}

    def at(self, values: Arrays) -> _Mapped:
        """Evaluate the nodes."""
        require_finite(values)
        return _Mapped(self, self.node_map.at(*(values[name] for name in self.inputs)))


@dataclass(frozen=True, eq=False)
class _Mapped:
    of: MapStep
    state: NodeState

    @property
    def values(self) -> Arrays:
        return {self.of.name: self.state.nodes}

    def jvp(self, changes: Arrays) -> Arrays:
        return {self.of.name: self.state.jvp(*(changes[name] for name in self.of.inputs))}

    def vjp(self, bars: Arrays) -> Arrays:
        return self.state.vjp(np.ascontiguousarray(bars[self.of.name]), tuple(self.of.inputs))


@dataclass(frozen=True, eq=False)
class MeasureStep(OneLine):
    """A measure of the nodes of a surface."""

    measure: Measure

    @property
    def inputs(self) -> Shapes:
        """The nodes."""
        return {SURFACE: self.measure.surface.points.shape}

    @property
    def outputs(self) -> Shapes:
        """What is measured."""
        return {self.measure.name: tuple(self.measure.shape)}

    def at(self, values: Arrays) -> _Measured:
        """Measure the nodes."""
        require_finite(values)
        return _Measured(self.measure, values[SURFACE])


@dataclass(frozen=True, eq=False)
class _Measured:
    measure: Measure
    points: np.ndarray

    @cached_property
    def _partials(self) -> Any:
        return self.measure.partials(self.points)

    @property
    def values(self) -> Arrays:
        return {self.measure.name: self.measure.evaluate(self.points).reshape(self.measure.shape)}

    def jvp(self, changes: Arrays) -> Arrays:
        change = self._partials @ changes[SURFACE].ravel()
        return {self.measure.name: change.reshape(self.measure.shape)}

    def vjp(self, bars: Arrays) -> Arrays:
        return {SURFACE: (self._partials.T @ bars[self.measure.name].ravel()).reshape(-1, 3)}


@dataclass(frozen=True, eq=False)
class QualityStep(OneLine):
    """Quality bounds of all cells."""

    judge: CellJudge
    names: Sequence[str]  # of the bounds

    @property
    def inputs(self) -> Shapes:
        """The nodes."""
        return {GRID: self.judge.baseline.shape}

    @property
    def outputs(self) -> Shapes:
        """The bounds, a number each."""
        return dict.fromkeys(self.names, ())

    def at(self, values: Arrays) -> _Judged:
        """Measure the cells."""
        require_finite(values)
        return _Judged(self.judge, values[GRID], self.judge.evaluate(values[GRID], self.names))


@dataclass(frozen=True, eq=False)
class _Judged:
    judge: CellJudge
    nodes: np.ndarray
    found: GridValues

    @property
    def values(self) -> Arrays:
        return {name: np.array(value) for name, value in self.found.aggregates.items()}

    def jvp(self, changes: Arrays) -> Arrays:
        change = self.judge.jvp(self.nodes, np.ascontiguousarray(changes[GRID]), self.found)
        return {name: np.array(value) for name, value in change.aggregates.items()}

    def vjp(self, bars: Arrays) -> Arrays:
        seeds = {name: float(bar) for name, bar in bars.items()}
        return {GRID: self.judge.vjp(self.nodes, self.found, GridValues(seeds))}


def require_finite(values: Arrays) -> None:
    """Refuse arrays with numbers that are not finite."""
    for name, array in values.items():
        if not np.isfinite(array).all():
            raise MovementError(f"'{name}' is not finite; take a smaller step")
