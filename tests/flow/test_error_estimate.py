"""Errors of coefficients by the adjoint, against flows that are solved on the finer member."""

import warnings

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import EulerFlow, InputError, SpuriousDragWarning, design_summary, fit_grid
from bspline_mdao.adaptation import error_estimate
from bspline_mdao.core.evaluation.transfer import NodeTransfer
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.forces import FlowForces
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.loads.induced_drag import InducedDrag
from bspline_mdao.flow.om.error_estimate import finer_member
from bspline_mdao.generators import (
    Spacing,
    hh_wing_grid,
    infinite_wing_grid,
    naca_section,
    onera_m6_grid,
    rectangular_wing,
    section_o_grid,
)
from bspline_mdao.grids.cells.cell_faces import CellFaces

NAMES = "CL", "CD", "CD_entropy"


def flown(model):
    """Flow about a section at M 0.5 and 1.25 degrees."""
    problem = om.Problem(EulerFlow(model=model, reference_area=1.0, iprint=0), reports=False)
    problem.setup()
    problem.set_val("Mach_number", 0.5)
    problem.set_val("alpha", 1.25)
    problem.run_model()
    return problem


@pytest.fixture(scope="module")
def model():
    return fit_grid(infinite_wing_grid(naca_section(0.12), (25, 17), Spacing()), keep_residual=False)


@pytest.fixture(scope="module")
def wing():
    return fit_grid(onera_m6_grid((9, 9, 9)), keep_residual=False)


@pytest.fixture(scope="module")
def coarse(model):
    return flown(model)


@pytest.fixture(scope="module")
def estimates(coarse):
    return error_estimate(coarse, NAMES)


@pytest.mark.slow
def test_the_estimates_are_the_errors_of_flows_on_the_finer_member(model, coarse, estimates):
    finer = flown(model.member(2.0))
    for name, estimate in estimates.items():
        assert estimate.value == coarse.get_val(name)
        error = coarse.get_val(name).item() - finer.get_val(name).item()
        assert 0.85 < estimate.error / error < 1.15, name
    assert abs(estimates["CD"].limit) < 0.3 * estimates["CD"].value  # it should be zero


@pytest.fixture(scope="module")
def kept():
    """A section whose splines miss the grid by as much as the errors of its flow, which is made up for."""
    return fit_grid(section_o_grid(naca_section(0.12), 24, far=20.0), n_control=(10, 8, 2))


@pytest.mark.parametrize("factor", [1.5, 2.0])
def test_estimates_are_made_on_the_member_of_the_family_to_the_last_bit(kept, factor):
    nodes, member = (each.regenerate().to_vector().reshape(-1, 3) for each in (kept, kept.member(factor)))
    flow = FlowGrid.of(kept.topology, nodes)
    finer = finer_member(kept, flow, FlowForces.of(flow, nodes, 1.0), nodes, "xzy", factor)
    np.testing.assert_array_equal(finer.nodes_at(nodes), member)


def test_the_finer_grid_of_a_moved_one_is_displaced_as_that_is(kept):
    nodes, finer = (each.regenerate().to_vector().reshape(-1, 3) for each in (kept, kept.member(2.0)))
    flow, shift = FlowGrid.of(kept.topology, nodes), np.array([0.3, -0.2, 0.0])
    moved = finer_member(kept, flow, FlowForces.of(flow, nodes, 1.0), nodes + shift, "xzy", 2.0)
    np.testing.assert_allclose(moved.nodes_at(nodes + shift), finer + shift, atol=1e-13)


@pytest.mark.slow
def test_what_the_splines_miss_of_a_grid_is_no_part_of_the_error(kept):
    grid, finer = flown(kept), flown(kept.member(2.0))
    estimates = error_estimate(grid, NAMES)
    assert kept.report.rms > 1e-3
    for name, estimate in estimates.items():
        error = (grid[name] - finer[name]).item()
        assert 0.85 < estimate.error / error < 1.15, name


def test_contributions_of_the_cells_sum_to_what_the_residuals_make(coarse, estimates):
    n_cells = coarse.get_val("states").size // 5
    for estimate in estimates.values():
        assert estimate.contributions.shape == (n_cells,)
        assert abs(estimate.contributions.sum()) <= estimate.bound
    leaves = estimates["CD_entropy"]  # the rest is what prolongation changes of it at once, at the walls
    assert leaves.contributions.sum() == pytest.approx(leaves.error, abs=0.3 * abs(leaves.error))
    assert leaves.remaining < 0.5 * abs(leaves.error)


@pytest.mark.slow
def test_drag_of_a_wing_is_estimated_where_prolonged_states_and_adjoints_alone_do_not(wing):
    grid, finer = (flown(each) for each in (wing, wing.member(2.0)))
    estimates = error_estimate(grid, ["CL", "CD", "CM_bending"])
    for name, estimate in estimates.items():
        error = (grid.get_val(name) - finer.get_val(name)).item()
        assert abs(estimate.error - error) < estimate.remaining, name
    assert estimates["CD"].error == pytest.approx((grid["CD"] - finer["CD"]).item(), rel=0.1)


@pytest.mark.slow
def test_members_have_the_nodes_of_the_splines_where_interpolated_cells_would_be_inside_out():
    model = fit_grid(hh_wing_grid(rectangular_wing(), (9, 13, 9), Spacing()), keep_residual=False)
    nodes, finer = model.regenerate().to_vector().reshape(-1, 3), model.member(2.0).topology
    interpolated = NodeTransfer.of(model.topology, finer).prolong(nodes)
    with pytest.raises(InputError, match="cells have negative volumes"):
        CellFaces.of(finer, interpolated).require_volumes(interpolated)
    estimate = error_estimate(flown(model), ["CD"])["CD"]
    assert 0.0 < estimate.finer < estimate.value


