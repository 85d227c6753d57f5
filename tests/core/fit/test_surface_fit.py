"""Surface control points follow surface nodes: rigid motions exactly, and kinks without swinging."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bspline_mdao import InputError, fit_grid
from bspline_mdao.core.fit.surface_fit import SurfaceFollower
from bspline_mdao.core.mesh.surface import SurfaceGrid
from bspline_mdao.generators import Spacing, onera_m6_grid
from bspline_mdao.grids.topology.sharing import node_sharing
from bspline_mdao.movers import moving_mesh
from bspline_mdao.splines import fit_surface
from bspline_mdao.testing import central_difference


@pytest.fixture(scope="module", params=["least squares", "candidates"])
def wing(request):
    """A wing, of which least squares are valid or not, and its mesh and surface."""
    method = "least_squares" if request.param == "least squares" else "valid"
    model = fit_grid(onera_m6_grid((11, 10, 9), Spacing(off_wall=1e-5)), n_control=6, method=method)
    assert (model.candidate_weights is None) == (request.param == "least squares")
    return model, moving_mesh(model), SurfaceGrid.of(model)


def numbers_in_disorder(surface):
    """All nodes, some of them twice."""
    rng, n = np.random.default_rng(2), surface.n_points
    return rng.permutation(np.concatenate([np.arange(n), rng.integers(0, n, n // 3)]))


def some_numbers(surface):
    """Nine of ten nodes."""
    return np.random.default_rng(8).permutation(surface.n_points)[surface.n_points // 10 :]


NUMBERS = {"all": lambda surface: None, "in disorder": numbers_in_disorder, "some": some_numbers}


@pytest.mark.slow
def test_nodes_at_rest_keep_the_control_points(wing):
    model, mesh, surface = wing
    found = SurfaceFollower.of(model, mesh, surface).at(surface.points).control_points
    np.testing.assert_allclose(found, mesh.points[mesh.surface_ids], rtol=0, atol=1e-16)


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [30, 180, 290])
def test_a_surface_that_turns_takes_its_control_points_along(wing, degrees):
    model, mesh, surface = wing
    (normal,) = mesh.plane_normals
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * normal).as_matrix()
    shift = np.cross(normal, [3.0, -2.0, 1.0])
    found = SurfaceFollower.of(model, mesh, surface).at(surface.points @ turn.T + shift).control_points
    expected = mesh.points[mesh.surface_ids] @ turn.T + shift
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


@pytest.mark.slow
def test_control_points_swing_less_than_half_as_far_as_least_squares_beside_a_step(wing):
    model, mesh, surface = wing
    model = fit_grid(model.regenerate(), n_control=6, method="least_squares")
    rise = np.where(surface.points[:, 0] > np.median(surface.points[:, 0]), 0.1, 0.0)
    moved = surface.points + np.outer(rise, [0.0, 1.0, 0.0])
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    nodes[surface.rows] = moved
    nodes = nodes[node_sharing(model.topology).source_rows()]
    found = SurfaceFollower.of(model, mesh, surface).at(moved).control_points
    fitted = fit_surface(model, mesh.surface_ids, nodes).control_points
    swings = [np.linalg.norm(s - mesh.points[mesh.surface_ids], axis=1).max() for s in (found, fitted)]
    assert swings[0] < 0.5 * swings[1]
    assert swings[0] < 0.16  # the step is 0.1 high


@pytest.mark.slow
@pytest.mark.parametrize("numbers", NUMBERS.values(), ids=NUMBERS)
def test_products_with_the_derivative_are_exact_and_transposed(wing, numbers):
    model, mesh, surface = wing
    follower, rng = SurfaceFollower.of(model, mesh, surface, numbers(surface)), np.random.default_rng(4)
    nodes = follower.baseline + 0.1 * np.sin(follower.baseline @ rng.normal(size=(3, 3)))
    change = rng.normal(size=nodes.shape)
    followed = follower.at(nodes)
    forward = followed.jvp(change)
    slope = central_difference(lambda t: follower.at(nodes + t * change).control_points, 1e-3)
    np.testing.assert_allclose(slope, forward, rtol=0, atol=1e-9 * np.abs(forward).max())
    bar = rng.normal(size=forward.shape)
    terms = bar * forward
    assert abs(terms.sum() - np.vdot(followed.vjp(bar), change)) < 1e-13 * np.abs(terms).sum()


@pytest.mark.slow
def test_of_nodes_that_are_given_twice_the_mean_counts(wing):
    model, mesh, surface = wing
    rng, numbers = np.random.default_rng(5), numbers_in_disorder(surface)
    moves, noise = 0.1 * rng.normal(size=(surface.n_points, 3)), 0.1 * rng.normal(size=(surface.n_points, 3))
    whole = SurfaceFollower.of(model, mesh, surface)
    counts, seen = np.bincount(numbers), np.zeros(surface.n_points, dtype=int)
    given = np.empty((len(numbers), 3))
    for place, number in enumerate(numbers):  # what one has too much, the other has too little
        sign = 0.0 if counts[number] % 2 or seen[number] >= 2 * (counts[number] // 2) else (-1.0) ** seen[number]
        given[place] = moves[number] + sign * noise[number]
        seen[number] += 1
    parted = SurfaceFollower.of(model, mesh, surface, numbers)
    expected, found = (follower._forward(m) for follower, m in ((whole, moves), (parted, given)))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


@pytest.mark.slow
def test_nodes_that_are_not_given_go_between_their_neighbours(wing):
    model, mesh, surface = wing
    shift, numbers = np.array([0.3, -0.2, 0.0]), some_numbers(surface)
    found = SurfaceFollower.of(model, mesh, surface, numbers).at(surface.points[numbers] + shift).control_points
    np.testing.assert_allclose(found, mesh.points[mesh.surface_ids] + shift, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_control_points_stay_in_planes_of_symmetry_whatever_the_nodes_above_them_do(wing):
    model, mesh, surface = wing
    nodes = surface.points + 0.02 * np.random.default_rng(6).normal(size=surface.points.shape)
    found = SurfaceFollower.of(model, mesh, surface).at(nodes).control_points
    off = (found - mesh.points[mesh.surface_ids])[mesh.in_plane_rows]
    assert len(off)
    assert np.abs(np.sum(off * mesh.in_plane_normals, axis=1)).max() < 1e-15


@pytest.mark.slow
def test_fewer_nodes_than_control_points_are_refused(wing):
    model, mesh, surface = wing
    n = len(mesh.surface_ids) - 1
    with pytest.raises(InputError, match=f"its {n} nodes do not determine the {n + 1} control points"):
        SurfaceFollower.of(model, mesh, surface, np.arange(n))


@pytest.mark.slow
def test_a_patch_without_any_node_is_refused(wing):
    model, mesh, surface = wing
    with pytest.raises(InputError, match=r"none of the nodes of .* is given; give nodes of all its patches") as error:
        SurfaceFollower.of(model, mesh, surface, np.setdiff1d(np.arange(surface.n_points), surface.faces[0]))
    assert "\n" not in str(error.value)
