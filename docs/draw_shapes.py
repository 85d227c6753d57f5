"""Draw the way from a shape to its optimum for the landing page: of an airfoil, and of a surface.

``python docs/draw_shapes.py`` writes ``docs/_static/shapes.png``. Above, a name or a file of points becomes a grid, and
that an airfoil without a shock: least drag of the Euler equations at M 0.72 and one lift, area and thickness kept.
Below, a surface grid becomes a volume grid by extrusion, and that a body of the least skin around the volume of a ball
of its length, which is that ball. It takes two minutes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, GRAY, draw_net, draw_pressures, figure, wall_quads

STATIC = Path(__file__).parent / "_static"

N_ALONG, N_AROUND = 49, 41
"""Points of the body along its axis, and around."""

BALL = 16.0 * np.pi, 32.0 * np.pi / 3.0
"""Surface (m^2) and volume (m^3) of the ball of the same length."""

STATIONS = 17
"""Factors on the radius of the body along its axis."""


def airfoil() -> tuple[bm.FittedModel, om.Problem, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Least drag of the NACA 0012; the problem, and nodes and pressures before and after."""
    model = bm.fit_grid(bm.generators.airfoil_grid("naca0012"))
    wing = bm.DesignSurface.of(model)
    area = bm.measures.SectionArea.of(wing.surface, relative=True)
    parts = [0.02, 0.1, 0.25, 0.4, 0.6, 0.75, 0.9, 0.97]
    thickness = bm.measures.Thickness.of_sections(
        wing.surface, parts=parts, stations=None, relative=True, name="thickness"
    )
    shape = wing.grid_movement([bm.design.ClassShape("shape", 5)], measures=[area, thickness], quality=False, fit=False)
    problem = om.Problem(driver=bm.NLoptDriver(optimizer="LD_SLSQP", ftol_rel=1e-6, maxeval=25), reports=None)
    top = problem.model
    top.add_subsystem("shape_and_grid", shape, promotes=["*"])
    flow = bm.EulerFlow(model=model, reference_area=wing.planform_area, trim=True)
    top.add_subsystem("flow", flow, promotes=["*"])
    top.set_input_defaults("CL_target", 0.5)
    top.set_input_defaults("Mach_number", 0.72)
    top.add_design_var("shape", lower=-0.1, upper=0.1, ref=0.1)
    top.add_objective("CD", ref=0.01)
    top.add_constraint("section_area", lower=1.0)
    top.add_constraint("thickness", lower=0.8, ref=0.8)
    return (model, *solved(problem, ("grid", "Cp", "CD")))


