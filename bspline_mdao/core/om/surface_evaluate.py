"""The surface that belongs to a set of surface control points, as an OpenMDAO component."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...names import SURFACE, SURFACE_CONTROL_POINTS
from ..mesh.moving_mesh import MovingMesh
from ..mesh.surface import SurfaceGrid
from ..mesh.surface_map import SurfaceMap
from ..model.movable import Movable
from .check_directions import check_along_directions
from .checked_along_edges import check_along_edges
from .component import LINEAR_STEP, fails_together
from .model_option import declare_model
from .moved_points import MovedPoints


class SurfaceEvaluate(MovedPoints):
    """Regenerate the nodes of some patches from the surface control points, Eq. (3), without moving the grid.

    They are those of `GridEvaluate` to round-off, at a fraction of the cost. The component is linear (`is_linear`)
    where the residual of the fit does not turn with the surface.

    ==========================  ======  =============  =====  ======================================================
    name                        role    shape          units  meaning
    ==========================  ======  =============  =====  ======================================================
    ``surface_control_points``  input   (3 n_surface)  m      those on the design surface, in the order of the mesh's
                                                              ``surface_ids``
    ``surface``                 output  (3 n)          m      nodes of the `SurfaceGrid`, each once, xyz interleaved
    ==========================  ======  =============  =====  ======================================================

    Options
    -------
    model : FittedModel, LocalModel or MeshModel
        The fitted grid, or what one of several processes needs of it; or a mesh without structure.
    mesh : MovingMesh
        Its control mesh, which says what is the design surface.
    surface : SurfaceGrid
        Which nodes.

    Raises
    ------
    InputError
        In ``setup``, if nodes depend on control points that a mover may move and that are not on the design surface.
    om.AnalysisError
        In a run, if a control point is not finite, or if the surroundings of a point are turned inside out.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import SurfaceEvaluate, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import SurfaceGrid
    >>> from bspline_mdao.movers import moving_mesh
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> component = SurfaceEvaluate(model=model, mesh=moving_mesh(model), surface=SurfaceGrid.of(model))
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("body", component, promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.run_model()
    >>> problem.get_val("surface").shape
    (294,)
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: Movable,
            mesh: MovingMesh,
            surface: SurfaceGrid,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self)
        self.options.declare("mesh", types=MovingMesh, recordable=False, desc="its control mesh, ready to move")
        self.options.declare("surface", types=SurfaceGrid, recordable=False, desc="which nodes")

    @property
    def is_linear(self) -> bool:
        """Whether the outputs depend linearly (affinely) on the inputs."""
        return self.options["model"].is_linear_at_walls

    @fails_together
    def setup(self) -> None:
        """Declare the variables."""
        mesh, surface = self.options["mesh"], self.options["surface"]
        self._moves_by(SurfaceMap.of(self.options["model"], mesh, surface), SURFACE, SURFACE_CONTROL_POINTS)
        self.add_input(SURFACE_CONTROL_POINTS, val=mesh.points[mesh.surface_ids].ravel(), units="m")
        self.add_output(SURFACE, val=surface.points.ravel(), units="m")
        if self.is_linear:
            check_along_directions(self, LINEAR_STEP)
        else:
            check_along_edges(self, SURFACE_CONTROL_POINTS, mesh.surface_lines)
