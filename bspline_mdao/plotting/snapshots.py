"""What there is to look at, at one moment: a grid, its control mesh, and a flow about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..model.fitted_model import FittedModel
from ..names import CONTROL_POINTS, GRID
from ..topology.grid import Grid

__all__ = ["Snapshot"]


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A grid, and what else is known of it, kept while a problem goes on.

    Parameters
    ----------
    grid : Grid
        The grid.
    title : str
        What pictures call it.
    model : FittedModel or None
        The fitted grid that it comes from.
    control_points : ndarray or None
        Its control points (m), shape (n_control_points, 3).
    pressures : ndarray or None
        Pressure coefficients of the wall faces, of an `EulerFlow`.
    states : ndarray or None
        Its states.
    mach : float or None
        Mach number of the free stream.
    """

    grid: Grid
    title: str
    model: FittedModel | None = None
    control_points: np.ndarray | None = None
    pressures: np.ndarray | None = None
    states: np.ndarray | None = None
    mach: float | None = None

    def __repr__(self) -> str:
        flow = "no flow" if self.pressures is None else f"Mach {self.mach:.3g}"
        return f"Snapshot({self.title!r}, {self.grid.n_nodes:,} nodes, {flow})"

    @classmethod
    def of(cls, what: Any, title: str | None = None) -> Snapshot:
        """Take a grid, a fitted grid, or a problem as it is now.

        Parameters
        ----------
        what : Grid, FittedModel, openmdao.api.Problem, openmdao.api.Group or Snapshot
            Of a problem or a group of it, the first `GridMovement`, `GridEvaluate` or flow tells the grid, and the
            first `EulerFlow` the flow.
        title : str, optional
            What pictures call it.

        Returns
        -------
        Snapshot
            Of its own: what the problem does afterwards does not change it.

        Raises
        ------
        InputError
            If there is no grid in it, or a problem has not run.
        """
        if isinstance(what, cls):
            return what
        if isinstance(what, Grid):
            return cls(what, title or what.source)
        if isinstance(what, FittedModel):
            return cls(what.regenerate(), title or what.header.source, what, what.control_points)
        if hasattr(what, "model") and hasattr(what.model, "system_iter"):
            return _of_group(what.model, title or "now")
        if hasattr(what, "system_iter"):
            return _of_group(what, title or "now")
        raise InputError(
            f"nothing to look at in a {type(what).__name__}; give a Grid, a FittedModel, or a problem that has run"
        )


def _of_group(group, title: str) -> Snapshot:
    """What a group of a problem holds now."""
    systems = list(group.system_iter(include_self=True, recurse=True))
    model = next((found for system in systems if (found := _model_of(system)) is not None), None)
    if model is None:
        raise InputError("the problem has no GridMovement, GridEvaluate or EulerFlow of a FittedModel to look at")
    values = _values(systems)
    if GRID not in values:
        raise InputError("the problem has no grid yet; run it first: problem.run_model()")
    grid = model.header.grid(model.topology.shapes, values[GRID].reshape(-1, 3))
    points = values.get(CONTROL_POINTS)
    mach = values.get("Mach_number")
    return Snapshot(
        grid,
        title,
        model,
        model.control_points if points is None else points.reshape(-1, 3),
        values.get("Cp"),
        values.get("states"),
        None if mach is None else float(mach.ravel()[0]),
    )


def _model_of(system) -> FittedModel | None:
    """The fitted grid that a system was made with."""
    if "model" in system.options and isinstance(system.options["model"], FittedModel):
        return system.options["model"]
    return None


def _values(systems) -> dict[str, np.ndarray]:
    """Values of the variables that are looked for, of the first component that has each, as copies."""
    found: dict[str, np.ndarray] = {}
    for system in systems:
        own = system.get_io_metadata(metadata_keys=())
        for name in (GRID, CONTROL_POINTS, "Cp", "states", "Mach_number"):
            if name not in found and name in own:
                found[name] = np.array(system.get_val(name, from_src=False))
    return found
