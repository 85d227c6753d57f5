"""Thickness of a body at probes, along given lines or a grid of lines.

Theory: ``docs/theory/geometry.rst``, "Thickness".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from ...base.checks import as_numbers
from ...base.display import OneLine
from ...base.numerics.vectors import lengths, unit_vectors
from ...errors import InputError
from ..mesh.surface import SurfaceGrid
from .area import planform_normal
from .measure import Combinations
from .probes import FLAT, ROUND_OFF, as_points, opposite_probes
from .section_thickness import cuts_along_span, section_edges, stations_or_middle

__all__ = ["Thickness", "ruled_normals", "ruled_points", "within_edges"]

CHORD, SPAN = (0.05, 0.95), (0.02, 0.98)
"""Fractions of chord and span between which the thickness is measured: it vanishes at a rounded tip and at an edge."""


@dataclass(frozen=True, eq=False)
class Thickness(OneLine):
    """Distances between opposite probes, in metres or relative to the baseline.

    Make it by `at`, `grid` or `of_sections`.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    across : Combinations
        The n vectors from one probe to the opposite one.
    directions : ndarray, shape (n, 3)
        Unit vectors along the lines on the baseline.
    scales : ndarray, shape (n,)
        Divisors of the distances (m, or 1).
    units : str or None
        Units.
    shape : tuple of int
        Shape of the output.
    name : str
        Name of the output.

    Notes
    -----
    A distance cannot distinguish a body from an inverted one. If it is zero, as on a flat plate, its derivative is
    taken for opening along the line.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.measures import SurfaceGrid, Thickness
    >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((9, 9, 7))))
    >>> thickness = Thickness.grid(surface, n_chord=3, n_span=4, relative=True)
    >>> thickness.evaluate(surface.points * [1.0, 1.1, 1.0]).min().round(3).item()  # of a body that is 10 % thicker
    1.1
    """

    surface: SurfaceGrid
    across: Combinations
    directions: np.ndarray
    scales: np.ndarray
    units: str | None
    shape: tuple[int, ...]
    name: str

    @classmethod
    def at(
        cls,
        surface: SurfaceGrid,
        points: np.ndarray,
        direction: np.ndarray | None = None,
        relative: bool = False,
        name: str = "thickness",
    ) -> Thickness:
        """Measure along lines through points.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        points : ndarray, shape (..., 3)
            A point of each line (m), in the body or near it; the output has the shape of all dimensions except the
            last.
        direction : ndarray, shape (3,) or (..., 3), optional
            Directions of the lines; by default normal to the planform (`planform_normal`).
        relative : bool
            Whether to divide by the distances on the baseline.
        name : str
            Name of the output.

        Returns
        -------
        Thickness

        Raises
        ------
        InputError
            If a line does not cross the surface, or with ``relative``, if the baseline has no thickness.

        Examples
        --------
        >>> from bspline_mdao import fit_grid
        >>> from bspline_mdao.generators import onera_m6_grid
        >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4)))
        >>> thickness = Thickness.at(surface, [[0.3, 0.0, 0.1], [0.5, 0.0, 0.3]])
        >>> thickness.evaluate(surface.points).round(3)
        array([0.082, 0.08 ])
        """
        direction = planform_normal(surface) if direction is None else as_numbers(direction, f"{name}: direction")
        shape = np.shape(points)[:-1]
        flat = as_points(np.reshape(points, (-1, 3)) if shape else points, name)
        entries, exits = opposite_probes(
            surface, flat, direction.reshape(-1, 3) if direction.ndim > 1 else direction, name
        )
        across = Combinations.of([exits.matrix(surface.n_points) - entries.matrix(surface.n_points)])
        baseline = lengths(across.vectors(surface.points)[0])
        if relative:
            _require_thickness(baseline, surface, flat, name)
        directions = np.broadcast_to(direction.reshape(-1, 3), flat.shape)
        directions = directions / lengths(directions)[:, None]
        scales = baseline if relative else np.ones(len(flat))
        return cls(surface, across, directions, scales, None if relative else "m", shape or (1,), name)

    @classmethod
    def grid(
        cls,
        surface: SurfaceGrid,
        n_chord: int,
        n_span: int | None = None,
        relative: bool = False,
        name: str = "thickness",
        *,
        leading: np.ndarray | None = None,
        trailing: np.ndarray | None = None,
        chord: tuple[float, float] = CHORD,
        span: tuple[float, float] = SPAN,
    ) -> Thickness:
        """Measure on a grid of lines, perpendicular to the ruled surface between two polylines.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        n_chord, n_span : int
            Number of lines along the chord and along the span, evenly spread from end to end. A single one along the
            span is in its middle, the default for a grid about a section (`SurfaceGrid.is_section`); for a wing the
            number must be given.
        relative, name
            As for `at`.
        leading, trailing : ndarray, shape (m, 3), optional
            Polylines within the body (m), slightly behind the leading and ahead of the trailing edge. By default they
            are found on the surface, see `within_edges`.
        chord, span : tuple of float
            Fractions of chord and span between which they are found: 0 is the leading edge and the root.

        Returns
        -------
        Thickness
            Measure with output of shape (n_span, n_chord).

        Raises
        ------
        InputError
            As `at`; also if a polyline has zero length, or fewer than two lines are requested in a direction.

        Examples
        --------
        >>> from bspline_mdao import fit_grid
        >>> from bspline_mdao.generators import onera_m6_grid
        >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((17, 17, 13)), n_control=(9, 8, 7)))
        >>> Thickness.grid(surface, n_chord=3, n_span=2).evaluate(surface.points).round(3)
        array([[0.058, 0.091, 0.012],
               [0.026, 0.04 , 0.005]])
        """
        if n_span is None:
            n_span = len(stations_or_middle(surface, None, name))
        if leading is None or trailing is None:
            found = within_edges(surface, chord, span, max(n_span, 2), name)
            leading, trailing = (line if line is not None else cut for line, cut in zip((leading, trailing), found))
        points = ruled_points(leading, trailing, n_chord, n_span if n_span != 1 else 3, name)
        normals, lines = ruled_normals(points), slice(1, 2) if n_span == 1 else slice(None)
        return cls.at(surface, points[lines], normals[lines], relative, name)

    @classmethod
    def of_sections(
        cls,
        surface: SurfaceGrid,
        parts: Sequence[float],
        stations: Sequence[float] | None = None,
        relative: bool = False,
        name: str = "thickness",
    ) -> Thickness:
        """Measure at chord fractions of plane sections, perpendicular to their chord lines.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        parts : sequence of float
            Fractions of the chord, between 0 at the leading and 1 at the trailing edge.
        stations : sequence of float, optional
            Fractions of the span; by default the middle for a grid about a section (`SurfaceGrid.is_section`).
        relative, name
            As for `at`.

        Returns
        -------
        Thickness
            Measure with output of shape (n_parts,) for a section without stations, else (n_stations, n_parts).

        Raises
        ------
        InputError
            As `at`; also if parts or stations are invalid.

        Examples
        --------
        >>> from bspline_mdao import fit_grid
        >>> from bspline_mdao.generators import naca_section, section_o_grid
        >>> surface = SurfaceGrid.of(fit_grid(section_o_grid(naca_section(0.12), 64, far=20.0)))
        >>> Thickness.of_sections(surface, [0.3, 0.6]).evaluate(surface.points).round(3)
        array([0.12 , 0.091])
        """
        places = as_numbers(parts, f"{name}: parts")
        if not (places.ndim == 1 and len(places) and ((places > 0.0) & (places < 1.0)).all()):
            raise InputError(f"{name}: parts {parts} of the chord; give numbers between 0 and 1")
        cuts = cuts_along_span(surface, list(stations_or_middle(surface, stations, name)))
        start, end = (probes.at(surface.points) for probes in section_edges(surface, cuts, name))
        across = np.cross([cut.normal for cut in cuts], end - start)
        points = start[:, None] + places[:, None] * (end - start)[:, None]
        directions = np.broadcast_to(across[:, None], points.shape)
        if stations is None:
            points, directions = points[0], directions[0]
        return cls.at(surface, points, directions, relative, name)

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Distances, in the shape of the output, from nodes, shape (n_points, 3)."""
        return (lengths(self.across.vectors(points)[0]) / self.scales).reshape(self.shape)

    def partials(self, points: np.ndarray) -> csr_array:
        """Derivatives of the distances, shape (n, 3 n_points), in C order."""
        along = unit_vectors(self.across.vectors(points)[0], self.directions, ROUND_OFF * self.surface.size)
        return self.across.chain([along / self.scales[:, None]])


