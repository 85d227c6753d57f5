"""Seams stay smooth along their whole length, whatever the variables do: on balls, at noses, at poles."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from seam_cases import globe_grid

from bspline_mdao import InputError, fit_grid
from bspline_mdao.constraints import TangentContinuity
from bspline_mdao.core.design.elimination import eliminate
from bspline_mdao.core.design.selection import InBox
from bspline_mdao.core.mesh.seams import poles_of_mesh, seams_of_mesh
from bspline_mdao.generators import ball_grid, brick_grid, onera_m6_grid
from bspline_mdao.measures import seam_continuity
from bspline_mdao.movers import moving_mesh


def kinks_along(mesh, points, n_places=101):
    """Angles (deg) between both sides of all seams at many places, shape (n_seams, n_places), by their own formula."""
    found, t = [], np.linspace(0.0, 1.0, n_places + 2)[1:-1]
    for seam in seams_of_mesh(mesh):
        own, jets = points[seam.first.line(0)], [edge.weights(t) for edge in (seam.first, seam.second)]
        sides = [w[0] @ points[e.line(1)] + w[1] @ own for w, e in zip(jets, (seam.first, seam.second))]
        tangent = jets[0][2] @ own
        a, b = np.cross(sides[0], tangent), np.cross(tangent, sides[1])
        found.append(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1))))
    return np.array(found)


def moved_at_random(mesh, constraint, points, size):
    elimination = eliminate(mesh, points, [constraint])
    d = size * np.random.default_rng(3).normal(size=points.shape)
    return points + (elimination.matrix @ d.ravel()).reshape(-1, 3), points + d


def ball(n):
    mesh = moving_mesh(fit_grid(ball_grid((2 * n - 1, 2 * n - 1, 2 * n - 1, 5)), n_control=(n, n, 4)))
    return mesh, surface_of(mesh)


@pytest.fixture(scope="module")
def coarse():
    return ball(5)


@pytest.fixture(scope="module")
def fine():
    return ball(9)


@pytest.fixture(scope="module")
def wing():
    return moving_mesh(fit_grid(onera_m6_grid((17, 13, 13)), n_control=(13, 7, 7)))


def surface_of(mesh):
    return mesh.points[mesh.surface_ids]


def test_with_one_inner_knot_the_whole_seam_stays_smooth_to_round_off(coarse):
    mesh, points = coarse
    smooth = TangentContinuity().snapped(mesh, points)
    assert kinks_along(mesh, points).max() > 1.0
    assert 1e-5 < np.abs(smooth - points).max() < 0.01
    assert kinks_along(mesh, smooth).max() < 1e-8
    held, free = moved_at_random(mesh, TangentContinuity(), smooth, 0.02)
    assert kinks_along(mesh, held).max() < 1e-8
    assert kinks_along(mesh, free).max() > 20.0


@pytest.mark.slow
def test_with_many_knots_kinks_along_the_seam_fall_with_the_tolerance_and_so_does_freedom(fine):
    mesh, points = fine
    smooth = TangentContinuity().snapped(mesh, points)
    kinks, ranks = [], []
    for tolerance in (0.1, 1e-2, 1e-3, 1e-8):
        constraint = TangentContinuity(tolerance=tolerance)
        held, free = moved_at_random(mesh, constraint, smooth, 0.01)
        kinks.append(kinks_along(mesh, held).max())
        ranks.append(constraint.equations(mesh, smooth).matrix.shape[0])
    assert kinks_along(mesh, free).max() > 60.0
    assert (np.array(kinks) < [0.6, 0.15, 0.01, 0.01]).all()
    assert ranks == sorted(ranks)
    assert ranks[0] < ranks[1] < ranks[2]


@pytest.mark.slow
def test_the_nose_of_a_wing_stays_round_though_its_grid_lines_are_oblique_and_its_knots_curved(wing):
    points, constraint = surface_of(wing), TangentContinuity(max_kink=30.0, mirror=False)
    nose = np.median(kinks_along(wing, points), axis=1).argmin()
    smooth = constraint.snapped(wing, points)
    part = slice(0, 85)  # the other end runs into the edge of the tip
    assert 5.0 < kinks_along(wing, points)[nose, part].max() < 30.0
    assert np.abs(smooth - points).max() < 0.004
    assert kinks_along(wing, smooth)[nose, part].max() < 0.2
    held, free = moved_at_random(wing, constraint, smooth, 2e-4)
    assert kinks_along(wing, held)[nose, part].max() < 0.2
    assert kinks_along(wing, free)[nose, part].max() > 10.0
    assert np.abs(held[wing.in_plane_rows, 2]).max() < 1e-12  # the root stays on the symmetry plane


def kinks_to_the_image(model, mesh, surface):
    """Largest kink (deg) between a surface and its mirror image, as `seam_continuity` measures it."""
    points = model.control_points.copy()
    points[mesh.surface_ids] = surface
    own, all_ = (seam_continuity(model, points, mirror=mirror) for mirror in (False, True))
    images = [seam for seam in all_ if seam.names[1] == "its mirror image"]
    assert len(all_) == len(own) + len(images)
    for seam in images:  # the image is bent alike
        np.testing.assert_allclose(seam.curvatures[:, 0], seam.curvatures[:, 1], rtol=1e-9, atol=1e-9)
    return max(seam.max_kink for seam in images)


@pytest.mark.slow
def test_a_surface_stays_smooth_to_its_mirror_image_and_does_not_without():
    model = fit_grid(ball_grid((9, 9, 9, 5), octant=True), n_control=(5, 5, 4))
    mesh = moving_mesh(model)
    points, kinks = surface_of(mesh), {}
    assert 0.05 < kinks_to_the_image(model, mesh, points) < 0.2
    for mirror in (True, False):
        constraint = TangentContinuity(tolerance=1e-3, mirror=mirror)
        smooth = constraint.snapped(mesh, points)
        held, free = moved_at_random(mesh, constraint, smooth, 0.02)
        across = np.einsum("nd,nd->n", held[mesh.in_plane_rows], mesh.in_plane_normals)
        assert np.abs(across).max() < 1e-15  # all three planes pass through the middle
        kinks[mirror] = [kinks_to_the_image(model, mesh, surface) for surface in (smooth, held, free)]
    assert kinks[True][0] < 1e-3 < 0.5 < kinks[False][0]
    assert kinks[True][1] < 0.1 < 10.0 < kinks[False][1]
    assert kinks[True][2] > 10.0


def test_a_stretch_across_planes_of_symmetry_passes():
    mesh = moving_mesh(fit_grid(ball_grid((9, 9, 9, 5), octant=True), n_control=(5, 5, 4)))
    smooth = TangentContinuity().snapped(mesh, surface_of(mesh))
    stretched = smooth * [1.3, 0.8, 1.1]
    elimination = eliminate(mesh, smooth, [TangentContinuity()])
    np.testing.assert_allclose(elimination.matrix @ stretched.ravel(), stretched.ravel(), atol=1e-9)


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_where_grid_lines_leave_planes_upright_edges_stay_upright_to_round_off_however_the_planes_lie(turn):
    axes = Rotation.from_rotvec(turn * np.array([1.0, -2.0, 0.7])).as_matrix()
    grid = brick_grid((9, 7, 8, 6), octant=True)
    model = fit_grid(replace(grid, blocks=tuple(replace(block, nodes=block.nodes @ axes) for block in grid.blocks)))
    mesh = moving_mesh(model)
    held, free = moved_at_random(mesh, TangentContinuity(), surface_of(mesh), 0.02)
    assert kinks_to_the_image(model, mesh, held) < 1e-6 < 10.0 < kinks_to_the_image(model, mesh, free)


def test_kinks_that_a_fit_has_do_not_grow_with_what_variables_do(coarse):
    mesh, points = coarse
    held, _ = moved_at_random(mesh, TangentContinuity(), points, 0.01)
    assert kinks_along(mesh, held).max() < 1.2 * kinks_along(mesh, points).max()


def test_any_affine_move_is_smooth_and_passes(coarse):
    mesh, points = coarse
    smooth = TangentContinuity().snapped(mesh, points)
    elimination = eliminate(mesh, smooth, [TangentContinuity()])
    affine = smooth @ np.random.default_rng(1).normal(size=(3, 3)) + [1.0, 2.0, 3.0]
    np.testing.assert_allclose(elimination.matrix @ affine.ravel(), affine.ravel(), atol=1e-9)


def test_a_part_of_a_seam_is_smooth_where_it_is_asked_for(fine):
    mesh, points = fine
    smooth = TangentContinuity().snapped(mesh, points)
    top = InBox(low=(None, None, 0.4))
    held, _ = moved_at_random(mesh, TangentContinuity(top, tolerance=1e-3), smooth, 0.01)
    kinks = kinks_along(mesh, held)
    is_top = np.array([surface_of(mesh)[s.first.line(0), 2].min() > 0.4 for s in seams_of_mesh(mesh)])
    assert is_top.sum() == 4
    assert kinks[is_top].max() < 0.02 < 10.0 < kinks[~is_top].max()


def out_of_plane(pole, points):
    legs = points[pole.ring] - points[pole.at]
    legs /= np.linalg.norm(legs, axis=1)[:, None]
    return np.degrees(np.arcsin(np.abs(legs @ np.linalg.svd(legs)[2][2]).max()))


def test_poles_stay_smooth_with_the_seams_that_run_into_them():
    mesh = moving_mesh(fit_grid(globe_grid(), n_control=(5, 7, 4)))
    points, poles = surface_of(mesh), poles_of_mesh(mesh)
    assert [len(pole.ring) for pole in poles] == [16, 16]
    smooth = TangentContinuity().snapped(mesh, points)
    held, free = moved_at_random(mesh, TangentContinuity(), smooth, 0.02)
    for pole in poles:
        assert out_of_plane(pole, points) > 0.1
        assert out_of_plane(pole, free) > 5.0
        assert out_of_plane(pole, held) < 1e-8
    assert kinks_along(mesh, free).max() > 30.0
    assert kinks_along(mesh, held).max() < 1e-8


def test_a_tolerance_that_makes_no_sense_is_refused():
    with pytest.raises(InputError, match=r"'seams': a tolerance of 0; give 1e-12 to 0\.1"):
        TangentContinuity(tolerance=0.0, name="seams")
