"""Faces of CAD files as our own: points tied to them are nearest, and where the file has them."""

from dataclasses import replace

import numpy as np
import pytest
from cad_cases import BALL, CYLINDER, foreign_file, needs_opencascade

from bspline_mdao import InputError, fit_grid
from bspline_mdao.base.numerics.vectors import lengths
from bspline_mdao.core.cad.nurbs_surface import NurbsSurface
from bspline_mdao.design import TiedSurface
from bspline_mdao.files import read_cad, write_cad
from bspline_mdao.generators import ball_grid, onera_m6_grid


def random_surface(rng):
    """A rational surface of unlike degrees and numbers, with a double knot."""
    knots = np.array([0, 0, 0, 0.3, 0.3, 0.7, 1, 1, 1.0]), np.array([0, 0, 0, 0, 0.4, 1, 1, 1, 1.0])
    net = np.stack(np.meshgrid(np.linspace(0, 2, 6), np.linspace(0, 1, 5), [0.0], indexing="ij"), axis=-1)[:, :, 0]
    return NurbsSurface(knots, (2, 3), net + rng.uniform(-0.1, 0.1, net.shape), rng.uniform(0.5, 2.0, (6, 5)))


@pytest.fixture(scope="module")
def stranger(tmp_path_factory):
    return read_cad(foreign_file(tmp_path_factory.mktemp("cad") / "stranger.step"))


@pytest.fixture(scope="module")
def wing():
    return fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4))


def test_derivatives_of_rational_surfaces_are_exact_and_its_matrix_gives_its_points():
    rng = np.random.default_rng(1)
    surface, uv = random_surface(rng), rng.random((17, 2))
    at, matrix = surface.jets(uv), surface.matrix(uv)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(matrix @ surface.control_points.reshape(-1, 3), at.points, atol=1e-14)
    for axis, step in enumerate(1e-5 * np.eye(2)):
        ahead, behind = surface.jets(uv + step), surface.jets(uv - step)
        np.testing.assert_allclose((ahead.points - behind.points) / 2e-5, at.tangents[:, axis], atol=1e-8)
        np.testing.assert_allclose((ahead.tangents - behind.tangents) / 2e-5, at.second[:, axis], atol=1e-6)


@needs_opencascade
def test_the_faces_of_a_stranger_are_read_with_its_unit_and_numbered(stranger):
    assert stranger.unit == "millimetre"
    assert stranger.face_names == tuple(f"face {n}" for n in range(1, 9))
    assert [face.is_trimmed for face in stranger.body.faces] == [True, True, True, True, False, True, True, False]
    assert stranger.body.faces[7].surface.weights.min() < 0.9  # a ball is rational


@needs_opencascade
def test_places_on_cylinders_and_balls_are_those_of_their_formulas(stranger):
    rng, body = np.random.default_rng(2), stranger.body
    away = rng.normal(size=(40, 3))
    middle, radius = BALL
    around = middle + (radius + 0.05) * away / lengths(away)[:, None]
    tie = body.tie(around)
    np.testing.assert_allclose(body.places(tie), middle + (around - middle) / (radius + 0.05) * radius, atol=1e-9)
    foot, radius, height = CYLINDER
    angle, z = rng.uniform(0.0, 2.0 * np.pi, 40), rng.uniform(0.0, height, 40)
    ring = np.stack([np.cos(angle), np.sin(angle), 0.0 * z], axis=1)
    assert body.distances(foot + radius * ring + z[:, None] * [0.0, 0.0, 1.0]).max() < 1e-12
    over = foot + (radius + 0.03) * ring + [0.0, 0.0, height + 0.04]  # nearest is the rim, where faces are trimmed
    np.testing.assert_allclose(body.distances(over), 0.05, rtol=1e-12)
    np.testing.assert_allclose(body.distances(foot + 0.5 * radius * ring + [0, 0, height + 0.04]), 0.04, rtol=1e-12)


