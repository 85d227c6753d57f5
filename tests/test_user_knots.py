"""Knots that are functions of the user, from the fit to the regenerated grid; and fits of every order."""

import numpy as np
import openmdao.api as om
import pytest
from fit_cases import bend, bent_block, grid_of, lattice

from bspline_mdao import (
    Fit,
    FunctionKnots,
    GridEvaluate,
    InputError,
    family_member,
    fit_grid,
    invert_points,
    require_inside,
    ride,
)


def bent_knots(order, n_control):
    """Uniform knots, bent by a wave of the other two parameters."""
    inner = np.arange(1, n_control - order + 1) / (n_control - order + 1)
    room = 0.2 * inner * (1 - inner)

    def value(s, t):
        return inner + room * np.sin(2 * s + t)[:, None]

    def gradient(s, t):
        slope = room * np.cos(2 * s + t)[:, None]
        return np.stack([2 * slope, slope], axis=-1)

    return FunctionKnots(order, n_control, value, gradient)


@pytest.fixture(scope="module")
def model():
    knots = tuple(bent_knots(4, n) for n in (7, 8, 6))
    return fit_grid(bent_block(), knots=[knots])


def test_the_mesh_has_the_knots_that_were_given(model):
    assert model.mesh.volumes[0].n_control == (7, 8, 6)
    assert all(isinstance(knots, FunctionKnots) for knots in model.mesh.volumes[0].knots)
    assert 0.0 < model.report.relative_rms < 2e-2


def test_the_baseline_comes_back_through_the_users_knots(model):
    grid = bent_block().to_vector()
    np.testing.assert_allclose(model.regenerate().to_vector(), grid, atol=1e-14)
    problem = om.Problem()
    problem.model.add_subsystem("fit", Fit(model=model), promotes=["*"])
    problem.model.add_subsystem("evaluate", GridEvaluate(model=model), promotes=["grid"])
    problem.model.connect("control_points_initial", "evaluate.control_points")
    problem.setup()
    problem.run_model()
    np.testing.assert_allclose(problem.get_val("grid"), grid, atol=1e-13)


def test_the_users_knots_hold_for_the_whole_family(model):
    fine = family_member(model, 2.0)
    splines = model.evaluator().forward(model.control_points).reshape(*model.topology.shapes[0], 3)
    np.testing.assert_allclose(fine.blocks[0].nodes[::2, ::2, ::2], splines, atol=1e-14)


def test_points_ride_on_a_mesh_with_the_users_knots(model):
    points = bend(np.random.default_rng(5).uniform(0.2, 0.8, (20, 3)))
    inversion = require_inside(invert_points(model.mesh, model.control_points, points))
    turned = model.control_points[:, [1, 2, 0]]
    np.testing.assert_allclose(ride(model.mesh, inversion).forward(turned), points[:, [1, 2, 0]], atol=1e-12)


def test_a_grid_sampled_from_the_users_knots_is_recovered_to_round_off(model):
    # with the parameters of the model the least squares of its own points have its control points as their solution
    sampled = model.evaluator().forward(model.control_points)
    problem = om.Problem()
    problem.model.add_subsystem("fit", Fit(model=model), promotes=["*"])
    problem.setup()
    problem.set_val("grid_initial", sampled.ravel())
    problem.run_model()
    recovered = problem.get_val("control_points_initial").reshape(-1, 3)
    np.testing.assert_allclose(recovered, model.control_points, atol=1e-11)


def test_knots_of_the_wrong_number_of_segments_are_refused():
    knots = tuple(bent_knots(4, n) for n in (7, 8, 6))
    with pytest.raises(InputError, match=r"knots of 2 segments; give 1|each of the 1 segments"):
        fit_grid(bent_block(), knots=[knots, knots])


@pytest.mark.parametrize("order", range(2, 7))
def test_a_polynomial_block_is_fitted_exactly_at_every_order(order):
    xi = lattice(13, 12, 14, powers=(1, 1, 1))
    model = fit_grid(grid_of(xi @ np.array([[1.0, 0.2, 0.0], [0.1, 2.0, 0.3], [0.0, 0.4, 1.5]])), order=order)
    assert {volume.orders for volume in model.mesh.volumes} == {(order,) * 3}
    assert max(model.report.max_error) < 1e-13


def test_the_error_falls_with_the_order():
    errors = [fit_grid(bent_block((17, 17, 17)), order=p, n_control=(7, 7, 7)).report.rms for p in (2, 3, 4)]
    assert errors[0] > 2 * errors[1] > 4 * errors[2]
