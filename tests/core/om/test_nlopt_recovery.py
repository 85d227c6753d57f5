"""The NLopt driver where analyses fail, and what it predicts of the algorithms."""

import numpy as np
import openmdao.api as om
import pytest
from driver_cases import CASES, error, nlopt_driver, solve
from scipy.optimize import rosen, rosen_der

from bspline_mdao.core.om.drivers import nlopt_driver as module
from bspline_mdao.core.om.drivers.nlopt_algorithms import ALGORITHMS
from bspline_mdao.core.om.drivers.nlopt_functions import Functions
from bspline_mdao.core.om.drivers.nlopt_problem import AnalysisFailed, Statement, split_constraints
from bspline_mdao.core.om.drivers.nlopt_rules import (
    RECOVERIES,
    TURN,
    ConservativeRules,
    LineSearchRules,
    NoRules,
    SearchRecord,
    not_a_number,
    uphill,
    worst,
)
from bspline_mdao.core.om.drivers.optimality import multipliers, optimality
from bspline_mdao.core.om.drivers.scaled_model import ScaledModel

GRADIENT = [a.name for a in ALGORITHMS.values() if a.gradients and a.is_compiled and not a.is_global]
PLAIN = [name for name in GRADIENT if ALGORITHMS[name].local_optimizer == "none"]
pytestmark = pytest.mark.filterwarnings("ignore::openmdao.utils.om_warnings.OpenMDAOWarning")

WEIGHTS = np.linspace(1.0, 50.0, 5)


class Walled(om.ExplicitComponent):
    """A bowl or a valley in five variables with its optimum at one, which cannot be analysed beyond a wall."""

    def initialize(self):
        self.options.declare("valley", False)
        self.options.declare("is_beyond", default=lambda x: (x > 1.05).any())
        self.options.declare("says_nan", False)

    def setup(self):
        self.add_input("x", np.linspace(-3.0, -1.0, 5))
        self.add_output("f")
        self.add_output("total")
        self.declare_partials("f", "x")
        self.declare_partials("total", "x", val=1.0)
        self.n_failed = 0

    def compute(self, inputs, outputs):
        x = inputs["x"]
        outputs["f"] = rosen(x) if self.options["valley"] else WEIGHTS @ (x - 1.0) ** 2
        outputs["total"] = x.sum()
        if self.options["is_beyond"](x):
            self.n_failed += 1
            outputs["f"] = np.nan
            if not self.options["says_nan"]:
                raise om.AnalysisError("beyond the wall")

    def compute_partials(self, inputs, partials):
        x = inputs["x"]
        partials["f", "x"] = rosen_der(x) if self.options["valley"] else 2.0 * WEIGHTS * (x - 1.0)


def walled(algorithm, *, start=None, constraint=None, options=None, **settings):
    """Run a driver on the walled problem; the problem and the component."""
    problem = om.Problem(reports=None)
    component = problem.model.add_subsystem("walled", Walled(**settings), promotes=["*"])
    problem.model.add_design_var("x", lower=-8.0, upper=8.0)
    problem.model.add_objective("f")
    if constraint:
        problem.model.add_constraint("total", **constraint)
    problem.driver = nlopt_driver(algorithm, **(options or {}))
    problem.setup()
    if start is not None:
        problem.set_val("x", start)
    problem.run_driver()
    return problem, component


@pytest.mark.parametrize("algorithm", GRADIENT)
def test_every_gradient_algorithm_survives_a_wall_in_its_way(algorithm):
    problem, component = walled(algorithm)
    assert component.n_failed > 0
    assert problem.driver.n_failed_analyses == component.n_failed
    assert problem.get_val("f").item() < 1e-6
    assert problem.driver.result.success
    assert f"{component.n_failed} analyses failed" in problem.driver.result.exit_status


