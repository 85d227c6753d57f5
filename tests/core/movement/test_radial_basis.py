from dataclasses import replace

import numpy as np
import pytest
import scipy.stats
from mover_cases import (
    assert_derivative_is_exact,
    assert_derivative_is_transposed,
    bent_surface,
    both_sides,
    channel,
    channel_grid,
    in_symmetry,
    mesh_of,
    oblique_channel,
    opened,
    plate,
    rotation,
    wing,
)
from scipy.interpolate import RBFInterpolator

from bspline_mdao.core.movement.interpolation import find_centres
from bspline_mdao.core.movement.radial_basis import (
    COMPACT,
    GLOBAL,
    MOST_CENTRES,
    NEEDS_LINEAR,
    RadialBasis,
    radial_interpolation,
    radial_matrix,
    radial_sums,
    radial_sums_jvp,
)
from bspline_mdao.errors import InputError, MovementError

SMOOTH_RADIUS = {"gaussian": 0.1, "multiquadric": 0.1, "inverse multiquadric": 0.1}
"""Infinitely smooth functions give systems near singular where they are wide."""


def mover_of(mesh, kernel="wendland c2", **options):
    return RadialBasis(mesh, kernel, SMOOTH_RADIUS.get(kernel, 0.5), **options)


@pytest.mark.parametrize("kernel", [*COMPACT, *GLOBAL])
def test_displacements_of_all_centres_are_matched(kernel):
    random = np.random.default_rng(0)
    centres, displacement = random.normal(size=(40, 3)), random.normal(size=(40, 3))
    made = radial_interpolation(kernel, 1.0, kernel in NEEDS_LINEAR, centres.copy(), centres, displacement)
    np.testing.assert_allclose(made.values, displacement, atol=1e-10)
    assert made.report.residual < 1e-10


@pytest.mark.parametrize("kernel", ["wendland c2", "volume", "thin plate", "multiquadric", "inverse multiquadric"])
@pytest.mark.parametrize("n_centres", [4, 23])
def test_strengths_solve_the_bordered_system(kernel, n_centres):
    random = np.random.default_rng(n_centres)
    centres, right = random.normal(size=(n_centres, 3)), random.normal(size=(n_centres + 4, 5))
    functions = radial_matrix((*COMPACT, *GLOBAL).index(kernel), 1.3, centres)
    terms = np.column_stack([np.ones(n_centres), centres])
    made = radial_interpolation(kernel, 1.3, True, centres, centres, right[:n_centres, :3].copy())
    whole = np.block([[functions, terms], [terms.T, np.zeros((4, 4))]])
    np.testing.assert_allclose(made.system.solve(right), np.linalg.solve(whole, right), rtol=0, atol=1e-9)


def test_volume_splines_are_those_of_scipy():
    random = np.random.default_rng(3)
    centres, displacement, targets = (random.normal(size=(n, 3)) for n in (23, 23, 31))
    values = radial_interpolation("volume", 1.3, True, targets, centres, displacement).values
    expected = RBFInterpolator(centres, displacement, kernel="linear", degree=1)(targets)
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-11)


def test_centres_in_one_plane_are_refused_where_there_is_a_polynomial():
    centres = np.random.default_rng(0).normal(size=(12, 3))
    centres[:, 2] = 2.0 * centres[:, 0] + 1.0
    with pytest.raises(MovementError, match=r"in one plane.*'wendland c2'"):
        radial_interpolation("volume", 1.0, True, centres, centres, centres.copy())
    made = radial_interpolation("wendland c2", 1.0, False, centres, centres, centres.copy())
    np.testing.assert_allclose(made.values, centres, atol=1e-10)


def wendland(smoothness, power):
    """Wendland's function: (1 - r)_+^power, integrated ``smoothness`` times from r to 1 against t dt, and 1 at 0."""
    found = np.polynomial.Polynomial([1.0, -1.0]) ** power
    for _ in range(smoothness):
        integral = (found * np.polynomial.Polynomial([0.0, 1.0])).integ()
        found = integral(1.0) - integral
    return lambda r: np.where(r < 1.0, found(r) / found(0.0), 0.0)


