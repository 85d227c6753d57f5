from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from inversion_cases import row_of_volumes, sample, sector, single
from scipy.spatial import cKDTree
from splines_cases import random_bilinear_knots, wavy_knots

from bspline_mdao.core.evaluation.closest_point import bilinear_corners, map_point, map_point_scratch
from bspline_mdao.core.evaluation.inversion import embed_points, invert_points, require_inside
from bspline_mdao.core.splines.knots import ConstantKnots
from bspline_mdao.core.splines.mesh import BSplineMesh
from bspline_mdao.core.splines.volume import Volume, evaluate, evaluate_gradients
from bspline_mdao.errors import InputError


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def positions(mesh, control_points, inversion):
    """Where the parameters of an inversion are in space, by the splines' own evaluation."""
    points = np.empty((inversion.n_points, 3))
    for v, (volume, net) in enumerate(zip(mesh.volumes, mesh.nets(control_points))):
        points[inversion.volume == v] = evaluate(volume, net, inversion.parameters[inversion.volume == v])
    return points


def assert_found(mesh, control_points, points, tolerance=1e-12):
    inversion = invert_points(mesh, control_points, points)
    assert inversion.is_inside.all()
    assert np.abs(positions(mesh, control_points, inversion) - points).max() <= tolerance
    assert inversion.distance.max() <= tolerance
    assert inversion.parameters.min() >= 0
    assert inversion.parameters.max() <= 1
    return inversion


@pytest.mark.slow
@pytest.mark.parametrize("orders", [(4, 3, 5), (2, 4, 3), (5, 2, 4), (3, 5, 2), (6, 6, 6), (1, 2, 2)])
def test_single_point_mapping_agrees_with_that_of_many_points(rng, orders):
    volume = Volume(tuple(random_bilinear_knots(rng, p, n) for p, n in zip(orders, (2, 3, 4))))
    net = rng.standard_normal((*volume.n_control, 3))
    corners = tuple(bilinear_corners(knots) for knots in volume.knots)
    scratch = map_point_scratch(corners, net)
    position, jacobian = np.empty(3), np.empty((3, 3))
    for xi in rng.random((20, 3)):
        map_point(corners, net, xi, scratch, position, jacobian)
        np.testing.assert_allclose(position, evaluate(volume, net, xi[None])[0], atol=1e-13)
        np.testing.assert_allclose(jacobian, evaluate_gradients(volume, net, xi[None])[0], atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("orders", [(4, 3, 5), (2, 4, 3), (5, 2, 4), (4, 4, 4)])
def test_random_points_of_curved_volumes_are_found_to_round_off(rng, orders):
    mesh, control_points = row_of_volumes(rng, orders)
    parameters = rng.random((2000, 3))
    inversion = assert_found(mesh, control_points, sample(mesh, control_points, parameters))
    np.testing.assert_array_equal(inversion.volume, np.repeat([0, 1, 2], 2000))
    np.testing.assert_allclose(inversion.parameters, np.tile(parameters, (3, 1)), atol=1e-11)


@pytest.mark.parametrize("spacing", [1e-3, 1e-6])
def test_points_are_found_in_layers_as_thin_as_1e_minus_6(rng, spacing):
    mesh, control_points = row_of_volumes(rng, (4, 4, 4), (3, 3, 6), spacing=spacing)
    parameters = rng.random((3000, 3))
    parameters[:2000, 2] = (0.1 * spacing) ** rng.random(2000)
    assert_found(mesh, control_points, sample(mesh, control_points, parameters))


def test_left_handed_volumes_are_no_different(rng):
    mesh, control_points = row_of_volumes(rng)
    mirrored = control_points * [1, 1, -1]
    assert_found(mesh, mirrored, sample(mesh, mirrored, rng.random((1000, 3))))


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e-6, 0.0])
@pytest.mark.parametrize("angle", [1.5 * np.pi, 2 * np.pi, 0.1])
def test_points_at_every_distance_from_a_collapsed_face_are_found(rng, scale, angle):
    mesh, control_points = sector(rng, angle=angle)
    points = sample(mesh, control_points, rng.random((2000, 3)) * [scale, 1, 1])
    assert_found(mesh, control_points, points)


