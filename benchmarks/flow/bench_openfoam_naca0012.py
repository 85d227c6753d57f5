"""OpenFOAM's turbulent flow about the NACA 0012 on O-grids, beside what other codes agree on.

A Reynolds number of 6e6, the far field at 100 chords, each flow from the uniform stream to residuals below 1e-6::

    python benchmarks/flow/bench_openfoam_naca0012.py [--around N ...] [--angles DEG ...]
        [--turbulence SpalartAllmaras | kOmegaSST] [--walls resolved | functions]

Grids have N cells around the section. Resolved walls have half as many away from it, and first cells of 7.68e-4 / N
chords; with wall functions it is three eighths of N, and 5e-4 chords on any grid. It needs simpleFoam on the PATH.

References
----------
C. L. Rumsey, "Turbulence Modeling Resource: 2D NACA 0012 Airfoil Validation", NASA Langley, turbmodels.larc.nasa.gov:
compressible flow at Mach 0.15 by the model of Spalart and Allmaras, the far field at 500 chords.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from pathlib import Path
from typing import get_args

import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.flow import OpenFoamFlow, RansCase
from bspline_mdao.flow.openfoam.rans_case import Turbulence, WallTreatment

REYNOLDS, SPEED, FAR, THICKNESS = 6e6, 30.0, 100.0, 0.12
"""Of the chord; speed (m/s), where the far field is (chords), and thickness of the section."""

OTHERS = {0.0: (0.0, 81.0), 10.0: (1.09, 123.0)}
"""Lift coefficient and counts of drag that seven codes agree on, by angle (deg)."""


def make_grid(n_around: int, walls: WallTreatment) -> tuple[bm.Grid, float]:
    """Make the grid; it, and the height of its first cells (chords)."""
    n_away, off_wall = (n_around // 2, 7.68e-4 / n_around) if walls == "resolved" else (3 * n_around // 8, 5e-4)
    section = bm.generators.naca_section(THICKNESS)
    return bm.generators.section_o_grid(section, n_around, far=FAR, n_away=n_away, off_wall=off_wall), off_wall


def measure(n_around: int, angle: float, case: RansCase) -> dict[str, float]:
    """Solve one angle (deg) on one grid."""
    grid, off_wall = make_grid(n_around, case.walls)
    problem = om.Problem(reports=None)
    with tempfile.TemporaryDirectory() as folder:
        flow = OpenFoamFlow(model=bm.fit_grid(grid), case=case, folder=Path(folder), reference_area=1.0, iprint=0)
        problem.model.add_subsystem("flow", flow, promotes=["*"])
        problem.setup()
        problem.set_val("alpha", angle, units="deg")
        problem.set_val("speed", SPEED, units="m/s")
        start = time.perf_counter()
        problem.run_model()
    numbers = {name: problem.get_val(name).item() for name in ("CL", "CD", "n_iterations")}
    return numbers | {
        "expected": case.expected_y_plus([off_wall]).item(),
        "highest": problem.get_val("y_plus")[1],
        "seconds": time.perf_counter() - start,
    }


def main() -> None:
    """Solve all grids and angles."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--around", type=int, nargs="+", default=[128, 256])
    parser.add_argument("--angles", type=float, nargs="+", default=list(OTHERS))
    parser.add_argument("--turbulence", default="SpalartAllmaras", choices=get_args(Turbulence))
    parser.add_argument("--walls", default="resolved", choices=get_args(WallTreatment))
    arguments = parser.parse_args()
    case = RansCase(REYNOLDS, turbulence=arguments.turbulence, walls=arguments.walls, planes="empty")
    if shutil.which(case.program) is None:
        parser.exit(2, f"{parser.prog}: {case.program} is not on the PATH; on Debian: apt-get install openfoam\n")
    print(f"{arguments.turbulence}, walls {arguments.walls}")
    print("around  angle        CL   counts   y+ expected  highest  iterations  seconds   others: CL  counts")
    for n_around in arguments.around:
        for angle in arguments.angles:
            found = measure(n_around, angle, case)
            theirs = "{:13.2f}{:8.0f}".format(*OTHERS[angle]) if angle in OTHERS else ""
            print(
                f"{n_around:6d}{angle:7.1f}{found['CL']:10.4f}{1e4 * found['CD']:9.2f}{found['expected']:14.2f}"
                f"{found['highest']:9.2f}{found['n_iterations']:12.0f}{found['seconds']:9.1f}{theirs}",
                flush=True,
            )


if __name__ == "__main__":
    main()
