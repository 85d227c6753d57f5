"""OpenMDAO's own recorders leave out grids and states by default, with our drivers, and keep what is named."""

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import NLoptDriver, ScipyDriver
from bspline_mdao.core.om.drivers.short_records import LONGEST
from bspline_mdao.drivers import short_records


def openmdao_driver(**options):
    return short_records(short_records(om.ScipyOptimizeDriver(**options)))


DRIVERS = {"NLopt": NLoptDriver, "SciPy": ScipyDriver, "OpenMDAO": openmdao_driver}


class Counted(om.ExplicitComponent):
    """A component with an output that is no number, and so has no size."""

    def setup(self):
        self.add_input("short", np.zeros(2))
        self.add_discrete_output("word", "none")

    def compute(self, inputs, outputs, discrete_inputs, discrete_outputs):
        discrete_outputs["word"] = "some"


def recorded(tmp_path, driver, where, includes=None, long_variable=False, residuals=False):
    """Names, by their last parts, in the last case of a recorder of a driver or a problem."""
    n = LONGEST + 1
    problem = om.Problem(reports=None, driver=driver(disp=False, maxiter=1))
    formulas = ["f = sum((x - 2.0) ** 2) + 1e-9 * sum(long ** 2)", "grid = 3 * long", "short = 2 * x"]
    shapes = {"x": np.zeros(2), "short": np.zeros(2), "long": np.ones(n), "grid": np.zeros(n)}
    part = om.ExecComp(formulas, **shapes, do_coloring=False, has_diag_partials=False)
    part.options["default_shape"] = (1,)
    problem.model.add_subsystem("part", om.Group(), promotes=["*"]).add_subsystem("f", part, promotes=["*"])
    problem.model.add_subsystem("counted", Counted(), promotes=["*"])
    problem.model.approx_totals()
    problem.model.add_design_var("x")
    if long_variable:
        problem.model.add_constraint("grid", upper=1e3, linear=False)
    problem.model.add_objective("f")
    target = {"driver": problem.driver, "problem": problem}[where]
    target.add_recorder(om.SqliteRecorder(tmp_path / "c.sql"))
    target.recording_options["includes"] = includes or ["*"]
    target.recording_options["record_residuals"] = residuals
    problem.setup()
    if long_variable:
        problem.final_setup()
        names = problem.driver._get_vars_to_record().values()
    else:
        problem.run_driver()
        if where == "problem":
            problem.record("end")
        problem.cleanup()
        reader = om.CaseReader(tmp_path / "c.sql")
        case = reader.get_case(reader.list_cases(where, recurse=False, out_stream=None)[-1])
        names = [of.absolute_names() for of in (case.inputs, case.outputs, case.residuals) if of]
    return {name.rpartition(".")[2] for kind in names for name in kind}


@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("where", ["driver", "problem"])
def test_a_plain_recorder_leaves_out_what_is_long(tmp_path, driver, where):
    found = recorded(tmp_path, DRIVERS[driver], where, residuals=True)
    assert found >= {"f", "short", "word"}
    assert not found & {"grid", "long"}


@pytest.mark.parametrize("driver", [NLoptDriver, openmdao_driver])
@pytest.mark.parametrize("where", ["driver", "problem"])
def test_what_is_named_is_kept(tmp_path, where, driver):
    found = recorded(tmp_path, driver, where, includes=["*", "gr*"])
    assert "grid" in found
    assert "long" not in found


def test_responses_are_kept_however_long(tmp_path):
    assert "grid" in recorded(tmp_path, ScipyDriver, "driver", long_variable=True)
