"""Levels of a design: the start of each is the end of the one before, and curvature is carried on."""

from functools import cache

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import InputError, SurfaceControl, fit_grid
from bspline_mdao.core.design.parametrization import Parametrization
from bspline_mdao.design import CoarseNet, DesignLevel, Local, OnPatch, unused_gradient
from bspline_mdao.drivers import nlopt, recorded
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.movers import moving_mesh
from bspline_mdao.testing import check_totals

LIMIT = 0.01
"""What the sum of all displacements may be (m)."""


@cache
def first_level():
    model = fit_grid(onera_m6_grid((9, 9, 9)), n_control=(8, 5, 7))
    upper, lower = (OnPatch(model, f"wing_{side}") for side in ("upper", "lower"))
    mesh = moving_mesh(model)
    return DesignLevel.first(
        CoarseNet.of(model, mesh, Local("heights", upper & ~lower, "y"), n=4), -0.06, 0.04, unit=0.05
    )


@cache
def target():
    """A shape that is out of reach of the first level, and stiffnesses of the surface control points."""
    random, net = np.random.default_rng(2), first_level().net
    finer = net.refine([(0, 1)])
    points = net.mesh.points[net.mesh.surface_ids]
    shape = Parametrization(net.mesh, [finer]).apply(points, {"heights": 0.04 * random.normal(size=finer.n_values)})
    return shape.ravel(), random.uniform(0.5, 2.0, points.size)


def pose(level):
    """Least squares of the distances to the target, with a limit on the sum of the displacements."""
    shape, stiffness = target()
    start = level.net.mesh.points[level.net.mesh.surface_ids].ravel()
    problem, n = om.Problem(reports=None), shape.size
    level.add_to(problem.model)
    control = SurfaceControl(parametrization=Parametrization(level.net.mesh, [level.net]))
    problem.model.add_subsystem("control", control, promotes=["*"])
    distance = om.ExecComp(
        ["f = sum(k * (s - target)**2)", "total = sum(s - start)"],
        s={"shape": n, "units": "m"},
        **{
            name: {"val": value, "constant": True}
            for name, value in (("k", stiffness), ("target", shape), ("start", start))
        },
        do_coloring=False,
    )
    problem.model.add_subsystem("distance", distance, promotes=["f", "total", ("s", "surface_control_points")])
    problem.model.add_objective("f", ref=0.02)
    problem.model.add_constraint("total", upper=LIMIT, ref=LIMIT)
    return problem


def solved(level, tolerance, folder, name):
    """Find the least squares of a level, and record it."""
    problem = pose(level)
    problem.driver = nlopt(tolerance, 100)
    with recorded(problem, folder, name) as run:
        problem.run_driver()
    return run


@cache
def first_optimum(folder):
    return solved(first_level(), 1e-10, folder, "first").problem


@pytest.fixture(scope="module")
def at_optimum(tmp_path_factory):
    folder = tmp_path_factory.mktemp("levels")
    return first_optimum(folder), folder / "first.sql"


def ready(problem):
    problem.setup(mode="rev")
    problem.run_model()
    return problem


@pytest.mark.slow
def test_the_next_level_starts_at_the_optimum_and_keeps_its_shape_within_its_bounds(at_optimum):
    problem, cases = at_optimum
    level = first_level()
    finer = level.refined(problem, level.net.halves(), cases)
    started = ready(pose(finer))
    np.testing.assert_allclose(
        started.get_val("surface_control_points"), problem.get_val("surface_control_points"), rtol=0.0, atol=1e-15
    )
    assert abs(started.get_val("f") - problem.get_val("f")) < 1e-14
    assert (finer.lower <= finer.start).all()
    assert (finer.start <= finer.upper).all()
    assert np.isclose(problem.get_val("heights"), 0.04, atol=1e-9).any()  # a bound that holds


def test_totals_of_a_refined_level_are_exact(at_optimum):
    problem, cases = at_optimum
    level = first_level()
    started = ready(pose(level.refined(problem, [(0, 1), (1, 1)], cases)))
    started.set_val("combinations", 0.3 * np.random.default_rng(1).normal(size=started.get_val("combinations").size))
    started.run_model()
    found = check_totals(started, n_directions=2, step=0.1)
    assert found.transposed < 1e-12
    assert found.differences < 1e-9


