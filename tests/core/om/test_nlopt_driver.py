"""The NLopt driver on problems with known optima, beside SciPy's SLSQP, and what it tells of a run."""

import io
import time
from contextlib import redirect_stdout

import numpy as np
import openmdao.api as om
import pytest
from driver_cases import (
    CASES,
    betts,
    error,
    nlopt_driver,
    on_vectors,
    paraboloid,
    paraboloid_on_line,
    rosenbrock,
    solve,
)

from bspline_mdao import InputError, NLoptDriver
from bspline_mdao.core.om.drivers.nlopt_algorithms import ALGORITHMS

BY_NAME = {case.name: case for case in CASES}
pytestmark = pytest.mark.filterwarnings("ignore::openmdao.utils.om_warnings.OpenMDAOWarning")


def suits(case, name):
    """Whether an algorithm takes the constraints of a case."""
    algorithm = ALGORITHMS[name]
    return algorithm.inequality >= case.has_inequality and algorithm.equality >= case.has_equality


def scipy_driver(tolerance=1e-9):
    """SciPy's SLSQP, quiet."""
    return om.ScipyOptimizeDriver(optimizer="SLSQP", tol=tolerance, disp=False, singular_jac_behavior="ignore")


GRADIENT = [a.name for a in ALGORITHMS.values() if a.gradients and a.is_compiled and not a.is_global]
PLAIN = [(case, name, None) for case in CASES for name in GRADIENT if suits(case, name)]
INSIDE = [
    (case, outer, inner)
    for case in CASES
    for outer, inner in (("AUGLAG", "LD_LBFGS"), ("AUGLAG_EQ", "LD_CCSAQ"))
    if case.has_inequality or case.has_equality
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "algorithm", "local_optimizer"),
    PLAIN + INSIDE,
    ids=lambda value: getattr(value, "name", value),
)
def test_gradient_algorithms_reach_the_known_optimum(case, algorithm, local_optimizer):
    problem = solve(case, nlopt_driver(algorithm, local_optimizer=local_optimizer, maxeval=3000))
    assert error(case, problem) < 1e-6
    assert problem.driver.result.success
    assert problem.driver.is_feasible


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_slsqp_reaches_what_that_of_scipy_reaches_in_no_more_than_twice_the_evaluations(case):
    ours, theirs = solve(case, nlopt_driver("LD_SLSQP")), solve(case, scipy_driver())
    if case.name != "scaled by a negative number":  # SciPyOptimizeDriver then exchanges upper and lower limits
        assert abs(ours.get_val(case.objective).item() - theirs.get_val(case.objective).item()) < 1e-6 * max(
            1.0, abs(case.optimum)
        )
    assert ours.driver.result.model_evals <= 2 * theirs.driver.result.model_evals
    assert ours.driver.result.deriv_evals <= 2 * theirs.driver.result.deriv_evals


@pytest.mark.slow
def test_slsqp_needs_no_more_evaluations_than_that_of_scipy_on_all_problems_together():
    ours, theirs = (
        sum(solve(case, driver()).driver.result.model_evals for case in CASES)
        for driver in (lambda: nlopt_driver("LD_SLSQP"), scipy_driver)
    )
    assert ours <= theirs


LOCAL = ["LN_COBYLA", "LN_BOBYQA", "LN_NEWUOA_BOUND", "LN_PRAXIS", "LN_NELDERMEAD", "LN_SBPLX", "LN_AUGLAG"]


ROUGH = [(BY_NAME[name], algorithm) for name in ("paraboloid", "upper", "equality") for algorithm in LOCAL]


@pytest.mark.parametrize(
    ("case", "algorithm"),
    [(case, algorithm) for case, algorithm in ROUGH if suits(case, algorithm)],
    ids=lambda value: getattr(value, "name", value),
)
def test_local_algorithms_without_gradients_come_near(case, algorithm):
    problem = solve(case, nlopt_driver(algorithm))
    assert error(case, problem) < 1e-5
    assert problem.driver.result.success
    assert problem.driver.result.deriv_evals == 0


