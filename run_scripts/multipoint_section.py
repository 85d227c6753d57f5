"""Multipoint: one section, two Mach numbers.

One section for two Mach numbers: least mean drag at a given lift, on one grid that moves for both flows. The section
starts as the NACA 0012 at M 0.72 and 0.75 and a lift coefficient of 0.4. Both angles of attack are solved for with the
flows, so the lift is not a constraint. It takes ten minutes, with ``--quick`` one. The output is drag and angle of both
flows at the start and at the optima, the same on a finer grid that no optimiser saw, how the optimisers converged, a
check of the totals, and a picture of the section, its pressures and the histories.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.drivers import disagreement, nlopt, recorded, run_at, scipy_slsqp
from bspline_mdao.names import GRID
from bspline_mdao.plotting import (
    GRAY,
    draw_history,
    draw_optimality,
    draw_pressures,
    draw_sections,
    driver_styles,
    figure,
    wall_quads,
)
from bspline_mdao.scripts import pick_size, run
from bspline_mdao.testing import check_totals, perturb_design

MACH_NUMBERS = {"slow": 0.72, "fast": 0.75}
LIFT = 0.4

THINNEST, PLACES = 0.85, (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""Lower bounds of the thickness at these parts of the chord, relative to the NACA 0012's."""

DRAG, PRESSURE = 0.02, 0.1
"""Units of the objective, and of the combinations: the root mean square of the change of pressure coefficients. Smaller
units of drag would make the first steps of the optimisers larger."""

PARTS = -0.8, 1.0
"""Parts of the heights within which control points move: at -1 the sides would meet, far above 1 cells would fold."""

FINER = 1.5
"""Cells per direction of the member of the grid family that the optima are solved on again, relative to the grid's."""

DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_SLSQP": nlopt}

SIZES = {"quick": (32, 16, (11, 8), 3), "default": (64, 32, (15, 10), 200), "paper": (128, 64, (25, 14), 400)}
"""Cells around the section and away from it, control points, and iterations at most."""


def make_model(n_around: int, n_away: int, n_control) -> bm.FittedModel:
    """Make the O-grid about the section and fit it; all members of its family have the section of the fit."""
    grid = bm.generators.section_o_grid(bm.generators.naca_section(0.12), n_around, far=50.0, n_away=n_away)
    return bm.fit_grid(grid, n_control=[(*n_control, 2)], keep_residual=False)


def pose(model: bm.FittedModel, combinations: np.ndarray | None = None) -> om.Problem:
    """Pose the problem: parts of the heights of control points, with nose and trailing edge fixed. Not yet set up.

    Without combinations of the heights, they are inputs.
    """
    mesh, wall = bm.movers.moving_mesh(model), bm.measures.SurfaceGrid.of(model, "wing")
    rows = np.searchsorted(mesh.surface_ids, mesh.blocks[0][:, 0, 0])
    heights = np.abs(mesh.points[mesh.surface_ids][rows, 1])
    is_free = heights > 1e-3 * heights.max()
    directions = heights[is_free, None] * [0.0, 1.0, 0.0]
    variable = bm.design.Local("heights", rows[is_free], directions, units=None)
    parametrization = bm.design.Parametrization(mesh, [variable])
    measures = [
        bm.measures.Thickness.of_sections(wall, PLACES, relative=True),
        bm.measures.SectionArea.of(wall, relative=True, name="area"),
    ]
    problem, flows = om.Problem(reports=None), om.Group()
    geometry = bm.GridMovement(
        model=model,
        parametrization=parametrization,
        measures=measures,
        mover=bm.movers.LinearElasticity(mesh, n_increments=5),
        fit=False,
    )
    if combinations is not None:
        problem.model.add_subsystem("combine", bm.drivers.combine("heights", combinations), promotes=["*"])
        problem.model.add_design_var("combinations", ref=PRESSURE)
        problem.model.add_constraint("heights", lower=PARTS[0], upper=PARTS[1])
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    for name, mach in MACH_NUMBERS.items():
        flow = bm.EulerFlow(model=model, reference_area=1.0, trim=True, tolerance=1e-12, iprint=0)
        flows.add_subsystem(name, flow, promotes_inputs=[GRID, "CL_target", ("Mach_number", f"Mach_{name}")])
        problem.model.set_input_defaults(f"Mach_{name}", val=mach)
    problem.model.add_subsystem("flows", flows, promotes_inputs=["*"])
    problem.model.add_subsystem("mean", om.ExecComp("drag = 0.5*(slow + fast)"), promotes_outputs=["*"])
    for name in MACH_NUMBERS:
        problem.model.connect(f"flows.{name}.CD", f"mean.{name}")
    problem.model.set_input_defaults("CL_target", val=LIFT)
    problem.model.add_constraint("thickness", lower=THINNEST)
    problem.model.add_constraint("area", lower=1.0)
    problem.model.add_objective("drag", ref=DRAG)
    return problem


