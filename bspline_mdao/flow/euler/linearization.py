"""Derivatives of the residual of steady flow: exact products, and the Jacobians of all faces in single precision.

Exact products differentiate the flux of every face again, in the one direction that is asked for, or backwards: they
keep nothing. Krylov methods take products by the hundred; theirs are with Jacobians in single precision, of the flux of
a face with respect to its mean state and its jump. What these leave of a linear system is known exactly, so that its
solution can be refined to what rounding in double precision leaves.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit

from ...numerics.fives import add_product, add_scaled, lane_sums, load, prefetch, store, zeros
from ...numerics.processes import summed, summed_number
from .cell_sums import visit
from .far_vortex import VortexTangent
from .flux import face_flux_jvp
from .gas import N_STATES
from .reconstruction import FARFIELD, FIRST, INNER, MEAN, SLIP, THIRD, face_state, face_weights, shock_sensor

__all__ = ["FaceJacobians", "Linearization"]


@dataclass(frozen=True, eq=False)
class Linearization:
    """Derivatives of the residual; methods `..._jvp` and `..._vjp` are exact products with its Jacobian.

    Parameters
    ----------
    discretization : Discretization
    states : ndarray, shape (n_cells + n_ghosts, 5)
        Where it is differentiated, with the cells of other processes. Must not change.
    areas : ndarray, shape (n_faces, 3)
        Area vectors (m^2). Must not change.
    outside : ndarray, shape (n_faces, 5)
        States outside the far field, by the number of the face.
    vortex : VortexTangent, optional
        Derivatives of these states, where they are not the free stream.
    """

    discretization: Any  # a type of its own would have the two files import each other
    states: np.ndarray
    areas: np.ndarray
    outside: np.ndarray
    vortex: VortexTangent | None

    @cached_property
    def jacobians(self) -> FaceJacobians:
        """Jacobians of the fluxes in single precision, found at the first call."""
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
        shares = np.zeros((len(self.areas), 4, N_STATES))

        def fill(part):
            state_shares(*self._at(part), bar, shares[part])

        visit(len(shares), fill)
        change = discretization.halo.fold(discretization.sums.of_stencils(shares, len(self.states)))
        if self.vortex:
            change += self.vortex.by_state * self.vortex.circulation_vjp(self._outside_bars(bar))
        return change

    def area_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `area_jvp`."""
        bar, out = self._seen(bar), np.zeros_like(self.areas)
        visit(len(out), lambda part: area_bars(*self._at(part), bar, out[part]))
        if self.vortex:
            out[self.vortex.vortex.walls] += self.vortex.by_area * self.vortex.circulation_vjp(self._outside_bars(bar))
        return out

    def stream_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `stream_jvp`."""
        own = self._outside_bars(self._seen(bar))
        own = self.vortex.stream_vjp(own) if self.vortex else own.sum(axis=0)
        return summed(self.discretization.halo.comm, own)

    def of_circulation(self, vortex: VortexTangent) -> np.ndarray:
        """Change of the residual, shape (n_cells, 5), with the circulation of a section."""
        still = np.zeros_like(self.states), np.zeros_like(self.areas)
        return self._sum_changes(*still, self.discretization.at_far_field(vortex.by_circulation))

    def _change(self, d_states, d_areas, d_stream) -> np.ndarray:
        """Change of the residual in a direction, which counts cells of other processes."""
        d_far = self.vortex.outside_jvp(d_states, d_areas, d_stream) if self.vortex else d_stream
        return self._sum_changes(d_states, d_areas, self.discretization.at_far_field(d_far))

    def _sum_changes(self, d_states, d_areas, d_outside) -> np.ndarray:
        """Change of the residual with states, area vectors and the states outside."""
        dtype = np.result_type(d_states, d_areas, d_outside)
        d_states, d_areas = (np.ascontiguousarray(d, dtype) for d in (d_states, d_areas))
        flux = np.zeros((len(d_areas), N_STATES), dtype)

        def fill(part):
            flux_changes(*self._at(part), d_states, d_areas[part], d_outside[part], flux[part])

        visit(len(flux), fill)
        return self.discretization.sums.of_faces(flux, self.discretization.faces.n_cells)

    def _outside_bars(self, bar: np.ndarray) -> np.ndarray:
        """What the states outside the far field, shape (n_far, 5), get of rows of the residual."""
        vortex = self.discretization.vortex
        far = vortex.faces if vortex else np.flatnonzero(self.discretization.stencil.roles == FARFIELD)
        out = np.zeros((len(far), N_STATES))
        outside_bars(*self._at(far), bar, out)
        return out

    def _seen(self, bar: np.ndarray) -> np.ndarray:
        """Rows of the cells of this process, with none at those of others."""
        return np.ascontiguousarray(self.discretization.halo.pad(bar))

    def _at(self, part) -> tuple:
        """What the kernels take, of a range or list of faces."""
        discretization, stencil = self.discretization, self.discretization.stencil
        index = stencil.cells[part], stencil.weights, stencil.classes[part], stencil.roles[part]
        settings = discretization.dissipation, discretization.shock_threshold
        return *index, self.areas[part], self.states, self.outside[part], *settings


N_SHOCK = 28
"""Numbers of a face at a shock: the sensor, weights of mean and jump, derivatives of the sensor by the four pressures
and the two outer states, and of the flux by the sensor."""


@dataclass(frozen=True, eq=False)
class FaceJacobians:
    """Jacobians of the fluxes of all faces in single precision, and products with that of the residual.

    Parameters
    ----------
    discretization : Discretization
    values : ndarray of float32, shape (n_faces, 5, 10)
        Derivatives of the fluxes with respect to the mean state and to the jump.
    shock_rows : ndarray of int32, shape (n_faces,)
        Row in ``shocks`` of each face; -1 where the sensor is shut. No faces where it is shut at all of them.
    shocks : ndarray of float32, shape (n_shocks, 23)
        See `N_SHOCK`.
    of_circulation, circulation : ndarray of float32, shape (n_cells, 5)
        Derivatives of the residual with respect to the circulation of a section, and of that with respect to the
        states; no cells where the far field has no vortex.
    """

    discretization: Any  # a type of its own would have the two files import each other
    values: np.ndarray
    shock_rows: np.ndarray
    shocks: np.ndarray
    of_circulation: np.ndarray
    circulation: np.ndarray

    @classmethod
    def of(cls, linearization: Linearization) -> FaceJacobians:
        """Differentiate the fluxes of all faces."""
        discretization, n = linearization.discretization, len(linearization.areas)
        values = np.zeros((n, N_STATES, 2 * N_STATES), np.float32)
        rows = np.zeros(0, np.int32)
        if discretization.shock_threshold > 0.0:
            rows = np.full(n, -1, np.int32)
            visit(n, lambda part: find_shocks(*linearization._at(part), rows[part]))
            at_shock = rows >= 0
            rows[at_shock] = np.arange(np.count_nonzero(at_shock))
            rows = rows if at_shock.any() else rows[:0]  # in slow flow a product costs what it costs without a sensor
        shocks = np.zeros((int(rows.max(initial=-1)) + 1, N_SHOCK), np.float32)

        def fill(part):
            face_jacobians(*linearization._at(part), values[part], rows[part], shocks)

        visit(n, fill)
        vortex = linearization.vortex
        terms = (linearization.of_circulation(vortex), vortex.by_state) if vortex else 2 * (np.zeros((0, N_STATES)),)
        return cls(discretization, values, rows, shocks, *(term.astype(np.float32) for term in terms))

    def product(self, d_states: np.ndarray) -> np.ndarray:
        """Change of the residual with the states, both of float32 and shape (n_cells, 5)."""
        discretization, stencil, own = self.discretization, self.discretization.stencil, d_states
        d_states = discretization.halo.extend(np.ascontiguousarray(d_states, np.float32))
        flux, rest = np.empty((len(self.values), N_STATES), np.float32), (self.shocks, self.class_weights, d_states)

        def fill(part):
            index = stencil.cells[part], stencil.classes[part]
            multiply(*index, self.values[part], self.shock_rows[part], *rest, flux[part])

        visit(len(flux), fill)
        out = discretization.sums.of_faces(flux, discretization.faces.n_cells)
        return self._with_circulation(out, self.of_circulation, self.circulation, own)

    def transposed_product(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `product`."""
        discretization, stencil, own = self.discretization, self.discretization.stencil, bar
        bar = discretization.halo.pad(np.ascontiguousarray(bar, np.float32))
        shares, rest = np.empty((len(self.values), 4, N_STATES), np.float32), (self.shocks, self.class_weights, bar)

        def fill(part):
            index = stencil.cells[part], stencil.classes[part], stencil.roles[part]
            multiply_transposed(*index, self.values[part], self.shock_rows[part], *rest, shares[part])

        visit(len(shares), fill)
        out = discretization.halo.fold(discretization.sums.of_stencils(shares, len(bar)))
        return self._with_circulation(out, self.circulation, self.of_circulation, own)

    def _with_circulation(self, out, column: np.ndarray, row: np.ndarray, vector: np.ndarray) -> np.ndarray:
        """Add the part of a product that goes through the circulation of a section, if there is one."""
        if self.discretization.vortex:
            out += column * np.float32(summed_number(self.discretization.halo.comm, float(np.vdot(row, vector))))
        return out

    @cached_property
    def class_weights(self) -> np.ndarray:
        """Weights of the four cells in mean state and jump by the class of a face, shape (n_classes, 2, 4)."""
        stencil = self.discretization.stencil
        out = stencil.weights[:, [MEAN, FIRST]].astype(np.float32)
        inner = np.zeros(len(out), bool)
        inner[stencil.classes[stencil.roles == INNER]] = True
        out[inner, 1] = self.discretization.dissipation * stencil.weights[inner, THIRD]
        return out


