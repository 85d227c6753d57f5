"""Surface nodes give back the control points that they come from."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bspline_mdao import InputError, fit_grid, moving_mesh, onera_m6_grid
from bspline_mdao.fit.surface_fit import SurfaceLeastSquares
from bspline_mdao.mesh.surface import SurfaceGrid
from bspline_mdao.mesh.surface_map import SurfaceMap


@pytest.fixture(scope="module", params=[True, False], ids=["residual turns", "linear"])
def wing(request):
    """Map of a wing's surface, and the mesh."""
    model = fit_grid(onera_m6_grid((11, 10, 9)), wall_layer=request.param)
    mesh = moving_mesh(model)
    return SurfaceMap.of(model, mesh, SurfaceGrid.of(model)), mesh


def numbers_in_disorder(surface_map):
    """All nodes, some of them twice."""
    rng, n = np.random.default_rng(2), surface_map.matrix.shape[0]
    return rng.permutation(np.concatenate([np.arange(n), rng.integers(0, n, n // 3)]))


def moved_points(mesh, size=0.05):
    """Surface control points that are turned and deformed, those on planes of symmetry in them."""
    points, rng = mesh.points[mesh.surface_ids], np.random.default_rng(0)
    (axis,) = {int(np.argmax(np.abs(normal))) for normal in mesh.in_plane_normals}
    turn = Rotation.from_rotvec(0.4 * np.eye(3)[axis]).as_matrix()
    change = size * np.sin(points @ rng.normal(size=(3, 3)) + rng.normal(size=3))
    change[mesh.in_plane_rows, axis] = 0.0
    return points @ turn.T + change


@pytest.mark.slow
@pytest.mark.parametrize("numbers", [lambda surface_map: None, numbers_in_disorder], ids=["in order", "in disorder"])
def test_nodes_of_a_spline_surface_give_its_control_points_to_round_off(wing, numbers):
    surface_map, mesh = wing
    numbers = numbers(surface_map)
    control_points = moved_points(mesh)
    nodes = surface_map.apply(control_points)
    found = SurfaceLeastSquares.of(surface_map, mesh, numbers).at(nodes if numbers is None else nodes[numbers])
    np.testing.assert_allclose(found.control_points, control_points, atol=1e-13)


@pytest.mark.slow
def test_residual_of_other_nodes_is_orthogonal_to_all_that_control_points_can_do(wing):
    surface_map, mesh = wing
    nodes = surface_map.apply(moved_points(mesh))
    free = replace(mesh, in_plane_rows=mesh.in_plane_rows[:0], in_plane_normals=mesh.in_plane_normals[:0])
    nodes += 0.01 * np.random.default_rng(3).normal(size=nodes.shape)
    residual = nodes - SurfaceLeastSquares.of(surface_map, free).at(nodes).nodes
    assert np.linalg.norm(residual) > 0.1
    np.testing.assert_allclose(surface_map.matrix.T @ residual, 0.0, atol=1e-12)


@pytest.mark.slow
def test_control_points_stay_in_planes_of_symmetry_whatever_the_nodes_above_them_do(wing):
    surface_map, mesh = wing
    nodes = surface_map.apply(moved_points(mesh))
    nodes += 0.02 * np.random.default_rng(5).normal(size=nodes.shape)
    found = SurfaceLeastSquares.of(surface_map, mesh).at(nodes).control_points
    off = (found - mesh.points[mesh.surface_ids])[mesh.in_plane_rows]
    assert len(off)
    assert np.abs(np.sum(off * mesh.in_plane_normals, axis=1)).max() < 1e-15


@pytest.mark.slow
@pytest.mark.parametrize("is_spline", [True, False])
def test_products_with_the_derivative_are_exact_and_transposed(wing, is_spline):
    surface_map, mesh = wing
    inverse, rng = SurfaceLeastSquares.of(surface_map, mesh, numbers_in_disorder(surface_map)), np.random.default_rng(4)
    nodes = surface_map.apply(moved_points(mesh))[inverse.numbers]
    nodes += 0.0 if is_spline else 0.003 * rng.normal(size=nodes.shape)
    fitted, change = inverse.at(nodes), rng.normal(size=nodes.shape)
    forward = fitted.jvp(change)

    def difference(h):
        return (inverse.at(nodes + h * change).control_points - inverse.at(nodes - h * change).control_points) / (2 * h)

    slope = (4.0 * difference(1e-4) - difference(2e-4)) / 3.0
    np.testing.assert_allclose(slope, forward, atol=1e-9 * np.abs(forward).max())
    bar = rng.normal(size=forward.shape)
    assert np.vdot(bar, forward) == pytest.approx(np.vdot(fitted.vjp(bar), change), rel=1e-12)


@pytest.mark.slow
def test_nodes_that_do_not_determine_the_control_points_are_refused(wing):
    surface_map, mesh = wing
    n = surface_map.matrix.shape[0]
    with pytest.raises(InputError, match=f"its {n // 2} nodes do not determine") as error:
        SurfaceLeastSquares.of(surface_map, mesh, np.arange(n // 2))
    assert "\n" not in str(error.value)
