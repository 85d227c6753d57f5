"""Grids that are adapted to a flow: derivatives of what is lowered, and what it does to the errors."""

import numpy as np
import pytest

from bspline_mdao import InputError, fit_grid
from bspline_mdao.adaptation import adapt_grid
from bspline_mdao.core.design.interior_points import InteriorPoints
from bspline_mdao.flow.om.error_search import ErrorSearch, flow_problem
from bspline_mdao.generators import naca_section, section_o_grid

OPTIONS = {"reference_area": 1.0}


@pytest.fixture(scope="module")
def model():
    return fit_grid(section_o_grid(naca_section(0.12), 24, far=20.0), n_control=(12, 10, 2))


@pytest.fixture(scope="module")
def found(model):
    return adapt_grid(model, mach=0.5, alpha=1.25, limits={"CD": 0.0}, rounds=2, iterations=8, **OPTIONS)


@pytest.fixture(scope="module")
def search(model):
    shift = InteriorPoints("inner").bind(model)
    return ErrorSearch(model, shift, {"CL": 0.18, "CD": 0.0}, 0.5, 1.25, OPTIONS)


def test_the_drag_of_a_section_falls_with_its_estimate_at_equal_nodes(model, found):
    before, after = found.before["CD"], found.after["CD"]
    assert 0.0 < after.value < 0.65 * before.value
    assert found.ratio("CD") == pytest.approx(abs(after.value / before.value))
    assert abs(after.error) < 0.4 * before.error
    assert after.bound < before.bound
    assert found.is_better
    assert found.grid.shapes == model.regenerate().shapes


def test_the_drag_is_that_of_the_model_and_falls_at_other_angles_too(model, found):
    drags = {}
    for name, alpha in (("same", 1.25), ("other", 2.5)):
        for member in (model, found.model):
            problem = flow_problem(member, 0.5, alpha, OPTIONS)
            problem.run_model()
            drags.setdefault(name, []).append(problem.get_val("CD").item())
    np.testing.assert_allclose(drags["same"], [found.before["CD"].value, found.after["CD"].value], atol=1e-9)
    assert drags["other"][1] < drags["other"][0] / 1.5


def test_walls_and_the_far_field_keep_every_bit(model, found):
    (old,), (new,) = model.regenerate().blocks, found.grid.blocks
    for j in (0, -1):
        np.testing.assert_allclose(new.nodes[:, j], old.nodes[:, j], rtol=0.0, atol=1e-14)
    assert np.abs(new.nodes - old.nodes).max() > 1e-3
    np.testing.assert_allclose(new.nodes[..., 2], old.nodes[..., 2], atol=1e-13)


def test_the_loss_of_the_contributions_has_the_derivatives_of_complex_steps(search):
    random, loss = np.random.default_rng(0), search.estimate_loss
    values = random.uniform(-0.05, 0.05, search.shift.n_values)
    nodes, states = search.solve(values)
    d_states, d_nodes = (random.standard_normal(array.shape) for array in (states, nodes))
    step = 1e-30
    exact = loss.value(states + 1j * step * d_states, nodes + 1j * step * d_nodes).imag / step
    value, states_bar, nodes_bar = loss.gradient(states, nodes)
    assert value == pytest.approx(loss.value(states, nodes), rel=1e-13)
    assert np.sum(states_bar * d_states) + np.sum(nodes_bar * d_nodes) == pytest.approx(exact, rel=1e-10)


def test_the_gradient_is_that_of_the_flow_as_well(search):
    random = np.random.default_rng(1)
    values, direction = (random.uniform(-0.03, 0.03, search.shift.n_values) for _ in range(2))
    gradient, step = search.loss(values)[1], 1e-3
    high, low = (search.loss(values + sign * step * direction)[0] for sign in (1.0, -1.0))
    assert gradient @ direction == pytest.approx((high - low) / (2.0 * step), rel=1e-3)


def test_what_cannot_be_adapted_to_is_refused(model):
    flow = {"mach": 0.5, "alpha": 1.25}
    for change, message in (
        ({"of": "CM"}, "adapt to CM; give any of CL, CD, CD_induced, CD_entropy"),
        ({"limits": {"CL": 0.2}}, "limits has no number for CD"),
        ({"rounds": 0}, "rounds is 0; give 1 or more"),
        ({"reference_area": None}, "there is no reference_area"),
        ({"trim": True}, "the angle of attack is kept"),
    ):
        with pytest.raises(InputError, match=message):
            adapt_grid(model, **{**OPTIONS, **flow, **change})
