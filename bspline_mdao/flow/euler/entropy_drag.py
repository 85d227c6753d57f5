r"""Drag of the entropy that leaves through the far field, without the large terms that cancel in it.

In conservative variables the entropy has the derivatives v. The mass, momentum and energy that leave the grid through
its whole boundary are the sum of the residuals, zero, and so

    drag ~ sum_far G - v_inf . sum_boundary F

equals the flux G of the entropy once the flow is solved. The flux F of the scheme carries entropy out with half the sum
of the speed through the face and its rounded modulus, and with G of that speed the two agree to first order about the
free stream. The remainder far away is of second order: residuals that are not quite zero, of the flow or of linear
systems, count by v - v_inf instead of v. With relative numbers there are no large terms left in the sum either:

.. math::
    v_\infty \cdot F = \gamma (\gamma - 1) \left[ (\rho U - \tfrac12 \rho Q) \left( \frac{a^2 - 1}{\gamma - 1}
        + \tfrac12 |c|^2 \right) - (p - p_\infty) \, u_\infty \cdot S - \tfrac12 P \, c \cdot S
        - \tfrac12 \lambda_0 \left( \frac{\delta p - \delta \rho}{\gamma - 1} + \tfrac12 |c|^2 \delta \rho
        + \rho \, c \cdot \delta u \right) \right] ,

with c the velocity minus the stream's and the names of `.flux`; on walls and planes of symmetry only the second term
remains, and their sum is the pressure drag.

Theory: ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.numerics.halo import Halo
from ...base.numerics.processes import summed, summed_number
from ...base.numerics.vectors import dots
from .far_field import FarVortex
from .flow_grid import FlowGrid, area_vectors, area_vectors_jvp, area_vectors_vjp
from .flux import CV, ROUNDING
from .gas import GAMMA, N_STATES, free_stream, free_stream_partials
from .reconstruction import SLIP
from .residual import Discretization

__all__ = ["EntropyCoefficient", "EntropyDrag", "entropy_flux", "entropy_scale", "relative_entropy"]

_HEAT = GAMMA * (GAMMA - 1.0)
"""One over the temperature of the stream times the specific heat at constant volume."""

_REST = np.array([1.0, 0.0, 0.0, 0.0, 1.0 / GAMMA])
"""The gas of the stream without its speed."""


@dataclass(frozen=True, eq=False)
class EntropyDrag:
    """Drag of the entropy that leaves through the far field (Oswatitsch), divided by the dynamic pressure (m^2)."""

    # In flow without shocks there should be none. It comes from discretization errors, including those that weaken
    # trailing vortices: their part of the induced drag is in the entropy as well, so the two do not add up to the
    # pressure drag.

    # (n_boundary, 4) of int, rows of the corners of the boundary faces of this process; area vectors belong to these
    # faces
    corners: np.ndarray
    far: np.ndarray  # (n_far,) of int, faces of the far field among them,
    cells: np.ndarray  # (n_far,) of int, and their cells
    slip: np.ndarray  # (n_slip,) of int, faces of walls and planes of symmetry among them,
    slip_cells: np.ndarray  # (n_slip, 4) of int, cells from which their pressures are extrapolated,
    weights: np.ndarray  # (n_slip, 4), and their weights
    halo: Halo  # exchange of cells with other processes
    vortex: FarVortex | None  # in the states outside, its faces among the boundary faces
    axes: np.ndarray  # (3, 3), rows are the directions downstream, along the span, and up

    @classmethod
    def of(cls, discretization: Discretization, axes: np.ndarray) -> EntropyDrag:
        """Take the boundary faces of a discretisation, and the vortex outside its far field."""
        faces, stencil, vortex = discretization.faces, discretization.stencil, discretization.vortex
        first, far, slip = faces.n_inner, faces.faces_of("farfield"), np.flatnonzero(stencil.roles == SLIP)
        if vortex is not None:
            vortex = replace(vortex, faces=vortex.faces - first, walls=vortex.walls - first)
        pressures = stencil.cells[slip], stencil.means[stencil.classes[slip]]
        ends = faces.corners[first:], far - first, faces.left[far], slip - first
        return cls(*ends, *pressures, discretization.halo, vortex, axes)

    def evaluate(self, states: np.ndarray, areas: np.ndarray, alpha: float, mach: float) -> float:
        """Drag of states, shape (n_cells, 5), and boundary faces with area vectors (m^2), shape (n_boundary, 3)."""
        stream, seen = free_stream(mach, alpha, self.axes), self.halo.extend(states)
        _, *at = self._at_far_field(seen, areas, stream)
        push = areas[self.slip] @ stream[1:4]
        local = np.sum(far_terms(*at, *map(np.zeros_like, at))[0]) + self._rises(seen, stream[4]) @ push
        return summed_number(self.halo.comm, local) / (0.5 * mach**3)

    def jvp(
        self,
        states: np.ndarray,
        areas: np.ndarray,
        alpha: float,
        mach: float,
        d_states: np.ndarray,
        d_areas: np.ndarray,
        d_alpha: float,
        d_mach: float,
    ) -> float:
        """Change of the drag with the states, the area vectors, the angle (rad) and the Mach number."""
        stream, seen, d_seen = free_stream(mach, alpha, self.axes), self.halo.extend(states), self.halo.extend(d_states)
        by_mach, by_alpha = free_stream_partials(mach, alpha, self.axes)
        d_stream = by_mach * d_mach + by_alpha * d_alpha
        far, *at = self._at_far_field(seen, areas, stream)
        d_outside = np.tile(d_stream, (len(self.far), 1))
        if self.vortex is not None:
            d_outside = self.vortex.linearize(seen, areas, stream).outside_jvp(d_seen, d_areas, d_stream)
        d_near: tuple[np.ndarray, ...] = (
            d_seen[self.cells[far]] - d_stream,
            d_outside[far] - d_stream,
            d_areas[self.far[far]],
            d_stream[1:4],
        )
        slip, d_slip = areas[self.slip], d_areas[self.slip]
        local = np.sum(far_terms(*at, *d_near)[1]) + self._rises(d_seen, 0.0) @ (slip @ stream[1:4])
        local += self._rises(seen, stream[4]) @ (d_slip @ stream[1:4] + slip @ d_stream[1:4])
        change = summed_number(self.halo.comm, local) / (0.5 * mach**3)
        return change - 3.0 / mach * self.evaluate(states, areas, alpha, mach) * d_mach

    def vjp(
        self, states: np.ndarray, areas: np.ndarray, alpha: float, mach: float, bar: float
    ) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Derivatives with respect to the states, the area vectors, the angle and the Mach number, times a number."""
        stream, seen, scaled = free_stream(mach, alpha, self.axes), self.halo.extend(states), bar / (0.5 * mach**3)
        far, *at = self._at_far_field(seen, areas, stream)
        near, beyond, face, speed = (scaled * part for part in _gradients(*at))
        seen_bar, areas_bar, outside = np.zeros_like(seen), np.zeros_like(areas), np.zeros((len(self.far), N_STATES))
        np.add.at(seen_bar, self.cells[far], near)
        areas_bar[self.far[far]], outside[far] = face, beyond
        slip, rises = areas[self.slip], scaled * self._rises(seen, stream[4])
        np.add.at(seen_bar[:, 4], self.slip_cells, self.weights * (scaled * slip @ stream[1:4])[:, None])
        areas_bar[self.slip] = rises[:, None] * stream[1:4]
        stream_bar = -near.sum(axis=0) - beyond.sum(axis=0)
        stream_bar[1:4] += speed.sum(axis=0) + rises @ slip
        states_bar = self.halo.fold(seen_bar)
        if self.vortex is None:
            stream_bar += outside.sum(axis=0)
        else:
            tangent = self.vortex.linearize(seen, areas, stream)
            circulation = tangent.circulation_vjp(outside)
            states_bar += tangent.by_state * circulation
            areas_bar[self.vortex.walls] += tangent.by_area * circulation
            stream_bar += tangent.stream_vjp(outside)
        by_mach, by_alpha = free_stream_partials(mach, alpha, self.axes)
        stream_bar = summed(self.halo.comm, stream_bar)
        mach_bar = by_mach @ stream_bar - 3.0 / mach * bar * self.evaluate(states, areas, alpha, mach)
        return states_bar, areas_bar, by_alpha @ stream_bar, mach_bar

    def _at_far_field(self, seen: np.ndarray, areas: np.ndarray, stream: np.ndarray) -> tuple:
        """The faces of the far field with an area, and the arguments of `far_terms` for them."""
        outside = stream[None] if self.vortex is None else self.vortex.outside(seen, areas, stream)
        far = np.flatnonzero((areas[self.far] != 0.0).any(axis=1))
        beyond = np.broadcast_to(outside, (len(self.far), N_STATES))[far] - stream
        return far, seen[self.cells[far]] - stream, beyond, areas[self.far[far]], stream[1:4]

    def _rises(self, seen: np.ndarray, pressure: float | np.ndarray) -> np.ndarray:
        """Excess of the pressures on walls and planes of symmetry over another pressure, shape (n_slip,)."""
        return np.sum(self.weights * (seen[self.slip_cells, 4] - pressure), axis=1)


