r"""C-grids about sections by conformal mapping: around the section, and along a cut behind it.

The circle of `circle_mapping` is mapped to a slit from -2 to 2, with the trailing edge at 2. The square root maps the
plane outside the slit and its continuation to the upper half of another plane: wall and cut are its real axis. The grid
lines of equal height are confocal parabolas, which all lines from the wall cross at right angles::

           ____________
          / 1   | 2            three blocks: along the cut below it to the trailing edge, around the section, and along
         |  C=> +--------      the cut above it; j away from wall and cut, i clockwise
          \_____| 0____

The cut leaves the trailing edge along the bisector of its corner, and continues as a streamline without lift.

References
----------
J. F. Thompson, Z. U. A. Warsi and C. W. Mastin, *Numerical Grid Generation* (1985), chapter X: conformal mappings to
C-grids.
"""

from __future__ import annotations

import numpy as np

from ...errors import InputError
from ...grids.topology.grid import Grid
from .circle_mapping import TRAILING_EDGE, CircleMapping
from .section_base import behind_base, grown, opening
from .section_plane import at_distances, mapping_of, one_deep
from .stretching import stretch, stretch_from
from .wing import Section

__all__ = ["section_c_grid"]

GROWTH = 1.15
"""Growth of the cells from the trailing edge along the cut, if their number is not given."""

_WIDER = 0.01
"""Height of the first cells at the cut relative to the distance behind the trailing edge, far away."""

_TURN = 4.0
"""Height in the half plane, where the chord is 4 long, over which lines leave the intervals of the wall: the intervals
at the trailing edge would otherwise be as narrow far away."""

_NEAREST, _ALONG = 1e-9, 120
"""The nearest of the points that measure lengths of lines, and their number."""


def section_c_grid(
    section: Section,
    n_around: int = 64,
    far: float = 50.0,
    n_away: int = 48,
    off_wall: float | None = None,
    n_wake: int | None = None,
    base: complex = 0.0,
) -> Grid:
    """Make the C-grid about a section of unit chord, one cell deep between two planes of symmetry.

    Parameters
    ----------
    section : Section
        Section with a blunt nose and a closed trailing edge; points (x, y) in chords.
    n_around : int
        Cells around the section, an even number of 8 or more.
    far : float
        Distance of the outer boundary in chords, upstream and along the cut; it is twice as far above and below.
    n_away : int
        Cells from the section to the outer boundary.
    off_wall : float, optional
        Height of the first cells in chords; by default half of a chord divided by the cells around. At the cut they
        become higher behind the trailing edge.
    n_wake : int, optional
        Cells along the cut, 4 or more; by default for a growth of 15 % from the wall's cells at the trailing edge.
    base : complex
        Base of a blunt trailing edge, from its lower to its upper corner in chords. A wedge of this thickness, zero at
        the nose, is added to the section, and the cut opens to a block behind it.

    Returns
    -------
    Grid
        Three right-handed blocks, below the cut, around the section and above the cut, with the patches ``wing``,
        ``farfield`` and ``symmetry``, from z = 0 to z = 1. With a base there is a fourth block behind it and a patch
        ``base``. First cells at the base are as high as at the section, if this is less than the length of the
        section's last cells.

    Raises
    ------
    InputError
        If the nose is sharp, the counts are too small, the outer boundary is too near, or first cells of this height
        cannot grow to it.

    Examples
    --------
    >>> from bspline_mdao.generators import naca_section, section_c_grid
    >>> section_c_grid(naca_section(0.12), n_around=16, far=20.0, n_away=12, n_wake=10).shapes
    ((11, 13, 2), (17, 13, 2), (11, 13, 2))
    """
    mapping = mapping_of(section, "C-grid", n_around, n_away, far)
    if n_wake is not None and n_wake < 4:
        raise InputError(f"C-grid about a section: {n_wake} cells along the cut; give 4 or more")
    half_plane, height = _HalfPlane(mapping, far), off_wall or 0.5 / n_around
    wall = -2.0 * np.cos(np.pi * np.arange(n_around + 1) / n_around)  # equal angles of the circle
    at_edge = half_plane.points(wall[[1, -2]] + 0.0j)
    first = np.abs(at_edge - TRAILING_EDGE).mean()
    if base and height < first:  # also of the cells at the base
        first, wall = height, _towards_base(half_plane, wall, height)
    cut, behind = _cut(half_plane, first, n_wake)
    feet = np.concatenate([-cut[:0:-1], wall, cut[1:]])
    even = _even(half_plane.end, n_around, len(cut) - 1)
    behind = np.concatenate([behind[:0:-1], np.zeros_like(wall), behind[1:]])
    heights = grown(height, _WIDER, behind)
    points, up = _lines(half_plane, feet, even, heights, n_away)
    n_cut = len(cut) - 1
    edges = [n_cut, n_cut + n_around]
    points[edges, 0] = TRAILING_EDGE
    points[-n_cut - 1 :, 0] = points[n_cut::-1, 0]  # both compute the cut in different ways
    faces = {"wing": [(1, 2)], "farfield": [(0, 3), (1, 3), (2, 3), (0, 0), (2, 1)]}
    if base:
        points += opening(points[:, 0], feet, up, behind, base)
    parts = np.split(np.insert(points, edges, points[edges], axis=0), np.add(edges, [1, 2]))
    planes = dict(zip(("below the wake", "around the section", "above the wake"), parts))
    if base:
        planes["behind the base"] = behind_base(parts[0][::-1, 0], parts[2][:, 0], heights[-n_cut - 1 :])
        faces = {**faces, "farfield": [*faces["farfield"], (3, 1)], "base": [(3, 0)]}
    return one_deep(planes, faces, "C-grid about a section")


