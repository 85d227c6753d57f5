"""Surfaces of several patches, whose seams closest points cross."""

import numpy as np
import pytest
from sliding_cases import lean, passage, rows_of

from bspline_mdao import InputError, MovementError
from bspline_mdao.movers import Cylinder, PatchedSurface, Rotations, SplineSurface, closest_on, moving_mesh
from bspline_mdao.testing import central_difference

TUBE = Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0)


def tube(x, turn):
    """Rows of points of a piece of a tube about x, denser in its middle."""
    x, turn = np.meshgrid(x, turn, indexing="ij")
    return np.stack([x, np.cos(turn), np.sin(turn)], axis=-1)


def rough(points):
    """The same with bulges, so that no cylinder is left."""
    x, y = points[..., 0], points[..., 1]
    return points * (1.0 + 0.05 * np.sin(1.3 * x + 2.0 * y)[..., None] * np.array([0.0, 1.0, 1.0]))


PIECES = [
    tube(np.linspace(0.0, 1.5, 9), np.linspace(-0.3, 1.2, 21)),
    tube(np.linspace(0.0, 1.5, 12), np.linspace(1.2, 2.9, 26))[:, ::-1],  # its normal points inwards
    tube(np.linspace(1.5, 3.0, 10), np.linspace(-0.3, 2.9, 41)).swapaxes(0, 1),
]
"""Two beside each other and one behind both, whose points do not meet theirs."""


@pytest.fixture(scope="module")
def surface():
    return PatchedSurface([rough(points) for points in PIECES])


@pytest.fixture(scope="module")
def points():
    """Points above and below, within half a cell of a seam, of three patches, and far from all."""
    rng = np.random.default_rng(3)
    x, turn = rng.uniform(0.1, 2.9, 200), rng.uniform(-0.2, 2.8, 200)
    x[:60], turn[60:120] = rng.uniform(1.45, 1.55, 60), rng.uniform(1.17, 1.23, 60)
    x[:20], turn[:20] = rng.uniform(1.45, 1.55, 20), rng.uniform(1.17, 1.23, 20)
    r = rng.uniform(0.8, 1.3, 200)
    return rough(np.stack([x, r * np.cos(turn), r * np.sin(turn)], axis=-1))


def test_gradients_and_hessians_are_those_of_the_function_on_seams_as_well(surface, points):
    at, rng = surface.levels(points), np.random.default_rng(4)
    direction = rng.normal(size=points.shape)
    for exact, number in ((np.einsum("ni,ni->n", at.gradients, direction), 0), (None, 1)):
        if exact is None:
            exact = np.einsum("nij,nj->ni", at.hessians, direction)
        differences = central_difference(lambda h, k=number: surface.levels(points + h * direction)[k], 1e-4, levels=3)
        assert np.abs(exact - differences).max() < 1e-6 * np.abs(exact).max()
    np.testing.assert_allclose(at.hessians, at.hessians.swapaxes(1, 2), atol=1e-9)


def test_a_tube_of_patches_is_that_tube():
    off = []
    for n in (1, 2):
        pieces = [tube(np.linspace(0.0, 1.5, 8 * n + 1), np.linspace(a, a + 1.0, 12 * n + 1)) for a in (0.0, 1.0)]
        turn = np.linspace(0.05, 1.95, 401)
        points = np.stack([0.7 + 0.0 * turn, 1.1 * np.cos(turn), 1.1 * np.sin(turn)], axis=-1)
        off.append(np.abs(PatchedSurface(pieces).distances(points) - 0.1).max())
    assert off[0] < 1e-5
    assert off[1] < off[0] / 8.0


