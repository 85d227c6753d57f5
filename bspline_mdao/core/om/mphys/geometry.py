"""The geometry component for MPhys: design variables to the aerodynamic surface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import openmdao.api as om
from mphys import Builder
from openmdao.vectors.vector import Vector

from ....base.numerics.processes import summed
from ....names import SURFACE
from ...design.parametrization import Parametrization
from ...measures.measure import Measure
from ...mesh.surface import SurfaceGrid
from ...model.movable import Movable
from ..check_directions import check_along_directions
from ..component import LINEAR_STEP, CheckedOnProcesses
from ..model_option import Copied, declare_model
from ..surface_control import SurfaceControl
from ..surface_evaluate import SurfaceEvaluate
from ..surface_measure import SurfaceMeasure
from .conventions import COORDINATES, names_of
from .distribution import nodes_of_rank
from .point_sets import RidingPoints

__all__ = ["GeometryBuilder", "SurfaceGeometry"]


class SurfaceGeometry(Copied, om.Group):
    """Move a solver's surface by design variables, like pyGeo's ``OM_DVGEOCOMP`` with an FFD box.

    ==============================  ======  ============  =====  ====================================================
    name                            role    shape         units  meaning
    ==============================  ======  ============  =====  ====================================================
    name of each variable           input   (n_values)    its    its values, see `SurfaceControl`
    ``x_aero0_geometry_input``      input   (3 n_points)         surface nodes of the solver on the baseline (m)
    ``x_aero0_geometry_output``     output  (3 n_points)         the same, moved (m)
    ``surface``                     output  (3 n)         m      nodes of the `SurfaceGrid`, see `SurfaceEvaluate`
    name of each measure            output  its own       its    what it measures, see `SurfaceMeasure`
    ==============================  ======  ============  =====  ====================================================

    The displacement of every node is added to the input, so at initial values a solver gets its own nodes back. In
    MPhys 1.x the nodes are called ``x_aero_in`` and ``x_aero0``. On several processes they are distributed, and each
    process moves the nodes of its part of the solver.

    Options
    -------
    model : FittedModel or MeshModel
        The fitted grid, or an unstructured mesh.
    parametrization : Parametrization
        The variables and the linear constraints.
    surface : SurfaceGrid, optional
        The surface; all walls by default.
    numbers : sequence of int, optional
        Surface node of each of the solver's points on this process, possibly none, see
        `bspline_mdao.grids.topology.sharing`. By default the solver has all nodes in surface order, equally many on
        each process.
    measures : sequence of Measure
        Measures of the surface.
    point_sets : dict of str to ndarray, each of shape (n, 3)
        Baseline points of other disciplines inside the surface or on it (m), by MPhys names: with
        ``{"x_struct0": nodes}`` structural nodes are the input ``x_struct0_geometry_input`` and, moved with the
        surface, the output ``x_struct0_geometry_output``; see `RidingPoints`.
    generation : int, optional
        1 or 2: the MPhys whose names are used; by default the one that is installed.

    Raises
    ------
    InputError
        In ``setup``, if a node number or the generation does not exist, or if a point of a set is outside the surface.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.design import Twist
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> from bspline_mdao.mphys import SurfaceGeometry
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((5, 5, 5))))
    >>> shape = wing.parametrization([Twist("twist", wing.axis, stations=2)])
    >>> problem = om.Problem(SurfaceGeometry(model=wing.model, parametrization=shape, generation=2), reports=None)
    >>> _ = problem.setup()
    >>> problem.set_val("x_aero0_geometry_input", wing.surface.points.ravel())
    >>> problem.set_val("twist", [0.0, -3.0], units="deg")
    >>> problem.run_model()
    >>> problem.get_val("x_aero0_geometry_output").shape == (3 * wing.surface.n_points,)
    True
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: Movable,
            parametrization: Parametrization,
            surface: SurfaceGrid | None = None,
            numbers: Sequence[int] | np.ndarray | None = None,
            measures: Sequence[Measure] = (),
            point_sets: dict[str, np.ndarray] = {},  # noqa: B006
            generation: int | None = None,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self)
        self.options.declare(
            "parametrization", types=Parametrization, recordable=False, desc="variables and constraints"
        )
        self.options.declare("surface", default=None, recordable=False, desc="the surface")
        self.options.declare("numbers", default=None, recordable=False, desc="nodes that the solver has")
        self.options.declare("measures", default=(), recordable=False, desc="what is measured of the surface")
        self.options.declare("point_sets", default={}, recordable=False, desc="points that move with the surface")
        self.options.declare("generation", default=None, desc="MPhys whose names are used")

    def setup(self) -> None:
        """Add the components in the order of the chain."""
        model, parametrization = self.options["model"], self.options["parametrization"]
        surface = self.options["surface"] or SurfaceGrid.of(model)
        evaluate = SurfaceEvaluate(model=model, mesh=parametrization.mesh, surface=surface)
        place = _Displaced(surface=surface, numbers=self.options["numbers"], generation=self.options["generation"])
        self.add_subsystem("control", SurfaceControl(parametrization=parametrization), promotes=["*"])
        self.add_subsystem("evaluate", evaluate, promotes=["*"])
        self.add_subsystem("place", place, promotes=["*"])
        for name, points in self.options["point_sets"].items():
            settings = {"surface": surface, "generation": self.options["generation"]}
            self.add_subsystem(f"ride_{name}", RidingPoints(name=name, points=points, **settings), promotes=["*"])
        for measure in self.options["measures"]:
            self.add_subsystem(f"measure_{measure.name}", SurfaceMeasure(measure=measure), promotes=["*"])


