"""Airfoils: outlines of sections from points, NACA designations, and class and shape functions.

An outline runs from the trailing edge along the upper side to the nose, and back along the lower side, as in files in
Selig's order.

References
----------
C. L. Ladson, C. W. Brooks, A. S. Hill and D. W. Sproles, "Computer program to obtain ordinates for NACA airfoils", NASA
TM 4741 (1996): four and five digits. B. M. Kulfan, "Universal parametric geometry representation method", J. Aircraft
45 (2008), 142-158: class and shape functions.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BPoly, CubicSpline
from scipy.optimize import minimize_scalar

from ...base.checks import as_numbers
from ...base.display import OneLine
from ...errors import InputError
from .outline_checks import check_outline
from .wing import Section, naca_thickness

__all__ = ["Airfoil", "cst_airfoil", "naca_airfoil"]

_SIDE = 201
"""Points along each side of an outline from a formula, dense at both ends."""

_OF_SECTION = 401
"""Points along each side of a section from an outline: the two splines agree to 1e-9 chords."""

_NOSE = 0.03
"""Fraction of the chord that determines the radius of the nose."""

_SHARP = 1e-9
"""Height of a trailing edge in chords that is rounding."""

_CAMBER = {
    # by the second and third digit: place r of the end of the curved part, and factor k1, at a design lift of 0.3; for
    # reflexed lines also k2 / k1
    "10": (0.0580, 361.400), "20": (0.1260, 51.640), "30": (0.2025, 15.957), "40": (0.2900, 6.643),
    "50": (0.3910, 3.230), "21": (0.1300, 51.990, 0.000764), "31": (0.2170, 15.793, 0.00677),
    "41": (0.3180, 6.520, 0.0303), "51": (0.4410, 3.191, 0.1355),
}  # fmt: skip
"""Tables 1 and 2 of TM 4741."""


_FEW = 0.055
"""Distance in chords between an outline and the curve through every second point from which its points are too few.

