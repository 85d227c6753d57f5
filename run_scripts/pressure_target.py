"""Inverse design from pressures.

Inverse design: the ONERA M6 from its pressures, by more than 100 control-point variables. The wing to be found is the
M6 with smooth random bumps on both sides. The optimiser only sees the pressure coefficients of the wall faces. Its
variables are combinations of the heights along which the objective is equally curved on the M6. It takes a minute, with
``--quick`` half of that, and many hours at the paper's size. The output is the errors of the heights and of the
pressures, how the optimisers converged, a check of the totals, and a picture of a section, its pressures and the
histories.
"""

from __future__ import annotations

from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.design import Local, OnPatch, Parametrization
from bspline_mdao.drivers import nlopt, recorded, scipy_slsqp
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.movers import LinearElasticity, moving_mesh
from bspline_mdao.names import GRID
from bspline_mdao.plotting import (
    BLUE,
    GRAY,
    ORANGE,
    draw_history,
    draw_optimality,
    draw_pressures,
    faces_around,
    figure,
    wall_quads,
)
from bspline_mdao.scripts import pick_size, run
from bspline_mdao.testing import check_totals

MACH, ALPHA = 0.3, 2.0
"""Mach number and angle of attack (deg)."""

AREA = 0.5 * (1.0 + 0.562) * 1.4843
"""Of the half wing (m^2)."""

HEIGHT, N_WAVES = 0.2, 3
"""Root mean square of the bumps, relative to the height of a control point above the middle of the section, and their
half waves along the chord and along the span."""

UNIT, TOLERANCE = 1e-12, 1e-15
"""Unit of the objective for the driver: LD_LBFGS also stops at a gradient below 1e-8, which should come late.

The tolerance is for the objective, the mean square of the differences relative to the start's.
"""

SIZES = {
    "quick": (((5, 9, 5), (6, 6), (7, 5)), ((4, 7, 4), (4, 4), (5, 4))),
    "default": (((7, 11, 7), (7, 7), (11, 5)), ((5, 9, 5), (5, 5), (9, 4))),
    "paper": (((17, 33, 17), (25, 25), (25, 13)), ((7, 11, 7), (9, 9), (11, 7))),
}
"""Nodes and control points of the rows of blocks along the stream, away from the wing and along the span."""

DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_LBFGS": partial(nlopt, algorithm="LD_LBFGS")}


class PressureTarget:
    """The problem of one size: ``heights`` (m) and ``target`` (pressures) to be found, ``weights`` and ``modes``."""

    def __init__(self, shape, n_control):
        stream, normal, span = n_control
        counts = [(i, j, k) for k, j, i in product(span, normal, stream)]
        self.model = bm.fit_grid(onera_m6_grid(shape), n_control=counts)
        self.mesh = moving_mesh(self.model)
        upper, lower = (OnPatch(self.model, f"wing_{side}") for side in ("upper", "lower"))
        sides = (upper & ~lower) | (lower & ~upper)  # not the control points that both share, of edges and tip
        self.variable = Local("heights", sides, "y")
        points = self.mesh.points[self.mesh.surface_ids][sides.mask(self.mesh)]
        self.heights = HEIGHT * points[:, 1] * smooth_noise((points - points.min(axis=0)) / np.ptp(points, axis=0))
        self.target = started(self.flight(), heights=self.heights).get_val("Cp").copy()

        start = started(self.flight(), "fwd", heights=0.0 * self.heights)
        self.walls = self.model.regenerate().to_vector().reshape(-1, 3)[wall_quads(self.model)]
        diagonals = self.walls[:, 2] - self.walls[:, 0], self.walls[:, 3] - self.walls[:, 1]
        areas = 0.5 * np.linalg.norm(np.cross(*diagonals), axis=1)
        self.weights = areas / (areas @ (start.get_val("Cp") - self.target) ** 2)
        derivative = np.sqrt(self.weights)[:, None] * start.compute_totals(["Cp"], ["heights"])["Cp", "heights"]
        _, values, modes = np.linalg.svd(derivative, full_matrices=False)
        self.modes, self.condition = modes.T / values, values[0] / values[-1]

    def flight(self) -> om.Problem:
        """From the heights to the pressures. Not set up."""
        problem, parametrization = om.Problem(reports=None), Parametrization(self.mesh, [self.variable])
        mover, flow = (LinearElasticity(self.mesh, n_increments=1), bm.EulerFlow(model=self.model, reference_area=AREA))
        geometry = bm.GridMovement(model=self.model, parametrization=parametrization, mover=mover, fit=False)
        problem.model.add_subsystem("geometry", geometry, promotes=["*"])
        problem.model.add_subsystem("flow", flow, promotes=["*"])
        problem.model.set_input_defaults("Mach_number", val=MACH)
        problem.model.set_input_defaults("alpha", val=ALPHA, units="deg")
        return problem

    def problem(self) -> om.Problem:
        """The least squares. Not set up."""
        problem = self.flight()
        n = self.heights.size
        combine = om.ExecComp(
            "heights = dot(modes, combinations)",
            modes={"val": self.modes, "constant": True},
            combinations={"val": np.zeros(n)},  # the M6
            heights={"shape": n, "units": "m"},
            do_coloring=False,
        )
        constants = {name: {"val": getattr(self, name), "constant": True} for name in ("weights", "target")}
        formula = "mismatch = sum(weights * (Cp - target)**2)"
        match = om.ExecComp(formula, Cp={"shape": self.target.size}, **constants, do_coloring=False)
        problem.model.add_subsystem("combine", combine, promotes=["*"])
        problem.model.add_subsystem("match", match, promotes=["*"])
        problem.model.set_order(["combine", "geometry", "flow", "match"])
        problem.model.add_design_var("combinations", ref=np.sqrt(0.5 * UNIT))  # second derivatives are then 1
        problem.model.add_objective("mismatch", ref=UNIT)
        return problem

    def errors(self, problem: om.Problem) -> dict:
        """Compare the solution with the target."""
        errors = problem.get_val("heights") - self.heights
        return {
            "relative_error_of_variables": np.linalg.norm(errors) / np.linalg.norm(self.heights),
            "largest_error_of_variables": np.abs(errors).max(),
            "largest_error_of_pressure": np.abs(problem.get_val("Cp") - self.target).max(),
        }


