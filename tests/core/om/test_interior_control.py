"""Interior control points as design variables of OpenMDAO problems."""

from dataclasses import replace

import numpy as np
import openmdao.api as om
import pytest
from adaptation_cases import skewed_model

from bspline_mdao import GridEvaluate, GridMovement, InputError, InteriorControl, NLoptDriver, Quality
from bspline_mdao.design import InteriorPoints, Local, Parametrization
from bspline_mdao.movers import moving_mesh
from bspline_mdao.testing import check_totals


def quality_problem(driver=None, **options):
    """Interior control points against the worst cells of the skewed grid."""
    model = skewed_model()
    model = replace(model, settings=replace(model.settings, wall_layer=False))
    problem = om.Problem(driver=driver, reports=False)
    group = problem.model
    interior = group.add_subsystem(
        "interior", InteriorControl(model=model, variables=[InteriorPoints("inner", **options)]), promotes=["*"]
    )
    group.add_subsystem("evaluate", GridEvaluate(model=model), promotes=["*"])
    group.add_subsystem("quality", Quality(model=model, cells=True, rho=50.0), promotes=["*"])
    problem.setup(mode="rev")
    shift = interior.shifts["inner"]
    group.add_design_var("inner", lower=shift.lower, upper=shift.upper)
    group.add_objective("quality_ks", scaler=-1.0)
    problem.setup(mode="rev")
    return problem


def test_total_derivatives_of_the_worst_cell_are_exact():
    problem = quality_problem()
    problem.set_val("inner", 0.02 * np.random.default_rng(3).normal(size=problem.get_val("inner").shape))
    problem.run_model()
    check_totals(problem)


@pytest.mark.parametrize(
    "driver",
    [
        lambda: om.ScipyOptimizeDriver(optimizer="L-BFGS-B", maxiter=15, disp=False),
        lambda: NLoptDriver(optimizer="LD_MMA", maxeval=30, disp=False),
    ],
    ids=["SciPy", "NLopt"],
)
def test_a_driver_raises_the_worst_cell(driver):
    problem = quality_problem(driver())
    problem.run_model()
    before = problem.get_val("cell_quality").min()
    problem.run_driver()
    assert problem.get_val("cell_quality").min() > 1.1 * before
    assert np.abs(problem.get_val("inner")).max() <= 0.4 + 1e-12


def test_surface_and_inside_are_designed_together():
    model = skewed_model()
    mesh = moving_mesh(model)
    problem = om.Problem(reports=False)
    problem.model.add_subsystem(
        "interior",
        InteriorControl(model=model, variables=[InteriorPoints("inner", reach=0.2)]),
        promotes_inputs=["inner"],
        promotes_outputs=[("control_points", "control_points_initial")],
    )
    movement = GridMovement(
        model=model, parametrization=Parametrization(mesh, [Local("floor", direction="z")]), fit=False
    )
    problem.model.add_subsystem("shape", movement, promotes=["*"])
    for name in ("inner", "floor"):
        problem.model.add_design_var(name)
    problem.model.add_objective("quality_ks")
    problem.setup(mode="rev")
    random = np.random.default_rng(4)
    for name in ("inner", "floor"):
        problem.set_val(name, 0.01 * random.normal(size=problem.get_val(name).shape))
    problem.run_model()
    check_totals(problem)


def test_names_that_are_taken_are_refused():
    for variables, name in (
        ([InteriorPoints("grid")], "grid"),
        ([InteriorPoints("inner"), InteriorPoints("inner")], "inner"),
    ):
        problem = om.Problem(reports=False)
        component = InteriorControl(model=skewed_model(), variables=variables)
        problem.model.add_subsystem("interior", component)
        with pytest.raises(InputError, match=f"the name '{name}' of a variable is taken"):
            problem.setup()
