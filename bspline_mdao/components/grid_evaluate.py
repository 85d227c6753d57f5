"""The grid that belongs to a set of control points, as an OpenMDAO component."""

from __future__ import annotations

import numpy as np
from scipy.sparse import identity, kron

from ..errors import InputError
from ..evaluation.grid_map import GridState
from ..model import FittedModel
from ..names import CONTROL_POINTS, GRID
from .jacobian import (
    LINEAR_STEP,
    SparseComponent,
    add_product,
    check_along_directions,
    difference_step,
    failures_as_analysis_errors,
    finite_points,
)


class GridEvaluate(SparseComponent):
    """Regenerate the grid from the control points, Eq. (3), ``x = layer(A b + T(b) r)``.

    A holds the basis values at the parameters and knots of the model. The residual r of the fit turns with its
    surroundings, and nodes near walls follow them as a rigid body, see `bspline_mdao.evaluation.grid_map`. What turns
    with what, and what is near which wall, is that of the model. Of a model without ``wall_layer`` the grid is
    ``A b + r``, and the component is linear (`is_linear`).

    ==================  ======  ====================  =====  =======================================================
    name                role    shape                 units  meaning
    ==================  ======  ====================  =====  =======================================================
    ``control_points``  input   (3 n_control_points)  m      control points, each shared one once, xyz interleaved
    ``grid``            output  (3 n_nodes)           m      nodes, blocks in file order, each in C order of (i, j, k)
    ==================  ======  ====================  =====  =======================================================

    Options
    -------
    model : FittedModel
        The fitted grid.
    assembled : bool
        Declare A as a sparse matrix instead of applying it matrix-free, for solvers that want a matrix. It takes many
        times the memory and the time, and the map has to be linear.

    Raises
    ------
    InputError
        In ``setup``, if a matrix is asked of a map that is not linear.
    om.AnalysisError
        In a run, if a control point is not finite, or if the surroundings of a point are turned inside out.
    """

    def initialize(self):
        """Declare the options."""
        self.options.declare("model", types=FittedModel, recordable=False, desc="the fitted grid")
        self.options.declare("assembled", types=bool, default=False, desc="declare the sparse Jacobian")

    @property
    def is_linear(self) -> bool:
        """Whether the outputs depend linearly (affinely, with a residual) on the inputs."""
        return self.options["model"].grid_map().is_linear

    def setup(self):
        """Declare the variables, of the sizes of the model."""
        model = self.options["model"]
        self._map, self._last = model.grid_map(), None
        if self.options["assembled"] and not self._map.is_linear:
            raise InputError(
                f"{self.msginfo}: assembled=True needs a linear map; fit the grid with wall_layer=False, or leave "
                f"assembled out"
            )
        self.matrix_free = not self.options["assembled"]
        self.add_input(CONTROL_POINTS, val=model.control_points.ravel(), units="m")
        self.add_output(GRID, shape=3 * model.n_nodes, units="m")
        blocks = (block.nodes for block in model.regenerate().blocks)
        check_along_directions(self, LINEAR_STEP if self._map.is_linear else difference_step(blocks))

    def setup_partials(self):
        """Declare the Jacobian once and for all where it is wanted as a matrix."""
        if self.options["assembled"]:  # a matrix-free one stays undeclared: OpenMDAO would allocate it, and it is dense
            jacobian = kron(self._map.evaluator.matrix(), identity(3), format="coo")
            self.declare_sparse(GRID, CONTROL_POINTS, jacobian.row, jacobian.col, jacobian.data)

    def compute(self, inputs, outputs):
        """Evaluate the volumes at the nodes, and let nodes follow walls."""
        state = self._state_at(inputs)
        outputs[GRID] = state.nodes.ravel()
        if self.under_complex_step:
            outputs[GRID] += 1j * state.jvp(inputs[CONTROL_POINTS].imag.reshape(-1, 3)).ravel()

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        """Apply the Jacobian or its transpose at the inputs."""
        if self.options["assembled"]:
            super().compute_jacvec_product(inputs, d_inputs, d_outputs, mode)
            return
        state = self._state_at(inputs)
        add_product(state.jvp, state.vjp, d_inputs, d_outputs, mode, of=GRID, wrt=CONTROL_POINTS)

    def _state_at(self, inputs) -> GridState:
        """Grid of these control points: the last one if it was made for them."""
        points = finite_points(inputs[CONTROL_POINTS], CONTROL_POINTS, self.msginfo).real
        if self._last is None or not np.array_equal(points, self._last[0]):
            with failures_as_analysis_errors(self):
                self._last = points.copy(), self._map.at(points)
        return self._last[1]
