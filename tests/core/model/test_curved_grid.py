"""Curved hexahedra of a model: one numbering, right-handed, closed, as near to the splines as their degree says."""

import numpy as np
import pytest
from topology_cases import grid_of, o_grid, patch, smooth_box, split, turned_and_shuffled

from bspline_mdao import InputError, fit_grid
from bspline_mdao.generators import ball_grid, onera_m6_grid
from bspline_mdao.grids.cells.curved_grid import lagrange
from bspline_mdao.grids.topology.grid import Block, Grid
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.splines import curved_grid


@pytest.fixture(scope="module")
def ball():
    return fit_grid(ball_grid((9, 8, 7, 6), far=3.0), keep_residual=False)


@pytest.fixture(scope="module")
def wing():
    return fit_grid(onera_m6_grid((13, 17, 9)), keep_residual=False)


@pytest.fixture(scope="module")
def shuffled():
    grid, _ = turned_and_shuffled(grid_of(*split(smooth_box(9, 7, 6), [4], [3], [3])), np.random.default_rng(1))
    return fit_grid(grid, keep_residual=False)


def volume_by_faces(grid):
    """Volume inside of the boundary, by the divergence theorem with as many Gauss points as make it exact."""
    points, weights = np.polynomial.legendre.leggauss(2 * grid.degree + 2)
    values, slopes = lagrange(grid.degree, (points + 1) / 2)
    total = 0.0
    for p in grid.patches:
        x = grid.nodes[p.faces]
        at, along, up = (
            np.einsum("nabx,pa,qb->npqx", x, *two) for two in ((values, values), (slopes, values), (values, slopes))
        )
        total += np.einsum("npqx,npqx,p,q->", at, np.cross(along, up), weights / 2, weights / 2) / 3
    return total


@pytest.mark.slow
@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_elements_fill_what_their_boundary_encloses(ball, wing, shuffled, degree):
    """Holds only where nodes are shared across blocks, every patch is there, and its faces are turned outwards."""
    for model in (ball, wing, shuffled):
        grid = curved_grid(model, degree, 0.5)
        np.testing.assert_allclose(grid.volumes().sum(), volume_by_faces(grid), rtol=1e-12)
        assert (grid.volumes() > 0).all()


@pytest.mark.parametrize("degree", [2, 3])
def test_nodes_are_there_once(shuffled, degree):
    grid = curved_grid(shuffled, degree, 1.0)
    assert len(grid.nodes) == np.prod([degree * n + 1 for n in (8, 6, 5)])
    assert len(np.unique(grid.nodes.round(9), axis=0)) == len(grid.nodes)
    np.testing.assert_array_equal(np.unique(grid.elements), np.arange(len(grid.nodes)))


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_corners_are_the_nodes_of_the_member(ball, degree):
    grid, member = curved_grid(ball, degree, 1.0), ball.member(1.0).regenerate()
    corners = grid.nodes[grid.elements[:, ::degree, ::degree, ::degree]].reshape(-1, 3)
    assert {tuple(x) for x in corners} == {tuple(x) for block in member.blocks for x in block.nodes.reshape(-1, 3)}


@pytest.mark.slow
def test_areas_converge_at_the_order_of_the_element():
    """Without knots inside of volumes, which would bound the order; even degrees gain one."""
    model = fit_grid(ball_grid((5, 5, 5, 4), far=3.0), n_control=4, keep_residual=False)
    exact = curved_grid(model, 4, 3.0).areas("body").sum()
    for degree, order in ((1, 2), (2, 4), (3, 4)):
        errors = [abs(curved_grid(model, degree, factor).areas("body").sum() - exact) for factor in (1.0, 2.0)]
        assert np.log2(errors[0] / errors[1]) > order - 0.2


def test_inner_nodes_follow_the_stretching(ball):
    """An element between cells of ratio r has its middle node at the smooth place, so that its Jacobian is even."""
    grid = curved_grid(ball, 2, 1.0)
    assert grid.worst_jacobians().min() > 0.9 * curved_grid(ball, 1, 1.0).worst_jacobians().min()


def test_patches_are_named_and_what_has_no_name_is_called_boundary():
    grid = grid_of(smooth_box(5, 4, 6), patches=[patch("wall", Window(0, (0, 0, 0), (4, 0, 5)))])
    curved = curved_grid(fit_grid(grid, keep_residual=False), 2)
    assert {p.name: len(p.faces) for p in curved.patches} == {"wall": 20, "boundary": 20 + 2 * 12 + 2 * 15}
    with pytest.raises(InputError, match="no patch 'wing'; there are"):
        curved.areas("wing")


def test_left_handed_blocks_have_right_handed_elements():
    nodes = smooth_box(5, 4, 6)
    left = fit_grid(Grid((Block(np.ascontiguousarray(nodes[::-1]), "left"),)), keep_residual=False)
    right = fit_grid(Grid((Block(nodes, "right"),)), keep_residual=False)
    worst = [curved_grid(model, 3).worst_jacobians() for model in (left, right)]
    assert (worst[0] > 0).all()
    np.testing.assert_allclose(np.sort(worst[0]), np.sort(worst[1]), rtol=1e-6)


@pytest.mark.slow
def test_elements_at_collapsed_edges_are_counted_and_valid_inside(wing):
    grid = curved_grid(wing, 2)
    doubled = np.array([len(np.unique(element)) < 27 for element in grid.elements])
    np.testing.assert_array_equal(grid.is_collapsed, doubled)
    o_model = fit_grid(grid_of(o_grid(17, 7, 5)), n_control=(8, 5, 4), keep_residual=False)
    assert not curved_grid(o_model, 2).is_collapsed.any()


def test_an_inverted_element_is_found_where_it_is(ball):
    points = ball.control_points.copy()
    ids = ball.mesh.control_ids[2]
    points[ids[2:4, 2:4, 2]] += 3.0 * (points[ids[2:4, 2:4, -1]] - points[ids[2:4, 2:4, 2]])
    grid = curved_grid(ball, 3, 1.0, points)
    worst = grid.worst_jacobians()
    assert worst.min() < 0
    assert grid.places[np.argmin(worst), 0] == 2


@pytest.mark.parametrize("degree", [0, 5, 2.5, True, "3"])
def test_other_degrees_are_refused(ball, degree):
    with pytest.raises(InputError, match=r"degree .* of elements; give 1 to 4"):
        curved_grid(ball, degree)


def test_flat_and_blanked_grids_are_refused():
    with pytest.raises(InputError, match="one node thick"):
        curved_grid(fit_grid(grid_of(smooth_box(5, 6, 1)), keep_residual=False), 2)
    nodes = smooth_box(5, 4, 6)
    blank = np.ones(nodes.shape[:3], np.int32)
    blank[2, 2, 2] = 0
    model = fit_grid(Grid((Block(nodes, "box", blank),)), keep_residual=False)
    with pytest.raises(InputError, match="blanked nodes"):
        curved_grid(model, 2)
