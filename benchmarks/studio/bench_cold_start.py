"""First start: what is compiled and how many CPU seconds it takes, of small commands and of a program in Python.

Each runs in a process of its own, the first time with a folder of kernels that holds what those before it have
compiled, at the beginning nothing, and again. ``--check`` ends with 1 where more specialisations are compiled, or more
seconds taken, than `BUDGETS` allow: `.ci/run` asks it. The denominator of the ratio is what no change here can save: a
process that imports OpenMDAO, NumPy, SciPy and numba and ends.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from textwrap import dedent

ROOT = Path(__file__).parents[2]
PROGRAM = ("-m", "bspline_mdao")

CALLS: dict[str, tuple[str, ...]] = {
    "fit": (*PROGRAM, "fit", "@onera_m6", "-o", "m6.h5"),
    "move": (*PROGRAM, "move", "m6.h5", "--deform", "twist=10deg", "-o", "moved.vtm"),
    "quality": (*PROGRAM, "quality", "@onera_m6"),
    "example": ("example.py",),
}
"""Arguments of Python in the order in which a new user runs them; each compiles what those before it did not."""

ASKED = {"fit": 7.0, "move": 12.0, "example": 20.0}
"""CPU seconds that a first run should not exceed on an idle machine."""

BUDGETS = {"fit": (81, 50.0), "move": (165, 80.0), "quality": (2, 8.0), "example": (175, 145.0)}
"""Specialisations compiled, and CPU seconds, that ``--check`` allows: to go down only. Today 79, 162, none and 172 are
compiled. The seconds are twice what a busy machine took: 25, 39, 1.4 and 71."""

IMPORTS = "import openmdao.api, numpy, scipy.sparse.linalg, numba"


def main(calls: Sequence[str] = tuple(CALLS), *, again: bool = True) -> dict:
    """Run what is asked with no kernels, and again.

    Parameters
    ----------
    calls : sequence of str
        Which of `CALLS`.
    again : bool
        Whether each runs a second time.

    Returns
    -------
    dict
        Specialisations compiled, CPU seconds of first and second runs, and of the imports alone.
    """
    with tempfile.TemporaryDirectory() as folder:
        kernels = Path(folder, "kernels")
        paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        one = {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OPENMDAO_REPORTS": "0"}
        environment = {**os.environ, **one, "NUMBA_CACHE_DIR": str(kernels), "PYTHONPATH": paths}
        Path(folder, "example.py").write_text(example())
        _cpu_seconds(["-c", IMPORTS], folder, environment)  # so that modules are in the memory of the system
        imports = _cpu_seconds(["-c", IMPORTS], folder, environment)
        results = {"imports": imports}
        for name in calls:
            before = len(list(kernels.rglob("*.nbc")))
            first = _cpu_seconds(CALLS[name], folder, environment)
            row = {"compiled": len(list(kernels.rglob("*.nbc"))) - before, "first": first}
            row["second"] = _cpu_seconds(CALLS[name], folder, environment) if again else None
            results[name] = {**row, "first_by_imports": first / imports}
    return results


def example() -> str:
    """Lines of the program of the page on Python, without the picture at their end, which needs an extra."""
    page = (ROOT / "docs/in_python.rst").read_text(encoding="utf-8")
    program = re.findall(r"code-block:: python\n\n((?:   .*\n|\n)+)", page)[0]
    return "".join(line for line in dedent(program).splitlines(keepends=True) if "plot" not in line)


def beyond(results: dict) -> list[str]:
    """Say what is beyond its budget."""
    said = []
    for name, (n_allowed, seconds) in BUDGETS.items():
        row = results.get(name)
        if row and row["compiled"] > n_allowed:
            said.append(f"{name} compiles {row['compiled']} specialisations of kernels, {n_allowed} are allowed")
        if row and row["first"] > seconds:
            said.append(f"first {name} takes {row['first']:.1f} s of CPU, {seconds:.0f} are allowed")
    return said


def _cpu_seconds(arguments: Sequence[str], folder: str, environment: dict[str, str]) -> float:
    """CPU seconds of a Python process, its threads included."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def show(results: dict) -> None:
    """Print the figures as a table."""
    print(f"imports alone: {results['imports']:.1f} s of CPU")
    print(f"{'call':9s}{'compiled':>9s}{'first (s)':>11s}{'asked':>8s}{'again (s)':>11s}{'first / imports':>17s}")
    for name in CALLS:
        if name in results:
            row, asked = results[name], f"{ASKED[name]:.0f}" if name in ASKED else ""
            again = "" if row["second"] is None else f"{row['second']:.1f}"
            ratio = row["first_by_imports"]
            print(f"{name:9s}{row['compiled']:9d}{row['first']:11.1f}{asked:>8s}{again:>11s}{ratio:17.1f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    parser.add_argument("--check", action="store_true", help="first runs alone, and 1 as status beyond the budgets")
    arguments = parser.parse_args()
    measured = main(again=not arguments.check)
    show(measured)
    if arguments.json:
        arguments.json.write_text(json.dumps(measured, indent=1))
    if arguments.check and (complaints := beyond(measured)):
        sys.exit("\n".join(complaints))
