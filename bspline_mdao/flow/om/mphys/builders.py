"""Builders of MPhys, which make the subsystems of a scenario, and flow groups with its names and tags."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import openmdao.api as om
from mphys import Builder

from ....base.numerics.processes import ONE
from ....core.design.hinge import Hinge
from ....core.mesh.surface import SurfaceGrid
from ....core.model.fitted_model import FittedModel
from ....core.model.movable import Movable
from ....core.movement.mover import Mover
from ....core.om.model_option import Copied
from ....core.om.mphys.conventions import COORDINATES, COUPLING, INPUT, RESULT, VOLUME, Names, names_of
from ....core.om.mphys.distribution import nodes_of_rank
from ....core.om.mphys.renamed import Renamed, Renaming
from ....core.om.mphys.solver_loads import WALL_FORCES, SolverLoads
from ....core.om.mphys.warper import VolumeWarper
from ....errors import InputError
from ....names import GRID
from ...functionals import of_flow
from ..euler_flow import EulerFlow
from ..outputs import units_of

__all__ = ["EulerBuilder", "FlowBuilder", "FlowGroup"]


FLOW_RESULTS = units_of(("CL", "CD", "CM", "CD_induced", "span_load"))
"""Units of the outputs that every flow group has, including those of other packages."""

EULER_RESULTS = units_of(of_flow("euler"))
"""Units of the outputs of `EulerFlow`, except its states, hinge moments and the angle of a given lift."""


SCENARIOS = ("aerodynamic", "aerostructural")
"""Scenarios for which flows are built: the second moves the grid inside the coupling, and returns loads."""


class FlowBuilder(Builder):
    """The aerodynamic solver of scenarios: a flow group of this package with its movement of the grid.

    Parameters
    ----------
    model : FittedModel or MeshModel
        The fitted grid; or an unstructured mesh, on one process.
    flow : callable
        Makes a new group that solves the flow for every scenario, with ``grid``, ``alpha`` and ``Mach_number``.
    surface : SurfaceGrid, optional
        The design surface; all walls by default.
    results : dict, optional
        Units of the outputs for a scenario, by name; `FLOW_RESULTS` by default.
    generation : int, optional
        1 or 2: the MPhys version whose names are used; by default the installed one.
    scenario : str
        "aerodynamic": the grid is moved once, before the flow is solved. "aerostructural": it is moved inside the
        coupling, after the structure, and the loads ``f_aero`` (N) go to the structure; the flow then has an input
        ``dynamic_pressure`` (Pa) and an output ``wall_forces`` (N) on the nodes of the surface, as in `EulerFlow`.
    **movement
        Further options of `VolumeWarper`: ``mover``, ``require_valid``, ``comoving``.

    Raises
    ------
    InputError
        If there is no such scenario; in a run, if an "aerodynamic" one is placed before a coupling with a structure.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> builder = FlowBuilder(fit_grid(flat_plate_grid((5, 5, 5))), om.Group, results={})
    >>> builder.get_number_of_nodes()
    37
    """

    def __init__(
        self,
        model: Movable,
        flow: Callable[[], om.Group],
        *,
        surface: SurfaceGrid | None = None,
        results: Mapping[str, str | None] | None = None,
        generation: int | None = None,
        scenario: str = "aerodynamic",
        **movement: Any,
    ):
        if scenario not in SCENARIOS:
            raise InputError(f"{type(self).__name__}: there is no scenario {scenario!r}; give one of {SCENARIOS}")
        self._model, self._flow, self._movement = model, flow, movement
        self._generation, self._is_coupled = generation, scenario == "aerostructural"
        self._results = FLOW_RESULTS if results is None else results
        self._surface, self._comm = surface or SurfaceGrid.of(model), ONE
        self._hinges: dict[str, np.ndarray] = {}

    def initialize(self, comm: Any) -> None:
        """Take the communicator of the processes that solve the flow: MPhys or the script calls this first."""
        self._comm = comm

    def _numbers(self) -> np.ndarray:
        """Nodes of the surface on this process."""
        return nodes_of_rank(None, self._surface.n_points, "numbers", self._comm, type(self).__name__)

    def get_mesh_coordinate_subsystem(self, scenario_name: str | None = None) -> om.IndepVarComp:
        """Make the component that provides the surface nodes of the baseline, ``x_aero0_mesh`` (``x_aero0``)."""
        mesh = om.IndepVarComp()
        name = names_of(self._generation, type(self).__name__).mesh
        nodes = self._surface.points[self._numbers()].ravel()
        mesh.add_output(name, val=nodes, distributed=self._comm.size > 1, tags=COORDINATES)
        return mesh

    def get_pre_coupling_subsystem(self, scenario_name: str | None = None) -> VolumeWarper | None:
        """Make the group between ``x_aero`` and ``aero_vol_coords``, unless it belongs into the coupling."""
        return None if self._is_coupled else self._warper()

    def _warper(self) -> VolumeWarper:
        return VolumeWarper(model=self._model, surface=self._surface, **self._movement)

    def get_coupling_group_subsystem(self, scenario_name: str | None = None) -> FlowGroup:
        """Make the group that solves the flow; coupled with a structure, it also moves the grid and has loads."""
        options = {"n_nodes": self._model.n_nodes, "results": self._results, "generation": self._generation}
        options["hinges"] = self._hinges
        if self._is_coupled:
            options |= {"warper": self._warper(), "n_loaded": self._surface.n_points}
        return FlowGroup(flow=self._flow_of(scenario_name), **options)

    def _flow_of(self, scenario_name: str | None) -> Callable[[], om.Group]:
        """Maker of the flow of a scenario."""
        return self._flow

    def get_number_of_nodes(self) -> int:
        """Count the nodes of the design surface on this process."""
        return len(self._numbers())

    def get_ndof(self) -> int:
        """Count the coordinates, displacements and forces of a node."""
        return 3


class EulerBuilder(FlowBuilder):
    """The Euler equations as the aerodynamic solver of scenarios.

    Parameters
    ----------
    model : FittedModel
        The fitted grid.
    surface : SurfaceGrid, optional
        The design surface; all walls by default.
    mover : Mover, optional
        Moves the control mesh; by default `Rotations`.
    require_valid : bool
        Whether to refuse surfaces that invert cells of the grid.
    comoving : bool
        Whether everything fixed, such as the far field, follows the rigid part of the surface's motion.
    generation : int, optional
        1 or 2: the MPhys version whose names are used; by default the installed one.
    scenario : str
        "aerodynamic" or "aerostructural", see `FlowBuilder`.
    **options
        Options of `EulerFlow`, such as ``reference_area``. With ``trim`` there is ``CL_target`` instead of the angle of
        attack, and ``alpha`` is a result.

    Examples
    --------
    >>> from bspline_mdao import EulerFlow, fit_grid
    >>> from bspline_mdao.generators import infinite_wing_grid, naca_section
    >>> from bspline_mdao.measures import SurfaceGrid
    >>> from bspline_mdao.mphys import EulerBuilder
    >>> model = fit_grid(infinite_wing_grid(naca_section(0.12), (17, 9)))
    >>> builder = EulerBuilder(model, reference_area=1.0, iprint=0)  # options of EulerFlow
    >>> builder.get_number_of_nodes() == SurfaceGrid.of(model).n_points
    True
    """

    def __init__(
        self,
        model: FittedModel,
        *,
        surface: SurfaceGrid | None = None,
        mover: Mover | None = None,
        require_valid: bool = True,
        comoving: bool = False,
        generation: int | None = None,
        scenario: str = "aerodynamic",
        **options: Any,
    ):
        surface = surface or SurfaceGrid.of(model)
        if scenario == "aerostructural":
            options["loaded"] = surface

        def flow() -> EulerFlow:
            return EulerFlow(model=model, **options)

        results = {**EULER_RESULTS, **{hinge.output: None for hinge in options.get("hinges", ())}}
        if options.get("trim"):
            results["alpha"] = "deg"

        movement = {"mover": mover, "require_valid": require_valid, "comoving": comoving}
        super().__init__(
            model, flow, surface=surface, results=results, generation=generation, scenario=scenario, **movement
        )
        axes = (hinge.axis for hinge in options.get("hinges", ()))
        self._hinges = {axis.name: axis.points for axis in axes if isinstance(axis, Hinge)}


class FlowGroup(Copied, om.Group):
    """Solve a flow on the volume nodes of MPhys.

    =====================  ======  ==============  =====  =========================================
    name                   role    shape           units  meaning
    =====================  ======  ==============  =====  =========================================
    ``aero_vol_coords``    input   (3 n_nodes)            nodes of the grid (m)
    ``angle_of_attack``    input   (1,)            deg    2 by default; ``CL_target`` where ``alpha`` is a result
    ``mach_number``        input   (1,)                   0.3 by default
    name of each hinge     input   (6,)            m      both points of its axis, of moments about hinges that move
    name of each result    output  the flow's own         coefficients and whatever else was named
    =====================  ======  ==============  =====  =========================================

    In the coupling with a structure, with a ``warper`` and ``n_loaded``, the nodes of the grid are an output, and
    there are also

    =====================  ======  ==============  =====  =========================================
    ``x_aero``             input   (3 n_loaded)           nodes of the surface (m)
    ``dynamic_pressure``   input   (1,)            Pa     of the free stream; to be given
    ``f_aero``             output  (3 n_loaded)           forces on the nodes of the surface (N)
    =====================  ======  ==============  =====  =========================================

    In MPhys 1.x the conditions are called ``aoa``, ``mach`` and ``q_inf``.

    Options
    -------
    flow : callable
        Makes the group that solves the flow, with ``grid``, ``alpha`` (deg) and ``Mach_number``.
    n_nodes : int
        Number of nodes of the grid.
    results : dict
        Units of its outputs to pass on, None for no unit, by name.
    generation : int, optional
        1 or 2: the MPhys version whose names are used; by default the installed one.
    warper : VolumeWarper, optional
        Moves the grid before the flow is solved.
    n_loaded : int, optional
        Nodes of the surface that get forces; None for no forces.
    hinges : dict
        Inputs of the flow that are points of hinges, by name: their values on the baseline (m).

    Raises
    ------
    InputError
        In ``setup``, if forces are required of a flow that has none.
    """

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("flow", types=Callable, recordable=False, desc="makes the group that solves the flow")
        self.options.declare("n_nodes", types=int, desc="number of nodes of the grid")
        self.options.declare("results", types=Mapping, desc="units of the outputs that it passes on, by name")
        self.options.declare("generation", default=None, desc="MPhys whose names are used")
        self.options.declare("warper", default=None, recordable=False, desc="moves the grid before the flow is solved")
        self.options.declare("n_loaded", default=None, desc="nodes of the surface that get forces")
        self.options.declare("hinges", default={}, recordable=False, desc="points of hinges on the baseline, by name")

    def setup(self) -> None:
        """Put the flow between two components that translate names; in a coupling, with its movement and its loads."""
        names, n_loaded = names_of(self.options["generation"], self.msginfo), self.options["n_loaded"]
        conditions = _conditions(3 * self.options["n_nodes"], names, self.comm)
        results = _results(self.options["results"])
        if "alpha" in self.options["results"]:
            conditions[1] = _LIFT
        targets = [GRID, "CL_target" if conditions[1] is _LIFT else "alpha", "Mach_number"]
        if n_loaded is not None:
            conditions.append(_pressure(names))
            targets.append("dynamic_pressure")
        for name, points in self.options["hinges"].items():
            metres = {"val": points.ravel(), "units": "m"}
            conditions.append(Renaming(name, f"{name}_of_flow", {**metres, "tags": INPUT}, metres))
            targets.append(name)
        if self.options["warper"] is not None:
            self.add_subsystem("warper", self.options["warper"], promotes=["*"])
        self.add_subsystem("conditions", Renamed(pairs=conditions), promotes_inputs=["*"])
        self.add_subsystem("flow", self.options["flow"]())
        self.add_subsystem("results", Renamed(pairs=results), promotes_outputs=["*"])
        for pair, target in zip(conditions, targets):
            self.connect(f"conditions.{pair.target}", f"flow.{target}")
        for pair in results:
            self.connect(f"flow.{pair.target}", f"results.{pair.source}")
        if n_loaded is not None:
            self.add_subsystem("loads", SolverLoads(n_points=n_loaded), promotes_outputs=["*"])
            self.connect(f"flow.{WALL_FORCES}", f"loads.{WALL_FORCES}")

    def configure(self) -> None:
        """Refuse an unsuitable flow: without forces for a structure, or with the whole grid on each process."""
        outputs = {meta["prom_name"] for meta in self.flow.get_io_metadata("output").values()}
        if self.options["n_loaded"] is not None and WALL_FORCES not in outputs:
            raise InputError(
                f"{self.msginfo}: the flow has no output '{WALL_FORCES}', which an aerostructural scenario needs; take "
                f"EulerBuilder, or add forces (N) on the nodes of the surface to the flow"
            )
        grids = (meta for meta in self.flow.get_io_metadata("input").values() if meta["prom_name"] == GRID)
        if self.comm.size > 1 and not all(meta["distributed"] for meta in grids):
            raise InputError(
                f"{self.msginfo}: the flow wants the whole grid, and each of {self.comm.size} processes has a part; "
                f"take EulerBuilder, or one process for each scenario"
            )


_PARTS = {"shape_by_conn": True, "distributed": True}, {"copy_shape": VOLUME, "distributed": True}
"""Options for the nodes of the grid at inputs and outputs if each process has some of them."""


def _conditions(size: int, names: Names, comm: Any) -> list[Renaming]:
    """Names of MPhys for the inputs of a flow group; each of several processes has its nodes of the grid."""
    degrees = {"val": 2.0, "units": "deg"}
    given, handed = ({"shape": size}, {"shape": size}) if comm.size == 1 else _PARTS
    return [
        Renaming(VOLUME, GRID, {**given, "tags": COUPLING}, {**handed, "units": "m"}),
        Renaming(names.angle_of_attack, "alpha", {**degrees, "tags": INPUT}, degrees),
        Renaming(names.mach_number, "Mach_number", {"val": 0.3, "tags": INPUT}, {"val": 0.3}),
    ]


_LIFT = Renaming("CL_target", "lift_of_flow", {"val": 0.3, "tags": INPUT}, {"val": 0.3})
"""The lift of a flow whose angle of attack is a result."""


def _pressure(names: Names) -> Renaming:
    """Name of MPhys for the dynamic pressure; the flow may use the same name."""
    # It has no default, so the input is NaN. The output is a number: solvers look at what outputs were before.
    as_input = {"val": float("nan"), "units": "Pa", "tags": INPUT}
    return Renaming(names.dynamic_pressure, "pressure_of_stream", as_input, {"val": 0.0, "units": "Pa"})


def _results(units: Mapping[str, str | None]) -> list[Renaming]:
    """Outputs of a flow group that keep their names."""
    pairs = []
    for name, unit in units.items():
        source = f"{name}_of_flow"
        as_output = {"copy_shape": source, "units": unit, "tags": RESULT}
        pairs.append(Renaming(source, name, {"shape_by_conn": True, "units": unit}, as_output))
    return pairs
