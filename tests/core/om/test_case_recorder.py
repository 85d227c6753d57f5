"""Recorded cases without long arrays: what is left out, what is kept, and how long the files are."""

import os
import signal

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import CaseRecorder, GridMovement, fit_grid
from bspline_mdao.design import Parametrization, ReferenceAxis, Twist
from bspline_mdao.generators import flat_plate_grid
from bspline_mdao.movers import moving_mesh

N = 300


def problem_of(recorder, where, **component):
    problem = om.Problem(reports=None, driver=om.ScipyOptimizeDriver(disp=False, tol=1e-6))
    formulas = ["f = sum((x - 2.0) ** 2) + long[0] * 0", "grid = 3 * long"]
    model = om.ExecComp(formulas, x=np.zeros(2), long=np.zeros(N), grid=np.zeros(N), do_coloring=False)
    problem.model.add_subsystem("part", model, promotes=["*"])
    problem.model.add_design_var("x")
    problem.model.add_objective("f")
    if where == "driver":
        problem.driver.recording_options["includes"] = ["*"]
    target = {"driver": problem.driver, "problem": problem, "model": problem.model}.get(where)
    if where == "solver":
        problem.setup()
        target = problem.model.nonlinear_solver
    target.add_recorder(recorder)
    problem.setup()
    problem.run_driver()
    if where == "problem":
        problem.record("end")
    problem.cleanup()
    return problem


def names_in(path, source):
    reader = om.CaseReader(path)
    case = reader.get_case(reader.list_cases(source, recurse=False, out_stream=None)[-1])
    return {name.rpartition(".")[2] for of in (case.inputs, case.outputs) if of for name in of.absolute_names()}


@pytest.mark.parametrize(
    ("where", "source"), [("driver", "driver"), ("problem", "problem"), ("model", "root"), ("solver", None)]
)
def test_long_arrays_are_left_out_of_every_kind_of_case(tmp_path, where, source):
    recorder = CaseRecorder(tmp_path / "c.sql", longest=N - 1)
    problem_of(recorder, where)
    assert {name.rpartition(".")[2] for name in recorder.left_out} >= {"grid"}
    if source:
        found = names_in(tmp_path / "c.sql", source)
        assert {"f"} <= found
        assert not found & {"grid", "long"}


@pytest.mark.parametrize("pattern", ["grid", "part.grid", "gr*"])
def test_what_is_asked_for_is_kept(tmp_path, pattern):
    problem_of(CaseRecorder(tmp_path / "c.sql", longest=1, keep=pattern), "problem")
    assert names_in(tmp_path / "c.sql", "problem") >= {"f", "grid"}


@pytest.mark.slow
def test_what_is_short_is_recorded_as_by_openmdao(tmp_path):
    for name, kind in (("ours", CaseRecorder), ("theirs", om.SqliteRecorder)):
        problem_of(kind(tmp_path / name), "problem")
    assert names_in(tmp_path / "ours", "problem") == names_in(tmp_path / "theirs", "problem")


@pytest.mark.slow
def test_the_grid_is_left_out_of_a_wing_problem_and_the_file_is_short(tmp_path):
    model = fit_grid(flat_plate_grid((17, 15, 15)))
    variables = Parametrization(mesh := moving_mesh(model), [Twist("twist", ReferenceAxis.of(mesh), stations=2)])
    sizes = []
    for kind in (CaseRecorder, om.SqliteRecorder):
        problem = om.Problem(reports=None)
        movement = GridMovement(model=model, parametrization=variables)
        problem.model.add_subsystem("shape", movement, promotes=["*"])
        recorder = kind(tmp_path / kind.__name__, record_viewer_data=False)
        problem.add_recorder(recorder)
        problem.setup()
        problem.run_model()
        problem.record("end")
        problem.cleanup()
        sizes.append(os.path.getsize(tmp_path / kind.__name__))
        if kind is CaseRecorder:
            assert {name.rpartition(".")[2] for name in recorder.left_out} >= {"grid"}
            case = om.CaseReader(tmp_path / kind.__name__).get_case("end")
            assert {"corner_ks"} <= {name.rpartition(".")[2] for name in case.outputs.absolute_names()}
    assert 5 * sizes[0] < sizes[1]


def test_an_interrupt_while_a_case_is_written_comes_after_it(tmp_path, monkeypatch):
    """Else the number of the case is counted, the case is not there, and no reader finds the next ones."""
    record = om.SqliteRecorder.record_iteration_problem

    def interrupted(recorder, *case):
        signal.raise_signal(signal.SIGINT)
        record(recorder, *case)

    monkeypatch.setattr(om.SqliteRecorder, "record_iteration_problem", interrupted)
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("copy", om.ExecComp("y = 2 * x"), promotes=["*"])
    problem.add_recorder(CaseRecorder(tmp_path / "cases.sql"))
    problem.setup()
    problem.run_model()
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # shells start background jobs without it
    try:
        with pytest.raises(KeyboardInterrupt):
            problem.record("first")
    finally:
        signal.signal(signal.SIGINT, handler)
    problem.cleanup()
    assert om.CaseReader(tmp_path / "cases.sql").list_cases("problem", out_stream=None) == ["first"]
