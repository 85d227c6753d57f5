"""Adapt a grid to the drag.

Adapt the grid of a section to its drag, by interior control points and the adjoint's estimate of the error. It takes a
minute or two, with ``--quick`` some seconds, and with ``--paper``, some five minutes; this also adapts an H-H grid
about the section and a grid of the ONERA M6 to lift and drag. The output is lift and drag on O-grids about NACA 0012
and on the adapted one, at the conditions that it was adapted to and at others, their errors relative to exact values,
and a picture of the cells with their contributions to the error.
"""

from __future__ import annotations

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, ORANGE, figure
from bspline_mdao.scripts import pick_size, run

MACH, ALPHA = 0.5, 1.25
"""Mach number and angle (deg) of the flow that the grid is adapted to: without shocks, so that the drag is zero."""

LIFT = 0.17875
"""Of the section there, by the equation of the full potential, spectrally in the plane of its circle."""

OTHERS = ((0.5, 2.5), (0.3, 1.25))
"""Mach numbers and angles (deg) that the grid is not adapted to."""

SIZES = {"quick": (16, 32, 64), "default": (32, 64, 128), "paper": (32, 64, 128)}
"""Cells around the section of the family; the grid in the middle is adapted."""

EFFORT = {"quick": (2, 6), "default": (4, 8), "paper": (4, 8)}
"""Rounds, and iterations in each."""

HH, HH_SPACING, HH_FAR = ((25, 33, 25), 25), (6e-3, 8e-3, 8e-3), 50.0
"""Nodes of the rows of blocks of the H-H grid, heights off the wall, at the nose and at the edge, and the distance of
the far field, in chords."""

M6, M6_POINTS, M6_ALPHA = ((9, 17, 9), (13, 13), (13, 7)), (7, 7, 7), 3.06
"""Nodes of the rows of blocks of a grid of 13,824 cells about the M6, control points of each block, and the angle
(deg)."""

M6_LIMITS = {"CD": 0.0042, "CL": 0.2158}
"""Drag and lift of the M6 that members of up to 373,248 cells tend to."""

M6_OTHERS = ((0.5, 2.0), (0.3, 3.06))
"""Mach numbers and angles (deg) that its grid is not adapted to."""


def main(paper: bool = False, figures=None, quick: bool = False) -> dict:
    """Adapt the grid in the middle of a family.

    Parameters
    ----------
    paper, quick : bool
        Another of the sizes; with ``paper`` the H-H grid and the M6 as well.
    figures : path-like, optional
        Folder for ``adapt_grid.png``.

    Returns
    -------
    dict
        ``members``, for each grid of the family its ``n_cells``, ``CL`` and ``CD``; ``adapted``, the same of the one
        that was adapted; ``estimate`` and ``bound`` of the drag before and after; ``others``, drags before and after at
        other conditions; ``flows`` that were solved; ``drag_ratio`` and ``lift_ratio``, errors after by those
        before. With ``paper``, ``H-H`` and ``M6``: drag, lift, estimate and bound before and after, ``others`` on the
        given, the adapted and the finer grid, and the ratios of the errors, each against its limit.
    """
    sizes, (rounds, iterations) = pick_size(SIZES, paper, quick), pick_size(EFFORT, paper, quick)
    models = [
        bm.fit_grid(bm.generators.section_o_grid(bm.generators.naca_section(0.12, extended=True), n)) for n in sizes
    ]
    members = [solve(model, MACH, ALPHA) for model in models]
    given = models[1]
    search = {"rounds": rounds, "iterations": iterations, "reference_area": 1.0}
    found = bm.adaptation.adapt_grid(given, "CD", mach=MACH, alpha=ALPHA, **search)
    adapted = solve(found.model, MACH, ALPHA)
    numbers = {
        "members": members,
        "adapted": adapted,
        **changes(found),
        "flows": found.flows,
        "others": {
            f"M {mach:g}, {alpha:g} deg": [solve(model, mach, alpha)["CD"] for model in (given, found.model)]
            for mach, alpha in OTHERS
        },
        "drag_ratio": abs(adapted["CD"] / members[1]["CD"]),
        "lift_ratio": abs((adapted["CL"] - LIFT) / (members[1]["CL"] - LIFT)),
    }
    if paper:
        numbers["H-H"], numbers["M6"] = adapt_hh_section(search), adapt_wing()
    if figures:
        draw(figures, given, found, members, adapted)
    return numbers


