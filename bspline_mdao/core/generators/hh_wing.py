r"""Twelve-block H-H grids about a wing, and grids at their root, one cell deep about a section.

The blocks are upstream, at the wing and downstream (i), below and above (j), inboard and outboard of the tip (k)::

     y        far field                     block = stream + 3 above + 6 outboard, from 0
     |  +------+------+------+
     |  |  3   |  4   |  5   |  above        9  10  11  outboard
     |  +------<======>------+               the wing lies between blocks 1 and 4
     |  |  0   |  1   |  2   |  below        6   7   8  outboard
     |  +------+------+------+
     +------------------------- x            z along the span, symmetry plane z = 0

Every grid line along j starts on the *base surface*: the wing, and the plane y = 0 upstream, downstream and outboard of
it. Seen from above, these are six patches of nodes, three along the stream inboard of the tip and three outboard::

    z   +----------+--------+------------+
    |   | 3        | 4      | 5          |   outboard
    |   +----------+========+------------+   tip
    |   | 0       /  1  wing \ 2         |   inboard
    |   +--------+===========+-----------+   symmetry plane
    +----------------------------------------- x

The line leaves the surface in a direction between the wall's normal and the vertical, bends into the vertical within a
few tenths of a chord, and drifts towards its place at the outer boundary, where the clustering is relaxed. The grid is
an explicit smooth function of one-dimensional distributions, so grids of all resolutions are similar.

Theory: ``docs/theory/generators.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from ...errors import InputError
from ...grids.topology.grid import Block, Grid, Patch
from ...grids.topology.index_space import Window
from .stretching import geometric_last, stretch, stretch_from, stretch_lines
from .wing import Planform, Section, Wing, flat_section, surface_grid
from .wing_spacing import FarField, Spacing, default_spacing

_INBOARD = 6
"""Blocks of the wing's grid inboard of the tip."""

_PANEL = 3
"""Least number of cells along the span of each panel, for splines of order four."""

_TURN = 0.05
"""Distance outboard of the tip, in tip chords, over which the lines of the wing turn out of its sweep."""

_BEND = 0.1
"""Height, in root chords, over which a line bends from its direction at the wall into the vertical."""

_LAG = 0.05
"""Height, in root chords, below which intervals are measured along a slanted line rather than vertically."""

_SLIDE = 0.02
"""Height, in root chords, over which lines slide from the section's distribution of nodes to the chord's."""

_REACH = 8.0
"""Distance from a blunt edge, in its radii, over which lines that leave the wall lean away from its normal."""

_FAN = 2.5
"""Growth of this distance with height."""

_ROWS = (("upstream", "wing", "downstream"), ("below", "above"), ("inboard", "outboard"))


def hh_wing_grid(
    wing: Wing,
    shape: Sequence[int | Sequence[int]] = (45, 65, 33),
    spacing: Spacing | None = None,
    far_field: FarField | None = None,
) -> Grid:
    """Make the canonical H-H grid about a wing, with twelve blocks if the wing has no kink.

    Parameters
    ----------
    wing : Wing
        The wing, its root in the plane z = 0, x downstream, y up.
    shape : tuple
        Nodes per block along the stream, away from the wing and along the span. Each is one number for all blocks, or
        one for each of upstream, wing, downstream; below, above; inboard, outboard.
    spacing : Spacing, optional
        Intervals next to the wing. By default a thousandth of the root chord, as for the paper's M6 with 45 x 65 x 33
        nodes per block, and wider in proportion on coarser grids, where cells would otherwise grow too fast.
    far_field : FarField, optional
        Outer boundary, 10 root chords away by default.

    Returns
    -------
    Grid
        Twelve blocks, and six more for each kink of the planform, which nodes and edges of blocks meet exactly. Patches
        are ``wing_upper`` and ``wing_lower`` (wall), ``symmetry`` and ``farfield``. All blocks are right-handed.

    Raises
    ------
    InputError
        If the counts are too small or the spacings do not fit them.

    Examples
    --------
    >>> from bspline_mdao.generators import Planform, Wing, hh_wing_grid, naca_section
    >>> wing = Wing(Planform(root_chord=1.0, semi_span=3.0, taper=0.5), naca_section(0.12))
    >>> hh_wing_grid(wing, (5, 5, 5)).n_nodes
    1500
    """
    n_stream, n_normal, n_span = _counts(shape)
    chord = wing.planform.root_chord
    spacing = spacing or default_spacing(chord, shape)
    far_field = far_field or FarField(10.0 * chord, 0.05 * chord)
    layout = _Layout(wing, n_stream, n_normal, n_span, spacing, far_field, _kink_nodes(wing, n_span[0], spacing))
    rows = {side: _base_patches(layout, side) for side in (-1, 1)}
    nodes = [
        _extrude(rows[side][n + 3 * outboard], side, layout.n_normal[side > 0], layout)
        for outboard, side, n in product(range(2), (-1, 1), range(3))
    ]
    _join(nodes)
    ends = [0, *layout.kink_nodes, n_span[0] - 1]
    panels = [x[:, :, a : b + 1] for a, b in pairwise(ends) for x in nodes[:_INBOARD]]
    across = [f"panel {number}" for number in range(1, len(ends))] if layout.kink_nodes else ["inboard"]
    names = [f"{along} {side} {row}" for row, side, along in product([*across, "outboard"], *_ROWS[1::-1])]
    blocks = tuple(Block(np.ascontiguousarray(x), name) for x, name in zip([*panels, *nodes[_INBOARD:]], names))
    return Grid(blocks, _patches([block.shape for block in blocks]), source="H-H wing grid")