AHEAD = 16
"""Faces ahead of the one in work whose Jacobians are asked for from memory."""

_ZERO, _STILL = (0.0,) * 5, (0.0,) * 3

_UNIT = tuple(tuple(float(n == m) for n in range(5)) for m in range(5))

_AXIS = tuple(unit[:3] for unit in _UNIT[:3])


@njit(cache=True, error_model="numpy", nogil=True)
def flux_changes(
    cells, weights, classes, roles, areas, states, outside, dissipation, threshold, d_states, d_areas, d_outside, out
):
    """Change of the fluxes of all faces with states, area vectors and states outside at once."""
    for f in range(len(cells)):
        s, ds = (areas[f, 0], areas[f, 1], areas[f, 2]), (d_areas[f, 0], d_areas[f, 1], d_areas[f, 2])
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] == 0.0:
            continue
        near, role, w = cells[f], roles[f], weights[classes[f]]
        sigma, change = 0.0, 0.0 * d_states[0, 0]
        if role == INNER and threshold > 0.0:
            sigma, by_pressure, by_first, by_last = shock_sensor(states, near, threshold)
            for k in range(4):
                change += by_pressure[k] * d_states[near[k], 4]
            for n in range(5):
                change += by_first[n] * d_states[near[0], n] + by_last[n] * d_states[near[3], n]
        mean, jump, mean_slope, jump_slope = face_state(states, near, w, role, outside[f], dissipation, sigma)
        d_mean, d_jump, _, _ = face_state(d_states, near, w, role, d_outside[f], dissipation, sigma)
        if role == SLIP:
            for n in range(3):
                out[f, 1 + n] = d_mean[4] * s[n] + mean[4] * ds[n]
            continue
        d_mean, d_jump = _moved(d_mean, change, mean_slope), _moved(d_jump, change, jump_slope)
        flux = face_flux_jvp(mean, jump, s, sigma, d_mean, d_jump, ds, change)
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


