"""A case file of several runs is read as what each of them recorded, with the options of the last one."""

import sqlite3
from contextlib import closing

import numpy as np
import openmdao.api as om
import pytest
from driver_cases import on_vectors, paraboloid, rosenbrock

from bspline_mdao import NLoptDriver
from bspline_mdao.core.om.drivers.case_file import names_with_runs
from bspline_mdao.core.om.drivers.case_history import read_history


def driven_by(problem, driver, recorder):
    """The problem, set up with a driver that records."""
    problem.driver = driver
    driver.add_recorder(recorder)
    driver.recording_options["record_derivatives"] = True
    return problem.setup()


def nlopt(maxeval):
    return NLoptDriver(optimizer="LD_SLSQP", maxeval=maxeval, disp=False)


@pytest.fixture
def recorder(tmp_path):
    return om.SqliteRecorder(tmp_path / "a.sql", record_viewer_data=False)


def test_runs_of_one_problem_are_one_history_with_the_values_and_gradients_of_each(recorder, tmp_path):
    problem = driven_by(rosenbrock(3, upper=1.5), nlopt(5), recorder)
    starts, evaluations = np.random.default_rng(3).uniform(-0.7, 0.7, (3, 3)), 0
    first = []
    for start in starts:
        first.append(evaluations)
        problem.set_val("x", start)
        problem.run_driver()
        evaluations += problem.driver.result.model_evals
    problem.cleanup()
    history = read_history(tmp_path / "a.sql")
    (x,), (f,) = history.of_kind("variable"), history.of_kind("objective")
    assert history.n_evaluations == evaluations > 9
    np.testing.assert_array_equal(x.values[first], starts)
    valley = np.sum(4 * (x.values[:, 1:] - x.values[:, :-1] ** 2) ** 2 + (1 - x.values[:, :-1]) ** 2, axis=1)
    np.testing.assert_allclose(f.values[:, 0], valley, rtol=1e-14)
    assert np.all(np.diff(history.seconds) > 0.0)
    assert set(first) <= set(history.convergence.differentiated)
    for number, totals in zip(history.convergence.differentiated, history.convergence.totals):
        np.testing.assert_allclose(totals[1], 2.0 * x.values[number], rtol=1e-14)  # of the ball's constraint


def test_a_gradient_that_no_case_follows_in_its_run_is_of_no_case_of_the_next():
    """The last gradient of a run has the name of a case that its run never had, and the next one may have."""
    rows = [(1, "D|0"), (2, "G|1"), (3, "D|1"), (4, "G|2"), (5, "D|0"), (6, "D|1"), (7, "G|2"), (8, "D|2"), (9, "G|3")]
    moments = [[(float(time), f"D{name[1:]}") for time, name in rows if name[0] == kind] for kind in "DG"]
    cases, gradients = names_with_runs(*moments)
    assert cases == ["run0_D|0", "run0_D|1", "run1_D|0", "run1_D|1", "run1_D|2"]
    assert gradients == ["run0_D|1", "run0_D|2", "run1_D|2", "run1_D|3"]


def test_samples_and_the_search_after_them_are_one_history(recorder, tmp_path):
    points = [(-2.0, 1.0), (4.0, -3.0), (0.5, 0.25)]
    samples = om.DOEDriver(om.ListGenerator([[("x", x), ("y", y)] for x, y in points]))
    problem = driven_by(paraboloid(), samples, recorder)
    problem.run_driver()
    driven_by(problem, nlopt(3), recorder).run_driver()
    problem.cleanup()
    history = read_history(tmp_path / "a.sql")
    x, y = history.of_kind("variable")
    assert np.column_stack([x.values, y.values])[:3].tolist() == [list(point) for point in points]
    assert history.driver == "NLopt_LD_SLSQP"
    assert (history.n_evaluations, history.n_others) == (3 + problem.driver.result.model_evals, 0)


def test_evaluations_of_other_variables_are_left_out_and_counted(recorder, tmp_path):
    problem = driven_by(on_vectors(), nlopt(4), recorder)
    problem.run_driver()
    n_before = problem.driver.result.model_evals
    problem.model.add_constraint("g", indices=[1, 2], lower=0.0)
    driven_by(problem, nlopt(3), recorder).run_driver()
    n_after = problem.driver.result.model_evals
    problem.cleanup()
    history = read_history(tmp_path / "a.sql")
    assert (history.n_evaluations, history.n_others) == (n_after, n_before)
    assert [q.values.shape for q in history.quantities] == [(n_after, 4), (n_after, 1), (n_after, 2)]


@pytest.mark.parametrize("n_runs", [0, 1, 2])
def test_options_are_those_of_the_last_run_whichever_runs_the_recorder_saw(recorder, tmp_path, n_runs):
    """A recorder that is attached after the first run, as scripts do, has no options of that run."""
    problem = paraboloid().setup()
    for _ in range(n_runs):
        problem.run_model()
    problem.driver.add_recorder(recorder)
    for units in ("km", "m"):
        problem.model.paraboloid.options["units"] = units
        problem.run_driver()
    problem.cleanup()
    assert read_history(tmp_path / "a.sql").options["paraboloid"]["units"] == "m"


def test_a_file_without_options_is_read_in_silence(tmp_path):
    problem = paraboloid().setup()
    problem.driver.add_recorder(om.SqliteRecorder(tmp_path / "a.sql", record_viewer_data=False))
    problem.run_driver()
    problem.cleanup()
    with closing(sqlite3.connect(tmp_path / "a.sql")) as connection, connection:
        connection.execute("DELETE FROM system_metadata")
    assert read_history(tmp_path / "a.sql").options == {}
