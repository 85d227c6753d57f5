"""The run that a restart continues: where its cases are, and whether they belong to the same problem."""

from __future__ import annotations

from pathlib import Path

from ...core.om.drivers.case_file import count_cases
from ...core.om.drivers.case_history import read_history
from ...errors import InputError
from ...grids.io.run_folder import RESULTS, RunFolder, about_run
from ..study.same_problem import check_same_problem
from ..study.study import CASES, Study

__all__ = ["earlier_cases", "recorded_cases"]


def earlier_cases(folder: RunFolder, study: Study) -> Path:
    """Find the case file to continue from: the last one with cases, of the results or of a killed run.

    Raises `InputError` if there is none, it cannot be read, or the study is not the problem of its run.
    """
    of_run = {folder.path / CASES: folder.path, **_killed(folder)}
    files = sorted((file for file in of_run if file.is_file()), key=lambda file: file.stat().st_mtime, reverse=True)
    for file in files:
        if count_cases(file):
            read_history(file)
            about = about_run(of_run[file])
            if about:  # not if the script was run on its own: its responses and variables are compared all the same
                check_same_problem(study, about, str(folder.path))
            return file
    raise InputError(f"{folder.path}: has no recorded case to continue from; leave out --restart to begin")


def recorded_cases(folder: RunFolder) -> int:
    """Number of cases of a run in a folder, or of one that was killed there, as far as they can be read."""
    found = 0
    for file in filter(Path.is_file, [folder.path / CASES, *_killed(folder)]):
        try:
            found = max(found, count_cases(file))
        except InputError:
            continue
    return found


def _killed(folder: RunFolder) -> dict[Path, Path]:
    """Case files of killed runs, with their private folders."""
    return {place / RESULTS / CASES: place for place in folder.left_behind()}
