"""Problems with known optima for the drivers."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import openmdao.api as om
from openmdao.core.driver import Driver
from openmdao.test_suite.components.sellar import SellarDerivatives

from bspline_mdao import NLoptDriver


@dataclass(frozen=True)
class Case:
    """A problem: how to build it, its lowest objective and what constrains it."""

    name: str
    build: Callable[[], om.Problem]
    objective: str
    optimum: float
    has_inequality: bool = False
    has_equality: bool = False


class Formulas(om.ExplicitComponent):
    """Outputs and their derivatives by formulas: an `om.ExecComp` takes ten times as long for its complex steps."""

    def __init__(self, start, of):
        super().__init__()
        self.start, self.of = start, of  # the start of each input; by output, its formula and its derivatives

    def initialize(self):
        self.options.declare("units", None)  # which change nothing

    def setup(self):
        for name, value in self.start.items():
            self.add_input(name, value)
        for name, (formula, derivatives) in self.of.items():
            self.add_output(name, shape=np.shape(formula(**self.start)) or 1)
            self.declare_partials(name, list(derivatives))

    def compute(self, inputs, outputs):
        for name, (formula, _) in self.of.items():
            outputs[name] = formula(**inputs)

    def compute_partials(self, inputs, partials):
        for name, (_, derivatives) in self.of.items():
            for of, derivative in derivatives.items():
                partials[name, of] = derivative(**inputs)


def paraboloid(start=(0.0, 0.0), *, shift=None, scale=None, **constraints) -> om.Problem:
    """f = (x - 3)^2 + x y + (y + 4)^2 - 3 with constraints on c = x + y, d = y - x, r = x^2 + y^2."""
    problem = om.Problem(reports=None)
    formulas = {
        "f": (
            lambda x, y: (x - 3) ** 2 + x * y + (y + 4) ** 2 - 3,
            {"x": lambda x, y: 2 * (x - 3) + y, "y": lambda x, y: x + 2 * (y + 4)},
        ),
        "c": (lambda x, y: x + y, {"x": lambda x, y: 1.0, "y": lambda x, y: 1.0}),
        "d": (lambda x, y: y - x, {"x": lambda x, y: -1.0, "y": lambda x, y: 1.0}),
        "r": (lambda x, y: x**2 + y**2, {"x": lambda x, y: 2 * x, "y": lambda x, y: 2 * y}),
    }
    component = Formulas(start={"x": start[0], "y": start[1]}, of=formulas)
    problem.model.add_subsystem("paraboloid", component, promotes=["*"])
    for name in "xy":
        problem.model.add_design_var(name, lower=-50.0, upper=50.0, **(shift or {}))
    problem.model.add_objective("f", **(scale or {}))
    for name, settings in constraints.items():
        problem.model.add_constraint(name, **settings)
    return problem


def on_vectors(**constraint) -> om.Problem:
    """|z - t|^2 in six variables, of which four may move, with a constraint on some of the entries of 2 z + 1."""
    problem = om.Problem(reports=None)
    target = np.array([1.0, -2.0, 0.5, 3.0, 4.0, -1.0])
    formulas = {
        "f": (lambda z: np.sum((z - target) ** 2), {"z": lambda z: 2 * (z - target)}),
        "g": (lambda z: 2 * z + 1, {"z": lambda z: 2 * np.eye(6)}),
    }
    problem.model.add_subsystem("distance", Formulas(start={"z": np.zeros(6)}, of=formulas), promotes=["*"])
    problem.model.add_design_var("z", lower=-10.0, upper=[10.0, 10.0, 10.0, 2.5], indices=[0, 1, 3, 5])
    problem.model.add_objective("f")
    if constraint:
        problem.model.add_constraint("g", **constraint)
    return problem


def rosenbrock(n: int = 5, **constraint) -> om.Problem:
    """Rosenbrock's valley, with 4 instead of 100, within a ball if a constraint on r = |x|^2 is given."""

    def slope(x):
        steps = 8 * (x[1:] - x[:-1] ** 2)
        return np.append(-2 * x[:-1] * steps - 2 * (1 - x[:-1]), 0.0) + np.append(0.0, steps)

    problem = om.Problem(reports=None)
    formulas = {
        "f": (lambda x: np.sum(4 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2), {"x": slope}),
        "r": (lambda x: np.sum(x**2), {"x": lambda x: 2 * x}),
    }
    component = Formulas(start={"x": np.linspace(-0.9, 0.6, n)}, of=formulas)
    problem.model.add_subsystem("valley", component, promotes=["*"])
    problem.model.add_design_var("x", lower=-3.0, upper=3.0)
    problem.model.add_objective("f")
    if constraint:
        problem.model.add_constraint("r", **constraint)
    return problem


def betts() -> om.Problem:
    """Problem of Betts: a bowl beside a linear constraint and a bound."""
    problem = om.Problem(reports=None)
    component = om.ExecComp(["f = 0.01*x**2 + y**2 - 100", "c = 10*x - y"], x=5.0, y=5.0, do_coloring=False)
    problem.model.add_subsystem("betts", component, promotes=["*"])
    problem.model.add_design_var("x", lower=2.0, upper=50.0)
    problem.model.add_design_var("y", lower=-50.0, upper=50.0)
    problem.model.add_objective("f")
    problem.model.add_constraint("c", lower=10.0, linear=True)
    return problem


