"""ADODG 3: twist of least induced drag.

Twist of least induced drag of a rectangular wing of aspect ratio 6: case 3 of the ADODG. The wing has NACA 0012
sections and a semi-span of 3 chords, at M 0.5 and a lift coefficient of 0.375. An elliptical load has an induced drag
of 0.00746. It takes five minutes by the Euler equations, with ``--quick`` or ``--flow vortex`` less, and many hours at
the paper's size. The output is lift, induced drag and twist at the start and at the optima, the same on a finer grid
that no optimiser saw, how the optimisers converged, a check of the totals, and a picture of the wing, its load and the
histories.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.drivers import disagreement, nlopt, recorded, run_at, scipy_slsqp
from bspline_mdao.plotting import draw_designs, figure
from bspline_mdao.scripts import pick_size, run
from bspline_mdao.testing import check_totals, perturb_design

PLANFORM = bm.generators.Planform(root_chord=1.0, semi_span=3.0)
MACH, LIFT = 0.5, 0.375
IDEAL = LIFT**2 / (np.pi * PLANFORM.aspect_ratio)
"""Induced drag of an elliptical load."""

WORST_CORNER = 0.05
"""What the worst cell must keep of its corner triple product of 1, by the bound of `Quality`."""

FINER = 1.5
"""Cells per direction of the member of the grid family that the optima are solved on again, relative to the grid's."""

FLOWS = {"euler": bm.EulerFlow, "vortex": bm.LatticeFlow}
DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_SLSQP": nlopt}

SIZES = {
    "quick": (((7, 9, 7), (7, 7), (9, 7)), ((5, 6, 5), (5, 5), (6, 5)), (0.03, 0.05, 0.05, 0.08, 0.5), 3, 1e-10),
    "default": (((9, 13, 9), (9, 9), (17, 9)), ((6, 7, 6), (5, 5), (9, 6)), (0.03, 0.03, 0.03, 0.08, 0.25), 3, 1e-10),
    "paper": (((17, 33, 17), (25, 25), (33, 17)), ((7, 11, 7), (9, 9), (13, 7)), (0.01, 0.01, 0.01, 0.02), 3, 1e-10),
}
"""Nodes and control points of the rows of blocks along the stream, away from the wing and along the span; spacing, see
`Spacing`; stations of the twist; and the tolerance of the objective, the drag relative to the ideal one."""


def make_model(shape, n_control, spacing) -> bm.FittedModel:
    """Make the grid about the wing and fit it."""
    stream, normal, span = n_control
    counts = [(i, j, k) for k, j, i in product(span, normal, stream)]
    grid = bm.generators.hh_wing_grid(
        bm.generators.Wing(PLANFORM, bm.generators.naca_section(0.12)), shape, bm.generators.Spacing(*spacing)
    )
    return bm.fit_grid(grid, n_control=counts)


def pose(model: bm.FittedModel, stations: int, flow: str) -> om.Problem:
    """Pose the problem: angle of attack, and twist outboard of the root. Not yet set up.

    The wing is twisted about its trailing edge, so that the trace of the wake stays straight.
    """
    mesh = bm.movers.moving_mesh(model)
    twist = bm.design.Twist("twist", bm.design.ReferenceAxis.of(mesh, at=1.0), stations)
    mover = bm.movers.LinearElasticity(mesh, n_increments=3)
    geometry = bm.GridMovement(
        model=model, parametrization=bm.design.Parametrization(mesh, [twist]), mover=mover, fit=False
    )
    area = PLANFORM.root_chord * PLANFORM.semi_span

    problem = om.Problem(reports=None)
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    problem.model.add_subsystem("flow", FLOWS[flow](model=model, reference_area=area), promotes=["*"])
    problem.model.set_input_defaults("Mach_number", val=MACH)
    problem.model.set_input_defaults("alpha", val=4.0, units="deg")
    problem.model.add_design_var("alpha", lower=0.0, upper=10.0, ref=3.0, units="deg")
    problem.model.add_design_var("twist", indices=range(1, stations), lower=-10.0, upper=10.0, ref=3.0, units="deg")
    problem.model.add_constraint("CL", equals=LIFT, ref=LIFT)
    problem.model.add_constraint("corner_ks", lower=WORST_CORNER)
    problem.model.add_objective("CD_induced", ref=IDEAL)
    return problem


def main(
    paper: bool = False,
    figures=None,
    flow: Literal["euler", "vortex"] = "euler",
    quick: bool = False,
    drivers=DRIVERS,
) -> dict:
    """Find the twist with every driver.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`.
    figures : path-like, optional
        Folder for ``twist_induced_drag.png``, the N2 diagram ``twist_induced_drag.html`` and the recorded cases.
    flow : {"euler", "vortex"}
        Euler equations or vortex lattice.
    drivers : dict
        Makers of drivers by name.

    Returns
    -------
    dict
        ``totals``, see `check_totals`; `aerodynamics` of the ``initial`` wing, with those ``finer``, on the finer grid;
        for each of the ``drivers`` the same and what `RecordedRun.numbers` returns; by how much the drivers ``differ``,
        see `disagreement`.
    """
    *size, stations, tolerance = pick_size(SIZES, paper, quick)
    model, name = make_model(*size), "twist_induced_drag"
    start = pose(model, stations, flow)
    start.setup(mode="rev")
    start.run_model()
    runs = {}
    for driver, make_driver in drivers.items():
        problem = pose(model, stations, flow)
        problem.driver = make_driver(tolerance, 50)
        with recorded(problem, figures, f"{name}_{driver}") as runs[driver]:
            problem.run_driver()

    def summary(problem: om.Problem) -> dict:
        finer = run_at(problem, pose(model.member(FINER), stations, flow))
        return aerodynamics(problem) | {"finer": aerodynamics(finer)}

    if figures:
        with figure(figures, name, (9.5, 9.0), n_colours=256) as canvas:
            draw_designs(canvas, model, start, runs, "CD_induced", "induced drag relative to the ellipse's", IDEAL)
        om.n2(start, outfile=str(Path(figures) / f"{name}.html"), show_browser=False)
    return {
        "n_nodes": model.n_nodes,
        "initial": summary(start),
        "drivers": {name: each.numbers("flow") | summary(each.problem) for name, each in runs.items()},
        "differ": disagreement(runs),
        "totals": check_totals(perturb_design(start), n_directions=1, step=0.05, levels=2)._asdict(),
    }


def aerodynamics(problem: om.Problem) -> dict:
    """Lift, induced drag, by how much it is above the ellipse's at the same lift, angle of attack and twist."""
    lift, drag = (problem.get_val(name).item() for name in ("CL", "CD_induced"))
    return {
        "CL": lift,
        "CD_induced": drag,
        "above_ideal": drag / (IDEAL * (lift / LIFT) ** 2) - 1.0,
        "alpha": problem.get_val("alpha", units="deg").item(),
        "twist": problem.get_val("twist", units="deg").copy(),
    }


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/twist_induced_drag.png'
