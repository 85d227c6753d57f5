from functools import cache

import numpy as np
import pytest
from topology_cases import ORIENTATIONS, o_grid, patch, smooth_box, split, turned_and_shuffled, two_block_plate
from topology_cases import grid_of as make_grid

from bspline_mdao.core.evaluation.family import (
    IndexScaling,
    refine,
    refine_parameters,
    refined_topology,
    scaled_count,
)
from bspline_mdao.core.evaluation.index_map import interpolate
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.model.fitted_model import family_member
from bspline_mdao.core.splines.volume import evaluate
from bspline_mdao.errors import InputError
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.hexahedron import cell_quality
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.sharing import node_sharing


def stretched(n, ratio):
    """Points from 0 to 1 whose distances grow geometrically."""
    return np.concatenate([[0.0], np.cumsum(ratio ** np.arange(n - 1))]) / np.sum(ratio ** np.arange(n - 1))


@pytest.fixture(scope="module")
def m6_model():
    return fit_grid(onera_m6_grid((23, 33, 17)), n_control=(9, 9, 7), keep_residual=False)


@pytest.mark.parametrize("m", [2, 3])
@pytest.mark.parametrize("ratio", [1.05, 1.2, 1.4])
def test_geometric_stretching_is_kept(m, ratio):
    cells = np.diff(interpolate(stretched(15, ratio), 0, 14 * m + 1, is_increasing=True))
    np.testing.assert_allclose(cells[1:] / cells[:-1], ratio ** (1 / m), rtol=0.02)


def test_linear_interpolation_would_not_keep_the_stretching():
    x = stretched(15, 1.4)
    cells = np.diff(np.interp(np.arange(29) / 2, np.arange(15), x))
    assert np.abs(cells[1:] / cells[:-1] / 1.4**0.5 - 1).max() > 0.15


@pytest.mark.parametrize("n", [2, 3, 4, 5, 9])
def test_integer_factors_keep_the_values_to_the_last_bit(n):
    x = np.random.default_rng(n).standard_normal((4, n))
    for m in (1, 2, 3, 7):
        np.testing.assert_array_equal(interpolate(x, 1, m * (n - 1) + 1)[:, ::m], x)


