"""Drag of shocks and of the grid, and a warning where the latter is optimised."""

import warnings
from functools import cache

import numpy as np
import openmdao.api as om
import pytest
from euler_cases import case_of
from topology_cases import box, grid_of, patch

from bspline_mdao import EulerFlow, InputError, SpuriousDragWarning, fit_grid
from bspline_mdao.flow.euler import drag_sources as kernel
from bspline_mdao.flow.euler.drag_sources import DragSources, wave_drag
from bspline_mdao.flow.euler.entropy_drag import entropy_scale
from bspline_mdao.flow.euler.gas import GAMMA
from bspline_mdao.flow.loads.stream import RADIAN
from bspline_mdao.flow.om.spurious_drag import (
    drag_sources,
    is_optimised,
    warn_below_the_ellipse,
    warn_of_spurious_drag,
)
from bspline_mdao.generators import infinite_wing_grid, naca_section
from bspline_mdao.grids.topology.index_space import Window


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
    problem.model.add_subsystem("wake", om.ExecComp("drag = CD_induced + CD_entropy"), promotes=["*"])
    problem.model.add_design_var("alpha")
    problem.model.add_objective(objective)
    problem.setup()
    problem.set_val("Mach_number", mach)
    problem.set_val("alpha", alpha)
    return problem


def test_induced_drag_of_a_section_is_refused_as_an_objective_and_accepted_in_a_sum():
    with pytest.raises(InputError, match="CD_induced is optimised or constrained, and is 0 whatever"):
        problem("CD_induced").run_model()
    summed = problem("drag")
    summed.run_model()
    assert summed.get_val("drag").item() == summed.get_val("CD_entropy").item()


def sources_of(problem):
    state = problem.model.flow.state
    at = problem.get_val("states").reshape(-1, 5), problem.get_val("grid").reshape(-1, 3)
    stream = RADIAN * problem.get_val("alpha").item(), problem.get_val("Mach_number").item()
    return drag_sources(state.options["flow"], state.options["forces"], *at, *stream)


def jump(mach, pressure, density):
    """Wave drag of a stream along x whose pressure and density jump by these factors, and that of all its entropy."""
    x = np.array([0.0, 0.7, 1.5, 2.0, 2.8, 3.3, 4.1, 5.0, 5.6, 6.5])
    nodes = box(x, np.linspace(0.0, 1.3, 4), np.linspace(0.0, 0.6, 3))
    face, kinds = Window.whole(0, nodes.shape[:3]).face, ("farfield", "wall", "symmetry")
    patches = [patch(kind, face(2 * axis), face(2 * axis + 1)) for axis, kind in enumerate(kinds)]
    case = case_of(grid_of(nodes, patches=patches), mach=mach, degrees=0.0)
    states = np.tile([1.0, mach, 0.0, 0.0, 1.0 / GAMMA], (len(x) - 1, 3, 2, 1))
    states[5:] *= [density, 1.0 / density, 0.0, 0.0, pressure]
    entropy = mach * 1.3 * 0.6 * (np.log(pressure) - GAMMA * np.log(density)) / entropy_scale(mach)
    return wave_drag(case.discretization, states.reshape(-1, 5), case.areas, mach), entropy


def test_a_normal_shock_has_the_drag_of_its_entropy():
    mach = 1.4
    pressure = 1.0 + 2.0 * GAMMA / (GAMMA + 1.0) * (mach**2 - 1.0)
    density = (GAMMA + 1.0) * mach**2 / ((GAMMA - 1.0) * mach**2 + 2.0)
    wave, entropy = jump(mach, pressure, density)
    assert wave == pytest.approx(entropy, rel=1e-12)
    assert wave > 0.01


def test_a_rise_of_pressure_is_a_shock_where_the_flow_into_it_is_as_fast_as_sound():
    wave, entropy = jump(1.0, 1.1, 1.03)
    assert wave == pytest.approx(entropy, rel=1e-12)
    assert jump(0.9, 1.1, 1.03)[0] == 0.0  # faster than sqrt(p / rho), the speed of sound without gamma
    assert jump(1.4, 0.9, 0.95)[0] == 0.0  # an expansion


@pytest.mark.parametrize("part", [0.09, 0.11, -0.09, -0.11])
def test_more_than_a_tenth_of_the_drag_is_told_of_whichever_sign_it_has(part):
    sources = DragSources(0.02, 0.012 - 0.02 * part, 0.008)
    assert sources.spurious == pytest.approx(0.02 * part)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        warn_of_spurious_drag("flow", sources)
    assert len(told) == (abs(part) > 0.1)
    assert all(f"{100.0 * part:.0f} % of it is the grid's" in str(each.message) for each in told)


@pytest.mark.parametrize(
    ("objective", "is_found"), [("CD", True), ("total", True), ("ratio", True), ("CL", False), ("CD_entropy", False)]
)
def test_drag_is_optimised_where_a_response_depends_on_it(objective, is_found):
    unrun = problem(objective)
    unrun.final_setup()
    assert is_optimised(unrun.model.flow.forces, "CD") is is_found


def test_spurious_drag_that_is_optimised_is_told_once_with_its_parts():
    run = problem("ratio")
    with pytest.warns(SpuriousDragWarning, match=r"100 % of it is the grid's: CD 0\.\d+ = shocks 0\.00000"):
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


def test_induced_drag_below_that_of_the_ellipse_is_told_and_what_rounding_leaves_is_not():
    with pytest.warns(
        SpuriousDragWarning, match=r"cruise: CD_induced is 0\.004048, 0\.11 % below the drag of an elliptical"
    ):
        warn_below_the_ellipse("cruise", 0.0040483, 0.0040529)
    with warnings.catch_warnings():
        warnings.simplefilter("error", SpuriousDragWarning)
        warn_below_the_ellipse("cruise", 0.0074600, 0.0074604)
