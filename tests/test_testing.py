"""The checks of derivatives find what is right and what is wrong, and pass nothing that is empty."""

import subprocess
import sys

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import InputError
from bspline_mdao.testing import (
    assert_partials,
    central_difference,
    check_totals,
    complex_step,
    dot_test,
    perturb_design,
    richardson,
    taylor_rate,
    total_difference,
)

A = np.random.default_rng(0).normal(size=(4, 5))


class Cubes(om.ExplicitComponent):
    """``y = A x^3`` and its sum, whose derivatives are multiplied by a factor."""

    def initialize(self):
        self.options.declare("factor", default=1.0)

    def setup(self):
        self.add_input("x", val=np.linspace(0.5, 1.5, 5))
        self.add_output("y", shape=4)
        self.add_output("total")
        self.declare_partials("*", "x")

    def compute(self, inputs, outputs):
        outputs["y"] = A @ inputs["x"] ** 3
        outputs["total"] = outputs["y"].sum()

    def compute_partials(self, inputs, partials):
        partials["y", "x"] = self.options["factor"] * 3.0 * A * inputs["x"] ** 2
        partials["total", "x"] = partials["y", "x"].sum(axis=0)


def cubes(factor=1.0, constrained=None, **design):
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("cubes", Cubes(factor=factor), promotes=["*"])
    problem.model.add_design_var("x", **{"ref": 0.1, **design})
    problem.model.add_objective("total")
    problem.model.add_constraint("y", indices=constrained, lower=0.0)
    problem.setup()
    problem.run_model()
    return problem


@pytest.mark.slow
def test_testing_does_not_load_the_framework():
    code = "import sys, bspline_mdao.testing; assert 'openmdao' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=300).returncode == 0


@pytest.mark.parametrize("levels", [1, 2, 3])
def test_extrapolated_differences_are_of_twice_the_order_of_their_levels(levels):
    errors = [abs(central_difference(lambda h: np.sin(1.0 + h), step, levels) - np.cos(1.0)) for step in (0.4, 0.2)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0 * levels, abs=0.1)


def test_richardson_takes_arrays_and_refuses_nothing():
    steps = 0.5 / 2.0 ** np.arange(3)
    limit = richardson([np.array([1.0, 2.0]) + h**2 * np.array([3.0, -1.0]) + h**4 for h in steps])
    np.testing.assert_allclose(limit, [1.0, 2.0], atol=1e-14)
    with pytest.raises(InputError, match="no values"):
        richardson([])


def test_complex_step_is_exact_and_refuses_what_drops_it():
    x, d = np.array([0.5, 2.0]), np.array([1.0, -3.0])
    np.testing.assert_allclose(
        complex_step(lambda x: np.exp(x) / x, x, d), np.exp(x) * (x - 1.0) / x**2 * d, rtol=1e-15
    )
    with pytest.raises(InputError, match="drops the derivative"):
        complex_step(np.abs, x, d)
    for empty in (lambda x: x[:0], lambda x: x):
        with pytest.raises(InputError, match="empty"):
            complex_step(empty, x if empty(x).size == 0 else x[:0], d if empty(x).size == 0 else d[:0])


def test_dot_test_sees_a_wrong_transpose_and_refuses_zeros_and_shapes():
    assert dot_test(A.__matmul__, A.T.__matmul__, 5, 4) < 1e-15
    wrong = A.copy()
    wrong[1, 2] += 1e-6
    assert 1e-9 < dot_test(A.__matmul__, wrong.T.__matmul__, 5, 4) < 1e-5
    with pytest.raises(InputError, match="all products are zero"):
        dot_test(lambda x: np.zeros(4), lambda y: np.zeros(5), 5, 4)
    with pytest.raises(InputError, match=r"reverse product has the shape \(4,\), not \(5,\)"):
        dot_test(A.__matmul__, lambda y: y, 5, 4)
    with pytest.raises(InputError, match="empty"):
        dot_test(A.__matmul__, A.T.__matmul__, 0, 4)


def test_taylor_rate_is_two_for_the_derivative_one_for_another_and_infinite_for_lines():
    x, d = np.linspace(0.1, 1.0, 5), np.ones(5)
    exact = -np.sin(x) * d
    assert taylor_rate(np.cos, x, d, exact) == pytest.approx(2.0, abs=0.05)
    assert taylor_rate(np.cos, x, d, 1.01 * exact) == pytest.approx(1.0, abs=0.3)
    assert taylor_rate(A.__matmul__, x, d, A @ d) == np.inf
    with pytest.raises(InputError, match="does not change"):
        taylor_rate(np.ones_like, x, d, 0.0 * x)


