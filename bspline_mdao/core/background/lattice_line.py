"""Knots of one direction of a lattice, in metres, and the integrals of its basis functions.

The spans are even around the body and grow from there to the ends of the mesh's box. Derivatives are taken by the width
of the span that they are in,

    G_m,ij = sum over spans of h^(2 m - 1) integral of B_i^(m) B_j^(m) dx ,    m = 0, 1, 2,

so that an energy made of them does not depend on the size of anything, and weighs a wide span as much as a narrow one.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse import csr_array

from ..splines.knots import ConstantKnots

__all__ = ["LatticeLine"]

DEGREE = 3
"""Cubic: curvatures, whose squares the energy sums, are continuous."""

SHORTEST = 0.5
"""An end of the box that is nearer to the even spans than this part of one is met by making the last one wider."""


@dataclass(frozen=True, eq=False)
class LatticeLine:
    """One direction of a lattice."""

    breaks: np.ndarray  # (n_spans + 1,), ends of the spans, ascending (m)
    # whether all control points move alike: across a section, whose two planes are the ends of a single span
    is_tied: bool = False

    @classmethod
    def between(
        cls,
        box: tuple[float, float],  # ends of the mesh (m)
        even: tuple[float, float],  # ends of the part with even spans, within the box (m)
        spacing: float,  # width of these, at most (m)
        growth: float,  # ratio of the widths of neighbouring spans beyond
    ) -> LatticeLine:
        """Cut a direction into spans."""
        n_even = max(1, int(np.ceil((even[1] - even[0]) / spacing - 1e-9)))
        inner = np.linspace(even[0], even[1], n_even + 1)
        width = (even[1] - even[0]) / n_even
        low, high = _growing(even[0] - box[0], width, growth), _growing(box[1] - even[1], width, growth)
        breaks = np.concatenate([even[0] - low[::-1], inner, even[1] + high])
        breaks[0], breaks[-1] = box
        return cls(breaks)

    @property
    def degree(self) -> int:
        """Degree of the basis: linear across a section."""
        return 1 if self.is_tied else DEGREE

    @property
    def length(self) -> float:
        """Length of the whole (m)."""
        return float(self.breaks[-1] - self.breaks[0])

    @property
    def n_control(self) -> int:
        """Number of control points."""
        return len(self.breaks) - 1 + self.degree

    @property
    def n_unknowns(self) -> int:
        """Number of control points that move by themselves."""
        return 1 if self.is_tied else self.n_control

    @cached_property
    def coordinate_knots(self) -> np.ndarray:
        """Open knots (m)."""
        ends = np.ones(self.degree)
        return np.concatenate([self.breaks[0] * ends, self.breaks, self.breaks[-1] * ends])

    @property
    def knots(self) -> ConstantKnots:
        """Knots from 0 to 1."""
        knots = (self.coordinate_knots - self.breaks[0]) / self.length
        knots[-self.degree - 1 :] = 1.0
        return ConstantKnots(knots, self.degree + 1)

    @property
    def control_coordinates(self) -> np.ndarray:
        """Greville abscissae (m), shape (n_control,): control points there give the identity."""
        p = self.degree
        return np.stack([self.coordinate_knots[k : k + self.n_control] for k in range(1, p + 1)]).mean(axis=0)

    def parameters(self, coordinates: np.ndarray) -> np.ndarray:
        """Parameters of coordinates (m), from 0 to 1."""
        return np.clip((coordinates - self.breaks[0]) / self.length, 0.0, 1.0)

    def spans(self, coordinates: np.ndarray) -> np.ndarray:
        """Number of the span that each coordinate (m) is in."""
        return np.clip(np.searchsorted(self.breaks, coordinates, side="right") - 1, 0, len(self.breaks) - 2)

    @cached_property
    def gram(self) -> tuple[csr_array, csr_array, csr_array]:
        """Matrices G_0, G_1 and G_2 of the unknowns, each of shape (n_unknowns, n_unknowns)."""
        if self.is_tied:
            return csr_array(np.ones((1, 1))), csr_array((1, 1)), csr_array((1, 1))
        places, weights = np.polynomial.legendre.leggauss(self.degree + 1)  # exact for products of two basis functions
        widths = np.diff(self.breaks)
        points = (self.breaks[:-1, None] + 0.5 * widths[:, None] * (1.0 + places)).ravel()
        weights = (0.5 * widths[:, None] * weights).ravel()
        local, found = np.repeat(widths, len(places)), []
        for m in range(3):
            basis = BSpline(self.coordinate_knots, np.eye(self.n_control), self.degree)(points, nu=m)
            found.append(csr_array(basis.T @ ((weights * local ** (2 * m - 1))[:, None] * basis)))
        return found[0], found[1], found[2]


def _growing(length: float, width: float, growth: float) -> np.ndarray:
    """Distances of the ends of growing spans that fill a length, ascending; none where it is too short for one."""
    if length < SHORTEST * width:
        return np.zeros(0)
    n = max(1, int(np.ceil(np.log1p(length / width * (growth - 1.0) / growth) / np.log(growth))))
    ends = np.cumsum(growth ** np.arange(1, n + 1))
    return length / ends[-1] * ends
