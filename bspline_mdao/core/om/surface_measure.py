"""A measure of the regenerated surface, as an OpenMDAO component."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from openmdao.jacobians.jacobian import Jacobian
from openmdao.vectors.vector import Vector

from ...names import SURFACE
from ..measures.measure import Measure
from .checked_along_edges import check_along_edges
from .component import (
    SparseComponent,
    SparsePattern,
    fails_together,
    finite_points,
    refuse_complex_step,
)


class SurfaceMeasure(SparseComponent):
    """Measure the surface: thickness, volume, area, radii, angles or any other `Measure`.

    ====================  ======  ==========  =====  ===============================================================
    name                  role    shape       units  meaning
    ====================  ======  ==========  =====  ===============================================================
    ``surface``           input   (3 n)       m      nodes of the measure's `SurfaceGrid`, xyz interleaved
    name of the measure   output  the measure's own  what it measures
    ====================  ======  =================  ===============================================================

    Options
    -------
    measure : Measure
        What is measured and on which surface.

    Raises
    ------
    om.AnalysisError
        In a run, if a node is not finite.
    InputError
        For partial derivatives under complex step.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import SurfaceMeasure, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import EnclosedVolume, SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("body", SurfaceMeasure(measure=EnclosedVolume.of(surface)), promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.set_val("surface", surface.points.ravel())
    >>> problem.run_model()
    >>> problem.get_val("volume", units="m**3").round(6)
    array([1.])
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    wrt = SURFACE
    """Name of the input."""

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            measure: Measure,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("measure", recordable=False, desc="what is measured")

    @fails_together
    def setup(self) -> None:
        """Declare the variables."""
        measure = self.options["measure"]
        self.add_input(self.wrt, val=self._baseline().ravel(), units="m")
        self.add_output(measure.name, shape=measure.shape, units=measure.units)
        check_along_edges(self, self.wrt, self._lines(), is_complex=True)

    @fails_together
    def setup_partials(self) -> None:
        """Declare the entries that may differ from zero."""
        measure = self.options["measure"]
        self._sparse = SparsePattern.of(measure.partials(self._baseline()))
        self.declare_sparse(measure.name, self.wrt, self._sparse.rows, self._sparse.cols)

    @fails_together
    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Measure the points."""
        measure = self.options["measure"]
        outputs[measure.name] = measure.evaluate(self._points(inputs)).reshape(measure.shape)

    @fails_together
    def compute_partials(self, inputs: Vector, partials: Jacobian) -> None:
        """Differentiate the measure."""
        refuse_complex_step(self)
        measure = self.options["measure"]
        found = measure.partials(self._points(inputs))
        partials[measure.name, self.wrt] = self._sparse.data(found, f"{self.msginfo}: '{measure.name}'")

    def _points(self, inputs: Vector) -> np.ndarray:
        return finite_points(inputs[self.wrt], self.wrt, self.msginfo)

    def _baseline(self) -> np.ndarray:
        return self.options["measure"].surface.points

    def _lines(self) -> Sequence[np.ndarray]:
        """Numbers of the points in faces or lines, for checks."""
        return self.options["measure"].surface.lines
