"""Section II.E: lift and drag on three members of a grid family, their order, and their limit on infinitely fine grids.

All members have the same control points: what changes is the number of cells alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from common import BLUE, GREEN, ORANGE, PURPLE, figure, run
from euler_runs import COEFFICIENTS, OPTIONS, Condition, flow_problem, run_euler
from flown_wing import control_counts, size_of
from scipy.optimize import brentq

from bspline_mdao import FittedModel, Planform, Spacing, Wing, ball_grid, fit_grid, hh_wing_grid, naca_section

FACTORS = (2 / 3, 1.0, 3 / 2)
"""Cells per direction of the members, by those of the fitted grid."""

COLORS = dict(zip(COEFFICIENTS, (BLUE, ORANGE, GREEN, PURPLE)))
LABELS = dict(zip(COEFFICIENTS, ("$C_L$", "$C_D$", r"$C_{D,\mathrm{induced}}$", r"$C_{D,\mathrm{entropy}}$")))


@dataclass(frozen=True)
class Case:
    """A body in a stream.

    Parameters
    ----------
    title : str
        What it is.
    condition : Condition
        The stream, and the reference area.
    make_model : callable
        Fitted grid, given its size.
    sizes : dict
        Numbers that the grid is made with.
    exact : dict
        Limits of the coefficients by name, None where it is not known.
    """

    title: str
    condition: Condition
    make_model: Callable[[object], FittedModel]
    sizes: dict
    exact: dict[str, float | None]


class WingSize(NamedTuple):
    """Nodes and control points of the rows of blocks, and the spacing, see `hh_wing_grid`."""

    shape: tuple
    n_control: tuple
    spacing: Spacing


def wing_model(size: WingSize) -> FittedModel:
    """Fit the grid about a rectangular wing of chord 1 and semi-span 3 with sections NACA 0012."""
    wing = Wing(Planform(root_chord=1.0, semi_span=3.0), naca_section(0.12))
    grid = hh_wing_grid(wing, size.shape, size.spacing)
    return fit_grid(grid, n_control=control_counts(size.n_control), keep_residual=False)


def ball_model(n_cells: int) -> FittedModel:
    """Fit the grid about a ball of radius 1, with these cells along all edges of its six blocks."""
    n = n_cells + 1
    return fit_grid(ball_grid((n,) * 4, far=20.0, off_wall=1.0 / n_cells), keep_residual=False)


CASES = {
    "wing": Case(
        "rectangular wing NACA 0012, M 0.3, 4°",
        Condition(0.3, 4.0, area=3.0),
        wing_model,
        {
            "quick": WingSize(
                ((7, 7, 7), (7, 7), (7, 7)), ((5, 6, 5), (5, 5), (6, 4)), Spacing(0.06, 0.08, 0.08, 0.08)
            ),
            "default": WingSize(
                ((7, 13, 7), (10, 10), (13, 7)), ((5, 8, 5), (6, 6), (9, 5)), Spacing(0.03, 0.03, 0.03, 0.05)
            ),
            "paper": WingSize(
                ((13, 25, 13), (16, 16), (25, 13)), ((7, 11, 7), (9, 9), (13, 7)), Spacing(0.015, 0.015, 0.015, 0.025)
            ),
        },
        dict.fromkeys(COEFFICIENTS),
    ),
    "ball": Case(
        "ball, M 0.2",
        Condition(0.2, 0.0, area=np.pi),
        ball_model,
        {"quick": 6, "default": 12, "paper": 18},
        {"CD": 0.0, "CD_entropy": 0.0},
    ),
}


def main(paper: bool = False, figures=None, quick: bool = False, iprint: int = 0) -> dict:
    """Solve the flow on three members of the family of each grid.

    Parameters
    ----------
    paper, quick : bool
        Another of the sizes of `CASES`.
    figures : path-like, optional
        Folder for ``grid_family.png``.
    iprint : int
        1 for a line a flow, 2 for one a Newton step.

    Returns
    -------
    dict
        For ``wing`` and ``ball``: ``members``, a list of what `euler_runs.run_euler` tells; and ``convergence`` of the
        coefficients by name, see `Convergence`.
    """
    numbers = {name: study(case, size_of(case.sizes, paper, quick), iprint) for name, case in CASES.items()}
    if figures:
        draw(figures, numbers)
    return numbers


def study(case: Case, size, iprint: int) -> dict:
    """Solve the flow on all members and extrapolate."""
    model = case.make_model(size)
    members = [run_euler(flow_problem(model.member(factor), case.condition, iprint=iprint)) for factor in FACTORS]
    spacings = np.array([member["n_cells"] for member in members]) ** (-1.0 / 3.0)
    found = {
        name: convergence(spacings, np.array([member[name] for member in members]), exact)._asdict()
        for name, exact in case.exact.items()
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
    order = observed_order(spacings, np.diff(values))
    if order is None:
        return Convergence(None, None)
    ratio = (spacings[1] / spacings[2]) ** order
    return Convergence(order, values[2] + (values[2] - values[1]) / (ratio - 1.0))


def observed_order(spacings: np.ndarray, steps: np.ndarray) -> float | None:
    """Order by the two steps between values at three spacings, None where there is none between 0 and 20."""

    def excess(order):
        first, second = np.diff(spacings**order)
        return steps[1] * first - steps[0] * second

    lowest, highest = 1e-3, 20.0
    return brentq(excess, lowest, highest) if excess(lowest) * excess(highest) < 0.0 else None


def draw(folder, numbers: dict) -> None:
    """Draw the coefficients of each case over the square of the spacing: in a straight line at second order."""
    panels = ("wing", ("CL",)), ("wing", ("CD", "CD_induced", "CD_entropy")), ("ball", ("CD", "CD_entropy"))
    with figure(folder, "grid_family", size=(10.5, 3.6)) as canvas:
        for axes, (name, group) in zip(canvas.subplots(1, 3), panels):
            draw_members(axes, numbers[name], group)
            axes.set(title=CASES[name].title, xlabel=r"$(n_\mathrm{finest} / n)^{2/3}$, $n$ cells", xlim=(-0.1, None))


def draw_members(axes, found: dict, names) -> None:
    """Draw some coefficients of one case, and their limits as rings."""
    n_cells = np.array([member["n_cells"] for member in found["members"]])
    x = (n_cells[-1] / n_cells) ** (2.0 / 3.0)
    for name in names:
        order, limit = found["convergence"][name].values()
        label = f"{LABELS[name]}, " + ("no order" if order is None else f"order {order:.2f}")
        axes.plot(x, [member[name] for member in found["members"]], "o-", color=COLORS[name], label=label)
        if limit is not None:
            axes.plot(0.0, limit, "o", color=COLORS[name], fillstyle="none")
    axes.legend(fontsize=9)


if __name__ == "__main__":
    run(main, __doc__, quick=OPTIONS["quick"], iprint=OPTIONS["iprint"])
