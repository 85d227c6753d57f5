"""Draw the pictures of the page on seeing grids and flows.

``python docs/draw_seeing.py`` writes ``docs/_static/seeing_model.png``, ``seeing_quality.png`` and ``seeing_cp.png``:
the ONERA M6 with its control mesh, the quality of its cells, and its pressures at M 0.84 before and after its tip is
turned nose down by 4 degrees. It takes half a minute.
"""

from __future__ import annotations

from pathlib import Path

import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.flow import Snapshot
from bspline_mdao.plotting import plot
from bspline_mdao.studio.plotting.figures import reduce_colours

STATIC = Path(__file__).parent / "_static"

SHAPE = (15, 25, 13), (13, 13), (17, 9)
"""Nodes of the rows of blocks of the grid in the flow along the stream, away from the wing and along the span."""

TWIST = 0.0, -4.0
"""Twist at root and tip (deg)."""


def main() -> None:
    """Draw all three."""
    model = bm.fit_grid(bm.generators.onera_m6_grid((15, 13, 11)))
    size = {"size": (900, 560)}
    model.plot(("walls", "symmetry", "control mesh"), STATIC / "seeing_model.png", **size)
    model.plot("quality", STATIC / "seeing_quality.png", **size)
    draw_flow(bm.fit_grid(bm.generators.onera_m6_grid(SHAPE)))
    for name in ("seeing_model", "seeing_quality", "seeing_cp"):
        reduce_colours(STATIC / f"{name}.png", 256)


def draw_flow(model: bm.FittedModel) -> None:
    """Draw the pressures of the wing before and after the twist."""
    mesh = bm.movers.moving_mesh(model)
    twist = bm.design.Twist("twist", bm.design.ReferenceAxis.of(mesh), len(TWIST))
    moved = bm.GridMovement(model=model, parametrization=bm.design.Parametrization(mesh, [twist]), fit=False)
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("geometry", moved, promotes=["*"])
    problem.model.add_subsystem("flow", bm.EulerFlow(model=model, reference_area=0.75), promotes=["*"])
    problem.model.set_input_defaults("Mach_number", val=0.84)
    problem.model.set_input_defaults("alpha", val=3.06, units="deg")
    problem.setup()
    problem.run_model()
    before = Snapshot.of(problem, "before")
    problem.set_val("twist", TWIST, units="deg")
    problem.run_model()
    plot(problem, "Cp", STATIC / "seeing_cp.png", before=before, size=(800, 533))


if __name__ == "__main__":
    main()