def test_coarse_members_pick_from_the_values():
    x = np.random.default_rng(1).standard_normal((13, 3))
    for m in (2, 3, 4):
        np.testing.assert_array_equal(interpolate(x, 0, 12 // m + 1), x[::m])


@pytest.mark.parametrize("continuity", [2, 3, 4])
def test_interpolation_is_of_fifth_order(continuity):
    t = [np.linspace(0, 1, n) for n in (21, 41, 81)]
    errors = [
        np.abs(interpolate(np.sin(3 * x), 0, 5 * len(x) - 4, continuity=continuity) - np.sin(3 * fine)).max()
        for x, fine in zip(t, (np.linspace(0, 1, 5 * len(x) - 4) for x in t))
    ]
    assert np.log2(np.divide(errors[:-1], errors[1:])).min() > 4.7


@pytest.mark.parametrize("is_increasing", [False, True])
@pytest.mark.parametrize("continuity", [2, 3, 4])
def test_derivatives_are_continuous_at_old_values_up_to_the_order_asked_for(continuity, is_increasing):
    """Each side is a polynomial, which divided differences of as many positions as it has coefficients give exactly."""
    n_inside = 2 * continuity + 1  # positions of an interval that are its coefficients
    x = np.cumsum(10.0 ** np.random.default_rng(continuity).uniform(-1, 1, (20, 9)), axis=1)
    fine = interpolate(x, 1, 8 * n_inside + 1, is_increasing, continuity)
    taylor = np.linalg.inv(np.vander(np.arange(n_inside + 1) / n_inside, increasing=True))
    for node in range(1, 8):
        at = node * n_inside
        before, after = fine[:, at - n_inside : at + 1][:, ::-1] @ taylor.T, fine[:, at : at + n_inside + 1] @ taylor.T
        before *= (-1.0) ** np.arange(n_inside + 1)
        scale = np.abs(after).max()
        np.testing.assert_allclose(before[:, : continuity + 1], after[:, : continuity + 1], rtol=0, atol=1e-7 * scale)
        if 2 <= node <= 6:  # the first two and the last two intervals have the polynomial of the same five values
            assert np.abs(before - after)[:, continuity + 1].max() > 1e-4 * scale


@pytest.mark.parametrize("continuity", [2, 3, 4, 5])
def test_increasing_values_stay_increasing(continuity):
    rng = np.random.default_rng(2)
    x = np.cumsum(10.0 ** rng.uniform(-6, 0, (200, 12)), axis=1)
    assert (np.diff(interpolate(x, 1, 23 * 11 + 1, True, continuity)) > 0).all()
    assert (np.diff(interpolate(x, 1, 23 * 11 + 1, False, continuity)) < 0).any()


@pytest.mark.parametrize("continuity", [2, 4])
def test_ordinary_stretching_is_not_limited(continuity):
    for x in (stretched(12, 1.6), stretched(15, 1.4), stretched(9, 0.7)):
        free, limited = (interpolate(x, 0, 41, is_limited, continuity) for is_limited in (False, True))
        np.testing.assert_allclose(limited, free, rtol=0, atol=1e-15)


@pytest.mark.parametrize("x", [np.linspace(0.0, 1.0, 15) ** 2, 1.0 - np.cos(0.5 * np.pi * np.linspace(0.0, 1.0, 15))])
def test_spacing_that_goes_to_zero_at_an_end_is_kept(x):
    """Cosine spacing, and trailing edges of Joukowski sections: the first cell of a member was 18 % too long."""
    free, limited = (interpolate(x, 0, 22, is_limited) for is_limited in (False, True))
    np.testing.assert_allclose(limited[1], free[1], rtol=0.01)
    np.testing.assert_allclose(limited[2:], free[2:], rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("is_increasing", [False, True])
def test_the_map_is_the_same_from_both_ends(is_increasing):
    x = np.cumsum(10.0 ** np.random.default_rng(5).uniform(-3, 0, (9, 11)), axis=1)
    there, back = interpolate(x, 1, 34, is_increasing), -interpolate(-x[:, ::-1], 1, 34, is_increasing)[:, ::-1]
    np.testing.assert_allclose(back, there, rtol=0, atol=1e-13)


def test_members_are_as_smooth_as_the_splines():
    grid = make_grid(smooth_box(9, 8, 7))
    for order, continuity in ((3, 2), (4, 2), (5, 3), (6, 4)):
        model = fit_grid(grid, n_control=7, order=order, keep_residual=False)
        member = model.member(1.5).parameters[0]
        np.testing.assert_array_equal(member, refine_parameters(model.parameters[0], member.shape[:3], continuity))


def test_equal_values_keep_their_bits():
    np.testing.assert_array_equal(interpolate(np.full(6, 0.1), 0, 17), 0.1)


def test_parameters_that_would_fold_are_interpolated_linearly():
    parameters = np.stack(np.meshgrid(*[np.linspace(0, 1, n) for n in (6, 5, 4)], indexing="ij"), -1)
    parameters[:, 2, :, 0] = stretched(6, 0.01)[:, None]
    refined = refine_parameters(parameters, (11, 13, 7))
    assert (np.diff(refined[..., 0], axis=0) > 0).all()
    assert (np.diff(interpolate(interpolate(parameters[..., 0], 0, 11, True), 1, 13), axis=0) <= 0).any()


def random_parameters(rng, shape):
    """Parameters that increase along their own direction from 0 to 1."""
    parameters = np.stack([np.sort(rng.uniform(0, 1, shape), axis=d) for d in range(3)], axis=-1)
    for d in range(3):
        along = np.moveaxis(parameters[..., d], d, 0)
        along[0], along[-1] = 0.0, 1.0
    return parameters


def test_nodes_of_a_face_depend_on_the_face_alone():
    rng = np.random.default_rng(3)
    parameters, other = random_parameters(rng, (6, 5, 4)), random_parameters(rng, (6, 5, 4))
    other[:, 0] = parameters[:, 0]
    a, b = (refine_parameters(x, (13, 12, 9)) for x in (parameters, other))
    np.testing.assert_array_equal(a[:, 0], b[:, 0])
    assert not np.array_equal(a[:, 1], b[:, 1])


def test_counts_are_rounded_and_never_vanish():
    assert [scaled_count(n, 1.5) for n in (1, 2, 3, 4, 6)] == [1, 3, 4, 6, 9]
    assert [scaled_count(n, 0.25) for n in (1, 2, 3, 9, 11)] == [1, 2, 2, 3, 4]


@pytest.mark.parametrize("factor", [0.5, 0.77, 1.0, 1.5, 2.0, 3.3])
def test_the_member_of_a_grid_has_the_scaled_topology(factor):
    grid, _ = turned_and_shuffled(make_grid(*split(smooth_box(9, 10, 8), [4], [6], [3])), np.random.default_rng(4))
    member = refined_topology(find_topology(grid), factor)
    sharing = node_sharing(member)
    n_unique = sum(int(own.sum()) for own in sharing.is_evaluated)
    assert n_unique + len(sharing.copies) == member.n_nodes
    counts = [sum(scaled_count(n, factor) - 1 for n in parts) + 1 for parts in ((5, 5), (7, 4), (4, 5))]
    assert n_unique == np.prod(counts)


def test_cut_blocks_and_windows_are_scaled():
    grid = two_block_plate()
    topology = find_topology(grid)
    assert len(topology.segments) > len(grid.blocks)
    member = refined_topology(topology, 2.0)
    assert member.shapes == tuple(tuple(2 * n - 1 for n in shape) for shape in topology.shapes)
    for before, after in zip(topology.boundary, member.boundary):
        assert after.window.lo == tuple(2 * i for i in before.window.lo)
        assert after.window.hi == tuple(2 * i for i in before.window.hi)
    scaling = IndexScaling.of(topology, 1.4)
    ends = {(s.block, s.lo): s.hi for s in refined_topology(topology, 1.4).segments}
    for segment in topology.segments:
        scaled = scaling.window(segment)
        assert ends[scaled.block, scaled.lo] == scaled.hi


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.6, 2.0, 2.5])
def test_both_sides_of_interfaces_get_the_same_bits(m6_model, factor):
    grid = family_member(m6_model, factor)
    topology = refined_topology(m6_model.topology, factor)
    assert len(topology.interfaces) > 12
    for interface in topology.interfaces:
        a = grid.blocks[interface.a.block].nodes[interface.a.slices]
        b = grid.blocks[interface.b.block].nodes[interface.b.slices]
        np.testing.assert_array_equal(a, interface.orientation.apply(b))


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 1.5, 2.0])
def test_cells_of_members_are_valid(m6_model, factor):
    for block in family_member(m6_model, factor).blocks:
        assert cell_quality(block.nodes).is_valid.all()