def sellar() -> om.Problem:
    """Sellar's two coupled disciplines."""
    problem = om.Problem(
        SellarDerivatives(nonlinear_solver=om.NonlinearBlockGS, linear_solver=om.DirectSolver), reports=None
    )
    problem.model.set_solver_print(-1)
    problem.model.add_design_var("z", lower=[-10.0, 0.0], upper=[10.0, 10.0])
    problem.model.add_design_var("x", lower=0.0, upper=10.0)
    problem.model.add_objective("obj")
    problem.model.add_constraint("con1", upper=0.0)
    problem.model.add_constraint("con2", upper=0.0)
    return problem


def paraboloid_on_line(d: float) -> float:
    """Lowest objective of the paraboloid where y - x = d; without constraints that is at d = -14."""
    return 6.0 + (d + 4.0) ** 2 - (3.0 * d + 2.0) ** 2 / 12.0


REST = 0.5**2 + 4.0**2
"""What the two variables that may not move add to the objective of `on_vectors`."""


def _free(name: str, build: Callable[[], om.Problem], objective: str, optimum: float) -> Case:
    return Case(name, build, objective, optimum)


def _inequality(name: str, build: Callable[[], om.Problem], objective: str, optimum: float) -> Case:
    return Case(name, build, objective, optimum, has_inequality=True)


def _equality(name: str, build: Callable[[], om.Problem], objective: str, optimum: float) -> Case:
    return Case(name, build, objective, optimum, has_equality=True)


CASES = (
    _free("paraboloid", paraboloid, "f", paraboloid_on_line(-14.0)),
    _free(
        "paraboloid scaled by references",
        lambda: paraboloid(shift={"ref": 10.0, "ref0": -3.0}, scale={"ref": -20.0, "ref0": -60.0}),
        "f",
        paraboloid_on_line(-14.0),
    ),
    _free("vectors", on_vectors, "f", REST),
    _free("Rosenbrock", rosenbrock, "f", 0.0),
    _inequality("upper", lambda: paraboloid(d={"upper": -15.0}), "f", paraboloid_on_line(-15.0)),
    _inequality("lower", lambda: paraboloid(d={"lower": -12.0}), "f", paraboloid_on_line(-12.0)),
    _inequality("linear", lambda: paraboloid(d={"upper": -15.0, "linear": True}), "f", paraboloid_on_line(-15.0)),
    _inequality(
        "two-sided, low", lambda: paraboloid(d={"lower": -13.0, "upper": 50.0}), "f", paraboloid_on_line(-13.0)
    ),
    _inequality(
        "two-sided, high", lambda: paraboloid(d={"lower": -50.0, "upper": -16.0}), "f", paraboloid_on_line(-16.0)
    ),
    _inequality(
        "two-sided, linear, scaled",
        lambda: paraboloid(
            shift={"scaler": 0.25, "adder": 7.0},
            d={"lower": -11.0, "upper": -10.0, "linear": True, "ref": 5.0, "ref0": 2.0},
        ),
        "f",
        paraboloid_on_line(-11.0),
    ),
    _inequality(
        "scaled by a negative number",
        lambda: paraboloid(d={"upper": -15.0, "scaler": -0.2, "adder": 3.0}),
        "f",
        paraboloid_on_line(-15.0),
    ),
    _inequality(
        "linear and nonlinear",
        lambda: paraboloid((5.0, -5.0), r={"upper": 25.0}, c={"lower": 0.5, "linear": True}),
        "f",
        -14.248575928869,
    ),
    _inequality("vector", lambda: on_vectors(indices=[0, 3], upper=[2.0, 5.0]), "f", REST + 0.5**2 + 1.0),
    _inequality(
        "vector, two-sided",
        lambda: on_vectors(indices=[0, 1, 5], lower=[4.0, -4.0, -9.0], upper=[9.0, -3.5, -3.0]),
        "f",
        REST + 0.5**2 + 0.25**2 + 1.0,
    ),
    _inequality("Betts", betts, "f", -99.96),
    _inequality("Sellar", sellar, "obj", 3.18339395172),
    _inequality("Rosenbrock in a ball", lambda: rosenbrock(upper=2.0), "f", 0.51081392530394),
    _equality("equality", lambda: paraboloid(d={"equals": -15.0}), "f", paraboloid_on_line(-15.0)),
    _equality(
        "equality, linear, scaled",
        lambda: paraboloid(d={"equals": -15.0, "linear": True, "ref": 40.0, "ref0": 10.0}),
        "f",
        paraboloid_on_line(-15.0),
    ),
    _equality("vector equality", lambda: on_vectors(indices=[1, 5], equals=[-1.0, 0.0]), "f", REST + 1.0 + 0.5**2),
    _equality("circle", lambda: paraboloid((2.0, -2.0), r={"equals": 25.0}), "f", -15.248579511485),
)


def solve(case: Case, driver: Driver) -> om.Problem:
    """The problem of a case, after the driver has run."""
    problem = case.build()
    problem.driver = driver
    problem.setup()
    problem.run_driver()
    return problem


def error(case: Case, problem: om.Problem) -> float:
    """Error of the objective, relative where the optimum is larger than one."""
    return abs(problem.get_val(case.objective).item() - case.optimum) / max(1.0, abs(case.optimum))


def nlopt_driver(algorithm: str, **options) -> NLoptDriver:
    """A quiet driver."""
    return NLoptDriver(optimizer=algorithm, disp=False, singular_jac_behavior="ignore", **options)