def test_almost_all_points_are_found_where_columns_of_the_jacobian_become_parallel(rng):
    mesh, control_points = sector(rng, shear=0.3)
    points = sample(mesh, control_points, rng.random((2000, 3)) * [1e-6, 1, 1])
    assert (invert_points(mesh, control_points, points).distance <= 1e-12).mean() > 0.97


def test_points_near_a_face_collapsed_to_a_single_point_are_found(rng):
    volume = Volume(tuple(random_bilinear_knots(rng, p, 3) for p in (4, 3, 4)))
    n0, n1, n2 = volume.n_control
    r, a, b = np.meshgrid(np.linspace(0, 1, n0), np.linspace(-0.6, 0.6, n1), np.linspace(-0.5, 0.5, n2), indexing="ij")
    mesh, control_points = single(volume, np.stack([r, r * np.tan(a), r * np.tan(b)], axis=-1))
    for scale in (1.0, 1e-4, 0.0):
        assert_found(mesh, control_points, sample(mesh, control_points, rng.random((500, 3)) * [scale, 1, 1]))


def test_corners_edges_and_faces_are_found(rng):
    mesh, control_points = row_of_volumes(rng)
    parameters = np.array(np.meshgrid([0, 0.3, 1], [0, 0.6, 1], [0, 0.8, 1])).reshape(3, -1).T
    assert_found(mesh, control_points, sample(mesh, control_points, parameters))


def test_points_of_an_interface_belong_to_the_lowest_volume(rng):
    mesh, control_points = row_of_volumes(rng)
    parameters = rng.random((500, 3))
    parameters[:, 0] = 0
    points = sample(mesh, control_points, parameters)
    inversion = assert_found(mesh, control_points, points)
    np.testing.assert_array_equal(inversion.volume, np.repeat([0, 0, 1], 500))
    backwards = BSplineMesh(mesh.volumes[::-1], mesh.control_ids[::-1], mesh.n_control_points)
    inversion = assert_found(backwards, control_points, points)
    np.testing.assert_array_equal(inversion.volume, np.repeat([2, 1, 0], 500))


def test_two_plane_volumes_are_inverted(rng):
    volume = Volume((random_bilinear_knots(rng, 4, 3), random_bilinear_knots(rng, 3, 4), ConstantKnots.uniform(2, 2)))
    x, y, z = np.meshgrid(*(np.linspace(0, e, n) for e, n in zip((1, 2, 1e-3), volume.n_control)), indexing="ij")
    mesh, control_points = single(volume, np.stack([x, y + 0.2 * x * x, z], axis=-1))
    assert_found(mesh, control_points, sample(mesh, control_points, rng.random((1000, 3))))


def surface(rng):
    volume = Volume.of(random_bilinear_knots(rng, 4, 4), random_bilinear_knots(rng, 3, 5))
    x, y, _ = np.meshgrid(*(np.linspace(0, e, n) for e, n in zip((1, 2, 0), volume.n_control)), indexing="ij")
    return single(volume, np.stack([x, y, 0.2 * np.sin(3 * x) * np.cos(2 * y)], axis=-1))


def test_surfaces_keep_the_parameter_of_their_missing_direction(rng):
    mesh, control_points = surface(rng)
    inversion = assert_found(mesh, control_points, sample(mesh, control_points, rng.random((1000, 3)) * [1, 1, 0]))
    assert not inversion.parameters[:, 2].any()


def test_points_off_a_surface_get_the_closest_point_of_it(rng):
    mesh, control_points = surface(rng)
    points = sample(mesh, control_points, rng.random((400, 3)) * [1, 1, 0]) + 0.1 * rng.standard_normal((400, 3))
    lattice = np.stack(np.meshgrid(np.linspace(0, 1, 300), np.linspace(0, 1, 300), [0.0], indexing="ij"), axis=-1)
    nearest, _ = cKDTree(sample(mesh, control_points, lattice.reshape(-1, 3))).query(points)
    inversion = invert_points(mesh, control_points, points)
    assert not inversion.is_inside.any()
    assert (inversion.distance <= nearest + 1e-12).all()
    assert (inversion.distance >= nearest - 0.01).all()
    np.testing.assert_allclose(
        np.linalg.norm(positions(mesh, control_points, inversion) - points, axis=1), inversion.distance, atol=1e-13
    )