With 11 points, dense at both ends, it is 0.07 for NACA sections, and they come out 5 to 10 % too thick; with 21 it is
0.015, and the thickness is within 1 %. With 31 points equally far apart it is 0.044, all at the nose, and the thickness
is within 0.1 %."""


@dataclass(frozen=True, eq=False)
class Airfoil(OneLine):
    """The outline of a section: one cubic spline in chord length through points, including the nose.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        Points (x, y) from the trailing edge along the upper side around the nose and back along the lower side, usually
        in chords. If the first and the last one differ, the trailing edge is blunt, with the base between them.
    name : str
        Name for messages.

    Raises
    ------
    InputError
        If the points are not an outline: too few, not finite, duplicated, unordered, open, or with crossing sides.

    Examples
    --------
    >>> from bspline_mdao.generators import airfoil
    >>> section = airfoil("naca2412")
    >>> section
    Airfoil(points=array(401, 2), name='naca2412')
    >>> round(section.thickness, 4), round(section.nose_radius, 4), section.base
    (0.12, 0.0158, 0.0)
    """

    points: np.ndarray
    name: str = "airfoil"

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", as_numbers(self.points, f"airfoil '{self.name}'"))
        check_outline(self.points, f"airfoil '{self.name}'")

    @property
    def tail(self) -> np.ndarray:
        """Midpoint of the trailing edge, shape (2,)."""
        return 0.5 * (self.points[0] + self.points[-1])

    @property
    def nose(self) -> np.ndarray:
        """Point of the outline farthest from the trailing edge, shape (2,); its tangent is normal to the chord."""
        return self._curve(self._at_nose)

    @property
    def chord(self) -> float:
        """Distance from the nose to the midpoint of the trailing edge, in units of the points."""
        return float(np.linalg.norm(self.tail - self.nose))

    @property
    def base(self) -> float:
        """Height of the trailing edge in chords; 0 for a sharp one."""
        base = float(np.linalg.norm(self.points[0] - self.points[-1])) / self.chord
        return base if base > _SHARP else 0.0

    @cached_property
    def nose_radius(self) -> float:
        """Radius of the nose in chords, from squares of the thickness near it: few digits give no second derivative."""
        upper, lower = self._sides
        x = np.linspace(0.0, _NOSE, 41)[1:]
        half = 0.5 * (np.interp(x, *upper.T) - np.interp(x, *lower.T))
        terms = np.column_stack([np.ones_like(x), np.sqrt(x), x])  # the terms of NACA sections and of class functions
        radius = 0.5 * float(np.linalg.lstsq(terms, half**2 / x, rcond=None)[0][0])
        return radius if radius > 0.0 else 0.5 * float(half[0] ** 2 / x[0])  # a nose with few points

    @cached_property
    def few_points(self) -> str:
        """What to do if the points are too few for one curve; empty if they suffice."""
        every = np.unique(np.append(np.arange(0, len(self.points), 2), len(self.points) - 1))
        arc = self._curve.x
        off = np.linalg.norm(CubicSpline(arc[every], self.points[every])(arc) - self.points, axis=1).max() / self.chord
        if off <= _FEW:
            return ""
        return (
            f"{len(self.points)} points are too few to determine the outline, so its thickness and nose are guesses; "
            f"give more, such as 61, dense at the nose"
        )

    @property
    def thickness(self) -> float:
        """Largest thickness across the chord, in chords."""
        return self.section.thickness

    @cached_property
    def section(self) -> Section:
        """The same from (0, 0) at the nose to (1, 0), with its trailing edge closed by a wedge.

        The wedge is `base` thick at the trailing edge and zero at the nose: it moves no point by more than half of the
        base.
        """
        upper, lower = self._sides
        half = 0.5 * (upper[-1] - lower[-1])
        upper, lower = upper - half * upper[:, :1], lower + half * lower[:, :1]
        for side in (upper, lower):
            side[[0, -1]] = [[0.0, 0.0], [1.0, 0.0]]
        return Section(upper, lower, nose_radius=self.nose_radius)

    @property
    def base_of_section(self) -> complex:
        """Vector that the wedge removes at the trailing edge of `section`, from lower to upper corner, in chords."""
        upper, lower = self._in_chords(self.points[[0, -1]])
        return complex(*(upper - lower)) if self.base else 0.0

    def place(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 2) from the plane of `section` to the outline's plane."""
        along = self.tail - self.nose
        return self.nose + points[..., :1] * along + points[..., 1:] * [-along[1], along[0]]

    @cached_property
    def _sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Points of the upper and the lower side from the nose, in the plane of `section`, dense at both ends."""
        dense = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, _OF_SECTION)))
        first, last = (self._at_nose + (end - self._at_nose) * dense for end in self._curve.x[[0, -1]])
        return self._in_chords(self._curve(first)), self._in_chords(self._curve(last))

    def _in_chords(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 2) from the outline's plane to the plane of `section`."""
        along, from_nose = self.tail - self.nose, points - self.nose
        across = np.array([-along[1], along[0]])
        return np.stack([from_nose @ along, from_nose @ across], axis=-1) / (along @ along)

    @cached_property
    def _curve(self) -> CubicSpline:
        """Spline through the points."""
        arc = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1)))
        return CubicSpline(arc, self.points)

    @cached_property
    def _at_nose(self) -> float:
        """Parameter of the nose."""
        k = int(np.argmax(np.linalg.norm(self.points - self.tail, axis=1)))
        near = self._curve.x[k - 1], self._curve.x[k + 1]
        found = minimize_scalar(
            lambda t: -np.sum((self._curve(t) - self.tail) ** 2), bounds=near, method="bounded", options={"xatol": 1e-9}
        ).x
        for _ in range(2):  # to the last digit; a minimum from values has only half of the digits
            away, speed, turn = self._curve(found) - self.tail, self._curve(found, 1), self._curve(found, 2)
            found -= (away @ speed) / (speed @ speed + away @ turn)
        return float(np.clip(found, *near))