class _Displaced(CheckedOnProcesses, om.ExplicitComponent):
    """Add the displacement of the surface to a solver's nodes."""

    def initialize(self) -> None:
        self.options.declare("surface", types=SurfaceGrid, recordable=False)
        self.options.declare("numbers", default=None, recordable=False)
        self.options.declare("generation", default=None)

    def setup(self) -> None:
        surface, is_distributed = self.options["surface"], self.comm.size > 1
        self._names = names_of(self.options["generation"], self.msginfo)
        self._numbers = nodes_of_rank(self.options["numbers"], surface.n_points, "numbers", self.comm, self.msginfo)
        nodes = {"val": surface.points[self._numbers].ravel(), "distributed": is_distributed}
        self.add_input(self._names.geometry_input, **nodes, tags=list(self._names.input_tags))
        self.add_input(SURFACE, val=surface.points.ravel(), units="m")
        self.add_output(self._names.geometry_output, **nodes, tags=COORDINATES)
        check_along_directions(self, LINEAR_STEP)

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        displacement = inputs[SURFACE].reshape(-1, 3) - self.options["surface"].points
        outputs[self._names.geometry_output] = inputs[self._names.geometry_input] + displacement[self._numbers].ravel()

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        of, wrt = self._names.geometry_output, self._names.geometry_input
        if of not in d_outputs:
            return
        if mode == "fwd":
            if wrt in d_inputs:
                d_outputs[of] += d_inputs[wrt]
            if SURFACE in d_inputs:
                d_outputs[of] += d_inputs[SURFACE].reshape(-1, 3)[self._numbers].ravel()
            return
        if wrt in d_inputs:
            d_inputs[wrt] += d_outputs[of]
        if SURFACE in d_inputs:
            bar = np.zeros((self.options["surface"].n_points, 3), dtype=d_outputs[of].dtype)
            np.add.at(bar, self._numbers, d_outputs[of].reshape(-1, 3))
            d_inputs[SURFACE] += summed(self.comm, bar).ravel()


class GeometryBuilder(Builder):
    """The geometry of scenarios that run in parallel, each with its own copy (``geometry_builder``).

    In other cases add one `SurfaceGeometry` for all scenarios.

    Parameters
    ----------
    **options
        Options of `SurfaceGeometry`.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.design import Twist
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> from bspline_mdao.mphys import GeometryBuilder
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((5, 5, 5))))
    >>> shape = wing.parametrization([Twist("twist", wing.axis, stations=2)])
    >>> builder = GeometryBuilder(model=wing.model, parametrization=shape, generation=2)
    >>> type(builder.get_mesh_coordinate_subsystem()).__name__
    'SurfaceGeometry'
    """

    def __init__(self, **options: Any):
        self._options = options

    def get_mesh_coordinate_subsystem(self, scenario_name: str | None = None) -> SurfaceGeometry:
        """Make the subsystem between the surface nodes before and after the variables."""
        return SurfaceGeometry(**self._options)