@pytest.mark.parametrize("algorithm", [name for name in PLAIN if name not in ("LD_MMA", "LD_CCSAQ")])
def test_every_gradient_algorithm_survives_a_wall_along_a_valley(algorithm):
    problem, component = walled(algorithm, valley=True, start=np.linspace(-1.2, 0.5, 5))
    assert problem.get_val("f").item() < 1e-6
    assert problem.driver.result.success
    assert component.n_failed == problem.driver.n_failed_analyses


@pytest.mark.parametrize("algorithm", [name for name in GRADIENT if ALGORITHMS[name].inequality])
def test_walls_are_survived_beside_inequality_constraints(algorithm):
    problem, component = walled(algorithm, constraint={"upper": 4.0}, is_beyond=lambda x: (x > 1.02).any())
    optimum = 1.0 / np.sum(1.0 / WEIGHTS)
    assert component.n_failed > 0
    assert problem.get_val("f").item() == pytest.approx(optimum, abs=3e-6)
    assert problem.driver.result.success


INSIDE = [("LD_SLSQP", None), ("AUGLAG", "LD_LBFGS"), ("AUGLAG", "LD_TNEWTON"), ("AUGLAG_EQ", "LD_SLSQP")]


@pytest.mark.parametrize(("algorithm", "local_optimizer"), INSIDE)
def test_walls_are_survived_beside_equality_constraints(algorithm, local_optimizer):
    options = {"local_optimizer": local_optimizer, "maxeval": 3000}
    problem, component = walled(algorithm, constraint={"equals": 4.0}, options=options)
    assert component.n_failed > 0
    assert problem.get_val("f").item() == pytest.approx(1.0 / np.sum(1.0 / WEIGHTS), abs=3e-6)
    assert problem.driver.result.success


@pytest.mark.slow
@pytest.mark.parametrize(
    "algorithm", ["LN_COBYLA", "LN_BOBYQA", "LN_SBPLX", "LN_NELDERMEAD", "GN_DIRECT_L", "GN_CRS2_LM"]
)
def test_algorithms_without_gradients_survive_walls(algorithm):
    problem, component = walled(algorithm, options={"maxeval": 4000}, is_beyond=lambda x: x[0] > 1.3)
    assert component.n_failed > 0
    assert problem.get_val("f").item() < 0.3


def test_a_result_that_is_not_a_number_counts_as_a_failed_analysis():
    problem, component = walled("LD_LBFGS", says_nan=True)
    assert problem.driver.n_failed_analyses == component.n_failed > 0
    assert problem.get_val("f").item() < 1e-6


@pytest.mark.parametrize("algorithm", ["LD_MMA", "LD_CCSAQ", "LD_LBFGS", "LD_SLSQP"])
def test_a_run_that_is_held_up_by_failures_is_no_success(algorithm):
    problem, _ = walled(algorithm, is_beyond=lambda x: (x > 0.5).any())
    status = problem.driver.result.exit_status
    assert not problem.driver.result.success
    assert status.startswith(
        "MAXEVAL_REACHED" if algorithm == "LD_SLSQP" else "BLOCKED: analyses or gradients fail around the best"
    )
    assert np.all(problem.get_val("x") <= 0.5)


def test_an_analysis_that_fails_at_the_start_comes_out_as_it_is():
    with pytest.raises(om.AnalysisError, match="beyond the wall"):
        walled("LD_SLSQP", start=np.full(5, 2.0))
    with pytest.raises(om.AnalysisError, match="at the start is not a finite number"):
        walled("LD_SLSQP", start=np.full(5, 2.0), says_nan=True)


@pytest.mark.parametrize("says_nan", [False, True])
def test_a_start_that_bounds_bring_to_where_analyses_fail_comes_out_as_one_too(says_nan):
    problem = om.Problem(driver=nlopt_driver("LD_SLSQP"), reports=None)
    problem.model.add_subsystem("walled", Walled(says_nan=says_nan), promotes=["*"])
    problem.model.add_design_var("x", lower=2.0, upper=8.0)
    problem.model.add_objective("f")
    problem.setup()
    with pytest.raises(om.AnalysisError, match="at the start, which was brought within its bounds: "):
        problem.run_driver()


