"""Grids about balls and bricks: every block valid, matched and right-handed, patches where they belong."""

import numpy as np
import pytest

from bspline_mdao import find_topology
from bspline_mdao.errors import InputError
from bspline_mdao.generators import ball_grid, brick_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import report_quality

SHAPE = (7, 6, 5, 8)
GRIDS = {
    "ball": lambda octant: ball_grid(SHAPE, radius=1.5, off_wall=0.02, octant=octant),
    "brick": lambda octant: brick_grid(SHAPE, (4.0, 2.0, 1.0), octant=octant),
}


def wall(grid):
    patch = next(patch for patch in grid.patches if patch.name == "body")
    return np.concatenate([grid.blocks[w.block].nodes[w.slices].reshape(-1, 3) for w in patch.windows])


@pytest.mark.parametrize("octant", [False, True])
@pytest.mark.parametrize("body", GRIDS)
def test_blocks_are_valid_right_handed_and_matched(body, octant):
    grid = GRIDS[body](octant)
    topology, cells = (
        find_topology(grid),
        report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3)),
    )
    assert len(topology.interfaces) == (3 if octant else 12)
    assert topology.near_misses == ()
    assert cells.n_inverted == 0
    assert cells.min_corner > 0.3
    assert all(face.patch is not None for face in topology.boundary)


def test_a_left_handed_block_would_be_seen():
    for block in GRIDS["brick"](False).blocks:
        x = block.nodes
        edges = [np.diff(x, axis=d)[:1, :1, :1].ravel() for d in range(3)]
        assert np.linalg.det(edges) > 0.0


def test_the_body_is_where_it_is_asked_for():
    np.testing.assert_allclose(np.linalg.norm(wall(GRIDS["ball"](False)), axis=1), 1.5, rtol=1e-14)
    brick = wall(GRIDS["brick"](False))
    np.testing.assert_allclose(np.abs(brick / [2.0, 1.0, 0.5]).max(axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(np.ptp(brick, axis=0), [4.0, 2.0, 1.0], rtol=1e-14)


def test_the_first_interval_and_the_outer_boundary_are_as_asked_for():
    block = GRIDS["ball"](False).blocks[3].nodes
    np.testing.assert_allclose(np.linalg.norm(np.diff(block, axis=2)[:, :, 0], axis=-1), 0.02, rtol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(block[:, :, -1], axis=-1), 10.0, rtol=1e-14)


def test_an_octant_ends_on_its_planes():
    grid = GRIDS["brick"](True)
    for axis, name in enumerate("xyz"):
        patch = next(patch for patch in grid.patches if patch.name == f"symmetry_{name}")
        assert patch.kind == "symmetry"
        for window in patch.windows:
            assert np.abs(grid.blocks[window.block].nodes[window.slices][..., axis]).max() == 0.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"shape": (5, 5, 2, 5)}, "four counts of 3"),
        ({"shape": (5, 5, 5)}, "four counts of 3"),
        ({"radius": 3.0, "far": 2.0}, "cuts the body"),
        ({"shape": (5, 5, 5, 5), "off_wall": 20.0}, "do not fit"),
    ],
)
def test_what_does_not_fit_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        ball_grid(**arguments)
