r"""The far field of a lifting section: the free stream and a vortex with the circulation of the lift.

Far from a section in the plane the stream is disturbed like :math:`1/r`, by its circulation
:math:`\Gamma = L / (\rho_\infty q_\infty)`, L the lift per span. With the distances X along the stream and Y along the
lift from the quarter of the chord, and :math:`\beta^2 = 1 - M^2`, the rule of Prandtl and Glauert gives

.. math::
    \delta \mathbf{u} = \frac{\Gamma \beta}{2 \pi} \, \frac{Y \mathbf{e}_1 - X \mathbf{e}_2}{X^2 + \beta^2 Y^2} ;

density and pressure follow from the entropy and the total enthalpy of the stream. The circulation is computed from the
pressures on the walls, so the residual of each cell at the far field depends on all of them: a term of rank one in the
Jacobian. Vortex, places of the faces and depth of the grid are taken from the baseline.

References
----------
J. L. Thomas, M. D. Salas, "Far-field boundary conditions for transonic lifting solutions to the Euler equations", AIAA
J. 24 (1986), 1074-1080.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from ...base.numerics.halo import Halo
from ...base.numerics.processes import largest, summed, summed_number
from ...grids.cells.cell_faces import CellFaces
from ...grids.cells.quads import area_vectors
from .gas import GAMMA, N_STATES
from .reconstruction import Stencil
from .vortex_state import vortex_state
from .vortex_state_derivatives import vortex_state_jvp

__all__ = ["FarVortex", "VortexTangent"]


_FLAT = 1e-6
"""Length or area, relative to the grid's, that counts as zero."""


@dataclass(frozen=True, eq=False)
class FarVortex:
    """Vortex of a section, which disturbs the states outside the far field."""

    faces: np.ndarray  # (n_far,) of int, faces of the far field; like all here, of this process
    offsets: np.ndarray  # (n_far, 3), from the vortex to their centres (m)
    walls: np.ndarray  # (n_wall,) of int, faces of the walls
    cells: np.ndarray  # (n_wall, 4) of int, cells from which their pressures are extrapolated
    weights: np.ndarray  # (n_wall, 4), weights of these cells
    turn: np.ndarray  # (3, 3), rotates the direction of the stream into that of the lift
    depth: float  # of the grid, along the span (m)
    halo: Halo  # exchange of cells with other processes

    @classmethod
    def of(
        cls,
        faces: CellFaces,
        stencil: Stencil,  # cells and weights of the walls
        nodes: np.ndarray,  # (n_nodes, 3), baseline nodes (m)
        axes: np.ndarray,  # (3, 3), rows are the directions downstream, along the span, and up
        halo: Halo,  # exchange of cells with other processes
    ) -> FarVortex | None:
        """Find the vortex of a grid between two planes of symmetry across the span; None for other grids."""
        comm = halo.comm
        walls, far = faces.faces_of("wall"), faces.faces_of("farfield")
        places = nodes @ axes.T
        low, high = _ends(comm, places)
        bottom, top = _ends(comm, planes := places[faces.corners_of("symmetry"), 1].reshape(-1, 1))
        flat = _FLAT * np.max(high - low)
        strays = np.minimum(planes - bottom, top - planes).max(initial=0.0)
        areas = area_vectors(nodes[faces.corners[walls]])
        closure, surface = summed(comm, areas.sum(axis=0)), summed_number(comm, np.abs(areas).sum())
        is_between = top[0] - bottom[0] > flat and largest(comm, strays) < flat and summed_number(comm, len(far))
        if not is_between or np.abs(closure).max() >= _FLAT * surface:
            return None
        low, high = _ends(comm, places[faces.corners[walls]].reshape(-1, 3))
        quarter = np.array([0.75 * low[0] + 0.25 * high[0], 0.0, 0.5 * (low[2] + high[2])])
        offsets = nodes[faces.corners[far]].mean(axis=1) - quarter @ axes
        turn = np.outer(axes[2], axes[0]) - np.outer(axes[0], axes[2])
        weights = stencil.means[stencil.classes[walls]]
        return cls(far, offsets, walls, stencil.cells[walls], weights, turn, float(top[0] - bottom[0]), halo)

    def outside(
        self,
        states: np.ndarray,  # (n_cells + n_ghosts, 5)
        areas: np.ndarray,  # (n_faces, 3), area vectors (m^2)
        stream: np.ndarray,  # (5,)
    ) -> np.ndarray:
        """States outside the far field, shape (n_far, 5), real or complex."""
        return self._disturbed(stream, self._circulation(states, areas, stream))

    def linearize(self, states: np.ndarray, areas: np.ndarray, stream: np.ndarray) -> VortexTangent:
        """Differentiate `outside`; arguments are the same."""
        circulation, push = self._circulation(states, areas, stream), self.turn @ stream[1:4]
        impulse = stream[0] * (stream[1:4] @ stream[1:4]) * self.depth
        rise = self._pressures(states) - stream[4]
        by_pressure = areas[self.walls] @ push / impulse
        force = summed(self.halo.comm, rise @ areas[self.walls])
        by_stream = np.empty(N_STATES)
        by_stream[0] = -circulation / stream[0]
        by_stream[1:4] = force @ self.turn / impulse - 2.0 * circulation * stream[1:4] / (stream[1:4] @ stream[1:4])
        by_stream[4] = -summed_number(self.halo.comm, by_pressure.sum())
        by_state = np.zeros_like(states)
        np.add.at(by_state[:, 4], self.cells, self.weights * by_pressure[:, None])
        outside = self._disturbed_jvp(stream, circulation)
        return VortexTangent(self, outside, self.halo.fold(by_state), rise[:, None] * push / impulse, by_stream)

    def _pressures(self, states: np.ndarray) -> np.ndarray:
        """Pressures on the walls, shape (n_wall,)."""
        return np.sum(self.weights * states[self.cells, 4], axis=1)

    def _circulation(self, states: np.ndarray, areas: np.ndarray, stream: np.ndarray) -> float:
        """Lift per span divided by density and speed of the stream; pressures are relative to the stream's."""
        force = (self._pressures(states) - stream[4]) @ areas[self.walls]
        lift = summed_number(self.halo.comm, force @ (self.turn @ stream[1:4]))
        return lift / (stream[0] * (stream[1:4] @ stream[1:4]) * self.depth)

    def _disturbed(self, stream: np.ndarray, circulation: float) -> np.ndarray:
        """States of the stream with a vortex. In supersonic flow nothing of it travels upstream."""
        if _is_supersonic(stream):
            return np.tile(stream, (len(self.faces), 1))
        states = np.empty((len(self.faces), N_STATES), dtype=np.result_type(stream, circulation))
        _disturbed(tuple(stream), tuple(self.turn @ stream[1:4]), circulation, self.offsets, states)
        return states

    def _disturbed_jvp(self, stream: np.ndarray, circulation: float) -> np.ndarray:
        """Derivatives of these states with respect to the stream and the circulation, shape (n_far, 5, 6)."""
        found = np.zeros((len(self.faces), N_STATES, N_STATES + 1))
        if _is_supersonic(stream):
            found[:, range(N_STATES), range(N_STATES)] = 1.0
            return found
        at = tuple(stream), tuple(self.turn @ stream[1:4]), circulation
        for column, d_stream in enumerate(_STREAMS):
            change = tuple(d_stream), tuple(self.turn @ d_stream[1:4]), float(column == N_STATES)
            _disturbed_jvp(*at, self.offsets, *change, found[:, :, column])
        return found