def main(paper: bool = False, figures=None, quick: bool = False, drivers=DRIVERS) -> dict:
    """Find the section with every driver.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`; the quick one stops after some iterations.
    figures : path-like, optional
        Folder for ``multipoint_section.png``, the N2 diagram ``multipoint_section.html`` and the recorded cases.
    drivers : dict
        Makers of drivers by name.

    Returns
    -------
    dict
        ``n_cells``, ``n_variables``; the `summary` of the ``initial`` section, with that ``finer``, on the finer grid;
        by ``drivers`` the same and what `RecordedRun.numbers` returns; by how much they ``differ``, see
        `disagreement`; and ``totals``, see `check_totals`.
    """
    *counts, iterations = pick_size(SIZES, paper, quick)
    model, name = make_model(*counts), "multipoint_section"
    combinations = bm.drivers.even_pressures(
        pose(model), model, "heights", [f"flows.{name}.Cp" for name in MACH_NUMBERS]
    )
    start, away = (pose(model, combinations) for _ in range(2))
    for problem in (start, away):
        problem.setup(mode="rev")
        problem.run_model()
    runs = {}
    for driver, make_driver in drivers.items():
        problem = pose(model, combinations)
        problem.driver = make_driver(1e-10, iterations)
        with recorded(problem, figures, f"{name}_{driver}") as runs[driver]:
            problem.run_driver()
    if figures:
        with figure(figures, name, (11.0, 7.0), n_colours=256) as canvas:
            draw(canvas, model, start, runs)
        om.n2(start, outfile=str(Path(figures) / f"{name}.html"), show_browser=False)

    def with_finer(problem: om.Problem) -> dict:
        return summary(problem) | {"finer": summary(run_at(problem, pose(model.member(FINER), combinations)))}

    return {
        "n_cells": counts[0] * counts[1],
        "n_variables": start.get_val("heights").size,
        "initial": with_finer(start),
        "drivers": {name: each.numbers("flows") | with_finer(each.problem) for name, each in runs.items()},
        "differ": disagreement(runs),
        "totals": check_totals(perturb_design(away, size=0.03), n_directions=1, step=0.02, levels=2)._asdict(),
    }


def summary(problem: om.Problem) -> dict:
    """Mean drag, measures, and what each flow has for lift, drag and angle of attack."""
    flows = {
        name: {part: problem.get_val(f"flows.{name}.{part}").item() for part in ("CL", "CD", "alpha")}
        for name in MACH_NUMBERS
    }
    thinnest, area = problem.get_val("thickness").min(), problem.get_val("area").item()
    return {"drag": problem.get_val("drag").item(), "thinnest": thinnest, "area": area, **flows}


def draw(canvas, model: bm.FittedModel, start: om.Problem, runs) -> None:
    """Draw the sections, the pressures at both Mach numbers and the histories."""
    axes = canvas.subplot_mosaic([["slow", "fast", "section"], ["history", "history", "optimality"]])
    styles, quads = {"NACA 0012": {"color": GRAY}, **driver_styles(runs)}, wall_quads(model)
    for name, problem in {"NACA 0012": start, **{name: each.problem for name, each in runs.items()}}.items():
        corners = problem.get_val(GRID).reshape(-1, 3)[quads]
        draw_sections(axes["section"], model, problem.get_val(GRID), (0.5,), **styles[name], label=name)
        for point, mach in MACH_NUMBERS.items():
            pressures = problem.get_val(f"flows.{point}.Cp")
            draw_pressures(axes[point], corners, pressures, 0.5, **styles[name], label=name)
            axes[point].set_title(f"M {mach:g}")
    axes["slow"].legend(fontsize=8)
    draw_history(axes["history"], runs, "drag", "mean drag (counts)", lambda values: values * 1e4)
    draw_optimality(axes["optimality"], runs)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/multipoint_section.png'
