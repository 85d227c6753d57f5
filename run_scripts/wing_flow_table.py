"""Lift and drag of wings at Mach 0.3 by the Euler equations, by a vortex lattice and by other codes, in one table."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import openmdao.api as om
from common import BLUE, GREEN, ORANGE, PURPLE, RED, figure, run
from euler_runs import OPTIONS, Condition, flow_problem, nodes_of, run_euler, run_openfoam, run_timed, wall_quads
from flown_wing import size_of
from wall_sections import draw_pressures

from bspline_mdao import (
    FittedModel,
    InputError,
    LatticeFlow,
    find_topology,
    fit_grid,
    onera_m6_grid,
    onera_m6_planform,
    read_grid,
)
from bspline_mdao.io.patch_guess import guess_patches

COLORS = {"EulerFlow": BLUE, "LatticeFlow": GREEN, "OpenFOAM": ORANGE, "ADflow": RED, "vortex lattice": PURPLE}
"""Of the codes."""

STYLES = {
    "EulerFlow": {"color": BLUE, "linewidth": 1.2},
    "OpenFOAM": {"color": ORANGE, "marker": ".", "markersize": 4, "linestyle": ""},
}
"""Of the pressures by codes that have some."""


@dataclass(frozen=True)
class Case:
    """A wing in a stream.

    Parameters
    ----------
    title : str
        What it is.
    condition : Condition
        The stream, and the area of the half wing.
    make_model : callable
        Fitted grid, given its size; None where there is no file.
    sizes : dict
        What `make_model` is given.
    place : float
        Where along the span pressures are drawn (m).
    references : dict
        What is known of it: ``CL`` and ``CD`` by the names of the codes.
    """

    title: str
    condition: Condition
    make_model: Callable[[object], FittedModel | None]
    sizes: dict
    place: float
    references: dict[str, dict]


def rectangular_wing(factor: float) -> FittedModel | None:
    """Fit the grid of another project about a NACA 0012 wing: it, or a member of its family.

    The control points are three to four nodes, which keeps the wall of the members within 0.0005 chords of the grid's.
    """
    folder = os.environ.get("BSPLINE_MDAO_GRIDS")
    if not folder:
        return None
    grid = read_grid(Path(folder) / "hh_naca0012_12blocks.xyz")
    grid = replace(grid, patches=guess_patches(grid, [face.window for face in find_topology(grid).boundary]))
    n_control = [tuple(int(np.ceil(0.75 * n)) for n in block.nodes.shape[:3]) for block in grid.blocks]
    model = fit_grid(grid, n_control=n_control)
    return model if factor == 1.0 else model.member(factor)


def half_area() -> float:
    """Area of half the M6 wing of unit root chord (m^2)."""
    planform = onera_m6_planform()
    return 0.5 * (planform.root_chord + planform.tip_chord) * planform.semi_span


CASES = {
    "hh_naca0012": Case(
        "rectangular wing NACA 0012, 4°",
        Condition(0.3, 4.0, area=3.0),
        rectangular_wing,
        {"quick": 0.5, "default": 1.0, "paper": 1.5},
        1.5,
        {
            "ADflow": {"CL": 0.3116, "CD": 0.0206},
            "OpenFOAM": {"CL": 0.3050, "CD": 0.0114},
            "vortex lattice": {"CL": 0.3064, "CD_induced": 0.0050},
        },
    ),
    "onera_m6": Case(
        "ONERA M6, 3.06°",
        Condition(0.3, 3.06, area=half_area()),
        lambda shape: fit_grid(onera_m6_grid(shape)),
        {"quick": (7, 9, 7), "default": (15, 17, 13), "paper": (23, 33, 17)},
        0.65,
        {},
    ),
}
"""References are those of other codes on the same 36,864 cells: ADflow's Euler equations with central differences and
scalar dissipation, OpenFOAM's rhoSimpleFoam with linearUpwind, and OpenAeroStruct with Prandtl-Glauert."""


