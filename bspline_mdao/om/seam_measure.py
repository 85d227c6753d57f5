"""Smoothness across seams, as an OpenMDAO component."""

from __future__ import annotations

from ..checks import require_kind
from ..measures.seam_smoothness import SeamSmoothness
from ..names import SURFACE_CONTROL_POINTS
from .component import (
    SparseComponent,
    SparsePattern,
    check_along_directions,
    difference_step,
    fails_together,
    finite_points,
    refuse_complex_step,
)


class SeamMeasure(SparseComponent):
    """Measure kinks or jumps of curvature across the seams of a surface, as constraints on its control points.

    ==========================  ======  =========================  ============  ===================================
    name                        role    shape                      units         meaning
    ==========================  ======  =========================  ============  ===================================
    ``surface_control_points``  input   (3 n_surface)              m             surface control points, xyz
                                                                                 interleaved
    name of the measure         output  (n), one for each place    deg or 1/m    kinks, positive at an edge, or
                                                                                 jumps of curvature
    ==========================  ======  =========================  ============  ===================================

    Options
    -------
    measure : SeamSmoothness
        What is measured, at which places.

    Raises
    ------
    om.AnalysisError
        In a run, if a control point is not finite.
    InputError
        For partial derivatives under complex step.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import SeamMeasure, SeamSmoothness, ball_grid, fit_grid, moving_mesh
    >>> model = fit_grid(ball_grid((9, 9, 9, 9)))
    >>> jumps = SeamSmoothness.curvature_jumps(model, moving_mesh(model))
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("seams", SeamMeasure(measure=jumps), promotes=["*"])
    >>> problem.model.add_constraint("seam_curvature_jumps", lower=-0.1, upper=0.1)
    >>> _ = problem.setup()
    >>> problem.run_model()
    >>> problem.get_val("seam_curvature_jumps").shape
    (60,)
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    def initialize(self):
        """Declare the options."""
        self.options.declare("measure", recordable=False, desc="what is measured")

    @fails_together
    def setup(self):
        """Declare the variables."""
        measure = self.options["measure"]
        require_kind(measure, SeamSmoothness, f"{self.msginfo}: the measure", "make it with SeamSmoothness.kinks(...)")
        self.add_input(SURFACE_CONTROL_POINTS, val=measure.points.ravel(), units="m")
        self.add_output(measure.name, shape=measure.shape, units=measure.units)
        check_along_directions(self, difference_step([measure.points]), is_complex=True)

    @fails_together
    def setup_partials(self):
        """Declare what may differ from zero."""
        measure = self.options["measure"]
        self._sparse = SparsePattern.of(measure.partials(measure.points))
        self.declare_sparse(measure.name, SURFACE_CONTROL_POINTS, self._sparse.rows, self._sparse.cols)

    @fails_together
    def compute(self, inputs, outputs):
        """Measure the seams."""
        measure = self.options["measure"]
        outputs[measure.name] = measure.evaluate(self._points(inputs))

    @fails_together
    def compute_partials(self, inputs, partials):
        """Differentiate the measure."""
        refuse_complex_step(self)
        measure = self.options["measure"]
        found = measure.partials(self._points(inputs))
        partials[measure.name, SURFACE_CONTROL_POINTS] = self._sparse.data(found, f"{self.msginfo}: '{measure.name}'")

    def _points(self, inputs):
        return finite_points(inputs[SURFACE_CONTROL_POINTS], SURFACE_CONTROL_POINTS, self.msginfo)