@pytest.mark.slow
def test_factor_two_contains_the_grid(m6_model):
    grid, member = m6_model.regenerate(), family_member(m6_model, 2)
    for block, refined in zip(grid.blocks, member.blocks):
        np.testing.assert_allclose(refined.nodes[::2, ::2, ::2], block.nodes, rtol=0, atol=1e-13)


@pytest.mark.slow
def test_a_member_is_a_model_of_its_own(m6_model):
    member = m6_model.member(1.5)
    grid = member.regenerate()
    np.testing.assert_array_equal(grid.to_vector(), family_member(m6_model, 1.5).to_vector())
    found = find_topology(grid)
    assert member.n_nodes == grid.n_nodes > 2 * m6_model.n_nodes
    assert set(found.boundary) == set(member.topology.boundary)
    assert len(found.interfaces) == len(member.topology.interfaces)


@pytest.mark.slow
@pytest.mark.parametrize("d", range(3))
def test_ratios_of_neighbouring_cells_change_less_in_finer_members(m6_model, d):
    def largest_change(parameters):
        cells = [np.diff(x[..., d], axis=d) for x in parameters]
        return max(np.abs(np.diff(np.log(cell), n=2, axis=d)).max() for cell in cells)

    member = refine(m6_model.topology, m6_model.mesh, m6_model.parameters, 2)
    straight = [np.repeat(np.diff(x[..., d], axis=d), 2, axis=d) / 2 for x in m6_model.parameters]
    jump = max(np.abs(np.diff(np.log(cell), n=2, axis=d)).max() for cell in straight)
    change = largest_change(member.parameters)
    assert change < 0.5 * largest_change(m6_model.parameters)
    assert change < 0.2 * jump


@pytest.mark.slow
def test_members_follow_moved_control_points(m6_model):
    moved = family_member(m6_model, 0.5, m6_model.control_points + [1.0, 2.0, 3.0])
    still = family_member(m6_model, 0.5)
    np.testing.assert_allclose(
        moved.to_vector() - still.to_vector(), np.tile([1.0, 2.0, 3.0], still.n_nodes), atol=1e-13
    )


