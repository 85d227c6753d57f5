"""Chains for JAX and PyTorch give what the components give, with neither of the two installed."""

import subprocess
import sys

import numpy as np
import openmdao.api as om
import pytest
from bridge_cases import ASKED, case, largest_difference, measured, random_like, shape, wing

from bspline_mdao.base.sparse.cholesky import CholeskyFactor
from bspline_mdao.core.bridges.chain import Chain
from bspline_mdao.core.bridges.functions import grid_function, measures_function
from bspline_mdao.errors import InputError, MovementError
from bspline_mdao.testing import dot_test

pytestmark = pytest.mark.slow


def flat(arrays):
    return np.concatenate([np.ravel(array) for array in arrays])


def split(vector, shapes):
    cuts = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])[:-1]
    return [part.reshape(shape) for part, shape in zip(np.split(vector, cuts), shapes.values())]


def sizes(shapes):
    return sum(int(np.prod(shape)) for shape in shapes.values())


@pytest.mark.parametrize("name", ASKED)
def test_products_are_transposes_of_each_other(name):
    batches, points = case(name).batches, list(case(name).points.values())

    def product(is_transposed):
        shapes = batches.outputs if is_transposed else batches.inputs
        return lambda v: flat(batches.products((), points, split(v, shapes), is_transposed))

    assert dot_test(product(False), product(True), sizes(batches.inputs), sizes(batches.outputs)) < 1e-13


@pytest.mark.parametrize("name", ["control_points", "variables", "asked", "measures_of_variables"])
def test_products_are_the_rate_of_change(name):
    of = case(name)
    batches, points = of.batches, list(of.points.values())
    steps = [1e-3 * step for step in random_like(batches.inputs, 3).values()]

    def remainder(h):
        moved = [point + h * step for point, step in zip(points, steps)]
        (change,) = [flat(batches.values((), moved)) - flat(batches.values((), points))]
        return np.linalg.norm(change - h * flat(batches.products((), points, steps, False)))

    assert np.log2(remainder(1.0) / remainder(0.5)) == pytest.approx(2.0, abs=0.2)


def test_the_grid_of_variables_and_its_gradient_are_those_of_the_group():
    of, values = case("variables"), case("variables").points
    group = wing().grid_movement(list(shape().variables), quality=False, require_valid=False, fit=False)
    problem = om.Problem(group, reports=None)
    problem.setup(mode="fwd")
    for name, value in values.items():
        problem.set_val(name, value, units=None)
    problem.run_model()
    (nodes,) = of.batches.values((), list(values.values()))
    np.testing.assert_array_equal(nodes.ravel(), problem.get_val("grid"))
    bar = random_like(of.batches.outputs, 4)["grid"]
    ours = of.batches.products((), list(values.values()), [bar], True)
    totals = problem.compute_totals(["grid"], list(values))
    assert largest_difference(ours, [bar.ravel() @ totals["grid", name] for name in values]) < 1e-12


def test_batches_give_what_their_members_give_and_directions_go_together():
    of = case("variables")
    points, shapes = list(of.points.values()), of.batches.inputs
    many = [np.stack([point, 1.1 * point, 0.9 * point]) for point in points]
    (together,) = of.batches.values((3,), many)
    for n in range(3):
        assert largest_difference([together[n]], of.batches.values((), [point[n] for point in many])) < 1e-13
    steps = [np.stack(three) for three in zip(*(random_like(shapes, seed).values() for seed in range(3)))]
    (changes,) = of.batches.products((3,), [point[None] for point in points], steps, False)
    for n in range(3):
        (alone,) = of.batches.products((), points, [step[n] for step in steps], False)
        assert largest_difference([changes[n]], [alone]) < 1e-12


