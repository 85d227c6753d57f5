"""Derivatives of CL, CD and CM by the nodes of a model and the angle of attack, one adjoint solution for each.

Derivatives by the angle include the velocity far from the body, and the directions of lift and drag.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from ...grids.io.openfoam import PolyMesh
from ..loads.stream import stream_axes
from .adjoint import AdjointRun, FlowFunction, Opening
from .flow_run import CaseFlow
from .wall_loads import WallLoads

__all__ = ["CoefficientGradient", "FlowAdjoint"]


@dataclass(frozen=True, eq=False)
class CoefficientGradient(OneLine):
    """Derivatives of a coefficient."""

    nodes: np.ndarray  # (n_nodes, 3), by the nodes of the model (1/m); zero for nodes that are on no wall
    alpha: float  # by the angle of attack (1/rad)


@dataclass(frozen=True, eq=False)
class FlowAdjoint(OneLine):
    """Adjoints of a flow in the folder of its case."""

    flow: CaseFlow
    run: AdjointRun

    @classmethod
    def of(cls, flow: CaseFlow) -> FlowAdjoint:
        """Take other boundaries around the body as far field; `InputError` if OpenFOAM has no adjoint of the flow."""
        if flow.case.speed_name != "speed" or not flow.case.is_viscous:
            raise InputError(
                f"{flow.case.program}: OpenFOAM's adjoint is for incompressible viscous flows only; take a case "
                f"of simpleFoam, or differences"
            )
        mesh = flow.mesh
        openings: dict[str, Opening] = {
            patch.name: "farfield" for patch in mesh.boundary if patch.kind not in ("wall", "symmetry")
        }
        return cls(flow, AdjointRun(mesh.walls, openings, time_limit=flow.time_limit, slices=flow.slices))

    def gradient(
        self,
        name: str,  # CL, CD, or the parts of CM: CMx, CMy, CMz
        alpha: float,  # angle of attack (rad) of the solution in the folder
        speed: float,  # and its speed (m/s)
        loads: WallLoads,  # and its loads
    ) -> CoefficientGradient:
        """Solve the adjoint of a coefficient for the flow whose solution is in the folder."""
        mesh = self.flow.mesh
        directions = stream_axes(alpha, self.flow.axes)
        function, of_directions = self._function(name, directions, speed, loads)
        found = self.run.solve(self.flow.folder.path, self.flow.folder.last, function)
        nodes = found.gradient
        if isinstance(mesh.faces, PolyMesh):
            nodes = np.zeros(mesh.baseline.shape)
            nodes[mesh.faces.rows] = found.gradient
        return CoefficientGradient(nodes, float(speed * found.by_velocity @ directions[1]) + of_directions)

    def _function(
        self, name: str, directions: np.ndarray, speed: float, loads: WallLoads
    ) -> tuple[FlowFunction, float]:
        """The function of a coefficient, and its derivative by the directions that turn with the angle."""
        walls, (area, chord, point) = self.run.walls, self.flow.references
        drag, lift = directions
        if name == "CL":
            return FlowFunction.force(name, walls, lift, speed, area), -loads.CD
        if name == "CD":
            return FlowFunction.force(name, walls, drag, speed, area), loads.CL
        axis = np.eye(3)["xyz".index(name[-1])]
        return FlowFunction.moment(name, walls, axis, speed, (area, chord, point)), 0.0
