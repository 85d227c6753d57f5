"""Draw the picture of the landing page: pressures on the ONERA M6 at M 0.84, its shocks, and the grid that gives them.

``python docs/draw_landing.py`` writes ``docs/_static/landing.png``. It takes a minute.
"""

from __future__ import annotations

from pathlib import Path

import openmdao.api as om

from bspline_mdao import EulerFlow, GridMovement, fit_grid
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.plotting import plot

SHAPE = (17, 41, 17), (13, 13), (33, 9)
"""Nodes of the rows of blocks along the stream, away from the wing and along the span."""


def main() -> None:
    """Solve the flow and draw the wing in the plane of symmetry."""
    model = fit_grid(onera_m6_grid(SHAPE))
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("geometry", GridMovement(model=model, fit=False), promotes=["*"])
    problem.model.add_subsystem("flow", EulerFlow(model=model, reference_area=0.75), promotes=["*"])
    problem.model.set_input_defaults("Mach_number", val=0.84)
    problem.model.set_input_defaults("alpha", val=3.06, units="deg")
    problem.setup()
    problem.run_model()
    file = Path(__file__).parent / "_static" / "landing.png"
    plot(problem, ("walls", "symmetry", "Cp"), file, direction=(-0.75, 1.0, 0.9), zoom=0.9, size=(1600, 800))


if __name__ == "__main__":
    main()
