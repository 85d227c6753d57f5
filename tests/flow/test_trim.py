"""Flow at a given lift: the angle that is found, derivatives at fixed lift, and lifts that are out of reach."""

from functools import cache

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import EulerFlow, fit_grid
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.testing import assert_partials, central_difference

LIFT, OF = 0.2, ("CL", "CD", "CM", "alpha", "CD_induced")


@cache
def wing():
    """A wing of 1,024 cells."""
    return fit_grid(onera_m6_grid((5, 5, 5)))


def problem(mode="rev", is_complex=False, **options):
    """The flow about it, set up."""
    problem = om.Problem(reports=False)
    options = {"reference_area": 1.16, "trim": True, "tolerance": 1e-12, "iprint": 0} | options
    problem.model.add_subsystem("flow", EulerFlow(model=wing(), **options), promotes=["*"])
    problem.setup(mode=mode, force_alloc_complex=is_complex)
    if options["trim"]:
        problem.set_val("CL_target", LIFT)
    return problem


def run(problem, **values):
    """Run it with these values."""
    for name, value in values.items():
        problem.set_val(name, value)
    problem.run_model()
    return problem


@pytest.fixture(scope="module")
def trimmed():
    return run(problem())


def test_angle_that_is_found_gives_the_lift_and_the_flow_of_that_angle(trimmed):
    assert trimmed.get_val("CL").item() == pytest.approx(LIFT, abs=1e-12)
    free = run(problem(trim=False), alpha=trimmed.get_val("alpha"))
    for name in ("CL", "CD", "CM", "CD_induced", "span_load"):
        np.testing.assert_allclose(trimmed.get_val(name), free.get_val(name), rtol=1e-9, atol=1e-11)


@pytest.mark.slow
def test_totals_at_fixed_lift_agree_in_both_modes_and_with_those_at_fixed_angle(trimmed):
    wrt = ["CL_target", "Mach_number"]
    reverse, forward = trimmed.compute_totals(OF, wrt), run(problem("fwd")).compute_totals(OF, wrt)
    for pair, total in reverse.items():
        assert np.abs(forward[pair] - total).max() < 1e-10 * max(1.0, np.abs(total).max()), pair
    free = run(problem(trim=False), alpha=trimmed.get_val("alpha"))
    by_name = free.compute_totals(["CL", "CD"], ["alpha", "Mach_number"])
    slope = by_name["CL", "alpha"]
    at_lift = by_name["CD", "Mach_number"] - by_name["CD", "alpha"] / slope * by_name["CL", "Mach_number"]
    np.testing.assert_allclose(reverse["CD", "Mach_number"], at_lift, rtol=1e-9)
    np.testing.assert_allclose(reverse["alpha", "CL_target"], 1.0 / slope, rtol=1e-9)
    np.testing.assert_allclose(reverse["CL", "CL_target"], 1.0, rtol=1e-12)
    assert np.abs(reverse["CL", "Mach_number"]).max() < 1e-12


def test_totals_by_nodes_at_fixed_lift_agree_with_differences(trimmed):
    nodes, rng = trimmed.get_val("grid").copy(), np.random.default_rng(1)
    totals, along = trimmed.compute_totals(["CL", "CD", "alpha"], ["grid"]), rng.standard_normal(nodes.size)
    along[np.abs(nodes) < 1e-12] = 0.0  # planes of symmetry stay

    def at(step):
        run(trimmed, grid=nodes + step * along)
        return np.array([trimmed.get_val(name).item() for name in ("CD", "alpha")])

    exact = central_difference(at, 1e-5, levels=2)
    run(trimmed, grid=nodes)
    found = [(totals[name, "grid"] @ along).item() for name in ("CD", "alpha")]
    np.testing.assert_allclose(found, exact, rtol=1e-6)
    assert np.abs(totals["CL", "grid"] @ along) < 1e-12 * np.abs(totals["CD", "grid"]).sum()


@pytest.mark.slow
def test_partials_are_exact():
    assert_partials(run(problem(is_complex=True)), atol=1e-9, rtol=1e-10)


