"""Normals of parts of planes."""

import numpy as np

from bspline_mdao.core.walls.planes import PlaneNormal
from bspline_mdao.grids.topology.boundary_surface import quads_in_turn


def sheet(back: bool) -> np.ndarray:
    """Points of a sheet of two by four quads, which comes back to where it began or goes on."""
    x = np.array([0.0, 1.0, 2.0, 1.0, 0.0]) if back else np.arange(5.0)
    return np.stack([*np.meshgrid(np.arange(3.0), x, indexing="ij"), np.zeros((3, 5))], axis=-1).reshape(-1, 3)


def test_a_part_that_comes_back_to_where_it_began_has_no_normal_and_no_warning():
    normal_of = PlaneNormal.of_quads(quads_in_turn(np.arange(15).reshape(3, 5)))
    normal, area = normal_of.normal_and_area(sheet(back=False))
    assert (normal.tolist(), area) == ([0.0, 0.0, 1.0], 8.0)
    normal, area = normal_of.normal_and_area(sheet(back=True))  # such as both sides of a wake
    assert (normal.tolist(), area) == ([0.0, 0.0, 0.0], 0.0)
