"""A flow is summed up by its coefficients, and one by the Euler equations by how it converged too."""

import openmdao.api as om
import pytest

from bspline_mdao import EulerFlow, fit_grid
from bspline_mdao.flow.om.flow_run import run_flow
from bspline_mdao.generators import onera_m6_grid


@pytest.mark.slow
def test_an_euler_flow_tells_its_cells_and_its_convergence():
    problem = om.Problem(EulerFlow(model=fit_grid(onera_m6_grid((5, 6, 5))), reference_area=1.16), reports=None)
    problem.setup()
    told = run_flow(problem)
    assert told["n_cells"] == 12 * 4 * 5 * 4
    assert told["CL"] == problem.get_val("CL").item() > 0.0
    assert {"CD", "CD_induced", "CD_entropy"} <= set(told)
    history = problem.model.state.solution.history
    assert (told["n_steps"], told["residual"]) == (len(history) - 1, history[-1].residual)
    assert told["n_products"] > told["n_steps"] > 1
    assert told["seconds"] > 0.0


def test_what_has_no_coefficients_tells_its_time_alone():
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("lift", om.ExecComp("CL = 2*alpha"), promotes=["*"])
    problem.setup()
    assert set(run_flow(problem)) == {"CL", "seconds"}
    assert run_flow(problem)["CL"] == pytest.approx(2.0)
