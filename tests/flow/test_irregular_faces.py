"""Weights of mean states as functions of the nodes, and the residual with them: exact derivatives."""

import numpy as np
import pytest
from euler_cases import AXES, GRIDS, mach_of_cases, section_grid, with_guessed_patches

from bspline_mdao.flow.euler.cell_shapes import cell_shapes, face_centres, face_centres_jvp, face_centres_vjp
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.euler.irregular_weights import LARGEST
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.detection import find_topology

CASES = {
    "wing": lambda: with_guessed_patches(onera_m6_grid((7, 6, 5))),
    "section": lambda: section_grid(7, 5),
    "collapsed": lambda: with_guessed_patches(GRIDS["pie"]()),
}


def posed(name, threshold=0.0):
    """Flow of a grid whose inner nodes are moved a little, and random directions of nodes."""
    grid = CASES[name]()
    nodes, random = grid.to_vector().reshape(-1, 3), np.random.default_rng(3)
    flow = FlowGrid.of(find_topology(grid), nodes, shock_threshold=threshold)
    steps = np.repeat(0.02 * flow.least_height(nodes), 3)
    noise = random.uniform(-1.0, 1.0, (2, *nodes.shape))
    return flow, nodes + noise[0] * steps, noise[1] * steps


@pytest.mark.parametrize("name", CASES)
def test_weights_have_the_derivatives_of_complex_steps_in_both_directions(name):
    flow, nodes, d_nodes = posed(name)
    irregular_faces = flow.irregular_faces
    assert len(irregular_faces.ids) > 30
    exact = irregular_faces.changes(nodes + 1e-30j * d_nodes).imag / 1e-30
    change = irregular_faces.changes_jvp(nodes, d_nodes)
    np.testing.assert_allclose(change, exact, rtol=0.0, atol=1e-10 * np.abs(exact).max())
    bar = np.random.default_rng(4).standard_normal(change.shape)
    assert np.vdot(irregular_faces.changes_vjp(nodes, bar), d_nodes) == pytest.approx(np.vdot(bar, change), rel=1e-10)


def test_some_weights_are_kept_below_the_largest_and_others_are_as_they_would_be():
    flow, nodes, _ = posed("wing")
    irregular_faces, (middles, _, centres, spreads) = flow.irregular_faces, flow.irregular_faces._shapes(nodes)
    largest = np.abs(irregular_faces.changes(nodes)).max(axis=1)
    assert 0.95 * LARGEST < largest.max() < LARGEST
    cells, weights = irregular_faces._index
    free = np.zeros((len(cells), 4))
    for out, near, plain, middle in zip(free, cells, weights, middles[irregular_faces.ids]):
        places = centres[near] - middle
        is_there = np.array([near[0] != near[1], True, True, near[3] != near[2]])
        steps = np.where(is_there[:, None], places - places[is_there].mean(axis=0), 0.0)
        matrix = steps.T @ steps + 0.005 * (spreads[near[1]] + spreads[near[2]])
        out[:] = -steps @ np.linalg.solve(matrix, plain @ places)
    small = np.abs(free).max(axis=1) < 0.25 * LARGEST
    assert 0.2 < small.mean() < 0.9
    np.testing.assert_allclose(irregular_faces.changes(nodes)[small], free[small], rtol=5e-3, atol=1e-9)


@pytest.mark.parametrize("name", ["wing", "collapsed"])
def test_the_outer_cells_weigh_nearly_a_quarter_and_never_so_much_that_waves_turn_round(name):
    flow, nodes, _ = posed(name)
    weights = flow.irregular_faces._index[1] + flow.irregular_faces.changes(nodes)
    phases = np.linspace(0.0, 0.5 * np.pi, 200)[:, None]  # from the face to the cells next to it
    means = np.cos(phases * [3.0, 1.0, 1.0, 3.0]) @ weights.T
    assert means.min() > -1e-12
    assert 0.24 < (weights[:, 0] + weights[:, 3]).max() < 0.25