def body() -> tuple[bm.Grid, bm.FittedModel, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Least skin of a body around the volume of a ball of its length; its surface, and nodes before and after."""
    x = 2.0 - 2.0 * np.cos(np.linspace(0.0, np.pi, N_ALONG))
    angle = np.linspace(0.0, 2.0 * np.pi, N_AROUND)
    ball = 2.0 * np.sqrt(np.maximum(1.0 - (0.5 * x - 1.0) ** 2, 0.0))
    radius = ball * (1.0 + 0.2 * np.cos(np.pi * x))
    around = np.stack([np.cos(angle), np.sin(angle)])
    nodes = np.stack(np.broadcast_arrays(x[:, None], radius[:, None] * around[0], radius[:, None] * around[1]), axis=-1)
    surface = bm.Grid((bm.grids.Block(nodes[..., None, :], "body"),))
    volume = bm.generators.extrude_surface(surface, first_cell=0.05, layers=24, outer=30.0)
    model = bm.fit_grid(volume, n_control=(25, 21, 9))
    hull = bm.DesignSurface.of(model)
    factors = bm.design.RadiusFactor("radius", [(0.0, 0.0, 0.0), (4.0, 0.0, 0.0)], stations=STATIONS)
    area, enclosed = bm.measures.SurfaceArea.of(hull.surface), bm.measures.EnclosedVolume.of(hull.surface)
    problem = om.Problem(driver=bm.NLoptDriver(optimizer="LD_SLSQP", ftol_rel=1e-8, maxeval=60), reports=None)
    top = problem.model
    movement = hull.grid_movement([factors], measures=[area, enclosed], quality=False, fit=False)
    top.add_subsystem("shape_and_grid", movement, promotes=["*"])
    top.add_design_var("radius", lower=0.5, upper=2.0)
    top.add_objective("surface_area", ref=1.0)
    top.add_constraint("volume", equals=BALL[1], ref=BALL[1])
    return (surface, model, *solved(problem, ("grid", "surface_area"))[1:])


def solved(problem: om.Problem, names: tuple[str, ...]) -> tuple[om.Problem, dict, dict]:
    """Run an optimisation; outputs before and after."""
    problem.setup(mode="rev")
    problem.run_model()
    before = {name: problem.get_val(name).copy() for name in names}
    problem.run_driver()
    return problem, before, {name: problem.get_val(name).copy() for name in names}


def main() -> None:
    """Draw both."""
    with figure(STATIC, "shapes", (11.0, 5.6), n_colours=32) as drawing:
        rows = drawing.subplots(2, 3, width_ratios=(1.0, 1.0, 1.25))
        draw_airfoil(*rows[0])
        draw_body(*rows[1])
        for axes, title in zip(rows.ravel(), (
            "naca0012, or a file of points", "its grid", "least drag at M 0.72 and one lift",
            "a surface grid", "its volume grid, by extrusion", f"least skin: a ball has {BALL[0]:.2f} m²",
        )):  # fmt: skip
            axes.set_title(title, fontsize=10)


def draw_airfoil(points, grid, optimum) -> None:
    """Points of the section, the grid around it, and sections and pressures before and after."""
    model, _, before, after = airfoil()
    print("CD", before["CD"], after["CD"])
    net = model.regenerate().blocks[0].nodes[:, :, 0]
    points.plot(net[:, 0, 0], net[:, 0, 1], ".", color=GRAY, markersize=3)
    points.set(aspect="equal", ylim=(-0.3, 0.3), xlabel="$x / c$", ylabel="$y / c$")
    draw_net(grid, net[..., :2], color=GRAY, linewidth=0.4)
    grid.set(aspect="equal", xlim=(-0.5, 1.5), ylim=(-0.6, 0.6), xlabel="$x / c$", ylabel="$y / c$")
    quads = wall_quads(model)
    section = optimum.inset_axes((0.0, 0.0, 1.0, 0.3), sharex=optimum)
    for found, color, name in ((before, GRAY, "before"), (after, BLUE, "after")):
        nodes, counts = found["grid"].reshape(-1, 3), 1e4 * found["CD"].item()
        label = f"{name}: {counts:.0f} counts" if counts > 1.0 else f"{name}: no drag but the grid's error"
        draw_pressures(optimum, nodes[quads], found["Cp"], 0.5, color=color, label=label)
        around = nodes.reshape(*model.regenerate().blocks[0].nodes.shape)[:, 0, 0]
        section.plot(around[:, 0], around[:, 1], color=color)
    optimum.set(ylim=(3.0, -2.2), yticks=(1.0, 0.0, -1.0))
    section.set_aspect("equal", adjustable="datalim")
    section.axis("off")
    optimum.legend(framealpha=1.0, edgecolor="none", fontsize=8, loc="upper right")


def draw_body(sheet, volume, optimum) -> None:
    """The surface from aside, a cut of the volume, and profiles before and after."""
    surface, model, before, after = body()
    print("area", after["surface_area"])
    nodes = surface.blocks[0].nodes[:, :, 0]
    seen = np.where(nodes[..., 2:] >= -1e-9, nodes, np.nan)
    draw_net(sheet, seen[..., :2], color=GRAY, linewidth=0.4)
    shape = model.regenerate().blocks[0].nodes.shape
    along = shape.index(N_ALONG)
    for found, color, name in (
        (before, GRAY, f"before: {before['surface_area'].item():.2f} m²"),
        (after, BLUE, f"after: {after['surface_area'].item():.2f} m²"),
    ):
        cut = np.moveaxis(found["grid"].reshape(shape), along, 0)
        for row in (0, cut.shape[1] // 2):
            axes, width = (volume, 0.4) if color == GRAY else (optimum, 0.2)
            draw_net(axes, cut[:, row, :, :2], color=color, linewidth=width)
            optimum.plot(cut[:, row, 0, 0], cut[:, row, 0, 1], color=color, label=name if row == 0 else None)
    for axes in (sheet, volume, optimum):
        axes.set(aspect="equal", xlim=(-2.0, 6.0), ylim=(-3.2, 3.2), xlabel="$x$ (m)", ylabel="$y$ (m)")
    optimum.legend(framealpha=1.0, edgecolor="none", fontsize=8, loc="center", handlelength=0.8)


if __name__ == "__main__":
    main()
