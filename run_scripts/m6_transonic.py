"""ONERA M6: transonic drag.

The ONERA M6 at M 0.8395: sections of least drag at fixed lift, volume and thickness; shocks before and after. The angle
of attack is solved for with the flow, so the lift is not a constraint; planform and twist stay. The variables are
combinations of the heights of control points along which the pressures change evenly. It takes ten minutes, with
``--quick`` one. The output is drag, angle and the strongest shock at the start and at the optima, the same on a finer
grid that no optimiser saw, how the optimisers converged, a check of the totals, and a picture of the sections, their
pressures and the histories.
"""

from __future__ import annotations

from itertools import product
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
    faces_around,
    figure,
    wall_quads,
)
from bspline_mdao.scripts import pick_size, run
from bspline_mdao.testing import check_totals, perturb_design

MACH, LIFT = 0.8395, 0.27

THINNEST = 0.9
"""Lower bound of the thickness anywhere, relative to the M6's."""

DRAG, PRESSURE = 0.04, 0.1
"""Units of the objective, and of the combinations: the root mean square of the change of pressure coefficients."""

PARTS = -0.5, 0.5
"""Parts of the heights within which control points move: at -1 the sides would meet, far above 1 cells would fold."""

FINER = 1.5
"""Cells per direction of the member of the grid family that the optima are solved on again, relative to the grid's."""

STATIONS = (0.2, 0.5, 0.8)
"""Parts of the half span where pressures are drawn."""

DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_SLSQP": nlopt}

SIZES = {
    "quick": (((5, 9, 5), (6, 6), (5, 5)), ((4, 6, 4), (5, 5), (4, 4)), 3),
    "default": (((9, 25, 9), (13, 13), (15, 7)), ((5, 9, 5), (6, 6), (6, 4)), 200),
    "paper": (((17, 33, 17), (25, 25), (25, 13)), ((7, 11, 7), (9, 9), (9, 7)), 400),
}
"""Nodes and control points of the rows of blocks along the stream, away from the wing and along the span, and
iterations at most."""


def make_model(shape, n_control) -> bm.FittedModel:
    """Make the grid about the M6 and fit it; all members of its family have the wing of the fit."""
    stream, normal, span = n_control
    counts = [(i, j, k) for k, j, i in product(span, normal, stream)]
    return bm.fit_grid(bm.generators.onera_m6_grid(shape), n_control=counts, keep_residual=False)


def pose(model: bm.FittedModel, combinations: np.ndarray | None = None) -> om.Problem:
    """Pose the problem: parts of the heights of control points off the edges and the tip. Not yet set up.

    Without combinations of the heights, they are inputs.
    """
    mesh, wall = bm.movers.moving_mesh(model), bm.measures.SurfaceGrid.of(model, "wing*")
    upper, lower = (bm.design.OnPatch(model, f"wing_{side}") for side in ("upper", "lower"))
    sides = (upper & ~lower) | (lower & ~upper)
    heights = np.abs(mesh.points[mesh.surface_ids][sides.mask(mesh), 1])
    variable = bm.design.Local("heights", sides, heights[:, None] * [0.0, 1.0, 0.0], units=None)
    planform = bm.generators.onera_m6_planform()
    span = planform.semi_span * np.array([0.02, 0.9])
    leading, trailing = (np.column_stack([planform.x(part, span), 0.0 * span, span]) for part in (0.1, 0.9))
    geometry = bm.GridMovement(
        model=model,
        parametrization=bm.design.Parametrization(mesh, [variable]),
        measures=[
            bm.measures.Thickness.grid(wall, 5, 5, relative=True, leading=leading, trailing=trailing),
            bm.measures.EnclosedVolume.of(wall, relative=True),
        ],
        mover=bm.movers.LinearElasticity(mesh, n_increments=3),
        fit=False,
    )
    area = planform.semi_span**2 * 2.0 / planform.aspect_ratio
    flow = bm.EulerFlow(model=model, reference_area=area, trim=True, tolerance=1e-12, iprint=0)
    problem = om.Problem(reports=None)
    if combinations is not None:
        problem.model.add_subsystem("combine", bm.drivers.combine("heights", combinations), promotes=["*"])
        problem.model.add_design_var("combinations", ref=PRESSURE)
        problem.model.add_constraint("heights", lower=PARTS[0], upper=PARTS[1])
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.model.set_input_defaults("Mach_number", val=MACH)
    problem.model.set_input_defaults("CL_target", val=LIFT)
    problem.model.add_constraint("thickness", lower=THINNEST)
    problem.model.add_constraint("volume", lower=1.0)
    problem.model.add_objective("CD", ref=DRAG)
    return problem