@pytest.mark.slow
def test_points_outside_volumes_get_the_closest_point_of_all_of_them(rng):
    mesh, control_points = row_of_volumes(rng)
    points = rng.uniform(-1, 4, (2000, 3))
    lattice = np.stack(np.meshgrid(*[np.linspace(0, 1, 40)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    nearest, _ = cKDTree(sample(mesh, control_points, lattice)).query(points)
    inversion = invert_points(mesh, control_points, points)
    assert 0 < inversion.is_inside.sum() < 2000
    assert (inversion.distance >= np.where(inversion.is_inside, 0, nearest - 0.05)).all()
    assert (inversion.distance <= nearest + 0.05).all()
    assert (inversion.distance <= nearest + 1e-12).mean() > 0.995


def test_points_outside_are_named(rng):
    mesh, control_points = row_of_volumes(rng)
    points = sample(mesh, control_points, rng.random((20, 3)))
    points[[16, 40, 41, 59]] += [0, 0, 9]
    inversion = invert_points(mesh, control_points, points)
    with pytest.raises(
        InputError, match=r"^probes: 4 of 60 points lie outside all volumes: point 17 at distance \d"
    ) as e:
        require_inside(inversion, "probes")
    assert "point 41 at" in str(e.value)
    assert "\n" not in str(e.value)
    assert "point 60 at" not in str(e.value)
    np.testing.assert_array_equal(np.flatnonzero(~inversion.is_inside), [16, 40, 41, 59])


def test_tolerance_decides_what_is_inside(rng):
    mesh, control_points = surface(rng)
    points = sample(mesh, control_points, [[0.4, 0.7, 0.0]]) + [0, 0, 1e-3]
    assert not invert_points(mesh, control_points, points).is_inside[0]
    inversion = invert_points(mesh, control_points, points, tolerance=1e-3)
    assert require_inside(inversion) is inversion


@pytest.mark.slow
def test_knots_that_are_functions_of_the_user_are_followed_too(rng):
    volume = Volume((random_bilinear_knots(rng, 4, 3), wavy_knots(3), random_bilinear_knots(rng, 3, 2)))
    axes = [np.linspace(0, 1, n) for n in volume.n_control]
    mesh, control_points = single(volume, np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    control_points = control_points + 0.02 * rng.standard_normal(control_points.shape)
    assert_found(mesh, control_points, sample(mesh, control_points, rng.random((500, 3))))


def test_both_ways_of_descending_take_the_same_steps(rng, monkeypatch):
    mesh, control_points = row_of_volumes(rng)
    points = np.concatenate([sample(mesh, control_points, rng.random((200, 3))), rng.uniform(-1, 4, (50, 3))])
    one_by_one = invert_points(mesh, control_points, points)
    monkeypatch.setattr("bspline_mdao.core.evaluation.closest_point.bilinear_corners", lambda knots: None)
    together = invert_points(mesh, control_points, points)
    np.testing.assert_array_equal(together.volume, one_by_one.volume)
    np.testing.assert_allclose(together.parameters, one_by_one.parameters, atol=1e-6)
    np.testing.assert_allclose(together.distance, one_by_one.distance, atol=1e-11)


def test_points_can_be_inverted_from_several_threads_of_the_caller(rng):
    mesh, control_points = row_of_volumes(rng)
    points = sample(mesh, control_points, rng.random((300, 3)))
    with ThreadPoolExecutor(3) as pool:
        results = [job.result() for job in [pool.submit(invert_points, mesh, control_points, points) for _ in range(6)]]
    for result in results:
        assert result.is_inside.all()
        np.testing.assert_array_equal(result.parameters, results[0].parameters)


def test_results_are_the_same_bits_on_any_number_of_threads_and_in_any_company(rng):
    mesh, control_points = row_of_volumes(rng)
    points = np.concatenate([sample(mesh, control_points, rng.random((500, 3))), rng.uniform(-1, 4, (100, 3))])
    first = invert_points(mesh, control_points, points, n_threads=3)
    second = invert_points(mesh, control_points, points[::-1], n_threads=1)
    for name in ("volume", "parameters", "distance", "is_inside"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name)[::-1])


def test_chunks_do_not_change_anything(rng, monkeypatch):
    mesh, control_points = row_of_volumes(rng)
    points = sample(mesh, control_points, rng.random((100, 3)))
    whole = invert_points(mesh, control_points, points)
    monkeypatch.setattr("bspline_mdao.core.evaluation.inversion.CHUNK", 17)
    np.testing.assert_array_equal(invert_points(mesh, control_points, points).parameters, whole.parameters)


def test_a_denser_grid_rides_on_the_control_mesh(rng):
    mesh, control_points = row_of_volumes(rng, spacing=1e-3)
    axes = [np.linspace(0, 1, n) for n in (9, 7, 11)]
    parameters = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inversion = assert_found(mesh, control_points, sample(mesh, control_points, parameters))
    evaluator = embed_points(mesh, inversion)
    moved = control_points + 0.05 * rng.standard_normal(control_points.shape)
    np.testing.assert_allclose(evaluator.forward(moved), sample(mesh, moved, parameters), atol=1e-10)


@pytest.mark.slow
def test_riding_points_pass_the_dot_test(rng):
    mesh, control_points = row_of_volumes(rng)
    evaluator = embed_points(
        mesh, invert_points(mesh, control_points, sample(mesh, control_points, rng.random((50, 3))))
    )
    direction, bar = rng.standard_normal(control_points.shape), rng.standard_normal((150, 3))
    assert np.vdot(bar, evaluator.forward(direction)) == pytest.approx(
        np.vdot(evaluator.adjoint(bar), direction), rel=1e-12
    )


def test_no_points_are_no_problem(rng):
    mesh, control_points = row_of_volumes(rng)
    inversion = invert_points(mesh, control_points, np.empty((0, 3)))
    assert inversion.n_points == 0
    assert inversion.parameters.shape == (0, 3)
    require_inside(inversion)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((4, 2)), r"shape \(4, 2\)"),
        (np.zeros(3), r"shape \(3,\)"),
        ([[0, 0, 0], [0, np.nan, 0]], "point 2 of 2 is not finite"),
        ([[0, np.inf, 0]], "point 1 of 1 is not finite"),
    ],
)
def test_unusable_points_are_refused_in_one_line(rng, points, message):
    mesh, control_points = row_of_volumes(rng)
    with pytest.raises(InputError, match=message) as e:
        invert_points(mesh, control_points, points)
    assert "\n" not in str(e.value)


def test_control_points_of_another_mesh_are_refused(rng):
    mesh, control_points = row_of_volumes(rng)
    with pytest.raises(InputError, match="control points"):
        invert_points(mesh, control_points[1:], control_points)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hh_naca0012_12blocks.xyz", "bluntfin", "cfl3d_cylinder_ogrid.fmt"])
def test_fitted_nodes_of_real_grids_are_inverted_again(real_grids, name):
    from bspline_mdao.core.fit.fitting import fit_grid
    from bspline_mdao.grids.io.files import read_grid

    path = next(p for p in sorted(real_grids.iterdir()) if name in p.name)
    model = fit_grid(read_grid(path))
    nets = model.mesh.nets(model.control_points)
    points = [
        evaluate(volume, net, parameters.reshape(-1, 3))
        for volume, net, parameters in zip(model.mesh.volumes, nets, model.parameters)
    ]
    extent = np.linalg.norm(np.ptp(model.control_points, axis=0))
    assert_found(model.mesh, model.control_points, np.concatenate(points), tolerance=1e-12 * extent)
