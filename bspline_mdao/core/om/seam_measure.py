"""Smoothness across seams, as an OpenMDAO component."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.checks import require_kind
from ...names import SURFACE_CONTROL_POINTS
from ..measures.seam_smoothness import SeamSmoothness
from .surface_measure import SurfaceMeasure


class SeamMeasure(SurfaceMeasure):
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
        What is measured and where.

    Raises
    ------
    om.AnalysisError
        In a run, if a control point is not finite.
    InputError
        For partial derivatives under complex step.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import SeamMeasure, fit_grid
    >>> from bspline_mdao.generators import ball_grid
    >>> from bspline_mdao.measures import SeamSmoothness
    >>> from bspline_mdao.movers import moving_mesh
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

    wrt = SURFACE_CONTROL_POINTS

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            measure: SeamSmoothness,
            **options: Any,
        ) -> None: ...

    def _baseline(self) -> np.ndarray:
        measure = self.options["measure"]
        require_kind(measure, SeamSmoothness, f"{self.msginfo}: the measure", "make it with SeamSmoothness.kinks(...)")
        return measure.points

    def _lines(self) -> list[np.ndarray]:
        return [np.arange(len(self._baseline()))]
