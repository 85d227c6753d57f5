"""Flows with exact solutions.

Flows whose solution is known: a cylinder, a sphere, and a section of Kármán and Trefftz with lift. It takes a minute,
with ``--quick`` some seconds, and some minutes at the paper's size. The output is pressures, lift and drag on three
grids about each body, their errors and orders, and a picture of the pressures over the exact ones and of the errors
over the cells along a body.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.flow import run_flow
from bspline_mdao.names import GRID
from bspline_mdao.plotting import BLUE, GRAY, GREEN, ORANGE, PURPLE, figure, wall_quads
from bspline_mdao.scripts import pick_size, run

GAMMA = 1.4
"""Ratio of specific heats."""

ALPHA = 4.0
"""Angle of attack of the section (deg)."""

OFFSET, EDGE = 0.1, 15.0
"""Of the section: centre of its circle upstream of the middle, by the distance of the singular points from that; and
the angle of its trailing edge (deg). It is 17 % thick."""

SIZES = {
    "quick": {"cylinder": (24, 32, 48), "sphere": (4, 6, 8), "section": (24, 32, 48)},
    "default": {"cylinder": (32, 48, 64), "sphere": (6, 8, 12), "section": (32, 64, 128)},
    "paper": {"cylinder": (32, 48, 64), "sphere": (8, 12, 18), "section": (64, 128, 256)},
}
"""Cells around cylinder and section, and along a quarter of a great circle of the sphere."""

ERRORS = {
    "Cp_error": ("root mean square of $C_p$", BLUE, 1.4),
    "CD": ("$C_D$, exactly 0", ORANGE, 4.0),
    "CD_entropy": ("$C_D$ of the entropy", PURPLE, 1.4),
    "CL_error": ("$C_L$, relative", GREEN, 1.4),
}
"""What is drawn: labels, colours and widths. Both drags nearly agree, so one is drawn thin on the other."""


def main(paper: bool = False, figures=None, quick: bool = False, iprint: int = 0) -> dict:
    """Solve the flows on three grids about each body.

    Parameters
    ----------
    paper, quick : bool
        Another of the sizes.
    figures : path-like, optional
        Folder for ``validation_exact.png``.
    iprint : int
        1 for a line a flow, 2 for one a Newton step.

    Returns
    -------
    dict
        For ``cylinder``, ``sphere`` and ``section``: ``members``, a list of what `run_flow` returns, and of the least
        ``Cp`` and its exact value, the root mean square error of Cp, and for the section the lift without
        compressibility with its relative error; and ``orders`` of the errors between the two finest, None where the
        error changes its sign.
    """
    sizes, numbers, drawn = pick_size(SIZES, paper, quick), {}, {}
    for name, case in CASES.items():
        solved = [study(case, n, iprint) for n in sizes[name]]
        members, drawn[name] = [member for member, _ in solved], solved[-1][1]
        keys = [key for key in ("n_along", *ERRORS) if key in members[0]]
        finer, *falls = (members[-1][key] / members[-2][key] for key in keys)
        orders = [-np.log(fall) / np.log(finer) if fall > 0.0 else None for fall in falls]
        numbers[name] = {"members": members, "orders": dict(zip(keys[1:], orders))}
    if figures:
        draw(figures, numbers, drawn)
    return numbers


class Case(NamedTuple):
    """A body: its grid for a number of cells, Mach number, angle (deg), area, centre, and Cp by cosine and Mach."""

    title: str
    grid: Callable
    mach: float
    alpha: float
    area: float
    centre: float
    exact: Callable | None


def pressure(speed, mach: float):
    """Pressure coefficient of isentropic flow at a speed relative to the stream's."""
    ratio = (1.0 + 0.5 * (GAMMA - 1.0) * mach**2 * (1.0 - speed**2)) ** (GAMMA / (GAMMA - 1.0))
    return (ratio - 1.0) / (0.5 * GAMMA * mach**2)


