"""Flow with shocks: the section NACA 0012 at 1.25 degrees, subcritical at Mach 0.5 and transonic at Mach 0.8."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import openmdao.api as om
from common import BLUE, GRAY, RED, figure, run
from euler_runs import OPTIONS, Condition, flow_problem, nodes_of, run_euler, seconds_of, solution_of, wall_quads
from flown_wing import size_of

from bspline_mdao import FarField, FittedModel, Spacing, fit_grid, infinite_wing_grid, naca_section
from bspline_mdao.flow.euler.discretization import SHOCK_THRESHOLD
from bspline_mdao.flow.euler.gas import GAMMA

ALPHA = 1.25
"""Angle of attack (deg)."""


class Case(NamedTuple):
    """Mach number, lift coefficient in the literature, and colour."""

    mach: float
    lift: float
    color: str


CASES = {"subcritical": Case(0.5, 0.1798, BLUE), "transonic": Case(0.8, 0.348, RED)}
"""No friction; whether the trailing edge is blunt or closed alone moves these lifts by 4 %."""

SIZES = {"quick": 24, "default": 48, "paper": 96}
"""Cells along each side of the section."""


def main(paper: bool = False, figures=None, quick: bool = False, iprint: int = 0) -> dict:
    """Solve both flows, and differentiate the lift in angle and Mach number.

    Parameters
    ----------
    paper, quick : bool
        96 cells along each side of the section, or 24, not 48: 34,560 in all, or 2,160, not 8,640.
    figures : path-like, optional
        Folder for ``transonic_naca0012.png``.
    iprint : int
        1 for a line a flow, 2 for one a Newton step.

    Returns
    -------
    dict
        For ``subcritical`` and ``transonic``: what `euler_runs.run_euler` tells, ``CL_literature``, the derivatives
        ``CL_alpha`` (1/deg) and ``CL_Mach`` by the adjoint, and ``adjoint_seconds``.
    """
    model = section_model(size_of(SIZES, paper, quick))
    problems = {name: problem_of(model, case.mach, iprint) for name, case in CASES.items()}
    numbers = {name: fly(problem) | {"CL_literature": CASES[name].lift} for name, problem in problems.items()}
    if figures:
        draw(figures, model, problems)
    return numbers


def section_model(n_side: int) -> FittedModel:
    """Fit the grid about the section, with these cells along each side of it."""
    coarseness, n_away = 32.0 / n_side, 3 * n_side // 4 + 1
    spacing = Spacing(off_wall=6e-3 * coarseness, leading=8e-3 * coarseness, trailing=8e-3 * coarseness)
    shape = (n_away, n_side + 1, n_away), n_away
    return fit_grid(infinite_wing_grid(naca_section(0.12), shape, spacing, FarField(distance=50.0)))


def problem_of(model: FittedModel, mach: float, iprint: int) -> om.Problem:
    """Pose a flow."""
    return flow_problem(model, Condition(mach, ALPHA, area=1.0), shock_threshold=SHOCK_THRESHOLD, iprint=iprint)


def fly(problem: om.Problem) -> dict:
    """Run a flow and differentiate it; of a section there is no induced drag."""
    told = run_euler(problem)
    del told["CD_induced"]
    totals = {}
    told["adjoint_seconds"] = seconds_of(
        lambda: totals.update(problem.compute_totals(["CL"], ["alpha", "Mach_number"]))
    )
    slopes = {name: totals["CL", of].item() for name, of in (("CL_alpha", "alpha"), ("CL_Mach", "Mach_number"))}
    return told | slopes


def draw(folder, model: FittedModel, problems: dict[str, om.Problem]) -> None:
    """Draw pressures on the section, Mach numbers about it, and the histories."""
    with figure(folder, "transonic_naca0012", size=(11.0, 3.6)) as canvas:
        pressures, field, history = canvas.subplots(1, 3, width_ratios=(1.0, 1.25, 0.9))
        for name, problem in problems.items():
            draw_pressures(pressures, model, problem, CASES[name])
            steps = solution_of(problem).history
            history.semilogy([step.residual for step in steps], ".-", color=CASES[name].color)
        pressures.legend(fontsize=9)
        history.set(xlabel="Newton steps", ylabel="residual by that of the uniform stream")
        canvas.colorbar(draw_mach_numbers(field, model, problems["transonic"]), ax=field, label="Mach number")


def draw_pressures(axes, model: FittedModel, problem: om.Problem, case: Case) -> None:
    """Draw pressure coefficients along both sides; faces run along each side."""
    middles = nodes_of(problem)[wall_quads(model)].mean(axis=1)
    sides = np.stack([middles[:, 0], problem.get_val("Cp")]).reshape(2, 2, -1)
    for side, label in zip(sides.swapaxes(0, 1), (f"M {case.mach:g}", None)):
        axes.plot(*side, ".-", color=case.color, markersize=3, linewidth=0.8, label=label)
    axes.set(xlabel="$x$, chords", ylabel="$C_p$")
    if not axes.yaxis_inverted():
        axes.invert_yaxis()


def draw_mach_numbers(axes, model: FittedModel, problem: om.Problem):
    """Paint the cells about the section by the Mach number, block by block; returns what has the colours."""
    rho, u, v, w, p = solution_of(problem).states.T
    speeds = np.sqrt((u**2 + v**2 + w**2) * rho / (GAMMA * p))
    grid, start = model.regenerate(), 0
    for block in grid.blocks:
        x, y = block.nodes[:, :, 0, :2].transpose(2, 0, 1)
        part = speeds[start : start + (x.shape[0] - 1) * (x.shape[1] - 1)].reshape(x.shape[0] - 1, -1)
        mesh = axes.pcolormesh(x, y, part, cmap="RdBu_r", vmin=0.6, vmax=1.4, rasterized=True)
        middle_x, middle_y = (0.25 * (z[1:, 1:] + z[1:, :-1] + z[:-1, 1:] + z[:-1, :-1]) for z in (x, y))
        axes.contour(middle_x, middle_y, part, [1.0], colors=GRAY, linewidths=0.6)
        start += part.size
    axes.set(xlim=(-0.5, 1.5), ylim=(-0.8, 1.2), aspect="equal", xlabel="$x$, chords", ylabel="$y$, chords")
    return mesh


if __name__ == "__main__":
    run(main, __doc__, quick=OPTIONS["quick"], iprint=OPTIONS["iprint"])