def infinite_wing_grid(
    section: Section,
    shape: Sequence[int | Sequence[int]] = (33, 25),
    spacing: Spacing | None = None,
    far_field: FarField | None = None,
) -> Grid:
    """Make the grid at the root of a rectangular wing of unit chord, between two planes of symmetry.

    Parameters
    ----------
    section : Section
        Section of the wing.
    shape : tuple
        Nodes per block along the stream and away from the wing, as in `hh_wing_grid`.
    spacing : Spacing, optional
        Intervals next to the wing, by default as in `hh_wing_grid`; intervals along the span do not matter.
    far_field : FarField, optional
        Outer boundary, 10 chords away by default.

    Returns
    -------
    Grid
        Six blocks from z = 0 to z = 1 with the patches of `hh_wing_grid`. With a reference area of 1, coefficients are
        the section's.

    Raises
    ------
    InputError
        If the counts are too small or the spacings do not fit them.

    Examples
    --------
    >>> from bspline_mdao.generators import infinite_wing_grid, naca_section
    >>> grid = infinite_wing_grid(naca_section(0.12), (17, 9))  # one cell deep
    >>> grid.shapes[0]
    (17, 9, 2)
    """
    wing = Wing(Planform(root_chord=1.0, semi_span=3.0), section)
    whole = hh_wing_grid(wing, (*shape, 9), spacing, far_field)
    blocks = tuple(Block(_between_planes(block.nodes[:, :, 0]), block.name) for block in whole.blocks[:_INBOARD])
    patches = tuple(replace(patch, windows=_one_deep(patch.windows, patch.kind)) for patch in whole.patches)
    return Grid(blocks, patches, source="H-H grid of a section")


def _counts(shape: Sequence[int | Sequence[int]]) -> list[tuple[int, ...]]:
    """Nodes of every row of blocks in the three directions."""
    counts = []
    for row, given in zip(_ROWS, shape):
        count = tuple(int(n) for n in np.broadcast_to(given, len(row)))
        if min(count) < 5:
            raise InputError(f"H-H wing grid: {min(count)} nodes in a block along {'/'.join(row)}; give 5 at least")
        counts.append(count)
    return counts


def _root_interval(wing: Wing, n_span: int, spacing: Spacing) -> float:
    """Interval along the span at the symmetry plane."""
    return spacing.root or 2.0 * wing.planform.semi_span / (n_span - 1)


def _kink_nodes(wing: Wing, n_span: int, spacing: Spacing) -> tuple[int, ...]:
    """Numbers along the span of the nodes at the kinks: the nearest ones that leave each panel some cells."""
    planform = wing.planform
    if not planform.kinks:
        return ()
    n_panels = len(planform.kinks) + 1
    if n_span - 1 < _PANEL * n_panels:
        raise InputError(
            f"H-H wing grid: {n_span} nodes along {n_panels} panels; give {_PANEL * n_panels + 1} at least"
        )
    ends = np.array([_root_interval(wing, n_span, spacing), spacing.tip]) / planform.semi_span
    natural = stretch(n_span, *ends) * planform.semi_span
    numbers = np.rint(np.interp(planform.kinks, natural, np.arange(n_span))).astype(int)
    shift = _PANEL * np.arange(1, n_panels)
    numbers = np.maximum.accumulate(np.maximum(numbers - shift, 0)) + shift
    room = n_span - 1 - _PANEL * n_panels
    return tuple(np.minimum(numbers, room + shift).tolist())


