"""Draw what the variables along an axis do to a wing, for the page on them.

``python docs/draw_variables.py`` writes ``docs/_static/planform_variables.png``: the wing of the ONERA M6, before in
gray and after in blue, with the axis and its stations.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, GRAY, ORANGE

PICTURE = Path(__file__).parent / "_static" / "planform_variables.png"

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
    axes.set_title(title, fontsize=10)
    axes.set_aspect("equal")
    axes.axis("off")


def main():
    """Draw all panels."""
    mesh = bm.movers.moving_mesh(bm.fit_grid(bm.generators.onera_m6_grid((21, 17, 9)), n_control=(9, 9, 5)))
    figure, panels = plt.subplots(2, 4, figsize=(13, 4.6), sharex=True, sharey=True)
    for panel, case in zip(panels.flat, CASES, strict=True):
        draw(panel, mesh, *case)
    figure.tight_layout()
    figure.savefig(PICTURE, dpi=110)


if __name__ == "__main__":
    main()
