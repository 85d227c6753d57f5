"""Variables in which control points move together."""

import numpy as np
import pytest

from bspline_mdao import fit_grid
from bspline_mdao.core.adaptation.stiffness import StiffValues
from bspline_mdao.core.design.interior_points import InteriorPoints
from bspline_mdao.generators import onera_m6_grid


@pytest.fixture(scope="module")
def model():
    return fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 5))


@pytest.fixture(scope="module")
def shift(model):
    return InteriorPoints("inner", reach=0.3).bind(model)


@pytest.fixture(scope="module")
def stiff(model, shift):
    return StiffValues.of(model, shift)


def strains(model, shift, values):
    """Differences of displacements along all edges of the control mesh by their lengths, block after block."""
    moves, points = shift.displacement(values), model.control_points
    for ids in model.mesh.control_ids:
        for d in range(3):
            lengths = np.linalg.norm(np.diff(points[ids], axis=d), axis=-1)
            changes = np.linalg.norm(np.diff(moves[ids], axis=d), axis=-1)
            yield (changes[lengths > 1e-9] / lengths[lengths > 1e-9]).ravel()


@pytest.mark.slow
def test_the_square_of_a_step_is_that_of_the_strains_and_values_that_it_makes(model, shift, stiff):
    steps = 1e-3 * np.random.default_rng(0).standard_normal(shift.n_values)
    values = shift.reach * np.arctanh(stiff.values(steps) / shift.reach)
    squares = sum(np.sum(part**2) for part in strains(model, shift, values))
    assert squares + values @ values == pytest.approx(steps @ steps, rel=1e-10)
    assert squares > values @ values


def test_values_begin_where_they_are_told_to_and_never_leave_their_bounds(shift, stiff):
    random = np.random.default_rng(1)
    start = random.uniform(-0.299, 0.299, shift.n_values)
    begun = stiff.at(start)
    np.testing.assert_allclose(begun.values(np.zeros(shift.n_values)), start, rtol=1e-13)
    far = begun.values(1e3 * random.standard_normal(shift.n_values))
    assert np.abs(far).max() <= shift.reach
    assert np.abs(begun.at(far).values(np.zeros(shift.n_values)) - far).max() < 1e-8


def test_steps_have_the_derivatives_of_complex_steps(shift, stiff):
    random = np.random.default_rng(2)
    begun = stiff.at(random.uniform(-0.2, 0.2, shift.n_values))
    steps, along, bar = random.standard_normal((3, shift.n_values))
    exact = begun.values(steps + 1e-30j * along).imag @ bar / 1e-30
    assert begun.vjp(begun.values(steps), bar) @ along == pytest.approx(exact, rel=1e-10)
