"""Section II.E: order on a grid family.

Lift and drag on four members of a grid family, their order, and their limit on infinitely fine grids. All members have
the same control points: only the number of cells changes. It takes two minutes, with ``--quick`` some seconds, and a
quarter of an hour at the paper's size. The output, for a wing and for a ball, is the coefficients on the members, their
order of accuracy with its uncertainty, their limits, and a picture of them.

The wing is chosen so that an order can be expected: it has Joukowski sections of the same chord, ever thinner towards a
sharp tip, on an O-grid whose lines are the images of circles and rays. There are no singular lines, and no corners
except the edges. The wing is twisted so that its load vanishes towards the tip, in the shape of a bell: a vortex over a
loaded side edge would be resolved better on every finer grid, and reduce the lift at less than first order. H-H grids
have a singular line at the leading edge and the tip.

L. Prandtl, "Über Tragflügel kleinsten induzierten Widerstandes", Z. Flugtech. Motorluftsch. 24 (1933), 305-306.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import openmdao.api as om
from scipy.optimize import brentq, minimize_scalar

import bspline_mdao as bm
from bspline_mdao import Grid
from bspline_mdao.flow import run_flow
from bspline_mdao.grids import Block, Patch, Window
from bspline_mdao.plotting import BLUE, GREEN, ORANGE, PURPLE, figure
from bspline_mdao.scripts import pick_size, run

FACTORS = (2 / 3, 1.0, 3 / 2, 9 / 4)
"""Cells per direction of the members, relative to the sizes below."""

COEFFICIENTS = {
    "CL": ("$C_L$", BLUE),
    "CD": ("$C_D$", ORANGE),
    "CD_induced": (r"$C_{D,\mathrm{induced}}$", GREEN),
    "CD_entropy": (r"$C_{D,\mathrm{entropy}}$", PURPLE),
    "spurious": (r"$C_D - C_{D,\mathrm{induced}}$", PURPLE),
}
"""Labels and colours."""

TITLES = {"wing": "wing with a bell-shaped load, M 0.4, 2°", "ball": "ball, M 0.2"}
STREAMS = {"wing": (0.4, 2.0, 3.0, "xyz"), "ball": (0.2, 0.0, np.pi, "xzy")}
"""Mach number, angle of attack (deg), reference area (m^2) of the half wing and of the ball, and axes."""

EXACT = {
    "wing": {"CL": None, "CD": None, "CD_induced": None, "spurious": 0.0},
    "ball": {"CD": 0.0, "CD_entropy": 0.0},
}
"""Limits of the coefficients, None where they are not known. Drags of the pressures and of the wake are the same."""

WING_SIZES = {"quick": (16, 12, 6, 2), "default": (48, 36, 12, 6), "paper": (60, 42, 15, 6)}
"""Cells around the wing, off it, along the half span, and beyond the tip."""

FINENESS = {"wing": 2, "ball": 1}
"""Cells per direction of the grids that are fitted, relative to the sizes: splines waver between the nodes of
a fitted grid, by which members with nodes in other places would differ."""

SEMI_SPAN, THICKNESS, FAR = 3.0, 0.09, (16.0, 12.0)
"""Half span in chords; by how much the circle of Joukowski misses the origin at the root, which makes sections 12 %
thick; and the far field: radius about the wing and distance beyond its tip, in chords."""

ROOT_LIFT = 0.3
"""Lift coefficient of the root by the theory of the lifting line."""

BALL_SIZES = {"quick": 6, "default": 12, "paper": 16}
"""Cells along all edges of the six blocks about the ball."""


def main(paper: bool = False, figures=None, quick: bool = False, iprint: int = 0) -> dict:
    """Solve the flow on four members of the family of each grid.

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
        For ``wing`` and ``ball``: ``members``, a list of what `run_flow` returns, with ``spurious``, the difference of
        the drag of the pressures and of the wake; and ``convergence`` of the coefficients by name, see `Convergence`.
    """
    sizes, n = pick_size(WING_SIZES, paper, quick), pick_size(BALL_SIZES, paper, quick)
    fine = [FINENESS["wing"] * cells for cells in sizes]
    n_control = (sizes[0] + 1, sizes[1] + 1, fine[2] + 1)  # of each half of the wing; all there can be along walls
    models = {
        "wing": bm.fit_grid(joukowski_wing_grid(*fine), n_control=n_control, keep_residual=False),
        "ball": bm.fit_grid(bm.generators.ball_grid((n + 1,) * 4, far=20.0, off_wall=1.0 / n), keep_residual=False),
    }
    numbers = {name: study(name, model, iprint) for name, model in models.items()}
    if figures:
        draw(figures, numbers)
    return numbers


def joukowski_wing_grid(n_around: int, n_off: int, n_span: int, n_beyond: int) -> Grid:
    """Make an O-grid about half of a wing of unit chord, with cells of even size in the plane of the circle.

    Parameters
    ----------
    n_around, n_off, n_span, n_beyond : int
        Cells around the wing, an even number, off it, along the half span, and beyond the tip.

    Returns
    -------
    Grid
        One block, i from the trailing edge along the upper side to the nose and back, j away from the wing, k along the
        span from the plane of symmetry y = 0. Beyond the tip the two sides of the face j = 0 meet.
    """
    angle = 2.0 * np.pi * np.arange(n_around + 1) / n_around
    radius = np.geomspace(1.0, 4.0 * FAR[0], n_off + 1)
    span = stations(n_span, n_beyond)
    at = np.minimum(span / SEMI_SPAN, 1.0)
    offset = THICKNESS * (1.0 - at**2)
    circle = -offset + (1.0 + offset) * (radius[None, :] * np.exp(1j * angle)[:, None])[..., None]
    plane = 0.5 * (circle + 1.0 / circle)
    nose = -0.5 * ((1.0 + 2.0 * offset) + 1.0 / (1.0 + 2.0 * offset))
    plane = (plane - nose) / (1.0 - nose)
    half = n_around // 2
    plane[half:] = plane[half::-1].conj()  # the same bits on both sides
    nearness = np.exp(-((np.abs(plane - 0.5) / 4.0) ** 4))  # the far field is not turned
    plane = 0.25 + (plane - 0.25) * np.exp(-1j * bell_twist(at) * nearness)
    plane[-1] = plane[0]
    plane[half:, 0, n_span:] = plane[half::-1, 0, n_span:]
    nodes = np.stack(np.broadcast_arrays(plane.real, span, plane.imag), axis=-1)
    i, j, k = (n - 1 for n in nodes.shape[:3])
    wall, far = Window(0, (0, 0, 0), (i, 0, n_span)), (Window(0, (0, j, 0), (i, j, k)), Window(0, (0, 0, k), (i, j, k)))
    symmetry = Window(0, (0, 0, 0), (i, j, 0))
    patches = Patch("wing", "wall", (wall,)), Patch("far", "farfield", far), Patch("root", "symmetry", (symmetry,))
    return Grid((Block(nodes, "wing"),), patches)


def stations(n_span: int, n_beyond: int) -> np.ndarray:
    """Stations along the span: the sine's on the wing, and beyond it as dense at the tip, growing exponentially."""
    t, beyond = np.arange(n_span + 1) / n_span, np.arange(1, n_beyond + 1) / n_span
    curvature = SEMI_SPAN * (0.5 * np.pi) ** 2  # of the sine at the tip, so that both sides match
    growth = brentq(lambda q: curvature / q**2 * (np.cosh(q * beyond[-1]) - 1.0) - FAR[1], 1e-3, 700.0 / beyond[-1])
    past = curvature / growth**2 * (np.cosh(growth * beyond) - 1.0)
    return np.append(SEMI_SPAN * np.sin(0.5 * np.pi * t), SEMI_SPAN + past)


