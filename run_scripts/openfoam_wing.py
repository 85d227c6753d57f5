"""OpenFOAM: drag of a swept wing.

Least drag of a swept wing at a given lift in turbulent flow, by OpenFOAM: needs ``simpleFoam`` on the PATH. On Debian
``apt-get install openfoam`` installs it. The wing has a semi-span of three root chords, a taper of a half and a leading
edge that is swept by 20 degrees. It starts with NACA 0012 sections and no twist, at a Reynolds number of 3 million and
a lift coefficient of 0.5. Angle of attack, twist and camber at stations are the variables; the volume stays as it is,
because camber does not change the thickness. Grid and driver are from bspline_mdao. Derivatives are forward differences
of the totals, and each flow starts from the flow of the design.

It takes a quarter of an hour, with ``--quick`` some minutes, by wall functions on coarse grids. The output is lift,
drag, twist, camber and y+ of the wing at the start and at the optimum, the same on a finer grid that no optimiser saw,
how the optimiser converged, and a picture of pressures, twist, camber and the history.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.drivers import recorded
from bspline_mdao.flow import OpenFoamFlow, RansCase
from bspline_mdao.names import GRID
from bspline_mdao.plotting import GRAY, ORANGE, draw_history, draw_pressures, figure, wall_quads
from bspline_mdao.scripts import pick_size, run

PLANFORM = bm.generators.Planform(root_chord=1.0, semi_span=3.0, taper=0.5, leading_edge_sweep=20.0)
AREA = 0.75 * PLANFORM.semi_span
"""Of the half wing that the grid shows (m^2): mean chord times semi-span."""

REYNOLDS, SPEED, LIFT = 3e6, 30.0, 0.5
"""Of the root chord; speed of the free stream (m/s); lift coefficient."""

SLOPE = 3.7
"""Lift per angle (1/rad), about."""

UNIT, STEP = 0.01, 0.002
"""Of the variables, and of the differences: angles in radians and camber in chords, which change the lift as much."""

DRAG, CONSTRAINT = 1e-3, 0.1
"""Units of the objective and of lift."""

TOLERANCE, VIOLATION, TRIMMED = 3e-3, 2e-3, 1e-4
"""Of the objective, 0.03 counts of drag; of the constraint, in its unit; and of the lift of designs to compare."""

STATIONS = (0.0, 0.5, 1.0)
"""Along the span, from root to tip, of twist and camber; at the root the angle of attack is the twist."""

SIZES = {
    "quick": (((10, 17, 9), (12, 17), (13, 9)), 1.2, 6),
    "default": (((10, 17, 9), (12, 17), (13, 9)), 1.5, 14),
    "paper": (((17, 33, 13), (17, 25), (21, 13)), 1.5, 40),
}
"""Nodes of the rows of blocks along the stream, away from the wing and along the span; cells per direction of the finer
grid by those of the optimiser's; evaluations at most."""

RESIDUAL = 1e-6
"""Of the flow's residuals: what iterations leave of the drag is below 0.01 counts."""

SPACING = bm.generators.Spacing(off_wall=2e-3, leading=6e-3, trailing=1.2e-2, tip=0.02, root=0.25)
"""Heights and lengths of the first cells (m): for y+ between 30 and 300."""


def pose(model: bm.FittedModel, case: RansCase, folder: Path, alpha: float = LIFT / SLOPE) -> om.Problem:
    """Pose the problem: angle of attack, twist outboard of the root, and camber. Not yet set up."""
    mesh = bm.movers.moving_mesh(model)
    axis = bm.design.ReferenceAxis.of(mesh, at=1.0)
    variables = [bm.design.Twist("twist", axis, STATIONS), bm.design.Camber("camber", axis, STATIONS)]
    geometry = bm.GridMovement(model=model, parametrization=bm.design.Parametrization(mesh, variables), fit=False)
    flow = OpenFoamFlow(model=model, case=case, folder=folder, reference_area=AREA, time_limit=1800.0)
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.model.set_input_defaults("speed", val=SPEED, units="m/s")
    problem.model.set_input_defaults("alpha", val=alpha, units="rad")
    problem.model.set_input_defaults("twist", val=np.zeros(len(STATIONS)), units="rad")
    problem.model.add_design_var("alpha", lower=-0.05, upper=0.2, ref=UNIT, units="rad")
    problem.model.add_design_var("twist", indices=[1, 2], lower=-0.15, upper=0.15, ref=UNIT, units="rad")
    problem.model.add_design_var("camber", lower=-0.01, upper=0.04, ref=UNIT)
    problem.model.add_constraint("CL", equals=LIFT, ref=CONSTRAINT)
    problem.model.add_objective("CD", ref=DRAG)
    problem.model.approx_totals(method="fd", form="forward", step=STEP)
    return problem


