"""Recorded optimisations tell how they went on, in units of the driver, whatever the driver; histories draw that."""

from types import SimpleNamespace

import numpy as np
import openmdao.api as om
import pytest
from test_nlopt_recovery import Walled

from bspline_mdao import optimality_of
from bspline_mdao.drivers import disagreement, nlopt, recorded, run_at, scipy_slsqp
from bspline_mdao.plotting import draw_history, draw_optimality, driver_styles, figure

DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_SLSQP": nlopt}


def scaled_problem():
    """Least ``x0^4 + 3 x1^2`` with ``x0 + x1 = 2``, in units that all differ from 1."""
    problem = om.Problem(reports=None)
    component = om.ExecComp(["f = x[0]**4 + 3*x[1]**2", "g = x[0] + x[1]"], x=np.ones(2))
    component.options["do_coloring"] = False
    problem.model.add_subsystem("functions", component, promotes=["*"])
    problem.model.add_design_var("x", ref=4.0, ref0=1.0)
    problem.model.add_objective("f", ref=10.0)
    problem.model.add_constraint("g", equals=2.0, ref=4.0)
    return problem


def solved(problem, driver, folder=None, name="cases"):
    """Run a problem with a driver, and record it."""
    problem.driver = driver
    with recorded(problem, folder, name) as run:
        problem.run_driver()
    return run


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cases")
    return {name: solved(scaled_problem(), make(1e-14, 50), folder, name) for name, make in DRIVERS.items()}


@pytest.mark.slow
def test_convergence_of_recorded_cases_is_that_of_the_problem(runs):
    for run in runs.values():
        found, values = run.convergence, run.history["g"].ravel()
        np.testing.assert_allclose(found.violations, np.abs(values - 2.0) / 4.0, atol=1e-15)
        n, x = found.differentiated[-1], run.problem.get_val("x")
        assert found.residuals[-1] < 1e-4 * found.residuals[0]
        assert (np.diff(found.differentiated) > 0).all()
        assert n < len(values)
        assert 4.0 * x[0] ** 3 == pytest.approx(6.0 * x[1], rel=1e-5)
    # at the start the gradient is (4, 6), in units of the driver (1.2, 1.8); what is along (1, 1) the constraint holds
    np.testing.assert_allclose(runs["NLopt LD_SLSQP"].convergence.residuals[0], 0.6 / np.sqrt(2.0))


@pytest.mark.slow
def test_numbers_sum_an_optimisation_up(runs):
    for run in runs.values():
        numbers = run.numbers()
        assert numbers["success"]
        assert numbers["objective"] == pytest.approx(run.history["f"][-1].item(), rel=1e-6)
        assert numbers["violation"] < 1e-7
        assert numbers["optimality"] < 1e-4
        assert numbers["gradients"] <= numbers["evaluations"] < 60
        assert set(numbers["shares"]) == {"functions", "rest"}
        assert sum(numbers["shares"].values()) == pytest.approx(1.0)
        assert numbers["seconds"] == pytest.approx(sum(run.seconds.values()))


@pytest.mark.slow
def test_optimality_of_a_problem_is_that_of_the_point_where_it_is(runs):
    run = runs["SciPy SLSQP"]
    residual, violation = optimality_of(run.problem)
    assert residual < 1e-4 * run.initial_gradient
    assert violation < 1e-7
    problem = scaled_problem()
    problem.setup(mode="rev")
    problem.run_model()
    residual, violation = optimality_of(problem)
    assert residual == pytest.approx(0.6 / np.sqrt(2.0))  # see the first point of the recorded cases
    assert violation == pytest.approx(0.0)


@pytest.mark.slow
def test_drivers_that_agree_differ_by_little_in_units_of_the_driver(runs):
    x = [run.problem.get_val("x") for run in runs.values()]
    found = disagreement(runs)
    assert found["objective"] < 1e-10
    assert found["design"] == pytest.approx(np.abs(x[0] - x[1]).max() / 3.0)
    assert found["design"] < 1e-4


@pytest.mark.slow
def test_another_problem_is_run_at_an_optimum(runs):
    run = runs["SciPy SLSQP"]
    assert run_at(run.problem, scaled_problem()).get_val("f") == pytest.approx(run.problem.get_val("f"), abs=1e-14)


