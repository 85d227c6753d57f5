"""OpenFOAM: airfoil at high lift.

Least drag of an airfoil at a high lift in turbulent flow, by OpenFOAM: needs ``simpleFoam`` on the PATH. On Debian
``apt-get install openfoam`` installs it. The section starts as the NACA 0012 at a Reynolds number of 6e6 and a lift
coefficient of 1, where the flow turns sharply around the nose. Heights of control points and the angle of attack are
the variables. The section keeps its area and three quarters of its thickness everywhere, and its moment about the
quarter chord is bounded, which limits the camber. Grid and driver are from bspline_mdao. Derivatives are forward
differences of the totals, and each flow starts from the flow of the design.

It takes a quarter of an hour, with ``--quick``, with fewer control points and evaluations, three minutes. The output is
lift, drag, moment and y+ of the NACA 0012 and of the optimum, the same on a finer grid that the optimiser never saw,
how the optimiser converged, and a picture of sections, pressures and the history.
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

REYNOLDS, SPEED, LIFT = 6e6, 30.0, 1.0
"""Of the chord; speed of the free stream (m/s); lift coefficient."""

THINNEST, PLACES = 0.75, (0.02, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9)
"""Lower bounds of the thickness at these parts of the chord, relative to the NACA 0012's."""

MOMENT = 0.08
"""Largest moment about the quarter chord, nose down."""

PART = 1.2
"""How far control points may move by their heights over the chord line: at 1 a side would lie on that line."""

TOLERANCE, VIOLATION, TRIMMED = 3e-3, 2e-3, 2e-4
"""Of the objective, 0.03 counts of drag; of constraints, in their unit; and of the lift of designs that are compared,
to which they are trimmed. What residuals leave is half of that: an optimiser that requires less finds no design."""

UNIT, STEP = 0.01, 0.002
"""Of the variables, and of the differences: heights in chords and the angle in radians, which move walls as much."""

DRAG, CONSTRAINT = 1e-3, 0.1
"""Units of the objective and of constraints: steps of the size of `UNIT` change them by about as much."""

SLOPE = 6.0
"""Lift per angle (1/rad), about."""

N_AWAY, N_ALONG = 12, 2
"""Control points away from the section and along the span."""

SIZES = {
    "quick": ((128, 64, 6e-6), (192, 96, 4e-6), 9, 5),
    "default": ((128, 64, 6e-6), (192, 96, 4e-6), 13, 20),
    "paper": ((128, 64, 6e-6), (256, 128, 3e-6), 13, 60),
}
"""Cells around the section and away from it and heights of the first cells (chords), on the grid of the optimisers and
on the finer one; control points around the section, of which nose and trailing edge stay; evaluations at most.
"""


def make_model(n_around: int, n_away: int, off_wall: float, n_control: int) -> bm.FittedModel:
    """Make the O-grid about the section, of a height of the first cells, and fit it."""
    section = bm.generators.naca_section(0.12)
    grid = bm.generators.section_o_grid(section, n_around, far=50.0, n_away=n_away, off_wall=off_wall)
    return bm.fit_grid(grid, n_control=[(n_control, N_AWAY, N_ALONG)])


def pose(model: bm.FittedModel, case: RansCase, folder: Path, alpha: float = LIFT / SLOPE) -> om.Problem:
    """Pose the problem: heights of control points, with nose and trailing edge fixed. Not yet set up.

    The two planes of the grid move alike.
    """
    mesh, wall = bm.movers.moving_mesh(model), bm.measures.SurfaceGrid.of(model, "wing")
    rows = [np.searchsorted(mesh.surface_ids, mesh.blocks[0][:, 0, k]) for k in range(2)]
    heights = np.abs(mesh.points[mesh.surface_ids][rows[0], 1])
    free = np.flatnonzero(heights > 1e-3 * heights.max())
    first, second = (row[free] for row in rows)
    variable, alike = bm.design.Local("heights", first, "y"), bm.constraints.Linked(first, second)
    places = np.column_stack([PLACES, np.zeros(len(PLACES)), np.full(len(PLACES), 0.5)])
    measures = [
        bm.measures.Thickness.at(wall, places, np.array([0.0, 1.0, 0.0]), relative=True),
        bm.measures.EnclosedVolume.of(wall, relative=True),
    ]
    parametrization = bm.design.Parametrization(mesh, [variable], [alike])
    geometry = bm.GridMovement(model=model, parametrization=parametrization, measures=measures, fit=False)
    references = {"reference_area": 1.0, "moment_reference": (0.25, 0.0, 0.0)}
    flow = OpenFoamFlow(model=model, case=case, folder=folder, time_limit=1800.0, **references)
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.model.set_input_defaults("speed", val=SPEED, units="m/s")
    problem.model.set_input_defaults("alpha", val=alpha, units="rad")
    most = PART * heights[free]
    problem.model.add_design_var("heights", lower=-most, upper=most, ref=UNIT, units="m")
    problem.model.add_design_var("alpha", lower=-0.1, upper=0.2, ref=UNIT, units="rad")
    problem.model.add_constraint("CL", equals=LIFT, ref=CONSTRAINT)
    problem.model.add_constraint("CM", indices=[2], upper=MOMENT, ref=CONSTRAINT)
    problem.model.add_constraint("thickness", lower=THINNEST, ref=CONSTRAINT)
    problem.model.add_constraint("volume", lower=1.0, ref=CONSTRAINT)
    problem.model.add_objective("CD", ref=DRAG)
    problem.model.approx_totals(method="fd", form="forward", step=STEP)
    return problem


