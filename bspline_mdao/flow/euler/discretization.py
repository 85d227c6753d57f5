"""The residual of steady flow on a grid, and all its derivatives.

The residual depends on the grid through the area vectors of the faces alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...cells.cell_faces import CellFaces
from .face_ranges import sum_over_faces, visit_faces
from .gas import N_STATES
from .linearization import face_jacobians, state_jvp, state_vjp
from .residual import residual
from .stencil import FARFIELD, Stencil

__all__ = ["DISSIPATION", "SHOCK_THRESHOLD", "Discretization", "Linearization"]

DISSIPATION = 1.0 / 6.0
"""Share of the third difference that is dissipated: that of upwind-biased interpolation of third order."""

SHOCK_THRESHOLD = 0.05
"""A sound threshold of the sensor of shocks: flows slower than 0.83 of the speed of sound are the same as without."""


@dataclass(frozen=True, eq=False)
class Discretization:
    """Second-order finite volumes.

    Parameters
    ----------
    faces : CellFaces
        Cells and faces; their patches are of the kinds wall, symmetry or farfield.
    stencil : Stencil
        Cells and weights at every face.
    dissipation : float
        Share of the third difference that is dissipated.
    shock_threshold : float
        Relative second difference of the pressure at which a face is half that of a shock; 0 for no sensor.
    """

    faces: CellFaces
    stencil: Stencil
    dissipation: float = DISSIPATION
    shock_threshold: float = 0.0

    @classmethod
    def of(cls, faces: CellFaces, dissipation: float = DISSIPATION, shock_threshold: float = 0.0) -> Discretization:
        """Discretize the flow between faces.

        Raises
        ------
        InputError
            If a patch is of a kind that says nothing about the flow.
        """
        return cls(faces, Stencil.of(faces), dissipation, shock_threshold)

    def uniform(self, stream: np.ndarray) -> np.ndarray:
        """Fill all cells with the free stream: states, shape (n_cells, 5)."""
        return np.tile(stream, (self.faces.n_cells, 1))

    def residual(self, states: np.ndarray, areas: np.ndarray, stream: np.ndarray) -> np.ndarray:
        """Sum what flows out of every cell.

        Parameters
        ----------
        states : ndarray, shape (n_cells, 5)
            See `.gas`. Real or complex.
        areas : ndarray, shape (n_faces, 3)
            Area vectors (m^2), see `.areas`. Real or complex.
        stream : ndarray, shape (5,)
            The free stream. Real or complex.

        Returns
        -------
        ndarray, shape (n_cells, 5)
            Mass, momentum and energy per time.
        """
        dtype = np.result_type(states, areas, stream)
        states, areas, stream = (np.ascontiguousarray(array, dtype) for array in (states, areas, stream))
        rest = states, stream, self.dissipation, self.shock_threshold

        def add(part, out):
            residual(*self.stencil.part(part), areas[part], *rest, out)

        return sum_over_faces(self.faces.n_faces, add, states)

    def linearize(self, states: np.ndarray, areas: np.ndarray, stream: np.ndarray) -> Linearization:
        """Differentiate the residual in the states, the area vectors and the free stream."""
        n = self.faces.n_faces
        by_state, by_area = np.zeros((n, N_STATES, 2 * N_STATES)), np.zeros((n, N_STATES, 3))
        shares, sensors = np.zeros((n, 2, 4)), np.zeros((n if self.shock_threshold > 0.0 else 0, 5 + 2 * N_STATES))
        rest = states, stream, self.dissipation, self.shock_threshold

        def fill(part):
            out = by_state[part], by_area[part], shares[part], sensors[part]
            face_jacobians(*self.stencil.part(part), areas[part], *rest, *out)

        visit_faces(n, fill)
        return Linearization(self, by_state, by_area, shares, sensors)


@dataclass(frozen=True, eq=False)
class Linearization:
    """Jacobians of the fluxes of all faces; `jvp` and `vjp` are products with that of the residual.

    Parameters
    ----------
    discretization : Discretization
    by_state : ndarray, shape (n_faces, 5, 10)
        In the mean state and in the jump.
    by_area : ndarray, shape (n_faces, 5, 3)
        In the area vector.
    shares : ndarray, shape (n_faces, 2, 4)
        Weights of the cells in the mean state and in the jump.
    sensors : ndarray, shape (n_faces, 15)
        The sensor of shocks, its derivatives in the pressures of the cells and in the mean state of the first and the
        last, and those of the flux in it. Of no faces without a threshold.
    """

    discretization: Discretization
    by_state: np.ndarray
    by_area: np.ndarray
    shares: np.ndarray
    sensors: np.ndarray

    def state_jvp(self, d_states: np.ndarray) -> np.ndarray:
        """Change of the residual with the states, both of shape (n_cells, 5)."""
        return self._multiply(state_jvp, d_states)

    def state_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `state_jvp`."""
        return self._multiply(state_vjp, bar)

    def area_jvp(self, d_areas: np.ndarray) -> np.ndarray:
        """Change of the residual, shape (n_cells, 5), with the area vectors, shape (n_faces, 3)."""
        return self._gather(np.einsum("fnd,fd->fn", self.by_area, d_areas))

    def area_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `area_jvp`."""
        return np.einsum("fnd,fn->fd", self.by_area, self._through(bar))

    def stream_jvp(self, d_stream: np.ndarray) -> np.ndarray:
        """Change of the residual, shape (n_cells, 5), with the free stream, shape (5,)."""
        flux = np.zeros((len(self.by_state), N_STATES))
        flux[self._far] = self._by_stream @ d_stream
        return self._gather(flux)

    def stream_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `stream_jvp`."""
        return np.einsum("fnm,fn->m", self._by_stream, self._through(bar)[self._far])

    def _multiply(self, kernel, vector: np.ndarray) -> np.ndarray:
        """Product with the Jacobian or its transpose."""
        stencil, vector = self.discretization.stencil, np.ascontiguousarray(vector)

        def add(part, out):
            jacobians = self.by_state[part], self.shares[part], self.sensors[part]
            kernel(stencil.cells[part], stencil.roles[part], *jacobians, vector, out)

        return sum_over_faces(len(self.by_state), add, vector)

    @property
    def _far(self) -> np.ndarray:
        return np.flatnonzero(self.discretization.stencil.roles == FARFIELD)

    @property
    def _by_stream(self) -> np.ndarray:
        """Jacobians of the far field's faces in the free stream: half of the mean state, all of the jump."""
        by_state = self.by_state[self._far]
        return 0.5 * by_state[..., :N_STATES] + by_state[..., N_STATES:]

    def _gather(self, flux: np.ndarray) -> np.ndarray:
        """Sum fluxes, shape (n_faces, 5), over the faces of every cell."""
        faces = self.discretization.faces
        columns = [
            np.bincount(faces.left, column, faces.n_cells)
            - np.bincount(faces.right, column[: faces.n_inner], faces.n_cells)
            for column in flux.T
        ]
        return np.stack(columns, axis=1)

    def _through(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `_gather`."""
        faces = self.discretization.faces
        through = bar[faces.left]
        through[: faces.n_inner] -= bar[faces.right]
        return through