def bell_twist(at: np.ndarray) -> np.ndarray:
    """Incidence (rad) without angle of attack at places along the half span, 1 at the tip, for a load (1 - at^2)^(3/2).

    A lifting line with that load has the downwash 3 ROOT_LIFT / (16 SEMI_SPAN) (1 - 2 at^2).
    """
    downwash = 3.0 * ROOT_LIFT / (16.0 * SEMI_SPAN) * (1.0 - 2.0 * at**2)
    return downwash + ROOT_LIFT * (1.0 - at**2) ** 1.5 / (2.0 * np.pi) - np.radians(STREAMS["wing"][1])


def study(name: str, model: bm.FittedModel, iprint: int) -> dict:
    """Solve the flow on all members and extrapolate."""
    members, (mach, alpha, area, axes) = [], STREAMS[name]
    for factor in FACTORS:
        member = model.member(factor / FINENESS[name])
        flow = bm.EulerFlow(model=member, reference_area=area, axes=axes, iprint=iprint)
        problem = om.Problem(flow, reports=None)
        problem.setup(mode="rev")
        problem.set_val("Mach_number", mach)
        problem.set_val("alpha", alpha, units="deg")
        members.append(run_flow(problem))
        members[-1]["spurious"] = members[-1]["CD"] - members[-1]["CD_induced"]
    spacings = np.array([member["n_cells"] for member in members]) ** (-1.0 / 3.0)
    found = {
        key: convergence(spacings, np.array([member[key] for member in members]), exact)._asdict()
        for key, exact in EXACT[name].items()
    }
    return {"members": members, "convergence": found}


