"""The command ``optimize``: it turns a study into a script, runs it and reports the results."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click
import openmdao.api as om
from openmdao.utils import reports_system

from ...base.extras import INSTALL, library
from ...base.numerics.processes import on_first, world
from ...base.numerics.stopwatch import working_seconds
from ...core.om.drivers.case_file import count_cases
from ...core.om.drivers.case_history import read_history
from ...core.om.drivers.nlopt_driver import NLoptDriver
from ...errors import InputError, MovementError
from ...flow.om.induced_gain import InducedGain, induced_gains
from ...grids.io.disk import deferred_interrupts
from ...grids.io.formats import POLYMESH
from ...grids.io.run_folder import RunFolder
from ..report.design_summary import DesignSummary
from ..study.reader import read_study
from ..study.run_script import run_script
from ..study.same_problem import problem_of
from ..study.script import SCRIPT, study_script
from ..study.study import CAD_KINDS, CASES, Study
from ..study.variable_kinds import VARIABLES
from .better_designs import better_but_infeasible
from .earlier_run import earlier_cases, recorded_cases
from .lasting_stdout import lasting_stdout
from .optimum import cad_optima, optimum_of
from .output import check_outputs, print_lines, print_title, print_warnings, written_json
from .streams import is_quiet

STOPPED = (
    "all bounds hold to a ten-thousandth, and this may be no optimum: see max_iterations and tolerance in [driver]"
)
"""Remark on a feasible design at which the driver did not converge."""

CONTINUES, REPEATS = (
    "--restart continues from it",
    "--restart begins at the baseline again and repeats this run: raise max_iterations if it is spent",
)
"""What a restart does after such a run, by whether a design better than the baseline was found."""

OF_CLASS = re.compile(r"('[\w.]+') <class \w+>")
"""How OpenMDAO names a component: by its path and its class; studies know the path."""

NEEDED = {"report": ("report", ("plotly", "jinja2")), "picture": ("pictures", ("matplotlib",))}
"""Keys of ``[output]`` that need packages: their extra, and the packages."""


def optimize_study(
    study: Path,  # the study
    output: Path,  # folder for the results
    json: Path | None = None,  # numbers to write
    overwrite: bool = False,  # use a folder that is not empty
    restart: bool = False,  # continue from the best design that a run in the folder has recorded
    max_iterations: int | None = None,  # overrides the study
) -> None:
    """Run a study and show the results."""
    comm = world()
    if comm.size > 1:
        library("petsc4py", "a study on several processes needs petsc4py", "mpi")
    if overwrite and restart:
        raise InputError("--overwrite starts again and --restart continues; give one of them")
    found = on_first(comm, lambda: read_study(study))
    found.require_solver()
    if max_iterations is not None:
        found = replace(found, driver=found.driver | {"max_iterations": max_iterations})
    hints = [hint for name in NEEDED if (hint := _hint(found, name))]
    found = replace(found, output=found.output | {name: _is_made(found, name) for name in NEEDED})
    folder = RunFolder(output)
    with lasting_stdout():
        run = on_first(comm, lambda: _prepared(found, folder, json, overwrite, restart))
        print_lines(hints)
        _say_of_cad(found)
        start = working_seconds()
        problem, names = _run(run, folder, comm, f"{study}: running {output / SCRIPT}")
        numbers, seconds = _numbers(problem, names["before"], names["after"]), working_seconds() - start
        numbers |= {"evaluations_before": run.n_earlier, "seconds": seconds}
        numbers |= {"gains": {gain.name: _parts(gain) for gain in _gains(names)}}
        optimum = on_first(comm, lambda: optimum_of(names["model"], problem))
        numbers |= optimum.numbers()
        cad = on_first(comm, lambda: cad_optima(found, names))
        numbers |= {"cad": [vars(each) for each in cad]} if cad else {}
        with written_json(json, {"study": str(study), "folder": str(output), **numbers}, comm):
            pass
        optimum.show()
        print_lines([*names["shape"].options["parametrization"].notes, *map(str, cad)])
        print_warnings([*optimum.warnings(), *(each.warning for each in cad if each.warning)])
        print_warnings([gain.warning for gain in _gains(names) if gain.warning])
        _print_outcome(folder, problem, numbers, names["after"].infeasible)


@dataclass(frozen=True)
class _Run:
    """A run that is about to start: its study, its script, its private output folder, and the run it continues."""

    study: Study
    script: str
    private: Path
    n_earlier: int

    def words(self, comm: Any) -> str:
        """Description of the start."""
        start = f" from the best of {self.n_earlier} recorded designs" if self.n_earlier else ""
        return start + (f" on {comm.size} processes" if comm.size > 1 else "")


def _prepared(study: Study, folder: RunFolder, json: Path | None, overwrite: bool, restart: bool) -> _Run:
    """Check everything that could prevent a run, and make its private folder."""
    names = [SCRIPT, *study.results]
    if folder.path.exists() and not folder.path.is_dir():
        raise InputError(f"{folder.path}: is a file; name a folder for the results")
    check_outputs([*(folder.path / name for name in names), json], [study.source, *study.inputs.values()])
    if not (folder.is_empty or overwrite or restart):
        n_recorded = recorded_cases(folder)
        advice = f"--restart to continue from the best of {n_recorded} recorded designs, " if n_recorded else ""
        raise InputError(f"{folder.path}: is not empty; give {advice}--overwrite, or another folder")
    earlier = earlier_cases(folder, study) if restart else None
    taken_over = CASES if earlier == folder.path / CASES else ""  # may belong to the script, run on its own
    folder.check([name for name in (*names, *study.folders) if name != taken_over])
    private = folder.begin(problem_of(study))
    try:
        is_plane = study.kind.is_plane(study.grid["file"], study.source.parent)
        (private / SCRIPT).write_text(study_script(study, folder.path, is_plane=is_plane), encoding="utf-8")
        script = study_script(study, private, earlier and earlier.resolve(), is_plane)
    except BaseException:
        folder.discard()
        raise
    return _Run(study, script, private, count_cases(earlier) if earlier else 0)


def _gains(names: dict[str, Any]) -> tuple[InducedGain, ...]:
    """Reduction of induced drag, on the grid and on a finer one."""
    return induced_gains(names["before"].estimates, names["after"].estimates)


def _parts(gain: InducedGain) -> dict[str, float]:
    """Numbers of a gain for JSON."""
    return {"gain": gain.gain, "finer": gain.finer, "doubt": gain.doubt}


def _is_made(study: Study, name: str) -> bool:
    """Whether a page or a picture is made: if its packages are installed, unless the study says otherwise."""
    if name == "picture" and not study.has_pressures:
        return False
    asked, missing = study.output[name], _missing(name)
    if missing and asked:
        raise InputError(f"{study.source}: the {name} needs {missing[0]}; {_advice(name)}, or leave {name} out")
    return not missing if asked is None else asked


def _hint(study: Study, name: str) -> str:
    """Say what to install for a page or a picture that needs packages; empty if it needs none."""
    is_wanted = study.output[name] is None and (name != "picture" or study.has_pressures)
    return f"no {name} will be written: {_advice(name)} for one" if is_wanted and _missing(name) else ""


def _missing(name: str) -> list[str]:
    """Packages of a page or a picture that are not installed."""
    return [package for package in NEEDED[name][1] if find_spec(package) is None]


def _advice(name: str) -> str:
    """How to install the packages of a page or a picture."""
    return INSTALL.format(extra=NEEDED[name][0])


def _say_of_cad(study: Study) -> None:
    """Say if no CAD file can be written with the optimum."""
    kinds = {name: table["kind"] for name, table in study.variables.items() if VARIABLES[table["kind"]].made_by}
    if not study.cad_results and CAD_KINDS & set(kinds.values()):
        others = ", ".join(name for name, kind in kinds.items() if kind != "cad_points")
        print_lines(
            [
                f"no CAD file will be written with the optimum: {others} moves walls as well, but not by control "
                f"points of faces; write_cad of the moved control points has the walls themselves"
            ]
        )


def _run(run: _Run, folder: RunFolder, comm: Any, title: str) -> tuple[om.Problem, dict[str, Any]]:
    """Run a script, and move its results into place; return the problem, and all names that it defines."""
    script, failure = run.private / SCRIPT, None
    names: dict[str, Any] = {}
    try:
        print_title(title + run.words(comm))
        with warnings.catch_warnings(), _without_report_plugins():
            warnings.showwarning = lambda message, *_: print_warnings([_as_seen(str(message), run, folder)])
            # the script counts linear solves of the flow, but OpenMDAO counts variables
            warnings.filterwarnings("ignore", "Inefficient choice of derivative mode")
            run_script(run.study, run.script, script, names)
    except BaseException as error:
        failure = error
    if comm.size == 1 and "problem" in names:
        names["problem"].cleanup()  # closes the file of cases
    kept = _kept(run, folder) if comm.rank == 0 else ""
    if failure is not None:
        raise _said(failure, run, folder, kept) from None
    return names["problem"], names


@contextmanager
def _without_report_plugins() -> Iterator[None]:
    """Keep OpenMDAO from loading report writers, and Matplotlib with them: the script needs none."""
    loaded, reports_system._plugins_loaded = reports_system._plugins_loaded, True
    try:
        yield
    finally:
        reports_system._plugins_loaded = loaded


def _kept(run: _Run, folder: RunFolder) -> str:
    """Move the results of a run into place, and name them; do nothing if it ended before it had any."""
    with deferred_interrupts():
        has_cases = count_cases(run.private / CASES) > run.n_earlier
        has_more = any(path.name not in (SCRIPT, CASES) for path in run.private.iterdir())
        is_first = not (run.n_earlier or folder.names or folder.left_behind())
        if has_cases or (has_more and is_first):
            try:
                folder.keep()
            except (InputError, OSError) as error:
                raise InputError(
                    f"{error}; results stay in {run.private}, and --restart continues from them"
                ) from error
            return f"{folder.path} keeps {_listed(folder)}"
        folder.discard()
    return ""


def _said(failure: BaseException, run: _Run, folder: RunFolder, kept: str) -> BaseException:
    """Message of a run that failed: where its results are, and which there are."""
    words = "; ".join(part for part in (_as_seen(str(failure), run, folder), kept) if part)
    if isinstance(failure, KeyboardInterrupt):
        return KeyboardInterrupt(f"interrupted; {kept or f'{folder.path} is as it was'}")
    if isinstance(failure, om.AnalysisError):
        return click.ClickException(words)
    if isinstance(failure, InputError | MovementError):
        return type(failure)(words)
    return failure


def _as_seen(words: str, run: _Run, folder: RunFolder) -> str:
    """Text with the paths that results have once they are in place, and without classes of components."""
    inputs, results = f"{run.private}/../../", str(run.private)
    words = OF_CLASS.sub(r"\1", words)
    return " ".join(words.replace(inputs, f"{folder.path.absolute()}/").replace(results, str(folder.path)).split())


def _listed(folder: RunFolder) -> str:
    """Name the results, except for files in folders; for OpenFOAM's files, the folder."""
    cases = {name.rpartition("/")[0] for name in folder.names if f"/{POLYMESH}/" in name}
    return ", ".join(sorted([*(name for name in folder.names if "/" not in name), *cases]))


