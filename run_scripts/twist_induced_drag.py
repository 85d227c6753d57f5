"""Twist of least induced drag of a rectangular wing of aspect ratio 6: case 3 of the ADODG.

The wing has NACA 0012 sections and a semi-span of 3 chords, and flies at M 0.5 and a lift coefficient of 0.375. An
elliptical load has an induced drag of 0.00746.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import openmdao.api as om
from common import GRAY, figure, run
from flown_wing import OPTIONS, FlownWing, Scale, control_counts, optimise_with, size_of
from history import COLORS, draw_course, draw_objective
from optimisation import DRIVERS, flow_in_one, set_up, write_n2
from totals import check_totals, move_at_random
from wing_drawings import draw_ellipse, draw_load, draw_twist

from bspline_mdao import Planform, Spacing, Twist, Wing, fit_grid, hh_wing_grid, naca_section
from bspline_mdao.names import GRID

WING = Wing(Planform(root_chord=1.0, semi_span=3.0), naca_section(0.12))
"""The wing: `rectangular_wing`, in chords of its own and with a semi-span of 3 of them exactly."""

MACH = 0.5
LIFT = 0.375
IDEAL = LIFT**2 / (np.pi * WING.planform.aspect_ratio)
"""Induced drag of an elliptical load."""

WORST_CORNER = 0.05
"""What the worst cell must keep of its corner triple product of 1, by the bound of `Quality`."""


@dataclass(frozen=True)
class Size:
    """Nodes and control points of the rows of blocks and intervals, see `hh_wing_grid`; stations, and a tolerance.

    The tolerance is that of the objective, the drag by the ideal one.
    """

    shape: tuple
    n_control: tuple
    spacing: Spacing
    stations: int
    tolerance: float


SIZES = {
    "quick": Size(
        ((7, 9, 7), (7, 7), (9, 7)), ((5, 6, 5), (5, 5), (6, 5)), Spacing(0.03, 0.05, 0.05, 0.08, root=0.5), 4, 1e-7
    ),
    "default": Size(
        ((9, 13, 9), (9, 9), (17, 9)), ((6, 7, 6), (5, 5), (9, 6)), Spacing(0.03, 0.03, 0.03, 0.08, root=0.25), 6, 1e-7
    ),
    "paper": Size(
        ((17, 33, 17), (25, 25), (33, 17)), ((7, 11, 7), (9, 9), (13, 7)), Spacing(0.01, 0.01, 0.01, 0.02), 8, 1e-8
    ),
}


def make_wing(size: Size, flow: str) -> FlownWing:
    """Make and fit the grid of one of `SIZES`."""
    planform = WING.planform
    grid = hh_wing_grid(WING, size.shape, size.spacing)
    model = fit_grid(grid, n_control=control_counts(size.n_control))
    scale = Scale(planform.root_chord * planform.semi_span)
    return FlownWing(model, flow, scale, n_increments=3)


def pose(wing: FlownWing, size: Size) -> om.Problem:
    """Pose the problem: angle of attack, and twist outboard of the root. Not yet set up.

    The wing is twisted about its trailing edge, so that the trace of the wake stays straight.
    """
    problem = wing.problem([Twist("twist", wing.axis(at=1.0), size.stations)], MACH)
    model = problem.model
    model.set_input_defaults("alpha", val=4.0, units="deg")
    model.add_design_var("alpha", lower=0.0, upper=10.0, ref=3.0, units="deg")
    model.add_design_var("twist", indices=range(1, size.stations), lower=-10.0, upper=10.0, ref=3.0, units="deg")
    model.add_constraint("CL", equals=LIFT, ref=LIFT)
    model.add_constraint("corner_ks", lower=WORST_CORNER)
    model.add_objective("CD_induced", ref=IDEAL)
    return problem


def main(paper: bool = False, figures=None, flow: str = "euler", quick: bool = False, drivers=DRIVERS) -> dict:
    """Find the twist with every driver.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`.
    figures : path-like, optional
        Folder for ``twist_induced_drag.png``, the N2 diagram ``twist_induced_drag.html`` and the recorded cases.
    flow : str
        ``"euler"`` or ``"vortex"``.
    drivers : dict
        Makers of drivers by name, see `optimisation.DRIVERS`.

    Returns
    -------
    dict
        ``totals``, see `totals.check_totals`; `aerodynamics` of the ``initial`` wing; for each driver the same,
        ``twist`` and what `optimisation.Run.numbers` tells.
    """
    size = size_of(SIZES, paper, quick)
    wing = make_wing(size, flow)
    start = set_up(pose(wing, size))
    runs = optimise_with(drivers, lambda: pose(wing, size), size.tolerance, 50, figures, "twist_induced_drag")
    if figures:
        write_n2(start, figures, "twist_induced_drag")
        draw(figures, wing, start, runs)
    found = {name: flow_in_one(each) | aerodynamics(each.problem) for name, each in runs.items()}
    return {
        "n_nodes": wing.model.n_nodes,
        "initial": aerodynamics(start),
        "drivers": found,
        "totals": check_totals(move_at_random(start), n_directions=1, step=0.05, levels=2),
    }


def aerodynamics(problem: om.Problem) -> dict:
    """Lift, induced drag, by how much it is above that of an ellipse of the same lift, angle of attack and twist."""
    lift, drag = (problem.get_val(name).item() for name in ("CL", "CD_induced"))
    return {
        "CL": lift,
        "CD_induced": drag,
        "above_ideal": drag / (IDEAL * (lift / LIFT) ** 2) - 1.0,
        "alpha": problem.get_val("alpha", units="deg").item(),
        "twist": problem.get_val("twist", units="deg").copy(),
    }


def draw(folder, wing: FlownWing, start: om.Problem, runs: dict) -> None:
    """Draw load and twist of the initial wing and of the optima, and the histories."""
    with figure(folder, "twist_induced_drag", (9.5, 6.5)) as canvas:
        (load, twist), (drag, course) = canvas.subplots(2, 2)
        for name, problem in {"initial": start, **{name: found.problem for name, found in runs.items()}}.items():
            style = {"color": COLORS.get(name, GRAY), "label": name}
            draw_load(load, wing.strip_edges(problem), problem.get_val("span_load"), style)
            draw_twist(twist, wing.model, problem.get_val(GRID), style)
        draw_ellipse(load)
        draw_objective(drag, runs, "CD_induced", IDEAL, "induced drag by that of the ellipse")
        draw_course(course, runs)


if __name__ == "__main__":
    run(main, __doc__, **OPTIONS)
