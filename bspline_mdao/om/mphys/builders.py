"""Builders of MPhys, which make the subsystems of a scenario, and our flow groups under its names and tags."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import openmdao.api as om
from mphys import Builder

from ...mesh.surface import SurfaceGrid
from ...model.fitted_model import FittedModel
from ...movement.mover import Mover
from ...names import GRID
from ..component import LINEAR_STEP, check_along_directions
from ..flow.euler_flow import EulerFlow
from .conventions import COORDINATES, COUPLING, INPUT, RESULT, VOLUME, Names, names_of
from .geometry import SurfaceGeometry
from .warper import VolumeWarper

__all__ = ["EulerBuilder", "FlowBuilder", "FlowGroup", "GeometryBuilder"]


FLOW_RESULTS = {"CL": None, "CD": None, "CM": None, "CD_induced": None, "span_load": "m"}
"""Units of the outputs that every flow group has."""

EULER_RESULTS = {**FLOW_RESULTS, "CD_entropy": None, "Cp": None}
"""Units of the outputs of `EulerFlow`, but for its states."""


class GeometryBuilder(Builder):
    """The geometry of scenarios that run in parallel, each with its own copy (``geometry_builder``).

    Elsewhere add a `SurfaceGeometry` yourself, once for all scenarios.

    Parameters
    ----------
    **options
        Those of `SurfaceGeometry`.
    """

    def __init__(self, **options):
        self._options = options

    def get_mesh_coordinate_subsystem(self, scenario_name: str | None = None) -> SurfaceGeometry:
        """Make the subsystem between the surface nodes before and after the variables."""
        return SurfaceGeometry(**self._options)


class FlowBuilder(Builder):
    """The aerodynamic solver of scenarios: one of our flow groups behind our movement of the grid.

    Parameters
    ----------
    model : FittedModel
        The fitted grid.
    flow : callable
        Makes the group that solves the flow, a new one for every scenario: of ``grid``, ``alpha`` and ``Mach_number``.
    surface : SurfaceGrid, optional
        The design surface; all walls by default.
    results : dict, optional
        Units of its outputs that a scenario is to have, by name; `FLOW_RESULTS` by default.
    generation : int, optional
        1 or 2: the MPhys whose names are used; by default the one that is installed.
    **movement
        Further options of `VolumeWarper`: ``mover``, ``require_valid``.

    Examples
    --------
    >>> from bspline_mdao import fit_grid, flat_plate_grid
    >>> builder = FlowBuilder(fit_grid(flat_plate_grid((5, 5, 5))), om.Group, results={})
    >>> builder.get_number_of_nodes()
    37
    """

    def __init__(
        self,
        model: FittedModel,
        flow: Callable[[], om.Group],
        *,
        surface: SurfaceGrid | None = None,
        results: Mapping[str, str | None] | None = None,
        generation: int | None = None,
        **movement,
    ):
        self._model, self._flow, self._movement = model, flow, movement
        self._generation = generation
        self._results = FLOW_RESULTS if results is None else results
        self._surface = surface or SurfaceGrid.of(model)

    def get_mesh_coordinate_subsystem(self, scenario_name: str | None = None) -> om.IndepVarComp:
        """Make the component that gives the surface nodes of the baseline, ``x_aero0_mesh`` (``x_aero0``)."""
        mesh = om.IndepVarComp()
        name = names_of(self._generation, type(self).__name__).mesh
        mesh.add_output(name, val=self._surface.points.ravel(), tags=COORDINATES)
        return mesh

    def get_pre_coupling_subsystem(self, scenario_name: str | None = None) -> VolumeWarper:
        """Make the group between ``x_aero`` and ``aero_vol_coords``."""
        return VolumeWarper(model=self._model, surface=self._surface, **self._movement)

    def get_coupling_group_subsystem(self, scenario_name: str | None = None) -> FlowGroup:
        """Make the group that solves the flow."""
        options = {"n_nodes": self._model.n_nodes, "results": self._results, "generation": self._generation}
        return FlowGroup(flow=self._flow, **options)

    def get_number_of_nodes(self) -> int:
        """Count the nodes of the design surface."""
        return self._surface.n_points


class EulerBuilder(FlowBuilder):
    """The Euler equations as the aerodynamic solver of scenarios.

    Parameters
    ----------
    model : FittedModel
        The fitted grid.
    surface : SurfaceGrid, optional
        The design surface; all walls by default.
    mover : Mover, optional
        Moves the control mesh; by default linear elasticity.
    require_valid : bool
        Refuse control meshes with inverted elements.
    generation : int, optional
        1 or 2: the MPhys whose names are used; by default the one that is installed.
    **options
        Those of `EulerFlow`, such as ``reference_area``.
    """

    def __init__(
        self,
        model: FittedModel,
        *,
        surface: SurfaceGrid | None = None,
        mover: Mover | None = None,
        require_valid: bool = True,
        generation: int | None = None,
        **options,
    ):
        def flow():
            return EulerFlow(model=model, **options)

        movement = {"mover": mover, "require_valid": require_valid}
        super().__init__(model, flow, surface=surface, results=EULER_RESULTS, generation=generation, **movement)


class FlowGroup(om.Group):
    """Solve a flow on the volume nodes that MPhys hands over.

    =====================  ======  ==============  =====  =========================================
    name                   role    shape           units  meaning
    =====================  ======  ==============  =====  =========================================
    ``aero_vol_coords``    input   (3 n_nodes)            nodes of the grid (m)
    ``angle_of_attack``    input   (1,)            deg    2 by default
    ``mach_number``        input   (1,)                   0.3 by default
    name of each result    output  the flow's own         coefficients and whatever else was named
    =====================  ======  ==============  =====  =========================================

    In MPhys 1.x the conditions are called ``aoa`` and ``mach``.

    Options
    -------
    flow : callable
        Makes the group that solves the flow: of ``grid``, ``alpha`` (deg) and ``Mach_number``.
    n_nodes : int
        Number of nodes of the grid.
    results : dict
        Units of its outputs to hand on, None where there are none, by name.
    generation : int, optional
        1 or 2: the MPhys whose names are used; by default the one that is installed.
    """

    def initialize(self):
        """Declare the options."""
        self.options.declare("flow", types=Callable, recordable=False, desc="makes the group that solves the flow")
        self.options.declare("n_nodes", types=int, desc="number of nodes of the grid")
        self.options.declare("results", types=Mapping, desc="units of its outputs to hand on, by name")
        self.options.declare("generation", default=None, desc="MPhys whose names are used")

    def setup(self):
        """Put the flow between two components that translate."""
        names = names_of(self.options["generation"], self.msginfo)
        conditions = _conditions(3 * self.options["n_nodes"], names)
        results = _results(self.options["results"])
        self.add_subsystem("conditions", _Renamed(pairs=conditions), promotes_inputs=["*"])
        self.add_subsystem("flow", self.options["flow"]())
        self.add_subsystem("results", _Renamed(pairs=results), promotes_outputs=["*"])
        for pair in conditions:
            self.connect(f"conditions.{pair.target}", f"flow.{pair.target}")
        for pair in results:
            self.connect(f"flow.{pair.target}", f"results.{pair.source}")


@dataclass(frozen=True)
class _Pair:
    """A variable under two names, and how each is declared."""

    source: str
    target: str
    as_input: dict
    as_output: dict


def _conditions(size: int, names: Names) -> list[_Pair]:
    """Names of MPhys for the inputs of a flow group."""
    degrees = {"val": 2.0, "units": "deg"}
    return [
        _Pair(VOLUME, GRID, {"shape": size, "tags": COUPLING}, {"shape": size, "units": "m"}),
        _Pair(names.angle_of_attack, "alpha", {**degrees, "tags": INPUT}, degrees),
        _Pair(names.mach_number, "Mach_number", {"val": 0.3, "tags": INPUT}, {"val": 0.3}),
    ]


def _results(units: Mapping[str, str | None]) -> list[_Pair]:
    """Outputs of a flow group, which are to keep their names."""
    pairs = []
    for name, unit in units.items():
        source = f"{name}_of_flow"
        as_output = {"copy_shape": source, "units": unit, "tags": RESULT}
        pairs.append(_Pair(source, name, {"shape_by_conn": True, "units": unit}, as_output))
    return pairs


class _Renamed(om.ExplicitComponent):
    """Copy variables to other names, with the tags by which MPhys promotes them."""

    def initialize(self):
        self.options.declare("pairs", recordable=False)

    def setup(self):
        for pair in self.options["pairs"]:
            self.add_input(pair.source, **pair.as_input)
            self.add_output(pair.target, **pair.as_output)
        check_along_directions(self, LINEAR_STEP)

    def compute(self, inputs, outputs):
        for pair in self.options["pairs"]:
            outputs[pair.target] = inputs[pair.source]

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        for pair in self.options["pairs"]:
            if pair.target in d_outputs and pair.source in d_inputs:
                if mode == "fwd":
                    d_outputs[pair.target] += d_inputs[pair.source]
                else:
                    d_inputs[pair.source] += d_outputs[pair.target]
