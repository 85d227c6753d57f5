"""SciPy's optimizers survive analyses that fail, and tell how far they are."""

import numpy as np
import openmdao.api as om
import pytest
from driver_cases import paraboloid
from test_nlopt_recovery import WEIGHTS, Walled

from bspline_mdao import ScipyDriver
from bspline_mdao.core.om.drivers import scipy_driver as module
from bspline_mdao.core.om.drivers.scipy_driver import RECOVERIES

pytestmark = pytest.mark.filterwarnings("ignore::openmdao.utils.om_warnings.OpenMDAOWarning")
TIGHT = 1.0 / np.sum(1.0 / WEIGHTS)


def walled(optimizer, constraint=None, driver=ScipyDriver, make=Walled, **settings):
    problem = om.Problem(reports=None, driver=driver(optimizer=optimizer, tol=1e-9, maxiter=2000, disp=False))
    component = problem.model.add_subsystem("walled", make(**settings), promotes=["*"])
    problem.model.add_design_var("x", lower=-8.0, upper=8.0)
    problem.model.add_objective("f")
    if constraint:
        problem.model.add_constraint("total", **constraint)
    problem.setup()
    return problem, component


def is_quick(optimizer):
    return optimizer not in ("differential_evolution", "Nelder-Mead", "COBYLA")


@pytest.mark.parametrize("optimizer", list(filter(is_quick, RECOVERIES)))
@pytest.mark.parametrize("says_nan", [False, True])
def test_optimizers_survive_a_wall_in_their_way(optimizer, says_nan):
    problem, component = walled(optimizer, says_nan=says_nan)
    assert problem.run_driver().success
    assert problem.get_val("f").item() < 1e-6
    assert problem.driver.n_failed_analyses == component.n_failed > 0


@pytest.mark.parametrize("constraint", [{"equals": 4.0}, {"upper": 4.0}])
def test_a_wall_is_survived_beside_constraints(constraint):
    problem, component = walled("SLSQP", constraint)
    assert problem.run_driver().success
    assert component.n_failed > 0
    assert problem.get_val("f").item() == pytest.approx(TIGHT, abs=1e-6)


def test_openmdao_s_own_driver_ends_at_the_wall():
    with pytest.raises(om.AnalysisError, match="beyond the wall"):
        walled("SLSQP", driver=om.ScipyOptimizeDriver)[0].run_driver()


@pytest.mark.parametrize("optimizer", ["trust-constr", "BFGS"])
def test_failures_pass_through_where_an_optimizer_cannot_turn_back(optimizer):
    with pytest.raises(om.AnalysisError, match="beyond the wall"):
        walled(optimizer)[0].run_driver()


def test_a_search_that_ends_at_failures_has_failed_and_leaves_its_best_point():
    start = np.linspace(-3.0, -1.0, 5)
    problem, component = walled("SLSQP", is_beyond=lambda x: not np.array_equal(x, start))
    assert not problem.run_driver().success
    assert component.n_failed > 1
    np.testing.assert_array_equal(problem.get_val("x"), start)
    assert np.isfinite(problem.get_val("f"))


class BeyondDerivatives(Walled):
    """A bowl that cannot be differentiated near its optimum."""

    def compute_partials(self, inputs, partials):
        if self.options["is_beyond"](inputs["x"]):
            raise om.AnalysisError("no derivatives")
        super().compute_partials(inputs, partials)

    def compute(self, inputs, outputs):
        outputs["f"] = WEIGHTS @ (inputs["x"] - 1.0) ** 2
        outputs["total"] = inputs["x"].sum()


@pytest.mark.parametrize(
    ("optimizer", "constraint"), [("SLSQP", {"upper": 4.0}), ("SLSQP", None), ("L-BFGS-B", None), ("TNC", None)]
)
def test_derivatives_that_fail_end_the_search_with_a_warning_at_the_best_point(optimizer, constraint):
    problem, _ = walled(optimizer, constraint, make=BeyondDerivatives, is_beyond=lambda x: (x > 0.0).any())
    with pytest.warns(om.DriverWarning, match="derivatives failed; the model is left at the best.*no derivatives"):
        assert not problem.run_driver().success
    x, objective = problem.get_val("x"), problem.get_val("f").item()
    assert objective == problem.driver.best.objective == pytest.approx(WEIGHTS @ (x - 1.0) ** 2, rel=1e-12)
    problem.model.walled.options["is_beyond"] = lambda x: False
    assert problem.run_driver().success  # from there


def test_first_derivatives_that_fail_pass_through():
    problem, _ = walled("SLSQP", make=BeyondDerivatives, is_beyond=lambda x: True)
    with pytest.raises(om.AnalysisError, match="no derivatives"):
        problem.run_driver()