@pytest.mark.slow
def test_a_summary_has_the_estimates_beside_the_values(model, tmp_path):
    problem, machs = om.Problem(reports=False), {"slow": 0.3, "fast": 0.5}
    for name in machs:
        flow = EulerFlow(model=model, reference_area=1.0, iprint=0)
        problem.model.add_subsystem(name, flow, promotes_inputs=["grid"])
    problem.model.add_objective("fast.CD_entropy")
    problem.setup()
    for name, mach in machs.items():
        problem.set_val(f"{name}.Mach_number", mach)
        problem.set_val(f"{name}.alpha", 1.25, units="deg")
    problem.run_model()
    summary = design_summary(problem, ["slow.CD", "fast.CD", "fast.CL", "slow.CM"], finer=2.0)
    assert set(summary.estimates) == {"slow.CD", "fast.CD", "fast.CL", "fast.CD_entropy"}
    for name, estimate in summary.estimates.items():
        alone = error_estimate(problem, [name.split(".")[1]], flow=getattr(problem.model, name.split(".")[0]))
        assert estimate.value == problem.get_val(name).item()
        assert estimate.finer == pytest.approx(alone[name.split(".")[1]].finer, rel=1e-6)
    assert summary.numbers()["fast.CD"]["finer"] == summary.estimates["fast.CD"].finer
    assert "finer" not in summary.numbers()["slow.CM"]
    heads, *rows = str(summary).splitlines()
    assert heads.split() == ["objective", "value", "lower", "upper", "finer", "grid", "+-"]
    assert next(row for row in rows if "fast.CL" in row).split()[2] == f"{summary.estimates['fast.CL'].finer:.6g}"
    summary.write_csv(tmp_path / "summary.csv")
    assert (
        (tmp_path / "summary.csv")
        .read_text()
        .splitlines()[0]
        .endswith("lower,upper,finer,remaining,infeasible,at_bound")
    )


def test_a_summary_without_a_solution_has_its_values_and_a_warning(model):
    problem = om.Problem(EulerFlow(model=model, reference_area=1.0, iprint=0), reports=False)
    problem.setup()
    problem.final_setup()
    with pytest.warns(om.OpenMDAOWarning, match="the errors of CL are not estimated: .*no derivatives at a residual"):
        summary = design_summary(problem, ["CL"], finer=2.0)
    assert (summary.estimates, len(summary.entries)) == ({}, 1)
    assert "finer grid" not in str(summary)


def test_a_summary_warns_where_the_induced_drag_is_below_the_least_of_its_lift(coarse, wing, monkeypatch):
    with warnings.catch_warnings():
        warnings.simplefilter("error", SpuriousDragWarning)
        design_summary(coarse, ["CD_induced"], finer=1.5)  # a section has none, and there is none below it
    monkeypatch.setattr(InducedDrag, "least", lambda self, nodes, alpha, lift: lift)
    problem = flown(wing)
    with pytest.warns(SpuriousDragWarning, match=rf"{problem.get_val('CL').item():.6f}, which no wing"):
        design_summary(problem, ["CD_induced"], finer=1.5)


def test_the_limit_is_that_of_second_order(estimates):
    estimate = estimates["CL"]
    assert estimate.value - estimate.limit == pytest.approx(4.0 / 3.0 * estimate.error)
    assert estimate.finer - estimate.limit == pytest.approx(estimate.error / 3.0)


def test_adjoints_solve_the_transposed_system(coarse):
    grid, states = coarse.model.state.options["flow"], coarse.get_val("states").reshape(-1, 5)
    nodes, stream = coarse.get_val("grid").reshape(-1, 3), free_stream(0.5, np.radians(1.25), grid.axes)
    bar = np.random.default_rng(0).standard_normal(states.shape)
    psi = coarse.model.state.adjoint(bar, 1e-6)
    product = grid.discretization.linearize(states, grid.areas(nodes), stream).state_vjp(psi)
    np.testing.assert_allclose(product, bar, atol=1e-5 * np.linalg.norm(bar))


def test_what_cannot_be_estimated_is_refused(coarse):
    with pytest.raises(InputError, match="error estimate of CM; give any of CL, CD, CD_induced, CD_entropy"):
        error_estimate(coarse, ["CL", "CM"])
    with pytest.raises(InputError, match=r"factor 1\.0; give a number above 1, such as 2"):
        error_estimate(coarse, factor=1.0)
    with pytest.raises(InputError, match=r"summary: finer is 0\.5; give a number above 1"):
        design_summary(coarse, ["CL"], finer=0.5)
    with pytest.raises(InputError, match="a problem with one EulerFlow is wanted, it has none"):
        error_estimate(om.Problem(om.Group(), reports=False).setup())


@pytest.mark.slow
def test_trimmed_flow_has_the_estimates_of_its_angle(model, coarse, estimates):
    trimmed = om.Problem(EulerFlow(model=model, reference_area=1.0, trim=True, iprint=0), reports=False)
    trimmed.setup()
    trimmed.set_val("Mach_number", 0.5)
    trimmed.set_val("CL_target", coarse.get_val("CL"))
    trimmed.run_model()
    found = error_estimate(trimmed, ["CD"])["CD"]
    assert found.error == pytest.approx(estimates["CD"].error, rel=1e-3)
