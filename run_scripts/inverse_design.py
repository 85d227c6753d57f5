"""Inverse design from a grid.

Inverse design: from the M6 wing to another one whose grid is given, by more than 200 control-point variables. The wing
to be found is the M6 with all its surface control points displaced at random, by up to a fifth of the distance between
neighbours; its grid is made by the same chain. The optimiser only sees distances of nodes. It takes a minute and a
half, and ten minutes at the paper's size. The output is the errors of the variables and of the nodes, how the
optimisers converged, a check of the totals, and a picture of a section and the histories.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.drivers import nlopt, recorded, scipy_slsqp
from bspline_mdao.names import GRID
from bspline_mdao.plotting import BLUE, ORANGE, draw_history, draw_sections, figure
from bspline_mdao.scripts import run
from bspline_mdao.testing import check_totals

SIZES = {True: ((45, 65, 33), (13, 13, 9), 1, "y"), False: ((11, 9, 11), (7, 5, 7), 2, "xyz")}
"""Nodes and control points of each of the 12 blocks, increments, and free axes; the paper's (True) and small."""

DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_LBFGS": partial(nlopt, algorithm="LD_LBFGS")}

AMPLITUDE = 0.2
"""Largest displacement of a control point along each axis, relative to the distance to its nearest neighbour."""

CURVATURE = 0.1
"""Second derivative of the objective in only one value, in units of the driver.

Those along other directions are up to some thirty times greater: the first step, down the gradient, is of the right
size.
"""

UNIT = 1e-12
"""Unit of the objective for the driver: LD_LBFGS also stops at a gradient below 1e-8, which should come late."""

TOLERANCE = 1e-10
"""Of the objective in that unit: of the mean square of the distances, relative to the start's, it is 1e-22."""


class Mismatch(om.ExplicitComponent):
    """Mean square of the distances of the ``grid`` from a target, relative to the square of ``distance``."""

    def initialize(self):
        """Declare the options."""
        self.options.declare("target", types=np.ndarray, recordable=False, desc="nodes, shape (3 n,) (m)")
        self.options.declare("distance", types=float, desc="unit of the distances (m)")

    def setup(self):
        """Declare the variables."""
        self.add_input(GRID, val=self.options["target"], units="m")
        self.add_output("mismatch")
        self.declare_partials("mismatch", GRID)

    def compute(self, inputs, outputs):
        """Square the differences."""
        outputs["mismatch"] = self._weight() * np.sum((inputs[GRID] - self.options["target"]) ** 2)

    def compute_partials(self, inputs, partials):
        """Differentiate the squares."""
        partials["mismatch", GRID] = 2.0 * self._weight() * (inputs[GRID] - self.options["target"])

    def _weight(self) -> float:
        return 3.0 / self.options["target"].size / self.options["distance"] ** 2


class InverseDesign:
    """The problem of one size: its ``model``, the ``target`` by variable (m), its grid, and the ``distance`` to it."""

    def __init__(self, shape, n_control, n_increments: int, axes: str):
        self.model = bm.fit_grid(bm.generators.onera_m6_grid(shape), n_control=n_control)
        mesh = bm.movers.moving_mesh(self.model)
        in_plane, outside = axes.replace("z", ""), ~bm.design.NearPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        variables = [bm.design.Local(f"move_{in_plane}", None, in_plane)]  # points in the symmetry plane stay in it
        variables += [bm.design.Local("move_z", outside, "z")] if "z" in axes else []
        self.parametrization = bm.design.Parametrization(mesh, variables)
        self.mover = bm.movers.LinearElasticity(mesh, n_increments=n_increments)

        surface, rng = mesh.points[mesh.surface_ids], np.random.default_rng(6)
        distances = np.linalg.norm(surface[:, None] - surface, axis=2)
        spacing = np.repeat(np.sort(distances, axis=1)[:, 1], 3)
        moved = self.parametrization.partials(surface, self.parametrization.initial).values
        self.target = {
            name: AMPLITUDE * (abs(matrix).T @ spacing) * rng.uniform(-1.0, 1.0, matrix.shape[1])
            for name, matrix in moved.items()
        }
        there = self.run_chain(self.target)
        self.target_grid = there.get_val(GRID).copy()
        start = self.run_chain({})
        self.distance = float(np.sqrt(3.0 * np.mean((start.get_val(GRID) - self.target_grid) ** 2)))
        start.model.run_linearize()
        total = np.sqrt(UNIT * CURVATURE * self.target_grid.size / 6.0) * self.distance
        self.scales = {name: total / column_norms(start, name) for name in self.target}

    def chain(self) -> om.Problem:
        """From the variables to the grid, not set up."""
        options = {"parametrization": self.parametrization, "mover": self.mover, "quality": False}
        problem = om.Problem(reports=None)
        problem.model.add_subsystem("grid_movement", bm.GridMovement(model=self.model, **options), promotes=["*"])
        return problem

    def run_chain(self, values: dict) -> om.Problem:
        """Run the chain with some values of the variables."""
        problem = self.chain()
        problem.setup()
        for name, value in values.items():
            problem.set_val(name, value)
        problem.run_model()
        return problem

    def problem(self) -> om.Problem:
        """The least squares, not set up."""
        problem = self.chain()
        mismatch = Mismatch(target=self.target_grid, distance=self.distance)
        problem.model.add_subsystem("match", mismatch, promotes=["*"])
        for name, scale in self.scales.items():  # the second derivatives in one value alone are then `CURVATURE`
            problem.model.add_design_var(name, ref=scale)
        problem.model.add_objective("mismatch", ref=UNIT)
        return problem

    def errors(self, problem: om.Problem) -> dict:
        """Compare the solution with the target."""
        found = np.concatenate([problem.get_val(name) for name in self.target])
        wanted = np.concatenate(list(self.target.values()))
        return {
            "relative_error_of_variables": np.linalg.norm(found - wanted) / np.linalg.norm(wanted),
            "largest_error_of_variables": np.abs(found - wanted).max(),
            "largest_distance": np.linalg.norm((problem.get_val(GRID) - self.target_grid).reshape(-1, 3), axis=1).max(),
        }


