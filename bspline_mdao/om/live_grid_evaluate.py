"""The grid that belongs to a set of control points and to a baseline grid that changes, as an OpenMDAO component."""

from __future__ import annotations

import numpy as np
import openmdao.api as om

from ..errors import InputError
from ..fit.live_fit import LiveGrid, LiveGridState, live_grid
from ..model.fitted_model import FittedModel
from ..names import CONTROL_POINTS, CONTROL_POINTS_INITIAL, GRID, GRID_INITIAL
from .component import (
    LastState,
    add_product,
    check_along_directions,
    difference_step,
    fails_together,
    failures_as_analysis_errors,
    finite_points,
    refuse_complex_step,
)

INPUTS = (GRID_INITIAL, CONTROL_POINTS_INITIAL, CONTROL_POINTS)


class LiveGridEvaluate(om.ExplicitComponent):
    """Regenerate the grid where parameters and knots follow the baseline grid x0: `bspline_mdao.fit.live_fit`.

    The partner of ``Fit(live=True)``: behind a grid generator the totals of the regenerated grid are exact. Residual
    and wall layer are those of x0; which nodes are near a wall, and how much they follow it, stays as in the model. Of
    a model without ``wall_layer`` the grid is ``x = x0 + A(x0) (b - b0)``. Where there is no residual either, it is
    ``x = A(x0) b``, and there is no input ``control_points_initial``.

    ==========================  ======  ====================  =====  ===============================================
    name                        role    shape                 units  meaning
    ==========================  ======  ====================  =====  ===============================================
    ``grid_initial``            input   (3 n_nodes)           m      nodes of the baseline, as for `Fit`
    ``control_points_initial``  input   (3 n_control_points)  m      control points fitted to the baseline
    ``control_points``          input   (3 n_control_points)  m      control points after movement
    ``grid``                    output  (3 n_nodes)           m      nodes, blocks in file order, each in C order of
                                                                     (i, j, k), xyz interleaved
    ==========================  ======  ====================  =====  ===============================================

    Options
    -------
    model : FittedModel
        Fit of a baseline grid: topology, orders and numbers of control points.

    Raises
    ------
    InputError
        In ``setup``, if the model's parameters are corrected or given, or its knots are the user's own; in a run,
        under complex step.
    om.AnalysisError
        In a run, if a number is not finite, if the nodes have no parameters and knots, or if the surroundings of a
        point are turned inside out.
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    def initialize(self):
        """Declare the options."""
        self.options.declare("model", types=FittedModel, recordable=False, desc="fit of the baseline grid")

    @fails_together
    def setup(self):
        """Declare the variables, of the sizes of the model."""
        model = self.options["model"]
        grid = model.regenerate()
        baseline = grid.to_vector()
        self._baseline, self._last = LastState(), LastState()
        needs_initial = self._baseline.at([baseline.reshape(-1, 3)], self._grid).needs_initial
        self.add_input(GRID_INITIAL, val=baseline, units="m")
        if needs_initial:
            self.add_input(CONTROL_POINTS_INITIAL, val=model.control_points.ravel(), units="m")
        self.add_input(CONTROL_POINTS, val=model.control_points.ravel(), units="m")
        self.add_output(GRID, val=baseline, units="m")
        check_along_directions(self, difference_step(block.nodes for block in grid.blocks))

    def compute(self, inputs, outputs):
        """Evaluate the volumes at the nodes, and let nodes follow walls."""
        outputs[GRID] = self._state_at(inputs).nodes.ravel()

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        """Apply the Jacobian or its transpose."""
        state = self._state_at(inputs)
        add_product(inputs, d_inputs, d_outputs, mode, jvp=state.jvp, vjp=state.vjp, of=GRID, wrt=INPUTS)

    def _grid(self, nodes: np.ndarray) -> LiveGrid:
        return live_grid(self.options["model"], nodes)

    @fails_together
    def _state_at(self, inputs) -> LiveGridState:
        refuse_complex_step(self)
        points = {name: finite_points(inputs[name], name, self.msginfo) for name in INPUTS if name in inputs}
        with failures_as_analysis_errors(self, (InputError,)):
            grid = self._baseline.at([points[GRID_INITIAL]], self._grid)

        def make(*copies: np.ndarray) -> LiveGridState:
            made_for = dict(zip(points, copies))
            return grid.at(made_for.get(CONTROL_POINTS_INITIAL), made_for[CONTROL_POINTS])

        with failures_as_analysis_errors(self):
            return self._last.at(list(points.values()), make)
