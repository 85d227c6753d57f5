"""Record a first hour: install in a fresh environment, then the commands of the tutorial, with cold and warm kernels.

``python docs/record_first_hour.py FOLDER`` makes an environment in an empty folder by ``python -m venv``, installs the
package and what the tutorial needs with its own pip, and runs every command of ``docs/tutorial.rst`` twice, as the page
has them: the first time no kernel is compiled, the second time all are. The table goes to ``docs/tutorial/hour.txt``,
which the page of the installation shows. Seconds are those of the processor, user and system, so that a busy machine
changes little; kernels run on one thread.
"""

from __future__ import annotations

import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from record_tutorial import DOCS, PAGE, SCRIPTS, steps

MILESTONES = {"move ": "first moved grid", "optimise.py": "first optimum", "report ": "first report"}
"""What is there when a command has run."""

EXTRAS = "report,pictures"


def processor_seconds(command: list[str], **options) -> float:
    """Run a command, and return the time of the processor that it took (s)."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, text=True, capture_output=True, **options)
    if done.returncode:
        raise RuntimeError(f"{shlex.join(command)}\n{done.stdout}{done.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def commands() -> list[str]:
    """All commands of the tutorial, the report last."""
    (report,) = re.findall(r"^\.\. code-block:: shell\n\n   (.*)\n", PAGE.read_text(encoding="utf-8"), re.M)
    return [command for step, _ in steps() for command in step] + [report]


def run_all(folder: Path, programs: Path) -> list[float]:
    """Seconds of all commands in a folder, with the programs of an environment."""
    folder.mkdir()
    for script in SCRIPTS.glob("*.py"):
        shutil.copy(script, folder)
    own = {"OPENMDAO_REPORTS": "0", "OPENMDAO_WORKDIR": str(folder), "NUMBA_NUM_THREADS": "1"}
    own |= {"OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "NUMBA_CACHE_DIR")}
    seconds = []
    for command in commands():
        program, *arguments = shlex.split(command)
        seconds.append(processor_seconds([str(programs / program), *arguments], cwd=folder, env=environment | own))
        print(f"{seconds[-1]:6.1f} s  {command}", file=sys.stderr)
    return seconds


def table(install: float, cold: list[float], warm: list[float]) -> str:
    """The recorded hour."""
    lines = [f"{'cold':>7} {'warm':>7}   seconds of the processor", f"{install:7.1f}           pip install"]
    sums = [install, 0.0]
    marks = []
    for command, *both in zip(commands(), cold, warm):
        sums = [total + seconds for total, seconds in zip(sums, both)]
        short = "python -c ...  (writes the grid)" if " -c " in command else command
        lines.append(f"{both[0]:7.1f} {both[1]:7.1f}   {short}")
        marks += [f"{sums[0]:7.1f} {sums[1]:7.1f}   {what}" for key, what in MILESTONES.items() if key in command]
    return "\n".join([*lines, "", f"{'cold':>7} {'warm':>7}   from the beginning to the", *marks, ""])


def main(folder: Path) -> None:
    """Make the environment, run all twice, and write the table."""
    folder.mkdir(parents=True, exist_ok=True)
    programs = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
    install = processor_seconds([sys.executable, "-m", "venv", str(folder / "venv")])
    install += processor_seconds([str(programs / "pip"), "install", "-q", f"{DOCS.parent}[{EXTRAS}]"])
    text = table(install, *(run_all(folder / name, programs) for name in ("cold", "warm")))
    (SCRIPTS / "hour.txt").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute())
