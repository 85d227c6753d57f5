"""Inverse design: the ONERA M6 from its pressures, by more than 100 control-point variables.

The wing to be found is the M6 with smooth random bumps on both sides. The optimiser sees the pressure coefficients of
the wall faces alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import openmdao.api as om
from common import BLUE, GRAY, ORANGE, figure, run
from flown_wing import OPTIONS, FlownWing, Scale, control_counts, optimise_with, size_of
from history import draw_course, draw_history
from mismatch import Mismatch
from optimisation import UNCONSTRAINED, Run, flow_in_one, set_up, write_n2
from scipy.linalg import svd
from totals import check_totals
from wall_sections import faces_around

from bspline_mdao import Local, fit_grid, onera_m6_grid
from bspline_mdao.cells.quads import area_vectors
from bspline_mdao.names import GRID

MACH = 0.3
ALPHA = 2.0
"""Angle of attack (deg)."""

AREA = 0.5 * (1.0 + 0.562) * 1.4843
"""Of the half wing (m^2)."""

HEIGHT = 0.2
"""Root mean square of the bumps, by the height of a control point above the middle of the section."""

N_WAVES = 3
"""Half waves of the bumps along the chord and along the span."""

UNIT = 1e-12
"""Unit of the objective for the driver: LD_LBFGS also stops at a gradient below 1e-8, which should come late."""


@dataclass(frozen=True)
class Size:
    """Nodes and control points of the blocks along the stream, away from the wing and along the span; a tolerance.

    There is one number per row of blocks, see `hh_wing_grid`. The tolerance is that of the objective, the mean square
    of the differences by that of the start.
    """

    shape: tuple
    n_control: tuple
    tolerance: float


SIZES = {
    "quick": Size(((5, 9, 5), (6, 6), (7, 5)), ((4, 7, 4), (4, 4), (5, 4)), 1e-15),
    "default": Size(((7, 11, 7), (7, 7), (11, 5)), ((5, 9, 5), (5, 5), (9, 4)), 1e-15),
    "paper": Size(((17, 33, 17), (25, 25), (25, 13)), ((7, 11, 7), (9, 9), (11, 7)), 1e-15),
}


class Combined(om.ExplicitComponent):
    """Values of one variable as linear combinations, which an optimiser chooses instead.

    ================  ======  ===========  =====  =============================
    name              role    shape        units  meaning
    ================  ======  ===========  =====  =============================
    ``combinations``  input   (n_modes,)          what the optimiser chooses
    option            output  (n_values,)  m      ``modes @ combinations``
    ================  ======  ===========  =====  =============================

    Options
    -------
    values : str
        Name of the variable.
    modes : ndarray, shape (n_values, n_modes)
        The combinations (m).
    """

    def initialize(self):
        """Declare the options."""
        self.options.declare("values", types=str, desc="name of the variable")
        self.options.declare("modes", types=np.ndarray, recordable=False, desc="the combinations")

    def setup(self):
        """Declare the variables."""
        n_values, n_modes = self.options["modes"].shape
        self.add_input("combinations", val=np.zeros(n_modes))
        self.add_output(self.options["values"], shape=n_values, units="m")
        self.declare_partials(self.options["values"], "combinations", val=self.options["modes"])

    def compute(self, inputs, outputs):
        """Combine."""
        outputs[self.options["values"]] = self.options["modes"] @ inputs["combinations"]


@dataclass(frozen=True, eq=False)
class PressureTarget:
    """The problem.

    Parameters
    ----------
    wing : FlownWing
        The M6.
    """

    wing: FlownWing

    @classmethod
    def of(cls, size: Size) -> PressureTarget:
        """Make the problem of one size."""
        model = fit_grid(onera_m6_grid(size.shape), n_control=control_counts(size.n_control))
        return cls(FlownWing(model, "euler", Scale(AREA)))

    @cached_property
    def variable(self) -> Local:
        """Heights of all control points but those of the edges."""
        return Local("heights", self.wing.sides, "y")

    @cached_property
    def heights(self) -> np.ndarray:
        """Heights to be found (m)."""
        mesh = self.wing.mesh
        points = mesh.points[mesh.surface_ids][self.variable.where.mask(mesh)]
        return HEIGHT * points[:, 1] * smooth_noise((points - points.min(axis=0)) / np.ptp(points, axis=0))

    def flight(self) -> om.Problem:
        """From the heights to the pressures. Not set up."""
        problem = self.wing.problem([self.variable], MACH)
        problem.model.set_input_defaults("alpha", val=ALPHA, units="deg")
        return problem

    @cached_property
    def target(self) -> np.ndarray:
        """Pressure coefficients of the wing to be found."""
        return self.fly(self.heights)

    @cached_property
    def weights(self) -> np.ndarray:
        """Areas of the wall faces on the M6, by the weighted sum of squares at the start."""
        areas = np.linalg.norm(area_vectors(self.wing.baseline[self.wing.wall_quads]), axis=1)
        return areas / (areas @ (self.fly(0.0 * self.heights) - self.target) ** 2)

    def fly(self, heights: np.ndarray) -> np.ndarray:
        """Pressure coefficients of the wall faces of a wing."""
        problem = self.flight()
        problem.setup()
        problem.set_val("heights", heights)
        problem.run_model()
        return problem.get_val("Cp").copy()

    @cached_property
    def decomposition(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Singular values of the derivative of the weighted pressures in the heights on the M6 and its modes."""
        problem = self.flight()
        problem.setup(mode="fwd")
        problem.run_model()
        derivative = np.sqrt(self.weights)[:, None] * problem.compute_totals(["Cp"], ["heights"])["Cp", "heights"]
        return svd(derivative, full_matrices=False)[1:]

    @property
    def condition(self) -> float:
        """Ratio of the largest to the smallest singular value of the derivative."""
        values, _ = self.decomposition
        return values[0] / values[-1]

    @property
    def modes(self) -> np.ndarray:
        """Combinations of heights (m), shape (n, n), along all of which the objective is equally curved on the M6."""
        values, modes = self.decomposition
        return modes.T / values

    def problem(self) -> om.Problem:
        """The least squares. Not set up."""
        problem = self.flight()
        combined = Combined(values="heights", modes=self.modes)
        problem.model.add_subsystem("combine", combined, promotes=["*"])
        problem.model.set_order(["combine", "geometry", "flow", "drag"])
        mismatch = Mismatch(source="Cp", target=self.target, weights=self.weights)
        problem.model.add_subsystem("match", mismatch, promotes=["*"])
        problem.model.add_design_var("combinations", ref=np.sqrt(0.5 * UNIT))  # second derivatives are then 1
        problem.model.add_objective("mismatch", ref=UNIT)
        return problem

    def errors(self, problem: om.Problem) -> dict:
        """What is left between the solution and the target."""
        errors = problem.get_val("heights") - self.heights
        return {
            "relative_error_of_variables": np.linalg.norm(errors) / np.linalg.norm(self.heights),
            "largest_error_of_variables": np.abs(errors).max(),
            "largest_error_of_pressure": np.abs(problem.get_val("Cp") - self.target).max(),
        }


