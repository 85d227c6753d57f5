"""The outputs of a flow from the states of all cells: pressures and forces on walls, and far-field drag.

To add a function of the states, add its kernel to `KERNELS`; functions of the forces on walls go to the kernels of
`bspline_mdao.flow.loads.wing_coefficients`.

Theory: ``docs/theory/euler.rst`` and ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.sparse import csr_array

from ...base.numerics.halo import Halo
from ...base.numerics.processes import gathered
from ...errors import InputError
from ..functionals import FUNCTIONALS
from ..loads.force_coefficients import ForceCoefficients
from ..loads.hinges import HingeMoment
from ..loads.induced_drag import InducedDrag
from ..loads.span_strips import SpanStrips
from ..loads.wing_coefficients import WingCoefficients
from .entropy_drag import EntropyCoefficient
from .flow_grid import FlowGrid, area_vectors, area_vectors_jvp, area_vectors_vjp
from .gas import GAMMA
from .walls import Walls

__all__ = ["KERNELS", "FlowForces", "StateKernel", "WallPressure"]


_FLAT = 1e-6
"""Length, relative to the size of the grid, that counts as zero."""


class StateKernel(Protocol):
    """Functionals of the states, shape (n_cells, 5), the nodes (m), the angle of attack (rad) and the Mach number."""

    # Each of several processes gives its cells and nodes.

    @property
    def outputs(self) -> tuple[str, ...]:
        """Their names."""

    def evaluate(self, states: np.ndarray, nodes: np.ndarray, alpha: float, mach: float) -> dict[str, Any]:
        """Values by name; real or complex."""

    def jvp(
        self,
        states: np.ndarray,
        nodes: np.ndarray,
        alpha: float,
        mach: float,
        d_states: np.ndarray,
        d_nodes: np.ndarray,
        d_alpha: float,
        d_mach: float,
    ) -> dict[str, Any]:
        """Derivatives of `evaluate` along a direction in all of its arguments."""

    def vjp(
        self, states: np.ndarray, nodes: np.ndarray, alpha: float, mach: float, bars: dict
    ) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Apply the transpose of `jvp` to derivatives with respect to some of the outputs, by name."""


KERNELS: dict[str, Callable[[FlowGrid, float], StateKernel]] = {"entropy": EntropyCoefficient.of}
"""Makers of kernels from a grid and a reference area (m^2), by their names in the table of functionals."""


