"""Shapes added to sections as one curve: bumps, class-shape functions, camber and thickness modes.

Each is a height normal to the chord line, as a function of chordwise position and side. A value applies to the whole
section, whatever the number of planes, cells and control points across the span. All are linear in their values.
Theory: ``docs/theory/parametrization.rst``, "Sections as one curve".

References
----------
R. M. Hicks and P. A. Henne, Wing design by numerical optimization, *Journal of Aircraft* 15(7), 1978: bumps.

B. M. Kulfan, Universal parametric geometry representation method, *Journal of Aircraft* 45(1), 2008: class functions
times Bernstein polynomials.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse import csr_array
from scipy.special import comb

from ...base.checks import as_numbers
from ...base.display import OneLine
from ...errors import InputError
from .displacement import Displacement
from .reference_axis import ReferenceAxis, StationSpline
from .section_places import SectionPlaces
from .variable import AuxiliaryPoints, Layout

__all__ = ["CamberModes", "ClassShape", "HicksHenne", "ThicknessModes", "ThicknessPoints"]

SIDES = {"upper": 1.0, "lower": -1.0}
"""Sides of a section, and their signs."""

MOST = 50
"""Maximum number of modes of one kind: beyond it, Bernstein polynomials are sharper than control points can follow."""


@dataclass(frozen=True, eq=False)
class OfSections(OneLine, ABC):
    """Heights in chords added to sections, normal to their chord lines."""

    units: ClassVar[str | None] = None
    auxiliary: ClassVar[tuple[AuxiliaryPoints, ...]] = ()

    name: str  # name of the input of `SurfaceControl`
    # axis of the stations; the straight line along the span by default
    axis: ReferenceAxis | None = field(default=None, kw_only=True)
    # number of sections with values of their own, evenly from the root to the tip, or their positions
    stations: int | Sequence[float] = field(default=1, kw_only=True)
    # order of the spline between them: 2 straight lines, 4 cubics
    order: int = field(default=4, kw_only=True)

    def __post_init__(self) -> None:
        if self.axis is not None and not isinstance(self.axis, ReferenceAxis):
            raise InputError(f"'{self.name}': the axis is of type {type(self.axis).__name__}; give a ReferenceAxis")

    def bind(self, layout: Layout) -> Displacement:
        """Find the control points that give the surface its shapes, on the baseline."""
        places = SectionPlaces.of(layout, self.axis)
        heights = self.shapes(places.parts, places.sides) * places.chords[:, None]
        spline = StationSpline.of(self.stations, self.order).basis(places.stations)
        fields = np.einsum("nk,nm,nx->nkmx", spline, heights, places.up).reshape(len(heights), -1)
        found = places.surface.control(fields).reshape(len(heights), -1, 3).swapaxes(1, 2)
        matrix = csr_array(found.reshape(3 * len(heights), -1))
        matrix.resize(3 * len(layout.points), matrix.shape[1])
        return Displacement(matrix)

    @abstractmethod
    def shapes(
        self,
        parts: np.ndarray,  # (n,), fractions of the chord: 0 at the leading, 1 at the trailing edge
        sides: np.ndarray,  # (n,), 1 on the upper side, -1 on the lower one
    ) -> np.ndarray:  # (n, n_values), in chords, upwards positive
        """Heights in one section for a unit of each value."""


@dataclass(frozen=True, eq=False)
class HicksHenne(OfSections):
    r"""Add Hicks-Henne bumps to the sides of sections; values are heights in chords, upwards positive.

    The bump at the fraction m of the chord is :math:`\sin^w(\pi x^{\ln 0.5 / \ln m})`: 1 there, and 0 at both edges of
    the section, which stay in place. There is one value for each place on each side, upper ones first.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement`; 0 on the baseline.
    at : int or sequence of float
        Fractions of the chord where the bumps are highest, or their number, clustered towards the edges:
        ``(1 - cos(pi k / (n + 1))) / 2``.
    power : float or sequence of float
        Power of the sine, for all bumps or for each: the larger, the narrower.
    sides : str or sequence of str
        ``"upper"``, ``"lower"``, or both.
    axis : ReferenceAxis, optional
        Axis of the stations; the straight line along the span by default.
    stations : int or sequence of float
        Number of sections with values of their own, evenly from the first point of the axis (0) to the last (1), or
        their positions. A single station is a value for all.
    order : int
        Order of the spline between stations: 2 straight lines, 4 cubics.

    Raises
    ------
    InputError
        If a place is not between 0 and 1, or the bump is so near to the nose that it makes a kink there.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.design import HicksHenne
    >>> from bspline_mdao.generators import naca_section, section_o_grid
    >>> section = DesignSurface.of(fit_grid(section_o_grid(naca_section(0.12), 32, far=20.0)))
    >>> section.parametrization([HicksHenne("bumps", at=(0.2, 0.5, 0.8), sides="upper")]).initial["bumps"]
    array([0., 0., 0.])
    """

    at: int | Sequence[float] = 6
    power: float | Sequence[float] = field(default=3.0, kw_only=True)
    sides: str | Sequence[str] = field(default=("upper", "lower"), kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        places, powers, sides = self._places, self._powers, self._signs
        if not (places.ndim == 1 and len(places) and ((places > 0.0) & (places < 1.0)).all()):
            raise InputError(f"'{self.name}': bumps at {self.at}; give parts of the chord between 0 and 1, or how many")
        if powers.shape != places.shape or not (powers > 0.0).all() or not sides:
            raise InputError(
                f"'{self.name}': power {self.power} and sides {self.sides}; give a positive power, or one for each of "
                f"{len(places)} bumps, and sides out of upper and lower"
            )
        rises = powers * np.log(0.5) / np.log(places)
        if (rises <= 0.5).any():
            worst = int(np.argmin(rises))
            least = 0.5 * np.log(places[worst]) / np.log(0.5)
            raise InputError(
                f"'{self.name}': the bump at {places[worst]:g} of the chord makes a kink at the nose; move it back, or "
                f"take a power above {least:.3g}"
            )

    @property
    def _places(self) -> np.ndarray:
        if isinstance(self.at, (int, np.integer)) and not isinstance(self.at, bool):
            n = min(max(int(self.at), 0), MOST)
            return 0.5 * (1.0 - np.cos(np.pi * np.arange(1, n + 1) / (n + 1)))
        return as_numbers(self.at, f"'{self.name}': at")

    @property
    def _powers(self) -> np.ndarray:
        powers = as_numbers(self.power, f"'{self.name}': power")
        return np.full(self._places.shape, powers) if powers.ndim == 0 else powers

    @property
    def _signs(self) -> list[float]:
        names = [self.sides] if isinstance(self.sides, str) else list(self.sides)
        is_good = set(names) <= set(SIDES) and len(set(names)) == len(names)
        return [sign for side, sign in SIDES.items() if side in names] if is_good else []

    def shapes(self, parts: np.ndarray, sides: np.ndarray) -> np.ndarray:
        """Heights of every bump, shape (n, n_values), at chord fractions and sides, each of shape (n,)."""
        exponents = np.log(0.5) / np.log(self._places)
        waves = np.sin(np.pi * parts[:, None] ** exponents)
        bumps = np.where(parts[:, None] < 1.0, np.maximum(waves, 0.0), 0.0) ** self._powers
        return np.concatenate([bumps * (sides == sign)[:, None] for sign in self._signs], axis=1)


@dataclass(frozen=True, eq=False)
class ClassShape(OfSections):
    r"""Add class-shape functions (CST) to the sides of sections; values are weights, in chords, upwards positive.

    Weight k of a side multiplies :math:`x^{N_1} (1 - x)^{N_2} \, B_k^n(x)` with the Bernstein polynomials of degree n.
    The first weight belongs to both sides, up on the upper and down on the lower one: it sets the radius of the nose,
    which stays round. Values are, in this order, that first weight, weights 1 to n of the upper side, weights 1 to n of
    the lower side, and the height of the trailing edge.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement`; 0 on the baseline, which need not be of this kind.
    degree : int
        Degree n of the polynomials.
    exponents : tuple of float
        Exponents N1 and N2 of the class function: (0.5, 1) for a round nose and a wedge at the trailing edge.
    nose : bool
        Whether the first weight is a value; otherwise the nose radius is fixed.
    trailing : bool
        Whether the height of the trailing edge is a value: both sides move up by it in proportion to the chord
        fraction. The leading edge always stays.
    axis, stations, order
        As for `HicksHenne`.

    Raises
    ------
    InputError
        If the degree is not an integer from 1 on, or an exponent is not positive.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.design import ClassShape
    >>> from bspline_mdao.generators import naca_section, section_o_grid
    >>> section = DesignSurface.of(fit_grid(section_o_grid(naca_section(0.12), 32, far=20.0)))
    >>> section.parametrization([ClassShape("weights", degree=4)]).initial["weights"].size
    9
    """

    degree: int = 5
    exponents: tuple[float, float] = field(default=(0.5, 1.0), kw_only=True)
    nose: bool = field(default=True, kw_only=True)
    trailing: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_whole(self.degree, self.name, "degree")
        found = as_numbers(self.exponents, f"'{self.name}': exponents")
        if found.shape != (2,) or not (found >= (0.5, 1e-3)).all():
            raise InputError(
                f"'{self.name}': exponents {self.exponents}; give two numbers, from 0.5 on and positive: (0.5, 1)"
            )

    def shapes(self, parts: np.ndarray, sides: np.ndarray) -> np.ndarray:
        """Heights of every weight, shape (n, n_values), at chord fractions and sides, each of shape (n,)."""
        first, second = self.exponents
        functions = (parts**first * (1.0 - parts) ** second)[:, None] * bernstein(self.degree, parts)
        of_sides = [functions[:, 1:] * (sides == sign)[:, None] for sign in SIDES.values()]
        nose = [sides[:, None] * functions[:, :1]] if self.nose else []
        return np.concatenate([*nose, *of_sides, *([parts[:, None]] if self.trailing else [])], axis=1)


@dataclass(frozen=True, eq=False)
class _Counted(OfSections):
    """A number of shapes chosen by the user."""

    n: int = 4

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_whole(self.n, self.name, "n")


@dataclass(frozen=True, eq=False)
class CamberModes(_Counted):
    """Add camber modes to sections, moving both sides equally; values are heights in chords, upwards positive.

    The modes are the Bernstein polynomials of degree n + 1 without the first and the last, divided by their largest
    values: a single mode is the parabola of `Camber`. Both edges stay in place, unless their modes, the first and the
    last polynomial, are values as well, placed before and after the others.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement`; 0 on the baseline.
    n : int
        Number of modes, not counting the edges.
    leading, trailing : bool
        Whether the heights of the edges are values.
    axis, stations, order
        As for `HicksHenne`.

    Raises
    ------
    InputError
        If n is not an integer from 1 on.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.design import CamberModes
    >>> from bspline_mdao.generators import naca_section, section_o_grid
    >>> section = DesignSurface.of(fit_grid(section_o_grid(naca_section(0.12), 64, far=20.0)))
    >>> shape = section.parametrization([CamberModes("camber", 1)])
    >>> baseline = section.mesh.points[section.mesh.surface_ids]
    >>> (shape.apply(baseline, {"camber": np.array([0.02])}) - baseline).max(axis=0).round(3)
    array([0.  , 0.02, 0.  ])
    """

    leading: bool = field(default=False, kw_only=True)
    trailing: bool = field(default=False, kw_only=True)

    def shapes(self, parts: np.ndarray, sides: np.ndarray) -> np.ndarray:
        """Heights of every mode, shape (n, n_values), at chord fractions and sides, each of shape (n,)."""
        degree = self.n + 1
        scaled = bernstein(degree, parts) / np.diag(bernstein(degree, np.arange(degree + 1) / degree))
        return scaled[:, int(not self.leading) : degree + int(self.trailing)]


@dataclass(frozen=True, eq=False)
class ThicknessModes(_Counted):
    r"""Add thickness modes to sections, moving their sides apart; values are thicknesses in chords.

    The modes are :math:`\sqrt x \, B_k^n(x)` for k from 0 to n - 1, half upwards and half downwards, divided by their
    largest values. Both edges stay in place, and the nose stays round; the first mode changes its radius.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement`; 0 on the baseline.
    n : int
        Number of modes.
    nose : bool
        Whether the first mode changes the nose radius; otherwise k is from 1 to n, and the degree n + 1.
    axis, stations, order
        As for `HicksHenne`.

    Raises
    ------
    InputError
        If n is not an integer from 1 on.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.design import ThicknessModes
    >>> from bspline_mdao.generators import naca_section, section_o_grid
    >>> section = DesignSurface.of(fit_grid(section_o_grid(naca_section(0.12), 32, far=20.0)))
    >>> section.parametrization([ThicknessModes("thickness", 3)]).initial["thickness"]
    array([0., 0., 0.])
    """

    nose: bool = field(default=True, kw_only=True)

    def shapes(self, parts: np.ndarray, sides: np.ndarray) -> np.ndarray:
        """Heights of every mode, shape (n, n_values), at chord fractions and sides, each of shape (n,)."""
        first = 0 if self.nose else 1
        degree, numbers = self.n + first, np.arange(first, self.n + first)
        highest = (numbers + 0.5) / (degree + 0.5)  # where the derivative is zero
        modes, largest = (np.sqrt(x)[:, None] * bernstein(degree, x)[:, numbers] for x in (parts, highest))
        return 0.5 * sides[:, None] * modes / np.diag(largest)


@dataclass(frozen=True, eq=False)
class ThicknessPoints(_Counted):
    r"""Add a thickness spline to sections, moving their sides apart; values are its control points in chords.

    The spline is cubic and odd in :math:`\sqrt x`, so the nose stays round. Its knots cluster towards the edges: for n
    values ``(1 - cos(pi k / n)) / 2``. Control points at the edges stay; the first value changes the nose radius, the
    last one the trailing-edge angle. Each value affects only a part of the section, and if none is negative the section
    is nowhere thinner.

    Parameters
    ----------
    name : str
        Name of the design variable, an input of `GridMovement`; 0 on the baseline.
    n : int
        Number of control points, not counting the edges.
    axis, stations, order
        As for `HicksHenne`.

    Raises
    ------
    InputError
        If n is not an integer from 1 on.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, fit_grid
    >>> from bspline_mdao.design import ThicknessPoints
    >>> from bspline_mdao.generators import naca_section, section_o_grid
    >>> section = DesignSurface.of(fit_grid(section_o_grid(naca_section(0.12), 32, far=20.0)))
    >>> section.parametrization([ThicknessPoints("thickness", 5)]).initial["thickness"]
    array([0., 0., 0., 0., 0.])
    """

    n: int = 9

    def shapes(self, parts: np.ndarray, sides: np.ndarray) -> np.ndarray:
        """Heights of every control point, shape (n, n_values), at chord fractions and sides, each of shape (n,)."""
        knots = np.sin(0.5 * np.pi * np.arange(-self.n, self.n + 1) / self.n)
        basis = BSpline.design_matrix(np.sqrt(parts), np.pad(knots, 3, "edge"), 3).toarray()
        odd = basis - basis[:, ::-1]
        return 0.5 * sides[:, None] * odd[:, self.n + 2 : -1]


def bernstein(degree: int, parts: np.ndarray) -> np.ndarray:
    """Bernstein polynomials of a degree at chord fractions, shape (n,); shape (n, degree + 1)."""
    k = np.arange(degree + 1)
    return comb(degree, k) * parts[:, None] ** k * (1.0 - parts[:, None]) ** (degree - k)


def _require_whole(value: int, name: str, what: str) -> None:
    """Refuse an invalid number of modes."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 1 <= value <= MOST:
        raise InputError(f"'{name}': {what} {value!r}; give a whole number from 1 to {MOST}")