def smooth_noise(places: np.ndarray) -> np.ndarray:
    """Sums of half waves with random amplitudes, their root mean square 1, at places (n, 3) in the unit cube.

    Those below the middle of its height are not those above.
    """
    rng = np.random.default_rng(9)
    waves = np.cos(np.pi * places[:, [0, 2], None] * np.arange(N_WAVES))
    sides = np.einsum("ni,nj,sij->sn", waves[:, 0], waves[:, 1], rng.normal(size=(2, N_WAVES, N_WAVES)))
    noise = np.where(places[:, 1] > 0.5, *sides)
    return noise / np.sqrt(np.mean(noise**2))


def main(paper: bool = False, figures=None, quick: bool = False, drivers=UNCONSTRAINED) -> dict:
    """Find the wing with every driver.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`.
    figures : path-like, optional
        Folder for ``pressure_target.png``, the N2 diagram ``pressure_target.html`` and the recorded cases.
    drivers : dict
        Makers of drivers by name, see `optimisation.UNCONSTRAINED`.

    Returns
    -------
    dict
        ``n_nodes``, ``n_variables``, ``condition`` (ratio of the singular values of the derivative); ``totals``, see
        `totals.check_totals`; for each driver what `optimisation.Run.numbers` tells and
        ``relative_error_of_variables``, the norm of the error by that of the target, ``largest_error_of_variables`` (m)
        and ``largest_error_of_pressure``.
    """
    size = size_of(SIZES, paper, quick)
    design = PressureTarget.of(size)
    runs = optimise_with(drivers, design.problem, size.tolerance / UNIT, 100, figures, "pressure_target")
    part_of_the_way = set_up(design.problem())
    if figures:
        write_n2(part_of_the_way, figures, "pressure_target")
        draw(figures, design, runs)
    part_of_the_way.set_val("combinations", next(iter(runs.values())).problem.get_val("combinations") / 3.0)
    part_of_the_way.run_model()
    return {
        "n_nodes": design.wing.model.n_nodes,
        "n_variables": design.heights.size,
        "condition": design.condition,
        "drivers": {name: flow_in_one(result) | design.errors(result.problem) for name, result in runs.items()},
        "totals": check_totals(part_of_the_way, n_directions=1, step=1e-2 / np.sqrt(UNIT), levels=2),
    }


def draw(folder, design: PressureTarget, runs: dict[str, Run]) -> None:
    """Draw a section of the M6, of the target and of what was found with its pressures, and the histories."""
    found = next(reversed(runs.values())).problem
    start, target = (set_up(design.flight()) for _ in range(2))
    target.set_val("heights", design.heights)
    target.run_model()
    wings = {"M6": (start, GRAY, "-"), "target": (target, ORANGE, "-"), "found": (found, BLUE, ".")}
    walls = design.wing.baseline[design.wing.wall_quads]
    around = faces_around(walls, 0.5 * walls[..., 2].max())
    with figure(folder, "pressure_target", (9.5, 6.5)) as canvas:
        (section, pressure), (mismatch, course) = canvas.subplots(2, 2)
        for name, (problem, color, style) in wings.items():
            middles = problem.get_val(GRID).reshape(-1, 3)[design.wing.wall_quads[around]].mean(axis=1)
            section.plot(*middles.T[:2], style, color=color, label=name)
            pressure.plot(middles[:, 0], problem.get_val("Cp")[around], style, color=color, label=name)
        section.set(xlabel="$x$ (m)", ylabel="$y$ (m)")
        pressure.set(xlabel="$x$ (m)", ylabel="$C_p$")
        pressure.invert_yaxis()
        section.legend()
        draw_history(mismatch, runs, "mismatch", "mean square difference by that of the start")
        draw_course(course, runs)


if __name__ == "__main__":
    run(main, __doc__, quick=OPTIONS["quick"])
