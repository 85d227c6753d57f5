"""Why a run that was stopped early shows the design that it shows: what better ones miss."""

from __future__ import annotations

import numpy as np

from ...core.om.drivers.case_history import CaseHistory


def better_but_infeasible(
    history: CaseHistory,  # of a run with one objective
    is_baseline: bool,  # whether the best design is the one that the run began with
) -> str:
    """Say what designs with a better objective than the best feasible one miss; empty if there are none."""
    (objective,) = history.of_kind("objective")
    values = objective.scaled(objective.values)[:, 0]
    numbers = np.flatnonzero(history.has_run & (values < values[history.best]))
    which = "the baseline" if is_baseline else f"evaluation {history.best + 1}"
    found = f"{which} is the best design that satisfies all constraints"
    if not len(numbers):
        return f"{found}, and none has a better {objective.name}" if is_baseline else ""
    best = numbers[np.argmin(values[numbers])]
    missed = history.infeasible(int(best), 0.0)  # by the driver's tolerance alone
    return (
        f"{found}; {len(numbers)} of {history.n_evaluations} evaluations have a better {objective.name}, the best of "
        f"them {objective.values[best, 0]:.4g} in evaluation {best + 1}, which is {missed}"
    )
