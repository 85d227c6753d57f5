"""ONERA M6: least drag at fixed lift.

Least drag of the ONERA M6 at fixed lift: sections, twist, chord and sweep, with thickness, volume and area kept. By the
Euler equations, heights of control points are moved in combinations along which the pressures change evenly. It takes
five minutes, with ``--quick`` a minute and with ``--flow vortex`` less. The output is forces and variables at the start
and at the optima, the same on a finer grid that no optimiser saw, how the optimisers converged, a check of the totals,
and a picture of the wing, its load and the histories.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.design import Chord, Local, OnPatch, Parametrization, ReferenceAxis, Sweep, Twist
from bspline_mdao.drivers import combine, disagreement, even_pressures, nlopt, recorded, run_at, scipy_slsqp
from bspline_mdao.generators import onera_m6_grid, onera_m6_planform
from bspline_mdao.grids import GridQuality, report_quality
from bspline_mdao.measures import EnclosedVolume, ProjectedArea, SurfaceGrid, Thickness
from bspline_mdao.movers import LinearElasticity, moving_mesh
from bspline_mdao.names import GRID
from bspline_mdao.plotting import draw_designs, figure
from bspline_mdao.scripts import pick_size, run
from bspline_mdao.testing import check_totals, perturb_design

LIFT, ALPHA = 0.25, 3.0
"""Lift coefficient, and angle of attack (deg), which is fixed: the twist of the root is free."""

THINNEST = 0.85
"""Lower bound of the thickness anywhere, relative to the M6's."""

WORST_CORNER = 0.05
"""What the worst cell must keep of its corner triple product of 1, by the bound of `Quality`."""

DRAG, PRESSURE = 0.05, 0.1
"""Units of the objective, and of the combinations: the root mean square of the change of pressure coefficients."""

PARTS = -0.4, 0.4
"""Parts of their heights by which control points move: at -1 the sides would meet."""

FINER = 1.5
"""Cells per direction of the member of the grid family that the optima are solved on again, relative to the grid's."""

FLOWS = {
    "euler": (bm.EulerFlow, {"tolerance": 1e-12, "iprint": 0}, "CD_induced + CD_entropy"),
    "vortex": (bm.LatticeFlow, {}, "CD_induced"),
}
"""The drag from the forces on the wall is mostly an error of the grid: it is taken from the wake and the entropy."""

DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_SLSQP": nlopt}

SIZES = {
    "quick": (((7, 9, 7), (7, 7), (9, 5)), ((5, 6, 5), (5, 5), (5, 4)), 3, 1e-3),
    "default": (((7, 15, 7), (9, 9), (11, 5)), ((5, 8, 5), (6, 6), (6, 4)), 2, 1e-10),
    "paper": (((17, 33, 17), (25, 25), (25, 13)), ((7, 11, 7), (9, 9), (9, 7)), 5, 1e-10),
}
"""Nodes and control points of the rows of blocks along the stream, away from the wing and along the span; stations of
the variables; and the tolerance of the objective, the drag in units of `DRAG`."""

SUMMARY = ("CL", "CD", "CD_induced", "CD_entropy", "drag", "volume", "projected_area", "chord", "twist", "sweep")
"""Outputs and variables of a wing that come out where there are any."""


def make_model(shape, n_control) -> bm.FittedModel:
    """Make the grid about the M6 and fit it; all members of its family have the wing of the fit."""
    stream, normal, span = n_control
    counts = [(i, j, k) for k, j, i in product(span, normal, stream)]
    return bm.fit_grid(onera_m6_grid(shape), n_control=counts, keep_residual=False)


