"""Knots of one direction of a lattice, in metres, and the integrals of its basis functions.

Beyond the walls spans grow to the ends of the mesh's box, or the line is periodic; see `.wall_widths` for the spans in
between. Derivatives are scaled by a length h of their span, its width unless a smaller one is requested,

    G_m,ij = sum over spans of h^(2 m - 1) integral of B_i^(m) B_j^(m) dx ,    m = 0, 1, 2,

so an energy composed of them is independent of size, and gives wide and narrow spans the same weight.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import brentq
from scipy.sparse import csr_array, eye_array

from ..splines.knots import ConstantKnots

__all__ = ["LatticeLine", "even_breaks"]

DEGREE = 3
"""Cubic: curvatures, whose squares are summed in the energy, are continuous."""

SHORTEST = 0.5
"""If an end of the box is nearer to the even spans than this fraction of one, the last one is widened to reach it."""

FEWEST = 4
"""Minimum number of spans in a period: with fewer, a function would be its own neighbour."""

ROUNDING = 1e-13
"""Weights of unknowns in control points below this are rounding errors: the others are at least a sixth."""

BEYOND = 3
"""Power of the growth far from the walls, where displacements are small and smooth."""


@dataclass(frozen=True, eq=False)
class LatticeLine:
    """One direction of a lattice."""

    breaks: np.ndarray  # (n_spans + 1,), ends of the spans, ascending (m)
    scales: np.ndarray  # (n_spans,), the lengths that scale derivatives in the spans (m)
    # whether all control points move equally: across a section, whose two planes are the ends of a single span
    is_tied: bool = False
    is_periodic: bool = False  # whether it is periodic: spans are even, and ends move equally

    @classmethod
    def between(
        cls,
        box: tuple[float, float],  # ends of the mesh (m)
        inner: np.ndarray,  # (n,), ends of the spans around the walls, ascending, within the box (m)
        width: float,  # width of spans there unless narrower ones are requested (m)
        growth: float,  # ratio of the widths of neighbouring spans beyond
        near: float,  # distance from these beyond which spans grow faster (m)
    ) -> LatticeLine:
        """Continue spans to the ends of a mesh."""
        breaks = _continued(box, inner, growth, near)
        even = _continued(box, even_breaks(inner[0], inner[-1], width), growth, near)
        middles = 0.5 * (breaks[1:] + breaks[:-1])
        return cls(breaks, np.diff(even)[np.searchsorted(even, middles) - 1])

    @classmethod
    def periodic(
        cls,
        low: float,  # where a period begins (m)
        period: float,  # its length (m)
        width: float,  # largest width of spans (m)
        scale: float,  # largest length that scales derivatives (m)
    ) -> LatticeLine:
        """Divide a direction into periodic spans."""
        n, n_coarse = (max(FEWEST, int(np.ceil(period / each - 1e-9))) for each in (width, scale))
        return cls(np.linspace(low, low + period, n + 1), np.full(n, period / n_coarse), is_periodic=True)

    @property
    def degree(self) -> int:
        """Degree of the basis: linear across a section."""
        return 1 if self.is_tied else DEGREE

    @property
    def length(self) -> float:
        """Total length (m)."""
        return float(self.breaks[-1] - self.breaks[0])

    @property
    def n_control(self) -> int:
        """Number of control points."""
        return len(self.breaks) - 1 + self.degree

    @property
    def n_unknowns(self) -> int:
        """Number of control points that move independently."""
        return self.ties.shape[1]

    @cached_property
    def ties(self) -> csr_array:
        """Displacements of the control points from the unknowns, shape (n_control, n_unknowns)."""
        n = self.n_control
        if self.is_tied:
            return csr_array(np.ones((n, 1)))
        if not self.is_periodic:
            return csr_array(eye_array(n))
        # Periodic splines with two continuous derivatives in terms of open ones: the same functions at as many places
        n_spans, p = len(self.breaks) - 1, self.degree
        knots = self.breaks[0] + self.length / n_spans * np.arange(-p, n_spans + p + 1)
        wrapped = np.eye(n_spans)[np.arange(n) % n_spans]
        places = self.control_coordinates
        there = BSpline(knots, wrapped, p)(places)
        matrix = np.linalg.solve(BSpline(self.coordinate_knots, np.eye(n), p)(places), there)
        matrix[np.abs(matrix) < ROUNDING] = 0.0
        matrix[-1] = matrix[0]
        return csr_array(matrix)

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
        return np.clip((self.wrapped(coordinates) - self.breaks[0]) / self.length, 0.0, 1.0)

    def wrapped(self, coordinates: np.ndarray) -> np.ndarray:
        """Coordinates within the period (m), if there is one."""
        if not self.is_periodic:
            return coordinates
        return self.breaks[0] + np.mod(coordinates - self.breaks[0], self.length)

    def spans(self, coordinates: np.ndarray) -> np.ndarray:
        """Number of the span that contains each coordinate (m)."""
        coordinates = self.wrapped(coordinates)
        return np.clip(np.searchsorted(self.breaks, coordinates, side="right") - 1, 0, len(self.breaks) - 2)

    @cached_property
    def gram(self) -> tuple[csr_array, csr_array, csr_array]:
        """Matrices G_0, G_1 and G_2 of the unknowns, each of shape (n_unknowns, n_unknowns)."""
        return tuple(self.products(m, self.scales ** (2 * m - 1)) for m in range(3))  # type: ignore[return-value]

    def products(
        self, m: int, weights: np.ndarray, factors: Callable[[np.ndarray], np.ndarray] | None = None
    ) -> csr_array:
        """Integrals of products of the m-th derivatives of two unknowns, weighted by spans, shape (n_spans,)."""
        # factors: further weights of coordinates (m), shape (n,)
        if self.is_tied:
            return csr_array(np.full((1, 1), float(m == 0)))
        n = self.degree + 1  # exact for products of two basis functions
        basis, lengths = self.at_gauss_points(m, n)
        lengths *= np.repeat(weights, n)
        if factors is not None:
            lengths *= factors(self.gauss_points(n))
        return csr_array(basis.T @ (lengths[:, None] * basis))

    def gauss_points(self, n: int) -> np.ndarray:
        """Coordinates of n Gauss points of each span (m)."""
        places, widths = np.polynomial.legendre.leggauss(n)[0], np.diff(self.breaks)[:, None]
        return (self.breaks[:-1, None] + 0.5 * widths * (1.0 + places)).ravel()

    def at_gauss_points(self, m: int, n: int) -> tuple[csr_array, np.ndarray]:
        """The m-th derivatives of the unknowns at n Gauss points of each span, and the points' weights (m)."""
        if self.is_tied:
            return csr_array(np.full((1, 1), float(m == 0))), np.ones(1)
        weights, widths = np.polynomial.legendre.leggauss(n)[1], np.diff(self.breaks)[:, None]
        spline = BSpline(self.coordinate_knots, np.eye(self.n_control), self.degree)
        return csr_array(spline(self.gauss_points(n), nu=m) @ self.ties), (0.5 * widths * weights).ravel()


