"""The warper role of MPhys: surface coordinates to volume coordinates."""

from __future__ import annotations

import numpy as np
import openmdao.api as om

from ..components.control_mesh_move import mesh_of
from ..components.grid_movement import GridMovement
from ..components.jacobian import LINEAR_STEP, SparseComponent, add_product, check_along_directions, finite_points
from ..fit.surface_fit import SurfaceMiss
from ..geometry.surface import SurfaceGrid
from ..geometry.surface_inverse import SurfaceInverse
from ..geometry.surface_map import SurfaceMap
from ..grids.sharing import node_sharing
from ..model import FittedModel
from ..movement.boundary import moving_mesh
from ..movement.elasticity import LinearElasticity
from ..names import GRID, SURFACE_CONTROL_POINTS
from .conventions import COORDINATES, COUPLING, VOLUME, X_AERO, X_JIG, numbers_given, require_one_process

__all__ = ["VolumeWarper"]


class VolumeWarper(om.Group):
    """Move the volume behind the surface, as IDWarp does for ADflow and DAFoam.

    The surface control points are fitted to the nodes, the mover moves the control mesh, and the grid is regenerated.

    ===================  ======  ============  ==============================================================
    name                 role    shape         meaning
    ===================  ======  ============  ==============================================================
    ``x_aero``           input   (3 n_points)  surface nodes of the solver (m)
    ``x_aero0``          input   (3 n_points)  the same before an analysis; MPhys connects it, nothing reads it
    ``aero_vol_coords``  output  (3 n_nodes)   volume nodes of the solver (m), under the name ``volume_name``
    ===================  ======  ============  ==============================================================

    Options
    -------
    model : FittedModel
        The fitted grid.
    mover : Mover, optional
        Moves its control mesh; by default linear elasticity with all walls as the design surface.
    surface : SurfaceGrid, optional
        The design surface; all walls by default.
    numbers : sequence of int, optional
        The node of the surface that each of the solver's surface points is; all in their order by default.
    rows : sequence of int, optional
        The row of the grid that each of the solver's volume nodes is, see `bspline_mdao.grids.lookup`; by default all,
        blocks in file order, each in C order of (i, j, k).
    volume_name : str
        What the solver calls the volume nodes: "aero_vol_coords" (DAFoam), "adflow_vol_coords" (ADflow).
    require_valid : bool
        Refuse a tangled control mesh, see `ControlMeshMove`.

    Raises
    ------
    InputError
        In ``setup``, if a number or a row does not exist, if the nodes do not determine the control points, if the
        mover is that of another model, or if there are several processes.

    Notes
    -----
    Surfaces from `SurfaceGeometry` are met to round-off. Of others, such as an elastic wing's, the grid's wall keeps
    what the control points can represent; the rest, a residual of the fit, stays behind. How much that is, and where,
    is told in every run: in the log, as a warning beyond a thousandth of the surface's size, and by `miss`.
    """

    def initialize(self):
        """Declare the options."""
        self.options.declare("model", types=FittedModel, recordable=False, desc="the fitted grid")
        self.options.declare("mover", default=None, recordable=False, desc="moves the control mesh of the model")
        self.options.declare("surface", default=None, recordable=False, desc="the design surface")
        self.options.declare("numbers", default=None, recordable=False, desc="surface nodes that the solver has")
        self.options.declare("rows", default=None, recordable=False, desc="volume nodes that the solver has")
        self.options.declare("volume_name", default=VOLUME, types=str, desc="name of the volume nodes")
        self.options.declare("require_valid", types=bool, default=True, desc="refuse a tangled control mesh")

    def setup(self):
        """Add the components in the order of the chain."""
        require_one_process(self.comm, self.msginfo)
        model = self.options["model"]
        mover = self.options["mover"] or LinearElasticity(moving_mesh(model))
        surface = self.options["surface"] or SurfaceGrid.of(model)
        surface_map = SurfaceMap.of(model, mesh_of(mover, self.msginfo), surface)
        names = {"numbers": self.options["numbers"], "model": model, "surface": surface, "surface_map": surface_map}
        valid = self.options["require_valid"]
        movement = GridMovement(model=model, mover=mover, require_valid=valid, fit=False, quality=False)
        nodes = _SolverNodes(n_nodes=model.n_nodes, rows=self.options["rows"], name=self.options["volume_name"])
        self.add_subsystem("fit_surface", _SurfaceFit(**names), promotes=["*"])
        self.add_subsystem("movement", movement, promotes_inputs=[SURFACE_CONTROL_POINTS], promotes_outputs=[GRID])
        self.add_subsystem("nodes", nodes, promotes=["*"])

    @property
    def miss(self) -> SurfaceMiss | None:
        """How far the wall misses the solver's nodes after the last run; None before any."""
        return self.fit_surface.miss


