"""The grid that belongs to a set of control points, as an OpenMDAO component."""

from __future__ import annotations

import numpy as np
from scipy.sparse import identity, kron

from ..model import FittedModel
from ..names import CONTROL_POINTS, GRID
from .jacobian import LINEAR_STEP, SparseComponent, add_product, check_along_directions, finite_points


class GridEvaluate(SparseComponent):
    """Regenerate the grid from the control points, Eq. (3): ``x = A b + r``.

    The component is linear (`is_linear`): A holds the basis values at the parameters and knots of the model, and r is
    the residual of the fit, if the model carries it. Both stay as they are when the control points move.

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
        Declare A as a sparse matrix instead of applying it matrix-free. It takes many times the memory and the time;
        for solvers that want a matrix.

    Raises
    ------
    om.AnalysisError
        In a run, if a control point is not finite.
    """

    is_linear = True
    """Whether the outputs depend linearly (affinely, with a residual) on the inputs."""

    def initialize(self):
        """Declare the options."""
        self.options.declare("model", types=FittedModel, recordable=False, desc="the fitted grid")
        self.options.declare("assembled", types=bool, default=False, desc="declare the sparse Jacobian")

    def setup(self):
        """Declare the variables, of the sizes of the model."""
        model = self.options["model"]
        self._evaluator = model.evaluator()
        self.matrix_free = not self.options["assembled"]
        self.add_input(CONTROL_POINTS, val=model.control_points.ravel(), units="m")
        self.add_output(GRID, shape=3 * self._evaluator.n_rows, units="m")
        check_along_directions(self, LINEAR_STEP)

    def setup_partials(self):
        """Declare the Jacobian once and for all where it is wanted as a matrix."""
        if self.options["assembled"]:  # a matrix-free one stays undeclared: OpenMDAO would allocate it, and it is dense
            jacobian = kron(self._evaluator.matrix(), identity(3), format="coo")
            self.declare_sparse(GRID, CONTROL_POINTS, jacobian.row, jacobian.col, jacobian.data)

    def compute(self, inputs, outputs):
        """Evaluate the volumes at the nodes."""
        control_points = finite_points(inputs[CONTROL_POINTS], CONTROL_POINTS, self.msginfo)
        nodes = outputs[GRID].reshape(-1, 3)
        nodes[:] = self._evaluator.forward(np.ascontiguousarray(control_points))
        if self.options["model"].residual is not None:
            nodes += self.options["model"].residual

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        """Apply A or its transpose, whatever the inputs."""
        if self.options["assembled"]:
            super().compute_jacvec_product(inputs, d_inputs, d_outputs, mode)
            return
        jvp, vjp = self._evaluator.forward, self._evaluator.adjoint
        add_product(jvp, vjp, d_inputs, d_outputs, mode, of=GRID, wrt=CONTROL_POINTS)
