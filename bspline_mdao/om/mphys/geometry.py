"""The geometry role of MPhys: design variables to the aerodynamic surface."""

from __future__ import annotations

import numpy as np
import openmdao.api as om

from ...design.parametrization import Parametrization
from ...mesh.surface import SurfaceGrid
from ...model.fitted_model import FittedModel
from ...names import SURFACE
from ..component import LINEAR_STEP, SparseComponent, as_node_numbers, check_along_directions
from ..surface_control import SurfaceControl
from ..surface_evaluate import SurfaceEvaluate
from ..surface_measure import SurfaceMeasure
from .conventions import COORDINATES, X_INPUT, X_OUTPUT, require_one_process

__all__ = ["SurfaceGeometry"]


class SurfaceGeometry(om.Group):
    """Move the surface of a solver by our design variables, as pyGeo's ``OM_DVGEOCOMP`` does with an FFD box.

    ==============================  ======  ============  =====  ====================================================
    name                            role    shape         units  meaning
    ==============================  ======  ============  =====  ====================================================
    name of each variable           input   (n_values)    its    its values, see `SurfaceControl`
    ``x_aero0_geometry_input``      input   (3 n_points)         surface nodes of the solver on the baseline (m)
    ``x_aero0_geometry_output``     output  (3 n_points)         the same, moved (m)
    ``surface``                     output  (3 n)         m      nodes of the `SurfaceGrid`, see `SurfaceEvaluate`
    name of each measure            output  its own       its    what it measures, see `SurfaceMeasure`
    ==============================  ======  ============  =====  ====================================================

    The displacement of every node is added to the input: at initial values a solver gets its own nodes back.

    Options
    -------
    model : FittedModel
        The fitted grid.
    parametrization : Parametrization
        The variables and the linear constraints.
    surface : SurfaceGrid, optional
        The surface; all walls by default.
    numbers : sequence of int, optional
        The node of the surface that each of the solver's points is, see `bspline_mdao.topology.sharing`; by default the
        solver has all nodes in the order of the surface.
    measures : sequence of Measure
        What is measured of the surface.

    Raises
    ------
    InputError
        In ``setup``, if a number does not exist, or if there are several processes.
    """

    def initialize(self):
        """Declare the options."""
        self.options.declare("model", types=FittedModel, recordable=False, desc="the fitted grid")
        self.options.declare(
            "parametrization", types=Parametrization, recordable=False, desc="variables and constraints"
        )
        self.options.declare("surface", default=None, recordable=False, desc="the surface")
        self.options.declare("numbers", default=None, recordable=False, desc="nodes that the solver has")
        self.options.declare("measures", default=(), recordable=False, desc="what is measured of the surface")

    def setup(self):
        """Add the components in the order of the chain."""
        model, parametrization = self.options["model"], self.options["parametrization"]
        surface = self.options["surface"] or SurfaceGrid.of(model)
        evaluate = SurfaceEvaluate(model=model, mesh=parametrization.mesh, surface=surface)
        place = _Displaced(surface=surface, numbers=self.options["numbers"])
        self.add_subsystem("control", SurfaceControl(parametrization=parametrization), promotes=["*"])
        self.add_subsystem("evaluate", evaluate, promotes=["*"])
        self.add_subsystem("place", place, promotes=["*"])
        for measure in self.options["measures"]:
            self.add_subsystem(f"measure_{measure.name}", SurfaceMeasure(measure=measure), promotes=["*"])


class _Displaced(SparseComponent):
    """Add the displacement of the surface to a solver's nodes."""

    def initialize(self):
        self.options.declare("surface", types=SurfaceGrid, recordable=False)
        self.options.declare("numbers", default=None, recordable=False)

    def setup(self):
        require_one_process(self.comm, self.msginfo)
        baseline = self.options["surface"].points
        self._numbers = as_node_numbers(self.options["numbers"], len(baseline), "numbers", self.msginfo)
        nodes = baseline[self._numbers].ravel()
        self.add_input(X_INPUT, val=nodes, tags=COORDINATES)
        self.add_input(SURFACE, val=baseline.ravel(), units="m")
        self.add_output(X_OUTPUT, val=nodes, tags=COORDINATES)
        check_along_directions(self, LINEAR_STEP)

    def setup_partials(self):
        columns = (3 * self._numbers[:, None] + [0, 1, 2]).ravel()
        rows = np.arange(len(columns))
        self.declare_sparse(X_OUTPUT, X_INPUT, rows, rows, 1.0)
        self.declare_sparse(X_OUTPUT, SURFACE, rows, columns, 1.0)

    def compute(self, inputs, outputs):
        displacement = inputs[SURFACE].reshape(-1, 3) - self.options["surface"].points
        outputs[X_OUTPUT] = inputs[X_INPUT] + displacement[self._numbers].ravel()
