"""A design that violates a limit is called infeasible, by what and how much, in tables, files, histories and pages."""

import csv
import json
from dataclasses import replace

import numpy as np
import openmdao.api as om
import pytest
from driver_cases import on_vectors, paraboloid

from bspline_mdao import design_summary
from bspline_mdao.core.om.drivers.case_history import read_history
from bspline_mdao.core.om.drivers.violations import in_words, violations_of
from bspline_mdao.studio.report.notes import notes_on


def words_of(values, lower, upper, unit=1.0):
    arrays = (np.array(each, dtype=float) for each in (values, lower, upper))
    return in_words(violations_of([f"x[{n}]" for n in range(len(values))], *arrays, unit))


@pytest.mark.parametrize("size", [0.0048, 1.0, 300.0])
def test_a_value_may_be_beyond_a_limit_by_a_ten_thousandth_of_it(size):
    within, beyond = size * (1.0 - 0.9e-4), size * (1.0 - 1.1e-4)
    assert words_of([within], [size], [np.inf], size) == ""
    assert words_of([beyond], [size], [np.nan], size) == f"infeasible: x[0] is {size - beyond:.3g} below {size:g}"
    assert words_of([-within], [-np.inf], [-size], size) == ""
    assert words_of([-beyond], [np.nan], [-size], size) == f"infeasible: x[0] is {size - beyond:.3g} above -{size:g}"


def test_the_driver_s_unit_counts_at_zero_and_where_a_limit_is_far_below_it():
    assert words_of([-0.9e-4, 0.9e-4], [0.0, -np.inf], [np.inf, 0.0], unit=1.0) == ""
    assert words_of([-0.9e-4], [0.0], [np.inf], unit=0.1) == "infeasible: x[0] is 9e-05 below 0"
    assert words_of([1e-9 + 0.9e-6], [-np.inf], [1e-9]) == ""
    assert words_of([1e-9 + 1.1e-6], [-np.inf], [1e-9]) == "infeasible: x[0] is 1.1e-06 above 1e-09"


def test_the_worst_values_are_named_first_and_the_others_counted():
    words = words_of([0.9, 0.0, 5.0, np.nan, 2.0], [1.0, 1.0, 1.0, 1.0, 1.0], [np.inf, np.inf, 4.9, np.inf, np.inf])
    assert words == "infeasible: x[3] is no number, x[1] is 1 below 1, x[0] is 0.1 below 1, and 1 more"


@pytest.fixture
def problem(tmp_path):
    """Samples of a problem whose constraints are met by none; the model is left at the last one."""
    problem = on_vectors(indices=[2, 4, 5], lower=[1.0, -1.0, 0.0], upper=[9.0, -0.5, 9.0], ref=2.0)
    rows = np.random.default_rng(7).uniform(-0.2, 0.2, (3, 4))
    problem.driver = om.DOEDriver(om.ListGenerator([[("z", row)] for row in rows]))
    problem.driver.add_recorder(om.SqliteRecorder(tmp_path / "a.sql", record_viewer_data=False))
    problem.setup()
    problem.run_driver()
    problem.cleanup()
    return problem


def test_variables_at_a_bound_are_marked_and_counted_where_only_the_extremes_are_shown():
    values, rng = np.random.default_rng(3).uniform(-0.3, 0.3, 14), np.random.default_rng(4)
    values[[2, 5]], values[[7]] = 0.5, -0.5
    for n, marks in ((9, {2: "upper", 5: "upper", 7: "lower"}), (14, None)):
        order = rng.permutation(n) if marks is None else np.arange(n)
        problem = om.Problem(reports=None)
        problem.model.add_subsystem("f", om.ExecComp("f = sum(x)", x={"val": values[order]}), promotes=["*"])
        problem.model.add_design_var("x", lower=-0.5, upper=0.5)
        problem.model.add_objective("f")
        problem.setup()
        problem.run_model()
        lines = [line for line in design_summary(problem).table().splitlines() if line.startswith("  x")]
        said = [line.partition("  at the ")[2] for line in lines]
        if marks is not None:
            assert said == [f"{marks[k]} bound" if k in marks else "" for k in range(n)]
        else:
            assert [line.split("  ")[-1] for line in lines] == ["1 at the lower bound", "2 at the upper bound"]


