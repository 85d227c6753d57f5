"""Optimisations go on from the best design that was recorded, and their cases behind those of the run before."""

import os
import sqlite3
from contextlib import closing
from functools import partial

import numpy as np
import openmdao.api as om
import pytest
from driver_cases import on_vectors, paraboloid, rosenbrock
from fuzz_cases import N_MUTATIONS

from bspline_mdao import CaseRecorder, InputError, NLoptDriver, ScipyDriver, load_best
from bspline_mdao.core.om.drivers.case_file import count_cases
from bspline_mdao.core.om.drivers.case_history import read_history

NLOPT = {"optimizer": "LD_SLSQP", "disp": False}


def recorded(problem, file, driver=None, **recorder):
    """The problem, set up with a driver that records."""
    problem.driver = driver or NLoptDriver(**NLOPT)
    problem.driver.add_recorder(CaseRecorder(file, **{"record_viewer_data": False, **recorder}))
    problem.driver.recording_options["record_derivatives"] = True
    problem.setup()
    return problem


def run(problem):
    problem.run_driver()
    problem.cleanup()
    return problem


@pytest.fixture
def cases(tmp_path):
    """Case file of a constrained problem that was stopped early."""
    run(recorded(ball(), tmp_path / "a.sql", NLoptDriver(maxeval=4, **NLOPT)))
    return tmp_path / "a.sql"


def ball():
    """A valley within a ball: several steps to the optimum, at its rim."""
    return rosenbrock(3, upper=1.5)


def test_the_start_is_the_feasible_design_of_lowest_objective(tmp_path):
    points = np.random.default_rng(0).uniform(-12.0, 8.0, (30, 2))
    samples = om.DOEDriver(om.ListGenerator([[("x", x), ("y", y)] for x, y in points]))
    run(recorded(paraboloid(c={"upper": -5.0, "ref": 3.0}), tmp_path / "a.sql", samples))
    values = [(x - 3) ** 2 + x * y + (y + 4) ** 2 - 3 if x + y <= -5.0 else np.inf for x, y in points]
    other = paraboloid(c={"upper": -5.0}, scale={"ref": 7.0}, shift={"ref": 2.0, "ref0": 0.5})
    other.driver = NLoptDriver(**NLOPT)
    other.setup()
    assert 3 < np.isfinite(values).sum() < 27
    assert load_best(other, tmp_path / "a.sql") == np.argmin(values)
    assert [other.get_val(name).item() for name in "xy"] == pytest.approx(points[np.argmin(values)], rel=1e-14)


@pytest.mark.parametrize(("options", "best"), [({}, 0), ({"constraint_tolerance": 1e-2}, 1)])
def test_the_tolerance_of_the_driver_says_what_is_feasible(tmp_path, options, best):
    points = [(2.0, -7.5), (2.0, -6.999)]  # the second one violates the constraint by 0.001, and is lower
    samples = om.DOEDriver(om.ListGenerator([[("x", x), ("y", y)] for x, y in points]))
    run(recorded(paraboloid(c={"upper": -5.0}), tmp_path / "a.sql", samples))
    problem = paraboloid(c={"upper": -5.0})
    problem.driver = NLoptDriver(**NLOPT, **options)
    problem.setup()
    assert load_best(problem, tmp_path / "a.sql") == best


def test_limits_of_now_decide_what_is_feasible_and_where_the_start_is(cases):
    (x,) = (q.values for q in read_history(cases).quantities if q.kind == "variable")
    sizes = (x**2).sum(axis=1)
    tight = rosenbrock(3, upper=0.5 * sizes.min())  # nothing is feasible: the least violation counts
    near = rosenbrock(3, upper=1.5)
    near.model._static_design_vars["x"]["upper"] = 0.125
    for problem in (tight, near):
        problem.driver = NLoptDriver(**NLOPT)
        problem.setup()
    assert load_best(tight, cases) == np.argmin(sizes)
    load_best(near, cases)
    assert near.get_val("x").max() == 0.125


def test_entries_that_are_no_variables_stay(tmp_path):
    run(recorded(on_vectors(), tmp_path / "a.sql", NLoptDriver(maxeval=3, **NLOPT)))
    problem = on_vectors()
    problem.driver = NLoptDriver(**NLOPT)
    problem.setup()
    problem.set_val("z", np.arange(6.0))
    load_best(problem, tmp_path / "a.sql")
    (q,) = (q for q in read_history(tmp_path / "a.sql").quantities if q.kind == "variable")
    best = q.values[read_history(tmp_path / "a.sql").best]
    np.testing.assert_allclose(problem.get_val("z")[[0, 1, 3, 5]], best, rtol=1e-14)
    np.testing.assert_array_equal(problem.get_val("z")[[2, 4]], [2.0, 4.0])