def started(problem: om.Problem, mode: str = "rev", **values: np.ndarray) -> om.Problem:
    """Set a problem up and run it with some values."""
    problem.setup(mode=mode)
    for name, value in values.items():
        problem.set_val(name, value)
    problem.run_model()
    return problem


def smooth_noise(places: np.ndarray) -> np.ndarray:
    """Sums of half waves with random amplitudes, their root mean square 1, at places (n, 3) in the unit cube.

    Those below the middle of its height are not those above.
    """
    rng = np.random.default_rng(9)
    waves = np.cos(np.pi * places[:, [0, 2], None] * np.arange(N_WAVES))
    sides = np.einsum("ni,nj,sij->sn", waves[:, 0], waves[:, 1], rng.normal(size=(2, N_WAVES, N_WAVES)))
    noise = np.where(places[:, 1] > 0.5, *sides)
    return noise / np.sqrt(np.mean(noise**2))


def main(paper: bool = False, figures=None, quick: bool = False, drivers=DRIVERS) -> dict:
    """Find the wing with every driver.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`.
    figures : path-like, optional
        Folder for ``pressure_target.png``, the N2 diagram ``pressure_target.html`` and the recorded cases.
    drivers : dict
        Makers of drivers by name.

    Returns
    -------
    dict
        ``n_nodes``, ``n_variables``, ``condition`` (ratio of the singular values of the derivative); ``totals``, see
        `check_totals`; for each driver what `RecordedRun.numbers` returns and ``relative_error_of_variables``, the norm
        of the error relative to the target's, ``largest_error_of_variables`` (m) and
        ``largest_error_of_pressure``.
    """
    design = PressureTarget(*pick_size(SIZES, paper, quick))
    runs = {}
    for driver, make_driver in drivers.items():
        problem = design.problem()
        problem.driver = make_driver(TOLERANCE / UNIT, 100)
        with recorded(problem, figures, f"pressure_target_{driver}") as runs[driver]:
            problem.run_driver()
    part = next(iter(runs.values())).problem.get_val("combinations") / 3.0
    part_of_the_way = started(design.problem(), combinations=part)
    if figures:
        draw(figures, design, runs)
        om.n2(part_of_the_way, outfile=str(Path(figures) / "pressure_target.html"), show_browser=False)
    return {
        "n_nodes": design.model.n_nodes,
        "n_variables": design.heights.size,
        "condition": design.condition,
        "drivers": {name: result.numbers("flow") | design.errors(result.problem) for name, result in runs.items()},
        "totals": check_totals(part_of_the_way, n_directions=1, step=1e-2 / np.sqrt(UNIT), levels=2)._asdict(),
    }


def draw(folder, design: PressureTarget, runs: dict) -> None:
    """Draw by how much a section leaves that of the M6, its pressures, and the histories."""
    start, target = (started(design.flight(), heights=part * design.heights) for part in (0.0, 1.0))
    wings = {"M6": (start, GRAY, 1.4), "target": (target, ORANGE, 4.0)}
    wings["found"] = next(reversed(runs.values())).problem, BLUE, 1.2
    walls, place = design.walls, 0.5 * design.walls[..., 2].max()
    around = faces_around(walls, place)
    with figure(folder, "pressure_target", (9.5, 6.5), n_colours=256) as canvas:
        (section, pressure), (mismatch, optimality) = canvas.subplots(2, 2)
        for name, (problem, color, width) in wings.items():
            quads = problem.get_val(GRID).reshape(-1, 3)[wall_quads(design.model)]
            style = {"color": color, "label": name, "linewidth": width}
            x, y, _ = quads[around].mean(axis=1).T
            section.plot(x, 1e3 * (y - walls[around, :, 1].mean(axis=1)), ".-", **style)
            draw_pressures(pressure, quads, problem.get_val("Cp"), place, marker=".", **style)
        section.set(xlabel="$x$ (m)", ylabel="height above the M6 (mm)")
        pressure.legend()
        draw_history(mismatch, runs, "mismatch", "mean square difference relative to the start")
        draw_optimality(optimality, runs)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/pressure_target.png'