class Stiff(om.ImplicitComponent):
    """y = x^3 by Newton's method from where it is, which a failure leaves at infinity."""

    def setup(self):
        self.add_input("x", -1.0)
        self.add_output("y", 1.0)
        self.declare_partials("y", ["x", "y"])

    def apply_nonlinear(self, inputs, outputs, residuals):
        residuals["y"] = outputs["y"] - inputs["x"] ** 3

    def solve_nonlinear(self, inputs, outputs):
        if not np.isfinite(outputs["y"]).all():
            raise AssertionError("the analysis starts from the ruins of the last one")
        outputs["y"] = inputs["x"] ** 3
        if inputs["x"] > 1.2:
            outputs["y"] = np.inf
            raise om.AnalysisError("diverged")

    def linearize(self, inputs, outputs, partials):
        partials["y", "x"] = -3.0 * inputs["x"] ** 2
        partials["y", "y"] = 1.0


@pytest.mark.parametrize("algorithm", ["LD_SLSQP", "LD_MMA", "LD_LBFGS"])
def test_the_analysis_after_a_failed_one_starts_from_the_last_good_states(algorithm):
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("stiff", Stiff(), promotes=["*"])
    problem.model.add_subsystem("f", om.ExecComp("f = (y - 1)**2 + x**2 - 2*x"), promotes=["*"])
    problem.model.set_input_defaults("x", -1.0)
    problem.model.linear_solver = om.DirectSolver()
    problem.model.add_design_var("x", lower=-3.0, upper=30.0)
    problem.model.add_objective("f")
    problem.driver = nlopt_driver(algorithm)
    problem.setup()
    problem.run_driver()
    assert problem.driver.n_failed_analyses > 0
    assert problem.get_val("x").item() == pytest.approx(1.0, abs=1e-3)


class Creeping(Stiff):
    """y = x^3, which is found from states that are near alone."""

    def solve_nonlinear(self, inputs, outputs):
        if np.abs(np.cbrt(outputs["y"]) - inputs["x"]) > 1.5:
            raise om.AnalysisError("too far")
        outputs["y"] = inputs["x"] ** 3


def test_the_best_point_is_found_again_from_its_own_states():
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("creeping", Creeping(), promotes=["*"])
    problem.model.set_input_defaults("x", 1.0)
    problem.model.add_design_var("x")
    problem.model.add_objective("y")
    problem.driver = nlopt_driver("LD_SLSQP")
    problem.setup()
    problem.final_setup()
    model = ScaledModel(problem.driver)
    model.start()
    assert model.run(np.array([2.0]))[0] == pytest.approx(8.0)
    model.keep()
    for x in (3.0, 4.0):
        model.run(np.array([x]))
    with pytest.raises(AnalysisFailed, match="too far"):
        model.run(np.array([2.0]))
    assert model.restore(np.array([2.0]))[0] == pytest.approx(8.0)


class BrokenGradient(Walled):
    """The wall, seen by the derivatives alone."""

    def compute(self, inputs, outputs):
        outputs["f"] = WEIGHTS @ (inputs["x"] - 1.0) ** 2

    def compute_partials(self, inputs, partials):
        if (inputs["x"] > 1.05).any():
            self.n_failed += 1
            raise om.AnalysisError("no adjoint")
        super().compute_partials(inputs, partials)


@pytest.mark.parametrize("algorithm", ["LD_MMA", "LD_LBFGS", "LD_TNEWTON"])
def test_derivatives_that_fail_count_as_a_failed_analysis(algorithm):
    problem = om.Problem(reports=None)
    component = problem.model.add_subsystem("walled", BrokenGradient(), promotes=["*"])
    problem.model.add_design_var("x", lower=-8.0, upper=8.0)
    problem.model.add_objective("f")
    problem.driver = nlopt_driver(algorithm)
    problem.setup()
    problem.run_driver()
    assert problem.driver.n_failed_analyses == component.n_failed > 0
    assert problem.get_val("f").item() < 1e-6


# Kernels


