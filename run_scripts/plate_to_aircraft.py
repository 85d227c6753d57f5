"""From a flat plate to an efficient wing without remeshing: span, sweep, chord, twist and sections.

The plate of section IV.B has no thickness. The wing that is made of it holds a volume, and lifts as much as the plate
would at the lift coefficient, with the planform area of the plate.
"""

from __future__ import annotations

import openmdao.api as om
from common import run
from flown_wing import OPTIONS, FlownWing, Scale, control_counts, size_of
from optimisation import DRIVERS
from wing_design import Size, Study

from bspline_mdao import (
    Chord,
    EnclosedVolume,
    Local,
    OnPatch,
    ProjectedArea,
    Span,
    Sweep,
    Twist,
    fit_grid,
    flat_plate_grid,
)
from bspline_mdao.design.variable import Variable

MACH = 0.3
LIFT = 0.3
ALPHA = 3.0
"""Angle of attack, which is fixed: the twist of the root is free (deg)."""

AREA = 2.0
"""Of the half plate (m^2)."""

VOLUME = 0.08
"""Of the half wing (m^3): that of 7 % thick sections on the planform of the plate."""

WIDEST = 1.5
"""Largest factor on the span: with a given lift the induced drag falls as the span grows, and nothing weighs here."""

WORST_CORNER = 0.05
"""What the worst cell must keep of its corner triple product of 1, by the bound of `Quality`."""

DRAG = 0.01
"""Unit of the objective."""

SIZES = {
    "quick": Size(((7, 9, 7), (7, 7), (9, 5)), ((5, 6, 5), (5, 5), (5, 4)), 3, 1e-3),
    "default": Size(((7, 15, 7), (9, 9), (11, 5)), ((5, 8, 5), (6, 6), (6, 4)), 4, 1e-4),
    "paper": Size(((17, 33, 17), (25, 25), (25, 13)), ((7, 11, 7), (9, 9), (9, 7)), 5, 1e-4),
}
"""The tolerance is of the objective, the drag by `DRAG`."""


def make_wing(size: Size, flow: str) -> FlownWing:
    """Make and fit the grid of one of `SIZES`."""
    model = fit_grid(flat_plate_grid(size.shape), n_control=control_counts(size.n_control))
    return FlownWing(model, flow, Scale(AREA), n_increments=3)


def variables_of(wing: FlownWing, size: Size) -> list[Variable]:
    """From the sections outwards."""
    quarter = wing.axis(0.25)
    upper, lower = (OnPatch(wing.model, f"wing_{side}") for side in ("upper", "lower"))
    return [
        Local("upper_heights", upper & ~lower, "y"),
        Local("lower_heights", lower & ~upper, "y"),
        Chord("chord", quarter, size.stations),
        Twist("twist", wing.axis(1.0), size.stations),
        Span("span", quarter),
        Sweep("sweep", quarter),
    ]


def pose(wing: FlownWing, size: Size) -> om.Problem:
    """Pose the problem. Not yet set up."""
    measures = [EnclosedVolume.of(wing.surface), ProjectedArea.of(wing.surface, relative=True)]
    problem = wing.problem(variables_of(wing, size), MACH, measures)
    model = problem.model
    model.set_input_defaults("alpha", val=ALPHA, units="deg")
    model.add_design_var("upper_heights", lower=0.0, upper=0.06, ref=0.02, units="m")
    model.add_design_var("lower_heights", lower=-0.06, upper=0.0, ref=0.02, units="m")
    model.add_design_var("chord", lower=0.4, upper=1.5, ref=0.2)
    model.add_design_var("twist", lower=-5.0, upper=5.0, ref=3.0, units="deg")
    model.add_design_var("span", lower=0.7, upper=WIDEST, ref=0.2)
    model.add_design_var("sweep", lower=-10.0, upper=30.0, ref=10.0, units="deg")
    model.add_constraint("CL", equals=LIFT, ref=LIFT)
    model.add_constraint("volume", lower=VOLUME, ref=VOLUME, units="m**3")
    model.add_constraint("projected_area", equals=1.0)
    model.add_constraint("corner_ks", lower=WORST_CORNER)
    model.add_objective("drag", ref=DRAG)
    return problem


def main(paper: bool = False, figures=None, flow: str = "euler", quick: bool = False, drivers=DRIVERS) -> dict:
    """Find the wing with every driver.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`.
    figures : path-like, optional
        Folder for ``plate_to_aircraft.png``, the N2 diagram ``plate_to_aircraft.html`` and the recorded cases.
    flow : str
        ``"euler"`` or ``"vortex"``.
    drivers : dict
        Makers of drivers by name, see `optimisation.DRIVERS`.

    Returns
    -------
    dict
        What `Study.numbers` tells.
    """
    size = size_of(SIZES, paper, quick)
    wing = make_wing(size, flow)
    study = Study.of("plate_to_aircraft", wing, lambda: pose(wing, size), drivers, size.tolerance, figures)
    if figures:
        study.draw(figures)
    return study.numbers()


if __name__ == "__main__":
    run(main, __doc__, **OPTIONS)