@dataclass(frozen=True, eq=False)
class FlowForces:
    """The functionals of a flow: pressures on walls, their `WingCoefficients`, and functions of the states."""

    walls: Walls  # the walls of all processes
    pressure: WallPressure  # ``Cp``
    wing: WingCoefficients  # of the forces on walls
    kernels: tuple[StateKernel, ...]  # functions of the states

    @classmethod
    def of(
        cls,
        flow: FlowGrid,  # its faces and axes
        nodes: np.ndarray,  # (n_nodes, 3), baseline nodes (m)
        area: float,  # area, chord: reference area (m^2) of the modelled part, and chord (m)
        chord: float = 1.0,
        reference: Sequence[float] = (0.0, 0.0, 0.0),  # reference point of moments (m)
        # of bool, hinge moments, and the wall faces of the patches of each
        hinges: Sequence[tuple[HingeMoment, np.ndarray]] = (),
    ) -> FlowForces:
        """Find the walls, the strips of the wing and the far field of a grid."""
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
        keys = dict.fromkeys(each.kernel for each in FUNCTIONALS.values() if each.kernel in KERNELS)
        kernels = tuple(KERNELS[key](flow, area) for key in keys)
        return cls(flow.walls, WallPressure.of(flow), wing, kernels)

    def __repr__(self) -> str:
        return f"<forces on {len(self.walls.corners)} wall faces>"

    def evaluate(
        self,
        states: np.ndarray,  # (n_cells, 5), states of the cells; here and below, of this process
        nodes: np.ndarray,  # (n_nodes, 3), nodes of this process (m)
        alpha: float,  # alpha, mach: angle of attack (rad) and Mach number
        mach: float,
    ) -> dict[str, np.ndarray]:
        """Compute all outputs by name; real or complex."""
        on_walls, pressure = self.walls.nodes(nodes), self.pressure.evaluate(states, mach)
        areas = area_vectors(on_walls, self.walls.corners)
        found = {"Cp": pressure, **self.wing.evaluate(pressure[:, None] * areas, on_walls, alpha)}
        for kernel in self.kernels:
            found |= kernel.evaluate(states, nodes, alpha, mach)
        return found

    def jvp(
        self,
        states: np.ndarray,
        nodes: np.ndarray,
        alpha: float,
        mach: float,
        d_states: np.ndarray,
        d_nodes: np.ndarray,
        d_alpha: float,
        d_mach: float,
    ) -> dict[str, np.ndarray]:
        """Derivatives of `evaluate` along a direction in all of its arguments."""
        on_walls, d_on_walls, wall = self.walls.nodes(nodes), self.walls.nodes(d_nodes), self.walls.corners
        areas, d_areas = area_vectors(on_walls, wall), area_vectors_jvp(on_walls, wall, d_on_walls)
        pressure, d_pressure = self.pressure.evaluate(states, mach), self.pressure.jvp(states, mach, d_states, d_mach)
        forces, d_forces = pressure[:, None] * areas, d_pressure[:, None] * areas + pressure[:, None] * d_areas
        found = {"Cp": d_pressure, **self.wing.jvp(forces, on_walls, alpha, d_forces, d_on_walls, d_alpha)}
        for kernel in self.kernels:
            found |= kernel.jvp(states, nodes, alpha, mach, d_states, d_nodes, d_alpha, d_mach)
        return found

    def vjp(
        self, states: np.ndarray, nodes: np.ndarray, alpha: float, mach: float, bars: dict
    ) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Apply the transpose of `jvp` to derivatives with respect to some of the outputs, by name."""
        # Returns derivatives with respect to the states, the nodes, the angle (1/rad) and the Mach number.
        on_walls, pressure = self.walls.nodes(nodes), self.pressure.evaluate(states, mach)
        areas = area_vectors(on_walls, self.walls.corners)
        forces_bar, walls_bar, alpha_bar = self.wing.vjp(pressure[:, None] * areas, on_walls, alpha, bars)
        pressure_bar = bars.get("Cp", 0.0) + np.sum(forces_bar * areas, axis=1)
        states_bar, mach_bar = self.pressure.vjp(states, mach, pressure_bar)
        walls_bar += area_vectors_vjp(on_walls, self.walls.corners, pressure[:, None] * forces_bar)
        nodes_bar = self.walls.nodes_vjp(walls_bar)
        for kernel in self.kernels:
            if not bars.keys().isdisjoint(kernel.outputs):
                parts = kernel.vjp(states, nodes, alpha, mach, bars)
                states_bar, nodes_bar = states_bar + parts[0], nodes_bar + parts[1]
                alpha_bar, mach_bar = alpha_bar + parts[2], mach_bar + parts[3]
        return states_bar, nodes_bar, alpha_bar, mach_bar


def _planes_of_symmetry(flow: FlowGrid, nodes: np.ndarray) -> list[float]:
    """Coordinates along the span of the planes of symmetry across it: one for a half wing, two for an infinite one."""
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
    """Pressure coefficients on the wall faces, from the pressures in their fluxes."""

    cells: np.ndarray  # (n_own, 3) of int, cells from which the pressure of a face of this process is extrapolated
    weights: np.ndarray  # (n_own, 3), their weights
    halo: Halo  # exchange of cells with other processes
    walls: Walls  # the walls of all processes

    @classmethod
    def of(cls, flow: FlowGrid) -> WallPressure:
        """Take cells and weights from the stencils of the walls."""
        stencil, wall = flow.discretization.stencil, flow.faces.faces_of("wall")
        weights = stencil.means[stencil.classes[wall]]
        return cls(stencil.cells[wall, :3], weights[:, :3], flow.discretization.halo, flow.walls)

    def evaluate(self, states: np.ndarray, mach: float) -> np.ndarray:
        """Pressure coefficients, shape (n_wall,), from states, shape (n_cells, 5), at a Mach number."""
        pressures = self._extrapolated(states)
        return (pressures - 1.0 / GAMMA) / (0.5 * mach**2)

    def jvp(self, states: np.ndarray, mach: float, d_states: np.ndarray, d_mach: float) -> np.ndarray:
        """Change of the coefficients with the states and the Mach number."""
        d_pressures = self._extrapolated(d_states)
        return d_pressures / (0.5 * mach**2) - 2.0 * d_mach / mach * self.evaluate(states, mach)

    def vjp(self, states: np.ndarray, mach: float, bar: np.ndarray) -> tuple[np.ndarray, float]:
        """Apply the transpose of `jvp`: derivatives with respect to the states and the Mach number."""
        seen_bar = self.halo.pad(np.zeros_like(states))
        local_bar = bar[self.walls.owned]
        np.add.at(seen_bar[:, 4], self.cells, self.weights * local_bar[:, None] / (0.5 * mach**2))
        return self.halo.fold(seen_bar), -2.0 / mach * (bar @ self.evaluate(states, mach))

    def _extrapolated(self, states: np.ndarray) -> np.ndarray:
        """Pressures on all wall faces."""
        return self.walls.gather(np.sum(self.weights * self.halo.extend(states)[self.cells, 4], axis=1))