def statement(n=3, m=2):
    """A problem without limits but one."""
    upper = np.array([1.0, *np.full(m - 1, np.inf)])
    rows = split_constraints(np.full(m, -np.inf), upper, np.full(m, np.nan))
    return Statement(np.full(n, -np.inf), np.full(n, np.inf), *rows, tolerance=1e-6)


def record_of(random):
    """Record of a problem with three variables and two constraints."""
    base, other = (statement().point(random.standard_normal(3), f, random.standard_normal(2)) for f in (2.0, 5.0))
    return SearchRecord(base, random.standard_normal((3, 3)), 5.0, other)


def test_uphill_leaves_the_base_with_its_slope_and_turns_early():
    random = np.random.default_rng(1)
    given = record_of(random)
    step = -random.uniform(0.5, 1.5, 3) * given.totals[0]
    slope = given.totals[0] @ step
    substitute = uphill(given, given.base.x + step)
    curvature = -slope / TURN
    assert substitute.objective == pytest.approx(given.base.objective + slope + curvature / 2, rel=1e-12)
    assert substitute.totals[0] @ step == pytest.approx(slope + curvature, rel=1e-12)
    assert substitute.objective > given.base.objective
    np.testing.assert_array_equal(substitute.totals[1:], given.totals[1:])


def test_the_worst_is_worse_than_all_that_was_seen():
    given = record_of(np.random.default_rng(2))
    substitute = worst(given, np.zeros(3))
    assert substitute.objective == pytest.approx(5.0 + 3.0)
    np.testing.assert_array_equal(substitute.constraints, given.most_violating.constraints)


def test_nothing_is_said_by_what_is_not_a_number():
    assert np.isnan(not_a_number(record_of(np.random.default_rng(3)), np.zeros(3)).objective)
    assert {algorithm.recovery for algorithm in ALGORITHMS.values()} == set(RECOVERIES)


def test_constraints_are_split_into_rows_with_one_limit_each():
    lower = np.array([-np.inf, 1.0, -2.0, 0.0, -np.inf])
    upper = np.array([3.0, np.inf, 2.0, 0.0, np.inf])
    equals = np.array([np.nan, np.nan, np.nan, 7.0, np.nan])
    inequalities, equalities = split_constraints(lower, upper, equals)
    np.testing.assert_array_equal(inequalities.values(np.array([4.0, 0.5, 0.0, 9.0, 1.0])), [1.0, -2.0, 0.5, -2.0])
    np.testing.assert_array_equal(equalities.values(np.array([4.0, 0.5, 0.0, 9.0, 1.0])), [2.0])
    jacobian = np.arange(10.0).reshape(5, 2)
    np.testing.assert_array_equal(inequalities.gradients(jacobian), [[0, 1], [4, 5], [-2, -3], [-4, -5]])


class Undifferentiated(Walled):
    """The bowl, the derivatives of which fail at some points: not a number."""

    def compute_partials(self, inputs, partials):
        super().compute_partials(inputs, partials)
        if inputs["x"].max() > 0.0:
            raise om.AnalysisError("no derivatives here")


@pytest.mark.parametrize("algorithm", ["LD_SLSQP", "LD_MMA"])
def test_failed_gradients_are_counted_and_told(algorithm):
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("walled", Undifferentiated(is_beyond=lambda x: False), promotes=["*"])
    problem.model.add_design_var("x", lower=-8.0, upper=8.0)
    problem.model.add_objective("f")
    problem.driver = nlopt_driver(algorithm, maxeval=20)
    problem.setup()
    problem.run_driver()
    driver = problem.driver
    n = driver.n_failed_gradients
    assert driver.n_failed_analyses == n > 0
    assert f"; {n} analyses failed ({n} of them in gradients), " in driver.get_exit_status()
    assert not driver.result.success


