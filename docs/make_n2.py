"""Write N2 diagrams of the problems that pages show, as OpenMDAO draws them: ``python docs/make_n2.py FOLDER``."""

from __future__ import annotations

import sys
from pathlib import Path

import openmdao.api as om

import bspline_mdao as bm


def chain(wing: bm.DesignSurface) -> om.Problem:
    """The group alone: fit, move, evaluate, quality."""
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("grid_movement", bm.GridMovement(model=wing.model), promotes=["*"])
    return problem


def optimisation(wing: bm.DesignSurface) -> om.Problem:
    """Design variables, a measure, the moved grid, its quality and a flow."""
    problem = om.Problem(reports=None)
    volume = bm.measures.EnclosedVolume.of(wing.surface, relative=True)
    shape = wing.grid_movement([bm.design.Twist("twist", wing.axis, stations=3)], measures=[volume], fit=False)
    flow = bm.EulerFlow(model=wing.model, reference_area=wing.planform_area, trim=True)
    problem.model.add_subsystem("shape", shape, promotes=["*"])
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.model.add_design_var("twist")
    problem.model.add_constraint("volume", lower=1.0)
    problem.model.add_objective("CD_induced")
    return problem


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    wing = bm.DesignSurface.of(bm.fit_grid(bm.generators.onera_m6_grid((9, 8, 7))))
    for make in chain, optimisation:
        problem = make(wing)
        problem.setup()
        problem.final_setup()
        om.n2(problem, outfile=str(folder / f"n2_{make.__name__}.html"), show_browser=False, title=make.__name__)