class _SurfaceFit(om.ExplicitComponent):
    """Fit the surface control points to a solver's surface nodes."""

    def initialize(self):
        self.options.declare("model", types=FittedModel, recordable=False)
        self.options.declare("surface", types=SurfaceGrid, recordable=False)
        self.options.declare("surface_map", types=SurfaceMap, recordable=False)
        self.options.declare("numbers", default=None, recordable=False)
        self.miss: SurfaceMiss | None = None

    def setup(self):
        surface, topology = self.options["surface"], self.options["model"].topology
        numbers = numbers_given(self.options["numbers"], surface.n_points, "numbers", self.msginfo)
        self._inverse = SurfaceInverse.of(self.options["surface_map"], numbers)
        self._places = topology, node_sharing(topology).source_rows(), surface.rows[numbers]
        nodes = surface.points[numbers]
        self.add_input(X_AERO, val=nodes.ravel(), tags=COUPLING)
        self.add_input(X_JIG, val=nodes.ravel(), tags=COORDINATES)
        self.add_output(SURFACE_CONTROL_POINTS, val=self._inverse.apply(nodes).ravel(), units="m")
        check_along_directions(self, LINEAR_STEP)

    def compute(self, inputs, outputs):
        nodes = finite_points(inputs[X_AERO], X_AERO, self.msginfo)
        points = self._inverse.apply(nodes.real)
        outputs[SURFACE_CONTROL_POINTS] = points.ravel()
        if self.under_complex_step:
            outputs[SURFACE_CONTROL_POINTS] += 1j * self._inverse.jvp(nodes.imag).ravel()
        if not self.under_approx:
            self.miss = SurfaceMiss.of(*self._places, self._inverse.nodes(points), nodes)
            self.miss.log(f"{self.msginfo}: ")

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        jvp, vjp = self._inverse.jvp, self._inverse.vjp
        add_product(jvp, vjp, d_inputs, d_outputs, mode, of=SURFACE_CONTROL_POINTS, wrt=X_AERO)


class _SolverNodes(SparseComponent):
    """Hand the nodes of the grid over in a solver's order."""

    def initialize(self):
        self.options.declare("n_nodes", types=int)
        self.options.declare("rows", default=None, recordable=False)
        self.options.declare("name", types=str)

    def setup(self):
        n_nodes = self.options["n_nodes"]
        self._rows = numbers_given(self.options["rows"], n_nodes, "rows", self.msginfo)
        self.add_input(GRID, shape=3 * n_nodes, units="m")
        self.add_output(self.options["name"], shape=3 * len(self._rows), tags=COUPLING)
        check_along_directions(self, LINEAR_STEP)

    def setup_partials(self):
        columns = (3 * self._rows[:, None] + [0, 1, 2]).ravel()
        self.declare_sparse(self.options["name"], GRID, np.arange(len(columns)), columns, 1.0)

    def compute(self, inputs, outputs):
        outputs[self.options["name"]] = inputs[GRID].reshape(-1, 3)[self._rows].ravel()
