"""Everything that the states of all cells tell of the forces on a body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ..errors import InputError
from .euler.areas import area_vectors, area_vectors_jvp, area_vectors_vjp
from .euler.flow_grid import FlowGrid
from .euler.wall import EntropyDrag, WallPressure
from .force_coefficients import ForceCoefficients
from .induced_drag import InducedDrag
from .span_strips import SpanStrips
from .wing_coefficients import WingCoefficients

__all__ = ["FlowForces"]


@dataclass(frozen=True, eq=False)
class FlowForces:
    """Coefficients ``CL``, ``CD``, ``CM``, ``CD_induced`` and ``CD_entropy``, ``Cp`` and ``span_load`` (m).

    Parameters
    ----------
    wall, far : ndarray of int, shapes (n_wall, 4) and (n_far, 4)
        Corners of the faces of the walls and of the far field.
    pressure : WallPressure
    entropy : EntropyDrag
    wing : WingCoefficients
    """

    wall: np.ndarray
    far: np.ndarray
    pressure: WallPressure
    entropy: EntropyDrag
    wing: WingCoefficients

    @classmethod
    def of(
        cls, flow: FlowGrid, nodes: np.ndarray, area: float, chord: float = 1.0, reference=(0.0, 0.0, 0.0)
    ) -> FlowForces:
        """Prepare a grid.

        Parameters
        ----------
        flow : FlowGrid
            Its faces and axes.
        nodes : ndarray, shape (n_nodes, 3)
            Baseline nodes (m).
        area, chord : float
            Reference area (m^2) of what the grid shows, and chord (m).
        reference : sequence of three float
            Point that moments are taken about (m).

        Raises
        ------
        InputError
            If there is no wall, it has no span, a reference cannot be used, or the plane of symmetry is not at span 0.
        """
        faces = flow.faces
        wall, far = (faces.corners[faces.faces_of(kind)] for kind in ("wall", "farfield"))
        if not len(wall):
            raise InputError("flow: no patch is a wall, so that there are no forces; declare what the body is")
        planes = _planes_of_symmetry(flow, nodes)
        strips = SpanStrips.of(wall, nodes, flow.axes, is_symmetric=len(planes) == 1)
        induced = InducedDrag.of(strips, nodes) if len(planes) < 2 else InducedDrag.none(strips)
        middles = csr_array(
            (np.full(wall.size, 0.25), wall.ravel(), 4 * np.arange(len(wall) + 1)), (len(wall), len(nodes))
        )
        coefficients = ForceCoefficients(middles, flow.axes, area, chord, reference)
        wing = WingCoefficients(coefficients, induced)
        return cls(wall, far, WallPressure.of(flow.discretization), EntropyDrag.of(flow.discretization), wing)

    def evaluate(self, states: np.ndarray, nodes: np.ndarray, alpha, mach) -> dict[str, np.ndarray]:
        """Give all of them by name; real or complex.

        Parameters
        ----------
        states : ndarray, shape (n_cells, 5)
            States of all cells.
        nodes : ndarray, shape (n_nodes, 3)
            Nodes of the grid (m).
        alpha, mach : float
            Angle of attack (rad) and Mach number.
        """
        areas, pressure = area_vectors(nodes, self.wall), self.pressure.evaluate(states, mach)
        drag = self.entropy.evaluate(states, area_vectors(nodes, self.far), mach)
        return {
            "Cp": pressure,
            "CD_entropy": drag / self._area,
            **self.wing.evaluate(pressure[:, None] * areas, nodes, alpha),
        }

    def jvp(self, states, nodes, alpha, mach, d_states, d_nodes, d_alpha, d_mach) -> dict[str, np.ndarray]:
        """Derivatives of `evaluate` along a direction in all of its arguments."""
        areas, d_areas = area_vectors(nodes, self.wall), area_vectors_jvp(nodes, self.wall, d_nodes)
        pressure, d_pressure = self.pressure.evaluate(states, mach), self.pressure.jvp(states, mach, d_states, d_mach)
        forces, d_forces = pressure[:, None] * areas, d_pressure[:, None] * areas + pressure[:, None] * d_areas
        far, d_far = area_vectors(nodes, self.far), area_vectors_jvp(nodes, self.far, d_nodes)
        return {
            "Cp": d_pressure,
            "CD_entropy": self.entropy.jvp(states, far, mach, d_states, d_far, d_mach) / self._area,
            **self.wing.jvp(forces, nodes, alpha, d_forces, d_nodes, d_alpha),
        }

    def vjp(self, states, nodes, alpha, mach, bars: dict) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Apply the transpose of `jvp` to derivatives in some of the numbers, by name.

        Returns
        -------
        tuple
            Derivatives in the states, the nodes, the angle (1/rad) and the Mach number.
        """
        areas, pressure = area_vectors(nodes, self.wall), self.pressure.evaluate(states, mach)
        forces_bar, nodes_bar, alpha_bar = self.wing.vjp(pressure[:, None] * areas, nodes, alpha, bars)
        pressure_bar = bars.get("Cp", 0.0) + np.sum(forces_bar * areas, axis=1)
        states_bar, mach_bar = self.pressure.vjp(states, mach, pressure_bar)
        far, drag_bar = area_vectors(nodes, self.far), np.sum(bars.get("CD_entropy", 0.0)) / self._area
        by_entropy = self.entropy.vjp(states, far, mach, drag_bar)
        nodes_bar += area_vectors_vjp(nodes, self.wall, pressure[:, None] * forces_bar)
        nodes_bar += area_vectors_vjp(nodes, self.far, by_entropy[1])
        return states_bar + by_entropy[0], nodes_bar, alpha_bar, mach_bar + by_entropy[2]

    @property
    def _area(self) -> float:
        return self.wing.coefficients.area


def _planes_of_symmetry(flow: FlowGrid, nodes: np.ndarray) -> list[float]:
    """Coordinates along the span of the planes of symmetry across it: one of a half wing, two of an infinite one."""
    corners = flow.faces.corners[flow.faces.faces_of("symmetry")]
    span, sizes = (nodes @ flow.axes[1])[corners], np.ptp(nodes, axis=0).max()
    across = np.ptp(span, axis=1) < _FLAT * sizes
    places = np.sort(span[across].mean(axis=1))
    planes = places[np.diff(places, prepend=-np.inf) > _FLAT * sizes]
    if len(planes) == 1 and abs(planes[0]) > _FLAT * sizes:
        raise InputError(f"flow: the plane of symmetry is at span {planes[0]:g}; shift the grid, so that it is at 0")
    return list(planes)


_FLAT = 1e-6
"""Length, by the size of the grid, that is none."""