def trimmed(problem: om.Problem, design: om.Problem | None = None) -> om.Problem:
    """Solve the flow of a design, the NACA 0012 without one, at the angle that gives the lift."""
    problem.setup()
    if design is not None:
        problem.set_val("heights", design.get_val("heights"))
        problem.set_val("alpha", design.get_val("alpha"))
    for _ in range(6):
        problem.run_model()
        excess = problem.get_val("CL").item() - LIFT
        if abs(excess) < TRIMMED:
            break
        problem.set_val("alpha", problem.get_val("alpha") - excess / SLOPE)
    return problem


def main(paper: bool = False, figures=None, quick: bool = False) -> dict:
    """Find the section.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`; the quick one stops after some evaluations.
    figures : path-like, optional
        Folder for ``openfoam_airfoil.png`` and the recorded cases.

    Returns
    -------
    dict
        ``n_cells``, ``n_variables``, ``expected_y_plus``; the `summary` of the ``NACA 0012``; of the ``optimum`` the
        same and what `RecordedRun.numbers` returns. What is ``finer`` is on the finer grid.
    """
    size, finer, n_control, evaluations = pick_size(SIZES, paper, quick)
    case = RansCase(REYNOLDS, planes="empty")
    if shutil.which(case.program) is None:
        raise bm.InputError(f"{case.program} of OpenFOAM is not on the PATH; on Debian: apt-get install openfoam")
    model, fine_model = (make_model(*each, n_control) for each in (size, finer))
    with tempfile.TemporaryDirectory() as place:
        coarse, fine = Path(place) / "coarse", Path(place) / "fine"
        start = trimmed(pose(model, case, coarse))
        problem = pose(model, case, coarse, start.get_val("alpha").item())
        stop = {"ftol_abs": TOLERANCE, "ftol_rel": 0.0, "constraint_tolerance": VIOLATION, "maxeval": evaluations}
        problem.driver = bm.NLoptDriver(optimizer="LD_SLSQP", disp=False, singular_jac_behavior="ignore", **stop)
        with recorded(problem, figures, "openfoam_airfoil") as optimisation:
            problem.run_driver()
        numbers = {"NACA 0012": {}, "optimum": optimisation.numbers()}
        found = {"NACA 0012": start, "optimum": trimmed(pose(model, case, coarse), problem)}
        for name, design in found.items():
            again = trimmed(pose(fine_model, case, fine), design)
            numbers[name] |= summary(design) | {"finer": summary(again)}
    if figures:
        draw(figures, model, found, optimisation)
    return {
        "n_cells": [size[0] * size[1], finer[0] * finer[1]],
        "n_variables": start.get_val("heights").size + 1,
        "expected_y_plus": case.expected_y_plus([size[2], finer[2]]).tolist(),
        **numbers,
    }


def summary(problem: om.Problem) -> dict:
    """Return lift, drag, moment, angle, y+, area and thickness of a design, and its heights."""
    numbers = {name: problem.get_val(name).item() for name in ("CL", "CD", "volume", "n_iterations")}
    return numbers | {
        "alpha": problem.get_val("alpha", units="deg").item(),
        "moment": problem.get_val("CM")[2],
        "thinnest": problem.get_val("thickness").min(),
        **{name: problem.get_val(name).tolist() for name in ("y_plus", "heights")},
    }


def draw(folder, model: bm.FittedModel, found, optimisation) -> None:
    """Draw sections, pressures and the history."""
    with figure(folder, "openfoam_airfoil", (9.0, 4.5)) as canvas:
        axes = canvas.subplot_mosaic([["pressure", "section"], ["pressure", "history"]], height_ratios=[1.0, 2.0])
        quads = wall_quads(model)
        for color, (name, problem) in zip((GRAY, ORANGE), found.items()):
            style = {"color": color, "label": f"{name}: {1e4 * problem.get_val('CD').item():.1f} counts"}
            corners = problem.get_val(GRID).reshape(-1, 3)[quads]
            axes["section"].plot(*corners.mean(axis=1)[:, :2].T, **style)
            draw_pressures(axes["pressure"], corners, problem.get_val("Cp"), 0.5, **style)
        axes["section"].set(aspect="equal", xlabel="$x / c$", ylabel="$y / c$")
        axes["pressure"].legend(fontsize=8)
        runs = {"NLopt LD_SLSQP": optimisation}
        draw_history(axes["history"], runs, "CD", "drag (counts)", lambda values: 1e4 * values, log=False)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/openfoam_airfoil.png'
