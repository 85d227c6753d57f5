"""The residual of steady flow on a grid, R(W): the sum of the fluxes out of every cell.

The flux through a face is in `.flux`, at walls in `.wall_boundary`, the states for it in `.reconstruction`, the states
outside the far field in `.far_field`, derivatives in `.linearization`. The residual depends on the grid through the
area vectors of the faces and, where grid lines turn, through the weights of their mean states, see `.irregular_faces`:
a discretisation has the weights of one grid. Each of several processes has the rows of its own cells; their states see
the states of other processes through a halo.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from ...base.numerics.halo import ALONE, Halo
from ...base.numerics.processes import norm
from ...grids.cells.cell_faces import CellFaces
from .cell_sums import CellSums, visit
from .far_field import FarVortex
from .gas import N_STATES
from .linearization import Linearization
from .reconstruction import FaceScheme, Stencil, area_of, face_state, has_area, has_sensor, shock_sensor
from .wall_boundary import flux_through

__all__ = ["DISSIPATION", "SHOCK_THRESHOLD", "Discretization"]


DISSIPATION = 1.0 / 6.0
"""Fraction of the third difference that is dissipated: as in upwind-biased interpolation of third order."""

SHOCK_THRESHOLD = 0.05
"""Default threshold of the shock sensor: flows slower than 0.83 of the speed of sound are unaffected."""


@dataclass(frozen=True, eq=False)
class Discretization:
    """Discretisation of steady flow by second-order finite volumes."""

    faces: CellFaces  # cells and faces; their patches are of the kinds wall, symmetry or farfield
    stencil: Stencil  # cells and weights at every face
    dissipation: float = DISSIPATION  # fraction of the third difference that is dissipated
    # relative second difference of the pressure at which a face is half a shock; 0 for no sensor
    shock_threshold: float = 0.0
    halo: Halo = ALONE  # exchange of cells with other processes
    vortex: FarVortex | None = None  # of a section, in the states outside the far field

    @classmethod
    def of(
        cls, faces: CellFaces, dissipation: float = DISSIPATION, shock_threshold: float = 0.0, halo: Halo = ALONE
    ) -> Discretization:
        """Choose the stencils of all faces."""
        return cls(faces, Stencil.of(faces), dissipation, shock_threshold, halo)

    def uniform(self, stream: np.ndarray) -> np.ndarray:
        """Fill all cells with the free stream: states, shape (n_cells, 5)."""
        return np.tile(stream, (self.faces.n_cells, 1))

    def norm(self, rows: np.ndarray) -> float:
        """Euclidean norm of an array of all cells, shape (n_cells, 5); bitwise the same on all processes."""
        return norm(rows, self.halo.comm)

    def sizes(self, areas: np.ndarray) -> np.ndarray:
        """Areas (m^2) of the surfaces of all cells, shape (n_cells, 1), from area vectors; never zero."""
        # Residuals are compared per surface: in a plain norm the cells of the far field would hide those at walls.
        sizes = self.faces.sum_over_cells(np.linalg.norm(areas, axis=1), 1.0)
        return np.maximum(sizes, np.finfo(np.float32).tiny)[:, None]

    def residual(
        self,
        states: np.ndarray,  # (n_cells, 5), see `.gas`; real or complex
        areas: np.ndarray,  # (n_faces, 3), area vectors (m^2), see `.cell_shapes`; real or complex
        stream: np.ndarray,  # (5,), the free stream; real or complex
    ) -> np.ndarray:  # (n_cells, 5), mass, momentum and energy per time
        """Sum the outflow of every cell."""
        dtype = np.result_type(states, areas, stream, self.stencil.means)
        states, areas, stream = (np.ascontiguousarray(array, dtype) for array in (states, areas, stream))
        states, scheme = self.halo.extend(states), self.scheme.cast(dtype)
        outside = self.outside(states, areas, stream)
        flux = np.zeros((self.faces.n_faces, N_STATES), dtype)

        def fill(part: slice) -> None:
            fluxes(scheme.part(part), areas[part], states, outside[part], flux[part])

        visit(len(flux), fill)
        return self.sums.of_faces(flux, self.faces.n_cells)

    def outside(self, states: np.ndarray, areas: np.ndarray, stream: np.ndarray) -> np.ndarray:
        """States outside the far field, by the number of the face, from states extended by other processes' cells."""
        return self.at_far_field(self.vortex.outside(states, areas, stream) if self.vortex else stream)

    def at_far_field(self, rows: np.ndarray) -> np.ndarray:
        """Put rows of the faces of the far field, or one of shape (5,) for all, at their numbers: (n_faces, 5)."""
        shape = (self.faces.n_faces, N_STATES)
        if self.vortex is None or rows.ndim == 1:
            return np.broadcast_to(rows, shape)
        room = np.zeros((shape[0], N_STATES + 1), rows.dtype)[:, :N_STATES]  # same type as above, for kernels
        room[self.vortex.faces] = rows
        return np.broadcast_to(room, shape)

    def linearize(self, states: np.ndarray, areas: np.ndarray, stream: np.ndarray) -> Linearization:
        """Differentiate the residual with respect to the states, the area vectors and the free stream."""
        # The arrays are kept, and must not change.
        states, areas, stream = (np.ascontiguousarray(array) for array in (states, areas, stream))
        states = self.halo.extend(states)
        vortex = self.vortex.linearize(states, areas, stream) if self.vortex else None
        return Linearization(self, states, areas, self.outside(states, areas, stream), vortex)

    @cached_property
    def scheme(self) -> FaceScheme:
        """Arguments of the kernels of the faces."""
        return self.stencil.scheme(self.dissipation, self.shock_threshold)

    @property
    def sums(self) -> CellSums:
        """Sums over the faces of every cell."""
        return self.stencil.sums


@njit(cache=True, error_model="numpy", nogil=True)
def fluxes(scheme, areas, states, outside, out):
    """Fluxes through all faces out of the cells on their left, shape (n_faces, 5), initially zero."""
    for f in range(len(out)):
        s, role = area_of(areas, f), scheme.roles[f]
        if not has_area(s):
            continue
        sigma = 0.0 * states[0, 4]
        if has_sensor(scheme, f):
            sigma = shock_sensor(states, scheme.cells[f], scheme.threshold)
        mean, jump, _, _ = face_state(scheme, f, states, outside[f], sigma)
        flux = flux_through(role, mean, jump, s, sigma)
        for n in range(5):
            out[f, n] = flux[n]