@pytest.mark.parametrize("is_transposed", [False, True])
def test_control_meshes_of_a_batch_move_together_and_so_do_products_of_several_places(is_transposed, monkeypatch):
    batches, passes, solve = grid_function(wing().model, shape()), [], CholeskyFactor.solve
    monkeypatch.setattr(CholeskyFactor, "solve", lambda self, right: passes.append(right.shape) or solve(self, right))
    points = [np.stack([(1.0 + 0.1 * n) * point for n in range(18)]) for point in case("variables").points.values()]
    shapes = batches.outputs if is_transposed else batches.inputs
    vectors = [np.stack(many) for many in zip(*(random_like(shapes, seed).values() for seed in range(18)))]
    (values,) = batches.values((18,), points)
    products = batches.products((18,), points, vectors, is_transposed)
    assert {shape[2:] for shape in passes} == {(16,), (2,)}
    for n in (0, 15, 17):
        alone = [point[n] for point in points]
        assert largest_difference([values[n]], batches.values((), alone)) < 1e-13
        expected = batches.products((), alone, [vector[n] for vector in vectors], is_transposed)
        assert largest_difference([product[n] for product in products], expected) < 1e-11


def test_designs_that_are_kept_are_not_made_again(monkeypatch):
    of = wing()
    batches = grid_function(of.model, shape(), memory=2)
    made = []
    begun = Chain.begun
    monkeypatch.setattr(Chain, "begun", lambda self, batch: made.extend(batch) or begun(self, batch))
    points = list(case("variables").points.values())
    two = [np.stack([point, 0.5 * point]) for point in points]
    batches.values((2,), two)
    batches.products((2,), two, [np.ones((2, of.model.n_nodes, 3))], True)
    assert len(made) == 2


def test_bad_input_is_refused():
    of = wing()
    batches = grid_function(of.model, shape())
    with pytest.raises(InputError, match="'twist' is missing or unknown; give arrays of twist, thick"):
        batches.taken({"thick": np.ones(2)})
    with pytest.raises(InputError, match="takes values by names"):
        batches.taken(np.ones(3))
    with pytest.raises(InputError, match=r"'twist' is of shape \(2,\); give shape \(3,\)"):
        batches.require_shapes([(2,), (2,)])
    with pytest.raises(InputError, match="memory=0; give the number"):
        grid_function(of.model, memory=0)
    with pytest.raises(InputError, match="make it with fit_grid"):
        grid_function(of.mesh)
    with pytest.raises(InputError, match="leave 'mover' out"):
        grid_function(of.model, mover=object())
    with pytest.raises(InputError, match="give one"):
        grid_function(of.model, shape(), surface=of.surface)
    with pytest.raises(InputError, match="no numbers of the"):
        grid_function(of.model, surface=of.surface, numbers=[0, 0])
    with pytest.raises(InputError, match="there is none"):
        measures_function([])
    with pytest.raises(InputError, match="one name"):
        measures_function(measured()[:1] * 2)
    with pytest.raises(InputError, match="both the model and the parametrization"):
        measures_function(measured(), of.model)
    with pytest.raises(MovementError, match="'control_points' is not finite"):
        grid_function(of.model).values((), [np.full_like(of.model.control_points, np.nan)])


@pytest.mark.parametrize(("space", "name"), [("jax", "JAX"), ("torch", "PyTorch")])
def test_a_missing_library_is_named_with_the_command_that_installs_it(space, name, monkeypatch):
    import bspline_mdao

    monkeypatch.setitem(sys.modules, space, None)
    with pytest.raises(InputError, match=rf'functions of {name} need {space}: pip install "bspline_mdao\[{space}\]"'):
        getattr(bspline_mdao, space).grid(wing().model)


def test_the_package_imports_neither_library():
    code = (
        "import sys, bspline_mdao, bspline_mdao.jax, bspline_mdao.torch; bspline_mdao.jax.grid, bspline_mdao.torch.grid"
        "; import bspline_mdao.studio.cli.main; print({'jax', 'torch'} & set(sys.modules))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "set()"