def trimmed(problem: om.Problem, design: om.Problem | None = None) -> om.Problem:
    """Solve the flow of a design, the untwisted wing without one, at the angle that gives the lift."""
    problem.setup()
    if design is not None:
        for name in ("alpha", "twist", "camber"):
            problem.set_val(name, design.get_val(name))
    for _ in range(6):
        problem.run_model()
        excess = problem.get_val("CL").item() - LIFT
        if abs(excess) < TRIMMED:
            break
        problem.set_val("alpha", problem.get_val("alpha") - excess / SLOPE)
    return problem


def main(paper: bool = False, figures=None, quick: bool = False) -> dict:
    """Find twist and camber.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`; the quick one stops after some evaluations.
    figures : path-like, optional
        Folder for ``openfoam_wing.png`` and the recorded cases.

    Returns
    -------
    dict
        ``n_nodes`` of the grid and of the finer one; the `summary` of the ``initial`` wing; of the ``optimum`` the same
        and what `RecordedRun.numbers` returns. What is ``finer`` is on the finer grid.
    """
    shape, finer, evaluations = pick_size(SIZES, paper, quick)
    case = RansCase(REYNOLDS, walls="functions", tolerance=RESIDUAL)
    if shutil.which(case.program) is None:
        raise bm.InputError(f"{case.program} of OpenFOAM is not on the PATH; on Debian: apt-get install openfoam")
    wing = bm.generators.Wing(PLANFORM, bm.generators.naca_section(0.12))
    model = bm.fit_grid(bm.generators.hh_wing_grid(wing, shape, SPACING))
    fine_model = model.member(finer)
    with tempfile.TemporaryDirectory() as place:
        coarse, fine = Path(place) / "coarse", Path(place) / "fine"
        start = trimmed(pose(model, case, coarse))
        problem = pose(model, case, coarse, start.get_val("alpha").item())
        stop = {"ftol_abs": TOLERANCE, "ftol_rel": 0.0, "constraint_tolerance": VIOLATION, "maxeval": evaluations}
        problem.driver = bm.NLoptDriver(optimizer="LD_SLSQP", disp=False, **stop)
        with recorded(problem, figures, "openfoam_wing") as optimisation:
            problem.run_driver()
        numbers = {"initial": {}, "optimum": optimisation.numbers()}
        found = {"initial": start, "optimum": trimmed(pose(model, case, coarse), problem)}
        for name, design in found.items():
            again = trimmed(pose(fine_model, case, fine), design)
            numbers[name] |= summary(design) | {"finer": summary(again)}
    if figures:
        draw(figures, model, found, optimisation)
    return {"n_nodes": [model.n_nodes, fine_model.n_nodes], **numbers}


def summary(problem: om.Problem) -> dict:
    """Return lift, drag, angle, twist, camber and y+ of a design."""
    numbers = {name: problem.get_val(name).item() for name in ("CL", "CD", "n_iterations")}
    angles = {name: problem.get_val(name, units="deg").tolist() for name in ("alpha", "twist")}
    return numbers | angles | {name: problem.get_val(name).tolist() for name in ("camber", "y_plus")}


def draw(folder, model: bm.FittedModel, found, optimisation) -> None:
    """Draw pressures at half of the span, twist and camber, and the history."""
    with figure(folder, "openfoam_wing", (10.0, 6.5)) as canvas:
        (pressures, history), (twist, camber) = canvas.subplots(2, 2)
        quads = wall_quads(model)
        for color, (name, problem) in zip((GRAY, ORANGE), found.items()):
            style = {"color": color, "label": f"{name}: {1e4 * problem.get_val('CD').item():.1f} counts"}
            corners = problem.get_val(GRID).reshape(-1, 3)[quads]
            draw_pressures(pressures, corners, problem.get_val("Cp"), 0.5 * PLANFORM.semi_span, **style)
            geometric = problem.get_val("alpha", units="deg") + problem.get_val("twist", units="deg")
            twist.plot(STATIONS, geometric, "o", **style)
            camber.plot(STATIONS, 100.0 * problem.get_val("camber"), "o", **style)
        twist.set(xlabel="part of the span", ylabel="angle of sections (deg)")
        camber.set(xlabel="part of the span", ylabel="camber (% of the chord)")
        pressures.legend(fontsize=8)
        runs = {"NLopt LD_SLSQP": optimisation}
        draw_history(history, runs, "CD", "drag (counts)", lambda values: 1e4 * values, log=False)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/openfoam_wing.png'