def _is_supersonic(stream: np.ndarray) -> bool:
    """Whether the stream is sonic or supersonic."""
    return bool((stream[1:4] @ stream[1:4] / (GAMMA * stream[4] / stream[0])).real >= 1.0)


@njit(cache=True, error_model="numpy")
def _disturbed(stream, lift, circulation, offsets, states):
    for f in range(len(offsets)):
        offset = offsets[f, 0], offsets[f, 1], offsets[f, 2]
        states[f, 0], states[f, 1], states[f, 2], states[f, 3], states[f, 4] = vortex_state(
            stream, lift, circulation, offset
        )


@njit(cache=True, error_model="numpy")
def _disturbed_jvp(stream, lift, circulation, offsets, d_stream, d_lift, d_circulation, changes):
    for f in range(len(offsets)):
        offset = offsets[f, 0], offsets[f, 1], offsets[f, 2]
        changes[f, 0], changes[f, 1], changes[f, 2], changes[f, 3], changes[f, 4] = vortex_state_jvp(
            stream, lift, circulation, offset, d_stream, d_lift, d_circulation
        )


def _ends(comm: Any, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest coordinates of points, shape (n, d), of all processes."""
    lowest, highest = -points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)
    return -np.array([largest(comm, x) for x in lowest]), np.array([largest(comm, x) for x in highest])


_STREAMS = np.vstack([np.eye(N_STATES), np.zeros(N_STATES)])


@dataclass(frozen=True, eq=False)
class VortexTangent:
    """Derivatives of the states outside the far field and of the circulation."""

    vortex: FarVortex
    # (n_far, 5, 6), derivatives of the states with respect to the free stream and to the circulation
    outside: np.ndarray
    by_state: np.ndarray  # (n_cells, 5), derivatives of the circulation with respect to the states,
    by_area: np.ndarray  # (n_wall, 3), to the area vectors of the walls
    by_stream: np.ndarray  # (5,), and to the free stream

    @property
    def by_circulation(self) -> np.ndarray:
        """Derivatives of the states outside with respect to the circulation, shape (n_far, 5)."""
        return self.outside[..., N_STATES]

    def outside_jvp(self, d_states: np.ndarray, d_areas: np.ndarray, d_stream: np.ndarray) -> np.ndarray:
        """Change of the states outside, shape (n_far, 5), with states, area vectors and free stream."""
        local = np.vdot(self.by_state, self.vortex.halo.cut(d_states)) + np.vdot(
            self.by_area, d_areas[self.vortex.walls]
        )
        d_circulation = summed_number(self.vortex.halo.comm, local) + self.by_stream @ d_stream
        return self.outside[..., :N_STATES] @ d_stream + self.by_circulation * d_circulation

    def circulation_vjp(self, bar: np.ndarray) -> float:
        """Derivative with respect to the circulation, from derivatives by the states outside, (n_far, 5)."""
        return summed_number(self.vortex.halo.comm, np.vdot(self.by_circulation, bar))

    def stream_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Derivatives with respect to the free stream, from the same, for this process's faces."""
        return np.einsum("fnm,fn->m", self.outside[..., :N_STATES], bar) + self.by_stream * np.vdot(
            self.by_circulation, bar
        )
