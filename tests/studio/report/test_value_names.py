"""One value has one name, that of Python: in tables, files, reports and messages."""

import csv

import numpy as np
import openmdao.api as om
import pytest
from driver_cases import on_vectors

from bspline_mdao import NLoptDriver, design_summary
from bspline_mdao.core.om.component import finite_points, finite_values
from bspline_mdao.core.om.drivers.case_history import read_history

NAMES = {"f", "z[0]", "z[1]", "z[3]", "z[5]", "g[1]", "g[2]", "g[5]"}


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    """Four of six variables, and constraints on three of six values, some of which count from the end."""
    problem = on_vectors(indices=[-4, 1, -1], lower=[-8.0, -9.0, -7.0])
    problem.driver = NLoptDriver(optimizer="LD_SLSQP", maxeval=3, disp=False)
    problem.folder = tmp_path_factory.mktemp("names")
    problem.driver.add_recorder(om.SqliteRecorder(problem.folder / "a.sql"))
    problem.setup()
    problem.set_val("z", np.random.default_rng(5).uniform(-1.0, 1.0, 6))
    problem.run_driver()
    problem.cleanup()
    return problem


def of_python(problem, names):
    """Values by their names as Python sees them."""
    variables = {name: np.ravel(problem.get_val(name)) for name in ("f", "z", "g")} | {"f": problem.get_val("f").item()}
    return {name: eval(name, variables) for name in names}


def test_names_in_the_table_and_its_file_are_those_of_python(problem):
    summary = design_summary(problem)
    found = {n: v for entry in summary.entries for n, v in zip(entry.value_names, entry.values)}
    assert found == of_python(problem, NAMES)
    words = summary.table().split()
    summary.write_csv(problem.folder / "a.csv")
    with open(problem.folder / "a.csv", newline="") as file:
        rows = {row["name"]: float(row["value"]) for row in csv.DictReader(file)}
    assert rows == found
    assert set(words) >= NAMES


def test_names_in_a_case_file_and_its_report_are_those_of_python(problem):
    history = read_history(problem.folder / "a.sql")
    found = {n: v for q in history.quantities for n, v in zip(q.value_names, q.values[history.best])}
    assert found == of_python(problem, NAMES)
    tables = pytest.importorskip("bspline_mdao.studio.report.tables")
    charts = pytest.importorskip("bspline_mdao.studio.report.charts")
    shown = [row[0] for make in (tables.history_table, tables.variable_table) for row in make(history).rows]
    assert sorted(shown) == sorted(NAMES)
    drawn = {line["name"] for chart in charts.history_charts(history) for line in chart.data}
    assert drawn >= NAMES


def test_names_in_messages_are_those_of_python():
    values = np.array([1.0, 2.0, np.nan, 3.0, np.inf, 0.0])
    with pytest.raises(om.AnalysisError, match=r"wing: z\[2\] is nan"):
        finite_values(values, "z", "wing")
    with pytest.raises(om.AnalysisError, match=r"wing: z\[2\], z of point 1, is nan"):
        finite_points(values, "z", "wing")
    with pytest.raises(om.AnalysisError, match="wing: CL is nan"):
        finite_values(values[2:3], "CL", "wing")