def test_other_errors_of_the_model_and_failures_at_the_start_pass_through():
    def broken(x):
        raise ZeroDivisionError("no flow")

    with pytest.raises(ZeroDivisionError, match="no flow"):
        walled("SLSQP", is_beyond=broken)[0].run_driver()
    with pytest.raises(om.AnalysisError, match="beyond the wall"):
        walled("SLSQP", is_beyond=lambda x: True)[0].run_driver()


def test_without_failures_it_goes_the_way_of_openmdao_s_driver():
    found = []
    for driver in (ScipyDriver, om.ScipyOptimizeDriver):
        problem = paraboloid(c={"upper": 0.0}, d={"equals": -9.0})
        problem.driver = driver(optimizer="SLSQP", tol=1e-9, disp=False)
        problem.setup()
        problem.run_driver()
        found.append((problem.driver.iter_count, problem.get_val("x").item(), problem.get_val("y").item()))
    assert found[0][1:] == found[1][1:]
    assert found[0][0] - found[1][0] in (0, 1)  # the last run, at what was found


def test_the_bar_tells_of_runs_and_of_the_best_objective(monkeypatch):
    from contextlib import contextmanager

    told = []

    @contextmanager
    def progress_bar(title):
        yield lambda fraction, what: told.append((title, fraction, what))

    monkeypatch.setattr(module, "progress_bar", progress_bar)
    walled("SLSQP")[0].run_driver()
    assert {title for title, *_ in told} == {"ScipyOptimize_SLSQP"}
    best = [float(what.rpartition(" ")[2]) for *_, what in told]
    assert all(fraction < 0 for _, fraction, _ in told)
    assert best == sorted(best, reverse=True)
    assert best[-1] < 1e-6


class Interrupted(Walled):
    """The bowl, during whose n-th run an interrupt arrives, once."""

    def initialize(self):
        super().initialize()
        self.n_runs, self.n_end = 0, 10**9

    def compute(self, inputs, outputs):
        self.n_runs += 1
        outputs["f"] = np.nan  # half a run
        if self.n_runs == self.n_end:
            raise KeyboardInterrupt
        super().compute(inputs, outputs)


@pytest.mark.slow
@pytest.mark.parametrize("optimizer", ["SLSQP", "COBYLA", "trust-constr"])
@pytest.mark.parametrize("n", [4, 5, 9])
def test_an_interrupt_leaves_the_best_design_that_satisfies_the_constraints(optimizer, n):
    problem, component = walled(optimizer, {"upper": 4.0}, make=Interrupted, is_beyond=lambda x: False)
    component.n_end, found = n, []
    run = module.ScipyDriver._keep

    def watched(driver, objective):
        run(driver, objective)
        found.append((problem.get_val("f").item(), problem.get_val("total").item()))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module.ScipyDriver, "_keep", watched)
        result = problem.run_driver()
    assert problem.driver.is_interrupted
    assert not result.success
    assert problem.get_val("f").item() == min(f for f, total in found if total <= 4.0 + 1e-6)
    assert problem.get_val("f").item() == problem.driver.best.objective
    component.n_end = 10**9
    problem.run_driver()
    assert not problem.driver.is_interrupted


@pytest.mark.parametrize(("tolerance", "is_start"), [(1e-6, True), (2.0, False)])
def test_a_search_that_ends_early_keeps_the_best_design_within_the_tolerance_of_constraints(tolerance, is_start):
    problem = om.Problem(reports=None, driver=ScipyDriver(maxiter=2, disp=False, constraint_tolerance=tolerance))
    problem.model.add_subsystem("f", om.ExecComp("f = (x - 1)**2 + y"), promotes=["*"])
    problem.model.add_subsystem("circle", om.ExecComp("r = x**2 + y**2"), promotes=["*"])
    for name in "xy":
        problem.model.add_design_var(name, lower=-2.0, upper=2.0)
    problem.model.add_objective("f")
    problem.model.add_constraint("r", equals=1.0)
    problem.setup()
    problem.set_val("y", 1.0)
    problem.set_val("x", 0.0)
    assert not problem.run_driver().success
    found = problem.get_val("x").item(), problem.get_val("y").item()
    assert (found == (0.0, 1.0)) == is_start
    assert (problem.get_val("f").item() < 1.5) != is_start


def test_an_interrupt_before_the_first_design_passes_through():
    problem, component = walled("SLSQP", make=Interrupted, is_beyond=lambda x: False)
    component.n_end = 1
    with pytest.raises(KeyboardInterrupt):
        problem.run_driver()
