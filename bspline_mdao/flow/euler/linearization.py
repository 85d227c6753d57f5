"""Derivatives of the residual of steady flow: exact products.

They differentiate the flux of every face on the fly, in the requested direction or in reverse, and store nothing.
Krylov methods need hundreds of products, and use those of `.face_jacobians` instead.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit

from ...base.numerics.processes import summed
from .cell_sums import visit
from .face_jacobians import FaceJacobians
from .far_field import VortexTangent
from .flux_derivatives import face_flux_vjp
from .gas import N_STATES
from .reconstruction import (
    FARFIELD,
    INNER,
    area_of,
    face_state,
    face_weights,
    has_area,
    has_sensor,
    shock_sensor,
    shock_sensor_jvp,
    shock_sensor_vjp,
)
from .wall_boundary import flux_through_jvp, flux_through_vjp

__all__ = ["Linearization", "through_face"]


@dataclass(frozen=True, eq=False)
class Linearization:
    """Derivatives of the residual; methods `..._jvp` and `..._vjp` are exact products with its Jacobian."""

    discretization: Any  # its own type would be a circular import
    # (n_cells + n_ghosts, 5), point of linearization, with the cells of other processes; must not change
    states: np.ndarray
    areas: np.ndarray  # (n_faces, 3), area vectors (m^2); must not change
    outside: np.ndarray  # (n_faces, 5), states outside the far field, by the number of the face
    vortex: VortexTangent | None  # derivatives of these states, if they are not the free stream

    @cached_property
    def jacobians(self) -> FaceJacobians:
        """Jacobians of the fluxes in single precision, computed at the first call."""
        return FaceJacobians.of(self)

    def state_jvp(self, d_states: np.ndarray) -> np.ndarray:
        """Change of the residual with the states, both of shape (n_cells, 5)."""
        halo = self.discretization.halo
        return self._change(halo.extend(d_states), np.zeros_like(self.areas), np.zeros(N_STATES))

    def area_jvp(self, d_areas: np.ndarray) -> np.ndarray:
        """Change of the residual, shape (n_cells, 5), with the area vectors, shape (n_faces, 3)."""
        return self._change(np.zeros_like(self.states), d_areas, np.zeros(N_STATES))

    def stream_jvp(self, d_stream: np.ndarray) -> np.ndarray:
        """Change of the residual, shape (n_cells, 5), with the free stream, shape (5,)."""
        return self._change(np.zeros_like(self.states), np.zeros_like(self.areas), d_stream)

    def state_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `state_jvp`."""
        discretization, bar = self.discretization, self._seen(bar)
        contributions = np.zeros((len(self.areas), 4, N_STATES))

        def fill(part: slice) -> None:
            state_contributions(*self.at(part), bar, contributions[part])

        visit(len(contributions), fill)
        change = discretization.halo.fold(discretization.sums.of_stencils(contributions, len(self.states)))
        if self.vortex:
            change += self.vortex.by_state * self.vortex.circulation_vjp(self._outside_bars(bar))
        return change

    def area_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `area_jvp`."""
        bar, out = self._seen(bar), np.zeros_like(self.areas)
        visit(len(out), lambda part: area_bars(*self.at(part), bar, out[part]))
        if self.vortex:
            out[self.vortex.vortex.walls] += self.vortex.by_area * self.vortex.circulation_vjp(self._outside_bars(bar))
        return out

    def stream_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `stream_jvp`."""
        local = self._outside_bars(self._seen(bar))
        local = self.vortex.stream_vjp(local) if self.vortex else local.sum(axis=0)
        return summed(self.discretization.halo.comm, local)

    def of_circulation(self, vortex: VortexTangent) -> np.ndarray:
        """Change of the residual, shape (n_cells, 5), with the circulation of a section."""
        still = np.zeros_like(self.states), np.zeros_like(self.areas)
        return self._sum_changes(*still, self.discretization.at_far_field(vortex.by_circulation))

    def _change(self, d_states: np.ndarray, d_areas: np.ndarray, d_stream: np.ndarray) -> np.ndarray:
        """Change of the residual in a direction that includes cells of other processes."""
        d_far = self.vortex.outside_jvp(d_states, d_areas, d_stream) if self.vortex else d_stream
        return self._sum_changes(d_states, d_areas, self.discretization.at_far_field(d_far))

    def _sum_changes(self, d_states: np.ndarray, d_areas: np.ndarray, d_outside: np.ndarray) -> np.ndarray:
        """Change of the residual with states, area vectors and the states outside."""
        dtype = np.result_type(d_states, d_areas, d_outside)
        d_states, d_areas = (np.ascontiguousarray(d, dtype) for d in (d_states, d_areas))
        flux = np.zeros((len(d_areas), N_STATES), dtype)

        def fill(part: slice) -> None:
            flux_changes(*self.at(part), d_areas[part], d_states, d_outside[part], flux[part])

        visit(len(flux), fill)
        return self.discretization.sums.of_faces(flux, self.discretization.faces.n_cells)

    def _outside_bars(self, bar: np.ndarray) -> np.ndarray:
        """Adjoint of the states outside the far field, shape (n_far, 5), from rows of the residual."""
        vortex = self.discretization.vortex
        far = vortex.faces if vortex else np.flatnonzero(self.discretization.stencil.roles == FARFIELD)
        out = np.zeros((len(far), N_STATES))
        outside_bars(*self.at(far), bar, out)
        return out

    def _seen(self, bar: np.ndarray) -> np.ndarray:
        """Rows of the cells of this process, with zeros for the cells of others."""
        return np.ascontiguousarray(self.discretization.halo.pad(bar))

    def at(self, part: slice | np.ndarray) -> tuple:
        """Arguments of the kernels for a range or list of faces."""
        return self.discretization.scheme.part(part), self.areas[part], self.states, self.outside[part]