GLOBAL = [a.name for a in ALGORITHMS.values() if a.is_global and a.local_optimizer != "needed"]
FAR = {"GN_ESCH": 0.2, "GN_ISRES": 0.2}


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", GLOBAL)
def test_global_algorithms_come_near_within_their_budget(algorithm):
    case = BY_NAME["paraboloid"]
    problem = solve(case, nlopt_driver(algorithm, maxeval=600))
    assert error(case, problem) < FAR.get(algorithm, 0.01)
    assert problem.driver.result.success


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", [name for name in GLOBAL if ALGORITHMS[name].inequality])
def test_global_algorithms_keep_constraints(algorithm):
    problem = solve(BY_NAME["upper"], nlopt_driver(algorithm, maxeval=1000))
    assert error(BY_NAME["upper"], problem) < 0.1
    assert problem.get_val("d").item() <= -15.0 + 1e-5


def two_valleys():
    """Two minima, of which that at x = -1 is lower; the start is in the other's valley."""
    problem = om.Problem(reports=None)
    component = om.ExecComp("f = (x**2 - 1)**2 + 0.3*x + (y - 0.5)**2", x=0.9, y=0.0, do_coloring=False)
    problem.model.add_subsystem("valleys", component, promotes=["*"])
    for name in "xy":
        problem.model.add_design_var(name, lower=-2.0, upper=2.0)
    problem.model.add_objective("f")
    return problem


@pytest.mark.parametrize("local_optimizer", ["LD_LBFGS", "LN_BOBYQA"])
@pytest.mark.parametrize("algorithm", ["G_MLSL", "G_MLSL_LDS"])
def test_multi_start_leaves_the_valley_of_its_start(algorithm, local_optimizer):
    problem = two_valleys()
    problem.driver = nlopt_driver(algorithm, local_optimizer=local_optimizer, maxeval=400, population=4)
    problem.setup()
    problem.run_driver()
    assert problem.get_val("x").item() == pytest.approx(-1.035, abs=1e-2)


def run(problem, **options):
    """Run the NLopt driver on a problem that is not set up."""
    problem.driver = nlopt_driver(options.pop("optimizer", "LD_SLSQP"), **options)
    problem.setup()
    problem.run_driver()
    return problem


def test_the_same_seed_gives_the_same_points():
    objectives = [
        run(two_valleys(), optimizer="GN_CRS2_LM", maxeval=80, seed=seed).get_val("f").item()
        for seed in (3, 3, 4, None)
    ]
    assert objectives[0] == objectives[1] != objectives[2]


def test_linear_constraints_are_differentiated_once():
    calls = []
    problem = betts()
    problem.driver = nlopt_driver("LD_SLSQP")
    problem.setup()
    compute_totals = problem.driver._compute_totals
    problem.driver._compute_totals = lambda of, *rest: calls.append(tuple(of)) or compute_totals(of, *rest)
    problem.run_driver()
    assert calls.count(("c",)) == 1
    assert calls.count(("f",)) > 3


def test_the_model_is_left_at_the_best_feasible_point():
    problem = run(rosenbrock(upper=2.0), optimizer="LD_MMA")
    assert problem.get_val("r").item() <= 2.0 + 1e-6
    best = problem.driver.best
    np.testing.assert_array_equal(problem.get_val("x"), best.x)
    assert problem.get_val("f").item() == best.objective


def test_the_best_point_is_feasible_even_if_others_were_lower():
    problem = run(paraboloid((-20.0, 20.0), d={"lower": 10.0}), optimizer="LN_COBYLA", maxeval=12)
    assert problem.get_val("d").item() >= 10.0
    assert not problem.driver.result.success


# How runs end


def test_convergence_is_told_in_words(capsys):
    problem = paraboloid()
    problem.driver = NLoptDriver()
    problem.setup()
    result = problem.run_driver()
    words = "FTOL_REACHED: the objective changes by less than ftol_rel or ftol_abs; first-order residual "
    assert result.exit_status == f"{words}{problem.driver.outcome.optimality:.1e} of the largest gradient"
    assert problem.driver.outcome.optimality < 1e-9
    assert problem.driver.get_exit_status() == result.exit_status
    printed = capsys.readouterr().out
    assert "Optimization complete (LD_SLSQP)" in printed
    assert f"{result.model_evals} model runs, {result.deriv_evals} total derivatives" in printed
    assert result.iter_count == result.model_evals == problem.driver.iter_count
    assert 0 < result.deriv_evals <= result.model_evals
    assert result.runtime >= result.model_time > 0