FUNCTIONS = {
    "wendland c0": wendland(0, 2),
    "wendland c2": wendland(1, 3),
    "wendland c4": wendland(2, 4),
    "volume": lambda r: np.linalg.norm(np.outer(r, [0.6, 0.0, 0.8]), axis=1),
    "thin plate": lambda r: 0.5 * r**2 * np.log(r**2),
    "multiquadric": lambda r: np.hypot(1.0, r),
    "inverse multiquadric": lambda r: np.sin(np.arctan2(1.0, r)),
    "gaussian": lambda r: np.sqrt(2.0 * np.pi) * scipy.stats.norm.pdf(np.sqrt(2.0) * r),
}
"""The radial functions of the distance in radii, each by another formula than that of the kernel."""


@pytest.mark.parametrize("kernel", [*COMPACT, *GLOBAL])
def test_every_radial_function_is_the_one_of_its_name(kernel):
    kind, radius, random = [*COMPACT, *GLOBAL].index(kernel), 0.7, np.random.default_rng(2)
    r = np.linspace(0.02, 1.3, 40)
    along = random.normal(size=(40, 3))
    along *= (radius * r / np.linalg.norm(along, axis=1))[:, None]
    centre, strength = random.normal(size=(1, 3)), random.normal(size=(1, 3))
    expected = FUNCTIONS[kernel](r)
    sums = radial_sums(kind, radius, centre + along, centre, strength)
    np.testing.assert_allclose(sums, expected[:, None] * strength, rtol=1e-10, atol=1e-13)
    matrix = radial_matrix(kind, radius, np.concatenate([centre, centre + along]))
    np.testing.assert_allclose(matrix[0, 1:], expected, rtol=1e-10, atol=1e-13)
    step = 1e-6  # the slope, along the line to the centre
    outward = along / r[:, None]
    change = radial_sums_jvp(kind, radius, centre + along, centre, strength, outward, np.zeros((1, 3)))
    slope = (FUNCTIONS[kernel](r + step) - FUNCTIONS[kernel](r - step)) / (2 * step)
    away = np.abs(r - 1.0) > 2 * step
    np.testing.assert_allclose(change[away], (slope[:, None] * strength)[away], atol=1e-7)


@pytest.mark.parametrize("kernel", COMPACT)
def test_compact_functions_are_not_felt_beyond_their_radius(kernel):
    near, far = np.zeros((1, 3)), np.array([[0.0, 0.7, 0.0], [0.0, 0.699, 0.0]])
    values = radial_interpolation(kernel, 0.7, False, far, near, np.ones((1, 3))).values
    np.testing.assert_array_equal(values[0], 0.0)
    assert (values[1] > 0.0).all()


@pytest.mark.parametrize("kernel", [*NEEDS_LINEAR, "wendland c2"])
def test_affine_displacements_are_reproduced_with_the_linear_polynomial(kernel):
    mesh = mesh_of(channel_grid(rotation()), design="*")
    matrix, shift = np.random.default_rng(0).normal(size=(3, 3)), [0.1, 0.2, 0.3]
    moved = mesh.points @ matrix + shift
    points = mover_of(mesh, kernel, has_linear=True).move(mesh.points, moved[mesh.surface_ids]).points
    np.testing.assert_allclose(points, moved, atol=1e-10)


