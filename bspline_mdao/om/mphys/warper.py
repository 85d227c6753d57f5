"""The warper role of MPhys: surface coordinates to volume coordinates."""

from __future__ import annotations

import numpy as np
import openmdao.api as om

from ...fit.surface_fit import SurfaceMiss
from ...mesh.surface import SurfaceGrid
from ...model.fitted_model import FittedModel
from ...names import GRID, SURFACE
from ..component import LINEAR_STEP, SparseComponent, as_node_numbers, check_along_directions, finite_points
from ..grid_movement import GridMovement
from .conventions import COORDINATES, COUPLING, VOLUME, X_AERO, X_JIG, require_one_process

__all__ = ["VolumeWarper"]


class VolumeWarper(om.Group):
    """Move the volume behind the surface, as IDWarp does for ADflow and DAFoam.

    The surface control points are fitted to the nodes, the mover moves the control mesh, and the grid is regenerated,
    with the nodes of its wall exactly where the solver has them.

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
        The node of the surface that each of the solver's surface points is; all in their order by default. Of a node
        that is given more than once the mean counts.
    rows : sequence of int, optional
        The row of the grid that each of the solver's volume nodes is, see `bspline_mdao.topology.sharing`; by default
        all, blocks in file order, each in C order of (i, j, k).
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
    Every node that the solver gives is met to round-off, whatever the surface: one from `SurfaceGeometry`, which gives
    the grid of `GridMovement`, or an elastic wing's, of which control points alone would miss a part. That part fades
    over the blocks, see :doc:`/theory/asked_walls`; `miss` tells how much it is, and where, and so does the log to
    those who ask for information. Nodes of the surface that the solver does not give follow the control points.
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
        surface = self.options["surface"] or SurfaceGrid.of(model)
        numbers = as_node_numbers(self.options["numbers"], surface.n_points, "numbers", self.msginfo)
        valid, given = self.options["require_valid"], np.unique(numbers)
        options = {"model": model, "mover": self.options["mover"], "surface": surface, "numbers": given}
        movement = GridMovement(**options, require_valid=valid, fit=False, quality=False)
        nodes = _SolverNodes(n_nodes=model.n_nodes, rows=self.options["rows"], name=self.options["volume_name"])
        self.add_subsystem("surface", _SolverSurface(surface=surface, numbers=numbers), promotes=["*"])
        self.add_subsystem("movement", movement, promotes_inputs=[SURFACE], promotes_outputs=[GRID])
        self.add_subsystem("nodes", nodes, promotes=["*"])

    @property
    def miss(self) -> SurfaceMiss | None:
        """Distances by which control points alone would have missed the nodes in the last run; None before any."""
        return self.movement.fit_surface.miss


class _SolverSurface(SparseComponent):
    """Take the nodes of the surface from a solver, each once: the mean of those that are given more than once."""

    def initialize(self):
        self.options.declare("surface", types=SurfaceGrid, recordable=False)
        self.options.declare("numbers", recordable=False)

    def setup(self):
        numbers, surface = self.options["numbers"], self.options["surface"]
        given, self._places, counts = np.unique(numbers, return_inverse=True, return_counts=True)
        self._weights = 1.0 / counts[self._places]
        self.add_input(X_AERO, val=surface.points[numbers].ravel(), tags=COUPLING)
        self.add_input(X_JIG, val=surface.points[numbers].ravel(), tags=COORDINATES)
        self.add_output(SURFACE, val=surface.points[given].ravel(), units="m")
        check_along_directions(self, LINEAR_STEP)

    def setup_partials(self):
        rows = (3 * self._places[:, None] + [0, 1, 2]).ravel()
        self.declare_sparse(SURFACE, X_AERO, rows, np.arange(len(rows)), np.repeat(self._weights, 3))

    def compute(self, inputs, outputs):
        nodes = finite_points(inputs[X_AERO], X_AERO, self.msginfo) * self._weights[:, None]
        means = np.zeros_like(outputs[SURFACE].reshape(-1, 3))
        np.add.at(means, self._places, nodes)
        outputs[SURFACE] = means.ravel()


class _SolverNodes(SparseComponent):
    """Put the nodes of the grid in a solver's order."""

    def initialize(self):
        self.options.declare("n_nodes", types=int)
        self.options.declare("rows", default=None, recordable=False)
        self.options.declare("name", types=str)

    def setup(self):
        n_nodes = self.options["n_nodes"]
        self._rows = as_node_numbers(self.options["rows"], n_nodes, "rows", self.msginfo)
        self.add_input(GRID, shape=3 * n_nodes, units="m")
        self.add_output(self.options["name"], shape=3 * len(self._rows), tags=COUPLING)
        check_along_directions(self, LINEAR_STEP)

    def setup_partials(self):
        columns = (3 * self._rows[:, None] + [0, 1, 2]).ravel()
        self.declare_sparse(self.options["name"], GRID, np.arange(len(columns)), columns, 1.0)

    def compute(self, inputs, outputs):
        outputs[self.options["name"]] = inputs[GRID].reshape(-1, 3)[self._rows].ravel()
