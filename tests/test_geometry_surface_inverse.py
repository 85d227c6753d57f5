"""Surface nodes give back the control points that they come from."""

import numpy as np
import pytest

from bspline_mdao import InputError, fit_grid, moving_mesh, onera_m6_grid
from bspline_mdao.geometry.surface import SurfaceGrid
from bspline_mdao.geometry.surface_inverse import SurfaceInverse
from bspline_mdao.geometry.surface_map import SurfaceMap


@pytest.fixture(scope="module")
def surface_map():
    model = fit_grid(onera_m6_grid((11, 10, 9)), wall_layer=False)
    return SurfaceMap.of(model, moving_mesh(model), SurfaceGrid.of(model))


def numbers_in_disorder(surface_map):
    """All nodes, some of them twice."""
    rng, n = np.random.default_rng(2), surface_map.matrix.shape[0]
    return rng.permutation(np.concatenate([np.arange(n), rng.integers(0, n, n // 3)]))


@pytest.mark.parametrize("numbers", [lambda surface_map: None, numbers_in_disorder], ids=["in order", "in disorder"])
def test_nodes_of_a_spline_surface_give_its_control_points_to_round_off(surface_map, numbers):
    numbers = numbers(surface_map)
    inverse = SurfaceInverse.of(surface_map, numbers)
    control_points = np.random.default_rng(0).normal(size=(surface_map.matrix.shape[1], 3))
    nodes = surface_map.apply(control_points)
    np.testing.assert_allclose(inverse.apply(nodes if numbers is None else nodes[numbers]), control_points, atol=1e-13)


def test_residual_of_other_nodes_is_orthogonal_to_all_that_control_points_can_do(surface_map):
    inverse, rng = SurfaceInverse.of(surface_map), np.random.default_rng(3)
    nodes = rng.normal(size=surface_map.constant.shape)
    residual = nodes - surface_map.apply(inverse.apply(nodes))
    assert np.linalg.norm(residual) > 1.0
    np.testing.assert_allclose(surface_map.matrix.T @ residual, 0.0, atol=1e-12)


def test_products_with_the_derivative_are_exact_and_transposed(surface_map):
    inverse, rng = SurfaceInverse.of(surface_map, numbers_in_disorder(surface_map)), np.random.default_rng(4)
    nodes, change = rng.normal(size=(2, *inverse.constant.shape))
    forward = inverse.jvp(change)
    np.testing.assert_allclose(inverse.apply(nodes + change) - inverse.apply(nodes), forward, atol=1e-12)
    bar = rng.normal(size=forward.shape)
    assert np.vdot(bar, forward) == pytest.approx(np.vdot(inverse.vjp(bar), change), rel=1e-12)


def test_nodes_that_do_not_determine_the_control_points_are_refused(surface_map):
    n = surface_map.matrix.shape[0]
    with pytest.raises(InputError, match=f"its {n // 2} nodes do not determine") as error:
        SurfaceInverse.of(surface_map, np.arange(n // 2))
    assert "\n" not in str(error.value)