@dataclass(frozen=True, eq=False)
class EntropyCoefficient:
    """The entropy drag divided by the reference area (m^2), a kernel of states and nodes, see `.forces.StateKernel`."""

    drag: EntropyDrag
    nodes: Halo  # exchange of nodes with other processes
    area: float

    outputs = ("CD_entropy",)

    @classmethod
    def of(cls, flow: FlowGrid, area: float) -> EntropyCoefficient:
        """Take the far field of a grid."""
        return cls(EntropyDrag.of(flow.discretization, flow.axes), flow.corners, area)

    def evaluate(self, states: np.ndarray, nodes: np.ndarray, alpha: float, mach: float) -> dict[str, Any]:
        """Coefficient by its name; real or complex."""
        boundary = area_vectors(self.nodes.extend(nodes), self.drag.corners)
        return {"CD_entropy": self.drag.evaluate(states, boundary, alpha, mach) / self.area}

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
        """Derivative along a direction in all arguments."""
        seen, d_seen = self.nodes.extend(nodes), self.nodes.extend(d_nodes)
        boundary = area_vectors(seen, self.drag.corners)
        d_boundary = area_vectors_jvp(seen, self.drag.corners, d_seen)
        d_drag = self.drag.jvp(states, boundary, alpha, mach, d_states, d_boundary, d_alpha, d_mach)
        return {"CD_entropy": d_drag / self.area}

    def vjp(
        self, states: np.ndarray, nodes: np.ndarray, alpha: float, mach: float, bars: dict
    ) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Apply the transpose of `jvp`: derivatives with respect to states, nodes, angle and Mach number."""
        seen = self.nodes.extend(nodes)
        boundary, drag_bar = area_vectors(seen, self.drag.corners), np.sum(bars["CD_entropy"]) / self.area
        states_bar, areas_bar, alpha_bar, mach_bar = self.drag.vjp(states, boundary, alpha, mach, drag_bar)
        nodes_bar = self.nodes.fold(area_vectors_vjp(seen, self.drag.corners, areas_bar))
        return states_bar, nodes_bar, alpha_bar, mach_bar


def far_terms(
    b: np.ndarray,
    o: np.ndarray,
    s: np.ndarray,
    u: np.ndarray,
    db: np.ndarray,
    do: np.ndarray,
    ds: np.ndarray,
    du: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Flux of the entropy minus v_inf . F, by the latter's factor, shape (n,), and its change, on the far field."""
    # From states of the cells and outside minus the stream's, both of shape (n, 5), area vectors, shape (n, 3), and the
    # velocity of the stream, shape (3,).
    value, change = _entropy(b, s, u, db, ds, du)
    w, dw, j, dj = 0.5 * (b + o), 0.5 * (db + do), o - b, do - db
    r, dr, e, de, c, dc = 1.0 + w[:, 0], dw[:, 0], w[:, 4], dw[:, 4], w[:, 1:4], dw[:, 1:4]
    jr, djr, jp, djp, ju, dju = j[:, 0], dj[:, 0], j[:, 4], dj[:, 4], j[:, 1:4], dj[:, 1:4]
    v, dv, p = u + c, du + dc, e + _REST[4]
    U, dU, jU, djU = dots(v, s), dots(dv, s) + dots(v, ds), dots(ju, s), dots(dju, s) + dots(ju, ds)
    s2, ds2, q2, dq2 = dots(s, s), 2.0 * dots(s, ds), dots(v, v), 2.0 * dots(v, dv)
    stream, d_stream, cs, dcs = s @ u, ds @ u + s @ du, dots(c, s), dots(dc, s) + dots(c, ds)
    cc, dcc, cj, dcj = dots(c, c), 2.0 * dots(c, dc), dots(c, ju), dots(dc, ju) + dots(c, dju)
    heat = CV * (GAMMA * e - w[:, 0]) / r
    rest, d_rest = heat + 0.5 * cc, (CV * (GAMMA * de - dr) - heat * dr) / r + 0.5 * dcc
    A = np.sqrt(GAMMA * p / r * s2)
    dA = 0.5 * A * (de / p - dr / r + ds2 / s2)
    k, dk = (ROUNDING * A) ** 2, ROUNDING**2 * A * dA
    l0, lp, lm = np.sqrt(U * U + k), np.sqrt((U + A) ** 2 + k), np.sqrt((U - A) ** 2 + k)
    dl0, dlp, dlm = (U * dU + dk) / l0, ((U + A) * (dU + dA) + dk) / lp, ((U - A) * (dU - dA) + dk) / lm
    sigma, d_sigma, delta, d_delta = 0.5 * (lp + lm) - l0, 0.5 * (dlp + dlm) - dl0, 0.5 * (lp - lm), 0.5 * (dlp - dlm)
    m2 = q2 * r / (GAMMA * p)
    slow = 1.0 / np.sqrt(1.0 + m2 * m2)
    low, d_low = m2 * slow, slow**3 * ((dq2 * r + q2 * dr) / (GAMMA * p) - m2 * de / p)
    g, dg = sigma * r * low, (d_sigma * r + sigma * dr) * low + sigma * r * d_low
    P, Q = g * jU / s2 + delta * jp / A, sigma * jp / (GAMMA * p) + delta * jU / A
    dP = (dg * jU + g * (djU - jU * ds2 / s2)) / s2 + (d_delta * jp + delta * djp - delta * jp * dA / A) / A
    dQ = (d_sigma * jp + sigma * djp - sigma * jp * de / p) / (GAMMA * p)
    dQ += (d_delta * jU + delta * djU - delta * jU * dA / A) / A
    through, d_through = U - 0.5 * Q, dU - 0.5 * dQ
    loss = CV * (jp - jr) + 0.5 * cc * jr + r * cj
    d_loss = CV * (djp - djr) + 0.5 * (dcc * jr + cc * djr) + dr * cj + r * dcj
    value = value - (r * through * rest - e * stream - 0.5 * (P * cs + l0 * loss))
    change = change - (dr * through + r * d_through) * rest - r * through * d_rest + de * stream + e * d_stream
    return value, change + 0.5 * (dP * cs + P * dcs + dl0 * loss + l0 * d_loss)