@pytest.mark.slow
@pytest.mark.parametrize("make", [lambda: NLoptDriver(**NLOPT), lambda: ScipyDriver(optimizer="SLSQP", disp=False)])
def test_two_runs_make_one_history(cases, tmp_path, make):
    before = read_history(cases)
    problem = recorded(ball(), tmp_path / "b.sql", make(), earlier=cases)
    load_best(problem, cases)
    run(problem)
    found = read_history(tmp_path / "b.sql")
    n, n_new = before.n_evaluations, problem.driver.iter_count
    assert found.n_evaluations == n + n_new
    assert len(set(om.CaseReader(tmp_path / "b.sql").list_cases("driver", out_stream=None))) == n + n_new
    for old, new in zip(before.quantities, found.quantities):
        np.testing.assert_array_equal(new.values[:n], old.values)
    np.testing.assert_allclose(found.seconds[:n], before.seconds, atol=1e-6)
    assert (np.diff(found.seconds) >= 0.0).all()
    objective = next(q.values[:, 0] for q in found.quantities if q.kind == "objective")
    assert objective[n] == pytest.approx(objective[before.best], rel=1e-12)  # where the second run began
    found_at = found.convergence.differentiated
    assert set(before.convergence.differentiated) < set(found_at)
    x = next(q.values for q in found.quantities if q.kind == "variable")[found_at]
    np.testing.assert_allclose(found.convergence.totals[:, 1], 2.0 * x, rtol=1e-10)  # each gradient where it belongs
    assert problem.get_val("r").item() == pytest.approx(1.5, abs=1e-5)


@pytest.mark.slow
def test_clocks_and_counts_of_the_earlier_run_do_not_matter(tmp_path):
    """It ran on another machine, and recorded the model as well."""
    recorder = CaseRecorder(tmp_path / "a.sql", record_viewer_data=False)
    earlier = ball()
    earlier.driver = NLoptDriver(maxeval=4, **NLOPT)
    for requester in (earlier.driver, earlier.model):
        requester.add_recorder(recorder)
    run(earlier.setup())
    before = read_history(tmp_path / "a.sql")
    with closing(sqlite3.connect(tmp_path / "a.sql")) as connection, connection:
        connection.execute("UPDATE driver_iterations SET timestamp = timestamp + 1e6")
    run(recorded(ball(), tmp_path / "b.sql", NLoptDriver(maxeval=3, **NLOPT), earlier=tmp_path / "a.sql"))
    found, reader = read_history(tmp_path / "b.sql"), om.CaseReader(tmp_path / "b.sql")
    np.testing.assert_allclose(found.seconds[: before.n_evaluations], before.seconds, atol=1e-6)
    assert (np.diff(found.seconds) >= 0.0).all()
    names = reader.list_cases("driver", out_stream=None)
    assert names == reader.list_cases("driver", recurse=False, out_stream=None)
    assert [reader.get_case(name).counter for name in names] == [n + 1 for n in range(len(names))]


@pytest.mark.slow
def test_a_history_of_three_runs_goes_on_too(cases, tmp_path):
    for old, new in (("a.sql", "b.sql"), ("b.sql", "c.sql")):
        problem = recorded(ball(), tmp_path / new, NLoptDriver(maxeval=2, **NLOPT), earlier=tmp_path / old)
        load_best(problem, tmp_path / old)
        run(problem)
    names = om.CaseReader(tmp_path / "c.sql").list_cases("driver", out_stream=None)
    assert names == [f"rank0:NLopt_LD_SLSQP|{n}" for n in range(len(names))]
    assert len(names) >= count_cases(cases) + 4


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        (lambda: rosenbrock(3), "constraint 'r' has 1 value(s) there, none here"),
        (lambda: rosenbrock(4, upper=1.5), "variable 'x' has 3 value(s) there, 4 value(s) here"),
        (on_vectors, "variable 'z' has none there, 4 value(s) here"),
    ],
)
def test_cases_of_another_problem_are_refused(cases, pose, words):
    problem = pose()
    problem.driver = NLoptDriver(**NLOPT)
    problem.setup()
    with pytest.raises(InputError) as caught:
        load_best(problem, cases)
    assert str(caught.value) == f"{cases}: is of another problem: {words}; start again"


