"""The surface that belongs to a set of surface control points, as an OpenMDAO component."""

from __future__ import annotations

from scipy.sparse import identity, kron

from ..geometry.surface import SurfaceGrid
from ..geometry.surface_map import SurfaceMap
from ..model import FittedModel
from ..movement.mesh import MovingMesh
from ..names import SURFACE, SURFACE_CONTROL_POINTS
from .jacobian import LINEAR_STEP, SparseComponent, check_along_directions, finite_points


class SurfaceEvaluate(SparseComponent):
    """Regenerate the nodes of some patches from the surface control points, Eq. (3), without moving the grid.

    They are those of `GridEvaluate` to round-off, at a fraction of the cost: the component is linear, its Jacobian
    sparse and constant.

    ==========================  ======  =============  =====  ======================================================
    name                        role    shape          units  meaning
    ==========================  ======  =============  =====  ======================================================
    ``surface_control_points``  input   (3 n_surface)  m      those on the design surface, in the order of the mesh's
                                                              ``surface_ids``
    ``surface``                 output  (3 n)          m      nodes of the `SurfaceGrid`, each once, xyz interleaved
    ==========================  ======  =============  =====  ======================================================

    Options
    -------
    model : FittedModel
        The fitted grid.
    mesh : MovingMesh
        Its control mesh, which says what is the design surface.
    surface : SurfaceGrid
        Which nodes.

    Raises
    ------
    InputError
        In ``setup``, if nodes depend on control points that a mover may move and that are not on the design surface.
    om.AnalysisError
        In a run, if a control point is not finite.
    """

    is_linear = True
    """Whether the outputs depend linearly (affinely) on the inputs."""

    def initialize(self):
        """Declare the options."""
        self.options.declare("model", types=FittedModel, recordable=False, desc="the fitted grid")
        self.options.declare("mesh", types=MovingMesh, recordable=False, desc="its control mesh, ready to move")
        self.options.declare("surface", types=SurfaceGrid, recordable=False, desc="which nodes")

    def setup(self):
        """Declare the variables."""
        mesh, surface = self.options["mesh"], self.options["surface"]
        self._map = SurfaceMap.of(self.options["model"], mesh, surface)
        self.add_input(SURFACE_CONTROL_POINTS, val=mesh.points[mesh.surface_ids].ravel(), units="m")
        self.add_output(SURFACE, val=surface.points.ravel(), units="m")
        check_along_directions(self, LINEAR_STEP)

    def setup_partials(self):
        """Declare the Jacobian once and for all."""
        jacobian = kron(self._map.matrix, identity(3), format="coo")
        self.declare_sparse(SURFACE, SURFACE_CONTROL_POINTS, jacobian.row, jacobian.col, jacobian.data)

    def compute(self, inputs, outputs):
        """Evaluate the volumes at the nodes."""
        control_points = finite_points(inputs[SURFACE_CONTROL_POINTS], SURFACE_CONTROL_POINTS, self.msginfo)
        outputs[SURFACE] = self._map.apply(control_points).ravel()
