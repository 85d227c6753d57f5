"""Twist and planform of least induced drag at fixed lift: the regenerated wing in OpenAeroStruct's vortex lattice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import openmdao.api as om
from common import GRAY, figure, run
from history import COLORS
from lattice_wing import LINES, RectangularWing, started
from optimisation import DRIVERS, Run, flow_in_one, optimise, write_n2
from totals import check_totals

from bspline_mdao import VortexLattice
from bspline_mdao.design.planform import Chord, Sweep, Taper, Twist
from bspline_mdao.design.reference_axis import ReferenceAxis
from bspline_mdao.design.variable import Variable
from bspline_mdao.flow.induced_drag import Wake, least_drag

LIFT = 0.5
"""Lift coefficient, of the area of the rectangular wing."""

ALPHA = 4.0
"""Angle of attack where it is fixed (deg)."""

MACH = 0.3
"""Of the flight."""

TOLERANCE = 1e-10
"""Of the objective, the drag by that of the elliptical load."""


@dataclass(frozen=True, eq=False)
class Case:
    """What is designed.

    Parameters
    ----------
    title : str
        For the figure.
    variables : callable
        Variables of an axis and a number of stations.
    design : callable
        Adds design variables and further constraints to a model, for a wing.
    fixed : dict
        Values and units of inputs that stay.
    """

    title: str
    variables: Callable[[ReferenceAxis, int], list[Variable]]
    design: Callable[[om.Group, RectangularWing], None]
    fixed: dict

    def problem(self, wing: RectangularWing) -> om.Problem:
        """Pose the case for a wing. Not yet set up."""
        lattice = VortexLattice(n_chord=wing.size.n_chord, n_span=wing.size.n_span, reference_area=wing.area)
        problem = wing.problem(self.variables(wing.trailing_edge, wing.size.stations), lattice)
        for name, (value, units) in {"Mach_number": (MACH, None), "alpha": (ALPHA, "deg"), **self.fixed}.items():
            problem.model.set_input_defaults(name, val=value, units=units)
        self.design(problem.model, wing)
        problem.model.add_constraint("CL", equals=LIFT)
        problem.model.add_objective("CD", ref=LIFT**2 / (np.pi * wing.aspect_ratio))
        return problem


def design_twist(model: om.Group, wing: RectangularWing) -> None:
    """Leave the twist at all stations free."""
    model.add_design_var("twist", lower=-10.0, upper=10.0, ref=5.0, units="deg")


def design_chord(model: om.Group, wing: RectangularWing) -> None:
    """Leave the chord at all stations and the angle of attack free; the area stays."""
    model.add_design_var("chord", lower=wing.size.least_chord, upper=1.5, ref=0.3)
    model.add_design_var("alpha", lower=-10.0, upper=10.0, ref=5.0, units="deg")
    model.add_constraint("S_mesh", equals=wing.area, ref=wing.area, units="m**2")


CASES = {
    "twist": Case("twist of the rectangular wing", lambda axis, n: [Twist("twist", axis, n)], design_twist, {}),
    "chord": Case("chord of the untwisted wing", lambda axis, n: [Chord("chord", axis, n)], design_chord, {}),
    "swept": Case(
        "twist of a swept and tapered wing",
        lambda axis, n: [Taper("taper", axis), Twist("twist", axis, n), Sweep("sweep", axis)],
        design_twist,
        {"taper": (0.5, None), "sweep": (25.0, "deg")},
    ),
}


def main(paper: bool = False, figures=None, drivers=DRIVERS) -> dict:
    """Find the least induced drag of every case with every driver.

    Parameters
    ----------
    paper : bool
        12 blocks of 45 x 65 x 33 nodes and 30 strips per half wing; some 15,000 nodes and 10 strips by default.
    figures : path-like, optional
        Folder for ``wing_twist_vlm.png`` and the N2 diagram ``wing_twist_vlm.html``.
    drivers : dict
        Makers of drivers by name, see `optimisation.DRIVERS`.

    Returns
    -------
    dict
        For each case what `Study.numbers` tells.
    """
    wing = RectangularWing.of(paper)
    studies = {name: Study.of(wing, case, drivers) for name, case in CASES.items()}
    if figures:
        write_n2(studies["chord"].start, figures, "wing_twist_vlm")
        draw(figures, studies)
    return {name: study.numbers() for name, study in studies.items()}


@dataclass(frozen=True, eq=False)
class Study:
    """A case, solved.

    Parameters
    ----------
    title : str
        What is designed.
    start : om.Problem
        The initial wing.
    runs : dict of Run
        By the names of the drivers.
    totals : dict
        See `totals.check_totals`.
    """

    title: str
    start: om.Problem
    runs: dict[str, Run]
    totals: dict

    @classmethod
    def of(cls, wing: RectangularWing, case: Case, drivers: dict) -> Study:
        """Solve a case with every driver."""
        runs = {key: optimise(lambda: case.problem(wing), make(TOLERANCE, 100)) for key, make in drivers.items()}
        return cls(case.title, started(case.problem(wing)), runs, check_totals(perturbed(case.problem(wing))))

    @property
    def wings(self) -> dict[str, om.Problem]:
        """Problems at the start and at the optima, by name."""
        return {"initial": self.start, **{name: found.problem for name, found in self.runs.items()}}

    def numbers(self) -> dict:
        """Collect ``totals``, and what is known of the ``initial`` wing and by ``drivers``, see `efficiencies`."""
        found = {name: efficiencies(each.problem) | flow_in_one(each) for name, each in self.runs.items()}
        return {"totals": self.totals, "initial": efficiencies(self.start), "drivers": found}


def perturbed(problem: om.Problem) -> om.Problem:
    """Run a problem off the symmetry of the initial wing, where some derivatives vanish."""
    started(problem)
    for name in problem.model.get_design_vars():
        value = problem.get_val(name)
        problem.set_val(name, value + np.linspace(0.3, 0.0, value.size))
    problem.run_model()
    return problem


def wake_of(problem: om.Problem) -> Wake:
    """The wake of a wing at unit speed, the circulations twice as large: its load."""
    trailing, alpha = problem.get_val("camber_surface")[-1], problem.get_val("alpha", units="rad").item()
    heights = trailing[:, 2] * np.cos(alpha) - trailing[:, 0] * np.sin(alpha)
    return Wake(np.column_stack([trailing[:, 1], heights]), problem.get_val("span_load"))


def efficiencies(problem: om.Problem) -> dict:
    """Compare a wing with the ellipse and with Munk's optimum.

    Returns
    -------
    dict
        Span ``efficiency``; ``munk``, that of the load of least drag on the same wake; the ``gap``, by how much the
        drag is above that; and ``panel_efficiency``, from the forces on the bound vortices.
    """
    wake = wake_of(problem)
    best, elliptic = least_drag(wake.points, wake.lift), 2.0 * wake.lift**2 / (np.pi * span_of(wake) ** 2)
    panel_drag = problem.get_val("CD_panels").item() / problem.get_val("CL_panels").item() ** 2
    return {
        "efficiency": elliptic / wake.drag,
        "munk": elliptic / best.drag,
        "gap": wake.drag / best.drag - 1.0,
        "panel_efficiency": problem.get_val("S_ref").item() / (np.pi * span_of(wake) ** 2 * panel_drag),
    }


def span_of(wake: Wake) -> float:
    """Span of the whole wing (m)."""
    return -2.0 * wake.points[0, 0]


def draw(folder, studies: dict[str, Study]) -> None:
    """Draw span load, twist and planform of every case, before and after."""
    with figure(folder, "wing_twist_vlm", size=(10.0, 7.5)) as canvas:
        panels = canvas.subplots(3, len(studies), sharex=True, sharey="row")
        for study, column in zip(studies.values(), panels.T):
            for name, problem in study.wings.items():
                style = {"color": COLORS.get(name, GRAY), "label": name, "linestyle": LINES.get(name, "-")}
                draw_wing(column, problem, style)
            draw_optimum(column[0], wake_of(problem))
            column[0].set_title(study.title)
            column[2].set(xlabel="$2 y / b$", xlim=(0.0, 1.0))
        for axes, label in zip(panels[:, 0], ("load by its mean", "twist (deg)", "$x$ (m)")):
            axes.set_ylabel(label)
        panels[2, 0].invert_yaxis()
        panels[0, 0].legend(loc="lower left", fontsize=8)


def draw_wing(column, problem: om.Problem, style: dict) -> None:
    """Draw one wing."""
    nodes, wake = problem.get_val("camber_surface"), wake_of(problem)
    y = -2.0 * nodes[0, :, 1] / span_of(wake)
    (leading_x, _, leading_z), (trailing_x, _, trailing_z) = nodes[0].T, nodes[-1].T
    column[0].plot(0.5 * (y[1:] + y[:-1]), wake.circulations * span_of(wake) / wake.lift, **style)
    column[1].plot(y, np.degrees(np.arctan2(leading_z - trailing_z, trailing_x - leading_x)), **style)
    column[2].plot(y, leading_x, **style)
    column[2].plot(y, trailing_x, **style)


def draw_optimum(axes, wake: Wake) -> None:
    """Draw the load of least drag on a wake, and the ellipse."""
    middles = -(wake.points[1:, 0] + wake.points[:-1, 0]) / span_of(wake)
    best, y = least_drag(wake.points, 1.0), np.sin(np.linspace(0.0, 0.5 * np.pi, 101))
    axes.plot(middles, best.circulations * span_of(wake), "k.", markersize=4, label="Munk, same strips")
    axes.plot(y, 4.0 / np.pi * np.sqrt(1.0 - y**2), "k--", linewidth=0.7, label="ellipse")


if __name__ == "__main__":
    run(main, __doc__)
