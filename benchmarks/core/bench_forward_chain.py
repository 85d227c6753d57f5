"""Files, functions and frames of this package that one run from a twist to the quality of the grid walks.

The run is the second one of its problem, at another twist: nothing is set up or compiled. Frames are those of functions
of this package, kernels included, on one thread; OpenMDAO's own do not count. What is deepest of each component shows
where a reader has to go farthest.

Two counts are printed. The first has everything, and the targets are meant for it. The second leaves out what nobody
opens to follow the chain: `SERVICES`, which are known by their names, and frames of lambdas and comprehensions, which
stand where they are called and of which Python 3.12 has fewer.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from types import CodeType

import openmdao.api as om

import bspline_mdao
from bspline_mdao import DesignSurface, GridMovement, fit_grid
from bspline_mdao.design import Twist
from bspline_mdao.generators import flat_plate_grid, onera_m6_grid

PACKAGE = Path(bspline_mdao.__file__).parent
SERVICES = ("base/checks.py", "base/numerics/processes.py", "base/numerics/threads.py", "base/sparse/lapack.py")
"""Checks of inputs, agreement of processes, threads, and where LAPACK is."""

GRIDS = {"plate": lambda: flat_plate_grid((5, 5, 5)), "wing": lambda: onera_m6_grid((7, 8, 7))}


class Walk:
    """Calls of this package's functions while it is the profile function of `sys.setprofile`."""

    def __init__(self):
        self.stack: list[str] = []
        self.called: list[str] = []
        self.deepest: dict[str, list[str]] = {}
        self.depth_read = 0  # of the frames that a reader follows

    def __call__(self, frame, event: str, _) -> None:
        """Count a call, or take it off the stack."""
        if not frame.f_code.co_filename.startswith(f"{PACKAGE}/"):
            return
        if event == "call":
            self.stack.append(name_of(frame.f_code))
            self.called.append(self.stack[-1])
            self.depth_read = max(self.depth_read, sum(map(is_read, self.stack)))
            if len(self.stack) > len(self.deepest.get(self.stack[0], ())):
                self.deepest[self.stack[0]] = list(self.stack)
        elif event == "return":
            self.stack.pop()


def name_of(code: CodeType) -> str:
    """File and name of a function."""
    return f"{Path(code.co_filename).relative_to(PACKAGE).as_posix()}:{code.co_name}"


def is_read(name: str) -> bool:
    """Whether a function is one that a reader follows: no service, lambda or comprehension."""
    file, function = name.split(":")
    return file not in SERVICES and not function.startswith("<")


def main(grid: str = "plate") -> dict:
    """Walk one run.

    Parameters
    ----------
    grid : {"plate", "wing"}
        Thin flat plate, or wing with a residual of the fit.

    Returns
    -------
    dict
        Numbers of calls, functions and files, the depth, both of what a reader follows, the files, and the deepest
        stack below every entry.
    """
    wing = DesignSurface.of(fit_grid(GRIDS[grid]()))
    shape = wing.parametrization([Twist("twist", wing.axis, stations=2)])
    problem = om.Problem(GridMovement(model=wing.model, parametrization=shape, fit=False), reports=None)
    problem.setup()
    for degrees in (-3.0, -2.0):
        walk = Walk()
        problem.set_val("twist", [0.0, degrees], units="deg")
        sys.setprofile(walk)
        try:
            problem.run_model()
        finally:
            sys.setprofile(None)
    files = sorted({name.split(":")[0] for name in walk.called})
    read = {name for name in walk.called if is_read(name)}
    return {
        "calls": len(walk.called),
        "functions": len(set(walk.called)),
        "files": len(files),
        "depth": max(map(len, walk.deepest.values())),
        "files_read": len({name.split(":")[0] for name in read}),
        "depth_read": walk.depth_read,
        "names_of_files": files,
        "deepest": {entry: stack for entry, stack in walk.deepest.items() if len(stack) > 1},
    }


def report(numbers: dict) -> None:
    """Print the numbers and the deepest stacks."""
    print(f"{numbers['calls']} calls of {numbers['functions']} functions in {numbers['files']} files", end=", ")
    print(f"{numbers['depth']} deep (targets: 30 files, 12 deep)")
    print(f"of which a reader follows {numbers['files_read']} files, {numbers['depth_read']} deep")
    for stack in numbers["deepest"].values():
        print(f"\n{len(stack):3} frames")
        for name in stack:
            print(f"    {name}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("grid", nargs="?", choices=GRIDS, default="plate")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    options = parser.parse_args()
    numbers = main(options.grid)
    report(numbers)
    if options.json:
        options.json.write_text(json.dumps(numbers, indent=2) + "\n")
