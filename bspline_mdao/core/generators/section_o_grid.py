r"""O-grids about sections by conformal mapping: orthogonal, and of square cells out to the far field.

The mapping of Kármán and Trefftz takes the corner at the trailing edge away and leaves a near-circle, which the
iteration of Theodorsen maps to a circle. Rays and circles there are the grid lines here::

        j far field           i from the trailing edge along the lower side to the nose, and back along the upper one;
       / \                     the first and the last nodes of i coincide behind the trailing edge
      | C=> |  i = 0
       \_/

References
----------
J. C. Vassberg and A. Jameson, "In pursuit of grid convergence for two-dimensional Euler solutions", J. Aircraft 47
(2010), 1152-1166: grids of this kind. T. Theodorsen and I. E. Garrick, "General potential theory of arbitrary wing
sections", NACA Report 452 (1933).
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial.polynomial import polyval
from scipy.interpolate import CubicSpline, PchipInterpolator

from ...errors import InputError
from ...grids.topology.grid import Block, Grid, Patch
from ...grids.topology.index_space import Window
from .stretching import stretch_lines
from .wing import Section

_SAMPLES = 1025
"""Points along each side of the section, dense at both ends."""

_MODES = 1024
"""At least as many points of the circle take part in the iteration, several for each node."""

_STEPS, _TOLERANCE = 500, 1e-13
"""At most as many steps, until angles (rad) change by less."""

_NEAREST, _ALONG_RAY = 1e-7, 400
"""Logarithm of the radius of the nearest of the points by which the lengths of rays are measured, and their number."""

_TRAILING_EDGE = 1.0
"""In chords."""


def section_o_grid(
    section: Section,
    n_around: int = 64,
    far: float = 150.0,
    n_away: int | None = None,
    off_wall: float | None = None,
) -> Grid:
    """Make the O-grid about a section of unit chord, one cell deep between two planes of symmetry.

    Parameters
    ----------
    section : Section
        With a blunt nose and a closed trailing edge; points (x, y) in chords.
    n_around : int
        Cells around the section, an even number of 8 or more.
    far : float
        Radius of the outer boundary in chords.
    n_away : int, optional
        Cells from the section to the outer boundary; as many as make them square by default, which at the default
        radius is as many as around.
    off_wall : float, optional
        Height of the first cells in chords, for boundary layers; square cells by default. Along every ray cells grow
        from there to square ones at the outer boundary.

    Returns
    -------
    Grid
        One right-handed block of ``n_around + 1``, ``n_away + 1`` and 2 nodes, with the patches ``wing``, ``farfield``
        and ``symmetry``, from z = 0 to z = 1.

    Raises
    ------
    InputError
        If the nose is sharp, the counts are too small, the outer boundary is too near, or cells of that height cannot
        grow to it.

    Examples
    --------
    >>> from bspline_mdao.generators import naca_section, section_o_grid
    >>> section_o_grid(naca_section(0.12), n_around=16, far=20.0).shapes
    ((17, 12, 2),)
    """
    if not section.nose_radius > 0.0:
        raise InputError("O-grid about a section: the nose is sharp; give a Section with its nose_radius")
    if n_around < 8 or n_around % 2 or (n_away is not None and n_away < 4):
        away = "" if n_away is None else f" and {n_away} away from it"
        raise InputError(
            f"O-grid about a section: {n_around} cells around it{away}; give an even number of 8 or more around, and 4 "
            f"or more away"
        )
    around, angle = _outline(section)
    corner = _Corner(0.5 * section.nose_radius, 2.0 - angle / np.pi)
    circle = _Circle(corner.flatten(around), n_around)
    if not far > 2.0 * circle.radius:
        raise InputError(f"O-grid about a section: the far field at {far:g} chords cuts it; give 2 or more")
    decades = np.log(far / circle.radius)
    rows = n_away or max(4, round(n_around * decades / (2.0 * np.pi)))
    radii = np.exp(decades * np.arange(rows + 1) / rows)
    if off_wall is None:
        rings = np.stack([circle.ring(r) for r in radii], axis=1)
    else:
        rings = circle.points(_radii_off_wall(corner, circle, decades, rows, off_wall))
    points = corner.restore(rings)
    points[0, 0] = _TRAILING_EDGE
    points = np.concatenate([points, points[:1]])[::-1]  # i clockwise, for a right-handed block
    plane = np.stack([points.real, points.imag], axis=-1)
    nodes = np.stack([np.concatenate([plane, np.full((*plane.shape[:2], 1), z)], axis=-1) for z in (0.0, 1.0)], axis=2)
    block = Block(nodes, "around the section")
    face = Window.whole(0, block.shape).face
    kinds = {"wing": ("wall", (2,)), "farfield": ("farfield", (3,)), "symmetry": ("symmetry", (4, 5))}
    patches = tuple(Patch(name, kind, tuple(map(face, sides))) for name, (kind, sides) in kinds.items())
    return Grid((block,), patches, source="O-grid about a section")


def _radii_off_wall(corner: _Corner, circle: _Circle, decades: float, rows: int, height: float) -> np.ndarray:
    """Radii (n_around, rows + 1) of nodes on the rays whose first cells have a height (chords), the last are square."""
    logarithms = np.append(0.0, np.geomspace(_NEAREST, decades, _ALONG_RAY))
    rays = corner.restore(np.stack([circle.ring(r) for r in np.exp(logarithms)], axis=1))
    distances = np.cumsum(np.abs(np.diff(rays, axis=1)), axis=1)  # along each ray, from the section
    lengths = distances[:, -1]
    last = 2.0 * np.pi / len(rays) * np.exp(decades) * circle.radius
    asked = lengths[:, None] * stretch_lines(lengths, rows + 1, height, last)[:, 1:-1]
    inner = [
        np.exp(PchipInterpolator(np.log(there), np.log(logarithms[1:]))(np.log(here)))
        for there, here in zip(distances, asked)
    ]
    ends = np.broadcast_to([0.0, decades], (len(rays), 2))
    return np.exp(np.concatenate([ends[:, :1], inner, ends[:, 1:]], axis=1))


def _outline(section: Section) -> tuple[np.ndarray, float]:
    """Points from the trailing edge along the upper and back along the lower side, and the angle between both (rad)."""
    fractions = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, _SAMPLES)))
    upper, lower = (section.points(side, fractions[None], np.ones(1))[0] @ [1.0, 1.0j] for side in (1, -1))
    ends = _direction(lower[::-1]) / _direction(upper[::-1])
    angle = 0.5 * np.pi + np.angle(-1j * ends)  # from -pi/2, where sides would cross, to 3/2 pi
    return np.concatenate([upper[::-1], lower[1:]]), angle


def _direction(points: np.ndarray) -> complex:
    """Tangent at the first of some points whose distances from it are as the squares of 0, 1, 2: of second order."""
    first, second = np.diff(points[:3])
    return first * (first * abs(second) / (second * abs(first))) ** 0.25


class _Corner:
    """Mapping of Kármán and Trefftz between the plane of the section and that of the near-circle."""

    def __init__(self, inside: float, power: float):
        middle, half = 0.5 * (_TRAILING_EDGE + inside), 0.5 * (_TRAILING_EDGE - inside)
        self.power, self.here = power, (_TRAILING_EDGE, inside)
        self.there = (middle + half / power, middle - half / power)  # alike at infinity, but for a shift

    def flatten(self, outline: np.ndarray) -> np.ndarray:
        """Points of the near-circle of those around the section."""
        ratio = (outline[1:-1] - self.here[0]) / (outline[1:-1] - self.here[1])
        turns = np.unwrap(np.angle(ratio))
        turns += 2.0 * np.pi * np.round(0.5 - 0.5 * turns[0] / np.pi)  # from pi, also where the upper side begins below
        root = np.exp((np.log(np.abs(ratio)) + 1j * turns) / self.power)
        root = np.concatenate([[0.0], root, [0.0]])
        return (self.there[0] - self.there[1] * root) / (1.0 - root)

    def restore(self, points: np.ndarray) -> np.ndarray:
        """Points about the section of those about the near-circle."""
        ratio = ((points - self.there[0]) / (points - self.there[1])) ** self.power
        return (self.here[0] - self.here[1] * ratio) / (1.0 - ratio)


class _Circle:
    """Mapping of Theodorsen between the outside of the near-circle, counterclockwise, and that of a circle."""

    def __init__(self, outline: np.ndarray, n_around: int):
        self.stride = max(4, -(-_MODES // n_around))
        n = self.stride * n_around
        self.angles = 2.0 * np.pi * np.arange(n) / n
        self.centre = 0.5 * (outline.real.max() + outline.real.min()) + 0.5j * (outline.imag.max() + outline.imag.min())
        radii, turns = np.abs(outline - self.centre), np.unwrap(np.angle(outline - self.centre))
        if not np.all(np.diff(turns) > 0.0):
            raise InputError(
                "O-grid about a section: its near-circle is not star-shaped; give less camber, or a trailing edge "
                "without steps and hooks"
            )
        radii[-1] = radii[0]
        turns[-1] = turns[0] + 2.0 * np.pi
        spline = CubicSpline(turns, np.log(radii), bc_type="periodic")
        at, change = self.angles + turns[0], np.inf
        for _ in range(_STEPS):
            self.modes = np.conj(np.fft.rfft(spline(at))) / n  # of exp(-i k angle): what is analytic outside
            self.modes[1:] *= 2.0
            turned = self._series(1.0).imag
            self.turn = turns[0] - turned[0]  # the trailing edge stays at the angle 0
            new = self.angles + turned + self.turn
            at, change = new, np.abs(new - at).max()
            if change < _TOLERANCE:
                break
        else:
            raise InputError(
                f"O-grid about a section: the mapping to a circle is off by {change:.1g} rad; give less camber, or a "
                f"trailing edge without steps and hooks"
            )
        self.radius = float(np.exp(self.modes[0].real))

    def _series(self, radius: float) -> np.ndarray:
        """Logarithm of what a circle is stretched and turned by, at all angles."""
        n = self.angles.size
        terms = np.zeros(n, dtype=complex)
        terms[: self.modes.size] = self.modes * radius ** -np.arange(self.modes.size, dtype=np.float64)
        return np.fft.fft(terms)

    def ring(self, radius: float) -> np.ndarray:
        """Points about the near-circle that are on a circle of that radius, where the body is of radius 1."""
        around = radius * np.exp(self._series(radius) + 1j * (self.angles + self.turn))
        return self.centre + around[:: self.stride]

    def points(self, radii: np.ndarray) -> np.ndarray:
        """Points about the near-circle at radii (n_around, ...) of their own on each ray."""
        angles = self.angles[:: self.stride].reshape(-1, *[1] * (radii.ndim - 1))
        around = radii * np.exp(polyval(np.exp(-1j * angles) / radii, self.modes) + 1j * (angles + self.turn))
        return self.centre + around
