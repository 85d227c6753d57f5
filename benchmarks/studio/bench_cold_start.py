"""First start: CPU seconds of small commands with nothing compiled yet, and again with all kernels on the disk.

Each command runs in a process of its own, with its kernels in a folder that is new to the first run. The denominator of
the ratio is what no change here can save: a process that imports OpenMDAO, NumPy, SciPy and numba and ends.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

COMMANDS = {
    "fit": ("fit", "@onera_m6", "-o", "m6.h5"),
    "move": ("move", "m6.h5", "--deform", "twist=10deg", "-o", "moved.vtm"),
    "quality": ("quality", "@onera_m6"),
}
"""Commands in the order in which a new user runs them; each compiles what those before it did not."""

LIMITS = {"fit": 7.0, "move": 12.0}
"""CPU seconds that a first run should not exceed on an idle machine."""

IMPORTS = "import openmdao.api, numpy, scipy.sparse.linalg, numba"


def main(commands=tuple(COMMANDS)) -> dict:
    """Run the commands twice each.

    Parameters
    ----------
    commands : sequence of str
        Which of `COMMANDS`.

    Returns
    -------
    dict
        CPU seconds of first and second runs, and of the imports alone.
    """
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(Path(folder, "kernels"))}
        _cpu_seconds(["-c", IMPORTS], folder, environment)  # so that modules are in the memory of the system
        imports = _cpu_seconds(["-c", IMPORTS], folder, environment)
        results = {"imports": imports}
        for name in commands:
            call = ["-m", "bspline_mdao", *COMMANDS[name]]
            first, second = (_cpu_seconds(call, folder, environment) for _ in range(2))
            results[name] = {"first": first, "second": second, "first_by_imports": first / imports}
    return results


def _cpu_seconds(arguments: list[str], folder: str, environment: dict[str, str]) -> float:
    """CPU seconds of a Python process, its threads included."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def show(results: dict) -> None:
    """Print the figures as a table."""
    print(f"imports alone: {results['imports']:.1f} s of CPU")
    print(f"{'command':9s}{'first (s)':>11s}{'asked':>8s}{'again (s)':>11s}{'first / imports':>17s}")
    for name in COMMANDS:
        if name in results:
            row, limit = results[name], LIMITS.get(name)
            asked = "" if limit is None else f"{limit:.0f}"
            print(f"{name:9s}{row['first']:11.1f}{asked:>8s}{row['second']:11.1f}{row['first_by_imports']:17.1f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    arguments = parser.parse_args()
    measured = main()
    show(measured)
    if arguments.json:
        arguments.json.write_text(json.dumps(measured, indent=1))