@pytest.mark.parametrize("threshold", [0.0, 0.05])
def test_the_residual_has_the_derivatives_of_complex_steps_of_the_nodes(threshold):
    flow, nodes, d_nodes = posed("wing", threshold)
    stream = free_stream(mach_of_cases(threshold), 0.05, AXES)
    noise = np.random.default_rng(5).uniform(-0.1, 0.1, (flow.faces.n_cells, 5))
    states = flow.discretization.uniform(stream) * (1.0 + noise)

    def residual(x):
        return flow.at(x).residual(states, flow.areas(x), stream)

    exact = residual(nodes + 1e-30j * d_nodes).imag / 1e-30
    tangent = flow.at(nodes).linearize(states, flow.areas(nodes), stream)
    change = flow.nodes_jvp(nodes, tangent, d_nodes)
    np.testing.assert_allclose(change, exact, rtol=0.0, atol=1e-11 * np.abs(exact).max())
    frozen = tangent.area_jvp(flow.areas_jvp(nodes, d_nodes))
    assert np.abs(change - frozen).max() > 1e-2 * np.abs(change).max()
    bar = np.random.default_rng(6).standard_normal(change.shape)
    assert np.vdot(flow.nodes_vjp(nodes, tangent, bar), d_nodes) == pytest.approx(np.vdot(bar, change), rel=1e-10)


def test_on_its_own_nodes_a_grid_has_the_weights_that_it_was_posed_with():
    flow, nodes, _ = posed("section")
    grid = CASES["section"]()
    again = FlowGrid.of(find_topology(grid), nodes)
    for ids in (flow.irregular_faces.ids, again.irregular_faces.ids):
        assert len(ids) > 30
    both = np.intersect1d(flow.irregular_faces.ids, again.irregular_faces.ids, return_indices=True)
    ours, theirs = flow.irregular_faces.changes(nodes)[both[1]], again.irregular_faces.changes(nodes)[both[2]]
    np.testing.assert_array_equal(ours, theirs)
    assert len(both[0]) > 0.95 * len(flow.irregular_faces.ids)


def test_centres_and_edges_of_a_sheared_box_are_those_of_its_corners():
    random = np.random.default_rng(7)
    edges, origin = random.standard_normal((3, 3)), random.standard_normal(3)
    corners = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    faces = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)], np.int32)
    if np.linalg.det(edges) < 0.0:
        edges[0] *= -1.0
    centres, areas = face_centres(origin + corners @ edges, faces)
    np.testing.assert_allclose(areas.sum(axis=0), 0.0, atol=1e-13)
    middles, spreads = cell_shapes(centres, areas, np.zeros(6, np.int32), np.zeros(0, np.int32), 1)
    np.testing.assert_allclose(middles[0], origin + 0.5 * edges.sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose(spreads[0], edges.T @ edges, rtol=1e-12, atol=1e-12)


def test_centres_and_areas_of_faces_have_exact_derivatives_where_corners_coincide():
    rng = np.random.default_rng(17)
    nodes, corners = rng.standard_normal((40, 3)), rng.integers(0, 40, (60, 4)).astype(np.int32)
    corners[:5, 1] = corners[:5, 0]
    corners[5:10, 2:] = corners[5:10, :2]  # no diagonal, and no area
    corners[10:12] = corners[10:12, :1]
    d_nodes, bars = rng.standard_normal((40, 3)), rng.standard_normal((2, 60, 3))
    exact = [part.imag / 1e-30 for part in face_centres(nodes + 1e-30j * d_nodes, corners)]
    changes = face_centres_jvp(nodes, corners, d_nodes)
    np.testing.assert_allclose(changes, exact, rtol=1e-12, atol=1e-13)
    back = np.vdot(face_centres_vjp(nodes, corners, *bars), d_nodes)
    assert back == pytest.approx(np.vdot(bars, changes), rel=1e-12)
