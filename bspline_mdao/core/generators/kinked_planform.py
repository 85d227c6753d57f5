"""Planforms of several panels: adjacent trapezoids whose edges have kinks between them.

Theory: ``docs/theory/generators.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.checks import as_numbers
from ...base.display import OneLine
from ...errors import InputError

__all__ = ["KinkedPlanform"]


@dataclass(frozen=True, eq=False)
class KinkedPlanform(OneLine):
    """One half of a wing of straight panels, with its root in the symmetry plane z = 0.

    Parameters
    ----------
    stations : array_like, shape (n, 3)
        Span position, coordinate x of the leading edge and chord (m), from the root at 0 to the tip, at every kink.

    Raises
    ------
    InputError
        If stations do not ascend from 0, or chords are not positive.

    Examples
    --------
    >>> from bspline_mdao.generators import KinkedPlanform
    >>> planform = KinkedPlanform([[0.0, 0.0, 1.6], [1.2, 0.9, 1.0], [4.0, 1.9, 0.5]])
    >>> planform.kinks, round(planform.aspect_ratio, 2), round(planform.trailing_edge_sweep, 1)
    ((1.2,), 8.74, 10.1)
    """

    stations: Sequence[Sequence[float]] | np.ndarray

    def __post_init__(self) -> None:
        stations = as_numbers(self.stations, "planform: stations")
        object.__setattr__(self, "stations", stations)
        if stations.ndim != 2 or stations.shape[1] != 3 or len(stations) < 2 or not np.isfinite(stations).all():
            raise InputError(
                f"planform: stations of shape {stations.shape}; give two or more of finite span, leading edge and chord"
            )
        span, _, chord = stations.T
        if span[0] != 0.0 or not (np.diff(span) > 0.0).all() or not (chord > 0.0).all():
            raise InputError(
                f"planform: stations at spans {span.tolist()} with chords {chord.tolist()}; give spans ascending from "
                f"0, and positive chords"
            )

    @property
    def kinks(self) -> tuple[float, ...]:
        """Span positions between the panels (m)."""
        return tuple(self._columns[0][1:-1].tolist())

    @property
    def root_chord(self) -> float:
        """Chord in the symmetry plane (m)."""
        return float(self._columns[2][0])

    @property
    def tip_chord(self) -> float:
        """Chord at the tip (m)."""
        return float(self._columns[2][-1])

    @property
    def semi_span(self) -> float:
        """Distance from the symmetry plane to the tip (m)."""
        return float(self._columns[0][-1])

    @property
    def aspect_ratio(self) -> float:
        """Aspect ratio of the whole wing."""
        span, _, chord = self._columns
        return 2.0 * self.semi_span**2 / float(np.trapezoid(chord, span))

    @property
    def trailing_edge_sweep(self) -> float:
        """Sweep of the trailing edge of the last panel (deg)."""
        return float(np.degrees(np.arctan(self.slope_at_tip(1.0))))

    def x(self, fraction: np.ndarray | float, z: np.ndarray | float) -> Any:
        """Coordinate x (m) of a chord fraction, 0 the leading and 1 the trailing edge, at span position z."""
        span, leading, chord = self._columns
        return np.interp(z, span, leading) + fraction * np.interp(z, span, chord)

    def slope_at_tip(self, fraction: np.ndarray | float) -> Any:
        """dx/dz of a line of constant chord fraction in the last panel."""
        _, leading, chord = self._columns
        length = np.diff(self._columns[0])[-1]
        return (np.diff(leading)[-1] + fraction * np.diff(chord)[-1]) / length

    @property
    def _columns(self) -> np.ndarray:
        """Span positions, leading edges and chords, shape (3, n)."""
        return np.asarray(self.stations).T
