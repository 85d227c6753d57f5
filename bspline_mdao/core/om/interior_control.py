"""Interior control points as design variables, as an OpenMDAO component."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from openmdao.vectors.vector import Vector

from ...base.checks import require_list
from ...errors import InputError
from ...names import ALL_NAMES, CONTROL_POINTS, CONTROL_POINTS_INITIAL
from ..design.interior_points import InteriorPoints, InteriorShift
from ..model.fitted_model import FittedModel
from .check_directions import check_along_directions
from .component import LINEAR_STEP, SparseComponent, fails_together, finite_points, finite_values
from .model_option import declare_model


class InteriorControl(SparseComponent):
    """Move interior control points by design variables, one after the other; the surface stays.

    The component is linear. Before a mover, promote ``control_points`` as its ``control_points_initial``, so surface
    and interior are designed together; without one, `GridEvaluate` uses ``control_points`` directly.

    ==========================  ======  ====================  =====  ===============================================
    name                        role    shape                 units  meaning
    ==========================  ======  ====================  =====  ===============================================
    name of each variable       input   (n_values,)                  its values, zero where nothing moves
    ``control_points_initial``  input   (3 n_control_points)  m      control points before, xyz interleaved
    ``control_points``          output  (3 n_control_points)  m      control points after
    ==========================  ======  ====================  =====  ===============================================

    Options
    -------
    model : FittedModel
        The fitted grid.
    variables : sequence of InteriorPoints
        The variables.

    Attributes
    ----------
    shifts : dict of str to InteriorShift
        After ``setup``: the bounds and the points that each value moves.

    Raises
    ------
    InputError
        In ``setup``, if a variable's name occurs twice or is taken, or if a variable has no point to move.
    om.AnalysisError
        In a run, if a value or a control point is not finite.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import InteriorControl, fit_grid
    >>> from bspline_mdao.design import InteriorPoints
    >>> from bspline_mdao.generators import brick_grid
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> problem = om.Problem(reports=None)
    >>> component = InteriorControl(model=model, variables=[InteriorPoints("inside")])
    >>> _ = problem.model.add_subsystem("body", component, promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.run_model()
    >>> problem.get_val("control_points").shape
    (234,)
    """

    is_linear = True
    """Whether the outputs depend linearly (affinely) on the inputs."""

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: FittedModel,
            variables: Sequence[InteriorPoints],
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self, FittedModel)
        self.options.declare("variables", recordable=False, desc="interior control points that move")
        self.shifts: dict[str, InteriorShift] = {}

    @fails_together
    def setup(self) -> None:
        """Declare the variables in the model's sizes."""
        model, points = self.options["model"], self.options["model"].control_points
        variables = require_list(self.options["variables"], "variable", ("name", "bind"), self.msginfo)
        self.shifts = {}
        for variable in variables:
            if not variable.name or variable.name in ALL_NAMES or variable.name in self.shifts:
                raise InputError(f"{self.msginfo}: the name '{variable.name}' of a variable is taken; choose another")
            self.shifts[variable.name] = variable.bind(model)
            self.add_input(variable.name, val=self.shifts[variable.name].initial)
        self.add_input(CONTROL_POINTS_INITIAL, val=points.ravel(), units="m")
        self.add_output(CONTROL_POINTS, val=points.ravel(), units="m")
        check_along_directions(self, LINEAR_STEP)

    @fails_together
    def setup_partials(self) -> None:
        """Declare the constant Jacobian."""
        diagonal = np.arange(self.options["model"].control_points.size)
        self.declare_sparse(CONTROL_POINTS, CONTROL_POINTS_INITIAL, diagonal, diagonal, 1.0)
        for name, shift in self.shifts.items():
            entries = shift.matrix.tocoo()
            self.declare_sparse(CONTROL_POINTS, name, entries.row, entries.col, entries.data)

    @fails_together
    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Move the points."""
        points = finite_points(inputs[CONTROL_POINTS_INITIAL], CONTROL_POINTS_INITIAL, self.msginfo)
        for name, shift in self.shifts.items():
            points = shift.apply(points, finite_values(inputs[name], name, self.msginfo))
        outputs[CONTROL_POINTS] = points.ravel()
