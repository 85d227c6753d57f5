"""Section II.E: wings in unsteady motion.

Shape control in unsteady flow (section II.E): a pitching and a flapping wing, with exact grid velocities. It takes half
a minute. The output is the errors of differences in time, which approach the exact velocities at second order, the
worst cells over a period, and a picture of both motions.
"""

from __future__ import annotations

import numpy as np

from bspline_mdao import fit_grid
from bspline_mdao.design import UnsteadyGrid, flapping, pitching
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids import cell_quality
from bspline_mdao.movers import LinearElasticity, moving_mesh
from bspline_mdao.plotting import BLUE, GRAY, ORANGE, draw_net, figure
from bspline_mdao.scripts import run
from bspline_mdao.testing import richardson

PERIOD = 1.0
"""Period of both motions (s)."""

TIME = 0.07
"""When velocities are compared with differences in time (s)."""

STEPS = PERIOD / np.array([50.0, 100.0, 200.0, 400.0])
"""Steps of the differences (s)."""

ROOT_BLOCKS, WING_BLOCKS = range(6), (1, 4, 7, 10)
"""Blocks at the symmetry plane, and those above and below the wing and outboard of it."""

COLORS = {"pitching": BLUE, "flapping": ORANGE}


def main(paper: bool = False, figures=None) -> dict:
    """Move the M6 wing through a period of each motion.

    Parameters
    ----------
    paper : bool
        12 blocks of 45 x 65 x 33 nodes and 16 times; some 20,000 nodes and 8 times by default.
    figures : path-like, optional
        Folder for ``unsteady_wing.png``.

    Returns
    -------
    dict
        For each motion: ``max_speed`` (m/s); ``differences``, the largest error of central differences in time for
        ``steps`` (s), relative to the largest speed; ``rate``, its order; ``velocity_error``, the error after
        extrapolation; over the period ``phases``, smallest corner triple product ``min_corner`` and ``q_min`` of the
        grid, and ``n_inverted``.
    """
    shape, n_control, n_times = ((45, 65, 33), (13, 13, 9), 16) if paper else ((13, 15, 11), (7, 7, 6), 8)
    model = fit_grid(onera_m6_grid(shape), n_control=n_control)
    mesh = moving_mesh(model)
    mover = LinearElasticity(mesh, n_increments=2)
    motions = {
        "pitching": pitching(mesh, np.radians(15.0), 1.0 / PERIOD),
        "flapping": flapping(mesh, np.radians(40.0), 1.0 / PERIOD),
    }
    grids = {name: UnsteadyGrid(model, mover, motion) for name, motion in motions.items()}
    phases = np.arange(n_times) / n_times
    states = {name: [unsteady.at(phase * PERIOD) for phase in phases] for name, unsteady in grids.items()}
    numbers = {
        name: {"phases": phases.tolist(), **quality_over(model, states[name]), **compare_velocities(unsteady)}
        for name, unsteady in grids.items()
    }
    if figures:
        draw(figures, model, states, numbers)
    return numbers


def compare_velocities(unsteady: UnsteadyGrid) -> dict:
    """Compare the velocities with central differences in time, of ever smaller steps and extrapolated."""
    exact = unsteady.at(TIME).velocities
    differences = [(unsteady.at(TIME + step).nodes - unsteady.at(TIME - step).nodes) / (2.0 * step) for step in STEPS]
    speed = np.abs(exact).max()
    errors = np.array([np.abs(difference - exact).max() for difference in differences]) / speed
    return {
        "max_speed": speed,
        "steps": STEPS,
        "differences": errors,
        "rate": np.log2(errors[-2] / errors[-1]),
        "velocity_error": np.abs(richardson(differences) - exact).max() / speed,
    }


def quality_over(model, states) -> dict:
    """Worst cells of the grid at every time."""
    qualities = [
        [cell_quality(block.nodes) for block in model.header.grid(model.topology.shapes, state.nodes).blocks]
        for state in states
    ]
    return {
        "min_corner": [min(float(quality.min_corner.min()) for quality in blocks) for blocks in qualities],
        "q_min": [min(float(quality.q.min()) for quality in blocks) for blocks in qualities],
        "n_inverted": sum(int((~quality.is_valid).sum()) for blocks in qualities for quality in blocks),
    }


def draw(folder, model, states, numbers) -> None:
    """Draw the moving grids with their speeds, the error of differences and the quality over the period."""
    with figure(folder, "unsteady_wing", size=(10.0, 7.0)) as canvas:
        (side, front), (error, quality) = canvas.subplots(2, 2)
        stream = model.topology.shapes[4][0]
        draw_cut(side, model, states["pitching"][1], ROOT_BLOCKS, np.s_[:, :, 0], (0, 1))
        draw_cut(front, model, states["flapping"][1], WING_BLOCKS, np.s_[stream // 2], (2, 1))
        side.set(xlim=(-0.7, 1.7), ylim=(-0.8, 0.8), xlabel="$x$ (m)", ylabel="$y$ (m)", title="pitching: the root")
        front.set(xlim=(0.0, 2.4), ylim=(-0.5, 1.1), xlabel="$z$ (m)", ylabel="$y$ (m)", title="flapping: mid-chord")
        for name, results in numbers.items():
            error.loglog(results["steps"], results["differences"], "o-", color=COLORS[name], label=name)
            quality.plot(results["phases"], results["min_corner"], "o-", color=COLORS[name], label=name)
        error.loglog(STEPS, 20.0 * STEPS**2, "--", color=GRAY, label="order 2")
        error.set(xlabel="time step (ms)", ylabel="error of differences relative to the largest speed")
        error.set_xticks(STEPS, [f"{1e3 * step:g}" for step in STEPS])
        error.set_xticks([], minor=True)
        quality.set(xlabel="time relative to the period", ylabel="smallest corner triple product", ylim=(0.0, None))
        for axes in (error, quality):
            axes.legend()


def draw_cut(axes, model, state, blocks, cut, plane) -> None:
    """Draw a cut through blocks of the grid in a coordinate plane, coloured by the speed (m/s)."""
    shapes = model.topology.shapes
    nodes, velocities = (model.header.grid(shapes, x).blocks for x in (state.nodes, state.velocities))
    speeds = {block: np.linalg.norm(velocities[block].nodes[cut], axis=-1) for block in blocks}
    fastest = max(speed.max() for speed in speeds.values())
    for block, speed in speeds.items():
        x, y = np.moveaxis(nodes[block].nodes[cut], -1, 0)[list(plane)]
        image = axes.pcolormesh(x, y, speed, shading="gouraud", cmap="viridis", vmin=0.0, vmax=fastest)
        draw_net(axes, np.stack([x, y], axis=-1), color="white", linewidth=0.25)
    axes.set_aspect("equal")
    axes.figure.colorbar(image, ax=axes, shrink=0.8, label="speed of the nodes (m/s)")


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/thumbnails/unsteady_wing.png'
