"""Validation: ONERA M6.

The ONERA M6 wing at Mach 0.8395 and 3.06 degrees, compared with measured pressures and another Euler solver. It takes
some minutes, with ``--quick`` half a minute, and half an hour at the paper's size. The output is lift and drag on two
grids, how far the pressures are from the measured ones at seven stations along the span, if a file has them, and a
picture of both.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.flow import run_flow
from bspline_mdao.names import GRID
from bspline_mdao.plotting import BLUE, RED, faces_around, figure, wall_quads
from bspline_mdao.scripts import pick_size, run

MACH, ALPHA = 0.8395, 3.06
"""Of the stream; angle of attack (deg)."""

STATIONS = (0.20, 0.44, 0.65, 0.80, 0.90, 0.95, 0.99)
"""Where pressures were measured, by the semi-span."""

SU2 = {"CL": 0.280800, "CD": 0.008623, "area": 0.7588 / 0.8059**2}
"""SU2 8.4, central differences, 582,752 tetrahedra: values of its regression test ``oneram6``, serial, converged.

Its area (root chords squared) is the area of the wing seen from above, with the rounded tip.
"""

SIZES = {
    "quick": (((5, 9, 5), (7, 7), (7, 5)), ((7, 13, 7), (9, 9), (9, 5))),
    "default": (((9, 17, 9), (13, 13), (13, 7)), ((13, 25, 13), (17, 17), (17, 9))),
    "paper": (((13, 25, 13), (17, 17), (17, 9)), ((19, 37, 19), (25, 25), (25, 13))),
}
"""Nodes of the rows of blocks along the stream, away from the wing and along the span, of two grids."""


def main(paper: bool = False, figures=None, quick: bool = False, iprint: int = 0, measured: str = "") -> dict:
    """Solve the flow on two grids.

    Parameters
    ----------
    paper, quick : bool
        Another of the sizes.
    figures : path-like, optional
        Folder for ``validation_m6.png``.
    iprint : int
        1 for a line a flow, 2 for one a Newton step.
    measured : str
        File of the measured pressures as distributed with CFL3D; by default ``flow/onera_m6_experiment_cfl3d.dat`` next
        to the folder that ``BSPLINE_MDAO_GRIDS`` names, if it is there.

    Returns
    -------
    dict
        ``members``, a list of what `run_flow` returns; ``SU2``, its lift and drag by the same area; and where there are
        measured pressures ``Cp_difference``, the root mean square difference from them at each station.
    """
    planform = bm.generators.onera_m6_planform()
    area = 2.0 * planform.semi_span**2 / planform.aspect_ratio
    members = []
    for shape in pick_size(SIZES, paper, quick):
        model = bm.fit_grid(bm.generators.onera_m6_grid(shape, far_field=bm.generators.FarField(distance=20.0)))
        problem = flow_problem(model, area, iprint)
        members.append(run_flow(problem))
    quads, cp = problem.get_val(GRID).reshape(-1, 3)[wall_quads(model)], problem.get_val("Cp")
    numbers = {"members": members, "SU2": {key: SU2[key] * SU2["area"] / area for key in ("CL", "CD")}}
    file = Path(
        measured or Path(os.environ.get("BSPLINE_MDAO_GRIDS", ".")).parent / "flow/onera_m6_experiment_cfl3d.dat"
    )
    points = read_measured(file) if measured or file.is_file() else {}
    if points:
        numbers["Cp_difference"] = {
            f"{at:g}": difference(quads, cp, at * planform.semi_span, points[at]) for at in points
        }
    if figures:
        draw(figures, quads, cp, planform.semi_span, points)
    return numbers


def flow_problem(model: bm.FittedModel, area: float, iprint: int) -> om.Problem:
    """Pose the flow."""
    flow = bm.EulerFlow(model=model, reference_area=area, iprint=iprint)
    problem = om.Problem(flow, reports=None)
    problem.setup(mode="rev")
    problem.set_val("Mach_number", MACH)
    problem.set_val("alpha", ALPHA, units="deg")
    return problem


def read_measured(file: Path) -> dict[float, np.ndarray]:
    """Read chord fraction, pressure coefficient and side, +1 upper, of the orifices at each station, shape (n, 3)."""
    points: dict[float, list] = {}
    side = 0.0
    for line in file.read_text().splitlines():
        words = line.split()
        if "ETA=" in line:
            rows, side = points.setdefault(float(line.split("ETA=")[1]), []), 0.0
        elif "SURFACE" in line:
            side = 1.0 if "UPPER" in line else -1.0
        elif side and len(words) == 3:
            rows.append((float(words[1]), float(words[2]), side))
    return {station: np.array(rows) for station, rows in points.items()}


def section(quads: np.ndarray, place: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Wall faces at a place along the span, their chord fractions, and which are on the upper side."""
    around = faces_around(quads, place)
    planform, middles = bm.generators.onera_m6_planform(), quads[around].mean(axis=1)
    ends = planform.x(0.0, middles[:, 2]), planform.x(1.0, middles[:, 2])
    return around, (middles[:, 0] - ends[0]) / (ends[1] - ends[0]), middles[:, 1] > 0.0


def difference(quads: np.ndarray, cp: np.ndarray, place: float, points: np.ndarray) -> float:
    """Root mean square difference from measured pressures, between faces linearly."""
    around, fractions, is_upper = section(quads, place)
    gaps = []
    for side, faces in ((1.0, is_upper), (-1.0, ~is_upper)):
        order = np.argsort(fractions[faces])
        here = points[points[:, 2] == side]
        gaps.append(np.interp(here[:, 0], fractions[faces][order], cp[around][faces][order]) - here[:, 1])
    return float(np.sqrt(np.mean(np.concatenate(gaps) ** 2)))


def draw(folder, quads: np.ndarray, cp: np.ndarray, semi_span: float, points: dict[float, np.ndarray]) -> None:
    """Draw pressures at the stations on the finest grid, and those measured."""
    with figure(folder, "validation_m6", size=(11.0, 5.6)) as canvas:
        panels = canvas.subplots(2, 4, sharey=True).ravel()
        for station, axes in zip(STATIONS, panels):
            around, fractions, _ = section(quads, station * semi_span)
            axes.plot(fractions, cp[around], ".", color=BLUE, markersize=3, label="EulerFlow")
            if station in points:
                axes.plot(*points[station][:, :2].T, "o", color=RED, markersize=3, fillstyle="none", label="measured")
            axes.set(title=f"$z / b$ = {station:.2f}", xlabel="$x / c$")
        panels[0].invert_yaxis()  # of all
        panels[0].set_ylabel("$C_p$")
        panels[0].legend(fontsize=9)
        panels[-1].set_axis_off()


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/validation_m6.png'
