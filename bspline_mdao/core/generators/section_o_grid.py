r"""O-grids about sections by conformal mapping: orthogonal, with square cells out to the far field.

The grid lines are the images of rays and circles about the circle that the section is mapped to::

        j far field           i from the trailing edge along the lower side to the nose, and back along the upper one;
       / \                     the first and the last nodes of i coincide behind the trailing edge
      | C=> |  i = 0
       \_/

References
----------
J. C. Vassberg and A. Jameson, "In pursuit of grid convergence for two-dimensional Euler solutions", J. Aircraft 47
(2010), 1152-1166: grids of this kind.
"""

from __future__ import annotations

import numpy as np

from ...grids.topology.grid import Grid
from .circle_mapping import TRAILING_EDGE, CircleMapping
from .section_plane import at_distances, mapping_of, one_deep
from .stretching import stretch_lines
from .wing import Section

_NEAREST, _ALONG_RAY = 1e-7, 400
"""Logarithm of the radius of the nearest of the points that measure lengths of rays, and their number."""


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
        Section with a blunt nose and a closed trailing edge; points (x, y) in chords.
    n_around : int
        Cells around the section, an even number of 8 or more.
    far : float
        Radius of the outer boundary in chords.
    n_away : int, optional
        Cells from the section to the outer boundary. By default as many as make them square, which at the default
        radius is the number around.
    off_wall : float, optional
        Height of the first cells in chords, for boundary layers; square cells by default. Along every ray cells grow
        from this height to square ones at the outer boundary.

    Returns
    -------
    Grid
        One right-handed block of ``n_around + 1``, ``n_away + 1`` and 2 nodes, with the patches ``wing``, ``farfield``
        and ``symmetry``, from z = 0 to z = 1.

    Raises
    ------
    InputError
        If the nose is sharp, the counts are too small, the outer boundary is too near, or first cells of this height
        cannot grow to it.

    Examples
    --------
    >>> from bspline_mdao.generators import naca_section, section_o_grid
    >>> section_o_grid(naca_section(0.12), n_around=16, far=20.0).shapes
    ((17, 12, 2),)
    """
    mapping = mapping_of(section, "O-grid", n_around, n_away, far)
    decades = np.log(far / mapping.radius)
    rows = n_away or max(4, round(n_around * decades / (2.0 * np.pi)))
    if off_wall is None:
        points = _rings(mapping, np.exp(decades * np.arange(rows + 1) / rows))
    else:
        points = mapping.points(_off_wall(mapping, n_around, decades, rows, off_wall))
    points[0, 0] = TRAILING_EDGE
    points = np.concatenate([points, points[:1]])[::-1]  # i clockwise, for a right-handed block
    faces = {"wing": [(0, 2)], "farfield": [(0, 3)]}
    return one_deep({"around the section": points}, faces, "O-grid about a section")


def _off_wall(mapping: CircleMapping, n_around: int, decades: float, rows: int, height: float) -> np.ndarray:
    """Nodes (n_around, rows + 1) about the circle with first cells of a height (chords) and square last ones."""
    logarithms = np.append(0.0, np.geomspace(_NEAREST, decades, _ALONG_RAY))
    rays = _rings(mapping, np.exp(logarithms))
    lengths = np.abs(np.diff(rays, axis=1)).sum(axis=1)
    last = 2.0 * np.pi / n_around * np.exp(decades) * mapping.radius
    asked = lengths[:, None] * stretch_lines(lengths, rows + 1, height, last)[:, 1:-1]
    inner = [at_distances(ray, logarithms, distances) for ray, distances in zip(rays, asked)]
    ends = np.broadcast_to([0.0, decades], (n_around, 2))
    turns = 2.0j * np.pi * np.arange(n_around)[:, None] / n_around
    return np.exp(np.concatenate([ends[:, :1], inner, ends[:, 1:]], axis=1) + turns)


def _rings(mapping: CircleMapping, radii: np.ndarray) -> np.ndarray:
    """Points (n_around, n) about the section on circles."""
    return np.stack([mapping.ring(radius) for radius in radii], axis=1)
