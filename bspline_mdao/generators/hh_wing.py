"""Twelve-block H-H grids about a wing.

The blocks are upstream, wing and downstream of it (i), below and above (j), inboard and outboard of the tip (k)::

     y        far field                     block = stream + 3 above + 6 outboard, from 0
     |  +------+------+------+
     |  |  3   |  4   |  5   |  above        9  10  11  outboard
     |  +------<======>------+               the wing lies between blocks 1 and 4
     |  |  0   |  1   |  2   |  below        6   7   8  outboard
     |  +------+------+------+
     +------------------------- x            z along the span, symmetry plane z = 0

Every grid line along j starts on the sheet (`hh_sheets`). It leaves it in a direction between the wall's normal and the
vertical, bends into the vertical within a few tenths of a chord, and drifts towards its place at the outer boundary,
where the clustering is relaxed.
The grid is an explicit smooth function of one-dimensional distributions, so that it is alike at all resolutions.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ..errors import InputError
from ..topology.index_space import Window
from ..topology.multiblock import Block, Grid, Patch
from .hh_sheets import FarField, Layout, Sheet, Spacing, distance_from, edges, sheets
from .stretching import geometric_last, stretch
from .wing_surface import Wing

__all__ = ["FarField", "Spacing", "hh_wing_grid"]

_BEND = 0.1
"""Height, in root chords, over which a line bends from its direction at the wall into the vertical."""

_LAG = 0.05
"""Height, in root chords, below which intervals are measured along a slanted line rather than as heights."""

_SLIDE = 0.02
"""Height, in root chords, over which lines slide from the section's distribution of nodes to the chord's."""

_REACH = 8.0
"""Distance from a blunt edge, in its radii, over which the lines that leave the wall lean away from its normal."""

_FAN = 2.5
"""Growth of that distance with height."""

_ROWS = (("upstream", "wing", "downstream"), ("below", "above"), ("inboard", "outboard"))


def hh_wing_grid(
    wing: Wing, shape=(45, 65, 33), spacing: Spacing | None = None, far_field: FarField | None = None
) -> Grid:
    """Make the canonical twelve-block H-H grid about a wing.

    Parameters
    ----------
    wing : Wing
        The wing, its root in the plane z = 0, x downstream, y up.
    shape : tuple
        Nodes per block along the stream, away from the wing and along the span. Each is one count for all blocks, or
        one for each of upstream, wing, downstream; below, above; inboard, outboard.
    spacing : Spacing, optional
        Intervals next to the wing.
    far_field : FarField, optional
        Outer boundary.

    Returns
    -------
    Grid
        Patches ``wing_upper`` and ``wing_lower`` (wall), ``symmetry`` and ``farfield``. All blocks are right-handed.

    Raises
    ------
    InputError
        If the counts are too small or the spacings do not fit them.
    """
    layout = Layout(wing, *_counts(shape), spacing or Spacing(), far_field or FarField())
    rows = {side: sheets(layout, side) for side in (-1, 1)}
    nodes = [
        _extrude(rows[side][stream + 3 * outboard], side, layout.n_normal[side > 0], layout)
        for outboard, side, stream in product(range(2), (-1, 1), range(3))
    ]
    _join(nodes)
    names = [f"{stream} {side} {span}" for span, side, stream in product(*_ROWS[::-1])]
    blocks = tuple(Block(np.ascontiguousarray(x), name) for x, name in zip(nodes, names))
    return Grid(blocks, _patches([block.shape for block in blocks]), source="H-H wing grid")


def _join(nodes):
    """Copy what blocks share, in place, from the block of lower number: they come by it on different ways.

    Along the stream, then outboard, then upwards: what is copied before stays equal. The two sides of the wing share
    its leading edge, its trailing edge and its tip.
    """
    for b in range(12):
        if b % 3:
            nodes[b][0] = nodes[b - 1][-1]
        if b >= 6:
            nodes[b][:, :, 0] = nodes[b - 6][:, :, -1]
    for b in (3, 4, 5, 9, 10, 11):
        for part in (np.s_[0], np.s_[-1], np.s_[:, -1]) if b == 4 else (np.s_[:],):
            nodes[b][:, 0][part] = nodes[b - 3][:, -1][part]


def _counts(shape):
    """Nodes of every row of blocks in the three directions."""
    counts = []
    for row, given in zip(_ROWS, shape):
        count = tuple(int(n) for n in np.broadcast_to(given, len(row)))
        if min(count) < 5:
            raise InputError(f"H-H wing grid: {min(count)} nodes in a block along {'/'.join(row)}; give 5 at least")
        counts.append(count)
    return counts


def _extrude(sheet: Sheet, side: int, n: int, layout: Layout) -> np.ndarray:
    """Fill one block with lines from a sheet to the upper (side = 1) or lower (-1) boundary; shape (ni, n, nk, 3)."""
    chord, start = layout.wing.planform.root_chord, sheet.points[:, None]
    height = _heights(sheet, n, layout)
    up = height / layout.far.distance
    inner = 1.0 - _ramp(up)
    lean_x, lean_z = _lean(sheet, height, layout.wing)
    # further out the lines next to a blunt edge, which are slanted, do not lag behind the others
    lag = inner * _near(height, _LAG * chord) * (1.0 - 1.0 / np.sqrt(1.0 + lean_x**2 + lean_z**2))
    rise, wall = height * (1.0 - lag), inner * _near(height, _BEND * chord)
    slide = _near(height, _SLIDE * chord)[..., None]
    base = slide * start + (1.0 - slide) * sheet.plate[:, None]
    drift = sheet.far[:, None] - base
    nodes = np.empty((*height.shape, 3))
    nodes[..., 0] = base[..., 0] + drift[..., 0] * _outer(up, sheet.away_z[:, None]) + wall * rise * lean_x
    nodes[..., 1] = wall * start[..., 1] + side * rise
    nodes[..., 2] = base[..., 2] + drift[..., 2] * _outer(up, sheet.away_x[:, None]) + wall * rise * lean_z
    return nodes if side > 0 else nodes[:, ::-1]


def _heights(sheet, n, layout):
    """Lengths along the lines, shape (ni, n, nk): clustered at the wing, less so at the outer boundary."""
    far, off_wall = layout.far.distance, layout.spacing.off_wall
    near, relaxed = (
        far * _from_wall(n, interval / far)[:, None] for interval in (off_wall, layout.far.relaxation * off_wall)
    )
    return near + (relaxed - near) * _outer(sheet.away_x, sheet.away_z)[:, None]


def _lean(sheet, height, wing):
    """Direction (x, 1, z) in which lines leave the sheet: half-way between the normal and the vertical at a blunt edge.

    Lines that left a blunt leading edge along the tangent of the wall would give a valid grid, but a control mesh with
    inverted elements. The lean fades away from the edge, over a distance that grows with height, so that lines do not
    cross.
    """
    leading, tip = edges(wing)
    inside = (1.0 - _outer(sheet.away_x, sheet.away_z))[:, None]
    inboard = np.minimum(sheet.points[:, None, :, 2] / wing.planform.semi_span, 1.0) ** 2
    radii = wing.nose_radius, wing.tip_radius
    x, z = (_fade(distance_from(sheet.points, edge), radius, height) for edge, radius in zip((leading, tip), radii))
    return -inside * x, inside * inboard * z


def _fade(distance, radius, height):
    """1 at a blunt edge, 0 far away from it; 0 everywhere for a sharp one."""
    if radius == 0.0:
        return np.zeros_like(height)
    return _near(distance[:, None], _REACH * radius + _FAN * height)


def _from_wall(n, first):
    """Distribution from the wall to the outer boundary in near-geometric progression."""
    return stretch(n, first, geometric_last(n, first))


def _near(distance, reach):
    """1 at the wall, fading to 0 over a distance."""
    return 1.0 / (1.0 + (distance / reach) ** 2)


def _ramp(t):
    """Smooth step from 0 to 1 with level ends."""
    return t * t * (2.5 - t - 0.5 * t * t)


def _outer(s, t):
    """0 at the wing, 1 where either distance has reached the outer boundary."""
    return 1.0 - (1.0 - _ramp(s)) * (1.0 - _ramp(t))


def _patches(shapes):
    """Declare the wall, the symmetry plane and the far field."""
    faces = {"wing_upper": [(4, 2)], "wing_lower": [(1, 3)], "symmetry": [], "farfield": []}
    for block in range(12):
        stream, above, outboard = block % 3, (block // 3) % 2, block // 6
        if stream != 1:
            faces["farfield"].append((block, 0 if stream == 0 else 1))
        faces["farfield"].append((block, 2 + above))
        faces["farfield" if outboard else "symmetry"].append((block, 5 if outboard else 4))
    kinds = {"symmetry": "symmetry", "farfield": "farfield"}
    return tuple(
        Patch(name, kinds.get(name, "wall"), tuple(Window.whole(b, shapes[b]).face(face) for b, face in where))
        for name, where in faces.items()
    )
