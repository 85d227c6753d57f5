"""From a cube to a ball.

The body of least area at a given volume: a cube becomes a ball. The analytic optimum is the ball, of area ``(36 pi
V^2)^(1/3)``. Every control point of the cube's surface moves along the ray from the centre. No polyhedron has less area
than the ball, so the optimum on every grid is above it, by an error of second order in the size of the quads until only
the error of the splines is left. It takes half a minute, and some minutes at the paper's size. The output is the errors
of the area on ever finer grids and their order, how the optimisers converged, a check of the totals, and a picture of
the body, the errors and the histories.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.drivers import RecordedRun, nlopt, recorded, scipy_slsqp
from bspline_mdao.plotting import BLUE, GRAY, GREEN, ORANGE, RED, draw_history, draw_net, figure
from bspline_mdao.scripts import run
from bspline_mdao.testing import check_totals, perturb_design

AREA = (36.0 * np.pi) ** (1.0 / 3.0)
"""Area of the ball of unit volume (m^2)."""

RADIUS = (0.75 / np.pi) ** (1.0 / 3.0)
"""Its radius (m)."""

TOLERANCE = 1e-13
"""Of the area (m^2)."""

SIZES = {False: ((9, 17, 33), (5, 7)), True: ((17, 33, 65), (5, 7, 9, 11))}
"""Nodes and control points along the edges of the cube, at the larger size (True) and small."""

DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_SLSQP": nlopt}


class Body:
    """A cube of unit volume whose control points move along rays: ``model``, ``parametrization`` and ``surface``."""

    def __init__(self, n_nodes: int, n_control: int):
        grid = bm.generators.brick_grid((n_nodes, n_nodes, n_nodes, 9), far=5.0)
        self.model = bm.fit_grid(grid, n_control=(n_control, n_control, 5))
        mesh, self.surface = bm.movers.moving_mesh(self.model), bm.measures.SurfaceGrid.of(self.model)
        points = mesh.points[mesh.surface_ids]
        rays = points / np.linalg.norm(points, axis=1, keepdims=True)
        self.parametrization = bm.design.Parametrization(mesh, [bm.design.Local("radial", direction=rays)])

    def problem(self) -> om.Problem:
        """Least area at unit volume, not set up; the grid does not move along."""
        problem = om.Problem(reports=None)
        evaluate = bm.SurfaceEvaluate(model=self.model, mesh=self.parametrization.mesh, surface=self.surface)
        area, volume = bm.measures.SurfaceArea.of(self.surface), bm.measures.EnclosedVolume.of(self.surface)
        problem.model.add_subsystem("control", bm.SurfaceControl(parametrization=self.parametrization), promotes=["*"])
        problem.model.add_subsystem("evaluate_surface", evaluate, promotes=["*"])
        problem.model.add_subsystem("area", bm.SurfaceMeasure(measure=area), promotes=["*"])
        problem.model.add_subsystem("volume", bm.SurfaceMeasure(measure=volume), promotes=["*"])
        problem.model.add_design_var("radial", ref=0.2)
        problem.model.add_objective("surface_area")
        problem.model.add_constraint("volume", equals=1.0)
        return problem


def started(body: Body) -> om.Problem:
    """Run the problem off the cube, whose symmetry makes derivatives vanish."""
    problem = body.problem()
    problem.setup(mode="rev")
    problem.run_model()
    return perturb_design(problem)


def solve(body: Body, drivers) -> dict[str, RecordedRun]:
    """Find the least area with every driver."""
    runs: dict[str, RecordedRun] = {}
    for driver, make_driver in drivers.items():
        problem = body.problem()
        problem.driver = make_driver(TOLERANCE, 500)
        with recorded(problem) as runs[driver]:
            problem.run_driver()
    return runs


def main(paper: bool = False, figures=None, drivers=DRIVERS) -> dict:
    """Round the cube on several grids with every driver.

    Parameters
    ----------
    paper : bool
        More and larger grids.
    figures : path-like, optional
        Folder for ``min_area_body.png`` and the N2 diagram ``min_area_body.html``.
    drivers : dict
        Makers of drivers by name.

    Returns
    -------
    dict
        ``area``, the analytic optimum (m^2); for each driver what `RecordedRun.numbers` returns of the finest grid,
        ``roundness``, the largest distance of a node from the ball relative to its radius, and by number of control
        points along an edge, on grids ever finer, the relative ``errors`` of the area, their ``orders``, and the error
        ``of_splines`` that is left when they are extrapolated; ``totals``, see `check_totals`; of the grid that
        follows, ``n_inverted`` and the smallest corner triple product ``min_corner``.
    """
    n_nodes, n_control = SIZES[paper]
    bodies = {n: [Body(m, n) for m in n_nodes] for n in n_control}
    solved = {n: [solve(body, drivers) for body in row] for n, row in bodies.items()}
    body, runs = bodies[n_control[-1]][-1], solved[n_control[-1]][-1]
    best, start = next(reversed(runs.values())).problem, started(body)

    movement = bm.GridMovement(model=body.model, parametrization=body.parametrization)
    followed = om.Problem(movement, reports=None)
    followed.setup()
    followed.set_val("radial", best.get_val("radial"))
    followed.run_model()
    cells = movement.quality.report()

    summaries = {}
    for name, result in runs.items():
        radii = np.linalg.norm(result.problem.get_val("surface").reshape(-1, 3), axis=1)
        by_control = {n: [each[name].problem for each in row] for n, row in solved.items()}
        summaries[name] = result.numbers() | {
            "roundness": np.abs(radii / RADIUS - 1.0).max(),
            **convergence(by_control),
        }
    if figures:
        errors = summaries[next(reversed(runs))]["errors"]
        draw(figures, body.surface, best, runs, {n: (1.0 / (np.array(n_nodes) - 1.0), e) for n, e in errors.items()})
        om.n2(start, outfile=str(Path(figures) / "min_area_body.html"), show_browser=False)
    return {
        "area": AREA,
        "n_variables": {n: len(row[0].parametrization.initial["radial"]) for n, row in bodies.items()},
        "n_nodes": n_nodes,
        "drivers": summaries,
        "totals": check_totals(start)._asdict(),
        "n_inverted": cells.n_inverted,
        "min_corner": cells.min_corner,
    }


def convergence(problems: dict[int, list[om.Problem]]) -> dict:
    """Errors of the area on grids whose spacing is halved, and what is left in the limit, by control points."""
    numbers = {"errors": {}, "orders": {}, "of_splines": {}}
    for n, row in problems.items():
        errors = np.array([problem.get_val("surface_area").item() for problem in row]) / AREA - 1.0
        differences = errors[:-1] - errors[1:]
        numbers["errors"][n] = errors
        numbers["orders"][n] = np.log2(differences[:-1] / differences[1:])
        numbers["of_splines"][n] = errors[-1] - differences[-1] / 3.0
    return numbers


def draw(folder, surface: bm.measures.SurfaceGrid, best: om.Problem, runs: dict, errors: dict) -> None:
    """Draw the cube and what became of it, the convergence with the grid and the histories."""
    with figure(folder, "min_area_body", (10.5, 3.4), n_colours=64) as canvas:
        shape, convergence, history = canvas.subplots(1, 3)
        draw_surface(shape, surface, surface.points, GRAY, -0.75)
        draw_surface(shape, surface, best.get_val("surface").reshape(-1, 3), BLUE, 0.75)
        shape.set_aspect("equal")
        shape.set_axis_off()
        for color, (n, (spacing, values)) in zip((BLUE, ORANGE, GREEN, RED), errors.items()):
            convergence.loglog(spacing, values, "o-", color=color, label=f"{n} x {n} control points on a face")
        convergence.loglog(spacing, 0.2 * spacing**2, "--", color=GRAY, label="order 2")
        convergence.set(xlabel="spacing of nodes relative to the cube", ylabel="relative error of the area")
        convergence.set_xticks(spacing, [f"1/{1.0 / each:.0f}" for each in spacing])
        convergence.set_xticks([], minor=True)
        convergence.legend(fontsize=8)
        draw_history(
            history, runs, "surface_area", "relative error of the area", lambda area: np.abs(area / AREA - 1.0)
        )


def draw_surface(axes, surface: bm.measures.SurfaceGrid, nodes: np.ndarray, color: str, offset: float) -> None:
    """Draw the grid lines of a body where they face the observer, who looks from (1, 1, 1)."""
    view = np.array([[-1.0, 1.0, 0.0], [-1.0, -1.0, 2.0]]) / np.sqrt([[2.0], [6.0]])
    for ids in surface.faces:
        face = nodes[ids]
        normals = np.cross(np.gradient(face, axis=0), np.gradient(face, axis=1))
        seen = np.where(normals.sum(axis=-1, keepdims=True) > 0.0, face @ view.T, np.nan)
        draw_net(axes, seen + [offset, 0.0], color=color, linewidth=0.4)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/min_area_body.png'
