"""ONERA M6: few control points first.

Sections of the ONERA M6 in three levels: few control points first, knots inserted where the gradient requires them.
Heights of both sides minimise the drag at fixed lift, volume and thickness: with all control points from the start,
along combinations that are even by displacements or by pressures, and in three levels along combinations by pressures,
each of which starts from the shape, the bounds and the second derivatives of the previous one. It takes three minutes,
with ``--quick`` half a minute. The output is flow and gradient solutions of the three methods until the drag is within
1, 0.1 and 0.01 counts of the least that any finds, the knots, a check of the totals, and a picture of the histories and
the points of the levels.
"""

from __future__ import annotations

import tempfile
from itertools import product
from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.design import CoarseNet, DesignLevel, Local, OnPatch, Parametrization, unused_gradient
from bspline_mdao.drivers import RecordedRun, even_pressures, nlopt, recorded
from bspline_mdao.generators import onera_m6_grid, onera_m6_planform
from bspline_mdao.measures import EnclosedVolume, SurfaceGrid, Thickness
from bspline_mdao.movers import LinearElasticity, moving_mesh
from bspline_mdao.plotting import BLUE, GRAY, GREEN, ORANGE, figure
from bspline_mdao.scripts import pick_size, run
from bspline_mdao.testing import check_totals, perturb_design

MACH, LIFT, THINNEST = 0.5, 0.27, 0.9
"""Mach number, lift coefficient, and the lower bound of the thickness anywhere, relative to the M6's."""

DRAG, PARTS, UNIT, CHANGE = 0.04, (-0.5, 0.5), 0.03, 0.1
"""Unit of the objective, parts of the heights within which control points move, and units of the first changes: the
root mean squares over the surface of the displacement (m), and of the pressure coefficient's change."""

COUNT, WITHIN = 1e-4, (1.0, 0.1, 0.01)
"""A drag count, and how near to the least drag it is to be, in counts."""

COLORS = ORANGE, GREEN, BLUE
"""Colors of the levels."""

SIZES = {
    "quick": (((5, 9, 5), (6, 6), (7, 5)), ((4, 6, 4), (5, 5), (5, 4)), 2, 1e-3, 4),
    "default": (((7, 15, 7), (9, 9), (11, 5)), ((5, 11, 5), (6, 6), (8, 4)), 6, 1e-7, 50),
    "paper": (((17, 33, 17), (25, 25), (25, 13)), ((7, 15, 7), (9, 9), (11, 7)), 5, 1e-7, 200),
}
"""Nodes and control points of the rows of blocks along the stream, away from the wing and along the span, knots that
are inserted first, tolerance of the objective, and iterations at most."""

FEWEST = 5, 4
"""Points of the coarsest net along the chord and along the span."""

SOON = 4e-3
"""Tolerance of the objective at which the coarse levels end: what they leave, the next one has to find anyway."""


def make_model(shape, n_control) -> bm.FittedModel:
    """Make the grid about the M6 and fit it."""
    stream, normal, span = n_control
    counts = [(i, j, k) for k, j, i in product(span, normal, stream)]
    return bm.fit_grid(onera_m6_grid(shape), n_control=counts, keep_residual=False)


def make_net(model: bm.FittedModel) -> CoarseNet:
    """Make the coarsest net of parts of the heights of control points off the edges and the tip."""
    mesh = moving_mesh(model)
    upper, lower = (OnPatch(model, f"wing_{side}") for side in ("upper", "lower"))
    sides = (upper & ~lower) | (lower & ~upper)
    heights = np.abs(mesh.points[mesh.surface_ids][sides.mask(mesh), 1])
    variable = Local("heights", sides, heights[:, None] * [0.0, 1.0, 0.0], units=None)
    return CoarseNet.of(model, mesh, variable, n=FEWEST)


def pose(model: bm.FittedModel, level: DesignLevel) -> om.Problem:
    """Pose the problem of a level. Not yet set up."""
    wall, planform = SurfaceGrid.of(model, "wing*"), onera_m6_planform()
    span = planform.semi_span * np.array([0.02, 0.9])
    leading, trailing = (np.column_stack([planform.x(part, span), 0.0 * span, span]) for part in (0.1, 0.9))
    geometry = bm.GridMovement(
        model=model,
        parametrization=Parametrization(level.net.mesh, [level.net]),
        measures=[
            Thickness.grid(wall, 5, 5, relative=True, leading=leading, trailing=trailing),
            EnclosedVolume.of(wall, relative=True),
        ],
        mover=LinearElasticity(level.net.mesh, n_increments=3),
        fit=False,
        quality=False,
    )
    area = planform.semi_span**2 * 2.0 / planform.aspect_ratio
    flow = bm.EulerFlow(model=model, reference_area=area, trim=True, tolerance=1e-12, iprint=0)
    problem = om.Problem(reports=None)
    level.add_to(problem.model)
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.model.add_subsystem("drag", om.ExecComp("drag = CD_induced + CD_entropy"), promotes=["*"])
    problem.model.set_input_defaults("Mach_number", val=MACH)
    problem.model.set_input_defaults("CL_target", val=LIFT)
    problem.model.add_constraint("thickness", lower=THINNEST)
    problem.model.add_constraint("volume", lower=1.0)
    problem.model.add_objective("drag", ref=DRAG)
    return problem