def _require_thickness(baseline: np.ndarray, surface: SurfaceGrid, points: np.ndarray, name: str) -> None:
    """Refuse probes where the baseline has no thickness to divide by."""
    is_flat = baseline <= FLAT * surface.size
    if is_flat.any():
        number = int(np.argmax(is_flat))
        x, y, z = points[number]
        raise InputError(
            f"{name}: no thickness on the baseline at probe {number + 1} of {len(points)}, ({x:g}, {y:g}, {z:g}), "
            f"to be relative to; leave it out, or take relative=False"
        )


def within_edges(
    surface: SurfaceGrid,  # a wing
    # fractions of the chord, from leading edge (0) to trailing edge (1), and of the span, from root (0) to tip (1)
    chord: tuple[float, float] = CHORD,
    span: tuple[float, float] = SPAN,
    n: int = 9,  # sections, at least 2
    what: str = "edges",  # purpose of the lines, for messages
) -> tuple[np.ndarray, np.ndarray]:
    """Find the polylines at two chord fractions of plane sections across the span."""
    # returns leading, trailing (n, 3): points of the chord lines on the baseline (m), the root first
    for name, parts in (("chord", chord), ("span", span)):
        if len(parts) != 2 or not 0.0 <= parts[0] < parts[1] <= 1.0:
            raise InputError(f"{what}: {name} {parts}; give two rising parts of it within 0 to 1, such as (0.05, 0.95)")
    ends = section_edges(surface, cuts_along_span(surface, np.linspace(*span, n).tolist()), what)
    start, end = (probes.matrix(surface.n_points) @ surface.points for probes in ends)
    leading, trailing = (start + part * (end - start) for part in chord)
    return leading, trailing