ENDS = {
    "MAXEVAL_REACHED": ({"maxeval": 5}, False),
    "MAXTIME_REACHED": ({"maxtime": 1e-4, "optimizer": "LN_SBPLX"}, False),
    "STOPVAL_REACHED": ({"stopval": 0.9}, True),
    "XTOL_REACHED": ({"xtol_rel": 1e-2, "ftol_rel": 0.0, "optimizer": "LN_NELDERMEAD"}, True),
    "FTOL_REACHED": ({"ftol_abs": 1e-3, "ftol_rel": 0.0}, True),
}


@pytest.mark.parametrize("end", ENDS)
def test_every_criterion_stops_the_run_and_only_convergence_is_success(end):
    options, is_success = ENDS[end]
    result = run(rosenbrock(), **options).driver.result
    assert result.exit_status.startswith(f"{end}: ")
    assert result.success == is_success


def test_each_variable_may_have_its_own_tolerance_and_first_step():
    coarse, fine = (
        run(
            paraboloid(),
            optimizer="LN_SBPLX",
            ftol_rel=0.0,
            xtol_abs=np.array([0.1, tolerance]),
            initial_step=np.array([2.0, 1.0]),
        )
        for tolerance in (0.1, 1e-7)
    )
    assert "XTOL_REACHED" in coarse.driver.result.exit_status
    assert coarse.driver.result.model_evals < fine.driver.result.model_evals


def test_an_end_that_is_infeasible_is_a_failure():
    problem = run(paraboloid(d={"lower": 200.0}))
    assert not problem.driver.result.success
    assert "constraints are violated by up to 1.0e+02" in problem.driver.result.exit_status


def test_an_interrupt_from_the_keyboard_keeps_the_best_point():
    class Interrupting(om.ExplicitComponent):
        def setup(self):
            self.add_input("x", 1.0)
            self.add_output("f")
            self.declare_partials("f", "x")
            self.n_runs = 0

        def compute(self, inputs, outputs):
            self.n_runs += 1
            if self.n_runs == 4:
                raise KeyboardInterrupt
            outputs["f"] = np.cosh(inputs["x"])

        def compute_partials(self, inputs, partials):
            partials["f", "x"] = np.sinh(inputs["x"])

    for algorithm in ("LD_SLSQP", "LD_MMA", "LD_LBFGS", "LN_COBYLA", "LD_VAR2"):
        problem = om.Problem(reports=None)
        problem.model.add_subsystem("bowl", Interrupting(), promotes=["*"])
        problem.model.add_design_var("x", lower=-5.0, upper=5.0)
        problem.model.add_objective("f")
        result = run(problem, optimizer=algorithm).driver.result
        assert result.exit_status == "INTERRUPTED: it was interrupted from the keyboard"
        assert not result.success
        assert problem.get_val("f").item() == pytest.approx(np.cosh(problem.get_val("x").item()), rel=1e-14)
        assert problem.get_val("f").item() <= np.cosh(1.0)
        assert problem.get_val("f").item() == problem.driver.best.objective


class Breaking(om.ExplicitComponent):
    """A bowl above a limit c that raises something in its third run, or in its second computation of partials."""

    def initialize(self):
        self.options.declare("error")
        self.options.declare("where", "compute")

    def setup(self):
        self.add_input("x", [3.0, 2.0])
        self.add_output("f")
        self.add_output("c")
        self.declare_partials("*", "x")
        self.points, self.n_partials = [], 0

    def compute(self, inputs, outputs):
        outputs["f"], outputs["c"] = np.sum(inputs["x"] ** 4), np.sum(inputs["x"])
        if len(self.points) == 2 and self.options["where"] == "compute":
            raise self.options["error"]
        self.points.append((outputs["f"].item(), tuple(inputs["x"])))

    def compute_partials(self, inputs, partials):
        self.n_partials += 1
        if self.n_partials == 2 and self.options["where"] == "partials":
            raise self.options["error"]
        partials["f", "x"], partials["c", "x"] = 4.0 * inputs["x"] ** 3, np.ones((1, 2))


def breaking(lower=-1.0, **options):
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("breaking", Breaking(**options), promotes=["*"])
    problem.model.add_design_var("x", lower=-5.0, upper=5.0)
    problem.model.add_objective("f")
    problem.model.add_constraint("c", lower=lower)
    return problem


