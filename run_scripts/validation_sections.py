"""Validation: NACA 0012.

NACA 0012 at 1.25 degrees, Mach 0.5 and 0.8, compared with published results. It takes a minute or two, with ``--quick``
some seconds, and a quarter of an hour at the paper's size. The output is lift and drag on three O-grids of the kind
that Vassberg and Jameson used and on three H-H grids of this project, their orders and limits, the same on grids of
CFL3D and MACH-Aero if the environment names the folder that has them, and a picture of pressures and of lift and drag
over the cells, with published values.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao import Grid
from bspline_mdao.flow import run_flow
from bspline_mdao.grids import Block, guess_patches
from bspline_mdao.names import GRID
from bspline_mdao.plotting import BLUE, GRAY, GREEN, ORANGE, figure, wall_quads
from bspline_mdao.scripts import pick_size, run

ALPHA = 1.25
"""Angle of attack (deg)."""

CHORD = 1.0089304113651427
"""Of the section by the chord of the equation of NACA, where its thickness is zero."""

SECTION = bm.generators.naca_section(0.12, extended=True)
"""That of Vassberg and Jameson: the equation of NACA until it closes, scaled to unit chord."""

CELLS = np.array([256, 512, 1024, 2048])
PUBLISHED = {
    0.5: (np.array([0.178366720, 0.179125033, 0.179487608, 0.179650543]) / CHORD, 0.179783519 / CHORD),
    0.8: (np.array([0.359073197, 0.357580694, 0.355943711, 0.354593186]) / CHORD, 0.348226045 / CHORD),
}
"""Lift by Mach number on O-grids of so many cells each way, and its limit: CFL3D, flux splitting, no vortex far away.