@pytest.mark.slow
def test_the_components_of_a_group_may_be_told_of_as_one():
    def make_problem():
        problem = om.Problem(reports=None)
        flow = problem.model.add_subsystem("flow", om.Group(), promotes=["*"])
        flow.add_subsystem("first", om.ExecComp("y = 2*x"), promotes=["*"])
        flow.add_subsystem("second", om.ExecComp("z = y**2 - y"), promotes=["*"])
        problem.model.add_design_var("x")
        problem.model.add_objective("z")
        return problem

    run = solved(make_problem(), nlopt(1e-12, 20, "LD_LBFGS"))
    assert set(run.numbers()["shares"]) == {"first", "second", "rest"}
    assert set(run.numbers("flow")["shares"]) == {"flow", "rest"}


@pytest.mark.slow
def test_cases_are_kept_where_a_folder_is_named(tmp_path):
    solved(scaled_problem(), nlopt(1e-6, 50), tmp_path / "new", "design_NLopt LD_SLSQP")
    (file,) = (tmp_path / "new").iterdir()
    assert file.name == "design_nlopt_ld_slsqp.sql"
    assert len(om.CaseReader(str(file)).list_cases("driver", out_stream=None)) >= 3


@pytest.mark.slow
def test_histories_are_drawn_as_they_were_recorded(runs, tmp_path):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    with figure(tmp_path, "history", (4.0, 2.0)) as canvas:
        values, optimality = canvas.subplots(1, 2)
        draw_history(values, runs, "f", "objective", lambda f: f - 1.0, log=False)
        draw_optimality(optimality, runs)
    assert values.get_ylabel() == "objective"
    assert all(place == round(place) for axes in (values, optimality) for place in axes.get_xticks())
    for line, (name, run) in zip(values.lines, runs.items()):
        np.testing.assert_array_equal(line.get_ydata(), run.history["f"].ravel() - 1.0)
        assert (line.get_label(), line.get_color()) == (name, driver_styles(runs)[name]["color"])
    assert optimality.get_yscale() == "log"
    found = [line for line in optimality.lines if line.get_label().endswith("optimality")]
    assert len(found) == 2
    for line, run in zip(found, runs.values()):
        np.testing.assert_array_equal(line.get_xdata(), run.convergence.differentiated)
        np.testing.assert_allclose(line.get_ydata()[0], 1.0)
    least = min(np.min(line.get_ydata()) for line in found)
    assert 0.1 * least < optimality.get_ylim()[0] <= least  # no decades without a curve


@pytest.mark.parametrize("size", [1e-2, 1e-9])
def test_violations_are_drawn_and_named_where_they_are_seen(size, tmp_path):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    violations = {"first": size * np.array([1.0, 0.4, 0.0]), "second": np.zeros(3)}
    same = {"residuals": np.array([3.0, 0.02, 1e-5]), "differentiated": [0, 1, 2]}
    found = {name: SimpleNamespace(violations=each, **same) for name, each in violations.items()}
    runs = {name: SimpleNamespace(convergence=each) for name, each in found.items()}
    with figure(tmp_path, "optimality", (2.0, 2.0)) as canvas:
        draw_optimality(axes := canvas.subplots(), runs)
    is_seen = size > axes.get_ylim()[0]
    assert is_seen == (size == 1e-2)
    drawn = [line.get_label() for line in axes.lines if line.get_label().endswith("violation")]
    assert drawn == (["first: violation"] if is_seen else [])
    assert axes.get_ylabel().endswith("violation") == is_seen


def walled_problem():
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("walled", Walled(), promotes=["*"])
    problem.model.add_design_var("x", lower=-8.0, upper=8.0)
    problem.model.add_objective("f")
    return problem


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::openmdao.utils.om_warnings.OpenMDAOWarning")
def test_both_drivers_go_on_after_an_analysis_that_fails():
    for run in (solved(walled_problem(), make_driver(1e-12, 100)) for make_driver in DRIVERS.values()):
        assert run.problem.driver.n_failed_analyses > 0
        np.testing.assert_allclose(run.problem.get_val("x"), 1.0, atol=1e-5)


def test_the_line_of_the_first_driver_is_wide_if_others_may_cover_it():
    widths = [[style["linewidth"] for style in driver_styles(names).values()] for names in ("a", "ab")]
    assert widths[0] == widths[1][1:]
    assert widths[1][0] > 2.0 * widths[1][1]
