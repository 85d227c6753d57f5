"""Forces of the Euler flow on the nodes of a surface, as an OpenMDAO component.

Theory: ``docs/theory/aerostructure.rst``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector

from ...core.mesh.surface import SurfaceGrid
from ...core.om.component import CheckedOnProcesses, add_bar, direction_in
from ...errors import InputError
from ...names import GRID
from ..euler.flow_grid import FlowGrid
from ..euler.gas import N_STATES
from ..euler.wall_forces import WallForces
from .euler_state import check_on_grid

__all__ = ["EulerWallForces"]

INPUTS = ("states", GRID, "Mach_number", "dynamic_pressure")
"""In the order of the kernel's arguments."""


class EulerWallForces(CheckedOnProcesses, om.ExplicitComponent):
    """Forces on the nodes of a surface, with the same sum and moment as the pressures on its faces.

    ====================  ======  ============  =====  =================================================================
    name                  role    shape         units  meaning
    ====================  ======  ============  =====  =================================================================
    ``states``            input   (5 n_cells)          see `EulerState`
    ``grid``              input   (3 n_nodes)   m      nodes
    ``Mach_number``       input   (1,)                 of the free stream
    ``dynamic_pressure``  input   (1,)          Pa     of the free stream; to be given, there is no default
    ``wall_forces``       output  (3 n_points)  N      forces on the nodes of the surface, above the pressure at rest
    ====================  ======  ============  =====  =================================================================

    Options
    -------
    flow : FlowGrid
        Faces and axes.
    nodes : ndarray, shape (n_nodes, 3)
        Baseline nodes (m).
    surface : SurfaceGrid
        The surface: walls of the flow.

    Raises
    ------
    InputError
        In ``setup``, if the surface does not consist of walls; in a run, if there is no dynamic pressure.
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("flow", types=FlowGrid, recordable=False, desc="faces and axes")
        self.options.declare("nodes", types=np.ndarray, recordable=False, desc="baseline nodes, m")
        self.options.declare("surface", types=SurfaceGrid, recordable=False, desc="walls of the flow")

    def setup(self) -> None:
        """Declare the variables."""
        flow, nodes, surface = (self.options[name] for name in ("flow", "nodes", "surface"))
        check_on_grid(self, flow, nodes)
        self._forces = WallForces.of(flow, surface.quads, surface.rows)
        if self._forces.n_faces < len(surface.quads):
            missing = len(surface.quads) - self._forces.n_faces
            raise InputError(
                f"{self.msginfo}: {missing} of {len(surface.quads)} faces of the surface are no walls of the flow; "
                f"take a surface of walls, SurfaceGrid.of(model)"
            )
        is_distributed = self.comm.size > 1
        self.add_input("states", shape=N_STATES * flow.faces.n_cells, distributed=is_distributed)
        self.add_input(GRID, val=nodes.ravel(), units="m", distributed=is_distributed)
        self.add_input("Mach_number")
        self.add_input("dynamic_pressure", val=np.nan, units="Pa")
        self.add_output("wall_forces", val=np.zeros(3 * surface.n_points), units="N")

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Distribute the pressures on the faces to their corners."""
        pressure = inputs["dynamic_pressure"][0]
        if not 0.0 < pressure.real < np.inf:
            raise InputError(
                f"{self.msginfo}: dynamic_pressure is {pressure}; give the free stream's, a positive number of Pa"
            )
        outputs["wall_forces"] = self._forces.evaluate(*self._at(inputs)).ravel()

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose."""
        if "wall_forces" not in d_outputs:
            return
        if mode == "fwd":
            d_outputs["wall_forces"] += self._forces.jvp(*self._at(inputs), *self._along(inputs, d_inputs)).ravel()
        else:
            bars = self._forces.vjp(*self._at(inputs), d_outputs["wall_forces"].reshape(-1, 3))
            for name, bar in zip(INPUTS, bars):
                add_bar(d_inputs, name, np.asarray(bar))

    def _at(self, inputs: Vector) -> tuple[np.ndarray, np.ndarray, float, float]:
        """States, nodes, Mach number and dynamic pressure."""
        states, nodes, mach, pressure = (inputs[name] for name in INPUTS)
        return states.reshape(-1, N_STATES), nodes.reshape(-1, 3), mach[0], pressure[0]

    def _along(self, inputs: Vector, d_inputs: Vector) -> tuple[np.ndarray, Any, float, float]:
        """Directions in all of these, zero if OpenMDAO leaves one out."""
        states = d_inputs["states"] if "states" in d_inputs else np.zeros_like(inputs["states"])
        d_mach, d_pressure = (d_inputs[name].item() if name in d_inputs else 0.0 for name in INPUTS[2:])
        return states.reshape(-1, N_STATES), direction_in(d_inputs, inputs, GRID), d_mach, d_pressure
