"""Cell measures: Eq. (9), corners, volumes, handedness, collapsed and planar blocks."""

import numpy as np
import pytest

from bspline_mdao.errors import InputError
from bspline_mdao.grids.cells.hexahedron import cell_quality, collapsed_corners


def lattice(ni, nj, nk):
    axes = np.arange(float(ni)), np.arange(float(nj)), np.arange(float(nk))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def crooked(shape=(4, 5, 6), amount=0.3, seed=1):
    return lattice(*shape) + amount * np.random.default_rng(seed).uniform(-1.0, 1.0, (*shape, 3))


def reference(nodes):
    """Q, smallest corner, smallest Jacobian and volume of right-handed cells, by direct numpy."""
    ni, nj, nk = (n - 1 for n in nodes.shape[:3])
    at = lambda a, b, d: nodes[a : a + ni, b : b + nj, d : d + nk]  # noqa: E731
    triples, jacobians = [], []
    for a, b, d in np.ndindex(2, 2, 2):
        u, v, w = at(1, b, d) - at(0, b, d), at(a, 1, d) - at(a, 0, d), at(a, b, 1) - at(a, b, 0)
        jacobians.append(np.sum(np.cross(u, v) * w, axis=-1))
        lengths = np.prod([np.linalg.norm(e, axis=-1) for e in (u, v, w)], axis=0)
        triples.append(jacobians[-1] / lengths)
    return np.prod(triples, axis=0), np.min(triples, axis=0), np.min(jacobians, axis=0), gauss_volume(at)


def gauss_volume(at):
    volume = 0.0
    for point in 0.5 + np.array(list(np.ndindex(2, 2, 2)) - np.array(0.5)) / np.sqrt(3.0):
        gradient = [0.0, 0.0, 0.0]
        for corner in np.ndindex(2, 2, 2):
            value = [p if c else 1.0 - p for p, c in zip(point, corner)]
            slope = [1.0 if c else -1.0 for c in corner]
            for d in range(3):
                factors = [slope[e] if e == d else value[e] for e in range(3)]
                gradient[d] = gradient[d] + np.prod(factors) * at(*corner)
        volume = volume + np.linalg.det(np.stack(gradient, axis=-1)) / 8.0
    return volume


def test_unit_cube_has_quality_and_volume_one():
    quality = cell_quality(lattice(2, 2, 2))
    assert (quality.q, quality.min_corner, quality.min_jacobian, quality.volume, quality.handedness) == (1, 1, 1, 1, 1)


@pytest.mark.parametrize("angle", [0.1, 0.7, 1.2])
def test_sheared_cube_has_the_eighth_power_of_the_cosine(angle):
    nodes = lattice(3, 3, 3)
    nodes[..., 0] += np.tan(angle) * nodes[..., 2]
    quality = cell_quality(nodes)
    np.testing.assert_allclose(quality.q, np.cos(angle) ** 8, rtol=1e-13)
    np.testing.assert_allclose(quality.volume, 1.0, rtol=1e-13)


def test_all_measures_agree_with_a_numpy_reference_on_crooked_cells():
    nodes = crooked(amount=0.6)
    quality, expected = cell_quality(nodes), reference(nodes)
    assert not quality.is_valid.all()
    for value, other in zip((quality.q, quality.min_corner, quality.min_jacobian, quality.volume), expected):
        np.testing.assert_allclose(value, other, rtol=1e-11, atol=1e-14)


