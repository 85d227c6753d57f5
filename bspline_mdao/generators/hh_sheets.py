r"""The sheet of an H-H wing grid: the wing, and the plane y = 0 upstream, downstream and outboard of it.

Seen from above, a sheet is six patches of nodes, three along the stream inboard of the tip and three outboard::

    z   +----------+--------+------------+
    |   | 0        | 1      | 2          |   outboard
    |   +----------+========+------------+   tip
    |   | 0       /  1  wing \ 2         |   inboard
    |   +--------+===========+-----------+   symmetry plane
    +----------------------------------------- x
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .section import flat_section
from .stretching import geometric_last, stretch, stretch_lines
from .wing_surface import Wing, surface_grid

__all__ = ["FarField", "Layout", "Sheet", "Spacing", "sheets"]

_TURN = 0.05
"""Distance outboard of the tip, in tip chords, over which the lines of the wing turn out of its sweep."""


@dataclass(frozen=True)
class Spacing:
    """Intervals next to the wing (m).

    Parameters
    ----------
    off_wall : float
        First interval along the grid lines that leave the wing; near a blunt edge they come out up to 5 % shorter.
    leading, trailing, tip : float
        Intervals on both sides of the leading edge, the trailing edge and the tip, along the surface and away from it.
    root : float, optional
        Interval along the span at the symmetry plane; twice the mean interval by default.
    """

    off_wall: float = 1e-3
    leading: float = 1e-3
    trailing: float = 1e-3
    tip: float = 1e-3
    root: float | None = None

    def widened(self, factor: float) -> Spacing:
        """Make all intervals but the root's wider by a factor."""
        off_wall, leading, trailing, tip = (factor * h for h in (self.off_wall, self.leading, self.trailing, self.tip))
        return Spacing(off_wall, leading, trailing, tip, self.root)


@dataclass(frozen=True)
class FarField:
    """The outer boundary and the grid there.

    Parameters
    ----------
    distance : float
        From the wing to the outer boundary on all sides (m).
    spread : float
        How far the lines that leave the edges of the wing have moved outwards at the outer boundary (m).
    relaxation : float
        Intervals at the outer boundary over those next to the wing. Where it is not 1 the grid lines curve.
    """

    distance: float = 10.0
    spread: float = 0.05
    relaxation: float = 2.0


@dataclass(frozen=True)
class Layout:
    """What a grid is made of: the wing, the counts of every block row and the spacings."""

    wing: Wing
    n_stream: tuple[int, int, int]
    n_normal: tuple[int, int]
    n_span: tuple[int, int]
    spacing: Spacing
    far: FarField

    @property
    def root_interval(self) -> float:
        """Interval along the span at the symmetry plane."""
        return self.spacing.root or 2.0 * self.wing.planform.semi_span / (self.n_span[0] - 1)

    @property
    def inlet(self) -> float:
        """Coordinate x of the upstream boundary."""
        return min(0.0, self.wing.planform.x(0.0, self.wing.planform.semi_span)) - self.far.distance

    @property
    def outlet(self) -> float:
        """Coordinate x of the downstream boundary."""
        planform = self.wing.planform
        return max(planform.root_chord, planform.x(1.0, planform.semi_span)) + self.far.distance

    @property
    def side(self) -> float:
        """Coordinate z of the side boundary."""
        return self.wing.planform.semi_span + self.far.distance


@dataclass(frozen=True)
class Sheet:
    """One patch of the sheet: where the grid lines along j start, how they leave and where they are bound for.

    Parameters
    ----------
    points : ndarray, shape (ni, nk, 3)
        Nodes.
    plate : ndarray, shape (ni, nk, 3)
        Nodes of the same patch about a wing of the same planform without thickness.
    far : ndarray, shape (ni, nk, 3)
        Nodes of the patch about that plate with the spacings of the outer boundary.
    away_x, away_z : ndarray, shape (ni, nk)
        Distance from the wing along the stream and along the span: 0 at the wing, 1 at the boundary.
    """

    points: np.ndarray
    plate: np.ndarray
    far: np.ndarray
    away_x: np.ndarray
    away_z: np.ndarray


def sheets(layout: Layout, side: int) -> list[Sheet]:
    """Make the six patches of the upper (side = 1) or lower (-1) sheet: along the stream, inboard first."""
    plate = replace(layout.wing, section=flat_section(), tip_section=None)
    flat = _patches(layout, plate, side)
    relaxed = _patches(replace(layout, spacing=layout.spacing.widened(layout.far.relaxation)), plate, side)
    on_wing = [flat[0], _surface(layout, layout.wing, side), *flat[2:]]
    patches = []
    for n, points in enumerate(on_wing):
        far = relaxed[n] + layout.far.spread * _outwards(layout, relaxed, n)
        patches.append(Sheet(points, flat[n], far, *_away(layout, flat, n)))
    return patches


