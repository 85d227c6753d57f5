"""Large grids with boundary layers by the command line: time and peak memory of a fit, a move and a look at the cells.

Every command runs in a process of its own. The grids: pyHyp's M6 with twice the cells in each direction, 1.3 million
nodes; NASA's turbine passage, 2.3 million; and an H-H grid about the M6 with the first nodes 1e-6 off the wall, 5
million. The first two need the folder ``BSPLINE_MDAO_GRIDS``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bspline_mdao import write_grid
from bspline_mdao.generators import Spacing, onera_m6_grid

FOLDER = Path(os.environ.get("BSPLINE_MDAO_GRIDS", "."))

TURBINE = """
[[patch]]
name = "blade"
kind = "wall"
faces = [{ block = 1, face = "kmin" }]

[[patch]]
name = "ends"
kind = "other"
faces = [{ block = 1, face = "jmin" }, { block = 1, face = "jmax" },
         { block = 2, face = "jmin" }, { block = 2, face = "jmax" }]

[[patch]]
name = "periodic"
kind = "other"
faces = [{ block = 1, face = "kmax", i = [1, 129] }, { block = 2, face = "kmin", i = [1, 41] },
         { block = 2, face = "kmin", i = [169, 269] }, { block = 2, face = "kmax" }]

[[patch]]
name = "ducts"
kind = "farfield"
faces = [{ block = 2, face = "imin" }, { block = 2, face = "imax" }]
"""
"""Patches of the turbine."""


def pyhyp(folder: Path) -> list[str]:
    """Make the refined M6, and give the arguments of its fit."""
    source, patches = FOLDER / "pyhyp_m6_9blocks.xyz", folder / "m6.toml"
    call("inspect", source, "--draft", patches)
    call("fit", source, "--patches", patches, "-o", folder / "coarse.h5")
    call("refine", folder / "coarse.h5", "--factor", "2", "-o", folder / "m6.xyz")
    call("inspect", folder / "m6.xyz", "--draft", patches)
    return [folder / "m6.xyz", "--patches", patches]


def turbine(folder: Path) -> list[str]:
    """Give the arguments of the fit of the turbine."""
    (folder / "turbine.toml").write_text(TURBINE)
    return [FOLDER / "nasa_vspt_turbine.xyz.gz", "--patches", folder / "turbine.toml"]


def hh_wing(folder: Path, shape=(65, 97, 65)) -> list[str]:
    """Make the H-H grid, and give the arguments of its fit."""
    write_grid(folder / "hh.cgns", onera_m6_grid(shape, Spacing(off_wall=1e-6)))
    return [folder / "hh.cgns"]


CASES = {
    "pyhyp": (pyhyp, ["twist=5deg"]),
    "turbine": (turbine, ["twist=1deg", "--release", "ends", "--release", "periodic"]),
    "hh_wing": (hh_wing, ["twist=5deg"]),
    "small": (lambda folder: hh_wing(folder, (11, 17, 9)), ["twist=1deg"]),
}
"""Grids, and how each is moved. Hub, casing and periodic planes of the turbine move with its blade."""


def main(cases=("pyhyp", "turbine", "hh_wing"), n_control: int | None = None) -> dict:
    """Run the commands.

    Parameters
    ----------
    cases : sequence of str
        Which of `CASES`.
    n_control : int, optional
        Control points in each direction of every block; chosen from the grid by default.

    Returns
    -------
    dict
        For each case, ``seconds`` (wall clock and CPU) and ``gigabytes`` (peak of the process) of ``fit``, ``move`` and
        ``quality``, and the numbers that they report.
    """
    results = {}
    for name in cases:
        make, deformation = CASES[name]
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            model, moved, numbers = folder / "model.h5", folder / "moved.xyz", folder / "numbers.json"
            counts = ["--n-control", "x".join([str(n_control)] * 3)] if n_control else []
            results[name] = {
                "fit": call("fit", *make(folder), *counts, "-o", model, numbers=numbers),
                "move": call("move", model, "--deform", *deformation, "--allow-invalid", "-o", moved, numbers=numbers),
                "quality": call("quality", moved, numbers=numbers),
            }
        show(name, results[name])
    return results


def call(*arguments, numbers: Path | None = None) -> dict:
    """Run a command in a process of its own, and measure it.

    Returns
    -------
    dict
        ``wall`` and ``cpu`` (s), ``gigabytes`` and what the command writes to ``numbers``.

    Raises
    ------
    RuntimeError
        If the command fails.
    """
    told = ["--json", numbers] if numbers else []
    words = [sys.executable, "-m", "bspline_mdao", *map(str, [*arguments, *told])]
    start = time.perf_counter()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{' '.join(words)} ended with {process.returncode}")
    measured = {"wall": wall, "cpu": usage.ru_utime + usage.ru_stime, "gigabytes": usage.ru_maxrss / 2**20}
    return {**measured, "told": json.loads(numbers.read_text()) if numbers else {}}


def show(name: str, case: dict) -> None:
    """Print what a case took, and what became of the grid."""
    fit, move = case["fit"]["told"], case["move"]["told"]
    print(
        f"{name}: {fit['n_nodes']:,} nodes, {fit['n_control_points']:,} control points, "
        f"{fit['n_invalid_control_elements']:,} invalid elements"
    )
    for command, numbers in case.items():
        print(f"  {command:8s} {numbers['wall']:7.1f} s, CPU {numbers['cpu']:7.1f} s, {numbers['gigabytes']:5.2f} GB")
    before, after = move["before"], move["after"]
    print(
        f"  {move['n_increments']} increments, {before['n_inverted']:,} inverted cells before and "
        f"{after['n_inverted']:,} after, smallest Q {before['q_min']:.2e} and {after['q_min']:.2e}",
        flush=True,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", choices=tuple(CASES), default=("pyhyp", "turbine", "hh_wing"))
    parser.add_argument("--n-control", type=int, metavar="N", help="control points in each direction of every block")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    options = parser.parse_args()
    result = main(options.cases, options.n_control)
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n")
