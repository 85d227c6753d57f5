"""A wing slides along a fuselage.

A wing slides along a fuselage, turns and rises on it, and finds its trimmed position. The fuselage is a cylinder, with
an H-H grid about a wing mapped onto it: the middle of the symmetry plane of the wing on its own becomes the upper half
of the cylinder by Joukowski's map, and the rest stays in this plane. A lattice moves the grid as a mesh. The wing
slides by its chord to and fro, is twisted by 10 degrees and gets a dihedral of 10, with its root on the fuselage. Then
its position and the twist of its tip are optimised for the least induced drag by a vortex lattice at a lift coefficient
of 0.4, with no moment about a fixed point. The lattice ends at the fuselage, as if that were a gap, and its load falls
off there. It takes half a minute, and some minutes with ``--paper``. The output is inverted cells, distances from the
fuselage, heights at walls and smallest volumes relative to the baseline; the optimum, a check of the totals, and a
picture.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.design import Dihedral, Junction, OfPart, OnPatch, Translation, Twist
from bspline_mdao.drivers import disagreement, nlopt, recorded, scipy_slsqp
from bspline_mdao.grids import Block, Patch, Window
from bspline_mdao.meshes import MeshModel, fit_mesh
from bspline_mdao.movers import Cylinder
from bspline_mdao.plotting import BLUE, GRAY, Camera, draw_history, figure
from bspline_mdao.scripts import pick_size, run
from bspline_mdao.testing import check_totals, perturb_design

SIZES = {
    "quick": ((9, 13, 9), (17, 17), (9, 5)),
    "default": ((9, 17, 9), (21, 21), (17, 9)),
    "paper": ((17, 41, 17), (33, 33), (41, 17)),
}
"""Nodes of the rows of blocks along the stream, away from the wing and along the span."""

WING = bm.generators.Wing(
    bm.generators.Planform(root_chord=1.0, semi_span=3.0, taper=0.6), bm.generators.naca_section(0.2)
)
FIRST = 5e-4
"""Height of the first cells of the boundary layers on wing and fuselage (m)."""

SPACING, FAR = bm.generators.Spacing(FIRST, 0.01, 0.01, 0.03, FIRST), bm.generators.FarField(6.0, 0.3)
RADIUS, REACH = 0.4, 2.5
"""Of the fuselage, and of what the slide of the wing moves along (m)."""

MOVES = {
    "slide": {"position": 1.0},
    "twist": {"twist": 10.0},
    "rise": {"dihedral": 10.0},
    "all": {"position": 1.0, "twist": 10.0, "dihedral": 10.0},
    "all back": {"position": -1.0, "twist": -10.0, "dihedral": -10.0},
}
"""What the wing does: place along the fuselage (m), and angles (deg)."""

MACH, LIFT, ABOUT, ENDS = 0.3, 0.4, (0.55, 0.0, 0.0), (1.1 * RADIUS, 3.0)
"""Of the flow, the point that the moment is taken about, and the ends of the vortex lattice along the span (m)."""

OUTPUTS = ("position", "twist", "alpha", "CL", "CM", "CD_induced")
"""Reported numbers of the optimum."""

VIEW = Camera(focus=(0.3, 0.0, 1.0), direction=(-0.5, 0.8, 0.9), height=5.0)
"""From where the pictures are seen: outboard, upstream and above."""

DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_SLSQP": nlopt}


def make_grid(stream, normal, span) -> bm.Grid:
    """Map the grid about a wing onto a fuselage."""
    grid = bm.generators.hh_wing_grid(WING, (stream, normal, span), SPACING, FAR)
    number = int(np.searchsorted(grid.blocks[4].nodes[0, :, 0, 1], 2.0 * RADIUS))  # of the line that becomes its edge
    x, edge = np.concatenate([block.nodes[:, number, 0, :2] for block in grid.blocks[3:6]]).T
    blocks, body, plane = [], [], []
    for place, block in enumerate(grid.blocks):
        stretch = 2.0 * RADIUS / np.interp(block.nodes[..., 0], x, edge)
        part = np.minimum(np.abs(block.nodes[..., 1]) * stretch / (2.0 * RADIUS), 1.0)
        y = block.nodes[..., 1] * (1.0 + (stretch - 1.0) * part**2 * (3.0 - 2.0 * part))
        flat = np.round(y, 12) + 1j * block.nodes[..., 2]  # an edge of the fuselage is where the root has no slope
        mapped = 0.5 * (flat + np.sqrt(flat - 2.0 * RADIUS) * np.sqrt(flat + 2.0 * RADIUS))
        blocks.append(Block(np.stack([block.nodes[..., 0], mapped.real, np.abs(mapped.imag)], axis=-1), block.name))
        if place < 6:
            i, j, _ = np.array(block.shape) - 1
            is_above = place > 2
            cut = number if is_above else j - number
            sides = Window(place, (0, 0, 0), (i, cut, 0)), Window(place, (0, cut, 0), (i, j, 0))
            body.append(sides[0 if is_above else 1])
            plane.append(sides[1 if is_above else 0])
    kept = [patch for patch in grid.patches if patch.kind != "symmetry"]
    more = Patch("fuselage", "wall", tuple(body)), Patch("symmetry", "symmetry", tuple(plane))
    return bm.Grid(tuple(blocks), (*kept, *more), source="wing on a fuselage")


def pose(model: MeshModel, stations: int) -> om.Problem:
    """Pose the problem: place, twist and angle of attack of least induced drag, trimmed. Not yet set up."""
    both = bm.DesignSurface.of(model)
    wing = both.part("wing*")
    twist, dihedral = Twist("twist", wing.axis, stations), Dihedral("dihedral", wing.axis)
    variables = [OfPart(each, wing.mesh) for each in (twist, dihedral, Translation("position", "x"))]
    fuselage = Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), RADIUS)
    junction = Junction(OnPatch(model, "fuselage"), REACH, fuselage)
    flow = {"reference_area": wing.planform_area, "moment_reference": ABOUT, "patches": "wing*", "ends": ENDS}
    problem = om.Problem(reports=None)
    top = problem.model
    movement = both.grid_movement(variables, junction=junction, quality=("volume_ks",))
    top.add_subsystem("geometry", movement, promotes=["*"])
    top.add_subsystem("flow", bm.LatticeFlow(model=model, **flow), promotes=["*"])
    top.set_input_defaults("Mach_number", val=MACH)
    top.set_input_defaults("alpha", val=4.0, units="deg")
    top.add_design_var("alpha", lower=-5.0, upper=10.0, ref=3.0, units="deg")
    top.add_design_var("twist", indices=range(1, stations), lower=-10.0, upper=10.0, ref=3.0, units="deg")
    top.add_design_var("position", lower=-1.0, upper=1.0, ref=0.3, units="m")
    top.add_constraint("CL", equals=LIFT, ref=LIFT)
    top.add_constraint("CM", indices=[2], equals=0.0, ref=0.1)
    top.add_constraint("volume_ks", lower=0.1)
    top.add_objective("CD_induced", ref=0.01)
    return problem


def judge(problem: om.Problem, model: MeshModel) -> dict:
    """Return cells, distances from the fuselage (m), and height ratios at walls, from 1 % to 99 % of them.

    Heights are of boundary layers; at edges, where lines leave the walls in a row of their own, cells are higher.
    """
    nodes, mesh, walls = problem.get_val("grid").reshape(-1, 3), model.mesh, model.node_map.embedded.walls
    after, before = mesh.quality(nodes), walls.heights(mesh.points)
    heights = (walls.heights(nodes) / before)[before < 2.0 * FIRST]
    off = np.hypot(*nodes[np.unique(mesh.markers["fuselage"]), 1:].T) - RADIUS
    return {
        "n_inverted": after.is_inverted.sum(),
        "smallest_ratio": (after.volumes / mesh.quality().volumes).min(),
        "off_fuselage": np.abs(off).max(),
        "heights": np.quantile(heights, [0.01, 0.99]),
    }


def main(paper: bool = False, figures=None, quick: bool = False, drivers=DRIVERS) -> dict:
    """Move the wing, and find its place and twist with every driver.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`.
    figures : path-like, optional
        Folder for ``wing_slides_on_body.png``.
    drivers : dict
        Makers of drivers by name.

    Returns
    -------
    dict
        ``n_points`` of the grid; by ``moves``, the ``optimum`` among them, what `judge` returns; by ``drivers`` what
        `RecordedRun.numbers` returns, with place, twist and coefficients of the ``optimum``; by how much they
        ``differ``, see `disagreement`; and ``totals``, see `check_totals`.
    """
    with tempfile.TemporaryDirectory() as folder:
        bm.write_grid(Path(folder, "wing.cgns"), make_grid(*pick_size(SIZES, paper, quick)))
        model = fit_mesh(Path(folder, "wing.cgns"))
    start, runs, moves, states = pose(model, 2), {}, {}, {"baseline": model.mesh.points}
    start.setup(mode="rev")
    for name, values in {"baseline": {}, **MOVES}.items():
        for variable, value in {"position": 0.0, "twist": 0.0, "dihedral": 0.0, **values}.items():
            start.set_val(variable, value)
        start.run_model()
        moves[name], states[name] = judge(start, model), start.get_val("grid").reshape(-1, 3).copy()
    for name, make_driver in drivers.items():
        problem = pose(model, 2)
        problem.driver = make_driver(1e-8, 60)
        with recorded(problem) as runs[name]:
            problem.run_driver()
    moves["optimum"], states["optimum"] = judge(problem, model), problem.get_val("grid").reshape(-1, 3).copy()
    if figures:
        draw(figures, model, states, runs)
    found = {name: {out: each.problem.get_val(out).copy() for out in OUTPUTS} for name, each in runs.items()}
    return {
        "n_points": model.mesh.n_points,
        "moves": moves,
        "drivers": {name: each.numbers() | {"optimum": found[name]} for name, each in runs.items()},
        "differ": disagreement(runs),
        "totals": check_totals(perturb_design(problem))._asdict(),
    }


def draw(folder, model: MeshModel, states: dict, runs: dict) -> None:
    """Draw the walls in every state, and the histories."""
    shown = [name for name in states if name not in ("slide", "rise")]
    with figure(folder, "wing_slides_on_body", (13.0, 6.2), n_colours=64) as canvas:
        *pictures, history = canvas.subplots(2, 3).flat
        for axes, name in zip(pictures, shown):
            for marker, color in (("fuselage", GRAY), ("wing_upper", BLUE), ("wing_lower", BLUE)):
                draw_faces(axes, states[name][model.mesh.markers[marker]], color)
            axes.set(title=name, xlim=(-3.0, 3.5), ylim=(-2.2, 2.4), aspect="equal")
            axes.set_axis_off()
        draw_history(history, runs, "CD_induced", "induced drag", log=False)


def draw_faces(axes, corners: np.ndarray, color: str) -> None:
    """Draw quads, shape (n, 4, 3), as they are seen from outboard, those at the back first."""
    from matplotlib.collections import PolyCollection

    seen = VIEW.project(corners.reshape(-1, 3)).reshape(-1, 4, 3)
    seen = seen[np.argsort(seen[..., 2].mean(axis=1)), :, :2]
    axes.add_collection(PolyCollection(seen, fc=color, ec="black", lw=0.15))


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/wing_slides_on_body.png'