@njit(cache=True, error_model="numpy", nogil=True)
def state_shares(cells, weights, classes, roles, areas, states, outside, dissipation, threshold, bar, out):
    """What the four cells at each face, shape (n_faces, 4, 5), get of rows of the residual."""
    jacobian, through, mean_bar, jump_bar = np.zeros((5, 10)), np.zeros(5), np.zeros(5), np.zeros(5)
    face_weight = np.zeros((2, 4))
    for f in range(len(cells)):
        s = (areas[f, 0], areas[f, 1], areas[f, 2])
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] == 0.0:
            continue
        near, role, w = cells[f], roles[f], weights[classes[f]]
        for n in range(5):
            through[n] = bar[near[1], n] - (bar[near[2], n] if role == INNER else 0.0)
            mean_bar[n] = 0.0
            jump_bar[n] = 0.0
        has_sensor, sigma = role == INNER and threshold > 0.0, 0.0
        if has_sensor:
            sigma, by_pressure, by_first, by_last = shock_sensor(states, near, threshold)
        face_weights(w, role, dissipation, sigma, face_weight)
        if role == SLIP:
            mean_bar[4] = through[1] * s[0] + through[2] * s[1] + through[3] * s[2]
        else:
            mean, jump, mean_slope, jump_slope = face_state(states, near, w, role, outside[f], dissipation, sigma)
            _fill(mean, jump, s, sigma, jacobian)
            for n in range(5):
                for m in range(5):
                    mean_bar[m] += jacobian[n, m] * through[n]
                    jump_bar[m] += jacobian[n, 5 + m] * through[n]
        for k in range(4):
            for n in range(5):
                out[f, k, n] = face_weight[0, k] * mean_bar[n] + face_weight[1, k] * jump_bar[n]
        if has_sensor:
            column = face_flux_jvp(mean, jump, s, sigma, mean_slope, jump_slope, _STILL, 1.0)
            sense = 0.0
            for n in range(5):
                sense += column[n] * through[n]
            for k in range(4):
                out[f, k, 4] += by_pressure[k] * sense
            for n in range(5):
                out[f, 0, n] += by_first[n] * sense
                out[f, 3, n] += by_last[n] * sense