def main(paper: bool = False, figures=None, quick: bool = False, drivers=DRIVERS) -> dict:
    """Find the sections with every driver.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`; the quick one stops after some iterations.
    figures : path-like, optional
        Folder for ``m6_transonic.png``, the N2 diagram ``m6_transonic.html`` and the recorded cases.
    drivers : dict
        Makers of drivers by name.

    Returns
    -------
    dict
        ``n_nodes``, ``n_variables``; the `summary` of the ``initial`` wing, with that ``finer``, on the finer grid; by
        ``drivers`` the same and what `RecordedRun.numbers` returns; by how much they ``differ``, see `disagreement`;
        and ``totals``, see `check_totals`.
    """
    *counts, iterations = pick_size(SIZES, paper, quick)
    model, name = make_model(*counts), "m6_transonic"
    finer, combinations = model.member(FINER), bm.drivers.even_pressures(pose(model), model, "heights")
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
        with figure(figures, name, (11.0, 9.0), n_colours=256) as canvas:
            draw(canvas, model, start, runs)
        om.n2(start, outfile=str(Path(figures) / f"{name}.html"), show_browser=False)

    def with_finer(problem: om.Problem) -> dict:
        return summary(model, problem) | {"finer": summary(finer, run_at(problem, pose(finer, combinations)))}

    return {
        "n_nodes": model.n_nodes,
        "n_variables": combinations.shape[1],
        "initial": with_finer(start),
        "drivers": {name: each.numbers("flow") | with_finer(each.problem) for name, each in runs.items()},
        "differ": disagreement(runs),
        "totals": check_totals(perturb_design(away, size=0.03), n_directions=1, step=0.005, levels=2)._asdict(),
    }


def summary(model: bm.FittedModel, problem: om.Problem) -> dict:
    """Forces, measures, and the largest rise of the pressure coefficient per chord where pressures are drawn."""
    names = ("CL", "CD", "CD_induced", "CD_entropy", "alpha", "volume")
    corners, pressures = problem.get_val(GRID).reshape(-1, 3)[wall_quads(model)], problem.get_val("Cp")
    steepest = []
    for part in STATIONS:
        around = faces_around(corners, part * corners[..., 2].max())
        upper = around[: len(around) // 2]  # from the trailing edge, where the flow stops, to the leading edge
        x = corners[upper, :, 0].mean(axis=1)
        rises = np.diff(pressures[upper]) / np.diff(x) * np.ptp(x)
        steepest.append(rises[x[1:] < x.min() + 0.9 * np.ptp(x)].max())
    values = {name: problem.get_val(name).item() for name in names}
    return values | {"thinnest": problem.get_val("thickness").min(), "steepest_rises": steepest}


def draw(canvas, model: bm.FittedModel, start: om.Problem, runs) -> None:
    """Draw the pressures at the stations, the sections and the histories."""
    pressures, (sections, history, optimality) = canvas.subplots(2, 3)
    styles, quads = {"ONERA M6": {"color": GRAY}, **driver_styles(runs)}, wall_quads(model)
    for name, problem in {"ONERA M6": start, **{name: each.problem for name, each in runs.items()}}.items():
        nodes, style = problem.get_val(GRID).reshape(-1, 3), styles[name] | {"label": name}
        draw_sections(sections, model, nodes, STATIONS, **style)
        for axes, part in zip(pressures, STATIONS):
            draw_pressures(axes, nodes[quads], problem.get_val("Cp"), part * nodes[quads][..., 2].max(), **style)
            axes.set_title(f"$2y/b$ = {part:g}")
    pressures[0].legend(fontsize=8)
    draw_history(history, runs, "CD", "drag (counts)", lambda values: values * 1e4, log=False)
    draw_optimality(optimality, runs)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/m6_transonic.png'
