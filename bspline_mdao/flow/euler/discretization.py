"""The residual of steady flow on a grid, R(W): the sum of the fluxes out of every cell, and all its derivatives.

The flux through a face is in `.flux`, the states that it is of in `.reconstruction`. The residual depends on the grid
through the area vectors of the faces alone. Sums over faces are made on several threads, each with a range of faces and
an array of its own. Of several processes each has the rows of its own cells; their states see those of others through a
halo.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from ...cells.cell_faces import CellFaces
from ...numerics.halo import ALONE, Halo
from ...numerics.processes import norm, summed
from ...numerics.threads import run_tasks, thread_count
from .flux import face_flux, face_flux_jvp
from .gas import N_STATES
from .reconstruction import FARFIELD, INNER, SLIP, Stencil, face_state, face_weights, shock_sensor

__all__ = ["DISSIPATION", "SHOCK_THRESHOLD", "Discretization", "Linearization"]


DISSIPATION = 1.0 / 6.0
"""Part of the third difference that is dissipated: that of upwind-biased interpolation of third order."""

SHOCK_THRESHOLD = 0.05
"""A sound threshold of the sensor of shocks: flows slower than 0.83 of the speed of sound are the same as without."""

FACES_PER_THREAD = 10_000
"""Fewer faces than this are not worth the start of a thread."""


@dataclass(frozen=True, eq=False)
class Discretization:
    """Discretisation of steady flow by second-order finite volumes.

    Parameters
    ----------
    faces : CellFaces
        Cells and faces; their patches are of the kinds wall, symmetry or farfield.
    stencil : Stencil
        Cells and weights at every face.
    dissipation : float
        Part of the third difference that is dissipated.
    shock_threshold : float
        Relative second difference of the pressure at which a face is half that of a shock; 0 for no sensor.
    halo : Halo
        Exchange of cells with other processes.
    """

    faces: CellFaces
    stencil: Stencil
    dissipation: float = DISSIPATION
    shock_threshold: float = 0.0
    halo: Halo = ALONE

    @classmethod
    def of(
        cls, faces: CellFaces, dissipation: float = DISSIPATION, shock_threshold: float = 0.0, halo: Halo = ALONE
    ) -> Discretization:
        """Choose the stencils of all faces.

        Raises
        ------
        InputError
            If a patch is of a kind that says nothing about the flow.
        """
        return cls(faces, Stencil.of(faces), dissipation, shock_threshold, halo)

    def uniform(self, stream: np.ndarray) -> np.ndarray:
        """Fill all cells with the free stream: states, shape (n_cells, 5)."""
        return np.tile(stream, (self.faces.n_cells, 1))

    def norm(self, rows: np.ndarray) -> float:
        """Euclidean norm of an array of all cells, shape (n_cells, 5); the same bits on all processes."""
        return norm(rows, self.halo.comm)

    def sizes(self, areas: np.ndarray) -> np.ndarray:
        """Areas (m^2) of the surfaces of all cells, shape (n_cells, 1), of area vectors; never nil.

        What flows out of a cell goes with its surface, 290 m^2 at the far field of a wing and 3 cm^2 at its tip.
        Residuals are compared per surface: in a plain norm the cells of the far field hide those at walls.
        """
        sizes = self.faces.sum_over_cells(np.linalg.norm(areas, axis=1), 1.0)
        return np.maximum(sizes, np.finfo(float).tiny)[:, None]

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
        states = self.halo.extend(states)
        rest = states, stream, self.dissipation, self.shock_threshold

        def add(part, out):
            residual(*self.stencil.part(part), areas[part], *rest, out)

        return self.halo.cut(_sum_over_faces(self.faces.n_faces, add, states))

    def linearize(self, states: np.ndarray, areas: np.ndarray, stream: np.ndarray) -> Linearization:
        """Differentiate the residual with respect to the states, the area vectors and the free stream."""
        n = self.faces.n_faces
        state_jacobians, area_jacobians = np.zeros((n, N_STATES, 2 * N_STATES)), np.zeros((n, N_STATES, 3))
        cell_weights, sensors = (
            np.zeros((n, 2, 4)),
            np.zeros((n if self.shock_threshold > 0.0 else 0, 5 + 2 * N_STATES)),
        )
        rest = self.halo.extend(states), stream, self.dissipation, self.shock_threshold

        def fill(part):
            out = state_jacobians[part], area_jacobians[part], cell_weights[part], sensors[part]
            face_jacobians(*self.stencil.part(part), areas[part], *rest, *out)

        _visit_faces(n, fill)
        if not sensors[:, 0].any():
            sensors = sensors[:0]  # in slow flow a product costs what it costs without a sensor
        return Linearization(self, state_jacobians, area_jacobians, cell_weights, sensors)


@dataclass(frozen=True, eq=False)
class Linearization:
    """Jacobians of the fluxes of all faces; methods `..._jvp` and `..._vjp` are products with that of the residual.

    Parameters
    ----------
    discretization : Discretization
    state_jacobians : ndarray, shape (n_faces, 5, 10)
        Derivatives of the fluxes with respect to the mean state and to the jump.
    area_jacobians : ndarray, shape (n_faces, 5, 3)
        Derivatives with respect to the area vector.
    cell_weights : ndarray, shape (n_faces, 2, 4)
        Weights of the four cells in the mean state and in the jump, with the sensor as it is.
    sensors : ndarray, shape (n_faces, 15)
        The sensor of shocks; its derivatives with respect to the pressures of the four cells and to the mean state of
        the first and the last; those of the flux with respect to the sensor. No faces where it is zero at all of them.
    """

    discretization: Discretization
    state_jacobians: np.ndarray
    area_jacobians: np.ndarray
    cell_weights: np.ndarray
    sensors: np.ndarray

    def state_jvp(self, d_states: np.ndarray) -> np.ndarray:
        """Change of the residual with the states, both of shape (n_cells, 5)."""
        halo = self.discretization.halo
        return halo.cut(self._multiply(state_jvp, halo.extend(d_states)))

    def state_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `state_jvp`."""
        halo = self.discretization.halo
        return halo.fold(self._multiply(state_vjp, halo.pad(bar)))

    def area_jvp(self, d_areas: np.ndarray) -> np.ndarray:
        """Change of the residual, shape (n_cells, 5), with the area vectors, shape (n_faces, 3)."""
        return self._gather(np.einsum("fnd,fd->fn", self.area_jacobians, d_areas))

    def area_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `area_jvp`."""
        return np.einsum("fnd,fn->fd", self.area_jacobians, self._through(bar))

    def stream_jvp(self, d_stream: np.ndarray) -> np.ndarray:
        """Change of the residual, shape (n_cells, 5), with the free stream, shape (5,)."""
        flux = np.zeros((len(self.state_jacobians), N_STATES))
        flux[self._far] = self._stream_jacobians @ d_stream
        return self._gather(flux)

    def stream_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `stream_jvp`."""
        own = np.einsum("fnm,fn->m", self._stream_jacobians, self._through(bar)[self._far])
        return summed(self.discretization.halo.comm, own)

    def _multiply(self, kernel, vector: np.ndarray) -> np.ndarray:
        """Product with the Jacobian or its transpose."""
        stencil, vector = self.discretization.stencil, np.ascontiguousarray(vector)

        def add(part, out):
            jacobians = self.state_jacobians[part], self.cell_weights[part], self.sensors[part]
            kernel(stencil.cells[part], stencil.roles[part], *jacobians, vector, out)

        return _sum_over_faces(len(self.state_jacobians), add, vector)

    @property
    def _far(self) -> np.ndarray:
        return np.flatnonzero(self.discretization.stencil.roles == FARFIELD)

    @property
    def _stream_jacobians(self) -> np.ndarray:
        """Derivatives of the far field's fluxes with respect to the free stream: half of the mean, all of the jump."""
        state_jacobians = self.state_jacobians[self._far]
        return 0.5 * state_jacobians[..., :N_STATES] + state_jacobians[..., N_STATES:]

    def _gather(self, flux: np.ndarray) -> np.ndarray:
        """Sum fluxes, shape (n_faces, 5), over the faces of every cell."""
        return np.stack([self.discretization.faces.sum_over_cells(column) for column in flux.T], axis=1)

    def _through(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `_gather`."""
        faces, bar = self.discretization.faces, self.discretization.halo.pad(bar)
        through = bar[faces.left]
        through[: faces.n_inner] -= bar[faces.right]
        return through


@njit(cache=True, error_model="numpy", nogil=True)
def residual(cells, weights, classes, roles, areas, states, stream, dissipation, threshold, out):
    """Add the fluxes through all faces to the outflow of the cells on their left, and subtract them on their right.

    Faces without area, as on a collapsed edge, have no flux; the sensor and the speeds would divide by it.
    """
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


_ZERO, _STILL = (0.0,) * 5, (0.0,) * 3

_UNIT = tuple(tuple(float(n == m) for n in range(5)) for m in range(5))

_AXIS = tuple(unit[:3] for unit in _UNIT[:3])


@njit(cache=True, error_model="numpy", nogil=True)
def face_jacobians(
    cells,
    weights,
    classes,
    roles,
    areas,
    states,
    stream,
    dissipation,
    threshold,
    state_jacobians,
    area_jacobians,
    cell_weights,
    sensors,
):
    """Differentiate the fluxes of all faces; the last four arguments are filled, see `Linearization`."""
    for f in range(len(cells)):
        s = (areas[f, 0], areas[f, 1], areas[f, 2])
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] == 0.0:
            continue
        near, role, w = cells[f], roles[f], weights[classes[f]]
        sigma = 0.0
        if role == INNER and threshold > 0.0:
            sigma, pressure_gradient, mean_gradient = shock_sensor(states, near, threshold)
            sensors[f, 0] = sigma
            for k in range(4):
                sensors[f, 1 + k] = pressure_gradient[k]
            for n in range(5):
                sensors[f, 5 + n] = mean_gradient[n]
        face_weights(w, role, dissipation, sigma, cell_weights[f])
        mean, jump, mean_slope, jump_slope = face_state(states, near, w, role, stream, dissipation, sigma)
        if role == SLIP:
            for n in range(3):
                state_jacobians[f, 1 + n, 4] = s[n]
                area_jacobians[f, 1 + n, n] = mean[4]
            continue
        _fill(mean, jump, s, sigma, state_jacobians[f], area_jacobians[f])
        if sigma != 0.0:  # else its derivatives are zero too
            column = face_flux_jvp(mean, jump, s, sigma, mean_slope, jump_slope, _STILL, 1.0)
            for n in range(5):
                sensors[f, 10 + n] = column[n]


@njit(cache=True, error_model="numpy", nogil=True)
def _fill(mean, jump, s, sigma, state_jacobians, area_jacobians):
    """Differentiate in one argument after the other: written out, what is multiplied by zero is not compiled."""
    _put(state_jacobians, 0, face_flux_jvp(mean, jump, s, sigma, _UNIT[0], _ZERO, _STILL, 0.0))
    _put(state_jacobians, 1, face_flux_jvp(mean, jump, s, sigma, _UNIT[1], _ZERO, _STILL, 0.0))
    _put(state_jacobians, 2, face_flux_jvp(mean, jump, s, sigma, _UNIT[2], _ZERO, _STILL, 0.0))
    _put(state_jacobians, 3, face_flux_jvp(mean, jump, s, sigma, _UNIT[3], _ZERO, _STILL, 0.0))
    _put(state_jacobians, 4, face_flux_jvp(mean, jump, s, sigma, _UNIT[4], _ZERO, _STILL, 0.0))
    _put(state_jacobians, 5, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[0], _STILL, 0.0))
    _put(state_jacobians, 6, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[1], _STILL, 0.0))
    _put(state_jacobians, 7, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[2], _STILL, 0.0))
    _put(state_jacobians, 8, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[3], _STILL, 0.0))
    _put(state_jacobians, 9, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[4], _STILL, 0.0))
    _put(area_jacobians, 0, face_flux_jvp(mean, jump, s, sigma, _ZERO, _ZERO, _AXIS[0], 0.0))
    _put(area_jacobians, 1, face_flux_jvp(mean, jump, s, sigma, _ZERO, _ZERO, _AXIS[1], 0.0))
    _put(area_jacobians, 2, face_flux_jvp(mean, jump, s, sigma, _ZERO, _ZERO, _AXIS[2], 0.0))


@njit(cache=True, error_model="numpy", nogil=True)
def _put(jacobian, m, column):
    for n in range(5):
        jacobian[n, m] = column[n]


@njit(cache=True, error_model="numpy", nogil=True)
def state_jvp(cells, roles, state_jacobians, cell_weights, sensors, d_states, out):
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
                mean[n] += cell_weights[f, 0, k] * d_states[at, n]
                jump[n] += cell_weights[f, 1, k] * d_states[at, n]
        if has_sensor:
            for k in range(4):
                sense += sensors[f, 1 + k] * d_states[near[k], 4]
            for n in range(5):
                sense += 0.5 * sensors[f, 5 + n] * (d_states[near[0], n] + d_states[near[3], n])
        b, c = near[1], near[2]
        for n in range(5):
            flux = sensors[f, 10 + n] * sense if has_sensor else 0.0
            for m in range(5):
                flux += state_jacobians[f, n, m] * mean[m] + state_jacobians[f, n, 5 + m] * jump[m]
            out[b, n] += flux
            if role == INNER:
                out[c, n] -= flux


@njit(cache=True, error_model="numpy", nogil=True)
def state_vjp(cells, roles, state_jacobians, cell_weights, sensors, bar, out):
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
                mean[m] += state_jacobians[f, n, m] * through[n]
                jump[m] += state_jacobians[f, n, 5 + m] * through[n]
        for k in range(4):
            at = near[k]
            for n in range(5):
                out[at, n] += cell_weights[f, 0, k] * mean[n] + cell_weights[f, 1, k] * jump[n]
        if has_sensor:
            for k in range(4):
                out[near[k], 4] += sensors[f, 1 + k] * sense
            for n in range(5):
                out[near[0], n] += 0.5 * sensors[f, 5 + n] * sense
                out[near[3], n] += 0.5 * sensors[f, 5 + n] * sense


def _face_ranges(n_faces: int) -> list[slice]:
    """Cut the list of faces into as many equal ranges as there are threads."""
    n = max(1, min(thread_count(None), n_faces // FACES_PER_THREAD))
    ends = [n_faces * k // n for k in range(n + 1)]
    return [slice(*pair) for pair in zip(ends[:-1], ends[1:])]


def _visit_faces(n_faces: int, task: Callable[[slice], None]) -> None:
    """Call ``task(range)`` for all ranges, on as many threads."""
    ranges = _face_ranges(n_faces)
    run_tasks(lambda n: task(ranges[n]), len(ranges), len(ranges))


def _sum_over_faces(n_faces: int, task: Callable[[slice, np.ndarray], None], like: np.ndarray) -> np.ndarray:
    """Sum what ``task(range, out)`` adds to zeros, in the order of the ranges.

    Parameters
    ----------
    n_faces : int
    task : callable
        Must release the interpreter lock.
    like : ndarray
        Array of the shape and type of the sum.
    """
    ranges = _face_ranges(n_faces)
    parts = [np.zeros_like(like) for _ in ranges]
    run_tasks(lambda n: task(ranges[n], parts[n]), len(ranges), len(ranges))
    for part in parts[1:]:
        parts[0] += part
    return parts[0]