@njit(cache=True, error_model="numpy", nogil=True)
def area_bars(cells, weights, classes, roles, areas, states, outside, dissipation, threshold, bar, out):
    """What the area vectors, shape (n_faces, 3), get of rows of the residual."""
    jacobian, through = np.zeros((5, 3)), np.zeros(5)
    for f in range(len(cells)):
        s = (areas[f, 0], areas[f, 1], areas[f, 2])
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] == 0.0:
            continue
        near, role, w = cells[f], roles[f], weights[classes[f]]
        for n in range(5):
            through[n] = bar[near[1], n] - (bar[near[2], n] if role == INNER else 0.0)
        sigma = 0.0
        if role == INNER and threshold > 0.0:
            sigma = shock_sensor(states, near, threshold)[0]
        mean, jump, _, _ = face_state(states, near, w, role, outside[f], dissipation, sigma)
        if role == SLIP:
            for n in range(3):
                out[f, n] = mean[4] * through[1 + n]
            continue
        _put(jacobian, 0, face_flux_jvp(mean, jump, s, sigma, _ZERO, _ZERO, _AXIS[0], 0.0))
        _put(jacobian, 1, face_flux_jvp(mean, jump, s, sigma, _ZERO, _ZERO, _AXIS[1], 0.0))
        _put(jacobian, 2, face_flux_jvp(mean, jump, s, sigma, _ZERO, _ZERO, _AXIS[2], 0.0))
        for m in range(3):
            for n in range(5):
                out[f, m] += jacobian[n, m] * through[n]