def test_everything_follows_a_translation_where_the_far_field_may():
    mesh = oblique_channel(released=("farfield",))
    shift = in_symmetry(mesh, np.ones((len(mesh.surface_ids), 3)))[mesh.in_plane_rows[0]]
    initial = mesh.points.copy()
    initial[mesh.surface_ids] += 0.1 * np.sin(3.0 * initial[mesh.surface_ids, :1]) * rotation()[:, 2]  # off one plane
    points = mover_of(mesh, "volume").move(initial, initial[mesh.surface_ids] + shift).points
    np.testing.assert_allclose(points, initial + shift, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("kernel", [*COMPACT, *GLOBAL])
def test_derivatives_of_every_kernel_are_exact(kernel):
    mover = mover_of(oblique_channel(), kernel, n_increments=2)
    initial, surface = bent_surface(mover.mesh)
    assert_derivative_is_transposed(mover.move(initial, surface))
    assert_derivative_is_exact(mover, initial, surface)


@pytest.mark.slow
@pytest.mark.parametrize("n_increments", [1, 5])
@pytest.mark.parametrize("has_linear", [False, True])
def test_derivatives_are_exact_in_any_number_of_increments(n_increments, has_linear):
    mover = RadialBasis(channel(), has_linear=has_linear, n_increments=n_increments)
    initial, surface = bent_surface(mover.mesh)
    assert_derivative_is_transposed(mover.move(initial, surface))
    assert_derivative_is_exact(mover, initial, surface)


@pytest.mark.slow
def test_derivatives_about_a_plate_with_coincident_sides_are_exact_to_the_condition_of_the_system():
    mover = RadialBasis(plate(), n_increments=2)
    initial, surface = bent_surface(mover.mesh)
    assert_derivative_is_transposed(mover.move(initial, surface), tolerance=1e-10)
    assert_derivative_is_exact(mover, initial, surface, tolerance=1e-7)


@pytest.mark.slow
def test_the_coincident_sides_of_a_plate_take_the_points_beside_them_along():
    mesh = plate()
    inner = slice(1, -1), slice(1, -1)
    lower, upper = both_sides(mesh)
    movement = RadialBasis(mesh, "wendland c0").move(mesh.points, opened(mesh))  # smoother ones overshoot beyond bounds
    moved = (movement.points - mesh.points)[..., 1]
    assert (mesh.points[lower] == mesh.points[upper]).all()
    assert (moved[mesh.blocks[1][:, -2][inner]] < 0.0).all()
    assert (moved[mesh.blocks[4][:, 1][inner]] > 0.0).all()
    assert movement.report.increments[0].solve.residual < 1e-9


def test_centres_that_stay_at_one_place_count_once():
    mesh = plate()
    is_free = np.zeros_like(mesh.is_free)  # nothing free beside the plate, and nothing but the surface to go to
    mesh = replace(mesh, surface_ids=np.arange(mesh.n_points, dtype=np.int32), is_free=is_free)
    mesh = replace(mesh, in_plane_rows=np.zeros(0, dtype=int), in_plane_normals=np.zeros((0, 3)))
    lower, upper = both_sides(mesh)
    assert len(find_centres(mesh).ids) == mesh.n_points - (lower != upper).sum()


def test_a_singular_system_is_told_with_what_to_do():
    mesh = wing()
    initial, surface = bent_surface(mesh)
    with pytest.raises(MovementError, match="take a smaller radius or another kernel"):
        RadialBasis(mesh, "gaussian", radius=10.0).move(initial, surface)


@pytest.mark.parametrize(
    "setting", [{"kernel": "cubic"}, {"radius": 0.0}, {"radius": np.nan}, {"kernel": "volume", "has_linear": False}]
)
def test_settings_that_mean_nothing_are_refused(setting):
    with pytest.raises(InputError, match="radial basis"):
        RadialBasis(channel(), **setting)


def test_too_many_centres_are_refused_before_anything_is_built():
    many = np.arange(MOST_CENTRES + 1, dtype=np.int32)
    mesh = replace(channel(), surface_ids=many, points=np.zeros((len(many), 3)), is_free=np.zeros((len(many), 3), bool))
    with pytest.raises(InputError, match="move the control mesh"):
        RadialBasis(mesh)
