"""The residual of steady flow on a grid, and all its derivatives.

The residual depends on the grid through the area vectors of the faces alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from ...cells.cell_faces import CellFaces
from ...numerics.threads import run_tasks, thread_count
from .flux import face_flux, face_flux_jvp
from .gas import N_STATES
from .reconstruction import FARFIELD, INNER, SLIP, Stencil, face_state, face_weights, shock_sensor

# FOLDED DOCSTRING (rework): Derivatives of the residual at a state: Jacobians of all faces, and the products with them.

_ZERO, _STILL = (0.0,) * 5, (0.0,) * 3
_UNIT = tuple(tuple(float(n == m) for n in range(5)) for m in range(5))
_AXIS = tuple(unit[:3] for unit in _UNIT[:3])


@njit(cache=True, error_model="numpy", nogil=True)
def face_jacobians(
    cells, weights, classes, roles, areas, states, stream, dissipation, threshold, by_state, by_area, shares, sensors
):
    """Differentiate the flux of every face.

    By its mean state and jump (5, 10), and by its area vector (5, 3). `shares` (2, 4) are the weights of the cells in
    both with the sensor as it is; `sensors` (15) are the sensor, its derivatives in the four pressures and in the mean
    state of the first and the last cell, and those of the flux in it; without a threshold there are none.
    """
    for f in range(len(cells)):
        s = (areas[f, 0], areas[f, 1], areas[f, 2])
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] == 0.0:
            continue
        near, role, w = cells[f], roles[f], weights[classes[f]]
        sigma = 0.0
        if role == INNER and threshold > 0.0:
            sigma, by_pressure, by_mean = shock_sensor(states, near, threshold)
            sensors[f, 0] = sigma
            for k in range(4):
                sensors[f, 1 + k] = by_pressure[k]
            for n in range(5):
                sensors[f, 5 + n] = by_mean[n]
        face_weights(w, role, dissipation, sigma, shares[f])
        mean, jump, mean_slope, jump_slope = face_state(states, near, w, role, stream, dissipation, sigma)
        if role == SLIP:
            for n in range(3):
                by_state[f, 1 + n, 4] = s[n]
                by_area[f, 1 + n, n] = mean[4]
            continue
        _fill(mean, jump, s, sigma, by_state[f], by_area[f])
        if role == INNER and threshold > 0.0:
            column = face_flux_jvp(mean, jump, s, sigma, mean_slope, jump_slope, _STILL, 1.0)
            for n in range(5):
                sensors[f, 10 + n] = column[n]


@njit(cache=True, error_model="numpy", nogil=True)
def _fill(mean, jump, s, sigma, by_state, by_area):
    """Differentiate in one argument after the other: written out, what is multiplied by zero is not compiled."""
    _put(by_state, 0, face_flux_jvp(mean, jump, s, sigma, _UNIT[0], _ZERO, _STILL, 0.0))
    _put(by_state, 1, face_flux_jvp(mean, jump, s, sigma, _UNIT[1], _ZERO, _STILL, 0.0))
    _put(by_state, 2, face_flux_jvp(mean, jump, s, sigma, _UNIT[2], _ZERO, _STILL, 0.0))
    _put(by_state, 3, face_flux_jvp(mean, jump, s, sigma, _UNIT[3], _ZERO, _STILL, 0.0))
    _put(by_state, 4, face_flux_jvp(mean, jump, s, sigma, _UNIT[4], _ZERO, _STILL, 0.0))
    _put(by_state, 5, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[0], _STILL, 0.0))
    _put(by_state, 6, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[1], _STILL, 0.0))
    _put(by_state, 7, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[2], _STILL, 0.0))
    _put(by_state, 8, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[3], _STILL, 0.0))
    _put(by_state, 9, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[4], _STILL, 0.0))
    _put(by_area, 0, face_flux_jvp(mean, jump, s, sigma, _ZERO, _ZERO, _AXIS[0], 0.0))
    _put(by_area, 1, face_flux_jvp(mean, jump, s, sigma, _ZERO, _ZERO, _AXIS[1], 0.0))
    _put(by_area, 2, face_flux_jvp(mean, jump, s, sigma, _ZERO, _ZERO, _AXIS[2], 0.0))


@njit(cache=True, error_model="numpy", nogil=True)
def _put(jacobian, m, column):
    for n in range(5):
        jacobian[n, m] = column[n]


@njit(cache=True, error_model="numpy", nogil=True)
def state_jvp(cells, roles, by_state, shares, sensors, d_states, out):
    """Add the change of the residual with the states."""
    mean, jump, has_sensor = np.zeros(5, d_states.dtype), np.zeros(5, d_states.dtype), len(sensors) > 0
    for f in range(len(cells)):
        near, role = cells[f], roles[f]
        sense = 0.0
        for n in range(5):
            mean[n] = 0.0
            jump[n] = 0.0
        for k in range(4):
            at = near[k]
            for n in range(5):
                mean[n] += shares[f, 0, k] * d_states[at, n]
                jump[n] += shares[f, 1, k] * d_states[at, n]
        if has_sensor:
            for k in range(4):
                sense += sensors[f, 1 + k] * d_states[near[k], 4]
            for n in range(5):
                sense += 0.5 * sensors[f, 5 + n] * (d_states[near[0], n] + d_states[near[3], n])
        b, c = near[1], near[2]
        for n in range(5):
            flux = sensors[f, 10 + n] * sense if has_sensor else 0.0
            for m in range(5):
                flux += by_state[f, n, m] * mean[m] + by_state[f, n, 5 + m] * jump[m]
            out[b, n] += flux
            if role == INNER:
                out[c, n] -= flux


@njit(cache=True, error_model="numpy", nogil=True)
def state_vjp(cells, roles, by_state, shares, sensors, bar, out):
    """Add the transposed product of `state_jvp`."""
    through, mean, jump, has_sensor = np.zeros(5), np.zeros(5), np.zeros(5), len(sensors) > 0
    for f in range(len(cells)):
        near, role = cells[f], roles[f]
        b, c = near[1], near[2]
        sense = 0.0
        for n in range(5):
            through[n] = bar[b, n] - (bar[c, n] if role == INNER else 0.0)
            if has_sensor:
                sense += sensors[f, 10 + n] * through[n]
            mean[n] = 0.0
            jump[n] = 0.0
        for n in range(5):
            for m in range(5):
                mean[m] += by_state[f, n, m] * through[n]
                jump[m] += by_state[f, n, 5 + m] * through[n]
        for k in range(4):
            at = near[k]
            for n in range(5):
                out[at, n] += shares[f, 0, k] * mean[n] + shares[f, 1, k] * jump[n]
        if has_sensor:
            for k in range(4):
                out[near[k], 4] += sensors[f, 1 + k] * sense
            for n in range(5):
                out[near[0], n] += 0.5 * sensors[f, 5 + n] * sense
                out[near[3], n] += 0.5 * sensors[f, 5 + n] * sense


# FOLDED DOCSTRING (rework): Sum of the fluxes out of every cell: the residual of steady flow.


@njit(cache=True, error_model="numpy", nogil=True)
def residual(cells, weights, classes, roles, areas, states, stream, dissipation, threshold, out):
    """Add the fluxes through all faces to what flows out of the cells on their left, and into those on their right."""
    for f in range(len(cells)):
        s = (areas[f, 0], areas[f, 1], areas[f, 2])
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] == 0.0:
            continue
        near, role, w = cells[f], roles[f], weights[classes[f]]
        sigma = 0.0 * states[0, 4]
        if role == INNER and threshold > 0.0:
            sigma = shock_sensor(states, near, threshold)[0]
        mean, jump, _, _ = face_state(states, near, w, role, stream, dissipation, sigma)
        b, c = near[1], near[2]
        if role == SLIP:
            for n in range(3):
                out[b, 1 + n] += mean[4] * s[n]
            continue
        flux = face_flux(mean, jump, s, sigma)
        for n in range(5):
            out[b, n] += flux[n]
            if role == INNER:
                out[c, n] -= flux[n]


# FOLDED DOCSTRING (rework): Sums over faces on several threads: each takes a range of faces and adds to an array of its own.

FACES_PER_THREAD = 10_000
"""Faces below which a thread is not worth its start."""


def face_ranges(n_faces: int) -> list[slice]:
    """Cut the list of faces into as many equal ranges as there are threads."""
    n = max(1, min(thread_count(None), n_faces // FACES_PER_THREAD))
    ends = [n_faces * k // n for k in range(n + 1)]
    return [slice(*pair) for pair in zip(ends[:-1], ends[1:])]


def visit_faces(n_faces: int, task: Callable[[slice], None]) -> None:
    """Call ``task(range)`` for all ranges, on as many threads."""
    ranges = face_ranges(n_faces)
    run_tasks(lambda n: task(ranges[n]), len(ranges), len(ranges))


def sum_over_faces(n_faces: int, task: Callable[[slice, np.ndarray], None], like: np.ndarray) -> np.ndarray:
    """Sum what ``task(range, out)`` adds to zeros, in the order of the ranges.

    Parameters
    ----------
    n_faces : int
    task : callable
        Must release the interpreter lock.
    like : ndarray
        Array of the shape and type of the sum.
    """
    ranges = face_ranges(n_faces)
    parts = [np.zeros_like(like) for _ in ranges]
    run_tasks(lambda n: task(ranges[n], parts[n]), len(ranges), len(ranges))
    for part in parts[1:]:
        parts[0] += part
    return parts[0]


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
