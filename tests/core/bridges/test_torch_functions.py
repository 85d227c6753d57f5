"""Functions of PyTorch have the values and the derivatives of our own, in both modes."""

import doctest

import numpy as np
import openmdao.api as om
import pytest
from bridge_cases import ASKED, case, largest_difference, random_like, shape, wing

import bspline_mdao.torch as ours
from bspline_mdao.errors import InputError, MovementError
from bspline_mdao.sampling import Designs, Sobol, sample

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

pytestmark = pytest.mark.slow


def given(of, arrays, **options):
    """Arguments of a function, of arrays by name."""
    tensors = {name: torch.tensor(array, dtype=torch.float64, **options) for name, array in arrays.items()}
    return tensors if of.batches.takes_names else next(iter(tensors.values()))


def found(returned):
    return [t.detach().numpy() for t in (returned.values() if isinstance(returned, dict) else [returned])]


@pytest.mark.parametrize("name", ASKED)
def test_values_and_both_products_are_ours(name):
    of = case(name)
    function, points = of.make(ours), list(of.points.values())
    x = given(of, of.points)
    assert largest_difference(found(function(x)), of.batches.values((), points)) == 0.0
    step = random_like(of.batches.inputs, 1)
    _, change = torch.func.jvp(function, (x,), (given(of, step),))
    expected = of.batches.products((), points, list(step.values()), False)
    assert largest_difference(found(change), expected) < 1e-12
    bar = random_like(of.batches.outputs, 2)
    wrt = given(of, of.points, requires_grad=True)
    returned = function(wrt)
    parts = list(returned.values()) if isinstance(returned, dict) else [returned]
    torch.autograd.backward(parts, [torch.tensor(b, dtype=torch.float64) for b in bar.values()])
    back = [t.grad.numpy() for t in (wrt.values() if isinstance(wrt, dict) else [wrt])]
    expected = of.batches.products((), points, list(bar.values()), True)
    assert largest_difference(back, expected) < 1e-12


def test_both_modes_pass_the_check_of_gradients():
    of = case("variables")
    grid, quality = of.make(ours), ours.quality(wing().model, ["corner_ks", "quality_pnorm"])
    rows = torch.as_tensor(wing().surface.rows[::50])

    def function(twist, thick):
        nodes = grid({"twist": twist, "thick": thick})
        return nodes[rows], *quality(nodes).values()

    x = given(of, of.points, requires_grad=True)
    assert torch.autograd.gradcheck(function, tuple(x.values()), eps=1e-4, atol=1e-6, check_forward_ad=True)


def test_vmap_gives_what_members_give():
    of = case("variables")
    grid = of.make(ours)

    def function(values):
        return grid(values).square().sum()

    x = given(of, of.points)
    many = {name: torch.stack([value, 1.1 * value, 0.8 * value]) for name, value in x.items()}
    together = torch.func.vmap(torch.func.grad(function))(many)
    for n in range(3):
        alone = torch.func.grad(function)({name: value[n] for name, value in many.items()})
        assert largest_difference([t[n].numpy() for t in together.values()], found(alone)) < 1e-12
    rows = torch.as_tensor(wing().surface.rows[3:5])
    back, ahead = (made(lambda v: grid(v)[rows])(x) for made in (torch.func.jacrev, torch.func.jacfwd))
    assert largest_difference(found(back), found(ahead)) < 1e-11


def test_second_derivatives_are_refused():
    of = case("variables")
    x = given(of, of.points, requires_grad=True)
    (gradient,) = torch.autograd.grad(of.make(ours)(x).square().sum(), x["twist"], create_graph=True)
    with pytest.raises(InputError, match="no second derivatives"):
        gradient.sum().backward()


def test_single_precision_is_rounded_at_the_border_alone():
    model = wing().model
    single = torch.tensor(model.control_points, dtype=torch.float32)
    nodes = ours.grid(model)(single)
    assert nodes.dtype == torch.float32
    np.testing.assert_array_equal(nodes.numpy(), model.node_map.at(single.double().numpy()).nodes.astype(np.float32))


def test_what_is_returned_may_be_written_to():
    of = case("control_points")
    function, x = of.make(ours), given(of, of.points)
    before = function(x).clone()
    function(x).zero_()
    assert torch.equal(function(x), before)


def test_a_design_that_cannot_be_moved_says_so():
    of = case("variables")
    with pytest.raises(MovementError, match="'twist' is not finite"):
        of.make(ours)({name: torch.full_like(value, np.nan) for name, value in given(of, of.points).items()})


def test_sampled_designs_are_read_back_by_one_line(tmp_path):
    problem = om.Problem(wing().grid_movement([shape().variables[0]], quality=False, fit=False), reports=None)
    problem.model.add_design_var("twist", lower=-3.0, upper=3.0, units="deg")
    problem.setup()
    designs = sample(problem, wing().model, Sobol(5), tmp_path / "designs.h5", single=True)
    loader = torch.utils.data.DataLoader(Designs(tmp_path / "designs.h5"), batch_size=2)
    values, nodes = zip(*loader)
    assert [len(part) for part in nodes] == [2, 2, 1]
    assert nodes[0].dtype == torch.float32
    np.testing.assert_array_equal(torch.cat(values).numpy(), designs.values)
    np.testing.assert_array_equal(nodes[1][0].numpy(), designs[2][1])


@pytest.mark.parametrize("name", ours.__all__)
def test_the_example_of_the_reference_runs(name):
    text = getattr(ours, name).__doc__.replace("  # doctest: +SKIP", "")
    test = doctest.DocTestParser().get_doctest(text, {}, name, None, 0)
    assert doctest.DocTestRunner().run(test).failed == 0
