"""Loads of the sections of a wing: chord, lift, drag and moment of every strip.

Theory: ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from .span_strips import SpanStrips

__all__ = ["SECTION_LOADS", "SectionLoads"]

SECTION_LOADS = ("strip_span", "strip_chord", "strip_cl", "strip_cd", "strip_cm")
"""Numbers per strip."""

_N = 19
"""Values of a strip: force, moment, two points of the leading and two of the trailing edge, and the angle."""


@dataclass(frozen=True, eq=False)
class SectionLoads:
    """Place along the span (m), chord (m), and coefficients of lift, drag and moment of every strip."""

    # Lift is as in the span load: at right angles to the stream and to the strip's trace in the plane across the
    # stream; drag is along the stream; both are divided by the chord and the width of the trace. The moment is about
    # the quarter chord, positive if it turns the nose up, divided by the square of the chord. The chord goes from the
    # middle of the strip's leading edge to the middle of its trailing edge; the points are those that were foremost and
    # last on the baseline.

    strips: SpanStrips  # the n strips of the wing
    points: csr_array  # (n_forces, n_nodes), weights of the nodes of the grid in the points of application

    outputs = SECTION_LOADS

    def evaluate(
        self,
        forces: np.ndarray,  # (n_forces, 3), forces divided by the dynamic pressure (m^2)
        nodes: np.ndarray,  # (n_nodes, 3), nodes of the grid (m)
        alpha: float,  # angle of attack (rad)
    ) -> dict[str, np.ndarray]:
        """Compute them by name, each of shape (n,); real or complex."""
        return self._named(_Strip(self._numbers(forces, nodes, alpha)).values)

    def jvp(
        self,
        forces: np.ndarray,
        nodes: np.ndarray,
        alpha: float,
        d_forces: np.ndarray,
        d_nodes: np.ndarray,
        d_alpha: float,
    ) -> dict[str, np.ndarray]:
        """Derivatives of `evaluate` along a direction in all of its arguments."""
        weights = self.strips.face_weights
        forces, nodes, d_forces, d_nodes = map(self._turned, (forces, nodes, d_forces, d_nodes))
        arms, d_arms = self.points @ nodes, self.points @ d_nodes
        d_moments = weights @ (np.cross(d_arms, forces) + np.cross(arms, d_forces))
        change = self._joined(weights @ d_forces, d_moments, d_nodes, d_alpha)
        strip = _Strip(self._joined(weights @ forces, weights @ np.cross(arms, forces), nodes, alpha))
        return self._named(strip.slopes(change))

    def vjp(
        self, forces: np.ndarray, nodes: np.ndarray, alpha: float, bars: dict
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Apply the transpose of `jvp` to derivatives with respect to some of the outputs, by name."""
        # Returns derivatives with respect to the forces, shape (n_forces, 3), the nodes, shape (n_nodes, 3), and the
        # angle (1/rad).
        strip, n = _Strip(self._numbers(forces, nodes, alpha)), self.strips.n_strips
        jacobian = strip.slopes(np.broadcast_to(np.eye(_N)[:, None], (_N, n, _N)))  # (values, numbers, strips)
        value_bars = np.stack([bars.get(name, 0.0) * np.ones(n) for name in SECTION_LOADS])
        value_bars[0] *= self._side
        bar = np.einsum("vns,vs->sn", jacobian, value_bars)
        on_faces = self.strips.face_weights.T @ bar[:, :6]
        arms, turned = self.points @ self._turned(nodes), self._turned(forces)
        forces_bar = on_faces[:, :3] + np.cross(on_faces[:, 3:], arms)
        nodes_bar = self.points.T @ np.cross(turned, on_faces[:, 3:])
        for edge, first in ((self.strips.leading, 6), (self.strips.trailing, 12)):
            stations_bar = np.zeros((n + 1, 3))
            stations_bar[:-1] += bar[:, first : first + 3]
            stations_bar[1:] += bar[:, first + 3 : first + 6]
            nodes_bar += edge.T @ stations_bar
        return forces_bar @ self.strips.axes, nodes_bar @ self.strips.axes, bar[:, 18].sum()

    def _numbers(self, forces: np.ndarray, nodes: np.ndarray, alpha: float) -> np.ndarray:
        """The values from which the loads of each strip are computed, shape (n, 19)."""
        forces, nodes = self._turned(forces), self._turned(nodes)
        weights = self.strips.face_weights
        return self._joined(weights @ forces, weights @ np.cross(self.points @ nodes, forces), nodes, alpha)

    def _joined(self, on_strips: np.ndarray, moments: np.ndarray, nodes: np.ndarray, alpha: float) -> np.ndarray:
        leading, trailing = self.strips.leading @ nodes, self.strips.trailing @ nodes
        angle = np.full((len(on_strips), 1), alpha)
        return np.hstack([on_strips, moments, leading[:-1], leading[1:], trailing[:-1], trailing[1:], angle])

    def _turned(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors of the grid in the axes downstream, along the span, and up."""
        return vectors @ self.strips.axes.T

    @property
    def _side(self) -> float:
        """Sign of the span: a half wing is on the negative side."""
        return -1.0 if self.strips.is_symmetric else 1.0

    def _named(self, values: Iterable[np.ndarray]) -> dict[str, np.ndarray]:
        named = dict(zip(SECTION_LOADS, values))
        return named | {"strip_span": self._side * named["strip_span"]}


class _Strip:
    """Loads of strips and their slopes, in the axes of the stream; inputs have shape (n, 19)."""

    def __init__(self, numbers: np.ndarray):
        alpha = numbers[:, 18]
        self.cosine, self.sine = np.cos(alpha), np.sin(alpha)
        self.vectors = self._to_stream(numbers)
        self.middle = 0.5 * (numbers[:, 13] + numbers[:, 16])
        force, moment, leading, trailing = self._reduced(self.vectors)
        self.force, self.moment = force, moment
        self.chord_line, self.quarter = trailing - leading, 0.75 * leading + 0.25 * trailing
        self.trace = self.vectors[5, 1:] - self.vectors[4, 1:]
        self.chord = np.sqrt(np.sum(self.chord_line**2, axis=0))
        self.width = np.sqrt(np.sum(self.trace**2, axis=0))
        self.lift = (self.trace[0] * force[2] - self.trace[1] * force[1]) / self.width
        self.pitching = np.sum(self._across(self.quarter, force, moment) * self.trace, axis=0) / self.width

    @property
    def values(self) -> np.ndarray:
        """Span, chord, and the coefficients of lift, drag and moment, shape (5, n)."""
        area = self.width * self.chord
        return np.stack(
            [self.middle, self.chord, self.lift / area, self.force[0] / area, self.pitching / (area * self.chord)]
        )

    def slopes(self, change: np.ndarray) -> np.ndarray:
        """Change of the values, shape (5, ..., n), with a change of the inputs, shape (..., n, 19)."""
        turned = np.stack([self.vectors[:, 2], 0.0 * self.vectors[:, 1], -self.vectors[:, 0]], axis=1)
        d_vectors = self._to_stream(change) + _spread(turned, change) * change[..., 18]
        d_force, d_moment, d_leading, d_trailing = self._reduced(d_vectors)
        force, moment, quarter = (_spread(vector, change) for vector in (self.force, self.moment, self.quarter))
        trace, line = _spread(self.trace, change), _spread(self.chord_line, change)
        d_trace, d_quarter = d_vectors[5, 1:] - d_vectors[4, 1:], 0.75 * d_leading + 0.25 * d_trailing
        d_chord = np.sum(line * (d_trailing - d_leading), axis=0) / self.chord
        d_width = np.sum(trace * d_trace, axis=0) / self.width
        d_lift = d_trace[0] * force[2] + trace[0] * d_force[2] - d_trace[1] * force[1] - trace[1] * d_force[1]
        d_lift = (d_lift - self.lift * d_width) / self.width
        across = self._across(quarter, force, moment)
        d_across = self._across(quarter, d_force, d_moment) + self._across(d_quarter, force, 0.0 * d_moment)
        d_pitching = np.sum(d_across * trace + across * d_trace, axis=0)
        d_pitching = (d_pitching - self.pitching * d_width) / self.width
        area, d_area = self.width * self.chord, d_width * self.chord + self.width * d_chord
        _, _, cl, cd, cm = self.values
        return np.stack(
            [
                0.5 * (change[..., 13] + change[..., 16]),
                d_chord,
                (d_lift - cl * d_area) / area,
                (d_force[0] - cd * d_area) / area,
                (d_pitching - cm * (d_area * self.chord + area * d_chord)) / (area * self.chord),
            ]
        )

    def _to_stream(self, numbers: np.ndarray) -> np.ndarray:
        """Vectors among the inputs in the axes of the stream, shape (6, 3, ..., n)."""
        x, y, z = (np.moveaxis(numbers[..., axis:18:3], -1, 0) for axis in range(3))
        return np.stack([x * self.cosine + z * self.sine, y, z * self.cosine - x * self.sine], axis=1)

    @staticmethod
    def _reduced(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Force, moment, and middles of the edges, each of shape (3, ..., n)."""
        return vectors[0], vectors[1], 0.5 * (vectors[2] + vectors[3]), 0.5 * (vectors[4] + vectors[5])

    @staticmethod
    def _across(point: np.ndarray, force: np.ndarray, moment: np.ndarray) -> np.ndarray:
        """Moment about a point, along the span and up, shape (2, ..., n)."""
        about_span = moment[1] - (point[2] * force[0] - point[0] * force[2])
        return np.stack([about_span, moment[2] - (point[0] * force[1] - point[1] * force[0])])


def _spread(vector: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Vectors of strips, shape (..., n), for changes of several kinds."""
    extra = (1,) * (change.ndim - 2)
    return vector.reshape(*vector.shape[:-1], *extra, vector.shape[-1])