def adapt_hh_section(search: dict) -> dict:
    """Adapt an H-H grid about the section to drag and lift; their limits are from two members."""
    grid = bm.generators.infinite_wing_grid(
        bm.generators.naca_section(0.12, extended=True),
        HH,
        bm.generators.Spacing(*HH_SPACING),
        bm.generators.FarField(HH_FAR),
    )
    given = bm.fit_grid(grid)
    return compare(given, bm.adaptation.adapt_grid(given, ("CD", "CL"), mach=MACH, alpha=ALPHA, **search), OTHERS)


def adapt_wing() -> dict:
    """Adapt a grid of the M6 to drag and lift."""
    planform = bm.generators.onera_m6_planform()
    area = 2.0 * planform.semi_span**2 / planform.aspect_ratio
    given = bm.fit_grid(bm.generators.onera_m6_grid(M6), n_control=M6_POINTS)
    how = {"limits": M6_LIMITS, "rounds": 4, "iterations": 14, "reach": 0.45, "reference_area": area}
    return compare(
        given, bm.adaptation.adapt_grid(given, ("CD", "CL"), mach=MACH, alpha=M6_ALPHA, **how), M6_OTHERS, area
    )


def compare(given: bm.FittedModel, found: bm.adaptation.Adaptation, conditions, area: float = 1.0) -> dict:
    """Compare drag and lift before and after, and on the finer member at other conditions."""
    others = {
        f"M {mach:g}, {alpha:g} deg": [solve(one, mach, alpha, area) for one in (given, found.model, given.member(2.0))]
        for mach, alpha in conditions
    }
    values = {name: [found.before[name].value, found.after[name].value] for name in found.limits}
    ratios = {"drag_ratio": found.ratio("CD"), "lift_ratio": found.ratio("CL")}
    return {**values, **changes(found), "limits": found.limits, "flows": found.flows, "others": others, **ratios}


def solve(model: bm.FittedModel, mach: float, alpha: float, area: float = 1.0) -> dict:
    """Solve a flow; returns the number of cells, lift and drag."""
    problem = om.Problem(bm.EulerFlow(model=model, reference_area=area, iprint=0), reports=None)
    problem.setup(mode="rev")
    problem.set_val("Mach_number", mach)
    problem.set_val("alpha", alpha, units="deg")
    problem.run_model()
    n_cells = problem.get_val("states").size // 5
    return {"n_cells": n_cells, **{name: problem.get_val(name).item() for name in ("CL", "CD")}}


def changes(found: bm.adaptation.Adaptation) -> dict:
    """Estimated error and bound of the drag, each before and after."""
    both = found.before["CD"], found.after["CD"]
    return {"estimate": [each.error for each in both], "bound": [each.bound for each in both]}


def draw(folder, given: bm.FittedModel, found: bm.adaptation.Adaptation, members: list[dict], adapted: dict) -> None:
    """Draw the cells about the section with what they contribute, and the drag over the cells."""
    from matplotlib.collections import PolyCollection

    with figure(folder, "adapt_grid", size=(12.0, 4.0)) as canvas:
        before, after, drag = canvas.subplots(1, 3)
        pairs = ((before, given.regenerate(), found.before), (after, found.grid, found.after))
        for axes, grid, estimates in pairs:
            x = grid.blocks[0].nodes[:, :, 0, :2]
            corners = np.stack([x[:-1, :-1], x[1:, :-1], x[1:, 1:], x[:-1, 1:]], axis=2).reshape(-1, 4, 2)
            sizes = np.log10(np.maximum(np.abs(estimates["CD"].contributions), 1e-12))
            look = {"cmap": "viridis", "clim": (-7.0, -4.0), "edgecolors": "w", "linewidths": 0.15}
            cells = axes.add_collection(PolyCollection(corners, array=sizes, **look))
            axes.set(xlim=(-0.3, 1.3), ylim=(-0.8, 0.8), aspect="equal", xlabel="$x / c$")
            axes.set_title(f"{'given' if axes is before else 'adapted'}: $C_D = {estimates['CD'].value:.5f}$")
        before.set_ylabel("$y / c$")
        canvas.colorbar(cells, ax=[before, after], label="$\\log_{10}$ of the contribution to the error of $C_D$")
        sides = [np.sqrt(member["n_cells"]) for member in members]
        drag.loglog(sides, [abs(member["CD"]) for member in members], "o-", color=BLUE, label="family")
        drag.loglog(np.sqrt(adapted["n_cells"]), abs(adapted["CD"]), "s", color=ORANGE, label="adapted")
        drag.set(xlabel="cells each way", ylabel="$|C_D|$, exactly 0", title=f"Mach {MACH:g}, {ALPHA:g}°")
        drag.set_xticks(sides, [f"{side:.0f}" for side in sides])
        drag.minorticks_off()
        drag.legend()


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/adapt_grid.png'