@njit(cache=True, error_model="numpy", nogil=True)
def outside_bars(cells, weights, classes, roles, areas, states, outside, dissipation, threshold, bar, out):
    """What the free stream gets of rows of the residual through faces of the far field, shape (n_faces, 5)."""
    jacobian = np.zeros((5, 10))
    for f in range(len(cells)):
        s = (areas[f, 0], areas[f, 1], areas[f, 2])
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] == 0.0:
            continue
        near = cells[f]
        mean, jump, _, _ = face_state(states, near, weights[classes[f]], roles[f], outside[f], dissipation, 0.0)
        _fill(mean, jump, s, 0.0, jacobian)
        for n in range(5):
            for m in range(5):
                out[f, m] += (0.5 * jacobian[n, m] + jacobian[n, 5 + m]) * bar[near[1], n]


@njit(cache=True, error_model="numpy", nogil=True)
def find_shocks(cells, weights, classes, roles, areas, states, outside, dissipation, threshold, out):
    """Write a zero for each face where the sensor is not shut."""
    for f in range(len(cells)):
        if roles[f] == INNER and shock_sensor(states, cells[f], threshold)[0] > 0.0:
            out[f] = 0


@njit(cache=True, error_model="numpy", nogil=True)
def face_jacobians(
    cells, weights, classes, roles, areas, states, outside, dissipation, threshold, values, shock_rows, shocks
):
    """Differentiate the fluxes of all faces; the last arguments are filled, see `FaceJacobians`."""
    face_weight = np.zeros((2, 4))
    for f in range(len(cells)):
        s = (areas[f, 0], areas[f, 1], areas[f, 2])
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] == 0.0:
            if len(shock_rows) > 0 and shock_rows[f] >= 0:
                face_weights(weights[classes[f]], roles[f], dissipation, 0.0, face_weight)
                shocks[shock_rows[f], 1:9] = face_weight.ravel()
            continue
        near, role, w = cells[f], roles[f], weights[classes[f]]
        at = shock_rows[f] if len(shock_rows) > 0 else -1
        sigma = 0.0
        if at >= 0:
            sigma, by_pressure, by_first, by_last = shock_sensor(states, near, threshold)
        mean, jump, mean_slope, jump_slope = face_state(states, near, w, role, outside[f], dissipation, sigma)
        if role == SLIP:
            for n in range(3):
                values[f, 1 + n, 4] = s[n]
            continue
        _fill(mean, jump, s, sigma, values[f])
        if at >= 0:
            face_weights(w, role, dissipation, sigma, face_weight)
            column = face_flux_jvp(mean, jump, s, sigma, mean_slope, jump_slope, _STILL, 1.0)
            row = shocks[at]
            row[0] = sigma
            for k in range(4):
                row[1 + k], row[5 + k], row[9 + k] = face_weight[0, k], face_weight[1, k], by_pressure[k]
            for n in range(5):
                row[13 + n], row[18 + n], row[23 + n] = by_first[n], by_last[n], column[n]


@njit(cache=True, error_model="numpy", nogil=True)
def _fill(mean, jump, s, sigma, jacobian):
    """Differentiate in one argument after the other: written out, what is multiplied by zero is not compiled."""
    _put(jacobian, 0, face_flux_jvp(mean, jump, s, sigma, _UNIT[0], _ZERO, _STILL, 0.0))
    _put(jacobian, 1, face_flux_jvp(mean, jump, s, sigma, _UNIT[1], _ZERO, _STILL, 0.0))
    _put(jacobian, 2, face_flux_jvp(mean, jump, s, sigma, _UNIT[2], _ZERO, _STILL, 0.0))
    _put(jacobian, 3, face_flux_jvp(mean, jump, s, sigma, _UNIT[3], _ZERO, _STILL, 0.0))
    _put(jacobian, 4, face_flux_jvp(mean, jump, s, sigma, _UNIT[4], _ZERO, _STILL, 0.0))
    _put(jacobian, 5, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[0], _STILL, 0.0))
    _put(jacobian, 6, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[1], _STILL, 0.0))
    _put(jacobian, 7, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[2], _STILL, 0.0))
    _put(jacobian, 8, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[3], _STILL, 0.0))
    _put(jacobian, 9, face_flux_jvp(mean, jump, s, sigma, _ZERO, _UNIT[4], _STILL, 0.0))