class _HalfPlane:
    """The exterior of a section, cut behind it, as the image of a half plane whose real axis is wall and cut."""

    def __init__(self, mapping: CircleMapping, far: float):
        self._mapping = mapping
        # where the outer boundary cuts the axes
        self.end, self.height = np.sqrt(far / mapping.radius + 2.0), np.sqrt(far / mapping.radius - 2.0)

    def points(self, plane: np.ndarray) -> np.ndarray:
        """Points about the section from complex points of the half plane, with the trailing edge at 2 and -2."""
        outside = (0.5 * (plane + np.sqrt(plane - 2.0) * np.sqrt(plane + 2.0))) ** 2
        return self._mapping.points(outside)

    def lengths(self, feet: np.ndarray) -> np.ndarray:
        """Lengths (chords) of upright lines from their feet (m,), far away, where points grow as squares."""
        slant = np.hypot(feet, self.height)
        squares = feet**2 * np.arcsinh(self.height / np.maximum(np.abs(feet), 1e-9))
        return self._mapping.radius * (self.height * slant + squares)


def _towards_base(half_plane: _HalfPlane, wall: np.ndarray, height: float) -> np.ndarray:
    """Nodes of the wall in the half plane, (n_around + 1,), with the base's intervals (chords) at both ends."""
    middle = len(wall) // 2
    steps = np.append(0.0, np.geomspace(_NEAREST, 2.0, _ALONG))
    at_nose = np.abs(np.diff(half_plane.points(wall[[middle - 1, middle + 1]] + 0.0j)))[0] / 2.0
    sides = []
    for sign in (-1.0, 1.0):
        line = half_plane.points(sign * (2.0 - steps) + 0.0j)
        line[0] = TRAILING_EDGE
        length = np.abs(np.diff(line)).sum()
        distances = length * stretch(middle + 1, height / length, at_nose / length)
        sides.append(sign * np.append(2.0, 2.0 - at_distances(line, steps, distances[1:-1])))
    return np.concatenate([sides[0], [0.0], sides[1][::-1]])


def _cut(
    half_plane: _HalfPlane,
    first: float,  # interval at the trailing edge (chords)
    n: int | None,  # cells
) -> tuple[np.ndarray, np.ndarray]:  # (n + 1,), nodes of the cut in the half plane; distances from the trailing edge
    """Divide the cut."""
    steps = np.append(0.0, np.geomspace(_NEAREST, half_plane.end - 2.0, _ALONG))
    line = half_plane.points(steps + 2.0 + 0.0j)
    line[0] = TRAILING_EDGE
    length = np.abs(np.diff(line)).sum()
    n = n or int(np.ceil(np.log1p((GROWTH - 1.0) * length / first) / np.log(GROWTH)))
    distances = length * stretch_from(n + 1, first / length)
    inner = at_distances(line, steps, distances[1:-1])
    return np.concatenate([[2.0], 2.0 + inner, [half_plane.end]]), distances


def _even(end: float, n_around: int, n_wake: int) -> np.ndarray:
    """Places of all lines far away, where lines at the trailing edge are no closer than others."""
    around = np.linspace(-2.0, 2.0, n_around + 1)
    first = min(4.0 / n_around / (end - 2.0), 1.0 / n_wake)
    behind = 2.0 + (end - 2.0) * stretch_from(n_wake + 1, first)[1:]
    return np.concatenate([-behind[::-1], around, behind])


def _lines(
    half_plane: _HalfPlane,
    # (m,), places of the lines at the real axis and far away, and heights of their first cells (chords)
    feet: np.ndarray,
    even: np.ndarray,
    heights: np.ndarray,
    n_away: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (m, n_away + 1) about the section on lines that leave wall and cut, and their heights in the half plane."""

    def bent(up: np.ndarray) -> np.ndarray:
        return feet[:, None] + (even - feet)[:, None] * up**2 / (up**2 + _TURN**2) + 1j * up

    up = np.append(0.0, np.geomspace(_NEAREST, half_plane.height, _ALONG))
    lines = half_plane.points(bent(up))
    lines[np.abs(feet) == 2.0, 0] = TRAILING_EDGE
    lengths = np.abs(np.diff(lines, axis=1)).sum(axis=1)
    # nodes from the lengths of straightened lines, which differ between neighbours as little as their feet do
    unbent = half_plane.lengths(feet)
    parts = np.stack([stretch_from(n_away + 1, first) for first in heights / unbent])
    asked = unbent[:, None] * parts * (1.0 + (lengths / unbent - 1.0)[:, None] * parts)
    inner = [at_distances(line, up, distances[1:-1]) for line, distances in zip(lines, asked)]
    ends = np.broadcast_to([0.0, half_plane.height], (len(feet), 2))
    up = np.concatenate([ends[:, :1], inner, ends[:, 1:]], axis=1)
    return half_plane.points(bent(up)), up
