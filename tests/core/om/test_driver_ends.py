"""What drivers say of how they ended: success is what the first-order conditions say, and what is wrong has a name."""

import numpy as np
import openmdao.api as om
import pytest
from driver_cases import nlopt_driver, paraboloid

from bspline_mdao import NLoptDriver, ScipyDriver, optimality_of
from bspline_mdao.core.om.drivers.nlopt_optimizer import BLOCKED, STALLED
from bspline_mdao.errors import InputError

pytestmark = pytest.mark.filterwarnings("ignore::openmdao.utils.om_warnings.OpenMDAOWarning")


class Bowl(om.ExplicitComponent):
    """A quartic bowl with two curved constraints, which a start may violate."""

    def initialize(self):
        self.options.declare("seed")

    def setup(self):
        random = np.random.default_rng(self.options["seed"])
        n = int(random.integers(2, 7))
        matrix = random.standard_normal((n, n))
        self.matrix, self.slope = matrix @ matrix.T + 0.1 * np.eye(n), random.standard_normal(n)
        self.centre, self.weights = random.standard_normal((2, n))
        self.radius, self.level = random.uniform(0.3, 1.5, 2)
        self.add_input("x", 3.0 * random.standard_normal(n))
        self.add_output("f")
        self.add_output("c", np.zeros(2))
        self.declare_partials("*", "*")

    def compute(self, inputs, outputs):
        x = inputs["x"]
        outputs["f"] = 0.5 * x @ self.matrix @ x - self.slope @ x + 0.1 * np.sum(x**4) + 2.0
        ball, wave = np.sum((x - self.centre) ** 2) - self.radius**2, np.sin(x).sum() + self.weights @ x - self.level
        outputs["c"] = ball, wave

    def compute_partials(self, inputs, partials):
        x = inputs["x"]
        partials["f", "x"] = self.matrix @ x - self.slope + 0.4 * x**3
        partials["c", "x"] = np.stack([2.0 * (x - self.centre), np.cos(x) + self.weights])


def problem_of(component, driver, **constraint):
    problem = om.Problem(reports=None, driver=driver)
    problem.model.add_subsystem("body", component, promotes=["*"])
    if isinstance(component, Wrong):
        problem.model.add_design_var("a", lower=-1.0, upper=1.0)
    problem.model.add_design_var("x", lower=-5.0, upper=5.0)
    problem.model.add_objective("f")
    if constraint:
        problem.model.add_constraint("c", **constraint)
    problem.setup()
    return problem


def bowl(seed, algorithm, **options):
    problem = problem_of(Bowl(seed=seed), nlopt_driver(algorithm, **options), upper=0.0)
    problem.run_driver()
    return problem


@pytest.mark.slow
def test_ccsaq_that_stalls_beside_a_constraint_is_no_success_and_finds_the_optimum_after_restarts():
    n_stalled = 0
    for seed in range(1, 14):
        exact, alone, again = bowl(seed, "LD_SLSQP"), bowl(seed, "LD_CCSAQ", restarts=0), bowl(seed, "LD_CCSAQ")
        if alone.driver.outcome.end == "STALLED":
            n_stalled += 1
            assert not alone.driver.result.success
            assert "no optimum" in alone.driver.result.exit_status
            assert optimality_of(alone)[0] > STALLED
            assert alone.get_val("f").item() > exact.get_val("f").item() + 1.0
            assert again.driver.outcome.n_restarts > 0
        assert again.driver.result.success
        assert again.driver.outcome.optimality < 1e-3
        assert again.get_val("f").item() == pytest.approx(exact.get_val("f").item(), rel=1e-5)
    assert n_stalled >= 5


def test_an_end_that_is_infeasible_is_not_called_optimal():
    problem = paraboloid(c={"upper": -1.0}, r={"upper": 1e-3})  # nothing satisfies both
    problem.driver = nlopt_driver("LD_SLSQP")
    problem.setup()
    result = problem.run_driver()
    assert not result.success
    assert problem.driver.outcome.end != "OPTIMAL"
    assert "constraints are violated" in result.exit_status


class Steep(om.ExplicitComponent):
    """A slope whose squares overflow."""

    def setup(self):
        self.add_input("x", np.ones(2))
        self.add_output("f")
        self.declare_partials("f", "x", val=1e200)

    def compute(self, inputs, outputs):
        outputs["f"] = 1e200 * inputs["x"].sum()


def test_a_gradient_that_overflows_is_not_called_optimal():
    problem = problem_of(Steep(), nlopt_driver("LD_SLSQP"))
    problem.run_driver()
    assert problem.driver.outcome.end != "OPTIMAL" or problem.get_val("x").max() == -5.0


