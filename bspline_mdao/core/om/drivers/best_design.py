"""The best design of a case file, as the start of another run."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np
import openmdao.api as om

from ....base.numerics.processes import on_first
from ....errors import InputError
from .case_history import FEASIBLE, CaseHistory, read_history
from .nlopt_problem import Point, Statement
from .scaled_model import ScaledModel

__all__ = ["load_best"]


def load_best(problem: om.Problem, cases: str | os.PathLike) -> int:
    """Set the design variables of a problem to the best design recorded by another run.

    The best design has the lowest objective of all that satisfy the problem's present bounds and constraints, or the
    smallest violation if none does. It does not matter how the other run ended.

    Parameters
    ----------
    problem : openmdao.api.Problem
        A problem after ``setup``, with one objective.
    cases : path-like
        Case file of a driver, for example from a `CaseRecorder`.

    Returns
    -------
    int
        Number of the evaluation, from 0.

    Raises
    ------
    InputError
        If the file cannot be read, has no design that could be analysed, or has other variables or responses.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import CaseRecorder, NLoptDriver, load_best
    >>> def pose(maxeval):
    ...     problem = om.Problem(driver=NLoptDriver(maxeval=maxeval, disp=False), reports=None)
    ...     valley = om.ExecComp("f = (1 - x)**2 + 4*(y - x**2)**2", x=0.0, y=1.0)
    ...     _ = problem.model.add_subsystem("valley", valley, promotes=["*"])
    ...     problem.model.add_design_var("x", lower=-2.0, upper=2.0)
    ...     problem.model.add_design_var("y", lower=-2.0, upper=2.0)
    ...     problem.model.add_objective("f")
    ...     return problem
    >>> stopped = pose(maxeval=4)
    >>> stopped.driver.add_recorder(CaseRecorder("valley.sql"))
    >>> _ = stopped.setup()
    >>> _ = stopped.run_driver()
    >>> stopped.cleanup()
    >>> cases = stopped.get_outputs_dir() / "valley.sql"
    >>> problem = pose(maxeval=100).setup()
    >>> _ = load_best(problem, cases)
    >>> problem.get_val("x").item() == stopped.get_val("x").item()
    True
    """
    problem.final_setup()
    driver = problem.driver
    history: CaseHistory = on_first(problem.comm, lambda: read_history(cases))
    model = ScaledModel(driver)
    for kind, here in (("variable", "design_var"), ("objective", "objective"), ("constraint", "constraint")):
        _check_same(cases, kind, {q.name: q.values.shape[1] for q in history.of_kind(kind)}, model.sizes(here))
    name = "constraint_tolerance"
    tolerance = driver.options[name] if name in driver.options else FEASIBLE  # noqa: SIM401  # no dictionary
    statement = Statement.of(model.design_limits(), model.constraint_limits(), tolerance)
    values = {q.name: q.values for q in history.quantities}
    points = [
        (int(number), statement.point(*model.scaled({name: of[number] for name, of in values.items()})))
        for number in np.flatnonzero(history.has_run)
    ]
    if not points:
        raise InputError(f"{cases}: has no design that could be analysed; start again")
    number, best = _best(points, tolerance)
    model.set(np.clip(best.x, statement.lower, statement.upper))
    return number


def _best(points: list[tuple[int, Point]], tolerance: float) -> tuple[int, Point]:
    """The best of numbered points."""
    found = points[0]
    for each in points[1:]:
        found = each if each[1].is_better(found[1], tolerance) else found
    return found


def _check_same(cases: str | os.PathLike, kind: str, there: Mapping[str, int], here: Mapping[str, int]) -> None:
    """Refuse cases with other quantities or other numbers of values."""
    for name in [*here, *there]:
        if there.get(name) != here.get(name):
            counts = [f"{found[name]} value(s)" if name in found else "none" for found in (there, here)]
            raise InputError(
                f"{cases}: is of another problem: {kind} '{name}' has {counts[0]} there, {counts[1]} here; start again"
            )
