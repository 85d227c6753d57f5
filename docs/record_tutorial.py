"""Run the commands of the tutorial, in order, and write what they print beside its scripts, where the page shows it.

``python docs/record_tutorial.py`` rewrites the files; a test compares them with what is printed now.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import textwrap
import time
from collections.abc import Callable
from pathlib import Path

DOCS = Path(__file__).parent
PAGE, SCRIPTS = DOCS / "tutorial.rst", DOCS / "tutorial"

PROGRAMS = {"python": [sys.executable], "bspline-mdao": [sys.executable, "-m", "bspline_mdao"]}
"""What runs the commands of the page: the Python that runs this."""

COLUMNS = "100"
"""Width of what is printed."""

BLOCK = re.compile(
    r"^\.\. code-block:: sh\n\n(?P<commands>(?:   .*\n|\n)+)(?:\.\. literalinclude:: tutorial/(?P<output>\w+\.txt)\n)?",
    re.M,
)


def steps() -> list[tuple[list[str], str | None]]:
    """Commands of each block of the page, and the file that shows what they print."""
    found = BLOCK.finditer(PAGE.read_text(encoding="utf-8"))
    return [(textwrap.dedent(step["commands"]).strip().splitlines(), step["output"]) for step in found]


def in_a_process(program: str, arguments: list[str], folder: Path) -> str:
    """Run a command of the page in a folder as a reader would; return what it prints."""
    environment = os.environ | {"COLUMNS": COLUMNS, "OPENMDAO_REPORTS": "0", "OPENMDAO_WORKDIR": str(folder)}
    done = subprocess.run([*PROGRAMS[program], *arguments], cwd=folder, env=environment, text=True, capture_output=True)
    if done.returncode:
        raise RuntimeError(f"{program} {shlex.join(arguments)}\n{done.stdout}{done.stderr}")
    return done.stdout


def run(folder: Path, call: Callable[[str, list[str], Path], str] = in_a_process) -> dict[str, str]:
    """Run all commands in a folder with the scripts of the tutorial; return what is printed, and the draft, by file."""
    for script in SCRIPTS.glob("*.py"):
        shutil.copy(script, folder)
    printed = {}
    for commands, output in steps():
        start, text = time.perf_counter(), ""
        for command in commands:
            program, *arguments = shlex.split(command)
            text += call(program, arguments, folder)
        print(f"{time.perf_counter() - start:6.1f} s  {'; '.join(commands)}", file=sys.stderr)
        if output:
            printed[output] = "\n".join(line.rstrip() for line in text.strip().splitlines()) + "\n"
    return printed | {"wing.toml": (folder / "wing.toml").read_text(encoding="utf-8")}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        for name, text in run(Path(scratch)).items():
            (SCRIPTS / name).write_text(text, encoding="utf-8")