def test_a_spent_budget_is_stopped_and_no_failure_in_words(capsys):
    problem = problem_of(Bowl(seed=1), NLoptDriver(optimizer="LD_SLSQP", maxeval=3, singular_jac_behavior="ignore"))
    assert not problem.run_driver().success
    printed = capsys.readouterr().out
    assert "Optimization stopped (LD_SLSQP)" in printed
    assert "MAXEVAL_REACHED" in printed
    assert "FAILED" not in printed


class Wrong(om.ExplicitComponent):
    """A bowl one of whose derivatives is not a number, from a computation on."""

    def initialize(self):
        self.options.declare("since", 1)
        self.options.declare("raises", None)

    def setup(self):
        self.add_input("a", 0.1)
        self.add_input("x", [2.0, 1.0, 3.0])
        self.add_output("f")
        self.add_output("c", np.zeros(2))
        self.declare_partials("*", "*")
        self.n_runs = self.n_partials = 0

    def compute(self, inputs, outputs):
        self.n_runs += 1
        if self.options["raises"] and self.n_runs == 5:
            raise self.options["raises"]
        outputs["f"], outputs["c"] = np.sum(inputs["x"] ** 4) + inputs["a"] ** 2, inputs["x"][:2]

    def compute_partials(self, inputs, partials):
        self.n_partials += 1
        partials["f", "x"], partials["c", "x"] = 4.0 * inputs["x"] ** 3, np.eye(2, 3)
        partials["f", "a"], partials["c", "a"] = 2.0 * inputs["a"], 0.0
        if self.n_partials >= self.options["since"]:
            partials["c", "x"][1, 2] = np.nan


DRIVERS = {
    "NLopt": lambda: nlopt_driver("LD_SLSQP"),
    "NLopt MMA": lambda: nlopt_driver("LD_MMA"),
    "SciPy": lambda: ScipyDriver(optimizer="SLSQP", disp=False),
}


@pytest.mark.parametrize("name", DRIVERS)
def test_a_derivative_that_is_no_number_is_named_at_its_first_evaluation(name):
    problem = problem_of(Wrong(), DRIVERS[name](), lower=-1.0)
    with pytest.raises(InputError, match="d c / d x of component body is not a finite number"):
        problem.run_driver()


def test_a_derivative_that_is_no_number_later_is_named_in_the_status():
    problem = problem_of(Wrong(since=3), nlopt_driver("LD_SLSQP"), lower=-1.0)
    assert not problem.run_driver().success
    assert "d c / d x of component body is not a finite number" in problem.driver.get_exit_status()
    assert problem.driver.outcome.optimality is None or problem.driver.outcome.optimality > BLOCKED


def best_of(problem):
    return problem.driver.best.objective, tuple(problem.driver.best.x)


def test_scipy_keeps_the_best_design_where_derivatives_are_no_numbers_later():
    problem = problem_of(Wrong(since=3), DRIVERS["SciPy"](), lower=-1.0)
    with pytest.warns(om.DriverWarning, match="d c / d x of component body is not a finite number"):
        assert not problem.run_driver().success
    objective, (_, *x) = best_of(problem)
    assert problem.get_val("x").tolist() == x
    assert problem.get_val("f").item() == objective < 2.0**4 + 1.0 + 3.0**4 + 0.1**2


@pytest.mark.parametrize("optimizer", ["SLSQP", "COBYLA", "BFGS"])
@pytest.mark.parametrize("kind", [ZeroDivisionError, KeyboardInterrupt])
def test_scipy_keeps_the_best_design_at_exceptions_and_interrupts(optimizer, kind):
    raised = kind("in the model")
    constraint = {} if optimizer == "BFGS" else {"lower": -1.0}
    problem = problem_of(Wrong(since=99, raises=raised), ScipyDriver(optimizer=optimizer, disp=False), **constraint)
    if kind is KeyboardInterrupt:
        assert not problem.run_driver().success
        assert "INTERRUPTED" in problem.driver.get_exit_status()
        assert problem.get_val("f").item() == problem.driver.best.objective
    else:
        with pytest.raises(kind, match="in the model"):
            problem.run_driver()
        assert "it is kept in driver.best" in "".join(getattr(raised, "__notes__", ["it is kept in driver.best"]))
    assert problem.get_val("x").tolist() == problem.driver.best.x[1:].tolist()
    assert problem.driver.best.objective <= 2.0**4 + 1.0 + 3.0**4 + 0.1**2


@pytest.mark.parametrize("name", DRIVERS)
def test_an_objective_that_is_no_number_at_the_start_is_said(name):
    class Nothing(Wrong):
        def compute(self, inputs, outputs):
            outputs["f"] = np.nan

    with pytest.raises(om.AnalysisError, match="at the start is not a finite number"):
        problem_of(Nothing(), DRIVERS[name](), lower=-1.0).run_driver()