def main(paper: bool = False, figures=None, quick: bool = False, openfoam: bool = False, iprint: int = 0) -> dict:
    """Fly both wings with every code that is there.

    Parameters
    ----------
    paper, quick : bool
        Another of the sizes of `CASES`.
    figures : path-like, optional
        Folder for ``wing_flow_table.png``.
    openfoam : bool
        Ask OpenFOAM as well, where it is installed.
    iprint : int
        1 for a line a flow, 2 for one a Newton step.

    Returns
    -------
    dict
        For ``hh_naca0012`` and ``onera_m6``: ``codes`` with what `euler_runs.run_euler` tells of ``EulerFlow``, what
        `euler_runs.run_timed` tells of ``LatticeFlow``, and ``OpenFOAM`` if it was asked; and ``references``. Or
        ``skipped``, and why.
    """
    flights = {name: Flight.of(case, size_of(case.sizes, paper, quick), iprint) for name, case in CASES.items()}
    flown = {name: flight for name, flight in flights.items() if flight is not None}
    numbers = {name: {"skipped": "set BSPLINE_MDAO_GRIDS to the folder of the grid"} for name in flights}
    pressures = {}
    for name, flight in flown.items():
        numbers[name], pressures[name] = flight.fly(openfoam)
    if figures:
        draw(figures, flown, pressures, numbers)
    return numbers


@dataclass(frozen=True, eq=False)
class Flight:
    """A wing, posed.

    Parameters
    ----------
    case : Case
        What flies.
    model : FittedModel
        Its grid.
    problem : om.Problem
        Its flow by the Euler equations.
    """

    case: Case
    model: FittedModel
    problem: om.Problem

    @classmethod
    def of(cls, case: Case, size, iprint: int) -> Flight | None:
        """Pose a case at one of its sizes; None where there is no grid."""
        model = case.make_model(size)
        return None if model is None else cls(case, model, flow_problem(model, case.condition, iprint=iprint))

    def fly(self, openfoam: bool) -> tuple[dict, dict[str, np.ndarray]]:
        """Fly with every code: its numbers, and the pressures that are drawn."""
        codes, pressures = {"EulerFlow": run_euler(self.problem)}, {"EulerFlow": self.problem.get_val("Cp")}
        codes["LatticeFlow"] = self.lattice()
        if openfoam:
            codes["OpenFOAM"], found = run_openfoam(self.problem, self.model, self.case.condition)
            pressures |= {} if found is None else {"OpenFOAM": found}
        return {"codes": codes, "references": self.case.references}, pressures

    def lattice(self) -> dict:
        """Fly with the vortex lattice, or tell why not."""
        try:
            return run_timed(flow_problem(self.model, self.case.condition, LatticeFlow))
        except InputError as error:
            return {"refused": str(error)}


def draw(folder, flights: dict[str, Flight], pressures: dict[str, dict], numbers: dict) -> None:
    """Draw for every wing pressures around it, and drag over lift by every code."""
    with figure(folder, "wing_flow_table", size=(8.6, 3.6 * len(flights))) as canvas:
        for (around, polar), (name, flight) in zip(canvas.subplots(len(flights), 2, squeeze=False), flights.items()):
            quads = nodes_of(flight.problem)[wall_quads(flight.model)]
            for code, found in pressures[name].items():
                draw_pressures(around, quads, found, flight.case.place, {"label": code, **STYLES[code]})
            around.set(title=f"{flight.case.title}, $z$ = {flight.case.place:g} m")
            around.legend()
            draw_coefficients(polar, numbers[name])


def draw_coefficients(axes, found: dict) -> None:
    """Draw drag over lift: dots for forces on the walls, rings for the induced drag, squares for references."""
    for marker, codes in (("o", found["codes"]), ("s", found["references"])):
        for code, values in codes.items():
            label = code if marker == "o" else f"{code}, reference"
            for name, fill in (("CD", "full"), ("CD_induced", "none")):
                if {"CL", name} <= set(values):
                    axes.plot(values["CL"], values[name], marker, color=COLORS[code], fillstyle=fill, label=label)
                    label = None
    axes.margins(0.1)
    axes.set(xlabel="$C_L$", ylabel="$C_D$, induced (open)", ylim=(0.0, None))
    axes.legend(fontsize=8)


if __name__ == "__main__":
    run(main, __doc__, **OPTIONS)
