"""Aerostructural: fuel burn of a wing.

Least fuel burn of a flexible wing: twist of the regenerated wing and thickness of OpenAeroStruct's tubular spar. It
takes half a minute, and an hour at the paper's size. The output is fuel, mass and centre of lift at the start and at
the optima, how the optimisers converged, a check of the totals, and a picture of span load, twist and spar.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.drivers import nlopt, recorded, scipy_slsqp
from bspline_mdao.flow import Aerostructure, Spar
from bspline_mdao.plotting import BLUE, GRAY, ORANGE, draw_ellipse, figure
from bspline_mdao.scripts import run
from bspline_mdao.testing import check_totals

SIZES = {
    False: ((11, 9, 13), (7, 6, 8), (0.01, 0.02, 0.02, 0.02), 11),
    True: ((45, 65, 33), (13, 13, 9), (), 31),
}
"""Nodes and control points of the grid, its spacing, and nodes of the lattice along the half span; there are two along
the chord, as the loads on the spar are what matters. Small, and the size of the paper's M6 grid (True)."""

WORST_CORNER = 0.1
"""What the worst cell must keep of its corner triple product of 1, by the bound of `Quality`."""

STATIONS = 4
"""Of the twist; its spline is too smooth to make use of what the panel forces leave out."""

THICKNESS = (0.003, 0.003, 0.003, 0.003)
"""Of the spar's wall where the optimisation starts, from the tip to the root (m)."""

GAUGE = 5e-4
"""Least thickness of the wall (m)."""

TOLERANCE = 1e-10
"""Of the objective, the fuel in units of 10 kg."""

DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_SLSQP": nlopt}
STYLES = {"initial": (GRAY, ":"), "SciPy SLSQP": (ORANGE, "-"), "NLopt LD_SLSQP": (BLUE, "--")}
"""Colours and lines, those that lie on others among them."""


def make_model(paper: bool) -> tuple[bm.FittedModel, bm.measures.CamberSurface]:
    """Fit the grid about the paper's rectangular wing, and lay a lattice of equal strips on its camber surface."""
    shape, n_control, spacing, n_span = SIZES[paper]
    grid = bm.generators.hh_wing_grid(
        bm.generators.rectangular_wing(), shape, bm.generators.Spacing(*spacing), bm.generators.FarField(10.0)
    )
    model = bm.fit_grid(grid, n_control=n_control)
    return model, bm.measures.CamberSurface.of(bm.measures.SurfaceGrid.of(model, "wing*"), 2, n_span)


def pose(model: bm.FittedModel, lattice: bm.measures.CamberSurface) -> om.Problem:
    """Pose the problem for a wing. Not yet set up."""
    mesh = bm.movers.moving_mesh(model)
    twist = bm.design.Twist("twist", bm.design.ReferenceAxis.of(mesh, at=0.25), STATIONS)
    geometry = bm.GridMovement(
        model=model,
        parametrization=bm.design.Parametrization(mesh, [twist]),
        measures=[lattice],
        mover=bm.movers.LinearElasticity(mesh, n_increments=1),
        fit=False,
    )
    nodes = lattice.evaluate(lattice.surface.points)
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    problem.model.add_subsystem("flow", Aerostructure(lattice=nodes, spar=Spar(THICKNESS)), promotes=["*"])
    top = problem.model
    top.add_constraint("corner_ks", lower=WORST_CORNER)
    top.add_design_var("twist", lower=-15.0, upper=15.0, ref=5.0, units="deg")
    top.add_design_var("spar_thickness", ref=1e-3, units="m")  # a spline's control points: the wall itself is bounded
    top.add_constraint("wall_thickness", lower=GAUGE, ref=1e-3, units="m")
    top.add_constraint("failure", upper=0.0)
    top.add_constraint("lift_deficit", equals=0.0)
    top.add_objective("fuel_burn", ref=10.0, units="kg")
    return problem


def main(paper: bool = False, figures=None, drivers=DRIVERS) -> dict:
    """Find the least fuel burn with every driver, stress and lift constrained.

    Parameters
    ----------
    paper : bool
        12 blocks of 45 x 65 x 33 nodes and 30 strips per half wing; some 15,000 nodes and 10 strips by default.
    figures : path-like, optional
        Folder for ``wing_aerostructural.png`` and the N2 diagram ``wing_aerostructural.html``.
    drivers : dict
        Makers of drivers by name.

    Returns
    -------
    dict
        ``totals``, see `check_totals`; what `flight` returns of the ``initial`` wing; for each driver that and what
        `RecordedRun.numbers` returns.
    """
    wing = make_model(paper)
    start = pose(*wing)
    start.setup(mode="rev")
    start.run_model()
    runs = {}
    for driver, make_driver in drivers.items():
        problem = pose(*wing)
        problem.driver = make_driver(TOLERANCE, 100)
        with recorded(problem) as runs[driver]:
            problem.run_driver()
    if figures:
        draw(figures, {"initial": start, **{name: found.problem for name, found in runs.items()}})
        om.n2(start, outfile=str(Path(figures) / "wing_aerostructural.html"), show_browser=False)
    numbers = {
        "initial": flight(start),
        "drivers": {name: flight(found.problem) | found.numbers("flow") for name, found in runs.items()},
    }
    # totals are checked off the symmetry of the initial wing, where some derivatives vanish
    start.set_val("twist", np.linspace(2.0, -1.0, STATIONS), units="deg")
    start.set_val("spar_thickness", np.linspace(1e-3, 2e-3, len(THICKNESS)), units="m")
    start.run_model()
    return numbers | {"totals": check_totals(start)._asdict()}


def flight(problem: om.Problem) -> dict:
    """Collect fuel and mass (kg), coefficients, and where half a wing's lift acts, relative to the semi-span.

    An elliptical load has it at 4 / (3 pi) = 0.424.
    """
    y, load = load_of(problem)
    numbers = {name: problem.get_val(name).item() for name in ("fuel_burn", "structural_mass", "CL", "CD", "failure")}
    return {**numbers, "centre_of_lift": y @ load / load.sum()}


def load_of(problem: om.Problem) -> tuple[np.ndarray, np.ndarray]:
    """Places of the strips along the span, relative to the semi-span, and lift per length, relative to its mean."""
    nodes, coefficients = problem.get_val("camber_surface"), problem.get_val("strip_lift")
    chords = np.linalg.norm(nodes[-1] - nodes[0], axis=1)
    load = coefficients * 0.5 * (chords[1:] + chords[:-1])
    y = nodes[0, :, 1] / nodes[0, 0, 1]
    return 0.5 * (y[1:] + y[:-1]), load / load.mean()


def draw(folder, problems: dict[str, om.Problem]) -> None:
    """Draw span load, twist and spar, before and after."""
    with figure(folder, "wing_aerostructural", size=(10.0, 3.2)) as canvas:
        load, twist, spar = canvas.subplots(1, 3)
        for name, problem in problems.items():
            color, line = STYLES.get(name, (GRAY, "-"))
            style, (y, strips) = {"color": color, "label": name, "linestyle": line}, load_of(problem)
            load.plot(y, strips, **style)
            twist.plot(np.linspace(0.0, 1.0, STATIONS), problem.get_val("twist", units="deg"), "o", **style)
            spar.step(y, problem.get_val("wall_thickness", units="mm").ravel(), where="mid", **style)
        draw_ellipse(load)
        for axes, label in ((twist, "twist (deg)"), (spar, "wall of the spar (mm)")):
            axes.set(xlabel="$2 y / b$", ylabel=label, xlim=(0.0, 1.0))


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/thumbnails/wing_aerostructural.png'