def ruled_points(
    # polylines (m)
    leading: np.ndarray,  # (m, 3)
    trailing: np.ndarray,  # (m, 3)
    # points from one polyline to the other and along them, at least 2
    n_chord: int,
    n_span: int,
    what: str,  # purpose of the points, for messages
) -> np.ndarray:  # (n_span, n_chord, 3)
    """Spread points evenly on the ruled surface between two polylines: by arc length along these, straight between."""
    if min(n_chord, n_span) < 2:
        raise InputError(f"{what}: {n_chord} probes along the chord, {n_span} along the span; give at least 2")
    start = _divided(leading, n_span, f"{what}, leading")
    end = _divided(trailing, n_span, f"{what}, trailing")
    fractions = np.linspace(0.0, 1.0, n_chord)[:, None]
    return start[:, None] + fractions * (end - start)[:, None]


def ruled_normals(points: np.ndarray) -> np.ndarray:
    """Return normals of a ruled surface, of any length, at its points; both have the shape (n_span, n_chord, 3)."""
    return np.cross(np.gradient(points, axis=0), points[:, -1:] - points[:, :1])


def _divided(line: ArrayLike, n: int, what: str) -> np.ndarray:
    """Points at equal distances along a polyline."""
    line = as_points(line, what)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    if not arc[-1] > 0.0:
        raise InputError(f"{what}: a polyline without length; give two or more points")
    at = np.linspace(0.0, arc[-1], n)
    return np.stack([np.interp(at, arc, x) for x in line.T], axis=-1)
