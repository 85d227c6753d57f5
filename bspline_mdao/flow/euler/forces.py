"""Forces on a body from the states of all cells: wall pressures, and the entropy that leaves through the far field.

Theory: ``docs/theory/euler.rst`` and ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ...base.numerics.halo import Halo
from ...base.numerics.processes import gathered
from ...errors import InputError
from ..loads.force_coefficients import ForceCoefficients, WingCoefficients
from ..loads.hinges import HingeMoment
from ..loads.induced_drag import InducedDrag
from ..loads.span_strips import SpanStrips
from .entropy_drag import EntropyDrag
from .flow_grid import FlowGrid, area_vectors, area_vectors_jvp, area_vectors_vjp
from .gas import GAMMA
from .walls import Walls

__all__ = ["FlowForces", "WallPressure"]


_FLAT = 1e-6
"""Length, relative to the size of the grid, that counts as zero."""


@dataclass(frozen=True, eq=False)
class FlowForces:
    """Forces of a flow: ``CL``, ``CD``, ``CM`` and the rest of `WingCoefficients`, ``CD_entropy`` and ``Cp``.

    Parameters
    ----------
    walls : Walls
        The walls of all processes.
    corners : Halo
        Exchange of nodes with other processes.
    pressure : WallPressure
    entropy : EntropyDrag
    wing : WingCoefficients
    """

    walls: Walls
    corners: Halo
    pressure: WallPressure
    entropy: EntropyDrag
    wing: WingCoefficients

    @classmethod
    def of(
        cls,
        flow: FlowGrid,
        nodes: np.ndarray,
        area: float,
        chord: float = 1.0,
        reference=(0.0, 0.0, 0.0),
        hinges: Sequence[tuple[HingeMoment, np.ndarray]] = (),
    ) -> FlowForces:
        """Find the walls, the strips of the wing and the far field of a grid.

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
        hinges : sequence of (HingeMoment, ndarray of bool)
            Hinge moments, and which wall faces belong to the patches of each.

        Raises
        ------
        InputError
            If there is no wall, it has no span, a reference cannot be used, or the plane of symmetry is not at span 0.
        """
        wall, on_walls = flow.walls.corners, flow.walls.nodes(nodes)
        if not len(wall):
            raise InputError("flow: no patch is a wall, so that there are no forces; declare what the body is")
        planes = _planes_of_symmetry(flow, nodes)
        strips = SpanStrips.of(wall, on_walls, flow.axes, is_symmetric=len(planes) == 1)
        induced = InducedDrag.of(strips, on_walls) if len(planes) < 2 else InducedDrag.none(strips)
        middles = csr_array(
            (np.full(wall.size, 0.25), wall.ravel(), 4 * np.arange(len(wall) + 1)), (len(wall), len(on_walls))
        )
        coefficients = ForceCoefficients(middles, flow.axes, area, chord, reference)
        wing = WingCoefficients.of(coefficients, induced, on_walls, hinges, wall)
        entropy = EntropyDrag.of(flow.discretization, flow.axes)
        return cls(flow.walls, flow.corners, WallPressure.of(flow), entropy, wing)

    def __repr__(self) -> str:
        return f"<forces on {len(self.walls.corners)} wall faces>"

    def evaluate(self, states: np.ndarray, nodes: np.ndarray, alpha, mach) -> dict[str, np.ndarray]:
        """Compute all outputs by name; real or complex.

        Parameters
        ----------
        states : ndarray, shape (n_cells, 5)
            States of all cells; here and below, those of this process.
        nodes : ndarray, shape (n_nodes, 3)
            Nodes of the grid (m), as well.
        alpha, mach : float
            Angle of attack (rad) and Mach number.
        """
        on_walls, pressure = self.walls.nodes(nodes), self.pressure.evaluate(states, mach)
        areas = area_vectors(on_walls, self.walls.corners)
        boundary = area_vectors(self.corners.extend(nodes), self.entropy.corners)
        drag = self.entropy.evaluate(states, boundary, alpha, mach)
        return {
            "Cp": pressure,
            "CD_entropy": drag / self._area,
            **self.wing.evaluate(pressure[:, None] * areas, on_walls, alpha),
        }

    def jvp(self, states, nodes, alpha, mach, d_states, d_nodes, d_alpha, d_mach) -> dict[str, np.ndarray]:
        """Derivatives of `evaluate` along a direction in all of its arguments."""
        on_walls, d_on_walls, wall = self.walls.nodes(nodes), self.walls.nodes(d_nodes), self.walls.corners
        areas, d_areas = area_vectors(on_walls, wall), area_vectors_jvp(on_walls, wall, d_on_walls)
        pressure, d_pressure = self.pressure.evaluate(states, mach), self.pressure.jvp(states, mach, d_states, d_mach)
        forces, d_forces = pressure[:, None] * areas, d_pressure[:, None] * areas + pressure[:, None] * d_areas
        seen, d_seen = self.corners.extend(nodes), self.corners.extend(d_nodes)
        boundary = area_vectors(seen, self.entropy.corners)
        d_boundary = area_vectors_jvp(seen, self.entropy.corners, d_seen)
        d_drag = self.entropy.jvp(states, boundary, alpha, mach, d_states, d_boundary, d_alpha, d_mach)
        return {
            "Cp": d_pressure,
            "CD_entropy": d_drag / self._area,
            **self.wing.jvp(forces, on_walls, alpha, d_forces, d_on_walls, d_alpha),
        }

    def vjp(self, states, nodes, alpha, mach, bars: dict) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Apply the transpose of `jvp` to derivatives with respect to some of the outputs, by name.

        Returns
        -------
        tuple
            Derivatives with respect to the states, the nodes, the angle (1/rad) and the Mach number.
        """
        on_walls, pressure, seen = (
            self.walls.nodes(nodes),
            self.pressure.evaluate(states, mach),
            self.corners.extend(nodes),
        )
        areas = area_vectors(on_walls, self.walls.corners)
        forces_bar, walls_bar, alpha_bar = self.wing.vjp(pressure[:, None] * areas, on_walls, alpha, bars)
        pressure_bar = bars.get("Cp", 0.0) + np.sum(forces_bar * areas, axis=1)
        states_bar, mach_bar = self.pressure.vjp(states, mach, pressure_bar)
        boundary, drag_bar = area_vectors(seen, self.entropy.corners), np.sum(bars.get("CD_entropy", 0.0)) / self._area
        entropy_bars = self.entropy.vjp(states, boundary, alpha, mach, drag_bar)
        walls_bar += area_vectors_vjp(on_walls, self.walls.corners, pressure[:, None] * forces_bar)
        nodes_bar = self.walls.nodes_vjp(walls_bar)
        nodes_bar += self.corners.fold(area_vectors_vjp(seen, self.entropy.corners, entropy_bars[1]))
        return states_bar + entropy_bars[0], nodes_bar, alpha_bar + entropy_bars[2], mach_bar + entropy_bars[3]

    @property
    def _area(self) -> float:
        return self.wing.coefficients.area