@pytest.mark.slow
def test_totals_are_checked_in_units_of_the_driver_and_the_table_falls_by_four():
    check = check_totals(cubes(), step=0.1)
    assert check.transposed < 1e-14
    assert check.differences < 1e-11
    np.testing.assert_allclose(check.steps, [0.1, 0.05, 0.025, 0.0125])
    np.testing.assert_allclose(check.errors[:-1] / check.errors[1:], 4.0, rtol=1e-3)
    first, *_, limit, exact = str(check).splitlines()
    assert first.split() == ["step", "error", "of"]
    assert limit.endswith(f"{check.differences:.2e}  differences extrapolated to step zero")
    assert exact.endswith(f"{check.transposed:.2e}  forward derivatives by reverse ones")
    assert len(str(check).splitlines()) == 7


def test_wrong_totals_are_seen_and_the_problem_is_left_where_it_was():
    problem = cubes(factor=1.001)
    before = problem.get_val("x").copy(), problem.get_val("y").copy()
    assert check_totals(problem, step=0.1).differences == pytest.approx(1e-3 / 1.001, rel=1e-3)
    np.testing.assert_array_equal(problem.get_val("x"), before[0])
    np.testing.assert_array_equal(problem.get_val("y"), before[1])


def test_entries_that_are_not_designed_do_not_count():
    check = check_totals(cubes(indices=[1, 3], ref=1.0), step=0.01)
    assert check.differences < 1e-9
    assert check.transposed < 1e-14


def test_entries_that_are_not_constrained_do_not_count():
    problem = cubes(constrained=[2, 0])
    assert check_totals(problem, step=0.1).transposed < 1e-14


def test_totals_of_nothing_are_refused():
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("cubes", Cubes(factor=0.0), promotes=["*"])
    problem.setup()
    problem.run_model()
    with pytest.raises(InputError, match="no responses or no design variables"):
        check_totals(problem)
    with pytest.raises(InputError, match="'y' does not depend"):
        check_totals(problem, ["y"], ["x"])
    with pytest.raises(InputError, match="no outputs or no inputs"):
        total_difference(problem, [], {"x": np.ones(5)})


def test_derivatives_that_vanish_by_symmetry_are_refused_and_not_compared_with_round_off():
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("hill", om.ExecComp("y = 3 + cos(x)"), promotes=["*"])
    problem.model.add_design_var("x", ref=2.0)
    problem.model.add_objective("y")
    problem.setup()
    problem.set_val("x", np.pi)
    problem.run_model()
    assert 0.0 < abs(problem.compute_totals()["y", "x"].item()) < 1e-15
    for step in (1e-3, 0.4):
        with pytest.raises(InputError, match=r"'y' does not depend .* round-off; .* perturb_design"):
            check_totals(problem, step=step)
    assert check_totals(perturb_design(problem), step=0.1).differences < 1e-9
    problem.set_val("x", np.pi + 1e-3)  # small derivatives are compared
    problem.run_model()
    assert check_totals(problem, step=0.1).differences < 1e-9


def test_a_perturbed_design_moves_by_parts_of_its_units():
    problem = cubes()
    moved = perturb_design(problem, size=0.5).get_val("x") - np.linspace(0.5, 1.5, 5)
    assert 0.0 < np.abs(moved).max() <= 0.05


@pytest.mark.parametrize(("factor", "match"), [(0.0, "J_fwd is empty or zero"), (1.1, "cubes")])
def test_partials_that_are_wrong_or_zero_do_not_pass(factor, match):
    assert_partials(cubes())
    with pytest.raises(ValueError, match=match):
        assert_partials(cubes(factor))


def test_a_component_that_judges_and_has_no_outputs_has_nothing_to_check():
    class Judge(om.ExplicitComponent):
        def setup(self):
            self.add_input("y", shape=4)

    problem = om.Problem(reports=None)
    problem.model.add_subsystem("cubes", Cubes(factor=1.0), promotes=["*"])
    problem.model.add_subsystem("judge", Judge(), promotes=["*"])
    problem.setup()
    problem.run_model()
    assert_partials(problem)


def test_a_problem_without_components_does_not_pass():
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("given", om.IndepVarComp("x"))
    problem.setup()
    problem.run_model()
    with pytest.raises(InputError, match="no component"):
        assert_partials(problem)