@njit(cache=True, error_model="numpy", nogil=True)
def _put(jacobian, m, column):
    for n in range(5):
        jacobian[n, m] = column[n]


@njit(cache=True, error_model="numpy", nogil=True)
def multiply(cells, classes, values, shock_rows, shocks, weights, d_states, out):
    """Change of the fluxes of all faces with the states, shape (n_faces, 5)."""
    for f in range(len(cells)):
        at = shock_rows[f] if len(shock_rows) > 0 else -1
        mean = jump = nothing = zeros()
        for k in range(4):
            by_mean, by_jump = weights[classes[f], 0, k], weights[classes[f], 1, k]
            if at >= 0:
                by_mean, by_jump = shocks[at, 1 + k], shocks[at, 5 + k]
            state = load(d_states, 5 * cells[f, k])
            mean, jump = add_scaled(mean, by_mean, state), add_scaled(jump, by_jump, state)
        row = 50 * f
        for line in range(4):
            prefetch(values, row + 50 * AHEAD + 16 * line)
        flux = lane_sums(
            add_product(add_product(nothing, load(values, row), mean), load(values, row + 5), jump),
            add_product(add_product(nothing, load(values, row + 10), mean), load(values, row + 15), jump),
            add_product(add_product(nothing, load(values, row + 20), mean), load(values, row + 25), jump),
            add_product(add_product(nothing, load(values, row + 30), mean), load(values, row + 35), jump),
            add_product(add_product(nothing, load(values, row + 40), mean), load(values, row + 45), jump),
        )
        if at >= 0:
            change = np.float32(0.0)
            for k in range(4):
                change += shocks[at, 9 + k] * d_states[cells[f, k], 4]
            for n in range(5):
                change += shocks[at, 13 + n] * d_states[cells[f, 0], n] + shocks[at, 18 + n] * d_states[cells[f, 3], n]
            flux = add_scaled(flux, change, load(shocks, N_SHOCK * at + 23))
        store(out, 5 * f, flux)


@njit(cache=True, error_model="numpy", nogil=True)
def multiply_transposed(cells, classes, roles, values, shock_rows, shocks, weights, bar, out):
    """What the four cells at each face, shape (n_faces, 4, 5), get of rows of the residual."""
    for f in range(len(cells)):
        b, c, one = cells[f, 1], cells[f, 2], np.float32(1.0 if roles[f] == INNER else 0.0)
        at = shock_rows[f] if len(shock_rows) > 0 else -1
        mean = jump = zeros()
        for line in range(4):
            prefetch(values, 50 * (f + AHEAD) + 16 * line)
        sense = np.float32(0.0)
        for n in range(5):
            through, row = bar[b, n] - one * bar[c, n], 50 * f + 10 * n
            mean, jump = (
                add_scaled(mean, through, load(values, row)),
                add_scaled(jump, through, load(values, row + 5)),
            )
            if at >= 0:
                sense += shocks[at, 23 + n] * through
        for k in range(4):
            by_mean, by_jump = weights[classes[f], 0, k], weights[classes[f], 1, k]
            if at >= 0:
                by_mean, by_jump = shocks[at, 1 + k], shocks[at, 5 + k]
            store(out, 20 * f + 5 * k, add_scaled(add_scaled(zeros(), by_mean, mean), by_jump, jump))
        if at >= 0:
            for k in range(4):
                out[f, k, 4] += shocks[at, 9 + k] * sense
            for n in range(5):
                out[f, 0, n] += shocks[at, 13 + n] * sense
                out[f, 3, n] += shocks[at, 18 + n] * sense
