"""Builders of MPhys: who makes the subsystems of a scenario."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import openmdao.api as om
from mphys import Builder

from ...mesh.surface import SurfaceGrid
from ...model.fitted_model import FittedModel
from ...movement.mover import Mover
from ..flow.euler_flow import EulerFlow
from .conventions import COORDINATES, X_MESH
from .flow_group import FlowGroup
from .geometry import SurfaceGeometry
from .warper import VolumeWarper

__all__ = ["EulerBuilder", "FlowBuilder", "GeometryBuilder"]

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
        """Make the subsystem between ``x_aero0_geometry_input`` and ``x_aero0_geometry_output``."""
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
        **movement,
    ):
        self._model, self._flow, self._movement = model, flow, movement
        self._results = FLOW_RESULTS if results is None else results
        self._surface = surface or SurfaceGrid.of(model)

    def get_mesh_coordinate_subsystem(self, scenario_name: str | None = None) -> om.IndepVarComp:
        """Make the component that gives the surface nodes of the baseline, ``x_aero0_mesh``."""
        mesh = om.IndepVarComp()
        mesh.add_output(X_MESH, val=self._surface.points.ravel(), tags=COORDINATES)
        return mesh

    def get_pre_coupling_subsystem(self, scenario_name: str | None = None) -> VolumeWarper:
        """Make the group between ``x_aero`` and ``aero_vol_coords``."""
        return VolumeWarper(model=self._model, surface=self._surface, **self._movement)

    def get_coupling_group_subsystem(self, scenario_name: str | None = None) -> FlowGroup:
        """Make the group that solves the flow."""
        return FlowGroup(flow=self._flow, n_nodes=self._model.n_nodes, results=self._results)

    def get_number_of_nodes(self) -> int:
        """Count the surface nodes."""
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
        **options,
    ):
        def flow():
            return EulerFlow(model=model, **options)

        super().__init__(model, flow, surface=surface, results=EULER_RESULTS, mover=mover, require_valid=require_valid)
