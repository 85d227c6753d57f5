"""Draw what is on the pages of the reference, one small picture for each.

``python docs/draw_reference.py`` writes ``docs/_static/reference/*.png``; names behind it choose some. Everything in
them is made by the names of the page that shows it. It takes half a minute.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import openmdao.api as om
from page_pictures import draw_pictures, in_plane, panels

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, GRAY, GREEN, ORANGE, RED, draw_net, draw_pressures, wall_quads

FOLDER = Path(__file__).parent / "_static" / "reference"

AROUND = {"aspect": "equal", "xlim": (-0.35, 1.35), "ylim": (-0.45, 0.45), "xticks": (), "yticks": ()}
"""What is seen around a section."""

NET = {"linewidth": 0.5}
"""Grid lines."""


def grids(drawing) -> None:
    """Blocks, and the quality of cells."""
    blocks, patches, quality = panels(drawing, ("blocks", "patches", "Q of the cells"))
    grid = bm.generators.airfoil_grid("naca0012", 32, 16, topology="C")
    colors = BLUE, GRAY, ORANGE
    for block, color in zip(grid.blocks, colors):
        draw_net(blocks, in_plane(block), color=color, **NET)
        draw_net(patches, in_plane(block), color="#cccccc", **NET)
    for patch in grid.patches:
        for window in patch.windows if patch.kind == "wall" else ():
            nodes = grid.blocks[window.block].nodes[window.slices]
            patches.plot(*nodes.reshape(-1, *nodes.shape[-2:])[:, 0, :2].T, color=ORANGE, linewidth=2.0)
            patches.set_title(f"patch {patch.name}, a {patch.kind}", fontsize=10)
    for sheet in bm.plotting.sheets_of(grid, ("symmetry",), "quality"):
        if sheet.kind == "symmetry":
            shown = quality.pcolormesh(*sheet.points[..., :2].transpose(2, 0, 1), sheet.values["Q"], vmin=0.0, vmax=1.0)
    drawing.colorbar(shown, ax=quality, shrink=0.8)
    for axes in (blocks, patches, quality):
        axes.set(**AROUND | {"xlim": (-0.6, 1.9), "ylim": (-0.9, 0.9)})


def generators(drawing) -> None:
    """A section, a wing, a body, and a box."""
    around, wing, ball, brick = panels(drawing, ("airfoil_grid", "hh_wing_grid", "ball_grid", "brick_grid"))
    draw_net(around, in_plane(bm.generators.airfoil_grid("naca0012", 40, 16).blocks[0]), color=GRAY, **NET)
    around.set(**AROUND)
    view = np.array([[0.9, 0.0, -0.45], [-0.2, 0.9, -0.4]])
    for patch in (model := bm.generators.onera_m6_grid((9, 9, 7))).patches:
        for window in patch.windows if patch.kind in ("wall", "symmetry") else ():
            nodes = np.squeeze(model.blocks[window.block].nodes[window.slices])
            near = np.where((np.abs(nodes - [0.5, 0.0, 0.0]) < 1.6).all(axis=-1, keepdims=True), nodes, np.nan)
            color, width = (BLUE, 0.7) if patch.kind == "wall" else ("#bbbbbb", 0.4)
            draw_net(wing, near @ view.T, color=color, linewidth=width)
    shapes = bm.generators.ball_grid((7, 7, 7, 7), far=3.0), bm.generators.brick_grid((6, 5, 5, 7), far=3.0)
    for axes, cells in zip((ball, brick), shapes):
        for patch in cells.patches:
            for window in patch.windows if patch.kind == "wall" else ():
                nodes = np.squeeze(cells.blocks[window.block].nodes[window.slices])
                normals = np.cross(np.gradient(nodes, axis=0), np.gradient(nodes, axis=1))
                outwards = np.sign(np.sum(normals * nodes))  # both bodies are around the origin
                is_seen = outwards * (normals @ np.cross(*view))[..., None] > 0.0
                draw_net(axes, np.where(is_seen, nodes @ view.T, np.nan), color=BLUE, linewidth=0.6)
    for axes in (wing, ball, brick):
        axes.set(aspect="equal")
    for axes in (around, wing, ball, brick):
        axes.set_axis_off()


def fit(drawing) -> None:
    """Grid, control mesh, and another grid of the same volume."""
    row = panels(drawing, ("a grid", "its control mesh", "member(1.5) of its family"))
    model = bm.fit_grid(bm.generators.airfoil_grid("naca0012", 32, 16))
    grid, member = (each.regenerate().blocks[0] for each in (model, model.member(1.5)))
    nets = in_plane(grid), model.mesh.nets(model.control_points)[0][:, :, 0, :2], in_plane(member)
    for axes, net, color in zip(row, nets, (GRAY, BLUE, GRAY)):
        draw_net(axes, net, color=color, **NET)
        axes.set(**AROUND)


def measures(drawing) -> None:
    """What is measured of a section."""
    (axes,) = panels(drawing, ("",))
    model = bm.fit_grid(bm.generators.airfoil_grid("naca2412", 128, 16))
    surface = bm.DesignSurface.of(model).surface
    points = in_plane(model.regenerate().blocks[0])[:, 0]
    axes.fill(*points.T, color="#e5eef6", zorder=0)
    axes.plot(*points.T, color=BLUE)
    nose = int(np.argmin(points[:, 0]))
    parts = [0.1, 0.3, 0.5, 0.7, 0.9]
    thickness = bm.measures.Thickness.of_sections(surface, parts=parts, stations=None)
    sides = [points[: nose + 1][::-1], points[nose:]]
    for part, value in zip(parts, np.ravel(thickness.evaluate(surface.points))):
        ends = [np.interp(part, *side.T) for side in sides]
        axes.annotate("", (part, max(ends)), (part, min(ends)), arrowprops={"arrowstyle": "<->", "color": ORANGE})
        axes.text(part, max(ends) + 0.005, f"{value:.3f}", fontsize=8, color=ORANGE, ha="center", va="bottom")
    area = np.ravel(bm.measures.SectionArea.of(surface).evaluate(surface.points))[0]
    axes.text(0.2, -0.11, f"SectionArea {area:.4f} m²", color=BLUE, fontsize=9)
    axes.text(0.55, 0.12, "Thickness.of_sections (m)", color=ORANGE, fontsize=9)
    axes.set(aspect="equal", xlim=(-0.05, 1.05), ylim=(-0.14, 0.15))
    axes.set_axis_off()


def movers(drawing) -> None:
    """A section that turns by 30 degrees, by three movers."""
    kinds = bm.movers.LinearElasticity, bm.movers.RadialBasis, bm.movers.InverseDistance
    row = panels(drawing, ("before", *(kind.__name__ for kind in kinds)))
    model = bm.fit_grid(bm.generators.airfoil_grid("naca0012", 48, 24), n_control=(17, 9, 2))
    mesh = bm.movers.moving_mesh(model)
    angle = np.radians(-30.0)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    about = np.array([0.5, 0.0, 0.0])
    surface = (mesh.points[mesh.surface_ids] - about) @ turn.T + about
    grids_of = [model.control_points, *(kind(mesh).move(mesh.points, surface).points for kind in kinds)]
    for axes, points, color in zip(row, grids_of, (GRAY, BLUE, BLUE, BLUE)):
        draw_net(axes, in_plane(model.regenerate(points).blocks[0]), color=color, **NET)
        axes.set(**AROUND | {"ylim": (-0.6, 0.6)})


def flow(drawing) -> None:
    """The Euler equations about a section."""
    mach, pressures = panels(drawing, ("EulerFlow at M 0.5, 2 degrees", "$C_p$ on the wall"))
    model = bm.fit_grid(bm.generators.airfoil_grid("naca0012", 64, 32))
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("geometry", bm.GridMovement(model=model, fit=False, quality=False), promotes=["*"])
    problem.model.add_subsystem("flow", bm.EulerFlow(model=model, reference_area=1.0), promotes=["*"])
    problem.model.set_input_defaults("Mach_number", val=0.5)
    problem.model.set_input_defaults("alpha", val=2.0, units="deg")
    problem.setup()
    problem.run_model()
    for sheet in bm.plotting.sheets_of(problem, ("symmetry",), "Mach"):
        if sheet.kind == "symmetry":
            shown = mach.pcolormesh(
                *sheet.points[..., :2].transpose(2, 0, 1), sheet.values["Mach"], cmap="turbo", rasterized=True
            )
    drawing.colorbar(shown, ax=mach, shrink=0.8, label="Mach number")
    mach.set(**AROUND)
    quads = problem.get_val("grid").reshape(-1, 3)[wall_quads(model)]
    draw_pressures(pressures, quads, problem.get_val("Cp"), 0.5, color=BLUE)


def optimisation(drawing) -> None:
    """Ways of two drivers through the same valley."""
    (axes,) = panels(drawing, ("",))
    x, y = np.meshgrid(np.linspace(-2.1, 2.1, 121), np.linspace(-2.1, 2.1, 121))
    axes.contour(
        x,
        y,
        np.log10(0.02 + (1 - x) ** 2 + 20 * (y - x**2) ** 2),
        14,
        colors="#cccccc",
        linewidths=0.7,
        linestyles="solid",
    )
    drivers = {
        "ScipyDriver, SLSQP": bm.ScipyDriver(optimizer="SLSQP", tol=1e-10, maxiter=80, disp=False),
        "NLoptDriver, LD_LBFGS": bm.NLoptDriver(optimizer="LD_LBFGS", tol=1e-10, disp=False),
    }
    for (name, driver), (color, width) in zip(drivers.items(), ((ORANGE, 2.4), (BLUE, 1.0))):
        problem = om.Problem(reports=None, driver=driver)
        problem.model.add_subsystem("valley", om.ExecComp("f = (1 - x)**2 + 20*(y - x**2)**2"), promotes=["*"])
        for variable in ("x", "y"):
            problem.model.add_design_var(variable, lower=-2.0, upper=2.0)
        problem.model.add_objective("f")
        problem.setup()
        problem.set_val("x", -1.2)
        problem.set_val("y", 1.0)
        with tempfile.TemporaryDirectory() as folder:
            file = str(Path(folder, "cases.sql"))
            driver.add_recorder(bm.CaseRecorder(file))
            problem.run_driver()
            problem.cleanup()
            reader = om.CaseReader(file)
            cases = [reader.get_case(case) for case in reader.list_cases("driver", out_stream=None)]
        way = [np.concatenate([case[key] for case in cases]) for key in ("x", "y")]
        axes.plot(*way, "o-", color=color, linewidth=width, markersize=2.0 + width, label=f"{name}: {len(cases)}")
    axes.plot(1.0, 1.0, "*", color=RED, markersize=9, zorder=3)
    axes.set(xlabel="x", ylabel="y", xlim=(-2.1, 2.1), ylim=(-2.1, 2.1))
    drawing.legend(fontsize=9, title="evaluations", title_fontsize=9, loc="outside right upper")


def sampling(drawing) -> None:
    """Plans of 32 designs."""
    plans = bm.sampling.LatinHypercube(32, seed=1), bm.sampling.Sobol(32, seed=1)
    for axes, plan in zip(panels(drawing, tuple(type(plan).__name__ for plan in plans)), plans):
        ranges = {"twist": {"size": 1, "lower": -3.0, "upper": 1.0}, "chord": {"size": 1, "lower": 0.8, "upper": 1.2}}
        twist, chord = zip(*((row[0][1].item(), row[1][1].item()) for row in plan(ranges)))
        axes.plot(twist, chord, "o", color=BLUE, markersize=3.5)
        axes.set(xlabel="twist (deg)", ylabel="chord", xlim=(-3.0, 1.0), ylim=(0.8, 1.2))


def testing(drawing) -> None:
    """Errors of a derivative over the step."""
    (axes,) = panels(drawing, ("",))
    model = bm.fit_grid(bm.generators.airfoil_grid("naca0012", 32, 16))
    measure = bm.measures.SectionArea.of(bm.DesignSurface.of(model).surface)
    points = bm.DesignSurface.of(model).surface.points
    direction = np.random.default_rng(2).normal(size=points.shape)
    exact = measure.partials(points) @ direction.ravel()
    steps = 10.0 ** np.arange(-1.0, -15.5, -0.5)

    def off(change):
        return np.abs(np.ravel(change) - np.ravel(exact)).max() / np.abs(exact).max()

    value = measure.evaluate
    one_sided = [off((value(points + h * direction) - value(points)) / h) for h in steps]
    central = [off((value(points + h * direction) - value(points - h * direction)) / (2.0 * h)) for h in steps]
    axes.loglog(steps, one_sided, ".-", color=GRAY, label="one-sided difference")
    axes.loglog(steps, np.maximum(central, 1e-17), ".-", color=ORANGE, label="central difference")
    stepped = bm.testing.complex_step(lambda x: value(x), points, direction)
    axes.axhline(max(off(stepped), 1e-16), color=GREEN, label="complex_step", linewidth=2.0)
    axes.set(xlabel="step (m)", ylabel="relative error of a derivative", xlim=(1e-15, 1.0))
    axes.legend(fontsize=8)


def components(drawing) -> None:
    """The chain of components and the variables between them."""
    (axes,) = panels(drawing, ("",))
    ends = {"Fit": (0.0, 0.5), "ControlMeshMove": (2.2, 3.9), "GridEvaluate": (5.3, 6.6), "Quality": (7.4, 8.3)}
    middles = {name: sum(sides) / 2 for name, sides in ends.items()}
    arrow = {"arrowstyle": "->", "color": GRAY, "shrinkA": 0, "shrinkB": 0}

    def flows(start, end, at, name, color):
        axes.annotate("", end, start, arrowprops=arrow)
        axes.text(*at, name, ha="center", va="center", fontsize=8, color=color)

    for name, (left, right) in ends.items():
        axes.fill([left, right, right, left], [-0.35, -0.35, 0.35, 0.35], facecolor="#e5eef6", edgecolor=BLUE)
        axes.text(middles[name], 0.0, name, ha="center", va="center", fontsize=9)
    boxes = list(ends.values())
    for left, right, name in zip(boxes, boxes[1:], ("control_points_initial", "control_points", "grid")):
        flows((left[1], 0.0), (right[0], 0.0), ((left[1] + right[0]) / 2, 0.2), name, GRAY)
    for name, variable in {"Fit": "grid_initial", "ControlMeshMove": "surface_control_points"}.items():
        flows((middles[name], 1.0), (middles[name], 0.35), (middles[name], 1.2), variable, ORANGE)
    for name, variable in {"GridEvaluate": "grid, for a flow", "Quality": "corner_ks, quality_ks"}.items():
        flows((middles[name], -0.35), (middles[name], -1.0), (middles[name], -1.2), variable, GREEN)
    axes.set(xlim=(-0.4, 8.9), ylim=(-1.4, 1.4))
    axes.set_axis_off()


def bridges(drawing) -> None:
    """A gradient by JAX: of the area of a section in its control points."""
    import jax  # of an extra

    jax.config.update("jax_enable_x64", True)
    row = panels(drawing, ("control points of the wall", "jax.grad of the section's area in these points"))
    wing = bm.DesignSurface.of(bm.fit_grid(bm.generators.airfoil_grid("naca2412", 48, 24), n_control=(17, 9, 2)))
    nodes, area = bm.jax.grid(wing.model), bm.jax.measures([bm.measures.SectionArea.of(wing.surface)])
    gradient = jax.grad(lambda points: sum(value.sum() for value in area(nodes(points)[wing.surface.rows]).values()))
    start, ids = wing.model.control_points, bm.movers.moving_mesh(wing.model).surface_ids
    points, arrows = start[ids][:, :2], np.asarray(gradient(jax.numpy.asarray(start)))[ids][:, :2]
    for axes in row:
        draw_net(axes, in_plane(wing.model.regenerate().blocks[0]), color="#cccccc", **NET)
        axes.plot(*points.T, ".", color=ORANGE, markersize=5)
        axes.set(**AROUND | {"ylim": (-0.3, 0.3), "xlim": (-0.15, 1.15)})
    row[1].quiver(*points.T, *arrows.T, color=BLUE, angles="xy", width=0.004)


def errors(drawing) -> None:
    """A cell that tangles, as its error names it."""
    row = panels(drawing, ("corners are positive", "one corner is negative"))
    square = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0), indexing="ij"), axis=-1)
    for axes, shift in zip(row, (0.35, 1.35)):
        net = square.copy()
        net[1, 1] += [shift, 0.15 * shift]
        draw_net(axes, net, color=GRAY, linewidth=0.9)
        if shift > 1.0:
            axes.fill(*net[[1, 2, 2, 1], [1, 1, 2, 2]].T, color=RED, alpha=0.25, linewidth=0.0)
        axes.plot(*net[1, 1], ".", color=RED if shift > 1.0 else BLUE, markersize=9)
        axes.set(aspect="equal")
        axes.set_axis_off()


PICTURES = {
    components: (8.0, 1.9), bridges: (8.0, 2.2), errors: (5.5, 2.0),
    grids: (8.0, 2.4), generators: (8.0, 2.2), fit: (8.0, 1.9), measures: (7.0, 2.0), movers: (8.0, 1.8),
    flow: (8.0, 2.6), optimisation: (7.0, 3.0), sampling: (6.5, 2.6), testing: (5.5, 2.9),
}  # fmt: skip
"""What draws, and sizes in inches."""


if __name__ == "__main__":
    draw_pictures(FOLDER, PICTURES, sys.argv[1:])
