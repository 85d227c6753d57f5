"""The command ``optimize``: a study is made a script, which is run, and told about."""

from __future__ import annotations

import time
import warnings
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click
import numpy as np
import openmdao.api as om

from ..errors import InputError
from ..extras import INSTALL
from ..io.disk import replaced_file
from ..numerics.processes import on_first, world
from ..om.design_summary import DesignSummary
from ..om.drivers.nlopt_driver import NLoptDriver
from ..study.script import SCRIPT, study_script
from ..study.study import Study, read_study
from .output import check_outputs, print_lines, print_title, print_warnings, written_json
from .sources import generator_of

RESULTS = (SCRIPT, "model.h5", "grid_before.*", "grid_after.*", "cases.sql", "summary.csv", "report.html")
"""Files that a run makes, by name or pattern."""

STOPPED = "all bounds hold but for 1e-4, and this may be no optimum: see max_iterations and tolerance in [driver]"
"""What is said of a feasible design at which the driver did not converge."""

REPORT_ADVICE = INSTALL.format(extra="report")

SLACK = 1e-4
"""Violation of a bound, relative to its size or 1, up to which a design counts as feasible."""


def optimize_study(
    study: Path, output: Path, json: Path | None = None, overwrite: bool = False, max_iterations: int | None = None
) -> None:
    """Run a study and show what came out.

    Parameters
    ----------
    study : Path
        The study.
    output : Path
        Folder for the results.
    json : Path, optional
        Numbers to write.
    overwrite : bool
        Use a folder that is not empty.
    max_iterations : int, optional
        Instead of what the study says.

    Raises
    ------
    InputError
        If the study cannot be used, or the folder is not empty.
    click.ClickException
        If the optimisation fails; what there is of it is kept.
    KeyboardInterrupt
        If the user interrupts; what there is is kept.
    """
    comm = world()
    found = on_first(comm, lambda: read_study(study))
    if max_iterations is not None:
        found = replace(found, driver=found.driver | {"max_iterations": max_iterations})
    found = replace(found, output=found.output | {"report": _is_reported(found)})
    check_outputs([json], [study], comm)
    script = output / SCRIPT
    text = on_first(comm, lambda: _written(found, output, overwrite))
    print_title(f"{study}: {script} runs" + (f" on {comm.size} processes" if comm.size > 1 else ""))
    start = time.perf_counter()
    problem, names = _run(script, text, output)
    numbers, seconds = _numbers(problem, names["before"], names["after"]), time.perf_counter() - start
    with written_json(json, {"study": str(study), "folder": str(output), **numbers, "seconds": seconds}, comm):
        pass
    _tell(output, problem, numbers)


def _is_reported(study: Study) -> bool:
    """Whether a report is written: where the packages for it are there, unless the study says otherwise."""
    missing = [name for name in ("plotly", "jinja2") if find_spec(name) is None]
    if missing and study.output["report"]:
        raise InputError(f"{study.source}: the report needs {missing[0]}; {REPORT_ADVICE}, or leave report out")
    if missing and study.output["report"] is None:
        print_lines([f"no report will be written: {REPORT_ADVICE} for one"])
    return not missing if study.output["report"] is None else study.output["report"]


def _generator(study: Study) -> str:
    """Call that makes the grid of a study, where it is a built-in one."""
    if not study.is_built_in:
        return ""
    place, shape = generator_of(study.grid["file"])
    return f"bm.{place.rpartition('.')[2]}({shape})"


def _written(study: Study, folder: Path, overwrite: bool) -> str:
    """Write the script of a study into its folder, and return it."""
    generator = _generator(study)
    script = _prepare(folder, overwrite) / SCRIPT
    text = study_script(study, folder, generator)
    with replaced_file(script) as part:
        part.write_text(text, encoding="utf-8")
    return text


def _prepare(folder: Path, overwrite: bool) -> Path:
    """Make the folder, or take the results of another run out of it."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; name a folder for the results")
    if folder.is_dir() and any(folder.iterdir()) and not overwrite:
        raise InputError(f"{folder}: is not empty; give --overwrite, or another folder")
    folder.mkdir(parents=True, exist_ok=True)
    for pattern in RESULTS:
        for path in folder.glob(pattern):
            if path.is_file():
                path.unlink()
    return folder


def _run(script: Path, text: str, folder: Path) -> tuple[om.Problem, dict[str, Any]]:
    """Run a script; return the problem, and all names that it gives."""
    names: dict[str, Any] = {"__name__": "__main__", "__file__": str(script)}
    try:
        with warnings.catch_warnings():  # the script counts linear solves of the flow, where OpenMDAO counts variables
            warnings.filterwarnings("ignore", "Inefficient choice of derivative mode")
            exec(compile(text, str(script), "exec"), names)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted; {folder} keeps {_kept(folder)}") from None
    except om.AnalysisError as error:
        raise click.ClickException(f"{error}; {folder} keeps {_kept(folder)}") from error
    return names["problem"], names


def _kept(folder: Path) -> str:
    """Name the results that there are."""
    return ", ".join(sorted(path.name for pattern in RESULTS for path in folder.glob(pattern)))


def _numbers(problem: om.Problem, before: DesignSummary, after: DesignSummary) -> dict[str, Any]:
    """Collect the numbers of a run for JSON."""
    result = problem.driver.result
    return {
        "optimizer": problem.driver.options["optimizer"],
        "success": bool(result.success),
        "status": _status(problem),
        "is_feasible": _is_feasible(after),
        "evaluations": result.model_evals,
        "gradients": result.deriv_evals,
        "before": before.numbers(),
        "after": after.numbers(),
    }


def _status(problem: om.Problem) -> str:
    """How the run ended, in words."""
    driver = problem.driver
    if isinstance(driver, NLoptDriver):
        return driver.get_exit_status()
    return f"{driver.options['optimizer']} {'converged' if driver.result.success else 'did not converge'}"


def _is_feasible(summary: DesignSummary) -> bool:
    """Whether no bound is violated by more than `SLACK`."""
    bounded = [entry for entry in summary.entries if entry.role in ("variable", "constraint")]
    for entry in bounded:
        for excess in (entry.lower - entry.values, entry.values - entry.upper):
            bound = np.maximum(1.0, np.abs(np.where(np.isnan(entry.lower), entry.upper, entry.lower)))
            if np.any(excess > SLACK * bound):  # not a number, where there is no bound, is not larger
                return False
    return True


def _tell(folder: Path, problem: om.Problem, numbers: dict[str, Any]) -> None:
    """Say how it ended and what was written; raise where it failed."""
    driver = problem.driver
    counts = f"{numbers['evaluations']} evaluations, {numbers['gradients']} gradients"
    if isinstance(driver, NLoptDriver) and driver.outcome is not None and driver.outcome.end == "INTERRUPTED":
        raise KeyboardInterrupt(f"interrupted after {counts}; {folder} keeps the best design so far")
    if not numbers["is_feasible"]:
        raise click.ClickException(
            f"{folder}: no design that satisfies all constraints was found ({numbers['status']}); the results are "
            f"kept. Give wider bounds, other constraints or more iterations"
        )
    if not numbers["success"]:
        print_warnings([f"{numbers['status']}; {STOPPED}"])
    print_lines([f"{numbers['status']}; {counts}"] if numbers["success"] else [])
    print_lines([f"{folder}: {_kept(folder)}"])