@njit(cache=True, error_model="numpy", nogil=True)
def flux_changes(scheme, areas, states, outside, d_areas, d_states, d_outside, out):
    """Change of the fluxes of all faces with states, area vectors and states outside at once."""
    for f in range(len(out)):
        s, ds, role = area_of(areas, f), area_of(d_areas, f), scheme.roles[f]
        if not has_area(s):
            continue
        sigma, change = 0.0, 0.0 * d_states[0, 0]
        if has_sensor(scheme, f):
            near = scheme.cells[f]
            sigma = shock_sensor(states, near, scheme.threshold)
            change += shock_sensor_jvp(states, near, scheme.threshold, d_states)
        mean, jump, mean_slope, jump_slope = face_state(scheme, f, states, outside[f], sigma)
        d_mean, d_jump, _, _ = face_state(scheme, f, d_states, d_outside[f], sigma)
        d_mean, d_jump = _moved(d_mean, change, mean_slope), _moved(d_jump, change, jump_slope)
        flux = flux_through_jvp(role, mean, jump, s, sigma, d_mean, d_jump, ds, change)
        for n in range(5):
            out[f, n] = flux[n]


@njit(cache=True, error_model="numpy", inline="always")
def _moved(a, factor, b):
    return (
        a[0] + factor * b[0],
        a[1] + factor * b[1],
        a[2] + factor * b[2],
        a[3] + factor * b[3],
        a[4] + factor * b[4],
    )


@njit(cache=True, error_model="numpy", inline="always")
def through_face(scheme, f, bar):
    """Adjoint of the flux of a face from rows of the residual."""
    b, c, inner = scheme.cells[f, 1], scheme.cells[f, 2], 1.0 if scheme.roles[f] == INNER else 0.0
    return (
        bar[b, 0] - inner * bar[c, 0],
        bar[b, 1] - inner * bar[c, 1],
        bar[b, 2] - inner * bar[c, 2],
        bar[b, 3] - inner * bar[c, 3],
        bar[b, 4] - inner * bar[c, 4],
    )


@njit(cache=True, error_model="numpy", nogil=True)
def state_contributions(scheme, areas, states, outside, bar, out):
    """Adjoints of the four cells at each face, shape (n_faces, 4, 5), from rows of the residual."""
    face_weight = np.zeros((2, 4))
    for f in range(len(out)):
        s, role = area_of(areas, f), scheme.roles[f]
        if not has_area(s):
            continue
        through, sigma = through_face(scheme, f, bar), 0.0
        if has_sensor(scheme, f):
            sigma = shock_sensor(states, scheme.cells[f], scheme.threshold)
        face_weights(scheme, f, sigma, face_weight)
        mean, jump, mean_slope, jump_slope = face_state(scheme, f, states, outside[f], sigma)
        mean_bar, jump_bar, _, sense = flux_through_vjp(role, mean, jump, s, sigma, through)
        for k in range(4):
            for n in range(5):
                out[f, k, n] = face_weight[0, k] * mean_bar[n] + face_weight[1, k] * jump_bar[n]
        if has_sensor(scheme, f):
            for n in range(5):
                sense += mean_bar[n] * mean_slope[n] + jump_bar[n] * jump_slope[n]
            first, left, right, last = shock_sensor_vjp(states, scheme.cells[f], scheme.threshold, sense)
            out[f, 1, 4] += left
            out[f, 2, 4] += right
            for n in range(5):
                out[f, 0, n] += first[n]
                out[f, 3, n] += last[n]


@njit(cache=True, error_model="numpy", nogil=True)
def area_bars(scheme, areas, states, outside, bar, out):
    """Adjoints of the area vectors, shape (n_faces, 3), from rows of the residual."""
    for f in range(len(out)):
        s, role = area_of(areas, f), scheme.roles[f]
        if not has_area(s):
            continue
        through, sigma = through_face(scheme, f, bar), 0.0
        if has_sensor(scheme, f):
            sigma = shock_sensor(states, scheme.cells[f], scheme.threshold)
        mean, jump, _, _ = face_state(scheme, f, states, outside[f], sigma)
        _, _, area_bar, _ = flux_through_vjp(role, mean, jump, s, sigma, through)
        for n in range(3):
            out[f, n] = area_bar[n]


@njit(cache=True, error_model="numpy", nogil=True)
def outside_bars(scheme, areas, states, outside, bar, out):
    """Adjoint of the free stream from rows of the residual through faces of the far field, shape (n_faces, 5)."""
    for f in range(len(out)):
        s = area_of(areas, f)
        if not has_area(s):
            continue
        mean, jump, _, _ = face_state(scheme, f, states, outside[f], 0.0)
        mean_bar, jump_bar, _, _ = face_flux_vjp(mean, jump, s, 0.0, through_face(scheme, f, bar))
        for n in range(5):
            out[f, n] = 0.5 * mean_bar[n] + jump_bar[n]
