"""Inverse design: from the M6 wing to another one whose grid is given, by more than 200 control-point variables.

The wing to be found is the M6 with all its surface control points displaced at random, by up to a fifth of the distance
between neighbours; its grid is made by the same chain. The optimiser sees distances of nodes alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import openmdao.api as om
from common import BLUE, GRAY, ORANGE, figure, run
from history import draw_history
from mismatch import Mismatch
from optimisation import UNCONSTRAINED, Run, optimise, set_up, write_n2
from scipy.spatial import cKDTree
from totals import check_totals
from wing_drawings import section_of

from bspline_mdao import FittedModel, GridMovement, LinearElasticity, fit_grid, moving_mesh, onera_m6_grid
from bspline_mdao.design.displacement import Local
from bspline_mdao.design.parametrization import Parametrization
from bspline_mdao.design.selection import NearPlane
from bspline_mdao.names import GRID

AMPLITUDE = 0.2
"""Largest displacement of a control point along each axis, by the distance to its nearest neighbour."""

CURVATURE = 0.1
"""Second derivative of the objective in one value alone, in units of the driver.

Those along other directions are up to some thirty times greater: the first step, down the gradient, is of the right
size.
"""

UNIT = 1e-12
"""Unit of the objective for the driver: LD_LBFGS also stops at a gradient below 1e-8, which should come late."""

TOLERANCE = 1e-10
"""Of the objective in that unit: of the mean square of the distances by that of the start it is 1e-22."""


@dataclass(frozen=True)
class Size:
    """A size of the problem: nodes and control points of each of the 12 blocks, increments, and axes that are free."""

    shape: tuple[int, int, int]
    n_control: tuple[int, int, int]
    n_increments: int
    axes: str


SMALL = Size((11, 9, 11), (7, 5, 7), 2, "xyz")
PAPER = Size((45, 65, 33), (13, 13, 9), 1, "y")

INCREMENTS = {"type": int, "help": "increments of the mover (2, and 1 at the paper's size)"}
"""Option of the command line."""


@dataclass(frozen=True, eq=False)
class InverseDesign:
    """The problem.

    Parameters
    ----------
    model : FittedModel
        Fit of the M6.
    parametrization : Parametrization
        Displacements of the surface control points.
    mover : LinearElasticity
        What moves the grid.
    target : dict of ndarray
        Values of the variables to be found, by name (m).
    """

    model: FittedModel
    parametrization: Parametrization
    mover: LinearElasticity
    target: dict[str, np.ndarray]

    @classmethod
    def of(cls, size: Size) -> InverseDesign:
        """Make the problem of one size."""
        model = fit_grid(onera_m6_grid(size.shape), n_control=size.n_control)
        mesh = moving_mesh(model)
        parametrization = Parametrization(mesh, variables_of(size.axes))
        surface = mesh.points[mesh.surface_ids]
        spacing = np.repeat(cKDTree(surface).query(surface, k=2)[0][:, 1], 3)
        rng, target = np.random.default_rng(6), {}
        for name, moved in parametrization.partials(surface, parametrization.initial).values.items():
            target[name] = AMPLITUDE * (abs(moved).T @ spacing) * rng.uniform(-1.0, 1.0, moved.shape[1])
        mover = LinearElasticity(mesh, n_increments=size.n_increments)
        return cls(model, parametrization, mover, target)

    def chain(self) -> om.Problem:
        """From the variables to the grid."""
        problem = om.Problem(reports=False)
        movement = GridMovement(model=self.model, parametrization=self.parametrization, mover=self.mover, quality=False)
        problem.model.add_subsystem("grid_movement", movement, promotes=["*"])
        return problem

    @cached_property
    def scales(self) -> dict[str, np.ndarray]:
        """Unit of each value for the driver (m): the second derivatives in one value alone are `CURVATURE`."""
        problem = self.chain()
        problem.setup()
        problem.run_model()
        problem.model.run_linearize()
        total = np.sqrt(UNIT * CURVATURE * self.target_grid.size / 6.0) * self.distance
        return {name: total / column_norms(problem, GRID, name) for name in self.target}

    @cached_property
    def target_grid(self) -> np.ndarray:
        """Nodes of the target, shape (3 n_nodes,) (m)."""
        problem = self.chain()
        problem.setup()
        for name, value in self.target.items():
            problem.set_val(name, value)
        problem.run_model()
        return problem.get_val(GRID).copy()

    @cached_property
    def distance(self) -> float:
        """Root mean square of the distances between the nodes of the M6 and of the target (m)."""
        return float(np.sqrt(3.0 * np.mean((self.model.regenerate().to_vector() - self.target_grid) ** 2)))

    def problem(self) -> om.Problem:
        """The least squares, not set up."""
        problem = self.chain()
        target = self.target_grid
        weights = 3.0 / target.size / self.distance**2
        mismatch = Mismatch(source=GRID, units="m", target=target, weights=weights)
        problem.model.add_subsystem("match", mismatch, promotes=["*"])
        for name, scale in self.scales.items():
            problem.model.add_design_var(name, ref=scale)
        problem.model.add_objective("mismatch", ref=UNIT)
        return problem

    def errors(self, problem: om.Problem) -> dict:
        """What is left between the solution and the target."""
        found = np.concatenate([problem.get_val(name) for name in self.target])
        wanted = np.concatenate(list(self.target.values()))
        return {
            "relative_error_of_variables": np.linalg.norm(found - wanted) / np.linalg.norm(wanted),
            "largest_error_of_variables": np.abs(found - wanted).max(),
            "largest_distance": np.linalg.norm((problem.get_val(GRID) - self.target_grid).reshape(-1, 3), axis=1).max(),
        }


def column_norms(problem: om.Problem, of: str, wrt: str) -> np.ndarray:
    """Norms of the derivatives of a long vector in every value of a variable, one forward product each."""
    seeds = np.eye(problem.get_val(wrt).size)
    products = (problem.compute_jacvec_product([of], [wrt], "fwd", {wrt: seed})[of] for seed in seeds)
    return np.array([np.linalg.norm(product) for product in products])


def variables_of(axes: str) -> list[Local]:
    """Displacements along some axes; points in the symmetry plane stay in it."""
    in_plane = "".join(axis for axis in axes if axis != "z")
    outside = ~NearPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    return [Local(f"move_{in_plane}", None, in_plane)] + [Local("move_z", outside, "z")] * ("z" in axes)


def main(paper: bool = False, figures=None, increments: int | None = None, drivers=UNCONSTRAINED) -> dict:
    """Find the wing with every driver.

    Parameters
    ----------
    paper : bool
        12 blocks of 45 x 65 x 33 nodes and 205 variables; small and 225 variables by default.
    figures : path-like, optional
        Folder for ``inverse_design.png`` and the N2 diagram ``inverse_design.html``.
    increments : int, optional
        Increments of the mover. With one the grid depends linearly on the variables.
    drivers : dict
        Makers of drivers by name, see `optimisation.UNCONSTRAINED`.

    Returns
    -------
    dict
        ``n_nodes``, ``n_variables``, the root mean square ``initial_distance`` of nodes (m); ``totals``, see
        `totals.check_totals`; for each driver what `optimisation.Run.numbers` tells and
        ``relative_error_of_variables``, the norm of the error by that of the target, ``largest_error_of_variables`` (m)
        and ``largest_distance`` of a node (m).
    """
    size = PAPER if paper else SMALL
    design = InverseDesign.of(replace(size, n_increments=increments or size.n_increments))
    runs = {name: optimise(design.problem, make(TOLERANCE, 2000)) for name, make in drivers.items()}
    numbers = {
        "n_nodes": design.model.n_nodes,
        "n_variables": sum(map(len, design.target.values())),
        "initial_distance": design.distance,
        "drivers": {name: result.numbers() | design.errors(result.problem) for name, result in runs.items()},
        "totals": check_totals(part_of_the_way(design), step=1e-3 / np.sqrt(UNIT)),
    }
    if figures:
        draw(figures, design, runs)
        write_n2(set_up(design.problem()), figures, "inverse_design")
    return numbers


def part_of_the_way(design: InverseDesign) -> om.Problem:
    """The problem at a third of the way, where no derivative is zero."""
    problem = set_up(design.problem())
    for name, value in design.target.items():
        problem.set_val(name, value / 3.0)
    problem.run_model()
    return problem


def draw(folder, design: InverseDesign, runs: dict[str, Run]) -> None:
    """Draw the section halfway of the M6, of the target and of what was found, and the histories."""
    found = next(reversed(runs.values())).problem.get_val(GRID)
    wings = {
        "M6": (design.model.regenerate().to_vector(), GRAY, "-"),
        "target": (design.target_grid, ORANGE, "-"),
        "found": (found, BLUE, "o"),
    }
    with figure(folder, "inverse_design", (9.5, 3.4)) as canvas:
        section, history = canvas.subplots(1, 2, width_ratios=(1.3, 1.0))
        for name, (nodes, color, style) in wings.items():
            line = section_of(design.model, nodes)
            section.plot(line[:, 0], line[:, 1], style, color=color, label=name, markersize=3.0)
        section.set(xlabel="x (m)", ylabel="y (m)")
        section.legend()
        draw_history(history, runs, "mismatch", "mean square distance by that of the start")


if __name__ == "__main__":
    run(main, __doc__, increments=INCREMENTS)
