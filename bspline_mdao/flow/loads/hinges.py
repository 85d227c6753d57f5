"""Control surfaces of a wing: their parts of the wall, and the axes of their hinge moments.

Theory: ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ...base.display import OneLine
from ...core.design.hinge import Hinge
from ...errors import InputError
from .axis_moments import AxisMoment, HingeLoads
from .span_strips import SpanStrips

__all__ = ["HingeMoment"]


@dataclass(frozen=True, eq=False)
class HingeMoment(OneLine):
    """A hinge moment: of the wall within a box along chord and span, or of some faces of it, about an axis.

    A quad of the wall that lies partly in the box counts in part. If no axis is given, it is the foremost line of the
    box, halfway between the sides of the wing as long as it lies between leading and trailing edge; it moves with
    these, and a positive moment turns the trailing edge down.

    Parameters
    ----------
    name : str
        The output is ``CM_`` and this name.
    chord : tuple of float
        Ends of the box along the chord: 0 at the leading edge, 1 at the trailing edge.
    span : tuple of float
        Ends of the box along the span: 0 at span 0, 1 at the tip; negative on the negative side of a whole wing.
    axis : sequence of two points or Hinge, optional
        Two points of the axis (m), in the axes of the grid; it is fixed, and a positive moment follows the right-hand
        rule from the first to the second. For a `bspline_mdao.design.Hinge` with a name, design variables place the
        axis: its name is an input of the flow, as it is an output of `GridMovement`.
    reference_area, reference_chord : float, optional
        Area (m^2) and chord (m) for the moment coefficient; by default the flow's.
    patches : str, sequence of str or SurfaceGrid, optional
        Patches that belong to it, by name or pattern (``"flap*"``), or the surface; all walls by default.

    Examples
    --------
    >>> aileron = HingeMoment("aileron", chord=(0.75, 1.0), span=(0.6, 0.9))
    >>> aileron.output
    'CM_aileron'
    """

    name: str
    chord: tuple[float, float] = (0.0, 1.0)
    span: tuple[float, float] = (-1.0, 1.0)
    axis: Sequence | Hinge | None = None
    reference_area: float | None = None
    reference_chord: float | None = None
    patches: Any = None

    def __post_init__(self) -> None:
        if not self.name.isidentifier():
            raise InputError(f"hinge '{self.name}': give a name of letters, digits and _, such as 'aileron'")
        for what in ("chord", "span"):
            ends = getattr(self, what)
            if np.shape(ends) != (2,) or not ends[0] < ends[1]:
                raise InputError(f"hinge {self.name}: {what} {ends}; give two ends, the lower one first")
        if isinstance(self.axis, Hinge):
            if not self.axis.name:
                raise InputError(f"hinge {self.name}: its axis is a Hinge without a name; give it one")
        elif self.axis is not None and (
            np.shape(self.axis) != (2, 3) or not np.isfinite(self.axis).all() or np.ptp(self.axis, axis=0).max() == 0.0
        ):
            raise InputError(f"hinge {self.name}: axis {self.axis}; give two different points x, y, z")
        for what in ("reference_area", "reference_chord"):
            value = getattr(self, what)
            if value is not None and not 0.0 < value < np.inf:
                raise InputError(f"hinge {self.name}: {what} {value}; give a positive number")

    @property
    def output(self) -> str:
        """Name of the coefficient."""
        return f"CM_{self.name}"

    @property
    def loads(self) -> str:
        """Name of force and moment, from which the coefficient about a `Hinge` is computed."""
        return f"loads_{self.name}"

    def volume(self, references: tuple[float, float]) -> float:
        """Divisor of its moment (m^3), from reference area (m^2) and chord (m) of the flow."""
        return (self.reference_area or references[0]) * (self.reference_chord or references[1])

    def moment(
        self,
        points: csr_array,
        references: tuple[float, float],
        strips: SpanStrips,
        nodes: np.ndarray,
        faces: np.ndarray,
        is_within: np.ndarray,
    ) -> AxisMoment | HingeLoads:
        """Determine on the baseline which forces count, and about which axis.

        Parameters
        ----------
        points : csr_array, shape (n_faces, n_nodes)
            Weights of the nodes in the points of application.
        references : tuple of float
            Reference area (m^2) and chord (m) of the flow.
        strips : SpanStrips
            Provide leading and trailing edge.
        nodes : ndarray, shape (n_nodes, 3)
            Baseline nodes (m).
        faces : ndarray of int, shape (n_faces, 4)
            Corners of the wall faces.
        is_within : ndarray of bool, shape (n_faces,)
            Whether they belong to the patches.

        Raises
        ------
        InputError
            If no face is in the box.
        """
        edges = _Edges.of(strips, nodes)
        corners = edges.places(nodes)[faces]
        weights = _covered(corners[..., 0], self.span) * _covered(corners[..., 1], self.chord) * is_within
        if not weights.any():
            raise InputError(
                f"hinge {self.name}: none of its patches lies in chord {self.chord} and span {self.span}; widen them"
            )
        volume = self.volume(references)
        if isinstance(self.axis, Hinge):
            return HingeLoads(self.loads, points, weights, self.axis.points[0])
        if self.axis is not None:
            return AxisMoment.about_fixed(points, weights, self.axis, volume)
        ends = edges.line(self.chord[0], np.clip(self.span, edges.parts[0], edges.parts[-1]))
        if np.linalg.det(strips.axes) * edges.side < 0.0:
            ends = ends[::-1]
        return AxisMoment(points, weights, csr_array(ends), np.zeros((2, 3)), volume)


@dataclass(frozen=True, eq=False)
class _Edges:
    """Leading and trailing edge of the baseline at the stations, by fractions of the span in ascending order."""

    strips: SpanStrips
    order: np.ndarray
    parts: np.ndarray
    leading: np.ndarray
    trailing: np.ndarray
    side: float
    size: float

    @classmethod
    def of(cls, strips: SpanStrips, nodes: np.ndarray) -> _Edges:
        side = -1.0 if strips.is_symmetric else 1.0
        leading, trailing = strips.leading @ nodes @ strips.axes.T, strips.trailing @ nodes @ strips.axes.T
        span = 0.5 * side * (leading[:, 1] + trailing[:, 1])
        order, size = np.argsort(span), np.abs(span).max()
        return cls(strips, order, span[order] / size, leading[order, 0], trailing[order, 0], side, size)

    def places(self, nodes: np.ndarray) -> np.ndarray:
        """Fractions of the span and of the chord of nodes, shape (n_nodes, 2)."""
        x, y, _ = (nodes @ self.strips.axes.T).T
        part = self.side * y / self.size
        first, last = (np.interp(part, self.parts, edge) for edge in (self.leading, self.trailing))
        return np.stack([part, (x - first) / np.maximum(last - first, np.finfo(float).tiny)], axis=1)

    def line(self, chord: float, span: np.ndarray) -> np.ndarray:
        """Weights of the nodes in points at a fraction of the chord and at fractions of the span, (2, n_nodes)."""
        at = np.stack([np.interp(span, self.parts, unit) for unit in np.eye(len(self.order))], axis=1)
        between = np.empty_like(at)
        between[:, self.order] = at
        return (1.0 - chord) * (between @ self.strips.leading) + chord * (between @ self.strips.trailing)


_FLAT = 1e-9
"""Extent, relative to span or chord, below which a quad has none."""


def _covered(places: np.ndarray, ends: Sequence[float]) -> np.ndarray:
    """Fraction of the extent of every quad, corners of shape (n, 4), between two ends."""
    low, high = places.min(axis=1), places.max(axis=1)
    extent = high - low
    inside = np.minimum(high, ends[1] + _FLAT) - np.maximum(low, ends[0] - _FLAT)
    return np.where(extent < _FLAT, inside >= 0.0, np.clip(inside / np.maximum(extent, _FLAT), 0.0, 1.0))
