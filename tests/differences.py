"""Derivatives held against differences: those of OpenMDAO's check, and central ones extrapolated to a step of zero."""

import numpy as np
import openmdao.api as om
from openmdao.core.component import Component
from openmdao.utils.assert_utils import assert_check_partials


def extrapolated_difference(function, step, levels):
    """Central differences of a function of one number at halved steps, extrapolated to step zero (Richardson)."""
    table = [(function(h) - function(-h)) / (2 * h) for h in step / 2.0 ** np.arange(levels)]
    for power in range(1, levels):
        table = [(4**power * fine - coarse) / (4**power - 1) for coarse, fine in zip(table, table[1:])]
    return table[0]


def extrapolated_runs(problem, name, direction, outputs):
    """Derivatives of some outputs of a problem, one after another, along a direction in an input."""
    start = problem.get_val(name).copy()

    def run(step):
        problem.set_val(name, start + step * direction)
        problem.run_model()
        return np.concatenate([problem.get_val(of).ravel() for of in outputs])

    found = extrapolated_difference(run, 4e-3, levels=3)
    problem.set_val(name, start)
    return found


def assert_partials_pass(problem, **tolerances):
    """Make a bare check of the partial derivatives of all components, and let no component pass without any."""
    data = problem.check_partials(out_stream=None)
    everything = problem.model.system_iter(recurse=True, typ=Component)
    assert set(data) == {part.pathname for part in everything if not isinstance(part, om.IndepVarComp)}
    for name, pairs in data.items():
        assert pairs, name
        for exact in ("J_fwd", "J_fd"):
            assert max(np.abs(pair[exact]).max() for pair in pairs.values() if exact in pair) > 0.0, name
    assert_check_partials(data, **tolerances)
