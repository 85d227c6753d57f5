"""The report of OpenMDAO: a page on an optimisation, if ``OPENMDAO_REPORTS`` or ``reports`` requests it.

``OPENMDAO_REPORTS=bspline_mdao python script.py`` writes it next to the other reports of the problem. If no recorder
is attached to the driver, one is attached for the run, which records all that the page shows.

OpenMDAO imports this module with the first problem of any kind, so libraries for pages are imported only when needed.
"""

from __future__ import annotations

from typing import Any

import openmdao.api as om
from openmdao.utils.reports_system import register_report_hook

from ...errors import InputError

__all__ = ["NAME", "PAGE"]

NAME, PAGE, CASES = "bspline_mdao", "bspline_mdao.html", "bspline_mdao_cases.sql"
"""Name of the report; files that it writes into the problem's folder of reports."""


def _bspline_mdao_report_register() -> None:
    """Register the report, as the entry point of plugins does."""
    register_report_hook(
        NAME,
        "run_driver",
        "Problem",
        pre=_record,
        post=_write,
        description="Grid and optimisation",
    )


def _record(problem: om.Problem) -> None:
    """Attach a recorder to the driver, unless it has one."""
    from .contents import INCLUDES

    driver = problem.driver
    if _model(problem) is None or driver._rec_mgr.has_recorders():  # OpenMDAO has no public name for it
        return
    driver.add_recorder(om.SqliteRecorder(problem.get_reports_dir() / CASES, record_viewer_data=False))
    driver.recording_options["includes"] = list(INCLUDES)
    driver.recording_options["record_derivatives"] = True


def _write(problem: om.Problem) -> None:
    """Write the page; failures are warnings, since the optimisation is done."""
    from ...core.om.drivers.case_history import read_history
    from .contents import Contents
    from .page import diagram_of, with_model, write_contents

    model = _model(problem)
    if model is None or problem.comm.rank > 0:
        return
    try:
        history = read_history(_case_file(problem))
        contents = Contents(problem._name or "problem", history=history, diagram=diagram_of(problem))
        write_contents(problem.get_reports_dir() / PAGE, with_model(contents, model, _slides(problem)))
    except InputError as error:
        om.issue_warning(f"the report {NAME} is not written: {error}")


def _model(problem: om.Problem) -> Any:
    """Model of the first system that has one; None if there is none."""
    for system in problem.model.system_iter(include_self=True, recurse=True):
        if "model" in system.options and hasattr(system.options["model"], "control_points"):
            return system.options["model"]
    return None


def _slides(problem: om.Problem) -> Any:
    """The slides of the first system that moves a mesh of blocks; empty if there is none."""
    for system in problem.model.system_iter(include_self=True, recurse=True):
        mesh = system.options["mesh"] if "mesh" in system.options else None  # noqa: SIM401 - they have no `get`
        if mesh is not None and hasattr(mesh, "curved_slides") and mesh.parameters is not None:
            return mesh.slides
    return ()


def _case_file(problem: om.Problem) -> str:
    """File of the first recorder of the driver that writes one."""
    recorders = (recorder for recorder in problem.driver._rec_mgr if isinstance(recorder, om.SqliteRecorder))
    files = [recorder._filepath for recorder in recorders]
    if not files:
        raise InputError("no om.SqliteRecorder is attached to the driver; attach one, or none at all")
    return files[0]
