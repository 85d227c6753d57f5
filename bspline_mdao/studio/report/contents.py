"""The contents of a report: a model, shapes of its grid, and the history of an optimisation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ...core.om.drivers.case_history import CaseHistory
from ...errors import InputError
from ...flow.euler.error_estimate import ErrorEstimate
from ...grids.topology.grid import MAX_COORDINATE
from ...names import CONTROL_POINTS, GRID
from .shape import Axes, Shape
from .subject import Subject

__all__ = ["INCLUDES", "RECORD", "Contents", "axes_of", "shapes_of"]

INCLUDES = "*control_points", "*Cp"
"""Outputs from which a report shows shapes and pressures."""

RECORD = 'problem.driver.recording_options["includes"] = ["*control_points", "*Cp"]'
"""Setting that makes a driver record them."""

PRESSURES, PANEL_PRESSURES = "Cp", "delta_Cp"
"""Endings of the names of pressure coefficients, and of the pressure differences across the panels of a lattice."""


@dataclass(frozen=True, eq=False)
class Contents:
    """All that a report shows."""

    title: str  # heading of the page
    subject: Subject | None = None  # the fitted grid, or the mesh
    shapes: tuple[Shape, ...] = ()  # one shape, or the shapes before and after; none without a model
    history: CaseHistory | None = None  # the optimisation
    missing: tuple[str, ...] = ()  # what cannot be shown, and what to do about it
    diagram: str | None = None  # the N2 diagram, a whole HTML page
    # estimates of lift and drag at the end on a finer grid, see `DesignSummary`
    estimates: Mapping[str, ErrorEstimate] = field(default_factory=dict)
    gains: tuple[str, ...] = ()  # reduction of induced drag, on the grid and on a finer one

    def without(self, *texts: str) -> Contents:
        """The same, with more that cannot be shown."""
        return replace(self, missing=(*self.missing, *texts))


def shapes_of(
    subject: Subject,  # the fitted grid, or the mesh
    history: CaseHistory | None,  # the optimisation; without it only the grid of the model is shown
) -> tuple[tuple[Shape, ...], list[str]]:  # shapes; missing
    """Shapes of a grid before and after an optimisation, and what is missing of them."""
    if history is None:
        return (_shape(subject, subject.label, subject.baseline_points),), []
    points = _ending(history.outputs, CONTROL_POINTS)
    grids = _ending(history.outputs, GRID)
    moved = [(name, of) for found, of in ((points, _from_points), (grids, _from_grid)) for name in found[:1]]
    if not moved:
        text = (
            f"The case file has no control points, so the grid of the model is shown instead of the optimum. "
            f"Record them: {RECORD}"
        )
        return (_shape(subject, subject.label, subject.baseline_points),), [text]
    name, make = moved[0]
    numbers = sorted(history.outputs[name])
    first, best = numbers[0], history.best if history.best in history.outputs[name] else numbers[-1]
    labels = {first: "Before", best: "After"} if best != first else {first: "Before"}
    shapes, missing, pressures = [], [], _ending(history.outputs, PRESSURES)
    n_wall_faces = 0 if subject.pressure_faces is None else len(subject.pressure_faces)
    for number, label in labels.items():
        if not (np.abs(history.outputs[name][number]) <= MAX_COORDINATE).all():
            raise InputError(
                f"{subject.source}: {name} of evaluation {number + 1} in the case file are no coordinates; it may "
                f"be damaged"
            )
        values = {key: history.outputs[key][number].ravel() for key in pressures if number in history.outputs[key]}
        fitting = {key: value for key, value in values.items() if value.size == n_wall_faces}
        shapes.append(make(subject, label, history.outputs[name][number], fitting))
        missing += [
            f"{key} is not shown: it does not match the {n_wall_faces:,} wall faces." for key in {*values} - {*fitting}
        ]
    if n_wall_faces and not pressures and not _ending(history.outputs, PANEL_PRESSURES):
        missing.append(f"The case file has no pressures Cp. If the flow has them, record them: {RECORD}")
    if len(shapes) == 1:
        missing.append("The first evaluation is the best one: there is no shape after.")
    return tuple(shapes), sorted(set(missing), key=missing.index)


def axes_of(
    subject: Subject,  # the fitted grid, or the mesh
    walls: np.ndarray,  # (n, 3), points on its walls (m)
    options: Mapping[str, Mapping[str, object]],  # options of the systems of a problem
) -> Axes:
    """Find the axes in which sections are drawn: from a flow, or a guess."""
    # Without a flow, the span is normal to the symmetry plane, or along the longest side of the walls, and downstream
    # is along the longest of the other sides.
    for of_system in options.values():
        text = str(of_system.get("axes", ""))
        if sorted(text) == ["x", "y", "z"]:
            downstream, span, up = ("xyz".index(letter) for letter in text)
            return Axes(downstream, span, up, unit=subject.unit)
    extents = np.ptp(walls, axis=0)
    across = subject.across_symmetry
    span = int(np.argmax(extents)) if across is None else across
    downstream, up = sorted((axis for axis in range(3) if axis != span), key=lambda axis: (-extents[axis], axis))
    return Axes(downstream, span, up, True, subject.unit)


def _ending(names: Mapping[str, object], ending: str) -> list[str]:
    """Names whose last part is this one, the shortest first."""
    return sorted((name for name in names if name.rpartition(".")[2] == ending), key=len)


def _shape(subject: Subject, label: str, points: np.ndarray, pressures: Mapping | None = None) -> Shape:
    """Shape of given control points."""
    is_baseline = np.array_equal(points, subject.baseline_points)
    return Shape(label, subject.nodes_at(None if is_baseline else points), points, pressures or {})


def _from_points(subject: Subject, label: str, points: np.ndarray, pressures: Mapping) -> Shape:
    """Shape of recorded control points."""
    if points.size != subject.baseline_points.size:
        raise _of_another(subject, f"{points.size // 3:,} control points", f"{len(subject.baseline_points):,}")
    return _shape(subject, label, points.reshape(-1, 3), pressures)


def _from_grid(subject: Subject, label: str, grid: np.ndarray, pressures: Mapping) -> Shape:
    """Shape of a recorded grid."""
    if grid.size != 3 * subject.n_nodes:
        raise _of_another(subject, f"{grid.size // 3:,} nodes", f"{subject.n_nodes:,}")
    return Shape(label, grid.reshape(-1, 3), None, pressures)


def _of_another(subject: Subject, recorded: str, given: str) -> InputError:
    return InputError(
        f"{subject.source}: the case file has {recorded} and the model {given}; give the model that was optimised"
    )