@needs_opencascade
def test_distances_from_trimmed_faces_are_those_of_opencascade(stranger):
    rng = np.random.default_rng(3)
    points = rng.uniform([-0.2, -0.2, -0.1], [1.2, 0.2, 1.6], (120, 3))
    ours, theirs = stranger.body.distances(points), stranger.distances(points)
    assert theirs.max() > 0.3
    tolerance = max(face.tolerance for face in stranger.body.faces)  # of its edges: OpenCascade's cut is so close
    assert np.abs(ours - theirs).max() < 2.0 * tolerance
    assert np.median(np.abs(ours - theirs)) < 1e-10


@needs_opencascade
def test_the_wall_of_the_m6_is_on_its_own_step_file_to_1e7_of_the_chord(wing, tmp_path):
    write_cad(tmp_path / "wing.step", wing, tolerance=1e-6)
    tied = TiedSurface.of(wing, tmp_path / "wing.step")
    missed = lengths(wing.residual_at(tied.surface.rows))
    assert tied.distances.max() <= missed.max()  # what the fit misses is not in the file
    of_splines = tied.surface.points - wing.residual_at(tied.surface.rows)
    assert tied.body.distances(of_splines).max() < 1e-7 * 0.8059
    assert set(tied.body.names) == {"wing_upper", "wing_lower"}
    upper = tied.surface.part("wing_upper")
    inside = np.setdiff1d(tied.surface.parts[upper[0]], tied.surface.parts[tied.surface.part("wing_lower")[0]])
    assert {tied.body.names[n] for n in tied.tie.faces[inside]} == {"wing_upper"}


@needs_opencascade
def test_a_grid_in_millimetres_goes_to_a_file_and_comes_from_it_as_large_as_it_is(tmp_path):
    grid = onera_m6_grid((9, 9, 7))
    blocks = tuple(replace(block, nodes=1000.0 * block.nodes) for block in grid.blocks)
    large = fit_grid(replace(grid, blocks=blocks, unit="mm"), n_control=(6, 5, 4))
    report = write_cad(tmp_path / "wing.step", large, tolerance=1e-5, units="in")
    assert report.n_on_symmetry == report.n_open == 2
    assert read_cad(tmp_path / "wing.step").body.size < 3.0  # metres
    tied = TiedSurface.of(large, tmp_path / "wing.step")
    assert 1.0 < tied.distances.max() <= 1000.0 * report.missed  # millimetres


@needs_opencascade
def test_walls_far_from_the_faces_are_refused_with_the_place_and_the_unit(tmp_path):
    ball = fit_grid(ball_grid((9, 9, 9, 9)))
    write_cad(tmp_path / "ball.step", ball)
    with pytest.raises(
        InputError, match=r"the node at \(.*\) of .* is .* m off its faces, more than 0.01 of the walls'"
    ):
        TiedSurface.of(ball, read_cad(tmp_path / "ball.step").body.scaled(1.05))
    with pytest.raises(InputError, match=r"give a scale: the faces are 1e\+03 times as large as the walls"):
        TiedSurface.of(ball, tmp_path / "ball.step", scale=1000.0)


@needs_opencascade
def test_parameters_of_nearest_points_change_as_newtons_method_says(stranger):
    rng, body = np.random.default_rng(4), stranger.body
    face = body.faces[7]
    away = rng.normal(size=(9, 3))
    points = BALL[0] + 0.36 * away / lengths(away)[:, None]
    found, change = face.nearest(points), rng.normal(size=(9, 3))
    rates = np.einsum("nic,nc->ni", face.rates(found.uv, points, found.on_edge), change)
    moved = [face.nearest(points + side * 1e-6 * change).uv for side in (1.0, -1.0)]
    np.testing.assert_allclose(rates, (moved[0] - moved[1]) / 2e-6, atol=1e-6 * np.abs(rates).max())