def pose(
    model: bm.FittedModel, stations: int, flow: str, mach: float, combinations: np.ndarray | None = None
) -> om.Problem:
    """Pose the problem. Not yet set up. Without combinations of the heights, they are variables themselves."""
    mesh, wall = moving_mesh(model), SurfaceGrid.of(model, "wing*")
    quarter, trailing = (ReferenceAxis.of(mesh, at=part) for part in (0.25, 1.0))
    # control points but those of edges and tip move by parts of their heights: the sides do not meet at thin places
    upper, lower = (OnPatch(model, f"wing_{side}") for side in ("upper", "lower"))
    sides = (upper & ~lower) | (lower & ~upper)
    heights = np.abs(mesh.points[mesh.surface_ids][sides.mask(mesh), 1])
    variables = [  # from the sections outwards; the tip stays where it is along the span
        Local("heights", sides, heights[:, None] * [0.0, 1.0, 0.0], units=None),
        Chord("chord", quarter, 2),  # straight edges: with more stations these wave, which no finer grid rewards
        Twist("twist", trailing, stations),
        Sweep("sweep", quarter),
    ]
    planform = onera_m6_planform()
    span = planform.semi_span * np.array([0.02, 0.9])
    leading, trailing = (np.column_stack([planform.x(part, span), 0.0 * span, span]) for part in (0.1, 0.9))
    measures = [  # relative to the M6, thickness along lines between the edges
        Thickness.grid(wall, 5, 5, relative=True, leading=leading, trailing=trailing),
        EnclosedVolume.of(wall, relative=True),
        ProjectedArea.of(wall, relative=True),
    ]
    mover = LinearElasticity(mesh, n_increments=3)
    parametrization = Parametrization(mesh, variables)
    geometry = bm.GridMovement(model=model, parametrization=parametrization, measures=measures, mover=mover, fit=False)
    area = planform.semi_span**2 * 2.0 / planform.aspect_ratio
    problem, (make_flow, options, drag) = om.Problem(reports=None), FLOWS[flow]
    if combinations is not None:
        problem.model.add_subsystem("combine", combine("heights", combinations), promotes=["*"])
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    problem.model.add_subsystem("flow", make_flow(model=model, reference_area=area, **options), promotes=["*"])
    problem.model.add_subsystem("drag", om.ExecComp(f"drag = {drag}"), promotes=["*"])
    top = problem.model
    top.set_input_defaults("Mach_number", val=mach)
    top.set_input_defaults("alpha", val=ALPHA, units="deg")
    if combinations is None:
        top.add_design_var("heights", lower=PARTS[0], upper=PARTS[1], ref=0.2)
    else:
        top.add_design_var("combinations", ref=PRESSURE)
        top.add_constraint("heights", lower=PARTS[0], upper=PARTS[1])
    top.add_design_var("chord", lower=0.5, upper=1.5, ref=0.2)
    top.add_design_var("twist", lower=-10.0, upper=10.0, ref=3.0, units="deg")
    top.add_design_var("sweep", lower=-10.0, upper=10.0, ref=5.0, units="deg")
    top.add_constraint("CL", equals=LIFT, ref=LIFT)
    top.add_constraint("thickness", lower=THINNEST)
    top.add_constraint("volume", lower=1.0)
    top.add_constraint("projected_area", equals=1.0)
    top.add_constraint("corner_ks", lower=WORST_CORNER)
    top.add_objective("drag", ref=DRAG)
    return problem


def main(
    paper: bool = False,
    figures=None,
    flow: Literal["euler", "vortex"] = "euler",
    quick: bool = False,
    mach: float = 0.3,
    drivers=DRIVERS,
) -> dict:
    """Find the wing with every driver.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`.
    figures : path-like, optional
        Folder for ``m6_lift_constrained.png``, the N2 diagram ``m6_lift_constrained.html`` and the recorded cases.
    flow : {"euler", "vortex"}
        Euler equations or vortex lattice.
    mach : float
        Mach number (0.3).
    drivers : dict
        Makers of drivers by name.

    Returns
    -------
    dict
        ``n_nodes``, ``n_variables``; the `summary` of the ``initial`` wing, with that ``finer``, on the finer grid; by
        ``drivers`` the same and what `RecordedRun.numbers` returns; by how much they ``differ``, see `disagreement`;
        and ``totals``, see `check_totals`.
    """
    *counts, stations, tolerance = pick_size(SIZES, paper, quick)
    model, name = make_model(*counts), "m6_lift_constrained"

    combinations = None
    if flow == "euler":
        combinations = even_pressures(pose(model, stations, flow, mach), model, "heights", linear_tolerance=1e-6)

    def make_problem(member: bm.FittedModel = model) -> om.Problem:
        return pose(member, stations, flow, mach, combinations)

    def with_finer(problem: om.Problem) -> dict:
        finer = model.member(FINER)
        return summary(model, problem) | {"finer": summary(finer, run_at(problem, make_problem(finer)))}

    start, away = make_problem(), make_problem()
    for problem in (start, away):
        problem.setup(mode="rev")
        problem.run_model()
    runs = {}
    for driver, make_driver in drivers.items():
        problem = make_problem()
        problem.driver = make_driver(tolerance, 300)
        with recorded(problem, figures, f"{name}_{driver}") as runs[driver]:
            problem.run_driver()
    if figures:
        with figure(figures, name, (9.5, 9.0), n_colours=256) as canvas:
            draw_designs(canvas, model, start, runs, "drag", "drag (counts)", 1e-4)
        om.n2(start, outfile=str(Path(figures) / f"{name}.html"), show_browser=False)
    return {
        "n_nodes": model.n_nodes,
        "n_variables": sum(start.get_val(name).size for name in start.model.get_design_vars()),
        "initial": with_finer(start),
        "drivers": {name: each.numbers("flow") | with_finer(each.problem) for name, each in runs.items()},
        "differ": disagreement(runs),
        "totals": check_totals(perturb_design(away, size=0.03), n_directions=1, step=0.002, levels=2)._asdict(),
    }


def summary(model: bm.FittedModel, problem: om.Problem) -> dict:
    """Summarise a wing: its forces, measures, variables except single control points, and invalid cells."""
    names = {meta["prom_name"] for _, meta in problem.model.list_outputs(out_stream=None)}
    wanted = [name for name in SUMMARY if name in names | set(problem.model.get_design_vars())]
    cells = report_quality(GridQuality.of_baseline(model.regenerate()), problem.get_val(GRID).reshape(-1, 3))
    counts = {"min_corner": cells.min_corner, "n_inverted": cells.n_inverted}
    return {name: problem.get_val(name).copy().squeeze() for name in wanted} | counts


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/m6_lift_constrained.png'