def test_the_unused_gradient_names_the_knot_that_the_target_needs(at_optimum):
    problem, _ = at_optimum
    net = first_level().net
    gradient = unused_gradient(problem, net)
    assert net.part_used(gradient) < 0.5
    assert net.where_to_refine(gradient, 1) == [(0, 1)]


def test_the_unused_gradient_is_that_of_the_lagrangian(at_optimum):
    """On the net it is what bounds hold, and nothing else; multipliers are those of the limit."""
    problem, _ = at_optimum
    level = first_level()
    gradient = level.net.weights.T @ unused_gradient(problem, level.net)
    free = (problem.get_val("heights") > level.lower + 1e-6) & (problem.get_val("heights") < level.upper - 1e-6)
    assert np.count_nonzero(~free) > 0
    assert np.abs(gradient[~free]).min() > 1e-3
    assert np.abs(gradient[free]).max() < 1e-4 * np.abs(gradient).max()


def test_curvature_that_the_driver_has_met_is_carried_on(at_optimum):
    """In the next level the second derivatives along the shapes of the one before are one, where steps went."""
    problem, cases = at_optimum
    level = first_level()
    finer = level.refined(problem, [(0, 1)], cases)
    _, stiffness = target()
    net, scale = finer.net, 0.02
    jacobian = (
        Parametrization(net.mesh, [net])
        .partials(net.mesh.points[net.mesh.surface_ids], {"heights": finer.start})
        .values["heights"]
    )
    curvature = finer.columns.T @ (jacobian.T @ (2.0 / scale * stiffness[:, None] * jacobian.toarray())) @ finer.columns
    without = level.refined(problem, [(0, 1)])
    plain = without.columns.T @ (jacobian.T @ (2.0 / scale * stiffness[:, None] * jacobian.toarray())) @ without.columns
    spread = [np.linalg.cond(matrix) for matrix in (curvature, plain)]
    assert (
        np.abs(np.log(np.linalg.eigvalsh(curvature))).mean() < 0.7 * np.abs(np.log(np.linalg.eigvalsh(plain))).mean()
    ), spread


def test_the_last_level_reaches_the_target_within_its_limits(at_optimum, tmp_path):
    problem, cases = at_optimum
    level = first_level()
    finer = level.refined(problem, level.net.where_to_refine(unused_gradient(problem, level.net), 1), cases)
    run = solved(finer, 1e-10, tmp_path, "second")
    assert run.problem.get_val("f") < 0.5 * problem.get_val("f")
    assert run.problem.get_val("total") < LIMIT * (1.0 + 1e-6)


def test_a_case_file_of_another_problem_is_refused(at_optimum):
    problem, cases = at_optimum
    level = first_level()
    finer = level.refined(problem, [(0, 1)], cases)
    with pytest.raises(InputError, match="is of other variables; give the case file of the level before"):
        finer.refined(ready(pose(finer)), [(0, 2)], cases)


def test_a_level_that_ended_where_it_started_has_no_curvature_to_carry_on(tmp_path):
    level, cases = first_level(), tmp_path / "first.sql"
    problem = solved(level, 1e9, tmp_path, "first").problem
    assert problem.driver.result.deriv_evals == 1
    after_one, without = level.refined(problem, [(0, 1)], cases), level.refined(problem, [(0, 1)])
    np.testing.assert_array_equal(after_one.columns, without.columns)


def test_a_case_file_without_derivatives_is_refused(tmp_path):
    level, cases = first_level(), tmp_path / "first.sql"
    problem = pose(level)
    problem.driver = nlopt(1e-10, 2)
    problem.driver.add_recorder(om.SqliteRecorder(cases, record_viewer_data=False))
    problem.setup(mode="rev")
    problem.run_driver()
    problem.cleanup()
    with pytest.raises(InputError, match="holds no gradients; set driver"):
        level.refined(problem, [(0, 1)], cases)
