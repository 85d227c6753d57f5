"""A process of ``warm-up``: runs usual commands on tiny grids, and tells what kernels they need.

``python -m bspline_mdao.studio.cli.warm_up_worker CHAIN LOCKS`` runs in a folder of its own. Each line that it prints
begins with a word: ``ran`` and a command, ``compiles`` and a kernel, ``needs`` and all kernels at the end.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import TextIO

from ...base.shared_compilation import shared_compilation
from .main import run

TINY = "@onera_m6:9x9x7"
"""Grid of chains that solve a flow. Where it is larger, the move factorizes by other kernels: the chain of these has
the default size."""

EULER = """
[grid]
file = "m6.h5"

[variables.twist]
stations = 3
values = [2, 3]
lower = -6.0
upper = 6.0
ref = 3.0

[flow]
kind = "euler"
Mach_number = 0.5
trim = true
CL_target = 0.25

[objective]
of = "CD_induced"
ref = 0.005

[constraints.corner_ks]
lower = 0.05

[driver]
optimizer = "LD_SLSQP"
max_iterations = 2
"""
"""Study of the Euler equations, which is README's example: `init` drafts it where no vortex lattice is there."""

FIT = ("fit", TINY, "-o", "m6.h5")

CHAINS: dict[str, tuple[tuple[str, ...], ...]] = {
    "flow": (FIT, ("optimize", "euler.toml", "-o", "flow")),
    "move": (
        ("fit", "@onera_m6", "-o", "m6.h5"),
        ("move", "m6.h5", "--deform", "twist=10deg", "-o", "moved.vtm"),
        ("inspect", "m6.h5"),
    ),
    "airfoil": (
        ("airfoil", "naca0012", "-o", "foil.h5", "--around", "32", "--away", "16"),
        ("init", "foil.h5", "-o", "foil.toml"),
        ("optimize", "foil.toml", "-o", "foil", "--max-iterations", "1"),
    ),
    "quality": (
        ("quality", TINY),
        ("fit", "@onera_m6:17x13x11", "-o", "m6.h5"),
        ("refine", "m6.h5", "-o", "fine.vtm"),
    ),
    "lattice": (
        FIT,
        ("init", "m6.h5", "-o", "wing.toml"),
        ("optimize", "wing.toml", "-o", "wing", "--max-iterations", "1"),
    ),
}
"""Commands that are run one after the other, in processes of their own. Long chains come first."""

EXTRAS = {"lattice": "openaerostruct"}
"""Modules that chains need, which not everybody has."""


def chains() -> list[str]:
    """Names of the chains that can run here."""
    return [name for name in CHAINS if name not in EXTRAS or importlib.util.find_spec(EXTRAS[name])]


def run_chain(
    commands: Sequence[Sequence[str]],  # commands, to run in the current folder
    locks: Path,  # folder of the locks, the same for all processes
    lines: TextIO,  # where lines are written
) -> int:  # exit status: that of the first command that failed
    """Run commands one after the other, and tell what kernels they need."""
    needed: set[tuple[str, str]] = set()

    def noted(index: str, signature: str, is_compiled: bool) -> None:
        needed.add((index, signature))
        if is_compiled:
            print("compiles", Path(index).stem, file=lines, flush=True)

    Path("euler.toml").write_text(EULER, encoding="utf-8")
    with shared_compilation(locks, noted):
        for command in commands:
            status = run(command)
            if status:
                return status
            print("ran", command[0], file=lines, flush=True)
    print("needs", json.dumps(sorted(needed)), file=lines, flush=True)
    return 0


if __name__ == "__main__":
    with open(os.dup(1), "w", encoding="utf-8") as pipe, open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
        ended = run_chain(CHAINS[sys.argv[1]], Path(sys.argv[2]), pipe)
    sys.exit(ended)
