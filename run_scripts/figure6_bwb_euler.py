"""Figure 6: flow about a blended-wing body.

The flow about the blended-wing body that a flat plate became, at Mach 0.3 and 4 degrees. The grid about a flat plate is
fitted, its control mesh moves to the body, the grid is regenerated, and the Euler equations are solved on it: one chain
of components. It takes ten seconds, and ten minutes at the paper's size. The output is lift and drag, how the flow
converged, the time of the derivatives of the lift through the whole chain, and a picture of the surface mesh, the
pressures and the history.
"""

from __future__ import annotations

import time

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.flow import openfoam_forces, run_flow
from bspline_mdao.names import GRID, SURFACE_CONTROL_POINTS
from bspline_mdao.plotting import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    RED,
    Camera,
    Paint,
    Scene,
    draw_pressures,
    draw_scene,
    figure,
    patch_faces,
    wall_quads,
)
from bspline_mdao.scripts import pick_size, run

MACH, ALPHA = 0.3, 4.0

SIZES = {"quick": (9, 7), "default": (13, 7), "paper": (45, 9)}
"""Nodes and control points of every block in each direction."""

CAMERA, PANEL = Camera(focus=(0.8, 0.05, 0.62), direction=(-0.35, 1.3, 0.35), height=1.45), (4.6, 2.4)
"""Where the body is seen from, and the width and height of a picture in inches."""

PLACES = dict(zip((0.1, 0.5, 0.9, 1.3), (BLUE, ORANGE, GREEN, PURPLE)))
"""Colours of the sections along the span (m)."""


def main(
    paper: bool = False, figures=None, quick: bool = False, openfoam: bool = False, iprint: int = 0, fields=None
) -> dict:
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
    fields : path-like, optional
        File of the fields for ParaView, ``body.vtm``.

    Returns
    -------
    dict
        ``reference_area`` of the half body (m^2), ``n_variables`` (coordinates of surface control points), what
        `run_flow` returns, the times of the grid included; ``gradient_seconds``, wall time of the derivatives of the
        lift with respect to all variables; ``openfoam`` if it was asked; and ``drawn_by``, if anything was.
    """
    n_nodes, n_control = pick_size(SIZES, paper, quick)
    model = bm.fit_grid(bm.generators.flat_plate_grid((n_nodes,) * 3), n_control=(n_control,) * 3, keep_residual=False)
    mesh, body = bm.movers.moving_mesh(model), bm.generators.generic_blended_wing_body()
    target, surface = bm.generators.fit_shape(model, mesh.surface_ids, body), bm.measures.SurfaceGrid.of(model, "wing*")
    area = bm.measures.ProjectedArea.of(surface, np.array([0.0, 1.0, 0.0])).evaluate(
        bm.generators.nodes_on_shape(model, body)[surface.rows]
    )

    problem, mover = om.Problem(reports=None), bm.movers.LinearElasticity(mesh, n_increments=5)
    geometry = bm.GridMovement(model=model, mover=mover, fit=False)
    flow = bm.EulerFlow(model=model, reference_area=area.item(), iprint=iprint)
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup(mode="rev")
    problem.set_val("Mach_number", MACH)
    problem.set_val("alpha", ALPHA, units="deg")
    problem.set_val(SURFACE_CONTROL_POINTS, target.ravel())
    numbers = {"reference_area": area.item(), "n_variables": target.size, **run_flow(problem)}
    start = time.perf_counter()
    problem.compute_totals(["CL"], [SURFACE_CONTROL_POINTS])
    numbers["gradient_seconds"] = time.perf_counter() - start
    if fields:
        flow.write_fields(fields)

    nodes, other = problem.get_val(GRID).reshape(-1, 3), None
    if openfoam:
        try:
            other = openfoam_forces(model.topology, nodes, MACH, ALPHA, area.item())
            names = ("CL", "CD", "seconds", "n_iterations", "is_converged")
            numbers["openfoam"] = (
                {name: getattr(other, name) for name in names} if other else {"refused": "not installed"}
            )
        except (bm.InputError, bm.SolverError) as error:
            numbers["openfoam"] = {"refused": str(error)}
    if figures:
        with figure(figures, "figure6_bwb_euler", size=(2.0 * PANEL[0] + 0.6, PANEL[1] + 3.4)) as canvas:
            panels = canvas.subplots(2, 2, height_ratios=(PANEL[1], 3.2))
            numbers["drawn_by"] = draw_body(panels[0], model, nodes, problem.get_val("Cp"))
            draw_sections(panels[1, 0], nodes[wall_quads(model)], problem.get_val("Cp"), other)
            draw_residuals(panels[1, 1], flow.state.solution.history)
    return numbers


def draw_body(panels, model: bm.FittedModel, nodes: np.ndarray, pressures: np.ndarray) -> str:
    """Draw surface mesh and pressures in space; returns what drew them."""
    blocks = model.header.grid(model.topology.shapes, nodes).blocks
    mesh = Scene(patch_faces(model, "wing", [block.nodes for block in blocks]), [], line_width=0.25)
    paint = Paint(nodes, wall_quads(model), pressures, (-1.0, 0.5))
    draw_scene(panels[0], mesh, CAMERA, PANEL)
    drawn_by = draw_scene(panels[1], Scene([], [], paint=paint), CAMERA, PANEL)
    panels[1].figure.colorbar(paint.mappable(), ax=panels[1], label="$C_p$", extend="both", shrink=0.8)
    return drawn_by


def draw_sections(axes, quads: np.ndarray, pressures: np.ndarray, other) -> None:
    """Draw pressures along sections, OpenFOAM's with dots."""
    for place, color in PLACES.items():
        draw_pressures(axes, quads, pressures, place, color=color, linewidth=1.0, label=f"$z$ = {place:g} m")
        if other is not None:
            draw_pressures(axes, quads, other.Cp, place, color=color, marker=".", markersize=3, linestyle="")
    axes.legend(fontsize=8)


def draw_residuals(axes, history) -> None:
    """Draw the residual over the products with the Jacobian, which take most of the time."""
    products = np.cumsum([step.n_products for step in history])
    axes.semilogy(products, [step.residual for step in history], "o-", color=RED, markersize=3)
    axes.set(xlabel="products with the Jacobian, dots: Newton steps", ylabel="residual (1: uniform stream)")


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/figure6_bwb_euler.png'
