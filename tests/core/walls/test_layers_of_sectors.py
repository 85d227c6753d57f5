"""Layers of sectors see walls beyond periodic sides: nodes go where those of the whole wheel go."""

from functools import cache

import numpy as np
import pytest
from topology_cases import grid_of, patch

from bspline_mdao import fit_grid
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.partition import Partition
from bspline_mdao.testing import central_difference

N_SECTORS, SHAPE = 5, (7, 9, 10)
PITCH = 2.0 * np.pi / N_SECTORS


def turned(points, angle):
    """Points turned about x."""
    cos, sin = np.cos(angle), np.sin(angle)
    return points @ np.array([[1.0, 0.0, 0.0], [0.0, cos, sin], [0.0, -sin, cos]])


@cache
def wheel(n_sectors, keep_residual=True):
    """Model of sectors whose hub, which repeats itself, has a boundary layer of cells 0.005 high and 0.2 wide."""
    i, j, k = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in SHAPE), indexing="ij")
    off = np.expm1(8.0 * k) / np.expm1(8.0)
    turn = PITCH * (j + 0.4 * i**2 + 0.03 * np.sin(2.0 * np.pi * j))
    radius = 2.0 + off + 0.1 * k * np.sin(3.0 * i) + 0.05 * np.cos(2.0 * np.pi * j) * (1.0 - off)
    nodes = np.stack([3.0 * i, radius * np.cos(turn), radius * np.sin(turn)], axis=-1)
    walls = [patch("wall", Window.whole(n, SHAPE).face(4)) for n in range(n_sectors)]
    grid = grid_of(*(turned(nodes, n * PITCH) for n in range(n_sectors)), patches=walls)
    return fit_grid(grid, n_control=(5, 6, 6), method="least_squares", keep_residual=keep_residual)


def alike_change(model, size=0.05):
    """Displacements of control points that both sides have, and that leave planes across the axis where they are."""
    mesh, rng = moving_mesh(model), np.random.default_rng(1)
    change = size * np.sin(mesh.points @ rng.uniform(-2.0, 2.0, (3, 3)) + rng.uniform(0.0, 3.0, 3))
    change[np.isin(mesh.points[:, 0].round(9), (0.0, 3.0)), 0] = 0.0
    return mesh.ties.alike(change)


@pytest.mark.parametrize(
    ("keep_residual", "tolerance"),
    # weights are kept in single precision, and a closest point on an edge may be in the triangle on either side of it;
    # rotations of a residual of 5e-3 are smoothed on either side of a periodic pair by themselves
    [(False, 2e-9), (True, 1e-6)],
)
def test_nodes_of_a_sector_go_where_those_of_the_whole_wheel_go(keep_residual, tolerance):
    one, whole = wheel(1, keep_residual), wheel(N_SECTORS, keep_residual)
    points = one.control_points + alike_change(one)
    of_all = whole.control_points.copy()
    for n, ids in enumerate(whole.mesh.control_ids):
        of_all[ids] = turned(points[one.mesh.control_ids[0]], n * PITCH)
    found, expected = one.grid_map().at(points).nodes, whole.grid_map().at(of_all).nodes[: one.n_nodes]
    assert one.grid_map().following.layer.n_followers > 3 * 7 * 9
    assert np.abs(found - one.grid_map().nodes).max() > 0.04
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


def test_derivatives_of_what_follows_walls_beyond_sides_are_exact():
    model, rng = wheel(1), np.random.default_rng(2)
    node_map, points = model.grid_map(), model.control_points + alike_change(model)
    change, bar = 0.1 * rng.normal(size=points.shape), rng.normal(size=(model.n_nodes, 3))
    state = node_map.at(points)
    forward, back = state.jvp(change), state.vjp(bar)["control_points"]
    assert np.vdot(bar, forward) == pytest.approx(np.vdot(back, change), rel=1e-12)
    difference = central_difference(lambda t: node_map.at(points + t * change).nodes, 1e-3, levels=4)
    np.testing.assert_allclose(forward, difference, atol=1e-9 * np.abs(forward).max())


def test_a_process_gives_its_nodes_the_bits_that_they_have_in_the_whole_sector():
    model = wheel(1)
    points = model.control_points + alike_change(model)
    nodes = model.regenerate(points).to_vector().reshape(-1, 3)
    for rank in range(3):
        part = model.local_model(Partition.of(model.topology, 3).subdomain(rank))
        np.testing.assert_array_equal(part.regenerate(points), nodes[part.subdomain.rows])