def test_mirrored_block_measures_the_same_with_the_other_handedness():
    nodes = crooked()
    right, left = cell_quality(nodes), cell_quality(nodes[::-1])
    assert (right.handedness, left.handedness) == (1, -1)
    for name in ("q", "min_corner", "min_jacobian", "volume"):
        np.testing.assert_allclose(getattr(left, name)[::-1], getattr(right, name), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("mirror", [False, True])
def test_a_cell_mirrored_against_its_block_is_inverted_though_its_q_is_one(mirror):
    nodes = lattice(6, 2, 2)
    nodes[3:, :, :, 0] -= 2.0  # the third cell runs backwards
    quality = cell_quality(nodes[:, ::-1] if mirror else nodes)
    np.testing.assert_allclose(quality.q, 1.0)
    np.testing.assert_array_equal(quality.is_valid[:, 0, 0], [True, True, False, True, True])
    np.testing.assert_allclose(quality.volume[:, 0, 0], [1, 1, -1, 1, 1])


def test_handedness_is_that_of_most_cells_even_if_the_middle_of_the_block_differs():
    nodes = lattice(8, 2, 2)
    nodes[4:, :, :, 0] -= 2.0
    assert cell_quality(nodes).handedness == 1


def test_permuting_the_directions_permutes_the_measures():
    nodes = crooked()
    quality, turned = cell_quality(nodes), cell_quality(nodes.transpose(1, 2, 0, 3))
    np.testing.assert_allclose(turned.q, quality.q.transpose(1, 2, 0), rtol=1e-12)
    assert turned.handedness == quality.handedness


def wedge():
    """Cells around the x axis, one layer deep: the edges on the axis have collapsed."""
    x, r, angle = np.meshgrid(np.arange(4.0), np.arange(3.0), [-0.3, 0.3], indexing="ij")
    return np.stack([x, r * np.cos(angle), r * np.sin(angle)], axis=-1)


def test_corners_on_a_collapsed_edge_are_left_out_and_the_wedge_judged_by_the_others():
    nodes = wedge()
    bits = collapsed_corners(nodes)
    np.testing.assert_array_equal(bits[:, 0, 0], 0b00110011)
    np.testing.assert_array_equal(bits[:, 1, 0], 0)
    quality = cell_quality(nodes)
    np.testing.assert_allclose(quality.q[:, 0, 0], np.cos(0.3) ** 4, rtol=1e-12)
    np.testing.assert_allclose(quality.q[:, 1, 0], np.cos(0.3) ** 8, rtol=1e-12)
    assert quality.is_valid.all()


def test_corners_left_out_on_the_baseline_stay_left_out_while_the_grid_moves():
    nodes = wedge()
    moved = nodes.copy()
    moved[:, 0, :, 2] = [-1e-3, 1e-3]
    assert np.all(collapsed_corners(moved) == 0)
    kept = cell_quality(moved, degenerate_corners=collapsed_corners(nodes))
    np.testing.assert_allclose(kept.q, cell_quality(nodes).q, rtol=1e-2)


def test_a_cell_without_corners_and_a_cell_with_a_nan_are_not_valid():
    nodes = lattice(4, 3, 3)
    nodes[:2] = nodes[0, 0, 0]
    nodes[3, 2, 2] = np.nan
    quality = cell_quality(nodes, degenerate_corners=collapsed_corners(np.nan_to_num(nodes)))
    assert not quality.is_valid[0].any()
    assert not quality.is_valid[2, 1, 1]
    assert quality.is_valid[2, 0, 0]


@pytest.mark.parametrize("flat", [0, 1, 2])
def test_a_planar_block_is_measured_in_its_plane(flat):
    plane = lattice(5, 4, 1)
    plane[..., 0] += np.tan(0.4) * plane[..., 1]
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    quality = cell_quality(np.moveaxis(plane @ turn, 2, flat))
    np.testing.assert_allclose(quality.q, np.cos(0.4) ** 4, rtol=1e-12)
    np.testing.assert_allclose(quality.volume, 1.0, rtol=1e-12)
    assert quality.q.shape[flat] == 1


def test_a_folded_corner_of_a_planar_block_is_seen():
    plane = lattice(4, 4, 1)
    plane[1, 1, 0, :2] = 2.4
    quality = cell_quality(plane)
    assert not quality.is_valid[1, 1, 0]
    assert quality.q[1, 1, 0] < 0.0


def test_a_line_of_nodes_is_refused():
    with pytest.raises(InputError, match="cells in two directions"):
        cell_quality(lattice(5, 1, 1))
