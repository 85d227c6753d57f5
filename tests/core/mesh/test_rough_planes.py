"""Planes of symmetry that are rough: grids in numbers of 4 bytes, turned and far from the origin, move all the same."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bspline_mdao import InputError, fit_grid
from bspline_mdao.base.numerics.mean_planes import mean_planes, near_enough
from bspline_mdao.core.fit.surface_fit import SurfaceFollower
from bspline_mdao.core.mesh.boundary import symmetry_planes
from bspline_mdao.core.walls.wall_correction import WallCorrection
from bspline_mdao.design import parse_deformation
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.node_numbering import face_rows
from bspline_mdao.measures import EnclosedVolume, SurfaceGrid
from bspline_mdao.movers import Rotations, moving_mesh

TURN = Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix()
FAR_AWAY = np.array([90.0, 150.0, 1400.0])
SHAPE = ((7, 9, 7), 11, (9, 7))
"""Cells next to the wing are small faces of its plane of symmetry."""


def rough_grid(bump=0.0):
    """A wing's grid in a turned frame far away, kept in numbers of 4 bytes; one node is off by a bump."""
    grid, blocks = onera_m6_grid(SHAPE), []
    for number, block in enumerate(grid.blocks):
        nodes = block.nodes.copy()
        if number == 1:
            nodes[3, 5, 0, 2] += bump
        far_away = nodes @ TURN.T + FAR_AWAY
        blocks.append(replace(block, nodes=far_away.astype(np.float32).astype(float) - FAR_AWAY))
    return replace(grid, blocks=tuple(blocks))


@pytest.mark.slow
def test_a_rough_plane_of_symmetry_slides_and_each_node_keeps_its_offset():
    model = fit_grid(rough_grid())
    mesh, surface = moving_mesh(model), SurfaceGrid.of(model)
    rows = [face_rows(model.topology, f.window).ravel() for f in model.topology.boundary if f.kind == "symmetry"]
    rows, at_rest = np.unique(np.concatenate(rows)), model.regenerate().to_vector().reshape(-1, 3)
    (normal,) = mesh.plane_normals
    assert abs(abs(normal @ TURN[:, 2]) - 1.0) < 1e-10
    offsets = at_rest[rows] @ normal
    roughness = np.ptp(offsets)
    assert roughness > 2e-6 * np.ptp(at_rest, axis=0).max()
    deformation = parse_deformation("twist=5deg", model, mesh)
    wall = deformation.apply_to_nodes(surface.points, surface.on_planes(model))
    points = SurfaceFollower.of(model, mesh, surface).at(wall).control_points
    moved = Rotations(mesh).move(model.control_points, points).points
    grid_map = model.grid_map().meeting(WallCorrection.of(model.topology, at_rest, surface.rows))
    nodes = grid_map.at(moved, wall).nodes
    assert np.linalg.norm(nodes[rows] - at_rest[rows], axis=1).max() > 0.01
    np.testing.assert_allclose(nodes[rows] @ normal, offsets, rtol=0.0, atol=1e-4 * roughness)


@pytest.mark.slow
def test_measures_close_a_body_at_a_rough_plane():
    rough, exact = (SurfaceGrid.of(fit_grid(grid)) for grid in (rough_grid(), onera_m6_grid(SHAPE)))
    volumes = [EnclosedVolume.of(surface).evaluate(surface.points)[0] for surface in (rough, exact)]
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-3)


@pytest.mark.slow
def test_a_plane_with_a_bump_is_refused():
    model = fit_grid(rough_grid(bump=0.02))
    with pytest.raises(InputError, match="is of kind symmetry, but leaves its plane"):
        moving_mesh(model)


@pytest.mark.parametrize("seed", range(3))
def test_parts_of_one_plane_share_it_and_parallel_ones_do_not(seed):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng).as_matrix()
    parts = [rng.uniform(0.0, size, (n, 3)) for size, n in ((9.0, 40), (0.01, 5), (0.1, 30), (7.0, 25))]
    for part, z in zip(parts, (0.0, 0.0, 2.0, 2.0)):
        part[:, 2] = z + 1e-6 * rng.uniform(-9.0, 9.0, len(part))
    turned = [part @ turn.T for part in parts]
    planes = mean_planes(turned)
    assert planes[0] is planes[1] is not planes[2]
    assert planes[2] is planes[3]
    for plane, z in zip(planes, (0.0, 0.0, 2.0, 2.0)):
        side = np.sign(plane.normal @ turn[:, 2])
        np.testing.assert_allclose(side * plane.normal, turn[:, 2], atol=1e-5)
        assert side * plane.offset == pytest.approx(z, abs=1e-5)
        assert plane.roughness < near_enough(turned)
    parts[1][0, 2] += 1e-3
    bumpy = [part @ turn.T for part in parts]
    assert mean_planes(bumpy)[1].roughness > near_enough(bumpy) or mean_planes(bumpy)[1] is not mean_planes(bumpy)[0]


@pytest.mark.slow
def test_planes_of_control_points_are_shared_by_their_faces():
    planes = symmetry_planes(fit_grid(rough_grid()))
    assert len(planes) == 6
    assert all((normal == planes[0][0]).all() and offset == planes[0][1] for normal, offset, _ in planes)
