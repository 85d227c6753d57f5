"""Figure 6: the flow about the blended-wing body that a flat plate became, at Mach 0.3 and 4 degrees.

The grid about a flat plate is fitted, its control mesh moves to the body, the grid is regenerated, and the Euler
equations are solved on it: one chain of components.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import openmdao.api as om
from common import BLUE, GREEN, ORANGE, PURPLE, RED, figure, run
from euler_runs import (
    OPTIONS,
    Condition,
    flow_problem,
    nodes_of,
    run_euler,
    run_openfoam,
    seconds_of,
    solution_of,
    wall_quads,
)
from flown_wing import size_of
from matplotlib.colors import Normalize
from morphs import BLENDED_WING_BODY, PAPER_INCREMENTS, Morph
from scenes import Camera, Paint, Scene, draw_scene, faces_of
from wall_sections import draw_pressures

from bspline_mdao import GridMovement, LinearElasticity, ProjectedArea, SurfaceGrid, nodes_on_shape
from bspline_mdao.names import SURFACE_CONTROL_POINTS

MACH, ALPHA = 0.3, 4.0
UP = np.array([0.0, 1.0, 0.0])

CAMERA = Camera(focus=(0.8, 0.05, 0.62), direction=(-0.35, 1.3, 0.35), height=1.45)
PANEL = (4.6, 2.4)
"""Width and height of a picture in inches."""

PLACES = (0.1, 0.5, 0.9, 1.3)
"""Sections along the span (m)."""

PRESSURES = Normalize(-1.0, 0.5)
"""Range of colours."""


class Size(NamedTuple):
    """Nodes and control points of every block in each direction."""

    n_nodes: int
    n_control: int


SIZES = {"quick": Size(9, 7), "default": Size(13, 7), "paper": Size(45, 9)}


def main(paper: bool = False, figures=None, quick: bool = False, openfoam: bool = False, iprint: int = 0) -> dict:
    """Move the grid, solve the flow, and differentiate the lift through the whole chain.

    Parameters
    ----------
    paper : bool
        12 blocks of 45 x 45 x 45 nodes, a million cells, with 9 x 9 x 9 control points; some 8 GB.
    figures : path-like, optional
        Folder for ``figure6_bwb_euler.png``.
    quick : bool
        6,144 cells.
    openfoam : bool
        Ask OpenFOAM as well, where it is installed.
    iprint : int
        1 for a line when the flow is solved, 2 for one a Newton step.

    Returns
    -------
    dict
        ``reference_area`` of the half body (m^2), ``n_variables`` (coordinates of surface control points), what
        `euler_runs.run_euler` tells, the times of the grid included; ``gradient_seconds``, wall time of the derivatives
        of the lift in all variables; ``openfoam`` if it was asked; and ``drawn_by``, if anything was.
    """
    size = size_of(SIZES, paper, quick)
    case = BLENDED_WING_BODY
    morph = Morph.of(case, case.make_grid((size.n_nodes,) * 3), (size.n_control,) * 3)
    condition = Condition(MACH, ALPHA, planform_area(morph))
    problem = chain(morph, condition, iprint)
    numbers = {"reference_area": condition.area, "n_variables": morph.surface.size, **run_euler(problem)}
    numbers["gradient_seconds"] = seconds_of(lambda: problem.compute_totals(["CL"], [SURFACE_CONTROL_POINTS]))
    other = None
    if openfoam:
        numbers["openfoam"], other = run_openfoam(problem, morph.model, condition)
    if figures:
        numbers["drawn_by"] = draw(figures, morph, problem, other)
    return numbers


def planform_area(morph: Morph) -> float:
    """Area of the half body as seen from above (m^2)."""
    surface = SurfaceGrid.of(morph.model, "wing*")
    nodes = nodes_on_shape(morph.model, BLENDED_WING_BODY.make_shape())
    return ProjectedArea.of(surface, UP).evaluate(nodes[surface.rows]).item()


def chain(morph: Morph, condition: Condition, iprint: int) -> om.Problem:
    """Wire the surface of the body to the moved control mesh, the regenerated grid and the flow."""
    mover = LinearElasticity(morph.mesh, n_increments=PAPER_INCREMENTS)
    geometry = GridMovement(model=morph.model, mover=mover, fit=False)
    problem = flow_problem(morph.model, condition, geometry=geometry, iprint=iprint)
    problem.set_val(SURFACE_CONTROL_POINTS, morph.surface.ravel())
    return problem


def draw(folder, morph: Morph, problem: om.Problem, other: np.ndarray | None) -> str:
    """Draw surface mesh, pressures and history; returns what drew the pictures in space."""
    quads, nodes, pressures = wall_quads(morph.model), nodes_of(problem), problem.get_val("Cp")
    paint = Paint(nodes, quads, pressures, PRESSURES)
    grid = morph.model.header.grid(morph.model.topology.shapes, nodes)
    mesh = Scene(faces_of(morph.model, "wing", [block.nodes for block in grid.blocks]), [], line_width=0.25)
    with figure(folder, "figure6_bwb_euler", size=(2.0 * PANEL[0] + 0.6, PANEL[1] + 3.4)) as canvas:
        (surface, colors), (sections, history) = canvas.subplots(2, 2, height_ratios=(PANEL[1], 3.2))
        draw_scene(surface, mesh, CAMERA, PANEL)
        drawn_by = draw_scene(colors, Scene([], [], paint=paint), CAMERA, PANEL)
        canvas.colorbar(paint.mappable(), ax=colors, label="$C_p$", extend="both", shrink=0.8)
        draw_sections(sections, nodes[quads], pressures, other)
        draw_history(history, problem)
    return drawn_by


def draw_sections(axes, quads: np.ndarray, pressures: np.ndarray, other: np.ndarray | None) -> None:
    """Draw pressures along sections, those of OpenFOAM with dots."""
    for place, color in zip(PLACES, (BLUE, ORANGE, GREEN, PURPLE)):
        label = f"$z$ = {place:g} m"
        draw_pressures(axes, quads, pressures, place, {"color": color, "linewidth": 1.0, "label": label})
        if other is not None:
            draw_pressures(axes, quads, other, place, {"color": color, "marker": ".", "markersize": 3, "linestyle": ""})
    axes.legend(fontsize=8)


def draw_history(axes, problem: om.Problem) -> None:
    """Draw the residual over the products with the Jacobian, which take most of the time."""
    history = solution_of(problem).history
    products = np.cumsum([step.n_products for step in history])
    axes.semilogy(products, [step.residual for step in history], "o-", color=RED, markersize=3)
    axes.set(xlabel="products with the Jacobian, dots: Newton steps", ylabel="residual by that of the uniform stream")


if __name__ == "__main__":
    run(main, __doc__, **OPTIONS)
