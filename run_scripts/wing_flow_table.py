"""Lift and drag of wings by three methods.

Lift and drag of wings at Mach 0.3 by the Euler equations, by a vortex lattice and by other codes, in one table. It
takes some minutes, with ``--quick`` half a minute, and an hour at the paper's size. The rectangular wing needs the grid
``hh_naca0012_12blocks.xyz`` in the folder that ``BSPLINE_MDAO_GRIDS`` names, and is skipped without it. The output is
the coefficients of each wing by every available code, and a picture of the pressures and of drag over lift.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.flow import openfoam_forces, run_flow
from bspline_mdao.grids import guess_patches
from bspline_mdao.names import GRID
from bspline_mdao.plotting import BLUE, GREEN, ORANGE, PURPLE, RED, draw_pressures, figure, wall_quads
from bspline_mdao.scripts import pick_size, run

COLORS = {"EulerFlow": BLUE, "LatticeFlow": GREEN, "OpenFOAM": ORANGE, "ADflow": RED, "vortex lattice": PURPLE}
TITLES = {"hh_naca0012": "rectangular wing NACA 0012, 4°", "onera_m6": "ONERA M6, 3.06°"}
MACH = 0.3

ALPHAS = {"hh_naca0012": 4.0, "onera_m6": 3.06}
"""Angles of attack (deg)."""

PLACES = {"hh_naca0012": 1.5, "onera_m6": 0.65}
"""Places along the span where pressures are drawn (m)."""

SIZES = {
    "hh_naca0012": {"quick": 0.5, "default": 1.0, "paper": 1.5},
    "onera_m6": {"quick": (7, 9, 7), "default": (15, 17, 13), "paper": (23, 33, 17)},
}
"""Cells per direction, relative to the grid of the first wing; nodes of each block about the second."""

REFERENCES = {
    "hh_naca0012": {
        "ADflow": {"CL": 0.3116, "CD": 0.0206},
        "OpenFOAM": {"CL": 0.3050, "CD": 0.0114},
        "vortex lattice": {"CL": 0.3064, "CD_induced": 0.0050},
    },
    "onera_m6": {},
}
"""Results of other codes on the same 36,864 cells: ADflow's Euler equations with central differences and scalar
dissipation, OpenFOAM's rhoSimpleFoam with linearUpwind, and OpenAeroStruct with Prandtl-Glauert."""


def main(paper: bool = False, figures=None, quick: bool = False, openfoam: bool = False, iprint: int = 0) -> dict:
    """Solve both wings with every available code.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`.
    figures : path-like, optional
        Folder for ``wing_flow_table.png``.
    openfoam : bool
        Ask OpenFOAM as well, where it is installed.
    iprint : int
        1 for a line a flow, 2 for one a Newton step.

    Returns
    -------
    dict
        For ``hh_naca0012`` and ``onera_m6``: ``codes`` with what `run_flow` returns of ``EulerFlow`` and of
        ``LatticeFlow``, and ``OpenFOAM`` if it was asked; and ``references``. Or ``skipped``, and why.
    """
    numbers = {"hh_naca0012": {"skipped": "set BSPLINE_MDAO_GRIDS to the folder of the grid"}}
    pressures = {}
    for name, sizes in SIZES.items():
        if name == "onera_m6" or os.environ.get("BSPLINE_MDAO_GRIDS"):
            model, area = make_model(name, pick_size(sizes, paper, quick))
            codes, pressures[name] = fly(name, model, area, openfoam, iprint)
            numbers[name] = {"codes": codes, "references": REFERENCES[name]}
    if figures:
        draw(figures, pressures, numbers)
    return numbers


def make_model(name: str, size) -> tuple[bm.FittedModel, float]:
    """Fit the grid about a wing; returns the area of the half wing (m^2) too."""
    if name == "onera_m6":
        planform = bm.generators.onera_m6_planform()
        area = 0.5 * (planform.root_chord + planform.tip_chord) * planform.semi_span
        return bm.fit_grid(bm.generators.onera_m6_grid(size)), area
    grid = bm.read_grid(Path(os.environ["BSPLINE_MDAO_GRIDS"]) / "hh_naca0012_12blocks.xyz")
    windows = [face.window for face in bm.find_topology(grid).boundary]
    grid = replace(grid, patches=guess_patches(grid, windows))
    # three control points for four nodes keep the wall of the members within 0.0005 chords of the grid's
    n_control = [tuple(int(np.ceil(0.75 * n)) for n in block.nodes.shape[:3]) for block in grid.blocks]
    model = bm.fit_grid(grid, n_control=n_control)
    return model if size == 1.0 else model.member(size), 3.0


def fly(name: str, model: bm.FittedModel, area: float, openfoam: bool, iprint: int) -> tuple[dict, dict]:
    """Solve with every code: numbers by its name, and, if it has them, corners of wall faces and pressures."""
    codes, pressures = {}, {}
    for code, make_flow in {"EulerFlow": bm.EulerFlow, "LatticeFlow": bm.LatticeFlow}.items():
        try:
            options = {"iprint": iprint} if code == "EulerFlow" else {}
            problem = om.Problem(make_flow(model=model, reference_area=area, **options), reports=None)
            problem.setup(mode="rev")
            problem.set_val("Mach_number", MACH)
            problem.set_val("alpha", ALPHAS[name], units="deg")
            codes[code] = run_flow(problem)
        except bm.InputError as error:  # OpenAeroStruct is not installed
            codes[code] = {"refused": str(error)}
        if code == "EulerFlow":
            nodes = problem.get_val(GRID).reshape(-1, 3)
            pressures[code] = nodes[wall_quads(model)], problem.get_val("Cp")
    if openfoam:
        try:
            found = openfoam_forces(model.topology, nodes, MACH, ALPHAS[name], area)
            names = ("CL", "CD", "seconds", "n_iterations", "is_converged")
            codes["OpenFOAM"] = {key: getattr(found, key) for key in names} if found else {"refused": "not installed"}
            pressures |= {"OpenFOAM": (nodes[wall_quads(model)], found.Cp)} if found else {}
        except (bm.InputError, bm.SolverError) as error:
            codes["OpenFOAM"] = {"refused": str(error)}
    return codes, pressures


def draw(folder, pressures: dict, numbers: dict) -> None:
    """Draw for every wing pressures around it, and drag over lift: dots, rings for induced drag, squares references."""
    with figure(folder, "wing_flow_table", size=(8.6, 3.6 * len(pressures))) as canvas:
        for (around, polar), name in zip(canvas.subplots(len(pressures), 2, squeeze=False), pressures):
            for code, (quads, values) in pressures[name].items():
                dots = {} if code == "EulerFlow" else {"marker": ".", "markersize": 4, "linestyle": ""}
                draw_pressures(around, quads, values, PLACES[name], label=code, color=COLORS[code], **dots)
            around.set(title=f"{TITLES[name]}, $z$ = {PLACES[name]:g} m")
            around.legend()
            for marker, kind in (("o", "codes"), ("s", "references")):
                for code, values in numbers[name][kind].items():
                    label = code if marker == "o" else f"{code}, reference"
                    for drag, fill in (("CD", "full"), ("CD_induced", "none")):
                        if {"CL", drag} <= set(values):
                            look = {"color": COLORS[code], "fillstyle": fill, "label": label}
                            polar.plot(values["CL"], values[drag], marker, **look)
                            label = None
            polar.margins(0.1)
            polar.set(xlabel="$C_L$", ylabel="$C_D$, induced (open)", ylim=(0.0, None))
            polar.legend(fontsize=8)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/thumbnails/wing_flow_table.png'
