"""Functions of JAX have the values and the derivatives of our own, under all of its transformations."""

import doctest

import numpy as np
import pytest
from bridge_cases import ASKED, case, largest_difference, random_like, wing

import bspline_mdao.jax as ours
from bspline_mdao.errors import InputError

jax = pytest.importorskip("jax", reason="JAX is not installed")

from jax.test_util import check_grads  # noqa: E402

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _double():
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


def given(of, arrays):
    """Arguments of a function, of arrays by name."""
    arrays = {name: jax.numpy.asarray(array) for name, array in arrays.items()}
    return arrays if of.batches.takes_names else next(iter(arrays.values()))


def found(shapes, returned):
    """Arrays of what a function returns, or of what belongs to its arguments: JAX sorts the names of a dict."""
    return [returned[name] for name in shapes] if isinstance(returned, dict) else [returned]


@pytest.mark.parametrize("name", ASKED)
def test_values_and_both_products_are_ours(name):
    of = case(name)
    function, points = of.make(ours), list(of.points.values())
    x = given(of, of.points)
    assert largest_difference(found(of.batches.outputs, function(x)), of.batches.values((), points)) == 0.0
    step = random_like(of.batches.inputs, 1)
    change = jax.jit(lambda x, d: jax.jvp(function, (x,), (d,))[1])(x, given(of, step))
    expected = of.batches.products((), points, list(step.values()), False)
    assert largest_difference(found(of.batches.outputs, change), expected) < 1e-12
    bar = random_like(of.batches.outputs, 2)
    seed = bar if of.batches.gives_names else next(iter(bar.values()))
    (back,) = jax.jit(lambda x, b: jax.vjp(function, x)[1](b))(x, seed)
    expected = of.batches.products((), points, list(bar.values()), True)
    assert largest_difference(found(of.batches.inputs, back), expected) < 1e-12


def objective(weights):
    model = wing().model
    case_of = case("variables")
    grid, quality = case_of.make(ours), ours.quality(model)

    def function(values):
        nodes = grid(values)
        return (weights * nodes).sum() ** 2 + quality(nodes)["corner_ks"]

    return function, given(case_of, case_of.points)


def test_jit_grad_jacobians_and_vmap_agree():
    weights = random_like({"x": (wing().model.n_nodes, 3)}, 5)["x"] / wing().model.n_nodes
    function, x = objective(weights)
    plain = jax.grad(function)(x)
    for made in (jax.jit(jax.grad(function)), jax.jacfwd(function), jax.jit(jax.jacrev(function))):
        gradient = made(x)
        assert largest_difference([gradient[name] for name in plain], plain.values()) < 1e-12
    many = {name: jax.numpy.stack([value, 1.1 * value, 0.8 * value]) for name, value in x.items()}
    together = jax.jit(jax.vmap(jax.value_and_grad(function)))(many)
    for n in range(3):
        value, gradient = jax.value_and_grad(function)({name: value[n] for name, value in many.items()})
        assert abs(together[0][n] - value) < 1e-12 * abs(value)
        assert largest_difference([together[1][name][n] for name in gradient], gradient.values()) < 1e-12


def test_batches_of_directions_at_batches_of_points_are_those_one_by_one():
    of = case("variables")
    grid = ours.grid(wing().model, of.batches.chain.steps[0].parametrization, memory=2)
    x = {name: jax.numpy.stack([value, 0.9 * value]) for name, value in of.points.items()}
    rows = wing().surface.rows[3:5]
    jacobian = jax.vmap(jax.jacrev(lambda values: grid(values)[rows]))(x)
    ahead = jax.vmap(jax.jacfwd(lambda values: grid(values)[rows]))(x)
    assert jacobian["twist"].shape == (2, 2, 3, 3)
    assert largest_difference([jacobian[name] for name in ahead], ahead.values()) < 1e-11