def _join(nodes: list[np.ndarray]) -> None:
    """Copy shared nodes, in place, from the block of lower number: blocks compute them in different ways."""
    # Along the stream, then outboard, then upwards: nodes copied earlier stay equal. The two sides of the wing share
    # its leading edge, its trailing edge and its tip.
    for b in range(12):
        if b % 3:
            nodes[b][0] = nodes[b - 1][-1]
        if b >= 6:
            nodes[b][:, :, 0] = nodes[b - 6][:, :, -1]
    for b in (3, 4, 5, 9, 10, 11):
        for part in (np.s_[0], np.s_[-1], np.s_[:, -1]) if b == 4 else (np.s_[:],):
            nodes[b][:, 0][part] = nodes[b - 3][:, -1][part]


def _patches(shapes: Sequence[tuple[int, ...]]) -> tuple[Patch, ...]:
    """Declare the wall, the symmetry plane and the far field."""
    faces: dict[str, list[tuple[int, int]]] = {"wing_upper": [], "wing_lower": [], "symmetry": [], "farfield": []}
    outboard = len(shapes) - _INBOARD
    for block in range(len(shapes)):
        stream, above = block % 3, (block // 3) % 2
        if stream != 1:
            faces["farfield"].append((block, 0 if stream == 0 else 1))
        elif block < outboard:
            faces["wing_upper" if above else "wing_lower"].append((block, 3 - above))
        faces["farfield"].append((block, 2 + above))
        if block < _INBOARD or block >= outboard:
            faces["farfield" if block >= outboard else "symmetry"].append((block, 5 if block >= outboard else 4))
    kinds = {"symmetry": "symmetry", "farfield": "farfield"}
    return tuple(
        Patch(name, kinds.get(name, "wall"), tuple(Window.whole(b, shapes[b]).face(face) for b, face in where))
        for name, where in faces.items()
    )


def _between_planes(nodes: np.ndarray) -> np.ndarray:
    """Nodes of one cell along the span, shape (ni, nj, 2, 3), from the nodes at the root."""
    return np.stack([nodes * [1.0, 1.0, 0.0] + [0.0, 0.0, z] for z in (0.0, 1.0)], axis=2)


def _one_deep(windows: Sequence[Window], kind: str) -> tuple[Window, ...]:
    """Faces of the inboard blocks; both faces for symmetry planes."""
    ends = ((0, 0), (1, 1)) if kind == "symmetry" else ((0, 1),)
    return tuple(
        Window(window.block, (*window.lo[:2], low), (*window.hi[:2], high))
        for window in windows
        if window.block < _INBOARD
        for low, high in ends
    )


@dataclass(frozen=True)
class _Layout:
    """Wing, counts of every block row and spacings of a grid."""

    wing: Wing
    n_stream: tuple[int, ...]
    n_normal: tuple[int, ...]
    n_span: tuple[int, ...]
    spacing: Spacing
    far: FarField
    kink_nodes: tuple[int, ...]  # numbers along the span of the nodes at the kinks of the planform

    @property
    def root_interval(self) -> float:
        """Interval along the span at the symmetry plane."""
        return _root_interval(self.wing, self.n_span[0], self.spacing)

    @property
    def inlet(self) -> float:
        """Coordinate x of the upstream boundary."""
        return min(self.wing.planform.x(0.0, z) for z in self.ends) - self.far.distance

    @property
    def outlet(self) -> float:
        """Coordinate x of the downstream boundary."""
        return max(self.wing.planform.x(1.0, z) for z in self.ends) + self.far.distance

    @property
    def ends(self) -> tuple[float, ...]:
        """Span positions of the ends of panels."""
        return (0.0, *self.wing.planform.kinks, self.wing.planform.semi_span)

    @property
    def side(self) -> float:
        """Coordinate z of the side boundary."""
        return self.wing.planform.semi_span + self.far.distance


@dataclass(frozen=True)
class _BasePatch:
    """One patch of the base surface: start, direction and target of the grid lines along j."""

    points: np.ndarray  # (ni, nk, 3), nodes
    plate: np.ndarray  # (ni, nk, 3), nodes of the same patch about a wing of equal planform without thickness
    far: np.ndarray  # (ni, nk, 3), nodes of the patch about this plate with the spacings of the outer boundary
    # distance from the wing along the stream and along the span: 0 at the wing, 1 at the boundary
    away_x: np.ndarray  # (ni, nk)
    away_z: np.ndarray  # (ni, nk)


def _base_patches(layout: _Layout, side: int) -> list[_BasePatch]:
    """Make the six patches of the upper (side = 1) or lower (-1) base surface: along the stream, inboard first."""
    plate = replace(layout.wing, section=flat_section(), tip_section=None, sections_between=())
    flat = _plane_patches(layout, plate, side)
    relaxed = _plane_patches(replace(layout, spacing=layout.spacing.widened(layout.far.relaxation)), plate, side)
    on_wing = [flat[0], _surface(layout, layout.wing, side), *flat[2:]]
    patches = []
    for n, points in enumerate(on_wing):
        far = relaxed[n] + layout.far.spread * _outwards(layout, relaxed, n)
        patches.append(_BasePatch(points, flat[n], far, *_away(layout, flat, n)))
    return patches


def _plane_patches(layout: _Layout, plate: Wing, side: int) -> list[np.ndarray]:
    """Nodes of the six patches about a wing without thickness."""
    inboard = _surface(layout, plate, side)
    patches = []
    for middle in (inboard, _outboard_patch(layout, inboard[:, -1])):
        patches += [_stream_patch(layout, middle[0], -1), middle, _stream_patch(layout, middle[-1], 1)]
    return patches


def _surface(layout: _Layout, wing: Wing, side: int) -> np.ndarray:
    s, counts = layout.spacing, (layout.n_stream[1], layout.n_span[0])
    return surface_grid(wing, side, counts, s.leading, s.trailing, layout.root_interval, s.tip, layout.kink_nodes)


def _outboard_patch(layout: _Layout, tip: np.ndarray) -> np.ndarray:
    """Lines from the nodes of the tip to the side boundary, which turn from the sweep into the z direction."""
    planform, far = layout.wing.planform, layout.far.distance
    out = far * stretch_from(layout.n_span[1], layout.spacing.tip / far)
    fraction = (tip[:, 0] - tip[0, 0]) / planform.tip_chord
    slope = planform.slope_at_tip(fraction)
    turn = _TURN * planform.tip_chord
    x = tip[:, :1] + slope[:, None] * turn * (1.0 - np.exp(-out / turn))
    return np.stack([x, np.zeros_like(x), np.broadcast_to(planform.semi_span + out, x.shape)], axis=-1)


def _stream_patch(layout: _Layout, edge: np.ndarray, direction: int) -> np.ndarray:
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


def _away(layout: _Layout, patches: Sequence[np.ndarray], n: int) -> tuple[np.ndarray, np.ndarray]:
    """Distances of patch n from the wing along the stream and the span, as fractions of the boundary's distance."""
    points, zero = patches[n], np.zeros(patches[n].shape[:2])
    edge, end = (points[-1, :, 0], layout.inlet) if n % 3 == 0 else (points[0, :, 0], layout.outlet)
    away_x = zero if n % 3 == 1 else (points[..., 0] - edge) / (end - edge)
    away_z = (points[..., 2] - layout.wing.planform.semi_span) / layout.far.distance if n >= 3 else zero
    return away_x, away_z


def _outwards(layout: _Layout, patches: Sequence[np.ndarray], n: int) -> np.ndarray:
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


def _extrude(base: _BasePatch, side: int, n: int, layout: _Layout) -> np.ndarray:
    """Nodes of one block, shape (ni, n, nk, 3): lines from the base surface to the upper (side 1) or lower boundary."""
    chord, start = layout.wing.planform.root_chord, base.points[:, None]
    height = _heights(base, n, layout)
    up = height / layout.far.distance
    inner = 1.0 - _ramp(up)
    lean_x, lean_z = _lean(base, height, layout.wing)
    # farther out, the slanted lines next to a blunt edge do not lag behind the others
    lag = inner * _near(height, _LAG * chord) * (1.0 - 1.0 / np.sqrt(1.0 + lean_x**2 + lean_z**2))
    rise, wall = height * (1.0 - lag), inner * _near(height, _BEND * chord)
    slide = _near(height, _SLIDE * chord)[..., None]
    foot = slide * start + (1.0 - slide) * base.plate[:, None]
    drift = base.far[:, None] - foot
    nodes = np.empty((*height.shape, 3))
    nodes[..., 0] = foot[..., 0] + drift[..., 0] * _outer(up, base.away_z[:, None]) + wall * rise * lean_x
    nodes[..., 1] = wall * start[..., 1] + side * rise
    nodes[..., 2] = foot[..., 2] + drift[..., 2] * _outer(up, base.away_x[:, None]) + wall * rise * lean_z
    return nodes if side > 0 else nodes[:, ::-1]


def _heights(base: _BasePatch, n: int, layout: _Layout) -> np.ndarray:
    """Lengths along the lines, shape (ni, n, nk): clustered at the wing, less so at the outer boundary."""
    far, off_wall = layout.far.distance, layout.spacing.off_wall
    near, relaxed = (
        far * stretch_from(n, interval / far)[:, None] for interval in (off_wall, layout.far.relaxation * off_wall)
    )
    return near + (relaxed - near) * _outer(base.away_x, base.away_z)[:, None]


def _lean(base: _BasePatch, height: np.ndarray, wing: Wing) -> tuple[np.ndarray, np.ndarray]:
    """Direction (x, 1, z) in which lines leave the base surface: at a blunt edge half-way from normal to vertical."""
    # Lines that left a blunt leading edge along the tangent of the wall would give a valid grid, but a control mesh
    # with inverted elements. The lean fades away from the edge, over a distance that grows with height, so lines do not
    # cross.
    leading, tip = _edges(wing)
    inside = (1.0 - _outer(base.away_x, base.away_z))[:, None]
    inboard = np.minimum(base.points[:, None, :, 2] / wing.planform.semi_span, 1.0) ** 2
    radii = wing.nose_radius, wing.tip_radius
    distances = [np.min([_distance_from(base.points, part) for part in edge], axis=0) for edge in (leading, tip)]
    x, z = (_fade(distance, radius, height) for distance, radius in zip(distances, radii))
    return -inside * x, inside * inboard * z


def _edges(wing: Wing) -> tuple[np.ndarray, ...]:
    """Leading edge and tip as segments of the plane y = 0: ends (x, z), shape (n, 2, 2) each."""
    planform, span = wing.planform, wing.planform.semi_span
    leading = np.array([[planform.x(0.0, z), z] for z in (0.0, *planform.kinks, span)])
    tip = np.array([[[planform.x(f, span), span] for f in (0.0, 1.0)]])
    return np.stack([leading[:-1], leading[1:]], axis=1), tip


def _distance_from(points: np.ndarray, segment: np.ndarray) -> np.ndarray:
    """Distance of points (..., 3) from a segment of the plane y = 0."""
    start, along = segment[0], segment[1] - segment[0]
    offset = points[..., ::2] - start
    at = np.clip(offset @ along / (along @ along), 0.0, 1.0)
    return np.sqrt(np.sum((offset - at[..., None] * along) ** 2, axis=-1) + points[..., 1] ** 2)


def _fade(distance: np.ndarray, radius: float, height: np.ndarray) -> np.ndarray:
    """1 at a blunt edge, 0 far away from it; 0 everywhere for a sharp edge."""
    if radius == 0.0:
        return np.zeros_like(height)
    return _near(distance[:, None], _REACH * radius + _FAN * height)


def _near(distance: np.ndarray, reach: np.ndarray | float) -> np.ndarray:
    """1 at the wall, fading to 0 over a distance."""
    return 1.0 / (1.0 + (distance / reach) ** 2)


def _ramp(t: np.ndarray) -> np.ndarray:
    """Smooth step from 0 to 1 with level ends."""
    return t * t * (2.5 - t - 0.5 * t * t)


def _outer(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    """0 at the wing, 1 where either distance has reached the outer boundary."""
    return 1.0 - (1.0 - _ramp(s)) * (1.0 - _ramp(t))
