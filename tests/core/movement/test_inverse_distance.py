import numpy as np
import pytest
from mover_cases import (
    assert_derivative_is_exact,
    assert_derivative_is_transposed,
    bent_surface,
    both_sides,
    channel,
    oblique_channel,
    opened,
    plate,
    wing,
)

from bspline_mdao.core.mesh.moving_mesh import MovingMesh
from bspline_mdao.core.movement.interpolation import APART, find_centres
from bspline_mdao.core.movement.inverse_distance import InverseDistance
from bspline_mdao.errors import InputError


def box_mesh(*lines):
    """Moving mesh of a box in two blocks, grid lines at given coordinates, all of its boundary the design surface."""
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
    is_inner = np.zeros(points.shape[:3], dtype=bool)
    is_inner[1:-1, 1:-1, 1:-1] = True
    ids = np.arange(is_inner.size, dtype=np.int32).reshape(is_inner.shape)
    is_free = np.repeat(is_inner.reshape(-1, 1), 3, axis=1)
    blocks = (ids[:3], ids[2:])
    return MovingMesh(blocks, ("block 1", "block 2"), points.reshape(-1, 3), ids[~is_inner], is_free)


@pytest.mark.parametrize(("exponents", "reach"), [((3, 5), 0.1), ((2, 4), 0.7), ((3, 6), 0.0)])
def test_displacements_are_the_means_with_the_weights_of_the_formula(exponents, reach):
    random = np.random.default_rng(6)
    lines = [np.cumsum(random.uniform(0.5, 2.0, n)) for n in (5, 4, 6)]
    mesh = box_mesh(*lines)
    displacement = 0.05 * random.standard_normal((len(mesh.surface_ids), 3))
    mover = InverseDistance(mesh, exponents=exponents, reach=reach)
    moved = mover.move(mesh.points, mesh.points[mesh.surface_ids] + displacement).points - mesh.points
    areas = np.zeros([len(line) for line in lines])
    widths = [0.5 * (np.diff(line, prepend=line[0]) + np.diff(line, append=line[-1])) for line in lines]
    for d in range(3):
        share = np.multiply.outer(*(widths[e] for e in range(3) if e != d))
        for end in (0, -1):
            np.moveaxis(areas, d, 0)[end] += share
    inner = np.setdiff1d(np.arange(mesh.n_points), mesh.surface_ids)
    r = np.linalg.norm(mesh.points[inner][:, None] - mesh.points[mesh.surface_ids], axis=-1) / mesh.size
    weights = areas.ravel()[mesh.surface_ids] * (r ** -exponents[0] + (r / reach if reach else np.inf) ** -exponents[1])
    expected = weights @ displacement / weights.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(moved[inner], expected, atol=1e-12)


def test_displacements_stay_between_those_of_the_surface_and_none():
    mesh = channel()
    random = np.random.default_rng(0).uniform(0.1, 0.2, len(mesh.surface_ids))
    points = InverseDistance(mesh).move(mesh.points, mesh.points[mesh.surface_ids] + random[:, None] * [0, 0, 1]).points
    moved = (points - mesh.points)[:, 2]
    assert (moved >= 0.0).all()
    assert (moved <= 0.2).all()


def test_a_longer_reach_holds_points_near_the_surface_to_it():
    mesh = wing()
    surface = mesh.points[mesh.surface_ids] + [0.0, 0.1, 0.0]
    moved = [InverseDistance(mesh, reach=reach).move(mesh.points, surface).points for reach in (0.0, 0.1, 0.2)]
    beside = np.setdiff1d(mesh.elements[np.isin(mesh.elements, mesh.surface_ids).any(axis=1)], mesh.surface_ids)
    follow = [np.mean((points - mesh.points)[beside, 1]) for points in moved]
    assert follow[0] < follow[1] < follow[2] < 0.1


def test_derivatives_of_plain_weights_with_the_far_field_released_are_exact():
    mover = InverseDistance(oblique_channel(released=("farfield",)), exponents=(4, 2), reach=0.0, n_increments=2)
    initial, surface = bent_surface(mover.mesh)
    assert_derivative_is_transposed(mover.move(initial, surface))
    assert_derivative_is_exact(mover, initial, surface)


def test_the_coincident_sides_of_a_plate_take_the_points_beside_them_along():
    mesh = plate()
    lower, upper = both_sides(mesh)
    points = InverseDistance(mesh).move(mesh.points, opened(mesh)).points
    moved = (points - mesh.points)[..., 1]
    inner = slice(1, -1), slice(1, -1)
    assert (lower != upper).reshape(mesh.blocks[1][:, -1].shape)[inner].all()
    assert (moved[mesh.blocks[1][:, -2][inner]] < 0.0).all()
    assert (moved[mesh.blocks[4][:, 1][inner]] > 0.0).all()


def test_only_centres_at_one_place_are_moved_apart_and_to_their_own_sides():
    mesh = plate()
    centres = find_centres(mesh)
    way = centres.position @ mesh.points - mesh.points[centres.ids]
    lower, upper = both_sides(mesh)
    is_twin = np.isin(centres.ids, np.concatenate([lower[lower != upper], upper[lower != upper]]))
    np.testing.assert_array_equal(way[~is_twin], 0.0)
    beside = mesh.points[mesh.blocks[4][1:-1, 1, 1:-1]] - mesh.points[mesh.blocks[4][1:-1, 0, 1:-1]]
    rows = np.searchsorted(centres.ids[: len(centres.surface_rows)], mesh.blocks[4][1:-1, 0, 1:-1])
    np.testing.assert_allclose(way[rows], APART * beside, atol=1e-14)
    assert len(centres.ids) == len(mesh.surface_ids) + len(mesh.fixed_ids)


@pytest.mark.parametrize("setting", [{"exponents": (0, 3)}, {"exponents": (1.5, 3)}, {"reach": -1.0}])
def test_settings_that_mean_nothing_are_refused(setting):
    with pytest.raises(InputError, match="inverse distance"):
        InverseDistance(channel(), **setting)
