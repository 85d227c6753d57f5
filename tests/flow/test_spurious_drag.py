"""Drag of shocks and of the grid, and a warning where the latter is optimised."""

import warnings
from functools import cache

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import EulerFlow, SpuriousDragWarning, fit_grid, infinite_wing_grid, naca_section
from bspline_mdao.flow.euler import drag_sources as kernel
from bspline_mdao.flow.stream import RADIAN
from bspline_mdao.om.flow.spurious_drag import drag_sources, is_optimised


@cache
def section(shape):
    return fit_grid(infinite_wing_grid(naca_section(0.12), shape), keep_residual=False)


def problem(objective, mach=0.4, alpha=1.25, shape=(17, 11)):
    """Flow about a section, not yet run; ``ratio`` depends on the drag by way of two components."""
    problem = om.Problem(reports=False)
    flow = EulerFlow(model=section(shape), reference_area=1.0, iprint=0)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.model.add_subsystem("sum", om.ExecComp("total = 2.0 * CD"), promotes=["*"])
    problem.model.add_subsystem("last", om.ExecComp(["ratio = total / CL", "twice = 2.0 * CL"]), promotes=["*"])
    problem.model.add_design_var("alpha")
    problem.model.add_objective(objective)
    problem.setup()
    problem.set_val("Mach_number", mach)
    problem.set_val("alpha", alpha)
    return problem


def sources_of(problem):
    state = problem.model.flow.state
    at = problem.get_val("states").reshape(-1, 5), problem.get_val("grid").reshape(-1, 3)
    stream = RADIAN * problem.get_val("alpha").item(), problem.get_val("Mach_number").item()
    return drag_sources(state.options["flow"], state.options["forces"], *at, *stream)


@pytest.mark.parametrize(
    ("objective", "is_found"), [("CD", True), ("total", True), ("ratio", True), ("CL", False), ("CD_entropy", False)]
)
def test_drag_is_optimised_where_a_response_depends_on_it(objective, is_found):
    unrun = problem(objective)
    unrun.final_setup()
    assert is_optimised(unrun.model.flow.forces, "CD") is is_found


def test_spurious_drag_that_is_optimised_is_told_once_with_its_parts():
    run = problem("ratio")
    with pytest.warns(SpuriousDragWarning, match=r"100 % of it is the grid's: CD 0\.\d+ = induced 0\.00000 \+ shocks"):
        run.run_model()
    sources = sources_of(run)
    assert sources.spurious == sources.total == pytest.approx(run.get_val("CD").item())
    with warnings.catch_warnings():
        warnings.simplefilter("error", SpuriousDragWarning)
        run.set_val("alpha", 1.3)
        run.run_model()


def test_drag_of_shocks_is_no_reason_for_a_warning(monkeypatch):
    run = problem("CD", mach=0.85, alpha=0.0, shape=(29, 19))
    with warnings.catch_warnings():
        warnings.simplefilter("error", SpuriousDragWarning)
        run.run_model()
    sources = sources_of(run)
    assert sources.wave > 0.02
    assert abs(sources.spurious) < 0.1 * sources.total
    monkeypatch.setattr(kernel, "SONIC", -np.inf)
    monkeypatch.setattr(kernel, "SMEARED", 40)
    np.testing.assert_allclose(sources_of(run).wave, run.get_val("CD_entropy"), rtol=1e-9)  # the face fluxes telescope
