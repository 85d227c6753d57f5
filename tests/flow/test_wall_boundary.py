"""The condition at walls: nothing but the pressure goes through, and all derivatives are those of that."""

import numpy as np
import pytest

from bspline_mdao.flow.euler.flux import face_flux
from bspline_mdao.flow.euler.reconstruction import FARFIELD, INNER, SLIP
from bspline_mdao.flow.euler.wall_boundary import flux_through, flux_through_jvp, flux_through_vjp, state_jacobian

ROLES = pytest.mark.parametrize("role", [INNER, FARFIELD, SLIP], ids=["inner", "far field", "wall"])


def at_face(seed=0):
    """Mean state, jump, area vector and sensor at a face, and a direction in them."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(0.5, 1.5, 5), 0.1 * rng.standard_normal(5), rng.standard_normal(3), np.array([0.3])
    return at, [rng.standard_normal(part.shape) for part in at]


def as_arguments(parts):
    """As the kernels take them."""
    *vectors, sensor = parts
    return *(tuple(vector.tolist()) for vector in vectors), sensor.item()


def test_nothing_flows_through_a_wall_and_all_else_is_the_flux_of_the_scheme():
    (mean, jump, s, sensor), _ = at_face()
    at = as_arguments((mean, jump, s, sensor))
    np.testing.assert_array_equal(flux_through(SLIP, *at), [0.0, *(mean[4] * s), 0.0])
    for role in (INNER, FARFIELD):
        assert flux_through(role, *at) == face_flux(*at)


@ROLES
def test_the_change_of_the_flux_is_that_of_a_complex_step(role):
    at, along = at_face(1)
    stepped = flux_through(role, *as_arguments([part + 1e-30j * d for part, d in zip(at, along)]))
    change = flux_through_jvp(role, *as_arguments(at), *as_arguments(along))
    np.testing.assert_allclose(change, np.imag(stepped) / 1e-30, rtol=1e-12, atol=1e-13)


@ROLES
def test_products_and_the_jacobian_of_states_are_transposes_of_the_change(role):
    at, along = at_face(2)
    bar = np.random.default_rng(3).standard_normal(5)
    change = flux_through_jvp(role, *as_arguments(at), *as_arguments(along))
    back = flux_through_vjp(role, *as_arguments(at), tuple(bar.tolist()))
    assert sum(np.dot(np.ravel(b), d) for b, d in zip(back, along)) == pytest.approx(bar @ change, rel=1e-12)
    jacobian = np.full((5, 10), np.nan)
    state_jacobian(role, *as_arguments(at), jacobian)
    np.testing.assert_allclose(bar @ jacobian, np.ravel(back[:2]), rtol=1e-12, atol=1e-13)