def _patches(layout, plate, side):
    """Nodes of the six patches about a wing without thickness."""
    inboard = _surface(layout, plate, side)
    patches = []
    for middle in (inboard, _outboard_patch(layout, inboard[:, -1])):
        patches += [_stream_patch(layout, middle[0], -1), middle, _stream_patch(layout, middle[-1], 1)]
    return patches


def _surface(layout, wing, side):
    s, counts = layout.spacing, (layout.n_stream[1], layout.n_span[0])
    return surface_grid(wing, side, counts, s.leading, s.trailing, layout.root_interval, s.tip)


def _outboard_patch(layout, tip):
    """Lines from the nodes of the tip to the side boundary; they turn out of the sweep into the z direction."""
    planform, far = layout.wing.planform, layout.far.distance
    out = far * _one_sided(layout.n_span[1], layout.spacing.tip / far)
    fraction = (tip[:, 0] - tip[0, 0]) / planform.tip_chord
    slope = planform.x(fraction, 1.0) - planform.x(fraction, 0.0)
    turn = _TURN * planform.tip_chord
    x = tip[:, :1] + slope[:, None] * turn * (1.0 - np.exp(-out / turn))
    return np.stack([x, np.zeros_like(x), np.broadcast_to(planform.semi_span + out, x.shape)], axis=-1)


def _stream_patch(layout, edge, direction):
    """Lines from the leading (direction = -1) or trailing (1) edge, (nk, 3), to the upstream or downstream boundary."""
    end = layout.inlet if direction < 0 else layout.outlet
    first = layout.spacing.leading if direction < 0 else layout.spacing.trailing
    length = np.abs(end - edge[:, 0])
    n = layout.n_stream[1 + direction]
    last = layout.far.distance * geometric_last(n, first / layout.far.distance)
    fractions = stretch_lines(length, n, first, last).T
    points = np.empty((n, *edge.shape))
    points[..., 0], points[..., 1:] = edge[:, 0] + direction * length * fractions, edge[:, 1:]
    points[-1, :, 0] = end
    return points if direction > 0 else points[::-1]


def _one_sided(n, first):
    """Distribution over [0, 1] from one given interval, in near-geometric progression."""
    return stretch(n, first, geometric_last(n, first))


def _away(layout, patches, n):
    """Distances of patch n from the wing along the stream and along the span: fractions of the way to the boundary."""
    points, zero = patches[n], np.zeros(patches[n].shape[:2])
    edge, end = (points[-1, :, 0], layout.inlet) if n % 3 == 0 else (points[0, :, 0], layout.outlet)
    away_x = zero if n % 3 == 1 else (points[..., 0] - edge) / (end - edge)
    away_z = (points[..., 2] - layout.wing.planform.semi_span) / layout.far.distance if n >= 3 else zero
    return away_x, away_z


def _outwards(layout, patches, n):
    """Displacement of patch n that moves the edges of the wing outwards by one and leaves the boundary in place."""
    points, (away_x, away_z) = patches[n], _away(layout, patches, n)
    move = np.zeros_like(points)
    if n % 3 == 1:
        x = points[..., 0]
        move[..., 0] = 2.0 * (x - x[0]) / (x[-1] - x[0]) - 1.0
    else:
        move[..., 0] = (1.0 - away_x) * (-1.0 if n % 3 == 0 else 1.0)
    move[..., 2] = 1.0 - away_z if n >= 3 else points[..., 2] / layout.wing.planform.semi_span
    return move


def edges(wing: Wing) -> tuple[np.ndarray, np.ndarray]:
    """Leading edge and tip as segments of the plane y = 0: ends (x, z), shape (2, 2) each."""
    planform, span = wing.planform, wing.planform.semi_span
    leading = np.array([[planform.x(0.0, z), z] for z in (0.0, span)])
    return leading, np.array([[planform.x(f, span), span] for f in (0.0, 1.0)])


def distance_from(points: np.ndarray, segment: np.ndarray) -> np.ndarray:
    """Distance of points (..., 3) from a segment of the plane y = 0."""
    start, along = segment[0], segment[1] - segment[0]
    offset = points[..., ::2] - start
    at = np.clip(offset @ along / (along @ along), 0.0, 1.0)
    return np.sqrt(np.sum((offset - at[..., None] * along) ** 2, axis=-1) + points[..., 1] ** 2)