def test_optimality_is_what_no_limit_holds_back():
    lower, upper = np.array([0.0, -np.inf, -np.inf]), np.full(3, np.inf)
    rows = split_constraints(np.array([-np.inf]), np.array([1.0]), np.array([np.nan]))
    problem = Statement(lower, upper, *rows, tolerance=1e-6)
    totals = np.array([[2.0, -3.0, 0.5], [0.0, 1.0, 0.0]])
    held = problem.point(np.array([0.0, 1.0, 0.0]), 0.0, np.array([1.0]))
    assert optimality(problem, held, totals) == pytest.approx(0.5)
    free = problem.point(np.array([0.5, 0.2, 0.0]), 0.0, np.array([0.2]))
    assert optimality(problem, free, totals) == pytest.approx(np.linalg.norm(totals[0]))
    pulled = problem.point(np.array([0.0, 1.0, 0.0]), 0.0, np.array([1.0]))
    assert optimality(problem, pulled, -totals) > 2.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_equality_holds_the_point_on_either_side(sign):
    """Its multiplier has either sign; those of inequalities and of bounds have one."""
    lower, upper = np.array([-np.inf, -np.inf, 0.0]), np.array([np.inf, 2.0, np.inf])
    rows = split_constraints(np.array([np.nan]), np.array([np.nan]), np.array([1.0]))
    problem = Statement(lower, upper, *rows, tolerance=1e-6)
    gradient = np.array([3.0, -1.0, 0.0])
    point = problem.point(np.array([1.0, 0.0, 0.0]), 0.0, np.array([1.0]))
    assert optimality(problem, point, np.array([sign * gradient, gradient])) == pytest.approx(0.0, abs=1e-12)
    off = sign * gradient + [0.0, 0.0, 0.25]  # what the lower bound of the third variable holds back
    assert optimality(problem, point, np.array([off, gradient])) == pytest.approx(0.0, abs=1e-12)
    free = sign * gradient - [0.0, 0.0, 0.25]  # away from it
    assert optimality(problem, point, np.array([free, gradient])) == pytest.approx(0.25)


def test_an_upper_bound_holds_a_point_that_would_rise():
    rows = split_constraints(np.zeros(0), np.zeros(0), np.zeros(0))
    problem = Statement(np.full(2, -np.inf), np.array([2.0, np.inf]), *rows, tolerance=1e-6)
    at_bound = problem.point(np.array([2.0, 0.0]), 0.0, np.zeros(0))
    assert optimality(problem, at_bound, np.array([[-3.0, 0.0]])) == pytest.approx(0.0, abs=1e-12)
    assert optimality(problem, at_bound, np.array([[3.0, 0.0]])) == pytest.approx(3.0)


@pytest.mark.parametrize(("limit", "near", "away"), [(0.2, 0.9e-4, 1.1e-4), (300.0, 0.029, 0.031)])
def test_a_limit_holds_a_point_within_a_ten_thousandth_of_its_size_or_of_one(limit, near, away):
    rows = split_constraints(np.array([limit]), np.array([np.inf]), np.array([np.nan]))
    problem = Statement(np.full(2, -np.inf), np.array([limit, np.inf]), *rows, tolerance=1e-6)
    totals = np.array([[-3.0, 2.0], [0.0, 1.0]])  # the bound holds the first variable, the constraint the second
    for off, expected in ((near, 0.0), (away, np.hypot(3.0, 2.0))):
        point = problem.point(np.array([limit - off, 0.0]), 0.0, np.array([limit + off]))
        assert optimality(problem, point, totals) == pytest.approx(expected, abs=1e-12)


def test_multipliers_of_equalities_have_either_sign_and_those_of_limits_one():
    limits = np.array([np.nan, 2.0, -np.inf]), np.array([np.nan, np.inf, 5.0]), np.array([1.0, np.nan, np.nan])
    problem = Statement(np.full(3, -np.inf), np.full(3, np.inf), *split_constraints(*limits), tolerance=1e-6)
    gradients = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0]])
    point = problem.point(np.zeros(3), 0.0, np.array([1.0, 2.0, 5.0]))
    for expected in ([0.7, -0.4, 0.3], [-0.7, -0.4, 0.3]):
        totals = np.vstack([-np.array(expected) @ gradients, gradients])
        np.testing.assert_allclose(multipliers(problem, point, totals), expected, rtol=1e-12)


