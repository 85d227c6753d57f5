"""Points of other disciplines that follow the shape, such as structural nodes, as an OpenMDAO component.

Theory: ``docs/theory/body_points.rst``, ``docs/theory/inversion.rst``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InputError
from ...names import CONTROL_POINTS, GRID, SURFACE
from ..model.movable import Movable
from .check_directions import check_along_directions
from .checked_along_edges import check_along_edges, numbered_blocks
from .component import LINEAR_STEP, fails_together
from .model_option import declare_model
from .moved_points import MovedPoints


class PointSet(MovedPoints):
    """Move points outside the grid with the shape: spars, ribs and tanks inside the body, probes in the flow.

    Points inside the body depend only on its walls. If all points are inside, the variables are:

    ===============  ======  ============  =====  ======================================================================
    name             role    shape         units  meaning
    ===============  ======  ============  =====  ======================================================================
    ``surface``      input   (3 n_wall)    m      nodes of all walls, ``SurfaceGrid.of(model)``; see `SurfaceEvaluate`
    ``points``       output  (3 n)         m      the points, under the name ``name``, xyz interleaved
    ===============  ======  ============  =====  ======================================================================

    If some are in the volumes, the inputs are these instead of ``surface``, or for an unstructured mesh only
    ``control_points``:

    ==================  ======  ============  =====  ===================================================================
    name                role    shape         units  meaning
    ==================  ======  ============  =====  ===================================================================
    ``control_points``  input   (3 n_c)       m      all control points, see `ControlMeshMove`
    ``grid``            input   (3 n_nodes)   m      the grid of these, see `GridEvaluate`
    ==================  ======  ============  =====  ===================================================================

    Options
    -------
    model : FittedModel or MeshModel
        The fitted grid, or an unstructured mesh, whose lattice moves points in the flow.
    points : ndarray, shape (n, 3)
        The points on the baseline (m).
    name : str
        Name of the output, "points" by default.
    tolerance : float, optional
        Distance (m) up to which a point counts as inside the volumes, see `FittedModel.embed_points`.

    Raises
    ------
    InputError
        In ``setup``, with the number of the first point that is neither in a volume nor in the body, and if there are
        several processes and points in the volumes: the grid is then distributed.
    om.AnalysisError
        In a run, if an input is not finite, or if the surroundings of a wall node are inverted.

    Examples
    --------
    >>> import numpy as np
    >>> import openmdao.api as om
    >>> from bspline_mdao import PointSet, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> problem = om.Problem(reports=None)
    >>> component = PointSet(model=model, points=np.array([[2.0, 0.0, 0.0]]), name="probe")
    >>> _ = problem.model.add_subsystem("body", component, promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.set_val("control_points", 1.1 * model.control_points.ravel())
    >>> problem.run_model()
    >>> problem.get_val("probe").round(6) + 0.0
    array([2.2, 0. , 0. ])
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: Movable,
            points: np.ndarray,
            name: str = "points",
            tolerance: float | None = None,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self)
        self.options.declare("points", types=np.ndarray, recordable=False, desc="the points on the baseline, m")
        self.options.declare("name", types=str, default="points", desc="name of the output")
        self.options.declare("tolerance", default=None, desc="distance up to which a point counts as inside, m")

    @property
    def is_linear(self) -> bool:
        """Whether the outputs depend linearly (affinely) on the inputs: known after ``setup``."""
        return self._embedded.is_linear

    @fails_together
    def setup(self) -> None:
        """Embed the points and declare the variables."""
        model = self.options["model"]
        embedded = self._embedded = model.embed_points(self.options["points"], self.options["tolerance"])
        n_in_volume, n_points = len(embedded.in_volume), len(embedded.points)
        if n_in_volume and self.comm.size > 1:
            raise InputError(
                f"{self.msginfo}: {n_in_volume} of {n_points} points are in the volumes, the first is point "
                f"{embedded.in_volume[0] + 1}, and {self.comm.size} processes share the grid there; give points "
                f"inside the body, or take one process"
            )
        nodes = model.node_map.nodes
        values = {CONTROL_POINTS: model.control_points, GRID: nodes, SURFACE: nodes[embedded.wall_rows]}
        names = embedded.inputs if n_in_volume else (SURFACE,)
        self._moves_by(embedded if n_in_volume else embedded.body, self.options["name"], *names)
        for name in names:
            self.add_input(name, val=values[name].ravel(), units="m")
        self.add_output(self.options["name"], val=embedded.points.ravel(), units="m")
        check_along_directions(self, LINEAR_STEP)
        if not self.is_linear:  # of points in the volumes, some follow walls
            check_along_edges(self, CONTROL_POINTS, model.control_lines)
            check_along_edges(self, GRID, numbered_blocks(model.topology.shapes))