def damaged(data, random):
    """Bytes of a file, shorter or with some of them changed."""
    data = bytearray(data)
    if random.random() < 0.4:
        return bytes(data[: random.integers(len(data))])
    start, n = random.integers(len(data)), random.choice([1, 50, 3000])
    piece = data[start : start + n]
    data[start : start + n] = random.integers(0, 256, len(piece), dtype=np.uint8).tobytes()
    return bytes(data)


def test_a_recorder_does_not_write_where_it_goes_on_from(cases, tmp_path, monkeypatch):
    data = cases.read_bytes()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="is the file of the earlier run; record into another one"):
        recorded(ball(), cases, earlier="a.sql").final_setup()
    assert cases.read_bytes() == data


def refusal(act):
    """What is said where something is refused; empty where it is not."""
    try:
        act()
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.slow
def test_damaged_files_are_named_in_one_line_or_read(cases, tmp_path):
    random, data, file = np.random.default_rng(5), cases.read_bytes(), tmp_path / "d.sql"
    problem = recorded(ball(), tmp_path / "e.sql")
    found = []
    n = N_MUTATIONS // 2
    for _ in range(n):
        file.write_bytes(damaged(data, random))
        behind = recorded(ball(), tmp_path / "f.sql", earlier=file)
        acts = (partial(load_best, problem, file), partial(count_cases, file), behind.final_setup)
        found += [words for words in map(refusal, acts) if words]
        behind.cleanup()
    assert len(found) > n // 2
    assert all(words.startswith(f"{file}: ") and "\n" not in words for words in found)


def test_a_file_of_another_version_is_not_taken_over(cases, tmp_path):
    with closing(sqlite3.connect(cases)) as connection, connection:
        connection.execute("UPDATE metadata SET format_version = 13")
    with pytest.raises(InputError, match="was written by another version of OpenMDAO"):
        recorded(ball(), tmp_path / "b.sql", earlier=cases).final_setup()


def test_files_without_cases_count_none(tmp_path):
    assert count_cases(tmp_path / "none.sql") == 0
    recorded(paraboloid(), tmp_path / "a.sql").final_setup()
    assert count_cases(tmp_path / "a.sql") == 0
    (tmp_path / "b.sql").write_bytes(b"")
    assert count_cases(tmp_path / "b.sql") == 0
    (tmp_path / "c.sql").write_text("no database, and longer than the head of one " * 9)
    with pytest.raises(InputError, match=r"c\.sql: is no case file that can be read"):
        count_cases(tmp_path / "c.sql")


def test_a_full_disk_ends_the_records_and_not_the_run(tmp_path):
    problem = recorded(ball(), tmp_path / "a.sql")
    problem.final_setup()
    recorder = problem.driver._rec_mgr[0]
    (n,) = recorder.connection.execute("PRAGMA page_count").fetchone()
    recorder.connection.execute(f"PRAGMA max_page_count = {n + 1}")
    with pytest.warns(om.CaseRecorderWarning) as caught:
        run(problem)
    (words,) = [str(each.message) for each in caught if each.category is om.CaseRecorderWarning]
    assert words.startswith(
        f"{tmp_path / 'a.sql'}: cases cannot be recorded (database or disk is full); the run continues"
    )
    assert problem.driver.result.success
    assert problem.get_val("r").item() == pytest.approx(1.5, abs=1e-5)
    assert 0 < count_cases(tmp_path / "a.sql") < problem.driver.iter_count
    other = recorded(ball(), tmp_path / "b.sql", earlier=tmp_path / "a.sql")
    load_best(other, tmp_path / "a.sql")  # what there is can be read


def test_a_file_that_cannot_be_made_is_refused_when_the_run_begins(tmp_path):
    (tmp_path / "folder.sql").mkdir()
    with pytest.raises(InputError, match=r"folder\.sql: cannot be written"):
        recorded(paraboloid(), tmp_path / "folder.sql").final_setup()


def test_a_disk_that_is_full_at_the_start_is_said_in_one_line(tmp_path, monkeypatch):
    connect = sqlite3.connect

    def full(n_pages, path, *arguments, **settings):
        found = connect(path, *arguments, **settings)
        found.execute(f"PRAGMA max_page_count = {n_pages}")
        return found

    problem = recorded(ball(), tmp_path / "a.sql", record_viewer_data=True)
    problem.final_setup()
    n = os.path.getsize(tmp_path / "a.sql") // 4096
    words = r"a\.sql: cannot be written \(database or disk is full\); choose another place"
    for n_pages in (5, n - 8, n - 4, n - 1):  # among the tables, or what is said of the model
        monkeypatch.setattr(sqlite3, "connect", partial(full, n_pages))
        with pytest.raises(InputError, match=words):
            recorded(ball(), tmp_path / "a.sql", record_viewer_data=True).final_setup()