class Convergence(NamedTuple):
    """Order of accuracy and the limit at spacing 0; None where the values do not approach one from one side.

    Each uncertainty is the difference to the result of only the finest three members, None if they give none.
    """

    order: float | None
    limit: float | None
    order_uncertainty: float | None = None
    limit_uncertainty: float | None = None


def convergence(spacings: np.ndarray, values: np.ndarray, exact: float | None = None) -> Convergence:
    """Fit ``value = limit + c spacing^order`` to values at three or more spacings by least squares, the finest last."""
    found, finest = least_squares(spacings, values, exact), least_squares(spacings[-3:], values[-3:], exact)
    if len(values) == 3 or None in (found.order, finest.order):
        return found
    return Convergence(*found[:2], abs(found.order - finest.order), abs(found.limit - finest.limit))


def least_squares(spacings: np.ndarray, values: np.ndarray, exact: float | None) -> Convergence:
    """Order and limit of all values; where the limit is known, the slope of the errors in logarithms."""
    if exact is not None:
        return Convergence(float(np.polyfit(np.log(spacings), np.log(np.abs(values - exact)), 1)[0]), exact)

    def fit(order: float) -> tuple[np.ndarray, float]:
        powers = np.stack([np.ones(len(spacings)), (spacings / spacings[0]) ** order], axis=1)
        found = np.linalg.lstsq(powers, values)[0]
        return found, float(np.sum((powers @ found - values) ** 2))

    order = minimize_scalar(lambda p: fit(p)[1], bounds=LIKELY_ORDERS, method="bounded", options={"xatol": 1e-10}).x
    is_at_end = min(order - LIKELY_ORDERS[0], LIKELY_ORDERS[1] - order) < 1e-2
    if is_at_end or (np.diff(values)[1:] * np.diff(values)[:-1] <= 0).any():
        return Convergence(None, None)
    return Convergence(float(order), float(fit(order)[0][0]))


LIKELY_ORDERS = 0.2, 8.0
"""Orders beyond these are none: the grids are too coarse."""


def draw(folder, numbers: dict) -> None:
    """Draw the coefficients over the square of the spacing, in a straight line at second order, and limits as rings."""
    panels = ("wing", ("CL",)), ("wing", ("CD", "CD_induced", "spurious")), ("ball", ("CD", "CD_entropy"))
    with figure(folder, "grid_family", size=(10.5, 3.6)) as canvas:
        for axes, (case, names) in zip(canvas.subplots(1, 3), panels):
            n_cells = np.array([member["n_cells"] for member in numbers[case]["members"]])
            x = (n_cells[-1] / n_cells) ** (2.0 / 3.0)
            for name in names:
                found, (label, color) = numbers[case]["convergence"][name], COEFFICIENTS[name]
                order, limit = found["order"], found["limit"]
                label += ", no order" if order is None else f", order {order:.2f}"
                axes.plot(x, [member[name] for member in numbers[case]["members"]], "o-", color=color, label=label)
                if limit is not None:
                    axes.plot(0.0, limit, "o", color=color, fillstyle="none")
            axes.set(title=TITLES[case], xlabel=r"$(n_\mathrm{finest} / n)^{2/3}$, $n$ cells", xlim=(-0.1, None))
            axes.legend(fontsize=9)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/thumbnails/grid_family.png'
