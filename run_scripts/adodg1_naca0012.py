"""ADODG 1: transonic drag of the NACA 0012.

Least drag of a section nowhere thinner than the NACA 0012, at M 0.85 and zero lift: case 1 of the AIAA's group. The
upper half of the section, on a half O-grid with symmetry ahead and behind, is nowhere below the NACA 0012: the heights
of all control points are bounded by the NACA 0012's, which holds on every member of the grid family. With more control
points, designs have several flows, with different shocks, and optimisers end on any of them. Every flow starts from the
flow of the last gradient, so small steps stay with it. It takes four minutes, with ``--quick`` some seconds, and a
quarter of an hour at the paper's size. The output is drag at the start and at the optima, the same on a finer grid that
no optimiser saw, started from the flow of the optimum and from the uniform stream, how the optimisers converged, a
check of the totals, and a picture of sections, pressures and histories.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao import Grid
from bspline_mdao.drivers import disagreement, nlopt, recorded, scipy_slsqp
from bspline_mdao.grids import Block, Patch, Window
from bspline_mdao.names import GRID
from bspline_mdao.plotting import (
    GRAY,
    draw_history,
    draw_optimality,
    draw_pressures,
    driver_styles,
    figure,
    wall_quads,
)
from bspline_mdao.scripts import pick_size, run
from bspline_mdao.testing import check_totals, perturb_design

MACH = 0.85

FAR = 50.0
"""Distance of the far field in chords."""

DRAG, PRESSURE = 0.05, 0.1
"""Units of the objective, and of the combinations: the root mean square of the change of pressure coefficients. Smaller
units of drag would make the first steps of the optimisers larger."""

HEIGHT = 0.01
"""Unit of the constraints of heights (chords)."""

THICKER, NOSE, TAIL = 0.05, (0.012, 2.0), 1.6
"""How much higher control points may be at most (chords), less near the nose, by a value at it and a slope, and near
the tail, by a slope: beyond, cells fold at the nose, and a tail that is cut off has its drag from the grid."""

FINER = 1.5
"""Cells per direction of the member of the grid family that the optima are solved on again, relative to the grid's."""

DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_SLSQP": nlopt}

SIZES = {"quick": (32, 20, (11, 8), 6), "default": (128, 80, (11, 10), 100), "paper": (192, 120, (11, 10), 100)}
"""Cells along the half section and away from it, control points, and iterations at most."""


def make_model(n_along: int, n_away: int, n_control) -> bm.FittedModel:
    """Make the half O-grid above the NACA 0012 and fit it; all members of its family have the section of the fit."""
    whole = bm.generators.section_o_grid(bm.generators.naca_section(0.12), 2 * n_along, far=FAR, n_away=n_away)
    nodes = whole.blocks[0].nodes[n_along:].copy()
    nodes[[0, -1], :, :, 1] = 0.0  # to the last bit
    face = Window.whole(0, nodes.shape[:3]).face
    sides = {"wing": ("wall", (2,)), "farfield": ("farfield", (3,))}
    sides |= {"planes": ("symmetry", (4, 5)), "middle": ("symmetry", (0, 1))}
    patches = tuple(Patch(name, kind, tuple(map(face, numbers))) for name, (kind, numbers) in sides.items())
    grid = Grid((Block(nodes, "above the section"),), patches, source="half O-grid")
    return bm.fit_grid(grid, n_control=[(*n_control, 2)], keep_residual=False)


def pose(model: bm.FittedModel, combinations: np.ndarray | None = None) -> om.Problem:
    """Pose the problem: heights of control points above the NACA 0012's, except at both ends. Not yet set up.

    Without combinations of the heights, they are inputs.
    """
    mesh = bm.movers.moving_mesh(model)
    rows = np.searchsorted(mesh.surface_ids, mesh.blocks[0][1:-1, 0, 0])
    parametrization = bm.design.Parametrization(mesh, [bm.design.Local("heights", rows, "y")])
    problem = om.Problem(reports=None)
    if combinations is not None:
        along = mesh.points[mesh.surface_ids][rows, 0]
        most = np.minimum(np.minimum(THICKER, NOSE[0] + NOSE[1] * along), TAIL * (1.0 - along))
        problem.model.add_subsystem("combine", bm.drivers.combine("heights", combinations, units="m"), promotes=["*"])
        problem.model.add_design_var("combinations", ref=PRESSURE)
        problem.model.add_constraint("heights", lower=0.0, upper=most, ref=HEIGHT, units="m")
    mover = bm.movers.LinearElasticity(mesh, n_increments=5)
    geometry = bm.GridMovement(model=model, parametrization=parametrization, mover=mover, fit=False)
    flow = bm.EulerFlow(model=model, reference_area=0.5, tolerance=1e-12, iprint=0, anchored=True)
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.model.set_input_defaults("Mach_number", val=MACH)
    problem.model.set_input_defaults("alpha", val=0.0, units="deg")
    problem.model.add_objective("CD", ref=DRAG)
    return problem