def test_states_are_changed_with_the_angle_as_the_flow_is(trimmed):
    state, residuals = trimmed.model.flow.state, {}
    inputs = {name: trimmed.get_val(name) for name in ("grid", "Mach_number")} | {"CL_target": np.array([1.05 * LIFT])}
    solved = {name: trimmed.get_val(name).copy() for name in ("states", "alpha")}

    def left(outputs):
        state.apply_nonlinear(inputs, outputs, residuals)
        return np.linalg.norm(residuals["states"]), abs(residuals["alpha"].item())

    moved = dict(solved)
    state._change(moved, state._sensitivity_at(inputs, solved), 0.05 * LIFT, 1.05 * LIFT)
    moved["alpha"] = np.atleast_1d(moved["alpha"])
    residual, lack = left(moved)
    residual_without, lack_without = left(moved | {"states": solved["states"]})
    assert residual < 0.04 * residual_without
    assert lack < 0.01 * lack_without


def test_next_design_starts_from_states_and_angle_of_the_last():
    flown = run(problem(tolerance=1e-10))
    cold = sum(step.n_products for step in flown.model.flow.state.solution.history)
    run(flown, Mach_number=0.31)
    assert sum(step.n_products for step in flown.model.flow.state.solution.history) < cold
    assert flown.get_val("CL").item() == pytest.approx(LIFT, abs=1e-10)


def test_lift_that_is_out_of_reach_is_refused_in_one_line_and_the_lift_that_it_names_is_found():
    flown = run(problem(tolerance=1e-10))
    angle, states = flown.get_val("alpha").copy(), flown.get_val("states").copy()
    with pytest.raises(
        om.AnalysisError, match=r"CL_target 9 is out of reach: at alpha .* deg CL is .*area \(1.16 m"
    ) as error:
        run(flown, CL_target=9.0)
    assert "\n" not in str(error.value)
    np.testing.assert_array_equal(flown.get_val("alpha"), angle)
    np.testing.assert_array_equal(flown.get_val("states"), states)
    run(flown, CL_target=LIFT)
    assert flown.get_val("alpha").item() == pytest.approx(angle.item(), abs=1e-7)
    with pytest.raises(om.AnalysisError, match=": CL_target is nan"):
        run(flown, CL_target=np.nan)


def test_area_in_another_unit_is_named_with_the_lift_the_angle_it_led_to_and_the_area_of_the_walls():
    flown = problem(reference_area=1.16e6, max_steps=3)
    with pytest.raises(
        om.AnalysisError,
        match=r"CL_target 0.2 is not reached: at alpha 2 deg the flow did not converge: .*; check CL_target, "
        r"axes \('xzy': downstream, along the span, up\) and reference_area \(1.16e\+06 m\^2; the walls as seen "
        r"from above: 1.16 m\^2\), or take a smaller CL_target or Mach number",
    ) as error:
        run(flown, Mach_number=0.7)
    assert "smaller angle" not in str(error.value)


def test_log_shows_the_angle(capsys):
    flown = run(problem(iprint=2, tolerance=1e-10))
    _, head, *lines, _ = capsys.readouterr().out.splitlines()
    assert head.endswith("alpha, deg")
    assert float(lines[-1].split()[-1]) == pytest.approx(flown.get_val("alpha").item(), abs=1e-6)
    assert len(head) == len(lines[0])


def test_two_points_share_a_grid_and_have_angles_of_their_own():
    both = om.Problem(reports=False)
    for name in ("slow", "fast"):
        flow = EulerFlow(model=wing(), reference_area=1.16, trim=True, iprint=0)
        both.model.add_subsystem(name, flow, promotes_inputs=["grid", "CL_target"])
    both.setup(mode="rev")
    run(both, CL_target=LIFT, **{"fast.Mach_number": 0.5})
    angles = [both.get_val(f"{name}.alpha").item() for name in ("slow", "fast")]
    assert angles[0] > angles[1] > 0.0
    totals = both.compute_totals(["slow.CD", "fast.CD"], ["CL_target", "grid"])
    assert min(np.abs(total).max() for total in totals.values()) > 0.0