# AlgorithmRules


def test_no_point_is_accepted_that_is_not_below_all_feasible_ones():
    rules, at = ConservativeRules(), lambda f, c: statement().point(np.zeros(3), f, np.array([c, 0.0]))
    rules.keep(at(2.0, 1.001), np.zeros(3))  # not feasible: the first constraint is at most one
    assert not rules.is_rejected(at(3.0, 0.0))
    rules.keep(at(4.0, 1.0), np.zeros(3))
    assert [rules.is_rejected(at(f, 0.0)) for f in (3.999, 4.0, 4.001)] == [False, True, True]
    rules.keep(at(5.0, 0.0), np.zeros(3))
    assert rules.is_rejected(at(4.0, 0.0))


def test_what_stands_for_failed_analyses_is_made_of_the_size_of_the_objective_and_totals_of_its_base():
    first = statement().point(np.zeros(3), -4.0, np.zeros(2))
    record = SearchRecord.at(first).with_totals(first, np.ones((3, 3)))
    assert record.spread == pytest.approx(0.4)
    assert worst(record, np.ones(3)).objective == pytest.approx(-3.6)
    better = statement().point(np.ones(3), -6.0, np.zeros(2))
    record = record.with_point(better, 1e-6)
    assert record.base is better
    assert not record.totals.any()  # they were those of another point
    assert record.spread == pytest.approx(2.0)
    assert record.with_totals(first, np.ones((3, 3))) is record
    assert record.with_point(first, 1e-6).with_totals(better, 2.0 * np.ones((3, 3))).totals.all()


def visited(case, algorithm, make_rules, monkeypatch):
    """All points at which an algorithm asks for the objective, and the number of total derivatives."""
    points, objective = [], Functions.objective

    def remembering(self, x, gradient):
        points.append(x.copy())
        return objective(self, x, gradient)

    with monkeypatch.context() as patch:
        patch.setattr(Functions, "objective", remembering)
        patch.setattr(module, "_rules_of", make_rules)
        problem = solve(case, nlopt_driver(algorithm))
    assert error(case, problem) < 1e-6
    return np.array(points), problem.driver.result.deriv_evals


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["LD_MMA", "LD_CCSAQ", "LD_SLSQP"])
def test_gradients_that_are_left_out_change_no_point(algorithm, monkeypatch):
    class Patient(LineSearchRules):
        def is_converged(self, x):
            return False

    predicted = {"LD_SLSQP": lambda *_: Patient(1e-9, 0.0, 1e-6)}.get(algorithm, lambda *_: ConservativeRules())
    saved = 0
    for case in CASES:
        if case.has_equality and not ALGORITHMS[algorithm].equality:
            continue
        (all_points, n_all), (points, n_some) = (
            visited(case, algorithm, make_rules, monkeypatch) for make_rules in (lambda *_: NoRules(), predicted)
        )
        np.testing.assert_array_equal(all_points, points)
        assert n_some <= n_all
        saved += n_all - n_some
    assert saved > 5


def test_a_converged_line_search_is_not_begun():
    point = statement().point(np.zeros(3), 4.0, np.zeros(2))
    rules = LineSearchRules(1e-6, 0.0, 1e-6)
    assert not rules.is_converged(np.ones(3))
    rules.keep(point, np.array([1.0, 0.0, 0.0]))
    assert rules.is_converged(np.array([-3e-6, 5.0, 0.0]))
    assert not rules.is_converged(np.array([-5e-6, 5.0, 0.0]))
    rules.fail()
    assert not rules.is_converged(np.array([-3e-6, 5.0, 0.0]))
    rules.keep(statement().point(np.zeros(3), 4.0, np.array([2.0, 0.0])), np.array([1.0, 0.0, 0.0]))
    assert not rules.is_converged(np.array([-3e-6, 5.0, 0.0]))