def test_closest_points_have_no_jump_across_seams_and_exact_derivatives(surface):
    turn = np.linspace(0.9, 1.5, 2001)
    line = np.stack([1.2 + turn - 0.9, 1.2 * np.cos(turn), 1.2 * np.sin(turn)], axis=-1)  # across both seams
    found = closest_on([surface], line)
    steps = np.diff(found.points, axis=0)
    assert np.abs(np.diff(steps, axis=0)).max() < 2e-2 * np.abs(steps).max()
    tangents = np.diff(line, axis=0)
    predicted = np.einsum("nij,nj->ni", 0.5 * (found.jacobians[1:] + found.jacobians[:-1]), tangents)
    assert np.abs(predicted - steps).max() < 1e-4 * np.abs(steps).max()
    for piece, place in ((PIECES[0], found.points[0]), (PIECES[2], found.points[-1])):
        assert SplineSurface(rough(piece)).distances(place[None])[0] < 1e-14


def test_off_the_seams_a_patch_is_the_spline_through_its_points(surface):
    alone = SplineSurface(rough(PIECES[0]))
    points = rough(tube([0.4, 0.7], [0.2, 0.5, 0.8]).reshape(-1, 3)) * 1.1
    for one, other in zip(surface.levels(points), alone.levels(points)):
        np.testing.assert_allclose(one, other, atol=1e-13)


def test_the_other_side_of_a_thin_body_does_not_count():
    angle = np.linspace(0.0, np.pi, 41)
    x, z = np.cos(angle), 0.02 * np.sin(angle)
    upper = np.stack(np.broadcast_arrays(x[:, None], np.linspace(0.0, 1.0, 5), z[:, None]), axis=-1)[4:-4]
    below = upper * [1.0, 1.0, -1.0]
    nose = np.stack(np.broadcast_arrays(x[:, None], np.linspace(0.0, 1.0, 5), z[:, None]), axis=-1)[:5]
    nose = np.concatenate([nose[::-1], (nose * [1.0, 1.0, -1.0])[1:]])
    body = PatchedSurface([upper, nose, below])
    np.testing.assert_allclose(body.distances(np.array([[0.1, 0.5, 0.05]])), 0.03, atol=2e-4)


def test_nodes_slide_across_a_seam_of_a_casing():
    model = passage()
    casing = model.regenerate().blocks[0].nodes[:, :, -1]
    wall = PatchedSurface([casing[:, :5], casing[:, 4:]])
    mesh = moving_mesh(model, "blade", sliding={"casing": wall})
    points = Rotations(mesh).move(model.control_points, lean(mesh, 0.1)).points
    grid_map, rng = model.map_sliding(mesh.slides, model), np.random.default_rng(5)
    state, rows = grid_map.at(points), rows_of(model, "casing")
    assert np.abs(wall.levels(state.nodes[rows]).values - wall.levels(grid_map.nodes[rows]).values).max() < 1e-13
    np.testing.assert_array_equal(grid_map.at(model.control_points).nodes, grid_map.nodes)
    direction = rng.normal(size=points.shape)
    exact = state.jvp(direction)
    differences = central_difference(lambda h: grid_map.at(points + h * direction).nodes, 1e-4, levels=3)
    np.testing.assert_allclose(exact, differences, atol=1e-6 * np.abs(exact).max())


def test_patches_that_do_not_fit_together_are_refused(surface):
    with pytest.raises(InputError, match="patch 2 meets none of the others at an edge"):
        PatchedSurface([PIECES[0], PIECES[1] + [0.0, 0.5, 0.0]])
    side = np.stack(np.meshgrid(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 5), [0.0], indexing="ij"), axis=-1)[
        :, :, 0
    ]
    with pytest.raises(InputError, match=r"patches 1 and 2 meet with a kink at \["):
        PatchedSurface([side, side[..., [2, 1, 0]]])
    with pytest.raises(InputError, match="no patch; give rows of points"):
        PatchedSurface([])
    with pytest.raises(MovementError, match=r"no point of it is near \[9.0, 1.0, 0.0\]"):
        surface.levels(np.array([[9.0, 1.0, 0.0]]))
