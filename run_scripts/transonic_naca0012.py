"""Transonic flow about the NACA 0012.

Flow with shocks: the section NACA 0012 at 1.25 degrees, subcritical at Mach 0.5 and transonic at Mach 0.8. It takes
half a minute, with ``--quick`` some seconds, and some minutes at the paper's size. The output is lift and drag next to
the literature's, how both flows converged, the derivatives of the lift by the adjoint, and a picture of the pressures,
the Mach numbers and the histories.
"""

from __future__ import annotations

import time

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.flow import run_flow
from bspline_mdao.names import GRID
from bspline_mdao.plotting import BLUE, GRAY, RED, figure, wall_quads
from bspline_mdao.scripts import pick_size, run

GAMMA = 1.4
"""Ratio of specific heats."""

ALPHA = 1.25
"""Angle of attack (deg)."""

CASES = {"subcritical": (0.5, 0.1798, BLUE), "transonic": (0.8, 0.348, RED)}
"""Mach number, lift coefficient in the literature, and colour.

No friction: limits of CFL3D in J. C. Vassberg and A. Jameson, J. Aircraft 47 (2010), 1152-1166; the page on validation
says how accurate they are. Whether the trailing edge is blunt or closed alone moves these lifts by 4 %.
"""

SIZES = {"quick": 24, "default": 48, "paper": 96}
"""Cells along each side of the section."""


def main(paper: bool = False, figures=None, quick: bool = False, iprint: int = 0) -> dict:
    """Solve both flows, and differentiate the lift with respect to angle and Mach number.

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
        For ``subcritical`` and ``transonic``: what `run_flow` returns, ``CL_literature``, the derivatives ``CL_alpha``
        (1/deg) and ``CL_Mach`` by the adjoint, and ``adjoint_seconds``.
    """
    model = section_model(pick_size(SIZES, paper, quick))
    numbers, problems = {}, {}
    for name, (mach, lift, _) in CASES.items():
        problems[name] = problem = problem_of(model, mach, iprint)
        numbers[name] = run_flow(problem) | {"CL_literature": lift}
        start = time.perf_counter()
        totals = problem.compute_totals(["CL"], ["alpha", "Mach_number"])
        numbers[name]["adjoint_seconds"] = time.perf_counter() - start
        numbers[name] |= {"CL_alpha": totals["CL", "alpha"].item(), "CL_Mach": totals["CL", "Mach_number"].item()}
    if figures:
        draw(figures, model, problems)
    return numbers


def section_model(n_side: int) -> bm.FittedModel:
    """Fit the grid about the section, with these cells along each side of it."""
    n_away, coarseness = 3 * n_side // 4 + 1, 32.0 / n_side
    spacing = bm.generators.Spacing(off_wall=6e-3 * coarseness, leading=8e-3 * coarseness, trailing=8e-3 * coarseness)
    shape, far = ((n_away, n_side + 1, n_away), n_away), bm.generators.FarField(distance=50.0)
    return bm.fit_grid(bm.generators.infinite_wing_grid(bm.generators.naca_section(0.12), shape, spacing, far))


def problem_of(model: bm.FittedModel, mach: float, iprint: int) -> om.Problem:
    """Pose a flow about the section."""
    flow = bm.EulerFlow(model=model, reference_area=1.0, iprint=iprint)
    problem = om.Problem(flow, reports=None)
    problem.setup(mode="rev")
    problem.set_val("Mach_number", mach)
    problem.set_val("alpha", ALPHA, units="deg")
    return problem


def draw(folder, model: bm.FittedModel, problems: dict[str, om.Problem]) -> None:
    """Draw pressures on both sides of the section, along which faces run, Mach numbers about it, and the histories."""
    with figure(folder, "transonic_naca0012", size=(11.0, 3.6)) as canvas:
        pressures, field, history = canvas.subplots(1, 3, width_ratios=(1.0, 1.25, 0.9))
        for name, problem in problems.items():
            mach, _, color = CASES[name]
            middles = problem.get_val(GRID).reshape(-1, 3)[wall_quads(model)].mean(axis=1)
            sides = np.stack([middles[:, 0], problem.get_val("Cp")]).reshape(2, 2, -1)
            for side, label in zip(sides.swapaxes(0, 1), (f"M {mach:g}", None)):
                pressures.plot(*side, ".-", color=color, markersize=3, linewidth=0.8, label=label)
            history.semilogy([step.residual for step in problem.model.state.solution.history], ".-", color=color)
        pressures.set(xlabel="$x / c$", ylabel="$C_p$")
        pressures.invert_yaxis()
        pressures.legend(fontsize=9)
        history.set(xlabel="Newton steps", ylabel="residual relative to the uniform stream's")
        mesh = draw_mach_numbers(field, model, problems["transonic"].model.state.solution.states)
        canvas.colorbar(mesh, ax=field, label="Mach number")


def draw_mach_numbers(axes, model: bm.FittedModel, states: np.ndarray):
    """Paint the cells about the section by the Mach number, block by block; returns what has the colours."""
    rho, u, v, w, p = states.T
    speeds, start = np.sqrt((u**2 + v**2 + w**2) * rho / (GAMMA * p)), 0
    for block in model.regenerate().blocks:
        x, y = block.nodes[:, :, 0, :2].transpose(2, 0, 1)
        part = speeds[start : start + (x.shape[0] - 1) * (x.shape[1] - 1)].reshape(x.shape[0] - 1, -1)
        mesh = axes.pcolormesh(x, y, part, cmap="RdBu_r", vmin=0.6, vmax=1.4, rasterized=True)
        middles = (0.25 * (z[1:, 1:] + z[1:, :-1] + z[:-1, 1:] + z[:-1, :-1]) for z in (x, y))
        axes.contour(*middles, part, [1.0], colors=GRAY, linewidths=0.6)
        start += part.size
    axes.set(xlim=(-0.5, 1.5), ylim=(-0.8, 1.2), aspect="equal", xlabel="$x / c$", ylabel="$y / c$")
    return mesh


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/thumbnails/transonic_naca0012.png'