def even_breaks(low: float, high: float, width: float) -> np.ndarray:
    """Ends of even spans of at most a width (m)."""
    return np.linspace(low, high, max(1, int(np.ceil((high - low) / width - 1e-9))) + 1)


def _continued(box: tuple[float, float], inner: np.ndarray, growth: float, near: float) -> np.ndarray:
    """Ends of spans to the ends of a mesh, see `LatticeLine.between`."""
    low = _growing(inner[0] - box[0], inner[1] - inner[0], growth, near)
    high = _growing(box[1] - inner[-1], inner[-1] - inner[-2], growth, near)
    breaks = np.concatenate([inner[0] - low[::-1], inner, inner[-1] + high])
    breaks[0], breaks[-1] = box
    return breaks


def _growing(length: float, width: float, growth: float, near: float) -> np.ndarray:
    """Distances of the ends of growing spans that fill a length, ascending; none if it is too short for one."""
    if length < SHORTEST * width:
        return np.zeros(0)
    ends = _ends(width, growth, min(length, near))
    left, last = length - ends[-1], width * growth ** len(ends)
    if left < last:  # all of them a little narrower, or wider by less
        ends = _ends(width, growth, length)
        return length / ends[-1] * ends
    n = len(_ends(last, growth**BEYOND, left))
    ratio = brentq(lambda ratio: last * (ratio ** np.arange(1, n + 1)).sum() - left, 0.5, growth**BEYOND + 1e-9)
    return np.append(ends, ends[-1] + np.cumsum(last * ratio ** np.arange(1, n + 1)))


def _ends(width: float, growth: float, length: float) -> np.ndarray:
    """Distances of the ends of spans that reach a length, each wider than the previous, the first than ``width``."""
    n = max(1, int(np.ceil(np.log1p(length / width * (growth - 1.0) / growth) / np.log(growth) - 1e-9)))
    return width * np.cumsum(growth ** np.arange(1, n + 1))