def naca_airfoil(digits: str, blunt: bool = False) -> Airfoil:
    """Make the outline of a NACA section of four or five digits.

    Parameters
    ----------
    digits : str
        Digits such as ``"2412"``. With five digits, the third one is 0, or 1 for a reflexed camber line.
    blunt : bool
        Keep the trailing edge open as in the definition, a fiftieth of the thickness. By default the last coefficient
        closes it, as in `naca_section`.

    Returns
    -------
    Airfoil
        The thickness is added normal to the camber line, which begins at (0, 0) and ends at (1, 0).

    Raises
    ------
    InputError
        If there is no such section.

    Examples
    --------
    >>> from bspline_mdao.generators import naca_airfoil
    >>> naca_airfoil("23012").points[:, 1].max().round(3).item()
    0.076
    """
    if not re.fullmatch(r"\d{4,5}", digits, re.ASCII) or digits[-2:] == "00":
        raise InputError(
            f"NACA '{digits}': give four or five digits such as 2412 or 23012, the last two above 00; others, such as "
            f"those of the 6-series, need a file of points"
        )
    if len(digits) == 5 and digits[1:3] not in _CAMBER:
        raise InputError(
            f"NACA '{digits}': there is no such camber line; the second and third digit are one of "
            f"{', '.join(sorted(_CAMBER))}"
        )
    if len(digits) == 4 and (digits[0] == "0") != (digits[1] == "0"):
        raise InputError(f"NACA '{digits}': camber and its place, the first two digits, are both 0 or neither")
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, _SIDE)))
    half = naca_thickness(x, int(digits[-2:]) / 100.0, is_closed=not blunt)
    line, slope = _four_digits(digits, x) if len(digits) == 4 else _five_digits(digits, x)
    across = half[:, None] * np.column_stack([-slope, np.ones_like(x)]) / np.hypot(1.0, slope)[:, None]
    middle = np.column_stack([x, line])
    return Airfoil(_around(middle + across, middle - across), f"naca{digits}")


def cst_airfoil(upper: Sequence[float], lower: Sequence[float], base: float = 0.0) -> Airfoil:
    """Make the outline of class and shape functions with a round nose: Kulfan's with exponents 1/2 and 1.

    Parameters
    ----------
    upper, lower : sequence of float
        Coefficients of Bernstein polynomials from the nose to the trailing edge, usually negative for the lower side;
        any number for either side.
    base : float
        Height of the trailing edge in chords.

    Returns
    -------
    Airfoil
        ``y = sqrt(x) (1 - x) sum(A_i B_i(x))``, plus and minus ``x base / 2``.

    Raises
    ------
    InputError
        If coefficients are missing or not finite, or sides cross.

    Examples
    --------
    >>> from bspline_mdao.generators import cst_airfoil
    >>> cst_airfoil([0.17, 0.16, 0.15], [-0.17, -0.1, -0.15])
    Airfoil(points=array(401, 2), name='cst')
    """
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, _SIDE)))
    sides = []
    for name, given, sign in (("upper", upper, 1.0), ("lower", lower, -1.0)):
        values = as_numbers(given, f"airfoil 'cst', {name} coefficients")
        if values.ndim != 1 or not values.size or not np.isfinite([*values, base]).all() or base < 0.0:
            raise InputError(
                f"airfoil 'cst', {name} coefficients {given} and base {base}: give one or more finite numbers and a "
                f"base of 0 or more"
            )
        shape = BPoly(values[:, None], [0.0, 1.0])(x)
        sides.append(np.column_stack([x, np.sqrt(x) * (1.0 - x) * shape + 0.5 * sign * base * x]))
    return Airfoil(_around(*sides), "cst")


def _around(upper: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """Outline of two sides (n, 2) that begin at the same nose."""
    return np.concatenate([upper[::-1], lower[1:]])


def _four_digits(digits: str, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Camber line of four digits and its slope."""
    if digits[:2] == "00":
        return np.zeros_like(x), np.zeros_like(x)
    height, at = int(digits[0]) / 100.0, int(digits[1]) / 10.0
    factor = height / np.where(x < at, at, 1.0 - at) ** 2
    rest = np.where(x < at, 0.0, 1.0 - 2.0 * at)
    return factor * (rest + 2.0 * at * x - x * x), 2.0 * factor * (at - x)


def _five_digits(digits: str, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Camber line of five digits and its slope."""
    end, factor, *ratio = _CAMBER[digits[1:3]]
    factor *= int(digits[0]) * 0.15 / 0.3 / 6.0
    behind = ratio[0] if ratio else 0.0
    ahead = np.where(x < end, 1.0, behind) * (x - end)
    chord = behind * (1.0 - end) ** 3 + end**3
    line = factor * (ahead * (x - end) ** 2 - chord * x + end**3)
    return line, factor * (3.0 * ahead * (x - end) - chord)
