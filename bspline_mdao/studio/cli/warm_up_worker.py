"""A process of ``warm-up``: it runs usual commands on tiny grids, and reports the kernels that they need.

``python -m bspline_mdao.studio.cli.warm_up_worker CHAIN LOCKS`` runs in a folder of its own. Each line that it prints
begins with a word: ``ran`` and a command, ``compiles`` and a kernel, ``needs`` and all kernels at the end.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import TextIO

from ...base.shared_compilation import shared_compilation
from .main import run
from .warm_up_chains import CHAINS
from .warm_up_inputs import INPUTS


def run_chain(
    commands: Sequence[Sequence[str]],  # commands, to run in the current folder
    locks: Path,  # folder of the locks, the same for all processes
    lines: TextIO,  # where lines are written
) -> int:  # exit status of the first command that failed
    """Run commands one after another, and report the kernels that they need."""
    needed: set[tuple[str, str]] = set()

    def noted(index: str, signature: str, is_compiled: bool) -> None:
        needed.add((index, signature))
        if is_compiled:
            print("compiles", Path(index).stem, file=lines, flush=True)

    with shared_compilation(locks, noted):
        for name, write in INPUTS.items():
            if any(name in command for command in commands):
                write(name)
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