@pytest.mark.parametrize("where", ["compute", "partials"])
@pytest.mark.parametrize("kind", [ZeroDivisionError, SystemExit])
@pytest.mark.parametrize("algorithm", ["LD_SLSQP", "LD_MMA", "LD_CCSAQ", "LN_COBYLA", "GN_ISRES"])
def test_what_the_model_raises_comes_out_and_names_the_best_design(algorithm, kind, where):
    if where == "partials" and not ALGORITHMS[algorithm].gradients:
        return
    raised = kind("in the model")
    problem = breaking(error=raised, where=where)
    with pytest.raises(kind, match="in the model") as error:
        run(problem, optimizer=algorithm)
    assert error.value is raised
    objective, x = min(problem.model.breaking.points)
    driver = problem.driver
    assert driver.is_feasible
    assert driver.best.objective == objective
    assert tuple(driver.best.x) == x == tuple(problem.get_val("x"))
    named = f"objective {objective:.10g} (scaled) and is feasible"
    assert named in driver.get_exit_status()
    assert driver.get_exit_status().startswith("NOT_FINISHED: the run ended in an exception; ")
    assert named in "".join(getattr(raised, "__notes__", [named]))


def test_a_second_interrupt_keeps_the_best_point(monkeypatch):
    def interrupt(functions):
        raise KeyboardInterrupt

    monkeypatch.setattr("bspline_mdao.core.om.drivers.nlopt_functions.Functions.restore_best", interrupt)
    problem = breaking(error=KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        run(problem, optimizer="LD_SLSQP")
    assert problem.driver.best.objective == min(problem.model.breaking.points)[0]


def test_a_best_point_that_is_not_feasible_is_named_as_such():
    problem = breaking(error=ZeroDivisionError(), lower=90.0)
    with pytest.raises(ZeroDivisionError):
        run(problem)
    assert not problem.driver.is_feasible
    assert "violates constraints by up to" in problem.driver.get_exit_status()


def test_nothing_is_named_where_the_first_run_fails():
    problem = breaking(error=ZeroDivisionError())
    problem.driver = nlopt_driver("LD_SLSQP")
    problem.setup()
    problem.final_setup()
    problem.model.breaking.points = [0, 0]
    with pytest.raises(ZeroDivisionError):
        problem.run_driver()
    assert problem.driver.get_exit_status() == "NOT_FINISHED: the run ended in an exception"


def printed_by(problem, algorithm):
    """Lines that a run prints by default."""
    problem.driver = NLoptDriver(optimizer=algorithm, singular_jac_behavior="ignore")
    problem.setup()
    printed = io.StringIO()
    with redirect_stdout(printed):
        problem.run_driver()
    return printed.getvalue().splitlines()


@pytest.mark.parametrize("algorithm", ["LD_SLSQP", "LD_MMA", "LN_COBYLA"])
def test_the_iterations_are_shown_by_default(algorithm):
    problem = paraboloid(d={"upper": -15.0})
    head, *lines = printed_by(problem, algorithm)
    assert head.split() == ["iteration", "runs", "objective", "violation", "optimality", "(scaled)"]
    lines = [line.split() for line in lines[: [line.startswith("Optim") for line in lines].index(True)]]
    assert [int(line[0]) for line in lines] == list(range(1, len(lines) + 1))
    runs = [int(line[1]) for line in lines]
    assert runs == sorted(runs)
    assert runs[-1] <= problem.driver.result.model_evals
    assert float(lines[-1][2]) == pytest.approx(paraboloid_on_line(-15.0), rel=1e-5)
    assert (float(lines[0][3]), len(lines[0])) == (15.0, 5 if algorithm.startswith("LD") else 4)
    if algorithm.startswith("LD"):
        assert len(lines) == problem.driver.result.deriv_evals
        gradient, outward = np.array([-6.0, 8.0]), np.array([-1.0, 1.0])  # of (x - 3)^2 + x y + (y + 4)^2, d at 0
        left = gradient - min(gradient @ outward, 0.0) * outward / 2.0
        assert float(lines[0][4]) == pytest.approx(np.linalg.norm(left) / 10.0, rel=1e-3)
        assert float(lines[-1][4]) < 1e-3


def test_a_quiet_driver_prints_nothing(capsys):
    run(paraboloid())
    assert capsys.readouterr().out == ""


# What is refused


REFUSED = {
    "LD_MMA takes no equality constraints ('d')": (lambda: paraboloid(d={"equals": -15.0}), {"optimizer": "LD_MMA"}),
    "LD_LBFGS takes no inequality constraints ('d')": (lambda: paraboloid(d={"lower": 1.0}), {"optimizer": "LD_LBFGS"}),
    "LN_NEWUOA ignores bounds ('x', 'y')": (paraboloid, {"optimizer": "LN_NEWUOA"}),
    "AUGLAG needs a local_optimizer": (paraboloid, {"optimizer": "AUGLAG"}),
    "LD_SLSQP runs no other algorithm": (paraboloid, {"local_optimizer": "LD_MMA"}),
    "local_optimizer LD_LBFGS takes no inequality": (
        lambda: paraboloid(d={"lower": 1.0}),
        {"optimizer": "AUGLAG_EQ", "local_optimizer": "LD_LBFGS"},
    ),
    "GN_ISRES has no end": (paraboloid, {"optimizer": "GN_ISRES", "maxeval": 0}),
    "option xtol_abs has 3 values": (paraboloid, {"xtol_abs": np.ones(3)}),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_cannot_be_done_is_refused_in_one_line_before_the_model_runs(message):
    build, options = REFUSED[message]
    problem = build()
    with pytest.raises(InputError) as raised:
        run(problem, **options)
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)
    assert problem.driver.result.model_evals == 0


def test_gradients_are_refused_without_derivatives():
    problem = paraboloid()
    problem.driver = nlopt_driver("LD_SLSQP")
    problem.setup(derivatives=False)
    with pytest.raises(InputError, match=r"needs gradients, .*: AUGLAG, .*LN_AUGLAG, .*LN_COBYLA"):
        problem.run_driver()
    problem.driver.options["optimizer"] = "LN_BOBYQA"
    assert problem.run_driver().success


def test_an_objective_is_needed_and_one_only():
    problem = paraboloid()
    problem.model.add_objective("c")
    problem.driver = nlopt_driver("LD_SLSQP")
    problem.setup()
    with pytest.raises(InputError, match="one objective"):
        problem.run_driver()


def test_names_that_nlopt_does_not_know_are_refused_at_once():
    with pytest.raises(ValueError, match="optimizer"):
        NLoptDriver(optimizer="SLSQP")


@pytest.mark.parametrize(
    ("option", "wrong", "right"),
    [
        ("population", 10**9, 10**6),
        ("vector_storage", 10**9, 100),
        ("seed", -1, 2**31 - 1),
        ("maxeval", 2**31, 2**31 - 1),
        ("local_maxeval", 2**40, 5),
        ("xtol_abs", -1.0, np.array([1.0, 0.0])),
        ("initial_step", 0.0, np.array([1.0, 2.0])),
        ("initial_step", np.array([1.0, -1.0]), None),
        ("parameters", {"inner_maxeval": "a"}, {"inner_maxeval": 3}),
        ("parameters", {3: 1.0}, {}),
    ],
)
def test_values_that_nlopt_cannot_take_are_refused_where_they_are_given(option, wrong, right):
    options = NLoptDriver().options
    options[option] = right
    with pytest.raises(ValueError, match=f"'{option}' (is|exceeds) "):
        options[option] = wrong


def test_a_problem_without_design_variables_is_refused():
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("f", om.ExecComp("f = x**2"), promotes=["*"])
    problem.model.add_objective("f")
    with pytest.raises(InputError, match="no design variables"):
        run(problem)


def test_what_nlopt_refuses_is_told_in_its_words():
    with pytest.raises(InputError, match=r"NLopt refuses to run AGS .*: \w"):
        run(rosenbrock(12), optimizer="GN_AGS")


def test_a_start_outside_the_bounds_is_brought_within():
    problem = paraboloid((80.0, 0.0), d={"upper": -15.0})
    problem.driver = nlopt_driver("LD_SLSQP", invalid_desvar_behavior="ignore")
    problem.setup()
    assert problem.run_driver().success
    assert problem.get_val("f").item() == pytest.approx(paraboloid_on_line(-15.0), rel=1e-9)


def test_variables_that_are_fixed_by_their_bounds_stay():
    problem = om.Problem(reports=None)
    component = om.ExecComp("f = (x - 1)**2 + x*y + y**2", x=3.0, y=1.0, do_coloring=False)
    problem.model.add_subsystem("bowl", component, promotes=["*"])
    problem.model.add_design_var("x", lower=3.0, upper=3.0)
    problem.model.add_design_var("y", lower=-5.0, upper=5.0)
    problem.model.add_objective("f")
    for algorithm in ("LD_SLSQP", "LD_MMA", "LN_COBYLA"):
        run(problem, optimizer=algorithm)
        assert problem.get_val("x").item() == 3.0
        assert problem.get_val("y").item() == pytest.approx(-1.5, abs=1e-4)


# OpenMDAO around it


@pytest.mark.slow
def test_every_evaluation_is_recorded(tmp_path):
    problem = on_vectors(indices=[0, 3], upper=[2.0, 5.0])
    problem.driver = nlopt_driver("LD_MMA")
    problem.driver.add_recorder(om.SqliteRecorder(tmp_path / "cases.sql", record_viewer_data=False))
    problem.driver.recording_options["record_derivatives"] = True
    problem.setup()
    problem.run_driver()
    problem.cleanup()
    reader = om.CaseReader(tmp_path / "cases.sql")
    cases = reader.list_cases("driver", out_stream=None)
    assert len(cases) == problem.driver.result.model_evals
    assert "NLopt_LD_MMA" in cases[0]
    objectives = [reader.get_case(case).get_objectives()["f"].item() for case in cases]
    assert problem.get_val("f").item() in objectives


def test_total_colouring_reduces_the_linear_solves():
    def sparse(driver):
        problem = om.Problem(reports=None)
        component = om.ExecComp("g = x**2 + x", x=np.linspace(0.5, 1.5, 20), g=np.zeros(20), has_diag_partials=True)
        problem.model.add_subsystem("diagonal", component, promotes=["*"])
        problem.model.add_subsystem(
            "total", om.ExecComp("f = sum(cosh(x))", x=np.linspace(0.5, 1.5, 20), do_coloring=False), promotes=["*"]
        )
        problem.model.add_design_var("x", lower=-4.0, upper=4.0)
        problem.model.add_objective("f")
        problem.model.add_constraint("g", lower=np.linspace(0.1, 0.4, 20))
        problem.driver = driver
        problem.setup(mode="rev")
        problem.run_driver()
        return problem

    plain, coloured = nlopt_driver("LD_SLSQP"), nlopt_driver("LD_SLSQP")
    coloured.declare_coloring(show_summary=False)
    first, second = sparse(plain), sparse(coloured)
    np.testing.assert_allclose(first.get_val("x"), second.get_val("x"), atol=1e-9)
    assert second.driver._coloring_info.coloring.total_solves() < 5


def test_totals_may_be_approximated():
    problem = paraboloid(d={"upper": -15.0})
    problem.model.approx_totals(method="fd")
    assert run(problem).get_val("f").item() == pytest.approx(paraboloid_on_line(-15.0), rel=1e-9)


def test_one_output_may_be_constrained_twice_by_aliases():
    problem = on_vectors(indices=[0], upper=2.0, alias="first")
    problem.model.add_constraint("g", indices=[3], upper=5.0, alias="second")
    problem.model.add_constraint("g", indices=[1], equals=-1.0, alias="third", linear=True)
    run(problem)
    np.testing.assert_allclose(problem.get_val("z"), [0.5, -1.0, 0.0, 2.0, 0.0, -1.0], atol=1e-6)


def test_units_are_those_of_the_declaration_and_what_comes_after_is_run_at_the_end():
    problem = om.Problem(reports=None, group_by_pre_opt_post=True)
    metres = {name: {"units": "m"} for name in "xyc"}
    formulas = ["f = (x - a)**2 + (y - 1)**2", "c = x + y"]
    for name, component in {
        "before": om.ExecComp("a = 2*q", q=1.5),
        "bowl": om.ExecComp(formulas, do_coloring=False, **metres),
        "after": om.ExecComp("z = 3*f"),
    }.items():
        problem.model.add_subsystem(name, component, promotes=["*"])
    problem.model.add_design_var("x", lower=0.0, upper=2000.0, units="cm", ref=100.0)
    problem.model.add_design_var("y", lower=-5.0, upper=5.0)
    problem.model.add_objective("f", ref=10.0)
    problem.model.add_constraint("c", upper=300.0, units="cm")
    run(problem)
    assert problem.get_val("x").item() == pytest.approx(2.5, abs=1e-5)
    assert problem.get_val("y").item() == pytest.approx(0.5, abs=1e-5)
    assert problem.get_val("z").item() == pytest.approx(1.5, abs=1e-6)


def test_the_autoscaler_of_openmdao_is_used():
    module = pytest.importorskip("openmdao.drivers.autoscalers.bounds_autoscaler", reason="new in OpenMDAO 3.45")
    problem = paraboloid(d={"upper": -15.0})
    problem.driver = nlopt_driver("LN_COBYLA")
    problem.driver.autoscaler = module.BoundsAutoscaler()
    problem.setup()
    assert problem.run_driver().success
    np.testing.assert_allclose(problem.driver.best.x, [(problem.get_val(name).item() + 50) / 100 for name in "xy"])


def test_debug_printing_shows_every_point():
    problem = paraboloid(d={"upper": -15.0})
    problem.driver = nlopt_driver("LD_SLSQP", debug_print=["desvars", "nl_cons", "objs", "totals"])
    problem.setup()
    printed = io.StringIO()
    with redirect_stdout(printed):
        result = problem.run_driver()
    assert printed.getvalue().count("Design Vars") == result.model_evals
    assert printed.getvalue().count("Objectives") == result.model_evals
    assert "Driver total derivatives for iteration" in printed.getvalue()


def test_a_column_of_zeros_in_the_totals_is_told():
    def idle(behavior):
        problem = om.Problem(reports=None)
        component = om.ExecComp("f = x[0]**2 + 0*x[1]", x=np.ones(2), do_coloring=False)
        problem.model.add_subsystem("idle", component, promotes=["*"])
        problem.model.add_design_var("x", lower=-1, upper=1)
        problem.model.add_objective("f")
        problem.driver = NLoptDriver(disp=False, singular_jac_behavior=behavior)
        problem.setup()
        problem.run_driver()

    with pytest.raises(RuntimeError, match="no impact"):
        idle("error")
    with pytest.warns(om.DerivativesWarning, match="no impact"):
        idle("warn")


def test_the_optimizer_report_tells_the_algorithm_and_how_it_ended(tmp_path, monkeypatch):
    from openmdao.visualization.opt_report.opt_report import opt_report

    problem = run(paraboloid(d={"upper": -15.0}), optimizer="LD_CCSAQ")
    monkeypatch.chdir(tmp_path)
    opt_report(problem, outfile=str(tmp_path / "report.html"))
    report = (tmp_path / "report.html").read_text()
    assert "NLopt_LD_CCSAQ" in report
    assert "FTOL_REACHED: the objective changes by less" in report
    assert "constraint_tolerance" in report


def test_a_driver_runs_again_after_its_options_were_changed():
    problem = run(paraboloid(d={"upper": -15.0}), optimizer="LD_MMA", maxeval=3)
    assert not problem.driver.result.success
    problem.driver.options["maxeval"] = 200
    assert problem.run_driver().success
    problem.driver.options["optimizer"] = "LN_COBYLA"
    problem.set_val("x", 0.0)
    assert problem.run_driver().success
    assert problem.get_val("f").item() == pytest.approx(paraboloid_on_line(-15.0), rel=1e-6)


@pytest.mark.slow
def test_parameters_of_one_algorithm_reach_nlopt():
    counts = [
        run(rosenbrock(), optimizer="LD_MMA", parameters=parameters).driver.result.model_evals
        for parameters in ({}, {"rho_init": 100.0})
    ]
    assert counts[0] != counts[1]
    counts = [
        run(rosenbrock(20), optimizer="LD_LBFGS", vector_storage=storage).driver.result.model_evals
        for storage in (0, 1)
    ]
    assert counts[0] < counts[1]


def test_a_pause_in_the_model_counts_for_maxtime():
    class Slow(om.ExplicitComponent):
        def setup(self):
            self.add_input("x", [0.4, 0.8])
            self.add_output("f")

        def compute(self, inputs, outputs):
            time.sleep(0.02)
            outputs["f"] = np.sum(np.cosh(inputs["x"]))

    problem = om.Problem(reports=None)
    problem.model.add_subsystem("slow", Slow(), promotes=["*"])
    problem.model.add_design_var("x", lower=-1.0, upper=1.0)
    problem.model.add_objective("f")
    result = run(problem, optimizer="LN_NELDERMEAD", maxtime=0.2, ftol_rel=0.0).driver.result
    assert result.exit_status.startswith("MAXTIME_REACHED")
    assert 5 <= result.model_evals <= 14
