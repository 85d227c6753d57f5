"""Planes of the boundary of a grid: whether they bound it, and which surfaces end in them at a right angle."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from topology_cases import box, grid_of, split

from bspline_mdao.grids.io.boundary_planes import find_planes
from bspline_mdao.grids.topology.index_space import Window


def test_a_plane_is_at_the_rim_where_all_nodes_are_on_one_side_of_it():
    """The face of a step in a channel has nodes ahead of it and behind it, the end of the channel has not."""
    ahead, below, above = split(
        box(np.linspace(0.0, 2.0, 9), np.linspace(0.0, 1.0, 6), np.linspace(0.0, 0.7, 5)), [4], [2], []
    )[1:]
    grid = grid_of(ahead, below, above)  # the lower one of the first two is cut out
    step, end = (Window.whole(1, below.shape[:3]).face(face) for face in (0, 1))
    planes = find_planes(grid, [step, end], 1.0)
    assert {plane.windows: plane.is_rim for plane in planes} == {(step,): False, (end,): True}
    for plane in planes:
        np.testing.assert_allclose(np.abs(plane.normal), [1.0, 0.0, 0.0], atol=1e-12)


def wall_in_a_plane(dihedral):
    """A swept bump that rises from an oblique plane by an angle (rad), with thin first cells, in numbers of 4 bytes."""
    nodes = box(np.linspace(0.0, 1.0, 41), np.geomspace(5e-6, 1.0, 25) - 5e-6, np.linspace(0.0, 1.0, 4))
    x, y, z = (nodes[..., d].copy() for d in range(3))
    nodes[..., 0] += 0.5 * y
    nodes[..., 2] += 0.1 * np.sin(3.0 * x) * (1.0 - z) + np.tan(dihedral) * y
    turn = Rotation.from_rotvec([0.5, 0.3, -0.4]).as_matrix()
    return grid_of((nodes @ turn.T + 100.0).astype(np.float32))


@pytest.mark.parametrize(("degrees", "is_normal"), [(0.0, True), (17.0, True), (23.0, False)])
def test_a_surface_ends_at_a_right_angle_up_to_twenty_degrees_though_first_cells_have_no_direction(degrees, is_normal):
    grid = wall_in_a_plane(np.radians(degrees))
    side, wall = (Window.whole(0, grid.shapes[0]).face(face) for face in (2, 4))
    (plane,) = find_planes(grid, [side], 1.0)
    assert plane.ends(grid, [wall])
    assert plane.ends_normally(grid, [wall]) is is_normal
    assert plane.ends_normally(grid, [wall], is_curved=True) is is_normal
    assert not plane.ends_normally(grid, [side])
