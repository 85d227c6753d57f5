"""Points that were not fitted, beside a grid with a boundary layer."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bspline_mdao import InputError, fit_grid
from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.core.movement.elasticity import LinearElasticity
from bspline_mdao.core.walls.embedded_points import planes_of
from bspline_mdao.generators import Spacing, onera_m6_grid
from bspline_mdao.grids.cells.first_cells import FirstCells
from bspline_mdao.movers import moving_mesh

TOLERANCE = 0.5
"""Nodes on the boundary are off the volumes by the error of the fit (m)."""


@pytest.fixture
def rng():
    return np.random.default_rng(12)


@pytest.fixture(scope="module")
def model():
    return fit_grid(onera_m6_grid((11, 17, 13), Spacing(off_wall=1e-4)), n_control=(7, 8, 7))


@pytest.fixture(scope="module")
def twisted(model):
    mesh = moving_mesh(model)
    surface = parse_deformation(["twist=10deg"], model, mesh).apply(model.control_points[mesh.surface_ids])
    return LinearElasticity(mesh).move(model.control_points, surface).points


@pytest.fixture(scope="module")
def first_nodes(model):
    """Rows of the nodes next to the wall."""
    cells = FirstCells.of_baseline(model.regenerate())
    wall = cells.rows[cells.at]
    return cells.next_rows[~np.isin(cells.next_rows, wall)]


@pytest.mark.slow
def test_embedded_points_at_nodes_next_to_the_wall_move_as_these_do(model, twisted, first_nodes):
    grid = model.grid_map().at(twisted)
    nodes = grid.of.nodes
    embedded = model.embed_points(nodes[first_nodes], TOLERANCE).at(twisted, grid.nodes)
    moves = np.linalg.norm(grid.nodes - nodes, axis=1)[first_nodes]
    off = np.linalg.norm(embedded.nodes - grid.nodes[first_nodes], axis=1)
    assert moves.max() > 0.04
    assert np.quantile(off, 0.9) < 2e-6  # nodes turn about corners of the wall, points about the closest place
    plain = embedded.of.evaluator.forward(twisted) + embedded.of.offsets
    assert np.quantile(np.linalg.norm(plain - grid.nodes[first_nodes], axis=1), 0.9) > 1e-4


@pytest.mark.slow
def test_embedded_points_stay_in_a_plane_of_symmetry(model, twisted, first_nodes):
    grid = model.grid_map().at(twisted)
    nodes = grid.of.nodes[first_nodes]
    in_plane = np.flatnonzero(nodes[:, 2] == 0.0)
    assert len(in_plane) > 3
    points = model.embed_points(nodes[in_plane], TOLERANCE).at(twisted, grid.nodes).nodes
    assert np.abs(points[:, 2]).max() < 1e-14
    assert np.abs(points - nodes[in_plane]).max() > 1e-8


@pytest.mark.slow
def test_points_lie_in_a_plane_up_to_the_rounding_of_files_and_no_farther(rng):
    grid_map = fit_grid(onera_m6_grid((5, 6, 5), Spacing(off_wall=1e-3))).grid_map()
    nodes, size = grid_map.nodes, np.linalg.norm(np.ptp(grid_map.nodes, axis=0))
    in_plane = rng.permutation(np.flatnonzero(nodes[:, 2] == 0.0))[:12]
    points, off = nodes[in_plane].copy(), size * np.repeat([0.0, 1e-10, 1e-8, 1e-7], 3)
    points[:, 2] += rng.choice([-1.0, 1.0], 12) * off
    ((found, normal),) = planes_of(grid_map, points)
    np.testing.assert_array_equal(found, np.arange(6))  # seven digits, those of 4-byte files, are too few
    np.testing.assert_array_equal(np.abs(normal), [0.0, 0.0, 1.0])


@pytest.mark.slow
def test_embedded_points_follow_a_rigid_motion(model, rng):
    inside = model.embed_points(model.evaluator().forward(model.control_points)[::7])
    turn = Rotation.from_rotvec(rng.standard_normal(3)).as_matrix()
    moved = model.control_points @ turn.T + rng.standard_normal(3)
    state = inside.at(moved, model.grid_map().at(moved).nodes)
    shift = moved[0] - turn @ model.control_points[0]
    np.testing.assert_allclose(state.nodes, inside.points @ turn.T + shift, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_a_rider_outside_is_named(model):
    with pytest.raises(InputError, match="embedded points: 1 of 1 points lie outside"):
        model.embed_points(np.array([[1e4, 0.0, 0.0]]))
