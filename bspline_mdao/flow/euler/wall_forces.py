"""Forces of the pressures on the nodes of a wall, for a structure that carries them.

The force on a wall face, dynamic pressure times Cp times area vector, acts at the mean of its corners; each corner
takes a quarter of it. So the nodes carry the force and the moment of the faces, as in `FlowForces`, to round-off, about
any point: the weights only change where on the face the force acts, not its sum or its moment.

Theory: ``docs/theory/aerostructure.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from .flow_grid import FlowGrid, area_vectors, area_vectors_jvp, area_vectors_vjp
from .forces import WallPressure

__all__ = ["WallForces"]


@dataclass(frozen=True, eq=False)
class WallForces:
    """Forces on the nodes of a surface from the states of all cells. Made by `WallForces.of`."""

    faces: np.ndarray  # (n_faces,) of int, wall faces that belong to the surface
    weights: csr_array  # (n_points, n_faces), fraction of the force on each face that each node takes
    pressure: WallPressure  # pressure coefficients on all wall faces

    @classmethod
    def of(
        cls,
        flow: FlowGrid,  # faces and stencils of the flow
        # (n_quads, 4) of int, numbers of the corners of the surface's quads; quads that are not on a wall of the flow
        # get no force
        quads: np.ndarray,
        rows: np.ndarray,  # (n_points,) of int, row in the grid vector of each node of the surface, ascending
    ) -> WallForces:
        """Find the wall faces of a flow, or of a part of it, that form a surface."""
        walls = flow.walls
        ours = walls.faces_on(rows[quads])
        corners = walls.rows_of_corners[ours]
        numbers, n = np.searchsorted(rows, corners), len(corners)
        weights = csr_array((np.full(4 * n, 0.25), numbers.ravel(), 4 * np.arange(n + 1)), (n, len(rows)))
        return cls(ours, csr_array(weights.T), WallPressure.of(flow))

    @property
    def n_faces(self) -> int:
        """Number of wall faces."""
        return len(self.faces)

    def evaluate(
        self,
        states: np.ndarray,  # (n_cells, 5), states of all cells
        nodes: np.ndarray,  # (n_nodes, 3), nodes of the grid (m)
        mach: float,  # mach number of the free stream
        dynamic_pressure: float,  # its dynamic pressure (Pa)
    ) -> np.ndarray:
        """Forces (N) on the nodes of the surface, shape (n_points, 3); real or complex."""
        return dynamic_pressure * self._reduced(states, nodes, mach)

    def jvp(
        self,
        states: np.ndarray,
        nodes: np.ndarray,
        mach: float,
        dynamic_pressure: float,
        d_states: np.ndarray,
        d_nodes: np.ndarray,
        d_mach: float,
        d_dynamic_pressure: float,
    ) -> np.ndarray:
        """Change of the forces along a direction in all arguments."""
        walls = self.pressure.walls
        on_walls, d_on_walls = walls.nodes(nodes), walls.nodes(d_nodes)
        areas, d_areas = area_vectors(on_walls, self._corners), area_vectors_jvp(on_walls, self._corners, d_on_walls)
        pressure = self.pressure.evaluate(states, mach)[self.faces]
        d_pressure = self.pressure.jvp(states, mach, d_states, d_mach)[self.faces]
        change = self.weights @ (d_pressure[:, None] * areas + pressure[:, None] * d_areas)
        return dynamic_pressure * change + d_dynamic_pressure * self._reduced(states, nodes, mach)

    def vjp(
        self, states: np.ndarray, nodes: np.ndarray, mach: float, dynamic_pressure: float, bar: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Apply the transpose of `jvp` to derivatives with respect to the forces, shape (n_points, 3)."""
        # Returns derivatives with respect to the states, the nodes, the Mach number and the dynamic pressure.
        on_walls, pressure = self.pressure.walls.nodes(nodes), self.pressure.evaluate(states, mach)[self.faces]
        areas, forces_bar = area_vectors(on_walls, self._corners), self.weights.T @ bar
        pressure_bar = np.zeros(len(self.pressure.walls.corners))
        pressure_bar[self.faces] = dynamic_pressure * np.sum(forces_bar * areas, axis=1)
        states_bar, mach_bar = self.pressure.vjp(states, mach, pressure_bar)
        walls_bar = area_vectors_vjp(on_walls, self._corners, dynamic_pressure * pressure[:, None] * forces_bar)
        nodes_bar = self.pressure.walls.nodes_vjp(walls_bar)
        return states_bar, nodes_bar, mach_bar, np.sum(forces_bar * areas * pressure[:, None])

    def _reduced(self, states: np.ndarray, nodes: np.ndarray, mach: float) -> np.ndarray:
        """Forces divided by the dynamic pressure (m^2)."""
        areas = area_vectors(self.pressure.walls.nodes(nodes), self._corners)
        return self.weights @ (self.pressure.evaluate(states, mach)[self.faces, None] * areas)

    @property
    def _corners(self) -> np.ndarray:
        """Corners of the faces among the nodes of the walls."""
        return self.pressure.walls.corners[self.faces]
