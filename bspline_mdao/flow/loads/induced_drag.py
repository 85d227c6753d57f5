"""Span load, lift and induced drag of a wing from its wake far downstream, in the Trefftz plane.

There the wake is a row of straight vortices that trail from the edges of the strips of a wing (`Wake`). With the
circulation ``g_i`` of strip i, its trace ``t_i`` in the plane from one trailing vortex to the next and a point ``m_i``
on it, its midpoint or another one, and the strengths ``s_j`` of the vortices at ``p_j``, the differences of the
circulations::

    lift / (rho V) = sum_i g_i t_iy,     drag / rho = 1/(4 pi) sum_ij g_i s_j (m_i - p_j) . t_i / |m_i - p_j|^2

From forces on the wall (`InducedDrag`), the lift of a strip per length of its trace is its circulation
(Kutta-Joukowski). With the angle ``t`` of a cosine along the trace, ``s = S cos t``, a load that goes to zero at the
tips is a sum of sines ``sin(n t)``. The first is the ellipse, and it alone carries the lift, from which it is computed.
A few more are fitted to the strips by least squares, fewer than there are strips, since the pressures at a tip are due
to a vortex that rolls up over its side: a wake that only leaves the trailing edge would count the load there as drag.

The sum is then distributed to many vortices at equal intervals of the angle. If the downwash is taken halfway between
two *angles*, sums over vortices are exact integrals of trigonometric polynomials.

Theory: ``docs/theory/far_field.rst`` and, for a vortex lattice, ``docs/theory/vortex_lattice.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...base.display import OneLine
from ...base.numerics.vectors import cross_2d
from .span_strips import SpanStrips
from .stream import stream_axes

__all__ = ["InducedDrag", "Wake", "least_drag"]


HARMONICS = 4
"""Number of sines of the load of a half wing, the odd ones up to ``sin(7 t)``; twice as many for a whole wing."""

_FINE = 64
"""Strips of the wake of a half wing: the drag of an elliptical load is then too small by 5e-5."""


@dataclass(frozen=True, eq=False)
class InducedDrag:
    """Span load and induced drag as functions of forces, nodes and angle of attack. Make it by `of` or `of_vortices`.

    ``loads``, shape (m, n), are the weights of the loads of the n ``strips`` of the wing in the loads of the wake.
    ``points``, shape (m + 1, n + 1), are the weights of the points of the trailing edge in the origins of the wake's
    vortices. ``places``, shape (m,), are the points of the downwash, see `Wake`.
    """

    strips: SpanStrips
    loads: np.ndarray
    points: np.ndarray
    places: np.ndarray

    @classmethod
    def of(cls, strips: SpanStrips, nodes: np.ndarray) -> InducedDrag:
        """Choose the strips of the wake on the baseline, nodes of shape (n_nodes, 3) in metres."""
        widths = np.linalg.norm(np.diff(_trace(strips, nodes, 0.0)[0], axis=0), axis=1)
        arc = np.concatenate([[0.0], np.cumsum(widths)])
        half = arc[-1] if strips.is_symmetric else 0.5 * arc[-1]
        end = np.arccos(1.0 - arc[-1] / half)
        angles = np.linspace(0.0, end, 1 + _FINE * (1 if strips.is_symmetric else 2))
        between = 0.5 * (angles[1:] + angles[:-1])
        fine, middles = half * (1.0 - np.cos(angles)), half * (1.0 - np.cos(between))
        sines = _sines(strips)
        stations = np.arccos(np.clip(1.0 - arc / half, -1.0, 1.0))
        return cls(
            strips,
            loads=np.sin(np.outer(between, sines)) @ _fit(stations, sines),
            points=np.stack([np.interp(fine, arc, unit) for unit in np.eye(len(arc))], axis=1),
            places=(middles - fine[:-1]) / np.diff(fine),
        )

    @classmethod
    def of_vortices(cls, strips: SpanStrips) -> InducedDrag:
        """Use the strips as strips of the wake: exact if the loads come from vortices between just these strips."""
        n = strips.n_strips
        return cls(strips, np.eye(n), np.eye(n + 1), np.full(n, 0.5))

    @classmethod
    def none(cls, strips: SpanStrips) -> InducedDrag:
        """Return no drag, and only the span load: a wing from wall to wall has no wake."""
        n = strips.n_strips
        return cls(strips, np.zeros((n, n)), np.eye(n + 1), np.full(n, 0.5))

    @property
    def has_wake(self) -> bool:
        """Whether there is a wake, and so an induced drag."""
        return bool(self.loads.any())

    def evaluate(
        self,
        forces: np.ndarray,  # (n_faces, 3), forces on the wall faces divided by the dynamic pressure (m^2)
        nodes: np.ndarray,  # (n_nodes, 3), nodes of the grid (m)
        alpha: float,  # angle of attack (rad)
    ) -> tuple[np.ndarray, float]:
        """Span load and induced drag; real or complex."""
        # Returns span_load: (n,), lift of every strip per length, divided by the dynamic pressure, at right angles to
        # the stream and to the strip's trace (m), which is twice its circulation divided by the speed; drag: induced
        # drag of the modelled part, a half wing or a whole one, divided by the dynamic pressure (m^2).
        trace, turn = _trace(self.strips, nodes, alpha)
        load = _Lift(np.diff(trace, axis=0), self.strips.face_weights @ forces @ turn.T).per_length
        return load, self._factor * self._wake(trace, load).drag

    def jvp(
        self,
        forces: np.ndarray,
        nodes: np.ndarray,
        alpha: float,
        d_forces: np.ndarray,
        d_nodes: np.ndarray,
        d_alpha: float,
    ) -> tuple[np.ndarray, float]:
        """Derivatives of `evaluate` along a direction in all of its arguments."""
        trace, turn = _trace(self.strips, nodes, alpha)
        d_trace, d_turn = _trace(self.strips, d_nodes, alpha)[0], _turn_slope(self.strips.axes, alpha)
        d_trace = d_trace + d_alpha * (self.strips.trailing @ nodes @ d_turn.T)
        on_strips = self.strips.face_weights @ forces
        lift = _Lift(np.diff(trace, axis=0), on_strips @ turn.T)
        d_force = self.strips.face_weights @ d_forces @ turn.T + d_alpha * (on_strips @ d_turn.T)
        d_load = np.sum(lift.slopes[0] * np.diff(d_trace, axis=0) + lift.slopes[1] * d_force, axis=1)
        trace_bar, load_bar = self._drag_gradients(trace, lift.per_length)
        return d_load, np.sum(trace_bar * d_trace) + load_bar @ d_load

    def vjp(
        self, forces: np.ndarray, nodes: np.ndarray, alpha: float, load_bar: np.ndarray, drag_bar: float
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Apply the transpose of `jvp` to derivatives with respect to the span load, shape (n,), and to the drag."""
        # Returns derivatives with respect to the forces, shape (n_faces, 3), the nodes, shape (n_nodes, 3), and the
        # angle (1/rad).
        trace, turn = _trace(self.strips, nodes, alpha)
        on_strips, at_stations = self.strips.face_weights @ forces, self.strips.trailing @ nodes
        lift = _Lift(np.diff(trace, axis=0), on_strips @ turn.T)
        trace_gradient, load_gradient = self._drag_gradients(trace, lift.per_length)
        widths_bar, force_bar = (drag_bar * load_gradient + load_bar)[:, None] * lift.slopes
        trace_bar = drag_bar * trace_gradient
        trace_bar[1:] += widths_bar
        trace_bar[:-1] -= widths_bar
        turn_bar = force_bar.T @ on_strips + trace_bar.T @ at_stations
        alpha_bar = np.sum(turn_bar * _turn_slope(self.strips.axes, alpha))
        return self.strips.face_weights.T @ (force_bar @ turn), self.strips.trailing.T @ (trace_bar @ turn), alpha_bar

    def least(
        self,
        nodes: np.ndarray,  # (n_nodes, 3), nodes of the grid (m), from which the wake trails
        alpha: float,  # angle of attack (rad)
        lift: float,  # lift of the modelled part, divided by the dynamic pressure (m^2), like the drag
    ) -> float:
        """Minimum induced drag over all loads along the span; the load is elliptical if the wake is plane (Munk)."""
        if not self.loads.any():  # from wall to wall
            return 0.0
        points = self.points @ _trace(self.strips, nodes, alpha)[0]
        return self._factor * least_drag(points, lift / self._factor, self.strips.is_symmetric, self.places).drag

    @property
    def _factor(self) -> float:
        """Drag divided by the dynamic pressure, relative to the drag of the whole wake at unit speed and density."""
        return 1.0 if self.strips.is_symmetric else 2.0

    def _wake(self, trace: np.ndarray, load: np.ndarray) -> Wake:
        """The wake at unit speed."""
        return Wake(self.points @ trace, 0.5 * (self.loads @ load), self.strips.is_symmetric, self.places)

    def _drag_gradients(self, trace: np.ndarray, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the drag with respect to the trace, shape (n + 1, 2), and to the load, shape (n,)."""
        points_bar, circulations_bar = self._wake(trace, load).drag_gradients()
        return self._factor * self.points.T @ points_bar, 0.5 * self._factor * circulations_bar @ self.loads


@dataclass(frozen=True, eq=False)
class _Lift:
    """Traces of strips and the forces on them in the Trefftz plane, both of shape (n, 2)."""

    widths: np.ndarray
    forces: np.ndarray

    @property
    def per_length(self) -> np.ndarray:
        """Force across the trace per length of it, shape (n,)."""
        return cross_2d(self.widths, self.forces) / self._squares

    @property
    def slopes(self) -> np.ndarray:
        """Derivatives of this with respect to the trace and to the force, shape (2, n, 2)."""
        up = np.stack([-self.widths[:, 1], self.widths[:, 0]], axis=1)
        turned = np.stack([self.forces[:, 1], -self.forces[:, 0]], axis=1)
        return np.stack([turned - 2.0 * self.per_length[:, None] * self.widths, up]) / self._squares[:, None]

    @property
    def _squares(self) -> np.ndarray:
        return np.sum(self.widths**2, axis=1)


def _trace(strips: SpanStrips, nodes: np.ndarray, alpha: float) -> tuple[np.ndarray, np.ndarray]:
    """Trace of the trailing edge in the Trefftz plane, shape (n + 1, 2), and the axes of that plane, shape (2, 3)."""
    turn = np.stack([strips.axes[1] + 0.0 * alpha, stream_axes(alpha, strips.axes)[1]])
    return strips.trailing @ nodes @ turn.T, turn


def _turn_slope(axes: np.ndarray, alpha: float) -> np.ndarray:
    """Derivative of the axes of the Trefftz plane with respect to the angle."""
    return np.stack([np.zeros(3), -stream_axes(alpha, axes)[0]])


def _sines(strips: SpanStrips) -> np.ndarray:
    """Multiples of the angle; the load of a symmetric wing only has the odd ones."""
    step = 2 if strips.is_symmetric else 1
    return np.arange(1, 1 + step * min(2 * HARMONICS // step, strips.n_strips), step)


def _fit(angles: np.ndarray, sines: np.ndarray) -> np.ndarray:
    """Matrix, shape (n_sines, n_strips), from loads of strips between angles to amplitudes of the sines."""
    widths, area = np.diff(-np.cos(angles)), 0.5 * angles[-1]
    means = np.stack([np.diff(_moment(angles, n)) / widths for n in sines], axis=1)
    first = widths / area
    roots = np.sqrt(widths)[:, None]
    others = np.linalg.pinv(roots * means[:, 1:]) @ (roots * (np.eye(len(widths)) - np.outer(means[:, 0], first)))
    return np.vstack([first, others])


def _moment(angles: np.ndarray, n: int) -> np.ndarray:
    """Integral of sin(n t) sin(t) from 0 to angles."""
    if n == 1:
        return 0.5 * angles - 0.25 * np.sin(2.0 * angles)
    return 0.5 * (np.sin((n - 1) * angles) / (n - 1) - np.sin((n + 1) * angles) / (n + 1))


_MIRROR = np.array([-1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Wake(OneLine):
    """Vortices that trail from the strips of a wing, from the left tip to the right one or to the symmetry plane.

    Parameters
    ----------
    points : ndarray, shape (n + 1, 2)
        Their intersections with the Trefftz plane: coordinates y, to the right, and z, up (m). Real or complex.
    circulations : ndarray, shape (n,)
        Circulations of the strips between them (m^2/s), positive if they lift. Real or complex.
    is_symmetric : bool
        Whether the right half is the mirror image about y = 0, and counts as well.
    places : float or ndarray, shape (n,)
        Points of the downwash, as fractions of the way from one vortex to the next.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.flow import Wake
    >>> y = np.linspace(-1.0, 0.0, 5)  # the left half of a flat wing of span 2
    >>> wake = Wake(np.column_stack([y, 0.0 * y]), np.sqrt(1.0 - (y[:-1] + 0.125) ** 2))
    >>> bool(wake.drag > 0.0)
    True
    """

    points: np.ndarray
    circulations: np.ndarray
    is_symmetric: bool = True
    places: float | np.ndarray = 0.5

    @property
    def lift(self) -> float:
        """Lift divided by density and speed (m^3/s)."""
        return self._halves * (self.circulations @ self._traces[:, 0])

    @property
    def drag(self) -> float:
        """Induced drag divided by density (m^4/s^2)."""
        return self.circulations @ self.influence @ self.circulations

    @cached_property
    def influence(self) -> np.ndarray:
        """Matrix of the drag as a quadratic form of the circulations, shape (n, n)."""
        kernel = sum(sign * _dot(arms, self._traces) / _dot(arms, arms) for sign, _, arms in self._images)
        return self._factor * (kernel[:, :-1] - kernel[:, 1:])

    def lift_gradients(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the lift with respect to the points, shape (n + 1, 2), and to the circulations, shape (n,)."""
        points_bar = np.zeros_like(self.points)
        points_bar[:, 0] = -self._halves * self._strengths
        return points_bar, self._halves * self._traces[:, 0]

    def drag_gradients(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the drag with respect to the points, shape (n + 1, 2), and to the circulations, shape (n,)."""
        weights = self._factor * np.outer(self.circulations, self._strengths)[:, :, None]
        points_bar = np.zeros_like(self.points)
        for sign, mirror, arms in self._images:
            traces, square = self._traces[:, None], _dot(arms, arms)[..., None]
            arms_bar = sign * weights * (traces - 2.0 * _dot(arms, traces)[..., None] / square * arms) / square
            place_bar, traces_bar = arms_bar.sum(axis=1), (sign * weights * arms / square).sum(axis=1)
            points_bar[:-1] += (1.0 - self._parts) * place_bar - traces_bar
            points_bar[1:] += self._parts * place_bar + traces_bar
            points_bar -= mirror * arms_bar.sum(axis=0)
        return points_bar, (self.influence + self.influence.T) @ self.circulations

    @property
    def _halves(self) -> float:
        return 2.0 if self.is_symmetric else 1.0

    @property
    def _factor(self) -> float:
        return self._halves / (4.0 * np.pi)

    @property
    def _traces(self) -> np.ndarray:
        return np.diff(self.points, axis=0)

    @property
    def _parts(self) -> np.ndarray:
        """`places` as a factor of points."""
        return np.asarray(self.places)[..., None]

    @property
    def _strengths(self) -> np.ndarray:
        """Strength of every trailing vortex, shape (n + 1,)."""
        return np.diff(self.circulations, prepend=0.0, append=0.0)

    @cached_property
    def _images(self) -> list[tuple[float, np.ndarray, np.ndarray]]:
        """Sign and mirror of the vortices and of their images, and the arms (n, n + 1, 2) from them to the places."""
        places = (1.0 - self._parts) * self.points[:-1] + self._parts * self.points[1:]
        images = [(1.0, np.ones(2)), (-1.0, _MIRROR)] if self.is_symmetric else [(1.0, np.ones(2))]
        return [(sign, mirror, places[:, None] - mirror * self.points) for sign, mirror in images]


def least_drag(points: np.ndarray, lift: float, is_symmetric: bool = True, places: float | np.ndarray = 0.5) -> Wake:
    """Find the circulations of minimum induced drag for a lift and a trace of the wake (Munk).

    Parameters
    ----------
    points : ndarray, shape (n + 1, 2)
        Intersections of the vortices with the Trefftz plane (m), see `Wake`.
    lift : float
        Lift divided by density and speed (m^3/s).
    is_symmetric, places : bool, and float or ndarray of shape (n,)
        As in `Wake`.

    Returns
    -------
    Wake
        The optimum: the drag is stationary where the downwash divided by the trace's slope is the same along the span.

    Notes
    -----
    With n strips of equal width across a whole flat wing of span b the minimum drag divided by density is
    ``2 lift^2 / (pi b^2) n / (n + 1)``: the discrete span efficiency is ``1 + 1/n``, not 1.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.flow import least_drag
    >>> y = np.linspace(-1.0, 0.0, 6)  # 10 strips across a flat wing of span 2
    >>> best = least_drag(np.column_stack([y, 0.0 * y]), lift=1.0)
    >>> bool(np.isclose(best.drag, 2.0 / (np.pi * 2.0**2) * 10 / 11))
    True
    """
    still = Wake(points, np.zeros(len(points) - 1), is_symmetric, places)
    _, lift_gradient = still.lift_gradients()
    circulations = np.linalg.solve(still.influence + still.influence.T, lift_gradient)
    return Wake(points, lift / (lift_gradient @ circulations) * circulations, is_symmetric, places)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products of arms (n, m, 2) with arms, or with traces (n, 2) or (n, 1, 2)."""
    return np.sum(a * (b if b.ndim == 3 else b[:, None]), axis=-1)