def test_the_file_of_a_design_marks_each_variable_at_a_bound_as_the_table_does(tmp_path):
    for n in (5, 17):
        values = np.random.default_rng(n).uniform(-0.3, 0.3, n)
        values[1], values[4] = 0.5, -0.5
        problem = om.Problem(reports=None)
        problem.model.add_subsystem("f", om.ExecComp("f = sum(x)", x={"val": values}), promotes=["*"])
        problem.model.add_design_var("x", lower=-0.5, upper=0.5)
        problem.model.add_objective("f")
        problem.setup()
        problem.run_model()
        summary = design_summary(problem)
        for before in (None, summary):
            summary.write_csv(tmp_path / "a.csv", before)
            with open(tmp_path / "a.csv", newline="") as file:
                marks = {row["name"]: row["at_bound"] for row in csv.DictReader(file)}
            assert {name: mark for name, mark in marks.items() if mark} == {
                "x[1]": "at the upper bound",
                "x[4]": "at the lower bound",
            }
        assert all(f"  {mark}" in summary.table() for mark in marks.values() if mark) == (n == 5)


def test_table_file_and_json_of_a_design_say_it_of_the_values_that_are_beyond(problem, tmp_path):
    before = design_summary(problem)
    assert before.infeasible == "infeasible: g[4] is 1.5 above -0.5"
    assert str(before).splitlines()[-1] == before.infeasible
    problem.set_val("z", [0.0, 0.0, 0.0, 0.0, -0.9, -2.0])
    problem.run_model()
    after = design_summary(problem)
    assert after.table(before).splitlines()[-2:] == [
        "before: infeasible: g[4] is 1.5 above -0.5",
        "after: infeasible: g[5] is 3 below 0",
    ]
    after.write_csv(tmp_path / "a.csv", before)
    with open(tmp_path / "a.csv", newline="") as file:
        rows = {row["name"]: (row["infeasible_before"], row["infeasible_after"]) for row in csv.DictReader(file)}
    assert {name: row for name, row in rows.items() if any(row)} == {"g[4]": ("1.5", ""), "g[5]": ("", "3.0")}
    assert json.loads(json.dumps(after.numbers()))["g"]["infeasible"] == {"g[5]": 3.0}


def test_a_history_says_the_same_as_the_table_at_the_same_design(problem, tmp_path):
    history = read_history(tmp_path / "a.sql")
    assert history.infeasible(2) == design_summary(problem).infeasible != ""
    assert notes_on(history)[0] == f"The first design is {history.infeasible(0)}."


def test_a_feasible_design_is_not_spoken_of(tmp_path):
    problem = paraboloid(c={"upper": 5.0}, d={"equals": 0.0})
    problem.driver.add_recorder(om.SqliteRecorder(tmp_path / "a.sql", record_viewer_data=False))
    problem.setup()
    problem.run_driver()
    problem.cleanup()
    summary, history = design_summary(problem), read_history(tmp_path / "a.sql")
    assert (summary.infeasible, history.infeasible(0), notes_on(history)) == ("", "", [])
    assert "infeasible" not in summary.table(summary)


def test_a_report_notes_mach_numbers_out_of_the_comparisons(problem, tmp_path):
    history = replace(read_history(tmp_path / "a.sql"), options={"top.cruise": {"shock_threshold": 0.05}}, best=2)
    flown = replace(history, outputs={f"{name}.Mach_number": {2: np.array([mach])} for name, mach in
                                      (("cruise", 0.84), ("dash", 0.9))})  # fmt: skip
    (note,) = [note for note in notes_on(flown) if "Mach" in note]
    assert note.startswith("dash: Mach_number is 0.9; results were compared with others only from 0.1 to 0.84")
    assert not [note for note in notes_on(replace(flown, options={})) if "Mach" in note]
    both = replace(
        flown, options=flown.options | {"top.climb": {"n_chord": 5}}, outputs={"Mach_number": {2: np.array([0.05])}}
    )
    assert not [note for note in notes_on(both) if "Mach" in note]  # there is a lattice, which may fly so