def main(paper: bool = False, figures=None, quick: bool = False) -> dict:
    """Find the sections all three ways.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`; the quick one stops after some iterations.
    figures : path-like, optional
        Folder for ``m6_levels.png`` and the recorded cases.

    Returns
    -------
    dict
        ``n_nodes``; the ``initial`` drag; for all at once, along combinations that are even by ``displacements`` and by
        ``pressures``, and for ``levels`` the drag and the solutions, see `counts`; of the levels ``n_variables``, the
        part of the gradient that is ``used`` at the end of each, and the ``knots`` inserted first along each strip; and
        ``totals`` away from the optimum, see `check_totals`.
    """
    *sizes, n_knots, tolerance, iterations = pick_size(SIZES, paper, quick)
    model = make_model(*sizes)
    net = make_net(model)

    def solve(level: DesignLevel, tolerance: float, name: str) -> RecordedRun:
        problem = pose(model, level)
        problem.driver = nlopt(tolerance, iterations)
        with recorded(problem, folder, f"m6_levels_{name}") as run:
            problem.run_driver()
        return run

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(figures or temporary)
        displacements = DesignLevel.first(net.refine(net.missing()), *PARTS, unit=UNIT)
        columns = displacements.columns @ even_pressures(pose(model, displacements), model, "combinations")
        nets, metric = (displacements.net, net), np.linalg.inv(columns @ columns.T)
        finest, coarsest = (DesignLevel.first(each, *PARTS, unit=CHANGE, metric=metric) for each in nets)
        ways = {n: [solve(each, tolerance, n)] for n, each in (("displacements", displacements), ("pressures", finest))}
        levels, runs, used = [coarsest], [solve(coarsest, SOON, "1")], []
        for n, ends in enumerate((SOON, tolerance), start=1):
            level, problem = levels[-1], runs[-1].problem
            gradient = unused_gradient(problem, level.net)
            used.append(level.net.part_used(gradient, metric))
            knots = level.net.where_to_refine(gradient, n_knots, metric) if n == 1 else level.net.missing()
            levels.append(level.refined(problem, knots, folder / f"m6_levels_{n}.sql"))
            runs.append(solve(levels[-1], ends, str(n + 1)))
    ways["levels"] = runs
    least = min(history(each[-1]).min() for each in ways.values())
    if figures:
        with figure(figures, "m6_levels", (11.0, 5.0)) as canvas:
            draw(canvas, levels, ways, least)
    numbers = {name: {"drag": each[-1].problem["drag"].item()} | counts(each, least) for name, each in ways.items()}
    away = perturb_design(ways["pressures"][0].problem, size=0.001)
    return {
        "n_nodes": model.n_nodes,
        "initial": runs[0].history["drag"][0].item(),
        **numbers,
        "n_variables": [level.net.n_values for level in levels],
        "used": used,
        "knots": [np.flatnonzero(after & ~before) for before, after in zip(net.kept, levels[1].net.kept)],
        "totals": check_totals(away, n_directions=1, step=5e-4, levels=3)._asdict(),
    }


def history(run: RecordedRun) -> np.ndarray:
    """Least drag of a feasible wing up to each flow solution."""
    is_feasible = run.convergence.violations < 1e-5
    return np.minimum.accumulate(np.where(is_feasible, run.history["drag"].ravel(), np.inf))


def counts(runs: list[RecordedRun], least: float) -> dict:
    """Flow and gradient solutions of all runs, two gradients for each choice of knots, and when drag was ``within``."""
    flows = sum(len(run.history["drag"]) for run in runs[:-1])
    gradients = sum(len(run.convergence.differentiated) + 2 for run in runs[:-1])
    course, differentiated, within = history(runs[-1]), runs[-1].convergence.differentiated, {}
    for part in WITHIN:
        there = np.flatnonzero(course < least + part * COUNT)
        if len(there):
            n_gradients = gradients + int(np.count_nonzero(differentiated <= there[0]))
            within[str(part)] = {"flows": flows + int(there[0]) + 1, "gradients": n_gradients}
    return {"flows": flows + len(course), "gradients": gradients + len(differentiated), "within": within}


def draw(canvas, levels: list[DesignLevel], ways: dict, least: float) -> None:
    """Draw the drag over the flow solutions, and where the levels have points."""
    drag, planform = canvas.subplots(1, 2)
    mesh, start = levels[0].net.mesh, 1
    for name, style in (("displacements", ":"), ("pressures", "-")):
        course = (history(ways[name][0]) - least) / COUNT
        drag.semilogy(np.arange(1, len(course) + 1), course, style, color=GRAY, label=f"all at once, by {name}")
    for number, (each, level, color) in enumerate(zip(ways["levels"], levels, COLORS), start=1):
        course = (history(each) - least) / COUNT
        drag.semilogy(start + np.arange(len(course)), course, color=color, label=f"level {number}")
        start += len(course)
        rows = level.net.variable.directed(mesh)[0][np.unique(level.net.weights.tocsc().argmax(axis=0))]
        x, y, z = mesh.points[mesh.surface_ids][rows].T
        planform.plot(x[y > 0.0], z[y > 0.0], "o", ms=15 - 4 * number, c=color, label=f"{level.net.n_values} points")
    drag.set(xlabel="flow solutions", ylabel="drag above the least (counts)", ylim=(1e-3, None))
    planform.set(xlabel="$x$ (m)", ylabel="$z$ (m)", aspect="equal")
    for axes in (drag, planform):
        axes.legend(fontsize=8)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/m6_levels.png'
