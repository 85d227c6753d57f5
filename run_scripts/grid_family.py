"""Section II.E: lift and drag on three members of a grid family, their order, and their limit on infinitely fine grids.

All members have the same control points: what changes is the number of cells alone. It takes some minutes, with
``--quick`` half a minute, and an hour at the paper's size. What comes out, for a rectangular wing and for a ball, are
the coefficients on the members, their order of accuracy and their limits, and a picture of them.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
import openmdao.api as om
from scipy.optimize import brentq

import bspline_mdao as bm
from bspline_mdao.om.flow.flow_run import run_flow
from bspline_mdao.plotting import BLUE, GREEN, ORANGE, PURPLE, figure
from bspline_mdao.run_script import pick_size, run

FACTORS = (2 / 3, 1.0, 3 / 2)
"""Cells per direction of the members, relative to those of the fitted grid."""

COEFFICIENTS = {
    "CL": ("$C_L$", BLUE),
    "CD": ("$C_D$", ORANGE),
    "CD_induced": (r"$C_{D,\mathrm{induced}}$", GREEN),
    "CD_entropy": (r"$C_{D,\mathrm{entropy}}$", PURPLE),
}
"""Labels and colours."""

TITLES = {"wing": "rectangular wing NACA 0012, M 0.3, 4°", "ball": "ball, M 0.2"}
STREAMS = {"wing": (0.3, 4.0, 3.0), "ball": (0.2, 0.0, np.pi)}
"""Mach number, angle of attack (deg) and reference area (m^2): of the half wing, and of the ball."""

EXACT = {"wing": dict.fromkeys(COEFFICIENTS), "ball": {"CD": 0.0, "CD_entropy": 0.0}}
"""Limits of the coefficients, None where they are not known."""

WING_SIZES = {
    "quick": (((7, 7, 7), (7, 7), (7, 7)), ((5, 6, 5), (5, 5), (6, 4)), (0.06, 0.08, 0.08, 0.08)),
    "default": (((7, 13, 7), (10, 10), (13, 7)), ((5, 8, 5), (6, 6), (9, 5)), (0.03, 0.03, 0.03, 0.05)),
    "paper": (
        ((13, 25, 13), (16, 16), (25, 13)),
        ((7, 11, 7), (9, 9), (13, 7)),
        (0.015, 0.015, 0.015, 0.025),
    ),
}
"""Nodes and control points of the rows of blocks along the stream, off the wing and along the span; spacing."""

BALL_SIZES = {"quick": 6, "default": 12, "paper": 18}
"""Cells along all edges of the six blocks about the ball."""


def main(paper: bool = False, figures=None, quick: bool = False, iprint: int = 0) -> dict:
    """Solve the flow on three members of the family of each grid.

    Parameters
    ----------
    paper, quick : bool
        Another of the sizes.
    figures : path-like, optional
        Folder for ``grid_family.png``.
    iprint : int
        1 for a line a flow, 2 for one a Newton step.

    Returns
    -------
    dict
        For ``wing`` and ``ball``: ``members``, a list of what `run_flow` returns; and ``convergence`` of the
        coefficients by name, see `Convergence`.
    """
    shape, (stream, normal, span), spacing = pick_size(WING_SIZES, paper, quick)
    wing = bm.Wing(bm.Planform(root_chord=1.0, semi_span=3.0), bm.naca_section(0.12))
    n_control = [(i, j, k) for k, j, i in product(span, normal, stream)]
    wing_grid, n = bm.hh_wing_grid(wing, shape, bm.Spacing(*spacing)), pick_size(BALL_SIZES, paper, quick)
    models = {
        "wing": bm.fit_grid(wing_grid, n_control=n_control, keep_residual=False),
        "ball": bm.fit_grid(bm.ball_grid((n + 1,) * 4, far=20.0, off_wall=1.0 / n), keep_residual=False),
    }
    numbers = {name: study(name, model, iprint) for name, model in models.items()}
    if figures:
        draw(figures, numbers)
    return numbers


def study(name: str, model: bm.FittedModel, iprint: int) -> dict:
    """Solve the flow on all members and extrapolate."""
    members, (mach, alpha, area) = [], STREAMS[name]
    for factor in FACTORS:
        flow = bm.EulerFlow(model=model.member(factor), reference_area=area, iprint=iprint)
        problem = om.Problem(flow, reports=None)
        problem.setup(mode="rev")
        problem.set_val("Mach_number", mach)
        problem.set_val("alpha", alpha, units="deg")
        members.append(run_flow(problem))
    spacings = np.array([member["n_cells"] for member in members]) ** (-1.0 / 3.0)
    found = {
        key: convergence(spacings, np.array([member[key] for member in members]), exact)._asdict()
        for key, exact in EXACT[name].items()
    }
    return {"members": members, "convergence": found}


class Convergence(NamedTuple):
    """Order of accuracy, and the limit at spacing 0; None where the values do not approach one from one side."""

    order: float | None
    limit: float | None


def convergence(spacings: np.ndarray, values: np.ndarray, exact: float | None = None) -> Convergence:
    """Extrapolate values at three spacings, the finest last, by ``value = limit + c spacing^order``.

    Where the limit is known the order is that of the two finest.
    """
    if exact is not None:
        order = np.log((values[1] - exact) / (values[2] - exact)) / np.log(spacings[1] / spacings[2])
        return Convergence(order, exact)

    def excess(order: float) -> float:
        first, second = np.diff(spacings**order)
        return (values[2] - values[1]) * first - (values[1] - values[0]) * second

    if excess(1e-3) * excess(20.0) >= 0.0:  # no order between these
        return Convergence(None, None)
    order = brentq(excess, 1e-3, 20.0)
    return Convergence(order, values[2] + (values[2] - values[1]) / ((spacings[1] / spacings[2]) ** order - 1.0))


def draw(folder, numbers: dict) -> None:
    """Draw the coefficients over the square of the spacing, in a straight line at second order, and limits as rings."""
    panels = ("wing", ("CL",)), ("wing", ("CD", "CD_induced", "CD_entropy")), ("ball", ("CD", "CD_entropy"))
    with figure(folder, "grid_family", size=(10.5, 3.6)) as canvas:
        for axes, (case, names) in zip(canvas.subplots(1, 3), panels):
            n_cells = np.array([member["n_cells"] for member in numbers[case]["members"]])
            x = (n_cells[-1] / n_cells) ** (2.0 / 3.0)
            for name in names:
                (order, limit), (label, color) = numbers[case]["convergence"][name].values(), COEFFICIENTS[name]
                label += ", no order" if order is None else f", order {order:.2f}"
                axes.plot(x, [member[name] for member in numbers[case]["members"]], "o-", color=color, label=label)
                if limit is not None:
                    axes.plot(0.0, limit, "o", color=color, fillstyle="none")
            axes.set(title=TITLES[case], xlabel=r"$(n_\mathrm{finest} / n)^{2/3}$, $n$ cells", xlim=(-0.1, None))
            axes.legend(fontsize=9)


if __name__ == "__main__":
    run(main)