def column_norms(problem: om.Problem, name: str) -> np.ndarray:
    """Norms of the derivatives of the grid with respect to every value of a variable, one forward product each."""
    seeds = np.eye(problem.get_val(name).size)
    products = (problem.compute_jacvec_product([GRID], [name], "fwd", {name: seed})[GRID] for seed in seeds)
    return np.array([np.linalg.norm(product) for product in products])


def main(paper: bool = False, figures=None, increments: int | None = None, drivers=DRIVERS) -> dict:
    """Find the wing with every driver.

    Parameters
    ----------
    paper : bool
        12 blocks of 45 x 65 x 33 nodes and 205 variables; small and 225 variables by default.
    figures : path-like, optional
        Folder for ``inverse_design.png`` and the N2 diagram ``inverse_design.html``.
    increments : int, optional
        Increments of the mover (2, and 1 at the paper's size). With one the grid depends linearly on the variables.
    drivers : dict
        Makers of drivers by name.

    Returns
    -------
    dict
        ``n_nodes``, ``n_variables``, the root mean square ``initial_distance`` of nodes (m); ``totals``, see
        `check_totals`; for each driver what `RecordedRun.numbers` returns and ``relative_error_of_variables``, the norm
        of the error relative to the target's, ``largest_error_of_variables`` (m) and ``largest_distance`` of a
        node (m).
    """
    shape, n_control, n_increments, axes = SIZES[paper]
    design = InverseDesign(shape, n_control, increments or n_increments, axes)
    runs = {}
    for driver, make_driver in drivers.items():
        problem = design.problem()
        problem.driver = make_driver(TOLERANCE, 2000)
        with recorded(problem) as runs[driver]:
            problem.run_driver()
    part_of_the_way = started(design)
    if figures:
        draw(figures, design, runs)
        om.n2(part_of_the_way, outfile=str(Path(figures) / "inverse_design.html"), show_browser=False)
    return {
        "n_nodes": design.model.n_nodes,
        "n_variables": sum(map(len, design.target.values())),
        "initial_distance": design.distance,
        "drivers": {name: result.numbers() | design.errors(result.problem) for name, result in runs.items()},
        "totals": check_totals(part_of_the_way, step=1e-3 / np.sqrt(UNIT))._asdict(),
    }


def started(design: InverseDesign) -> om.Problem:
    """Run the problem at a third of the way, where no derivative is zero."""
    problem = design.problem()
    problem.setup(mode="rev")
    for name, value in design.target.items():
        problem.set_val(name, value / 3.0)
    problem.run_model()
    return problem


def draw(folder, design: InverseDesign, runs: dict) -> None:
    """Draw the section halfway of the M6, of the target and of what was found, and the histories."""
    found = next(reversed(runs.values())).problem.get_val(GRID)
    styles = {
        "target": (design.target_grid, {"color": ORANGE, "linewidth": 4.0}),
        "found": (found, {"color": BLUE, "linewidth": 1.2}),
        "M6": (design.model.regenerate().to_vector(), {"color": "black", "linewidth": 0.8, "linestyle": "--"}),
    }
    with figure(folder, "inverse_design", (9.5, 3.2), n_colours=256) as canvas:
        section, history = canvas.subplots(1, 2, width_ratios=(1.6, 1.0))
        for name, (nodes, style) in styles.items():
            draw_sections(section, design.model, nodes, (0.5,), label=name, **style)
        section.legend(loc="upper center", ncols=3, bbox_to_anchor=(0.5, 1.8))
        draw_history(history, runs, "mismatch", "mean square distance, relative")


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/inverse_design.png'
