"""Flows that start from the solution of the last derivatives, as the steps of an optimiser do."""

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import EulerFlow, fit_grid
from bspline_mdao.flow.om.euler_state import EulerState
from bspline_mdao.generators import naca_section, section_o_grid


@pytest.fixture(scope="module")
def section():
    return fit_grid(section_o_grid(naca_section(0.12), 16, far=20.0, n_away=8), n_control=[(12, 8, 2)])


@pytest.fixture
def starts(monkeypatch):
    """States that runs start from, as they come."""
    found, solve = [], EulerState._attempts

    def attempts(self, inputs, outputs, *rest):
        found.append(outputs["states"].copy())
        return solve(self, inputs, outputs, *rest)

    monkeypatch.setattr(EulerState, "_attempts", attempts)
    return found


@pytest.mark.parametrize("trim", [False, True])
@pytest.mark.parametrize("anchored", [False, True])
def test_runs_start_from_the_last_derivatives_if_they_are_to(section, starts, anchored, trim):
    problem = om.Problem(reports=None)
    flow = EulerFlow(model=section, reference_area=1.0, iprint=0, anchored=anchored, trim=trim)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup(mode="rev")

    def run(mach):
        starts.clear()
        problem.set_val("Mach_number", mach)
        problem.run_model()
        return starts[0], problem.get_val("states").copy()

    _, first = run(0.3)
    problem.compute_totals(["CD"], ["Mach_number"])
    start, second = run(0.4)
    np.testing.assert_array_equal(start, first)
    start, _ = run(0.35)
    np.testing.assert_array_equal(start, first if anchored else second)
    problem.compute_totals(["CD"], ["Mach_number"])
    _, third = run(0.3)
    start, _ = run(0.31)
    assert np.array_equal(start, third) is not anchored


def test_states_that_were_restored_are_kept(section, starts):
    problem = om.Problem(reports=None)
    flow = EulerFlow(model=section, reference_area=1.0, iprint=0, anchored=True)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup(mode="rev")
    problem.run_model()
    problem.compute_totals(["CD"], ["Mach_number"])
    for mach in (0.4, 0.5):
        problem.set_val("Mach_number", mach)
        problem.run_model()
        if mach == 0.4:
            kept = problem.get_val("states").copy()
    problem.set_val("Mach_number", 0.4)
    problem.set_val("states", kept)
    starts.clear()
    problem.run_model()
    np.testing.assert_array_equal(starts[0], kept)
    np.testing.assert_array_equal(problem.get_val("states"), kept)