J. C. Vassberg and A. Jameson, J. Aircraft 47 (2010), 1152-1166, Tables 7 and 8, read in a copy of these rows. The
limits are from the last three values, at the orders 1.154 and 0.278. They are by a chord of one, and here by that
of the section: potential flow has 0.18035 by the former, and the paper 0.1803 where it is grid-converged.
"""

POTENTIAL = {0.5: 0.17875}
"""Lift of the section by the equation of the full potential, spectrally in the plane of its circle."""

GALERKIN = {0.8: {"CL": 0.333, "CD": 0.02135}}
"""V. Dolejší and F. Roskovec, Commun. Appl. Math. Comput. (2021), as cited by others: not seen in the original."""

SIZES = {"quick": (16, 32, 64), "default": (32, 64, 128), "paper": (64, 128, 256)}
"""Cells around the section in O-grids; half as many along each side of it in H-H grids."""

OTHERS = {"cfl3d_naca0012_cgrid.fmt": ("C-grid, CFL3D", "xyz"), "mach_naca0012.cgns": ("O-grid, MACH-Aero", "xzy")}
"""Files of other projects, in the folder that ``BSPLINE_MDAO_GRIDS`` names: labels, and axes downstream, along the span
and up. Every second node is taken."""

COLORS = {"O": BLUE, "H-H": ORANGE}
"""Of the families."""


def main(paper: bool = False, figures=None, quick: bool = False, iprint: int = 0) -> dict:
    """Solve the flows on all grids.

    Parameters
    ----------
    paper, quick : bool
        Another of the sizes; grids of other projects are left out when quick.
    figures : path-like, optional
        Folder for ``validation_sections.png``.
    iprint : int
        1 for a line a flow, 2 for one a Newton step.

    Returns
    -------
    dict
        By Mach number, such as ``"M 0.5"``, for the families ``O`` and ``H-H``: ``members``, a list of what `run_flow`
        returns, and for ``CL`` and ``CD`` the order and the limit of the three, None where there are none; the lift
        published, and in potential flow where there are no shocks; and for other grids what `run_flow` returns, or
        why they ``failed``.
    """
    numbers, drawn = {}, {}
    for mach in PUBLISHED:
        numbers[f"M {mach:g}"] = {"CL_published": PUBLISHED[mach][1], "CL_potential": POTENTIAL.get(mach)}
    for family, make in (("O", o_grid), ("H-H", hh_grid)):
        models = [bm.fit_grid(make(n)) for n in pick_size(SIZES, paper, quick)]
        for mach in PUBLISHED:
            solved = [solve(model, mach, "xzy", iprint) for model in models]
            members, drawn[mach, family] = [member for member, _ in solved], solved[-1][1]
            limits = {key: limit(np.array([member[key] for member in members])) for key in ("CL", "CD")}
            numbers[f"M {mach:g}"][family] = {"members": members} | limits
    folder = os.environ.get("BSPLINE_MDAO_GRIDS")
    for file, (name, axes) in OTHERS.items() if folder and not quick else ():
        model = bm.fit_grid(every_second_node(bm.read_grid(Path(folder) / file)))
        for mach in PUBLISHED:
            try:
                numbers[f"M {mach:g}"][name], _ = solve(model, mach, axes, iprint)
            except om.AnalysisError as error:
                numbers[f"M {mach:g}"][name] = {"failed": str(error)}
    if figures:
        draw(figures, numbers, drawn)
    return numbers


def o_grid(n: int) -> bm.Grid:
    """Make an O-grid of n cells around, and away, to 150 chords."""
    return bm.generators.section_o_grid(SECTION, n)


def hh_grid(n: int) -> bm.Grid:
    """Make an H-H grid of n / 2 cells along each side, to 50 chords."""
    n_side, n_away, coarseness = n // 2, 3 * n // 8 + 1, 64.0 / n
    spacing = bm.generators.Spacing(off_wall=6e-3 * coarseness, leading=8e-3 * coarseness, trailing=8e-3 * coarseness)
    shape, far = ((n_away, n_side + 1, n_away), n_away), bm.generators.FarField(distance=50.0)
    return bm.generators.infinite_wing_grid(SECTION, shape, spacing, far)


def every_second_node(grid: bm.Grid) -> bm.Grid:
    """Make the grid of half the cells in each direction that has more than one, its patches guessed."""
    halved = [block.nodes[tuple(slice(None, None, 2 if n > 2 else 1) for n in block.shape)] for block in grid.blocks]
    bare = Grid(tuple(Block(nodes, block.name) for nodes, block in zip(halved, grid.blocks)))
    patches = guess_patches(bare, [face.window for face in bm.find_topology(bare).boundary])
    return Grid(bare.blocks, patches)


def solve(model: bm.FittedModel, mach: float, axes: str, iprint: int) -> tuple[dict, np.ndarray]:
    """Solve a flow; returns its numbers, and the places along the chord and pressures of the wall faces, (2, n)."""
    options = {"reference_area": 1.0, "axes": axes, "iprint": iprint}
    problem = om.Problem(bm.EulerFlow(model=model, **options), reports=None)
    problem.setup(mode="rev")
    problem.set_val("Mach_number", mach)
    problem.set_val("alpha", ALPHA, units="deg")
    found = run_flow(problem)
    along = problem.get_val(GRID).reshape(-1, 3)[wall_quads(model)].mean(axis=1)[:, 0]
    return found, np.stack([along, problem.get_val("Cp")])


def limit(values: np.ndarray) -> dict | None:
    """Order and limit of values on three grids, each of half the spacing of the one before."""
    first, second = np.diff(values)
    if not first * second > 0.0 or abs(second) >= abs(first):
        return None
    return {"order": np.log2(first / second), "limit": values[2] + second**2 / (first - second)}


def draw(folder, numbers: dict, drawn: dict) -> None:
    """Draw pressures on the finest grids, and lift and drag over the cells each way."""
    with figure(folder, "validation_sections", size=(11.0, 6.8)) as canvas:
        for mach, (pressures, lift, drag) in zip(PUBLISHED, canvas.subplots(2, 3)):
            found = numbers[f"M {mach:g}"]
            for family, color in COLORS.items():
                pressures.plot(*drawn[mach, family], ".", color=color, markersize=3, label=f"{family}-grids")
                members = found[family]["members"]
                cells = np.sqrt([member["n_cells"] for member in members])
                for axes, key in ((lift, "CL"), (drag, "CD")):
                    axes.semilogx(cells, [m[key] for m in members], "o-", color=color, label=f"{family}-grids")
            for (name, _), mark in zip(OTHERS.values(), "D^"):
                for axes, key in ((lift, "CL"), (drag, "CD")) if "CL" in found.get(name, ()) else ():
                    axes.plot(np.sqrt(found[name]["n_cells"]), found[name][key], mark, color=GREEN, label=name)
            values, end = PUBLISHED[mach]
            lift.semilogx(CELLS, values, "s-", color=GRAY, markersize=4, label="CFL3D, O-grids, no vortex")
            lift.axhline(end, color=GRAY, linestyle=":", label="its limit")
            if mach in POTENTIAL:
                lift.axhline(POTENTIAL[mach], color=GRAY, linestyle="--", label="potential flow")
                drag.axhline(0.0, color=GRAY, linestyle="--", label="potential flow")
            for key, value in GALERKIN.get(mach, {}).items():
                {"CL": lift, "CD": drag}[key].axhline(value, color=GRAY, linestyle="-.", label="Galerkin, cited")
            pressures.set(title=f"Mach {mach:g}, {ALPHA:g}°", xlabel="$x / c$", ylabel="$C_p$")
            pressures.invert_yaxis()
            lift.set(xlabel="cells each way", ylabel="$C_L$")
            drag.set(xlabel="cells each way", ylabel="$C_D$")
            for axes, last in ((lift, 2048), (drag, 128)):
                ticks = [32 * 4**n for n in range(4) if 32 * 4**n <= last]
                axes.set_xticks(ticks, ticks)
                axes.minorticks_off()
        handles = {}
        for axes in canvas.axes[1::3]:  # of lift, which has every name
            handles |= dict(zip(*axes.get_legend_handles_labels()[::-1]))
        canvas.legend(handles.values(), handles, loc="outside lower center", ncols=4)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/validation_sections.png'