def test_differences_agree():
    function, x = objective(np.ones((wing().model.n_nodes, 3)) / wing().model.n_nodes)
    check_grads(function, (x,), order=1, modes=("fwd", "rev"), eps=1e-4)


def test_second_derivatives_are_refused():
    function, x = objective(np.ones((wing().model.n_nodes, 3)))
    with pytest.raises(NotImplementedError, match="no second derivatives"):
        jax.hessian(function)(x)


def test_single_precision_is_rounded_at_the_border_alone():
    jax.config.update("jax_enable_x64", False)
    model = wing().model
    nodes = ours.grid(model)(model.control_points)
    assert nodes.dtype == np.float32
    rounded = model.control_points.astype(np.float32).astype(float)
    np.testing.assert_array_equal(nodes, model.node_map.at(rounded).nodes.astype(np.float32))


def test_a_design_that_cannot_be_moved_says_so():
    of = case("variables")
    with pytest.raises(Exception, match="'twist' is not finite"):
        of.make(ours)({name: np.full_like(value, np.nan) for name, value in of.points.items()})


@pytest.mark.parametrize("name", ours.__all__)
def test_the_example_of_the_reference_runs(name):
    text = getattr(ours, name).__doc__.replace("  # doctest: +SKIP", "")
    test = doctest.DocTestParser().get_doctest(text, {}, name, None, 0)
    assert doctest.DocTestRunner().run(test).failed == 0


@pytest.mark.parametrize(("dtype", "within"), [(np.float64, 1e-14), (np.float32, 1e-6)])
def test_the_evaluation_by_jax_alone_is_that_of_the_grid(dtype, within):
    model = wing(wall_layer=False).model
    evaluate, state = ours.device_grid(model), model.node_map.at(model.control_points)
    x = jax.numpy.asarray(model.control_points, dtype)
    step = random_like({"x": model.control_points.shape}, 1)["x"].astype(dtype)
    bar = random_like({"x": state.nodes.shape}, 2)["x"].astype(dtype)
    nodes = jax.jit(evaluate)(x)
    assert nodes.dtype == dtype
    assert np.abs(nodes - state.nodes).max() < within * np.ptp(state.nodes)
    np.testing.assert_allclose(evaluate(x), nodes, rtol=0.0, atol=within * np.ptp(state.nodes))
    assert largest_difference([jax.jvp(evaluate, (x,), (step,))[1]], [state.jvp(step.astype(float))]) < within
    back = jax.jit(lambda x, b: jax.vjp(evaluate, x)[1](b)[0])(x, bar)
    assert largest_difference([back], [state.vjp(bar.astype(float))["control_points"]]) < 10.0 * within
    many = jax.vmap(evaluate)(jax.numpy.stack([x, 2.0 * x, x + step]))
    assert largest_difference(many, [evaluate(x), evaluate(2.0 * x), evaluate(x + step)]) < 10.0 * within
    rows = jax.jacrev(lambda x: evaluate(x)[7:9])(x)
    assert largest_difference([rows], [jax.jacfwd(lambda x: evaluate(x)[7:9])(x)]) < 10.0 * within


def test_the_evaluation_by_jax_alone_has_second_derivatives():
    model = wing(wall_layer=False).model
    evaluate, x = ours.device_grid(model), jax.numpy.asarray(model.control_points)
    hessian_times = jax.jvp(jax.grad(lambda x: (evaluate(x) ** 2).sum()), (x,), (x,))[1]
    matrix = model.node_map.evaluator.matrix()
    np.testing.assert_allclose(hessian_times, 2.0 * (matrix.T @ (matrix @ model.control_points)), rtol=1e-11, atol=1e-9)


def test_maps_that_are_not_linear_are_refused():
    with pytest.raises(InputError, match="fit with wall_layer=False"):
        ours.device_grid(wing().model)
    evaluate = ours.device_grid(wing(wall_layer=False).model)
    with pytest.raises(InputError, match="give shape"):
        evaluate(np.zeros((2, 3)))
