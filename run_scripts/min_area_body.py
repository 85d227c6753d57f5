"""The body of least surface at a given volume: a cube becomes a ball.

The analytic optimum is the ball, of area ``(36 pi V^2)^(1/3)``. Every control point of the cube's surface moves along
the ray from the centre. No polyhedron has less area than the ball, so that the optimum on every grid lies above it, by
an error of second order in the size of the quads until that of the splines is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import openmdao.api as om
from common import BLUE, GRAY, GREEN, ORANGE, RED, figure, run
from history import draw_history
from optimisation import DRIVERS, Run, optimise, set_up, write_n2
from totals import check_totals, move_at_random

from bspline_mdao import FittedModel, GridMovement, brick_grid, fit_grid, moving_mesh
from bspline_mdao.design.displacement import Local
from bspline_mdao.design.parametrization import Parametrization
from bspline_mdao.measures.area import SurfaceArea
from bspline_mdao.measures.volume import EnclosedVolume
from bspline_mdao.mesh.surface import SurfaceGrid
from bspline_mdao.om.surface_control import SurfaceControl
from bspline_mdao.om.surface_evaluate import SurfaceEvaluate
from bspline_mdao.om.surface_measure import SurfaceMeasure

AREA = (36.0 * np.pi) ** (1.0 / 3.0)
"""Area of the ball of unit volume (m^2)."""

RADIUS = (0.75 / np.pi) ** (1.0 / 3.0)
"""Its radius (m)."""

FAR = 5.0
"""Radius of the outer boundary (m)."""

TOLERANCE = 1e-13
"""Of the area (m^2)."""

SIZES = {False: ((9, 17, 33), (5, 7)), True: ((17, 33, 65), (5, 7, 9, 11))}
"""Nodes and control points along the edges of the cube, at the larger size (True) and small."""

COLORS = (BLUE, ORANGE, GREEN, RED)


@dataclass(frozen=True, eq=False)
class Body:
    """A cube of unit volume whose control points move along rays.

    Parameters
    ----------
    model : FittedModel
        Fit of the grid about it.
    parametrization : Parametrization
        One value for every surface control point (m).
    surface : SurfaceGrid
        Its nodes.
    """

    model: FittedModel
    parametrization: Parametrization
    surface: SurfaceGrid

    @classmethod
    def of(cls, n_nodes: int, n_control: int) -> Body:
        """Make one with so many nodes and control points along its edges."""
        grid = brick_grid((n_nodes, n_nodes, n_nodes, 9), far=FAR)
        model = fit_grid(grid, n_control=(n_control, n_control, 5))
        mesh = moving_mesh(model)
        points = mesh.points[mesh.surface_ids]
        rays = points / np.linalg.norm(points, axis=1, keepdims=True)
        return cls(model, Parametrization(mesh, [Local("radial", direction=rays)]), SurfaceGrid.of(model))

    def problem(self) -> om.Problem:
        """Least area at unit volume, not set up; the grid does not move along."""
        problem, mesh = om.Problem(reports=False), self.parametrization.mesh
        components = {
            "control": SurfaceControl(parametrization=self.parametrization),
            "evaluate_surface": SurfaceEvaluate(model=self.model, mesh=mesh, surface=self.surface),
            "area": SurfaceMeasure(measure=SurfaceArea.of(self.surface)),
            "volume": SurfaceMeasure(measure=EnclosedVolume.of(self.surface)),
        }
        for name, component in components.items():
            problem.model.add_subsystem(name, component, promotes=["*"])
        problem.model.add_design_var("radial", ref=0.2)
        problem.model.add_objective("surface_area")
        problem.model.add_constraint("volume", equals=1.0)
        return problem

    def roundness(self, problem: om.Problem) -> float:
        """Largest distance of a node from the ball by its radius."""
        nodes = problem.get_val("surface").reshape(-1, 3)
        return float(np.abs(np.linalg.norm(nodes, axis=1) / RADIUS - 1.0).max())

    def follow(self, radial: np.ndarray) -> om.Problem:
        """Move the grid behind the body."""
        problem = om.Problem(GridMovement(model=self.model, parametrization=self.parametrization), reports=False)
        problem.setup()
        problem.set_val("radial", radial)
        problem.run_model()
        return problem


def main(paper: bool = False, figures=None, drivers=DRIVERS) -> dict:
    """Round the cube on several grids with every driver.

    Parameters
    ----------
    paper : bool
        More and larger grids.
    figures : path-like, optional
        Folder for ``min_area_body.png`` and the N2 diagram ``min_area_body.html``.
    drivers : dict
        Makers of drivers by name, see `optimisation.DRIVERS`.

    Returns
    -------
    dict
        ``area``, the analytic optimum (m^2); for each driver what `optimisation.Run.numbers` tells of the finest grid,
        ``roundness``, the largest distance of a node from the ball by its radius, and by number of control points along
        an edge, on grids ever finer, the relative ``errors`` of the area, their ``orders``, and the error
        ``of_splines`` that is left when they are extrapolated; ``totals``, see `totals.check_totals`; of the grid
        that follows, ``n_inverted`` and the smallest corner triple product ``min_corner``.
    """
    n_nodes, n_control = SIZES[paper]
    bodies = {n: [Body.of(m, n) for m in n_nodes] for n in n_control}
    studies = {
        name: {n: [optimise(body.problem, make(TOLERANCE, 500)) for body in row] for n, row in bodies.items()}
        for name, make in drivers.items()
    }
    body, runs = bodies[n_control[-1]][-1], {name: study[n_control[-1]][-1] for name, study in studies.items()}
    best = next(reversed(runs.values())).problem
    followed = body.follow(best.get_val("radial"))  # a component does not keep its problem alive
    cells = followed.model.quality.report()
    numbers = {
        "area": AREA,
        "n_variables": {n: len(row[0].parametrization.initial["radial"]) for n, row in bodies.items()},
        "n_nodes": n_nodes,
        "drivers": {
            name: result.numbers() | {"roundness": body.roundness(result.problem), **convergence(studies[name])}
            for name, result in runs.items()
        },
        "totals": check_totals(move_at_random(set_up(body.problem()))),
        "n_inverted": cells.n_inverted,
        "min_corner": cells.min_corner,
    }
    if figures:
        draw(figures, body, runs, best, numbers)
        write_n2(set_up(body.problem()), figures, "min_area_body")
    return numbers


def convergence(study: dict[int, list[Run]]) -> dict:
    """Errors of the area on grids whose spacing is halved, and what is left in the limit, by control points."""
    numbers = {"errors": {}, "orders": {}, "of_splines": {}}
    for n, runs in study.items():
        errors = np.array([result.problem.get_val("surface_area").item() for result in runs]) / AREA - 1.0
        differences = errors[:-1] - errors[1:]
        numbers["errors"][n] = errors
        numbers["orders"][n] = np.log2(differences[:-1] / differences[1:])
        numbers["of_splines"][n] = errors[-1] - differences[-1] / 3.0
    return numbers


def draw(folder, body: Body, runs: dict[str, Run], best: om.Problem, numbers: dict) -> None:
    """Draw the cube and what became of it, the convergence with the grid and the histories."""
    with figure(folder, "min_area_body", (10.5, 3.4)) as canvas:
        shape, errors, history = canvas.subplots(1, 3)
        draw_surface(shape, body.surface, body.surface.points, GRAY, -0.75)
        draw_surface(shape, body.surface, best.get_val("surface").reshape(-1, 3), BLUE, 0.75)
        shape.set_aspect("equal")
        shape.set_axis_off()
        spacing = 1.0 / (np.array(numbers["n_nodes"]) - 1.0)
        for color, (n, values) in zip(COLORS, numbers["drivers"][next(reversed(runs))]["errors"].items()):
            errors.loglog(spacing, values, "o-", color=color, label=f"{n} x {n} control points on a face")
        errors.loglog(spacing, 0.2 * spacing**2, "--", color=GRAY, label="order 2")
        errors.set(xlabel="spacing of nodes by edge of the cube", ylabel="relative error of the area")
        errors.legend(fontsize=8)
        draw_history(history, runs, "surface_area", "relative error of the area", lambda area: area / AREA - 1.0)


def draw_surface(axes, surface: SurfaceGrid, nodes: np.ndarray, color: str, offset: float) -> None:
    """Draw the grid lines of a body where they face the observer, who looks from (1, 1, 1)."""
    view = np.array([[-1.0, 1.0, 0.0], [-1.0, -1.0, 2.0]]) / np.sqrt([[2.0], [6.0]])
    for ids in surface.faces:
        face = nodes[ids]
        normals = np.cross(np.gradient(face, axis=0), np.gradient(face, axis=1))
        x, y = np.moveaxis(np.where(normals.sum(axis=-1, keepdims=True) > 0.0, face @ view.T, np.nan), -1, 0)
        for lines in ((x, y), (x.T, y.T)):
            axes.plot(lines[0] + offset, lines[1], color=color, linewidth=0.4)


if __name__ == "__main__":
    run(main, __doc__)
