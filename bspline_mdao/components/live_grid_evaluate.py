"""The grid that belongs to a set of control points and to a baseline grid that changes, as an OpenMDAO component."""

from __future__ import annotations

import numpy as np
import openmdao.api as om

from ..fit.live_mapping import LiveMapping, live_mapping
from ..model import FittedModel
from ..names import CONTROL_POINTS, CONTROL_POINTS_INITIAL, GRID, GRID_INITIAL
from .jacobian import (
    add_bar,
    at_baseline,
    check_along_directions,
    difference_step,
    direction_in,
    finite_points,
    refuse_complex_step,
)


class LiveGridEvaluate(om.ExplicitComponent):
    """Regenerate the grid where parameters and knots follow the baseline grid x0: ``x = x0 + A(x0) (b - b0)``.

    The partner of ``Fit(live=True)``: behind a grid generator the totals of the regenerated grid are exact. Where the
    model carries no residual, the grid is ``x = A(x0) b`` and there is no input ``control_points_initial``.

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
        In a run, if a number is not finite, or if the nodes have no parameters and knots.
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    def initialize(self):
        """Declare the options."""
        self.options.declare("model", types=FittedModel, recordable=False, desc="fit of the baseline grid")

    def setup(self):
        """Declare the variables, of the sizes of the model."""
        model = self.options["model"]
        grid = model.regenerate()
        baseline = grid.to_vector()
        self._mapping = live_mapping(model, baseline.reshape(-1, 3))
        self.add_input(GRID_INITIAL, val=baseline, units="m")
        if model.residual is not None:
            self.add_input(CONTROL_POINTS_INITIAL, val=model.control_points.ravel(), units="m")
        self.add_input(CONTROL_POINTS, val=model.control_points.ravel(), units="m")
        self.add_output(GRID, val=baseline, units="m")
        check_along_directions(self, difference_step(block.nodes for block in grid.blocks))

    def compute(self, inputs, outputs):
        """Evaluate the volumes at the nodes."""
        for name in (GRID_INITIAL, CONTROL_POINTS_INITIAL, CONTROL_POINTS):
            if name in inputs:
                finite_points(inputs[name], name, self.msginfo)
        outputs[GRID] = self._mapping_at(inputs).evaluate(_displacement(inputs)).ravel()
        if CONTROL_POINTS_INITIAL in inputs:
            outputs[GRID] += inputs[GRID_INITIAL]

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        """Apply the Jacobian or its transpose."""
        if GRID not in d_outputs:
            return
        mapping, displacement = self._mapping_at(inputs), _displacement(inputs)
        carries = float(CONTROL_POINTS_INITIAL in inputs)  # whether the baseline itself is part of the sum
        if mode == "fwd":
            d_nodes = direction_in(d_inputs, inputs, GRID_INITIAL)
            d_control = direction_in(d_inputs, inputs, CONTROL_POINTS)
            d_control = d_control - direction_in(d_inputs, inputs, CONTROL_POINTS_INITIAL)
            d_outputs[GRID] += (mapping.jvp(displacement, d_nodes, d_control) + carries * d_nodes).ravel()
        else:
            bar = d_outputs[GRID].reshape(-1, 3)
            nodes_bar, control_bar = mapping.vjp(displacement, bar)
            add_bar(d_inputs, GRID_INITIAL, nodes_bar + carries * bar)
            add_bar(d_inputs, CONTROL_POINTS, control_bar)
            add_bar(d_inputs, CONTROL_POINTS_INITIAL, -control_bar)

    def _mapping_at(self, inputs) -> LiveMapping:
        refuse_complex_step(self)
        nodes = inputs[GRID_INITIAL]
        self._mapping = at_baseline(self._mapping, live_mapping, self.options["model"], nodes, self.msginfo)
        return self._mapping


def _displacement(inputs) -> np.ndarray:
    """Control points that the mapping is applied to, shape (n_control_points, 3): b - b0, or b alone."""
    control_points = inputs[CONTROL_POINTS]
    if CONTROL_POINTS_INITIAL in inputs:
        control_points = control_points - inputs[CONTROL_POINTS_INITIAL]
    return control_points.reshape(-1, 3)
