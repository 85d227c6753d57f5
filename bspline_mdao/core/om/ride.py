"""An unstructured mesh that moves with the control mesh, as an OpenMDAO component.

Theory: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ...names import CONTROL_POINTS
from ..model.fitted_model import FittedModel
from ..riding.riding_mesh import WALL, EmbeddedMesh
from ..sliding.sliding_nodes import Slide
from .check_directions import check_along_directions
from .checked_along_edges import check_along_edges
from .component import LINEAR_STEP, fails_together
from .model_option import declare_model
from .moved_points import MovedPoints


class Ride(MovedPoints):
    """Move the nodes of an unstructured mesh with the control mesh of a fitted grid.

    ==================  ======  ====================  =====  =======================================================
    name                role    shape                 units  meaning
    ==================  ======  ====================  =====  =======================================================
    ``control_points``  input   (3 n_control_points)  m      all control points, see `ControlMeshMove`
    ``wall``            input   (3 n_wall)            m      with ``asked``: prescribed positions of the mesh's wall
                                                             nodes, numbered by `wall_nodes`
    ``mesh``            output  (3 n)                 m      nodes of the mesh, under the name ``name``, xyz interleaved
    ==================  ======  ====================  =====  =======================================================

    Options
    -------
    model : FittedModel
        The fitted grid.
    mesh : MixedMesh
        The mesh on the baseline, by ``read_mesh(file).mesh`` or from arrays.
    name : str
        Name of the output, "mesh" by default.
    asked : bool
        Whether the nodes of its walls are given; otherwise they follow the control points.
    walls : sequence of str, optional
        Markers of the mesh that are walls; by default the markers on walls of the grid.
    tolerance : float, optional
        Distance (m) up to which nodes may be outside the grid, see `EmbeddedMesh`.
    hold_outside : bool
        Fix nodes that are farther outside.
    slides : sequence of Slide
        Patches of the grid that slide on curved surfaces, ``mesh.slides`` of the mesh that moves: their nodes stay on
        these, see :doc:`/theory/sliding`.

    Raises
    ------
    InputError
        In ``setup``, if nodes are outside the grid, if a marker does not exist, or if wall nodes are to be given and
        there are none.
    om.AnalysisError
        In a run, if an input is not finite, if the surroundings of a wall node are inverted, or if the boundary of the
        grid moves next to fixed nodes.

    Examples
    --------
    >>> import numpy as np
    >>> import openmdao.api as om
    >>> from bspline_mdao import Ride, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.meshes import MixedMesh
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> corners = np.array([[2.0, 0.0, 0.0], [2.5, 0.0, 0.0], [2.0, 0.5, 0.0], [2.0, 0.0, 0.5]])
    >>> mesh = MixedMesh(corners, {"tetra": np.array([[0, 1, 2, 3]])})
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("ride", Ride(model=model, mesh=mesh), promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.set_val("control_points", 1.1 * model.control_points.ravel())
    >>> problem.run_model()
    >>> problem.get_val("mesh")[:3].round(6) + 0.0
    array([2.2, 0. , 0. ])
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: FittedModel,
            mesh: MixedMesh,
            name: str = "mesh",
            asked: bool = False,
            walls: Sequence[str] | None = None,
            tolerance: float | None = None,
            hold_outside: bool = False,
            slides: Sequence[Slide] = (),
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self, FittedModel)
        self.options.declare("mesh", types=MixedMesh, recordable=False, desc="the mesh on the baseline")
        self.options.declare("name", types=str, default="mesh", desc="name of the output")
        self.options.declare("asked", types=bool, default=False, desc="whether nodes of walls are given")
        self.options.declare("walls", default=None, desc="markers that are walls")
        self.options.declare("tolerance", default=None, desc="distance up to which nodes may be outside, m")
        self.options.declare("hold_outside", types=bool, default=False, desc="hold nodes farther outside")
        self.options.declare("slides", default=(), recordable=False, desc="patches of the grid that slide")

    @property
    def is_linear(self) -> bool:
        """Whether the nodes depend linearly (affinely) on the inputs: known after ``setup``."""
        return self._riding.walls is None

    @property
    def wall_nodes(self) -> np.ndarray:
        """Numbers of the nodes of the mesh's walls, ascending: known after ``setup``."""
        return self._riding.asked_rows

    @fails_together
    def setup(self) -> None:
        """Locate the nodes in the volumes and declare the variables."""
        options = self.options
        model, mesh = options["model"], options["mesh"]
        chosen = {name: options[name] for name in ("walls", "tolerance", "hold_outside", "slides")}
        self._riding = EmbeddedMesh.of(model, mesh, **chosen)
        if options["asked"] and not self._riding.n_asked:
            raise InputError(f"{self.msginfo}: the mesh has no walls whose nodes could be given; leave 'asked' out")
        wrt = (CONTROL_POINTS, WALL) if options["asked"] else (CONTROL_POINTS,)
        self._moves_by(self._riding, options["name"], *wrt)
        self.add_input(CONTROL_POINTS, val=model.control_points.ravel(), units="m")
        if options["asked"]:
            self.add_input(WALL, val=mesh.points[self.wall_nodes].ravel(), units="m")
        self.add_output(options["name"], val=mesh.points.ravel(), units="m")
        check_along_directions(self, LINEAR_STEP)
        if not self.is_linear:
            check_along_edges(self, CONTROL_POINTS, model.mesh.control_ids)