def _numbers(problem: om.Problem, before: DesignSummary, after: DesignSummary) -> dict[str, Any]:
    """Collect the numbers of a run for JSON."""
    result = problem.driver.result
    return {
        "optimizer": problem.driver.options["optimizer"],
        "success": bool(result.success),
        "status": _status(problem),
        "was_feasible": not before.infeasible,
        "is_feasible": not after.infeasible,
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


def _print_outcome(folder: RunFolder, problem: om.Problem, numbers: dict[str, Any], infeasible: str) -> None:
    """Say how it ended and what was written; raise an error if it failed."""
    driver = problem.driver
    counts = f"{numbers['evaluations']} evaluations, {numbers['gradients']} gradients"
    is_said = driver.options["disp"] and not is_quiet()  # by the driver, as a run ends
    if driver.is_interrupted:
        raise KeyboardInterrupt(f"interrupted after {counts}; {folder.path} keeps the best design so far")
    if infeasible:
        raise click.ClickException(
            f"{folder.path}: no design that satisfies all constraints was found ({numbers['status']}); the best is "
            f"{infeasible}. The results are kept; give wider bounds, other constraints, or more "
            f"iterations by --restart"
        )
    if not numbers["success"]:
        is_baseline = all(
            each["values"] == numbers["before"][name]["values"]
            for name, each in numbers["after"].items()
            if each["role"] == "variable"
        )
        better = better_but_infeasible(read_history(folder.path / CASES), is_baseline)
        how = "" if is_said else f"{numbers['status']}; "
        print_warnings([f"{how}{STOPPED}; {REPEATS if is_baseline else CONTINUES}", *([better] if better else [])])
    print_lines([f"{numbers['status']}; {counts}"] if numbers["success"] and not is_said else [])
    print_lines([f"{folder.path}: {_listed(folder)}"])
