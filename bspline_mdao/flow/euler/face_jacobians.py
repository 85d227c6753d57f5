"""Jacobians of the fluxes of all faces in single precision, for the hundreds of products in Krylov methods.

They differentiate the flux of a face with respect to its mean state and its jump. The residual of a linear system is
computed exactly, see `.linearization`, so its solution can be refined to double-precision rounding.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit

from ...base.numerics.processes import summed_number
from ...base.numerics.vec5 import add_product, add_scaled, lane_sums, load, prefetch, store, zeros
from .cell_sums import visit
from .flux import STILL
from .flux_derivatives import face_flux_jvp
from .gas import N_STATES
from .reconstruction import (
    INNER,
    area_of,
    face_state,
    face_weights,
    has_area,
    has_sensor,
    shock_sensor,
    shock_sensor_vjp,
)
from .wall_boundary import state_jacobian

__all__ = ["FaceJacobians"]

N_SHOCK = 26
"""Numbers of a face at a shock: the sensor, weights of mean and jump, derivatives of the sensor by the two pressures in
the middle and the two outer states, and of the flux by the sensor."""

AHEAD = 16
"""Faces ahead of the current one whose Jacobians are prefetched."""


@dataclass(frozen=True, eq=False)
class FaceJacobians:
    """Jacobians of the fluxes of all faces in single precision, and products with the Jacobian of the residual."""

    discretization: Any  # its own type would be a circular import
    values: np.ndarray  # (n_faces, 5, 10), derivatives of the fluxes with respect to the mean state and to the jump
    # (n_faces,) of int, row in ``shocks`` of each face; -1 if the sensor is off. No faces if it is off at all of
    # them.
    shock_rows: np.ndarray
    shocks: np.ndarray  # (n_shocks, N_SHOCK), see `N_SHOCK`
    # of_circulation, circulation: (n_cells, 5), derivatives of the residual with respect to the circulation of a
    # section, and of the circulation with respect to the states; no cells if the far field has no vortex
    of_circulation: np.ndarray
    circulation: np.ndarray

    @classmethod
    def of(cls, linearization: Any) -> FaceJacobians:
        """Differentiate the fluxes of all faces."""
        discretization, n = linearization.discretization, len(linearization.areas)
        values = np.zeros((n, N_STATES, 2 * N_STATES), np.float32)
        rows = np.zeros(0, np.int32)
        if discretization.shock_threshold > 0.0:
            rows = np.full(n, -1, np.int32)
            visit(n, lambda part: find_shocks(discretization.scheme.part(part), linearization.states, rows[part]))
            at_shock = rows >= 0
            rows[at_shock] = np.arange(np.count_nonzero(at_shock))
            rows = rows if at_shock.any() else rows[:0]  # in slow flow a product costs as much as without a sensor
        shocks = np.zeros((int(rows.max(initial=-1)) + 1, N_SHOCK), np.float32)

        def fill(part: slice) -> None:
            face_jacobians(*linearization.at(part), values[part], rows[part], shocks)

        visit(n, fill)
        vortex = linearization.vortex
        terms = (linearization.of_circulation(vortex), vortex.by_state) if vortex else 2 * (np.zeros((0, N_STATES)),)
        return cls(discretization, values, rows, shocks, *(term.astype(np.float32) for term in terms))

    def product(self, d_states: np.ndarray) -> np.ndarray:
        """Change of the residual with the states, both of float32 and shape (n_cells, 5)."""
        discretization, scheme, local = self.discretization, self.discretization.scheme, d_states
        d_states = discretization.halo.extend(np.ascontiguousarray(d_states, np.float32))
        flux = np.empty((len(self.values), N_STATES), np.float32)
        rest = self.jump_weights, self.values, self.shock_rows, self.shocks, d_states

        visit(len(flux), lambda part: multiply(scheme, part.start, part.stop, *rest, flux))
        out = discretization.sums.of_faces(flux, discretization.faces.n_cells)
        return self._with_circulation(out, self.of_circulation, self.circulation, local)

    def transposed_product(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `product`."""
        discretization, scheme, local = self.discretization, self.discretization.scheme, bar
        bar = discretization.halo.pad(np.ascontiguousarray(bar, np.float32))
        contributions = np.empty((len(self.values), 4, N_STATES), np.float32)
        rest = self.jump_weights, self.values, self.shock_rows, self.shocks, bar

        visit(len(contributions), lambda part: multiply_transposed(scheme, part.start, part.stop, *rest, contributions))
        out = discretization.halo.fold(discretization.sums.of_stencils(contributions, len(bar)))
        return self._with_circulation(out, self.circulation, self.of_circulation, local)

    def _with_circulation(self, out: np.ndarray, column: np.ndarray, row: np.ndarray, vector: np.ndarray) -> np.ndarray:
        """Add the part of a product through the circulation of a section, if there is one."""
        if self.discretization.vortex:
            out += column * np.float32(summed_number(self.discretization.halo.comm, float(np.vdot(row, vector))))
        return out

    @cached_property
    def jump_weights(self) -> np.ndarray:
        """Weights of the four cells in the jump without a shock, shape (n_lines, 4), float32."""
        return self.discretization.stencil.smooth_jumps(self.discretization.dissipation).astype(np.float32)


