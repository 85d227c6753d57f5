"""Twist and planform of least induced drag at fixed lift: the regenerated wing in OpenAeroStruct's vortex lattice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import openmdao.api as om
from common import GRAY, figure, run
from optimisation import COLORS, DRIVERS, check_totals, optimise, write_n2

from bspline_mdao import (
    CamberSurface,
    FittedModel,
    GridMovement,
    LinearElasticity,
    VortexLattice,
    fit_grid,
    moving_mesh,
)
from bspline_mdao.flow.wake import Wake, least_drag
from bspline_mdao.generators import rectangular_wing
from bspline_mdao.generators.hh_wing import Spacing, hh_wing_grid
from bspline_mdao.geometry.surface import SurfaceGrid
from bspline_mdao.movement.mesh import MovingMesh
from bspline_mdao.parametrization.axis import ReferenceAxis
from bspline_mdao.parametrization.composition import Parametrization
from bspline_mdao.parametrization.planform import Chord, Sweep, Taper, Twist

LIFT = 0.5
"""Lift coefficient, of the area of the rectangular wing."""

ALPHA = 4.0
"""Angle of attack where it is fixed (deg)."""

WORST_CORNER = 0.25
"""What the worst cell must keep of its corner triple product of 1, by the bound of `Quality`."""

MACH = 0.3
"""Of the flight."""

TOLERANCE, MAX_ITERATIONS = 1e-11, 100
"""Of the objective, the drag by the least one of a flat wake; and iterations."""


@dataclass(frozen=True)
class Size:
    """Nodes and control points of the grid, and nodes of the lattice."""

    shape: tuple[int, int, int]
    n_control: tuple[int, int, int]
    n_chord: int
    n_span: int
    stations: int


SIZES = {
    False: Size((11, 9, 13), (7, 6, 8), n_chord=3, n_span=11, stations=6),
    True: Size((45, 65, 33), (13, 13, 9), n_chord=5, n_span=31, stations=8),
}
"""Small and at the paper's size of the M6 grid."""


@dataclass(frozen=True, eq=False)
class RectangularWing:
    """The fitted grid about the paper's rectangular wing, and what the optimisations share.

    Parameters
    ----------
    model : FittedModel
        The fitted grid.
    size : Size
        Its size and the lattice's.
    """

    model: FittedModel
    size: Size

    @classmethod
    def of(cls, paper: bool) -> RectangularWing:
        """Make and fit the grid."""
        size = SIZES[paper]
        spacing = Spacing() if paper else Spacing(0.01, 0.02, 0.02, 0.02)
        return cls(fit_grid(hh_wing_grid(rectangular_wing(), size.shape, spacing), n_control=size.n_control), size)

    @cached_property
    def mesh(self) -> MovingMesh:
        """Its control mesh."""
        return moving_mesh(self.model)

    @cached_property
    def lattice(self) -> CamberSurface:
        """The lattice: equal strips, for which the discrete optimum is known in closed form."""
        return CamberSurface.of(SurfaceGrid.of(self.model, "wing*"), self.size.n_chord, self.size.n_span)

    @cached_property
    def trailing_edge(self) -> ReferenceAxis:
        """Axis that variables work about, so that they leave the trace of the wake alone."""
        return ReferenceAxis.of(self.mesh, at=1.0)

    @cached_property
    def area(self) -> float:
        """Area of the whole wing (m^2)."""
        planform = rectangular_wing().planform
        return 2.0 * planform.root_chord * planform.semi_span

    @property
    def least_drag(self) -> float:
        """Munk's least drag coefficient of a flat wake of equal strips."""
        return LIFT**2 / (np.pi * rectangular_wing().planform.aspect_ratio * (1.0 + 0.5 / (self.size.n_span - 1)))

    def problem(self, case: Case) -> om.Problem:
        """Wire a case: variables, surface, grid and flow. Not yet set up."""
        problem = om.Problem(reports=None)
        parametrization = Parametrization(self.mesh, case.variables(self.trailing_edge, self.size.stations))
        geometry = GridMovement(
            model=self.model,
            parametrization=parametrization,
            measures=[self.lattice],
            mover=LinearElasticity(self.mesh, n_increments=2),
            fit=False,
        )
        sizes = {"n_chord": self.size.n_chord, "n_span": self.size.n_span}
        problem.model.add_subsystem("geometry", geometry, promotes=["*"])
        problem.model.add_subsystem("flow", VortexLattice(reference_area=self.area, **sizes), promotes=["*"])
        for name, (value, units) in {"Mach_number": (MACH, None), "alpha": (ALPHA, "deg"), **case.fixed}.items():
            problem.model.set_input_defaults(name, val=value, units=units)
        case.design(problem.model, self)
        problem.model.add_constraint("CL", equals=LIFT)
        problem.model.add_constraint("corner_ks", lower=WORST_CORNER)
        problem.model.add_objective("CD", ref=self.least_drag)
        return problem


def design_twist(model: om.Group, wing: RectangularWing) -> None:
    """Leave the twist at all stations free."""
    model.add_design_var("twist", lower=-10.0, upper=10.0, ref=5.0, units="deg")