def test_self_connected_grids_have_members():
    model = fit_grid(make_grid(o_grid(17, 7, 5)), n_control=(8, 5, 4), keep_residual=False)
    member = family_member(model, 1.7)
    assert member.shapes == ((28, 11, 8),)
    np.testing.assert_array_equal(member.blocks[0].nodes[0], member.blocks[0].nodes[-1])


def test_patches_and_degenerate_directions_are_kept():
    nodes = smooth_box(7, 9, 1)
    grid = make_grid(nodes, patches=[patch("wall", Window(0, (0, 0, 0), (6, 0, 0)))])
    model = fit_grid(grid, n_control=(4, 5, 1), keep_residual=False)
    member = family_member(model, 2.0)
    assert member.shapes == ((13, 17, 1),)
    assert member.patches[0].windows[0] == Window(0, (0, 0, 0), (12, 0, 0))


@pytest.mark.slow
@pytest.mark.parametrize("turn", ORIENTATIONS[::7])
def test_neighbours_would_put_shared_nodes_at_the_same_place(turn):
    """Each side's own parameters and volume, without the copies, give the nodes of the face."""
    left, right = split(smooth_box(11, 7, 6), [5], [], [])
    model = fit_grid(make_grid(left, turn.apply(right)), n_control=[(4, 5, 4), _turned((4, 5, 4), turn)])
    member = refine(model.topology, model.mesh, model.parameters, 1.8)
    sides = [
        evaluate(volume, net, parameters.reshape(-1, 3)).reshape(parameters.shape)
        for volume, net, parameters in zip(model.mesh.volumes, model.mesh.nets(model.control_points), member.parameters)
    ]
    (interface,) = member.topology.interfaces
    a, b = interface.a, interface.b
    np.testing.assert_allclose(
        sides[a.block][a.slices], interface.orientation.apply(sides[b.block][b.slices]), rtol=0, atol=1e-13
    )


def _turned(counts, turn):
    """Counts in the directions of the block that ``turn.apply`` makes."""
    return tuple(counts[turn.perm[d]] for d in range(3))


@pytest.mark.parametrize("factor", [0.0, -1.0, np.nan, np.inf])
def test_factors_that_mean_nothing_are_refused(m6_model, factor):
    with pytest.raises(InputError, match="positive number"):
        family_member(m6_model, factor)


@pytest.mark.parametrize("factor", [3.0, 2.5, 0.4])
def test_every_plane_of_a_member_takes_the_blanking_of_the_nearest_plane_of_the_grid(factor):
    topology = find_topology(make_grid(smooth_box(9, 6, 7)))
    scaling = IndexScaling.of(topology, factor)
    for planes, nearest in zip(scaling.planes[0], scaling.nearest(0)):
        assert len(nearest) == planes[-1] + 1
        places = np.interp(np.arange(len(nearest)), planes, np.arange(len(planes)))  # of the member, in the grid
        assert np.abs(nearest - places).max() <= 0.5


@cache
def shuffled_model(keep_residual=True):
    """Eight blocks turned at random, whose splines are too few for them."""
    grid, _ = turned_and_shuffled(make_grid(*split(smooth_box(7, 8, 9), [3], [3], [4])), np.random.default_rng(6))
    return fit_grid(grid, n_control=4, keep_residual=keep_residual)


def test_members_have_the_nodes_of_the_grid_where_what_the_splines_miss_is_kept():
    model, bare = shuffled_model(), shuffled_model(keep_residual=False)
    grid, finer, same = (each.regenerate() for each in (model, model.member(2.0), model.member(1.0)))
    assert np.abs(bare.member(2.0).regenerate().to_vector() - finer.to_vector()).max() > 1e-4
    np.testing.assert_array_equal(same.to_vector(), grid.to_vector())
    for block, refined in zip(grid.blocks, finer.blocks):
        np.testing.assert_allclose(refined.nodes[::2, ::2, ::2], block.nodes, rtol=0.0, atol=1e-13)
    coarser = model.member(2.0).member(0.5)
    np.testing.assert_allclose(coarser.residual, model.residual, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("factor", [0.6, 1.5, 2.0])
def test_blocks_share_nodes_of_members_to_the_last_bit_where_what_the_splines_miss_is_kept(factor):
    member = shuffled_model().member(factor)
    nodes = member.regenerate().to_vector().reshape(-1, 3)
    copies = node_sharing(member.topology).copies
    assert len(copies) > 50
    np.testing.assert_array_equal(nodes[copies[:, 0]], nodes[copies[:, 1]])