def main(paper: bool = False, figures=None, quick: bool = False, drivers=DRIVERS) -> dict:
    """Find the section with every driver.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`; the quick one stops after some iterations.
    figures : path-like, optional
        Folder for ``adodg1_naca0012.png``, the N2 diagram ``adodg1_naca0012.html`` and the recorded cases.
    drivers : dict
        Makers of drivers by name.

    Returns
    -------
    dict
        ``n_cells``, ``n_variables``; the `summary` of the ``initial`` section; by ``drivers`` the same and what
        `RecordedRun.numbers` returns; by how much they ``differ``, see `disagreement`; and ``totals``, see
        `check_totals`.
    """
    *counts, iterations = pick_size(SIZES, paper, quick)
    model, name = make_model(*counts), "adodg1_naca0012"
    combinations = bm.drivers.even_pressures(pose(model), model, "heights")
    start, away = (pose(model, combinations) for _ in range(2))
    for problem in (start, away):
        problem.setup(mode="rev")
        problem.run_model()
    totals = check_totals(perturb_design(away, size=0.02), n_directions=1, step=0.005, levels=2)
    runs = {}
    for driver, make_driver in drivers.items():
        problem = pose(model, combinations)
        problem.driver = make_driver(1e-9, iterations)
        with recorded(problem, figures, f"{name}_{driver}") as runs[driver]:
            problem.run_driver()
    if figures:
        with figure(figures, name, (11.0, 7.0), n_colours=256) as canvas:
            draw(canvas, model, start, runs)
        om.n2(start, outfile=str(Path(figures) / f"{name}.html"), show_browser=False)
    return {
        "n_cells": counts[0] * counts[1],
        "n_variables": start.get_val("heights").size,
        "initial": summary(model, combinations, start),
        "drivers": {
            name: each.numbers("flow") | summary(model, combinations, each.problem) for name, each in runs.items()
        },
        "differ": disagreement(runs),
        "totals": totals._asdict(),
    }


def summary(model: bm.FittedModel, combinations: np.ndarray, found: om.Problem) -> dict:
    """Return the drag of a design, its heights and their lowest, and its drag in other flows.

    These are ``cold``, on the same grid from the uniform stream, and ``finer``, on a finer member of the family: from
    the flow of the design, and cold. Drag is nan where none is found.
    """
    heights, finer = found.get_val("heights", units="m"), model.member(FINER)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "states.h5"
        found.model.flow.save_states(file)
        continued = drag_at(found, pose(finer, combinations), file)
    return {
        "drag": found.get_val("CD").item(),
        "cold": drag_at(found, pose(model, combinations)),
        "finer": {"drag": continued, "cold": drag_at(found, pose(finer, combinations))},
        "lowest": heights.min(),
        "heights": heights.tolist(),
    }


def drag_at(found: om.Problem, problem: om.Problem, states: Path | None = None) -> float:
    """Solve a design again, from saved states or from the uniform stream; its drag is nan where no flow is found."""
    problem.setup(mode="rev")
    problem.set_val("combinations", found.get_val("combinations"))
    if states is not None:
        problem.final_setup()
        problem.model.flow.load_states(states)
    try:
        problem.run_model()
    except om.AnalysisError:
        return np.nan
    return problem.get_val("CD").item()


def draw(canvas, model: bm.FittedModel, start: om.Problem, runs) -> None:
    """Draw sections, pressures and histories."""
    axes = canvas.subplot_mosaic([["pressure", "section"], ["history", "optimality"]])
    styles, quads = {"NACA 0012": {"color": GRAY}, **driver_styles(runs)}, wall_quads(model)
    for name, problem in {"NACA 0012": start, **{name: each.problem for name, each in runs.items()}}.items():
        corners = problem.get_val(GRID).reshape(-1, 3)[quads]
        axes["section"].plot(*corners.mean(axis=1)[:, :2].T, **styles[name], label=name)
        draw_pressures(axes["pressure"], corners, problem.get_val("Cp"), 0.5, **styles[name], label=name)
    axes["section"].set(aspect="equal", xlabel="$x / c$", ylabel="$y / c$")
    axes["pressure"].legend(fontsize=8, loc="lower center")
    draw_history(axes["history"], runs, "CD", "drag (counts)", lambda values: values * 1e4)
    draw_optimality(axes["optimality"], runs)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/adodg1_naca0012.png'
