"""From STEP to STEP: twist of a wing.

A wing is read from a STEP file, twisted for the least induced drag at its lift, and written as a STEP file. The CAD
file here is made from the package's ONERA M6; any STEP or IGES file of a wing's walls works in the same way. Three
files with the same faces are written: the wing, and two in which it is twisted about the quarter chord, by angles that
grow to the tip or are largest at mid-span. Nodes of the walls of a grid are tied once to the faces of the first by
their (u, v). The design variables are the interpolation towards the other files and the angle of attack; wall nodes are
exactly where the faces put them, the volume grid follows, and a vortex lattice (OpenAeroStruct) gives lift and induced
drag. It takes some ten seconds. The output is drags, the distance of wall nodes of the optimum from its STEP file, by
OpenCascade's own projection, a check of the totals, and a picture.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.drivers import nlopt, recorded
from bspline_mdao.plotting import BLUE, ORANGE, figure
from bspline_mdao.scripts import run
from bspline_mdao.testing import check_totals, perturb_design

ANGLE = 5.0
"""Largest angle of the other files (deg), nose down."""

STATIONS = {"tip": [0.0, 0.0, -ANGLE], "middle": [0.0, -ANGLE, 0.0]}
"""Angles at root, mid-span and tip (deg) of the other files."""

TOLERANCE = 1e-4
"""Largest distance of faces from the walls that they are made of (m)."""

SIZES = {False: ((15, 9, 7), (11, 6, 4)), True: ((25, 17, 9), (15, 9, 5))}
"""Nodes and control points of the blocks, at the larger size (True) and small."""

ALPHA = 3.0
"""Angle of attack of the baseline (deg), whose lift is kept."""


def written(model: bm.FittedModel, folder: Path) -> bm.design.TiedSurface:
    """Write the wing and the turned ones, and tie the nodes of the walls to the faces of the first."""
    bm.files.write_cad(folder / "wing.step", model, tolerance=TOLERANCE, units="mm")
    wing = bm.DesignSurface.of(model)
    twist = wing.parametrization([bm.design.Twist("twist", wing.axis, stations=3)])
    for name, angles in STATIONS.items():
        points = model.control_points.copy()
        points[wing.mesh.surface_ids] = twist.apply(points[wing.mesh.surface_ids], {"twist": np.array(angles)})
        bm.files.write_cad(folder / f"{name}.step", model, points, tolerance=TOLERANCE, units="mm")
    return bm.design.TiedSurface.of(model, folder / "wing.step")


def posed(tied: bm.design.TiedSurface, ways: bm.design.CadShapes, lift: float | None) -> om.Problem:
    """Least induced drag at the lift, not set up."""
    problem = om.Problem(reports=None)
    top = problem.model
    top.add_subsystem("walls", bm.design.CadWalls(variables=[ways]), promotes=["*"])
    movement = bm.GridMovement(model=tied.model, surface=tied.surface, fit=False, quality=False)
    top.add_subsystem("grid_movement", movement, promotes=["*"])
    area = bm.DesignSurface.of(tied.model).planform_area
    top.add_subsystem("flow", bm.LatticeFlow(model=tied.model, reference_area=area), promotes=["*"])
    top.set_input_defaults("alpha", ALPHA, units="deg")
    top.add_design_var("ways", lower=-1.0, upper=1.0)
    top.add_design_var("alpha", lower=-3.0, upper=9.0, ref=3.0, units="deg")
    top.add_objective("CD_induced", ref=1e-3)
    if lift is not None:
        top.add_constraint("CL", equals=lift, ref=0.2)
    return problem


def main(paper: bool = False, figures=None, folder=None) -> dict:
    """Twist the wing by its CAD files.

    Parameters
    ----------
    paper : bool
        More nodes.
    figures : path-like, optional
        Folder for ``cad_wing.png``.
    folder : path-like, optional
        Where ``wing.step``, ``tip.step``, ``middle.step`` and ``optimum.step`` go; they are removed by default.

    Returns
    -------
    dict
        ``drag`` and ``lift`` before and after, ``ways`` of the optimum, ``tied`` and ``off``, the largest distances (m)
        of wall nodes from the faces of ``wing.step``, and of those of the optimum from ``optimum.step``, ``names`` of
        its faces, what `RecordedRun.numbers` returns, and ``totals``, see `check_totals`.
    """
    nodes, n_control = SIZES[paper]
    model = bm.fit_grid(bm.generators.onera_m6_grid(nodes), n_control=n_control)
    with TemporaryDirectory() as other:
        place = Path(folder or other)
        tied = written(model, place)
        ways = bm.design.CadShapes("ways", tied, [tied.shape(place / f"{name}.step") for name in STATIONS])
        before = posed(tied, ways, None)
        before.setup()
        before.run_model()
        problem = posed(tied, ways, before.get_val("CL").item())
        problem.driver = nlopt(1e-8, 50)
        with recorded(problem) as done:
            problem.run_driver()
        best = done.problem
        body = bm.design.moved_body([ways], {"ways": best.get_val("ways")})
        shape = bm.files.write_cad_body(place / "optimum.step", body)
        nodes = best.get_val("grid").reshape(-1, 3)[tied.surface.rows]
        offset = nodes - tied.surface.points + tied.body.places(tied.tie)
        off = float(shape.distances(offset[:: max(len(offset) // 100, 1)]).max())
    if figures:
        draw(figures, {"wing.step": tied.body, "optimum.step": body})
    started = posed(tied, ways, None)
    started.setup(force_alloc_complex=True)
    started.run_model()
    drags, lifts = (
        {when: run.get_val(name).item() for when, run in (("before", before), ("after", best))}
        for name in ("CD_induced", "CL")
    )
    return {
        "drag": drags,
        "lift": lifts,
        "ways": best.get_val("ways").tolist(),
        "tied": float(tied.distances.max()),
        "off": off,
        "names": shape.names,
        **done.numbers(),
        "totals": check_totals(perturb_design(started))._asdict(),
    }


def draw(figures, bodies: dict[str, bm.files.CadBody]) -> None:
    """Draw sections of faces from root to tip, where the M6 is closed, one above the other, the optimum thin."""
    along, stations = np.linspace(0.0, 1.0, 161), np.linspace(0.0, 1.0, 6)
    uv = np.stack(np.meshgrid(along, stations, indexing="ij"), axis=-1).reshape(-1, 2)
    with figure(figures, "cad_wing", (7.5, 3.5), n_colours=64) as drawing:
        axes = drawing.subplots()
        for color, width, (name, body) in zip((ORANGE, BLUE), (3.0, 1.0), bodies.items()):
            for face in body.faces:
                ways = [face.surface.points(uv[:, order]).reshape(161, 6, 3) for order in ([0, 1], [1, 0])]
                sections = min(ways, key=lambda lines: np.ptp(lines[..., 2], axis=0).max())  # planes of constant z
                axes.plot(sections[..., 0], sections[..., 1] + 0.4 * sections[..., 2], color=color, linewidth=width)
            axes.plot([], [], color=color, linewidth=width, label=name)
        axes.set(xlabel="$x$ (m)", ylabel="$y + 0.4 z$ (m)", aspect="equal")
        axes.legend(frameon=False)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/cad_wing.png'