def _planes_of_symmetry(flow: FlowGrid, nodes: np.ndarray) -> list[float]:
    """Coordinates along the span of the planes of symmetry across it: one of a half wing, two of an infinite one."""
    corners = flow.faces.corners_of("symmetry")
    span, sizes = (flow.corners.extend(nodes) @ flow.axes[1])[corners], flow.extent(nodes)
    across = span.max(axis=1, initial=-np.inf) - span.min(axis=1, initial=np.inf) < _FLAT * sizes
    places = np.sort(gathered(flow.comm, span[across].mean(axis=1)))
    planes = places[np.diff(places, prepend=-np.inf) > _FLAT * sizes]
    if len(planes) == 1 and abs(planes[0]) > _FLAT * sizes:
        raise InputError(f"flow: the plane of symmetry is at span {planes[0]:g}; shift the grid, so that it is at 0")
    return list(planes)


@dataclass(frozen=True, eq=False)
class WallPressure:
    """Pressure coefficients on the wall faces, from the pressures that their fluxes have.

    Parameters
    ----------
    cells : ndarray of int, shape (n_own, 3)
        Cells that the pressure of a face of this process is extrapolated from.
    weights : ndarray, shape (n_own, 3)
        Their weights.
    halo : Halo
        Exchange of cells with other processes.
    walls : Walls
        The walls of all processes.
    """

    cells: np.ndarray
    weights: np.ndarray
    halo: Halo
    walls: Walls

    @classmethod
    def of(cls, flow: FlowGrid) -> WallPressure:
        """Take cells and weights from the stencils of the walls."""
        stencil, wall = flow.discretization.stencil, flow.faces.faces_of("wall")
        weights = stencil.means[stencil.classes[wall]]
        return cls(stencil.cells[wall, :3], weights[:, :3], flow.discretization.halo, flow.walls)

    def evaluate(self, states: np.ndarray, mach) -> np.ndarray:
        """Pressure coefficients, shape (n_wall,), of states, shape (n_cells, 5), at a Mach number."""
        pressures = self._extrapolated(states)
        return (pressures - 1.0 / GAMMA) / (0.5 * mach**2)

    def jvp(self, states: np.ndarray, mach, d_states: np.ndarray, d_mach) -> np.ndarray:
        """Change of the coefficients with the states and the Mach number."""
        d_pressures = self._extrapolated(d_states)
        return d_pressures / (0.5 * mach**2) - 2.0 * d_mach / mach * self.evaluate(states, mach)

    def vjp(self, states: np.ndarray, mach, bar: np.ndarray) -> tuple[np.ndarray, float]:
        """Apply the transpose of `jvp`: derivatives with respect to the states and the Mach number."""
        seen_bar = self.halo.pad(np.zeros_like(states))
        own_bar = bar[self.walls.own]
        np.add.at(seen_bar[:, 4], self.cells, self.weights * own_bar[:, None] / (0.5 * mach**2))
        return self.halo.fold(seen_bar), -2.0 / mach * (bar @ self.evaluate(states, mach))

    def _extrapolated(self, states: np.ndarray) -> np.ndarray:
        """Pressures on all wall faces."""
        return self.walls.gather(np.sum(self.weights * self.halo.extend(states)[self.cells, 4], axis=1))
