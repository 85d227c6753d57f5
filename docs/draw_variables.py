"""Draw what variables do to a wing and to a section, for the page on them.

``python docs/draw_variables.py`` writes ``docs/_static/planform_variables.png``: the wing of the ONERA M6, before in
gray and after in blue, with the axis and its stations; and ``section_variables.png``: the NACA 0012 in the same
colours, and below it what its upper side (blue) and its lower side (orange, wide) are moved by, enlarged.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from page_pictures import bare

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, GRAY, ORANGE, figure

STATIC = Path(__file__).parent / "_static"

CASES = (
    (bm.design.Twist, {"stations": 3}, (0.0, 6.0, 18.0), "Twist, 3 stations: 0, 6, 18 deg"),
    (bm.design.Chord, {"stations": 3}, (1.0, 1.3, 0.8), "Chord, 3 stations: 1, 1.3, 0.8"),
    (bm.design.Taper, {}, (0.4,), "Taper: 0.4"),
    (bm.design.ThicknessFactor, {"stations": 2}, (1.0, 3.0), "ThicknessFactor, 2 stations: 1, 3"),
    (bm.design.Camber, {"stations": 2}, (0.0, 0.15), "Camber, 2 stations: 0, 0.15 chords"),
    (bm.design.Span, {}, (1.3,), "Span: 1.3"),
    (bm.design.Sweep, {}, (15.0,), "Sweep: 15 deg"),
    (bm.design.Dihedral, {"stations": 2, "order": 2}, (0.0, 35.0), "Dihedral, 2 stations: 0, 35 deg"),
)
"""Variable, its settings, its values, and what stands above the panel."""

SECTIONS = (
    (
        bm.design.HicksHenne("v", (0.2, 0.5), sides="upper"),
        (0.02, -0.02),
        "HicksHenne, two above: 0.02, -0.02",
    ),
    (bm.design.HicksHenne("v", (0.4,), power=8.0), (0.02, 0.02), "HicksHenne at 0.4, power 8: 0.02, 0.02"),
    (bm.design.ClassShape("v", 3), (0.08, 0, 0, 0, 0, 0, 0), "ClassShape, first weight (nose): 0.08"),
    (bm.design.ClassShape("v", 2), (0, 0.1, 0, 0, 0.1), "ClassShape, weights above and below: 0.1"),
    (bm.design.CamberModes("v", 3), (0, 0, 0.03), "CamberModes, third of three: 0.03"),
    (bm.design.CamberModes("v", 2, trailing=True), (0, 0, -0.03), "CamberModes, trailing edge: -0.03"),
    (bm.design.ThicknessModes("v", 3, nose=False), (0, 0.04, 0), "ThicknessModes but the nose, second: 0.04"),
    (bm.design.CurvePoints("v", bm.design.Nearest((0.3, 0.06, 0.0))), (0.03,), "CurvePoints, one: 0.03"),
)
"""Variable of a section, its values, and what stands above the panel."""

ENLARGED, BELOW = 4.0, -0.2
"""Factor on the changes of a section, and the height at which they are drawn (chords)."""

VIEW = np.array([[0.80, 0.0, 0.42], [-0.28, 0.92, 0.50]])
"""Directions on paper, to the right and up, of stream, normal and span: from above, behind and outboard."""


def lines_of(mesh, points):
    """Lines of the control net along sections and span, of every block's faces on the surface."""
    rows = mesh.surface_rows
    for ids in mesh.blocks:
        for d in range(3):
            for end in (0, -1):
                face = rows[ids.take(end, axis=d)]
                if (face >= 0).all():
                    yield from (points[line] for line in (*face, *face.T))


def draw(axes, mesh, kind, settings, values, title):
    """Draw one panel."""
    axis = bm.design.ReferenceAxis.of(mesh)
    baseline = mesh.points[mesh.surface_ids]
    moved = bm.design.Parametrization(mesh, [kind("value", axis, **settings)]).apply(
        baseline, {"value": np.array(values)}
    )
    for points, color, width in ((baseline, GRAY, 0.5), (moved, BLUE, 0.8)):
        for line in lines_of(mesh, points):
            axes.plot(*(VIEW @ line.T), color=color, lw=width, alpha=0.8)
    axes.plot(*(VIEW @ axis.points.T), color=ORANGE, lw=1.6)
    places = bm.design.ReferenceAxis.of(mesh, n=max(len(values), 2)).points if len(values) > 1 else axis.points[[0, -1]]
    axes.plot(*(VIEW @ places.T), "o", color=ORANGE, ms=4)
    bare(axes, title.replace(": ", "\n"))


def draw_section(axes, section, variable, values, title):
    """Draw one panel of a section."""
    shape = section.parametrization([variable])
    baseline = section.mesh.points[section.mesh.surface_ids]
    points = section.mesh.points.copy()
    points[section.mesh.surface_ids] = shape.apply(baseline, {"v": np.array(values, dtype=float)})
    before, after = (section.model.regenerate(p).blocks[0].nodes[:, 0, 0, :2] for p in (section.mesh.points, points))
    for curve, color, width in ((before, GRAY, 0.8), (after, BLUE, 1.2)):
        axes.plot(*curve.T, color=color, lw=width)
    nose = int(np.argmin(before[:, 0]))
    for part, color, width in ((slice(nose + 1), ORANGE, 3.0), (slice(nose, None), BLUE, 1.0)):
        axes.plot(before[part, 0], BELOW + ENLARGED * (after - before)[part, 1], color=color, lw=width)
    axes.axhline(BELOW, color=GRAY, lw=0.5)
    bare(axes, title.replace(": ", "\n"))


def draw_sections():
    """Draw all panels of sections."""
    grid = bm.generators.section_o_grid(bm.generators.naca_section(0.12), 256, far=20.0)
    model = bm.fit_grid(grid, n_control=[(41, 13, 2)])
    section = bm.DesignSurface.of(model)
    with figure(STATIC, "section_variables", (9.5, 3.2), n_colours=64) as drawing:
        for panel, case in zip(drawing.subplots(2, 4, sharex=True, sharey=True).flat, SECTIONS, strict=True):
            draw_section(panel, section, *case)


def main():
    """Draw all panels."""
    draw_sections()
    mesh = bm.movers.moving_mesh(bm.fit_grid(bm.generators.onera_m6_grid((21, 17, 9)), n_control=(9, 9, 5)))
    with figure(STATIC, "planform_variables", (9.5, 4.0), n_colours=64) as drawing:
        for panel, case in zip(drawing.subplots(2, 4, sharex=True, sharey=True).flat, CASES, strict=True):
            draw(panel, mesh, *case)


if __name__ == "__main__":
    main()
