"""Least drag of the ONERA M6 at fixed lift: sections, twist, chord and sweep, with thickness, volume and area kept."""

from __future__ import annotations

import numpy as np
import openmdao.api as om
from common import run
from flown_wing import OPTIONS, FlownWing, Scale, control_counts, size_of
from optimisation import DRIVERS
from wing_design import Size, Study

from bspline_mdao import (
    Chord,
    EnclosedVolume,
    Local,
    ProjectedArea,
    Sweep,
    Thickness,
    Twist,
    fit_grid,
    onera_m6_grid,
    onera_m6_planform,
)
from bspline_mdao.design.variable import Variable
from bspline_mdao.measures.measure import Measure

LIFT = 0.25
ALPHA = 3.0
"""Angle of attack, which is fixed: the twist of the root is free (deg)."""

THINNEST = 0.85
"""What must be left of the thickness anywhere, by that of the M6."""

WORST_CORNER = 0.05
"""What the worst cell must keep of its corner triple product of 1, by the bound of `Quality`."""

DRAG = 0.01
"""Unit of the objective."""

MACH = {"type": float, "default": 0.3, "help": "Mach number (0.3)"}
"""Option of the command line."""


SIZES = {
    "quick": Size(((7, 9, 7), (7, 7), (9, 5)), ((5, 6, 5), (5, 5), (5, 4)), 3, 1e-3),
    "default": Size(((7, 15, 7), (9, 9), (11, 5)), ((5, 8, 5), (6, 6), (6, 4)), 4, 1e-5),
    "paper": Size(((17, 33, 17), (25, 25), (25, 13)), ((7, 11, 7), (9, 9), (9, 7)), 5, 1e-4),
}
"""The tolerance is of the objective, the drag by `DRAG`."""


def make_wing(size: Size, flow: str) -> FlownWing:
    """Make and fit the grid of one of `SIZES`."""
    planform = onera_m6_planform()
    model = fit_grid(onera_m6_grid(size.shape), n_control=control_counts(size.n_control))
    return FlownWing(model, flow, Scale(planform.semi_span**2 * 2.0 / planform.aspect_ratio), n_increments=3)


def variables_of(wing: FlownWing, size: Size) -> list[Variable]:
    """From the sections outwards; the tip stays where it is along the span.

    Control points move up and down by parts of their heights, so that the two sides do not meet where the wing is thin.
    """
    quarter, trailing = wing.axis(0.25), wing.axis(1.0)
    heights = np.abs(wing.mesh.points[wing.mesh.surface_ids][wing.sides.mask(wing.mesh), 1])
    return [
        Local("heights", wing.sides, heights[:, None] * [0.0, 1.0, 0.0], units=None),
        Chord("chord", quarter, size.stations),
        Twist("twist", trailing, size.stations),
        Sweep("sweep", quarter),
    ]


def measures_of(wing: FlownWing) -> list[Measure]:
    """Thickness along lines between the edges, volume and planform area, all by those of the M6."""
    span = onera_m6_planform().semi_span * np.array([0.02, 0.9])
    leading, trailing = (np.column_stack([onera_m6_planform().x(part, span), 0.0 * span, span]) for part in (0.1, 0.9))
    return [
        Thickness.grid(wing.surface, leading, trailing, 5, 5, relative=True),
        EnclosedVolume.of(wing.surface, relative=True),
        ProjectedArea.of(wing.surface, relative=True),
    ]


def pose(wing: FlownWing, size: Size, mach: float) -> om.Problem:
    """Pose the problem. Not yet set up."""
    problem = wing.problem(variables_of(wing, size), mach, measures_of(wing))
    model = problem.model
    model.set_input_defaults("alpha", val=ALPHA, units="deg")
    model.add_design_var("heights", lower=-0.4, upper=0.4, ref=0.2)
    model.add_design_var("chord", lower=0.5, upper=1.5, ref=0.2)
    model.add_design_var("twist", lower=-10.0, upper=10.0, ref=3.0, units="deg")
    model.add_design_var("sweep", lower=-10.0, upper=10.0, ref=5.0, units="deg")
    model.add_constraint("CL", equals=LIFT, ref=LIFT)
    model.add_constraint("thickness", lower=THINNEST)
    model.add_constraint("volume", lower=1.0)
    model.add_constraint("projected_area", equals=1.0)
    model.add_constraint("corner_ks", lower=WORST_CORNER)
    model.add_objective("drag", ref=DRAG)
    return problem


def main(
    paper: bool = False,
    figures=None,
    flow: str = "euler",
    quick: bool = False,
    mach: float = MACH["default"],
    drivers=DRIVERS,
) -> dict:
    """Find the wing with every driver.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`.
    figures : path-like, optional
        Folder for ``m6_lift_constrained.png``, the N2 diagram ``m6_lift_constrained.html`` and the recorded cases.
    flow : str
        ``"euler"`` or ``"vortex"``.
    mach : float
        Mach number.
    drivers : dict
        Makers of drivers by name, see `optimisation.DRIVERS`.

    Returns
    -------
    dict
        What `Study.numbers` tells.
    """
    size = size_of(SIZES, paper, quick)
    wing = make_wing(size, flow)
    name = "m6_lift_constrained"
    study = Study.of(name, wing, lambda: pose(wing, size, mach), drivers, size.tolerance, figures)
    if figures:
        study.draw(figures)
    return study.numbers()


if __name__ == "__main__":
    run(main, __doc__, **OPTIONS, mach=MACH)
