"""Trapezoidal wing planforms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError

__all__ = ["Planform"]


@dataclass(frozen=True)
class Planform:
    """One half of a trapezoidal wing, its root in the symmetry plane z = 0 and its leading edge there at x = 0.

    Parameters
    ----------
    root_chord : float
        Chord in the symmetry plane (m).
    semi_span : float
        Distance from the symmetry plane to the tip (m).
    taper : float
        Tip chord over root chord.
    leading_edge_sweep : float
        Sweep of the leading edge (deg), positive aft.
    """

    root_chord: float = 1.0
    semi_span: float = 2.0
    taper: float = 1.0
    leading_edge_sweep: float = 0.0

    def __post_init__(self):
        is_positive = self.root_chord > 0.0 and self.semi_span > 0.0 and self.taper > 0.0
        if not (is_positive and abs(self.leading_edge_sweep) < 80.0):
            raise InputError(
                f"planform: root chord {self.root_chord:g}, semi-span {self.semi_span:g}, taper {self.taper:g} must be "
                f"positive and the sweep {self.leading_edge_sweep:g} deg below 80"
            )

    @classmethod
    def from_sweeps(cls, root_chord: float, semi_span: float, leading: float, trailing: float) -> Planform:
        """Make the planform from the sweeps (deg) of both edges; the taper follows."""
        narrowing = semi_span * (np.tan(np.radians(leading)) - np.tan(np.radians(trailing)))
        return cls(root_chord, semi_span, 1.0 - narrowing / root_chord, leading)

    @property
    def tip_chord(self) -> float:
        """Chord at the tip (m)."""
        return self.taper * self.root_chord

    @property
    def aspect_ratio(self) -> float:
        """Aspect ratio of the whole wing."""
        return 4.0 * self.semi_span / (self.root_chord + self.tip_chord)

    @property
    def trailing_edge_sweep(self) -> float:
        """Sweep of the trailing edge (deg)."""
        return float(np.degrees(np.arctan(self._slope(1.0))))

    def x(self, fraction, z):
        """Coordinate x (m) of a chord fraction, 0 the leading and 1 the trailing edge, at span position z."""
        return fraction * self.root_chord + self._slope(fraction) * z

    def _slope(self, fraction):
        """dx/dz of a line of constant chord fraction."""
        narrowing = (1.0 - self.taper) * self.root_chord / self.semi_span
        return np.tan(np.radians(self.leading_edge_sweep)) - fraction * narrowing