def _entropy(
    b: np.ndarray, s: np.ndarray, u: np.ndarray, db: np.ndarray, ds: np.ndarray, du: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Flux of the entropy of cells, divided by the factor of v_inf . F, from their states minus the stream's."""
    rho, v, dv = 1.0 + b[:, 0], u + b[:, 1:4], du + db[:, 1:4]
    entropy, heat = np.log1p(GAMMA * b[:, 4]) - GAMMA * np.log1p(b[:, 0]), 1.0 + GAMMA * b[:, 4]
    d_entropy = GAMMA * (db[:, 4] / heat - db[:, 0] / rho)
    U, dU, s2 = dots(v, s), dots(dv, s) + dots(v, ds), dots(s, s)
    k = ROUNDING**2 * heat / rho * s2
    dk = ROUNDING**2 * ((GAMMA * db[:, 4] - heat * db[:, 0] / rho) * s2 + 2.0 * heat * dots(s, ds)) / rho
    modulus = np.sqrt(U * U + k)
    out, d_out = 0.5 * (U + modulus), 0.5 * (dU + (U * dU + 0.5 * dk) / modulus)
    change = db[:, 0] * out * entropy + rho * (d_out * entropy + out * d_entropy)
    return rho * out * entropy / _HEAT, change / _HEAT


def _gradients(b: np.ndarray, o: np.ndarray, s: np.ndarray, u: np.ndarray) -> list[np.ndarray]:
    """Derivatives of `far_terms` by its four arguments, for each face: shapes (n, 5), (n, 5), (n, 3) twice."""
    # direction by direction, as there are few faces
    still, at = [np.zeros_like(part) for part in (b, o, s, u)], (b, o, s, u)
    found = []
    for n, part in enumerate(at):
        units = np.eye(part.shape[-1])
        along = ([*still[:n], np.broadcast_to(unit, part.shape), *still[n + 1 :]] for unit in units)
        found.append(np.stack([far_terms(*at, *direction)[1] for direction in along], axis=1))
    return found


def entropy_flux(w: np.ndarray, areas: np.ndarray) -> np.ndarray:
    """Entropy that the scheme carries out through faces of the far field, shape (n,), from the states of cells."""
    still = np.zeros_like(w), np.zeros_like(areas), np.zeros(3)
    return _HEAT * _entropy(w - _REST, areas, np.zeros(3), *still)[0]


def relative_entropy(w: np.ndarray) -> np.ndarray:
    """Entropy above the free stream's, divided by the specific heat at constant volume."""
    return np.log(GAMMA * w[:, 4]) - GAMMA * np.log(w[:, 0])


def entropy_scale(mach: float) -> float:
    """Dynamic pressure times speed, divided by temperature of the stream and specific heat at constant volume."""
    return 0.5 * mach**3 * _HEAT