@njit(cache=True, error_model="numpy", nogil=True)
def find_shocks(scheme, states, out):
    """Write a zero for each face at which the sensor is not off."""
    for f in range(len(out)):
        if has_sensor(scheme, f) and shock_sensor(states, scheme.cells[f], scheme.threshold) > 0.0:
            out[f] = 0


@njit(cache=True, error_model="numpy", nogil=True)
def face_jacobians(scheme, areas, states, outside, values, shock_rows, shocks):
    """Differentiate the fluxes of all faces; the last arguments are filled, see `FaceJacobians`."""
    face_weight = np.zeros((2, 4))
    for f in range(len(values)):
        s, role, sigma = area_of(areas, f), scheme.roles[f], 0.0
        at = shock_rows[f] if len(shock_rows) > 0 else -1
        if not has_area(s):
            if at >= 0:
                face_weights(scheme, f, 0.0, face_weight)
                for k in range(4):
                    shocks[at, 1 + k], shocks[at, 5 + k] = face_weight[0, k], face_weight[1, k]
            continue
        if at >= 0:
            sigma = shock_sensor(states, scheme.cells[f], scheme.threshold)
        mean, jump, mean_slope, jump_slope = face_state(scheme, f, states, outside[f], sigma)
        state_jacobian(role, mean, jump, s, sigma, values[f])
        if at >= 0:
            face_weights(scheme, f, sigma, face_weight)
            column = face_flux_jvp(mean, jump, s, sigma, mean_slope, jump_slope, STILL, 1.0)
            by_first, by_left, by_right, by_last = shock_sensor_vjp(states, scheme.cells[f], scheme.threshold, 1.0)
            row = shocks[at]
            row[0], row[9], row[10] = sigma, by_left, by_right
            for k in range(4):
                row[1 + k], row[5 + k] = face_weight[0, k], face_weight[1, k]
            for n in range(5):
                row[11 + n], row[16 + n], row[21 + n] = by_first[n], by_last[n], column[n]


@njit(cache=True, error_model="numpy", nogil=True)
def multiply(scheme, first, end, jumps, values, shock_rows, shocks, d_states, out):
    """Change of the fluxes of a range of faces with the states, in an array for all, shape (n_faces, 5)."""
    # On a small grid, slicing a record for every range takes a tenth of the time of a product.
    cells, means, classes, lines = scheme.cells, scheme.means, scheme.classes, scheme.lines
    for f in range(first, end):
        at = shock_rows[f] if len(shock_rows) > 0 else -1
        mean = jump = nothing = zeros()
        for k in range(4):
            by_mean, by_jump = np.float32(means[classes[f], k]), jumps[lines[f], k]
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
            change = shocks[at, 9] * d_states[cells[f, 1], 4] + shocks[at, 10] * d_states[cells[f, 2], 4]
            for n in range(5):
                change += shocks[at, 11 + n] * d_states[cells[f, 0], n] + shocks[at, 16 + n] * d_states[cells[f, 3], n]
            flux = add_scaled(flux, change, load(shocks, N_SHOCK * at + 21))
        store(out, 5 * f, flux)


@njit(cache=True, error_model="numpy", nogil=True)
def multiply_transposed(scheme, first, end, jumps, values, shock_rows, shocks, bar, out):
    """Adjoints of the four cells at a range of faces from rows of the residual, in an array (n_faces, 4, 5)."""
    cells, means, classes, lines = scheme.cells, scheme.means, scheme.classes, scheme.lines
    for f in range(first, end):
        b, c, one = cells[f, 1], cells[f, 2], np.float32(1.0 if scheme.roles[f] == INNER else 0.0)
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
                sense += shocks[at, 21 + n] * through
        for k in range(4):
            by_mean, by_jump = np.float32(means[classes[f], k]), jumps[lines[f], k]
            if at >= 0:
                by_mean, by_jump = shocks[at, 1 + k], shocks[at, 5 + k]
            store(out, 20 * f + 5 * k, add_scaled(add_scaled(zeros(), by_mean, mean), by_jump, jump))
        if at >= 0:
            out[f, 1, 4] += shocks[at, 9] * sense
            out[f, 2, 4] += shocks[at, 10] * sense
            for n in range(5):
                out[f, 0, n] += shocks[at, 11 + n] * sense
                out[f, 3, n] += shocks[at, 16 + n] * sense