def design_chord(model: om.Group, wing: RectangularWing) -> None:
    """Leave the chord at all stations and the angle of attack free; the area stays."""
    model.add_design_var("chord", lower=0.2, upper=2.0)
    model.add_design_var("alpha", lower=-10.0, upper=10.0, ref=5.0, units="deg")
    model.add_constraint("S_mesh", equals=wing.area, ref=wing.area, units="m**2")


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
    variables: Callable[[ReferenceAxis, int], list]
    design: Callable[[om.Group, RectangularWing], None]
    fixed: dict


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
        For each case ``totals``, see `optimisation.check_totals`; for its ``initial`` wing the span ``efficiency`` and
        that of the load of least drag on the same wake, ``munk``; for each driver both, their relative ``gap``, that of
        the panel forces, ``panel_efficiency``, and what `optimisation.Run.numbers` tells.
    """
    wing = RectangularWing.of(paper)
    numbers, problems = {}, {}
    for name, case in CASES.items():
        start = started(wing.problem(case))
        runs = {
            key: optimise(lambda case=case: wing.problem(case), make(TOLERANCE, MAX_ITERATIONS))
            for key, make in drivers.items()
        }
        problems[name] = {"initial": start, **{key: each.problem for key, each in runs.items()}}
        numbers[name] = {
            "initial": efficiencies(start),
            "totals": check_totals(perturbed(wing.problem(case))),
            **{key: {**efficiencies(each.problem), **each.numbers()} for key, each in runs.items()},
        }
        for key, each in runs.items():
            numbers[name][key]["shares"] = merge_flow(each.problem, numbers[name][key]["shares"])
    if figures:
        write_n2(problems["chord"]["initial"], figures, "wing_twist_vlm")
        draw(figures, problems)
    return numbers


def started(problem: om.Problem) -> om.Problem:
    """Run a problem where it starts."""
    problem.setup(mode="rev")
    problem.run_model()
    return problem


def perturbed(problem: om.Problem) -> om.Problem:
    """Run a problem off the symmetry of the initial wing, where some derivatives vanish."""
    started(problem)
    for name in problem.model.get_design_vars():
        value = problem.get_val(name)
        problem.set_val(name, value + np.linspace(0.3, 0.0, value.size))
    problem.run_model()
    return problem


def merge_flow(problem: om.Problem, shares: dict[str, float]) -> dict[str, float]:
    """Add up the shares of the vortex lattice's components."""
    flow = {system.name for system in problem.model.flow.system_iter(recurse=True)}
    merged = {name: share for name, share in shares.items() if name not in flow}
    return {**merged, "flow": sum(share for name, share in shares.items() if name in flow)}


def wake_of(problem: om.Problem) -> Wake:
    """The wake of a wing."""
    trailing, alpha = problem.get_val("camber_surface")[-1], problem.get_val("alpha", units="rad").item()
    heights = trailing[:, 2] * np.cos(alpha) - trailing[:, 0] * np.sin(alpha)
    return Wake(np.column_stack([trailing[:, 1], heights]), problem.get_val("span_load"))


def efficiencies(problem: om.Problem) -> dict:
    """Span efficiency of a wing, and the largest one possible on its wake."""
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


def draw(folder, problems: dict[str, dict[str, om.Problem]]) -> None:
    """Draw span load, twist and planform of every case, before and after."""
    with figure(folder, "wing_twist_vlm", size=(10.0, 7.5)) as canvas:
        for (name, found), column in zip(problems.items(), canvas.subplots(3, len(problems), sharex=True).T):
            column[0].set_title(CASES[name].title)
            for key, problem in found.items():
                style = {"color": COLORS.get(key, GRAY), "label": key, "linestyle": "-" if key in COLORS else ":"}
                draw_wing(column, problem, style)
            draw_optimum(column[0], wake_of(problem))
            column[1].set(ylim=(-6.0, 6.0))
            column[2].set(xlabel="$2 y / b$", ylim=(1.4, -0.1), xlim=(0.0, 1.0))
        for axes, label in zip(canvas.axes[:: len(problems)], ("span load (m)", "twist (deg)", "$x$ (m)")):
            axes.set_ylabel(label)
        canvas.axes[0].legend(loc="lower left", fontsize=8)


def draw_wing(column, problem: om.Problem, style: dict) -> None:
    """Draw one wing."""
    nodes, wake = problem.get_val("camber_surface"), wake_of(problem)
    y = -2.0 * nodes[0, :, 1] / span_of(wake)
    (leading_x, _, leading_z), (trailing_x, _, trailing_z) = nodes[0].T, nodes[-1].T
    column[0].plot(0.5 * (y[1:] + y[:-1]), wake.circulations, **style)
    column[1].plot(y, np.degrees(np.arctan2(leading_z - trailing_z, trailing_x - leading_x)), **style)
    column[2].plot(y, leading_x, **style)
    column[2].plot(y, trailing_x, **style)


def draw_optimum(axes, wake: Wake) -> None:
    """Draw the load of least drag on a wake, and the ellipse."""
    middles = -(wake.points[1:, 0] + wake.points[:-1, 0]) / span_of(wake)
    y = np.sin(np.linspace(0.0, 0.5 * np.pi, 101))
    axes.plot(middles, least_drag(wake.points, wake.lift).circulations, "k.", markersize=4, label="Munk, same strips")
    axes.plot(y, 4.0 * wake.lift / (np.pi * span_of(wake)) * np.sqrt(1.0 - y**2), "k--", linewidth=0.7, label="ellipse")


if __name__ == "__main__":
    run(main, __doc__)