def cylinder(cosine: np.ndarray, mach: float) -> np.ndarray:
    """Cp on a cylinder across the stream: three terms of the expansion of Janzen and Rayleigh, for air."""
    angle = np.arccos(cosine)
    one, three, five = np.sin(angle), np.sin(3.0 * angle), np.sin(5.0 * angle)
    terms = 2 / 3 * one - 1 / 2 * three, 601 / 600 * one - 691 / 600 * three + 17 / 40 * five
    return pressure(2.0 * one + mach**2 * terms[0] + mach**4 * terms[1], mach)


def sphere(cosine: np.ndarray, mach: float) -> np.ndarray:
    """Cp on a sphere: two terms of the expansion of Janzen and Rayleigh."""
    return pressure(np.sqrt(1.0 - cosine**2) * (1.5 + mach**2 * (551 / 1760 - 243 / 352 * cosine**2)), mach)


def joukowski(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Points of the section at angles on its circle, the speeds there by the stream's, and the lift coefficient.

    Neither knows compressibility. From the circle of radius 1 + offset about -offset the mapping is
    ``(z - k) / (z + k) = ((w - 1) / (w + 1))^k``, with k = 2 less the angle of the trailing edge by pi.
    """
    k, radius, incidence = 2.0 - EDGE / 180.0, 1.0 + OFFSET, np.radians(ALPHA)
    w = -OFFSET + radius * np.exp(1j * angles)
    ratio = ((w - 1.0) / (w + 1.0)) ** k
    nose = ((-OFFSET - radius - 1.0) / (-OFFSET - radius + 1.0)) ** k
    z, front = k * (1.0 + ratio) / (1.0 - ratio), k * (1.0 + nose) / (1.0 - nose)
    with np.errstate(invalid="ignore", divide="ignore"):  # at the trailing edge
        slope = k**2 * 4.0 * ratio / ((1.0 - ratio) ** 2 * (w**2 - 1.0))
        speed = np.abs(2.0 * (np.sin(angles - incidence) + np.sin(incidence)) / slope)
    return (z - front) / (k - front), speed, 8.0 * np.pi * radius / (k - front) * np.sin(incidence)


def section_through(z: np.ndarray, nose_radius: float) -> bm.generators.Section:
    """Give the symmetric section through points from the nose along the upper side."""
    points = np.stack([z.real, z.imag], axis=1)
    points[[0, -1]] = [[0.0, 0.0], [1.0, 0.0]]
    return bm.generators.Section.symmetric(points, nose_radius)


def round_grid(n: int) -> bm.Grid:
    """Make a grid about a cylinder of diameter 1 with n cells around."""
    circle = 0.5 + 0.5 * np.exp(1j * np.linspace(np.pi, 0.0, 1601))
    return bm.generators.section_o_grid(section_through(circle, 0.5), n)


def section_grid(n: int) -> bm.Grid:
    """Make a grid about the section of Kármán and Trefftz with n cells around."""
    front, near = joukowski(np.pi - np.array([0.0, 1e-3]))[0]
    nose_radius = 0.5 * near.imag**2 / (near.real - front.real)
    return bm.generators.section_o_grid(section_through(joukowski(np.linspace(np.pi, 0.0, 801))[0], nose_radius), n)


def ball(n: int) -> bm.Grid:
    """Make a grid about a sphere with n cells along a quarter of its great circles."""
    return bm.generators.ball_grid((n + 1, n + 1, n + 1, 2 * n + 1), far=20.0, off_wall=0.72 / n)


CASES = {
    "cylinder": Case("cylinder, M 0.2", round_grid, 0.2, 0.0, 1.0, 0.5, cylinder),
    "sphere": Case("sphere, M 0.2", ball, 0.2, 0.0, np.pi, 0.0, sphere),
    "section": Case(f"section, {ALPHA:g}°, M 0.15", section_grid, 0.15, ALPHA, 1.0, 0.5, None),
}


def study(case: Case, n: int, iprint: int) -> tuple[dict, tuple]:
    """Solve a flow; returns its numbers, and the places along x and pressures of the wall faces."""
    model = bm.fit_grid(case.grid(n))
    problem = om.Problem(bm.EulerFlow(model=model, reference_area=case.area, iprint=iprint), reports=None)
    problem.setup(mode="rev")
    problem.set_val("Mach_number", case.mach)
    problem.set_val("alpha", case.alpha, units="deg")
    member = {"n_along": n} | run_flow(problem)
    points = problem.get_val(GRID).reshape(-1, 3)[wall_quads(model)].mean(axis=1) - [case.centre, 0.0, 0.0]
    cp = problem.get_val("Cp").copy()
    member["Cp_min"] = cp.min()
    if case.exact is not None:
        away = np.hypot(points[:, 1], points[:, 2] * (case.exact is sphere))
        error = cp - case.exact(points[:, 0] / np.hypot(points[:, 0], away), case.mach)
        member |= {"Cp_min_exact": case.exact(0.0, case.mach), "Cp_error": np.sqrt(np.mean(error**2))}
    else:  # lift is a series in the square of the Mach number: three tell that without compressibility
        lifts, squares = [member["CL"]], case.mach**2 + np.array([0.0, 0.04, 0.1])
        for square in squares[1:]:
            problem.set_val("Mach_number", np.sqrt(square))
            problem.run_model()
            lifts.append(problem.get_val("CL").item())
        lift, exact = np.polyval(np.polyfit(squares, lifts, 2), 0.0), joukowski(np.zeros(1))[2]
        member |= {"CL_incompressible": lift, "CL_exact": exact, "CL_error": lift / exact - 1.0}
    return member, (points[:, 0] + case.centre, cp)


def draw(folder, numbers: dict, drawn: dict) -> None:
    """Draw pressures on the finest grids over the exact ones, and errors over the cells."""
    with figure(folder, "validation_exact", size=(10.5, 6.4)) as canvas:
        for (name, case), (upper, lower) in zip(CASES.items(), canvas.subplots(2, 3).T):
            upper.plot(*drawn[name], ".", color=BLUE, markersize=3, label="EulerFlow")
            if case.exact is not None:
                cosine, exact = np.linspace(-1.0, 1.0, 201), f"exact, M {case.mach:g}"
                curve = case.centre + (case.centre or 1.0) * cosine, case.exact(cosine, case.mach)
            else:
                z, speed, _ = joukowski(np.linspace(1e-3, 2.0 * np.pi - 1e-3, 1000))
                curve, exact = (z.real, 1.0 - speed**2), "exact, M 0"
            upper.plot(*curve, color=GRAY, lw=0.8, label=exact)
            upper.set(title=case.title, xlabel="$x$ (m)", ylabel="$C_p$")
            upper.invert_yaxis()
            upper.legend(fontsize=9)
            members, n = numbers[name]["members"], [member["n_along"] for member in numbers[name]["members"]]
            for key, order in numbers[name]["orders"].items():
                errors, (label, color, width) = [abs(member[key]) for member in members], ERRORS[key]
                suffix = f", order {order:.2f}" if order else ", changes sign"
                lower.loglog(n, errors, "o-", color=color, lw=width, ms=3.0 + width, label=label + suffix)
            lower.set(xlabel="cells along a quarter" if name == "sphere" else "cells around", ylabel="error")
            decades = np.log10(lower.get_ylim()) + [0.0, 0.3]  # whole ones, and room for the legend
            lower.set_ylim(10.0 ** np.floor(decades[0]), 10.0 ** np.ceil(decades[1]))
            lower.set_xticks(n, n)
            lower.set_xticks([], minor=True)
            lower.legend(fontsize=8, loc="upper right")


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/validation_exact.png'
