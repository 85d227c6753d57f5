"""Stencils, boundary conditions, fluxes and the sensor of shocks of the Euler solver."""

import numpy as np
import pytest
from euler_cases import case_of, every_kind, faces_of, one_of_each_kind, slip_faces
from topology_cases import box, grid_of, smooth_box

from bspline_mdao.errors import InputError
from bspline_mdao.flow.euler.flux import ROUNDING, face_flux
from bspline_mdao.flow.euler.gas import GAMMA, critical_pressure, mach_numbers
from bspline_mdao.flow.euler.reconstruction import FARFIELD, Stencil, shock_sensor, shock_sensor_vjp

STEP = 1e-30


def averages(power):
    """Averages of x**power over the cells (-2, -1), (-1, 0), (0, 1) and (1, 2)."""
    ends = np.arange(-2.0, 3.0) ** (power + 1) / (power + 1)
    return np.diff(ends)


def weights_between(is_end_left, is_end_right):
    """Weights of an inner face of a row of cells, next to its ends or not."""
    n = 4 - is_end_left - is_end_right
    stencil = Stencil.of(faces_of(grid_of(box(np.arange(n + 1.0), [0.0, 1.0], [0.0, 1.0])), "farfield"))
    face = 1 - is_end_left
    return stencil.cells[face], stencil.means[stencil.classes[face]], stencil.differences[stencil.lines[face]]


def test_the_mean_is_of_fourth_order_and_the_third_difference_sees_cubics_alone():
    cells, mean, (first, third) = weights_between(0, 0)
    np.testing.assert_array_equal(cells, [0, 1, 2, 3])
    np.testing.assert_allclose([mean @ averages(k) for k in range(4)], [1.0, 0.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose([first @ averages(k) for k in range(2)], [0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose([third @ averages(k) for k in range(4)], [0.0, 0.0, 0.0, -6.0], atol=1e-14)


@pytest.mark.parametrize("ends", [(1, 0), (0, 1), (1, 1)])
def test_next_to_the_ends_of_lines_the_mean_is_of_second_order(ends):
    cells, mean, (_, third) = weights_between(*ends)
    x = np.where(mean != 0.0, cells - cells[1] - 0.5, 0.0)
    np.testing.assert_allclose([mean.sum(), mean @ x], [1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose([third.sum(), third @ x], [0.0, 0.0], atol=1e-14)


def row(kind, n):
    """Case of a row of cells of unit size, the patch at its low end of a kind."""
    grid = one_of_each_kind(box(np.arange(n + 1.0), [0.0, 1.0], [0.0, 1.0]).transpose(1, 0, 2, 3))
    return case_of(grid, {"wall": kind})


def pressure_at_end(kind, n, power):
    """Pressure that pushes on the low end of a row of cells where its values at the centres are x**power."""
    case = row(kind, n)
    states = case.discretization.uniform(case.stream)
    states[:, 4] = (np.arange(n) + 0.5) ** power
    end = slip_faces(case)[0]
    stencil = case.discretization.stencil
    return stencil.means[stencil.classes[end]] @ states[stencil.cells[end], 4]


@pytest.mark.parametrize("kind", ["wall", "symmetry"])
@pytest.mark.parametrize(("n", "degree"), [(1, 0), (2, 1), (3, 2), (4, 2)])
def test_pressure_at_slip_faces_is_extrapolated_by_as_many_cells_as_there_are(kind, n, degree):
    values = [pressure_at_end(kind, n, power) for power in range(4)]
    np.testing.assert_allclose(values[: degree + 1], np.eye(4)[0, : degree + 1], atol=1e-15)
    assert abs(values[degree + 1]) > 0.1


def test_nothing_but_pressure_goes_through_walls_and_symmetry_planes():
    case = every_kind()
    areas, slip = np.zeros_like(case.areas), slip_faces(case)
    areas[slip] = case.areas[slip]
    residual = case.residual(areas=areas)
    assert np.abs(residual[:, 1:4]).max() > 0.01
    assert np.abs(residual[:, [0, 4]]).max() == 0.0
    resting = case.states.copy()
    resting[:, :4] = 1.0
    np.testing.assert_array_equal(case.residual(states=resting, areas=areas), residual)


def test_the_far_field_gives_what_the_flux_makes_of_both_sides():
    case = row("farfield", 3)
    far = np.flatnonzero(case.discretization.stencil.roles == FARFIELD)
    for face in far[:4]:
        areas = np.zeros_like(case.areas)
        areas[face] = case.areas[face]
        inside = case.states[case.faces.left[face]]
        expected = face_flux(tuple(0.5 * (inside + case.stream)), tuple(case.stream - inside), tuple(areas[face]))
        np.testing.assert_allclose(case.residual(areas=areas)[case.faces.left[face]], expected, atol=1e-15)


def test_a_patch_that_says_nothing_about_the_flow_is_refused_in_one_line():
    with pytest.raises(InputError, match=r"patch 'unassigned' \(94 faces\) is of no kind; declare it as one of wall"):
        case_of(grid_of(smooth_box(4, 5, 6)))


def euler_flux(u, s):
    """Flux of conserved quantities through an area vector."""
    velocity, pressure = u[1:4] / u[0], (GAMMA - 1.0) * (u[4] - 0.5 * u[1:4] @ u[1:4] / u[0])
    through = velocity @ s
    return through * u + pressure * np.concatenate([[0.0], s, [through]])


def conserved(w):
    return np.concatenate([[w[0]], w[0] * w[1:4], [w[4] / (GAMMA - 1.0) + 0.5 * w[0] * w[1:4] @ w[1:4]]])


def derivative(function, at):
    """Jacobian by complex step."""
    return np.stack([function(at + 1j * STEP * unit).imag / STEP for unit in np.eye(len(at))], axis=1)


def modulus_of_jacobian(w, s):
    """Rounded absolute value of the Jacobian of the flux in the conserved quantities, from its eigenvectors."""
    jacobian = derivative(lambda u: euler_flux(u, s), conserved(w))
    speeds, vectors = np.linalg.eig(jacobian)
    rounded = np.sqrt(speeds**2 + (ROUNDING**2) * GAMMA * w[4] / w[0] * (s @ s))
    return (vectors * rounded) @ np.linalg.inv(vectors)


def test_the_flux_is_that_of_roe_but_for_the_low_mach_factor():
    rng = np.random.default_rng(8)
    for mach in (0.05, 0.6, 1.7):
        w = np.array([1.1, *mach * rng.uniform(-1.0, 1.0, 3), 0.8])
        jump, s = rng.standard_normal(5), rng.standard_normal(3)
        modulus = modulus_of_jacobian(w, s)
        expected = euler_flux(conserved(w), s) - 0.5 * modulus @ derivative(conserved, w) @ jump
        speed, sound = w[1:4] @ s, np.sqrt(GAMMA * w[4] / w[0] * (s @ s))
        around = [np.hypot(x, ROUNDING * sound) for x in (speed, speed + sound, speed - sound)]
        m2 = w[1:4] @ w[1:4] * w[0] / (GAMMA * w[4])
        kept = 1.0 - m2 / np.hypot(1.0, m2)
        spared = kept * (0.5 * (around[1] + around[2]) - around[0]) * w[0] * (jump[1:4] @ s) / (s @ s)
        expected += 0.5 * spared * np.array([0.0, *s, speed])
        np.testing.assert_allclose(face_flux(tuple(w), tuple(jump), tuple(s)), expected, rtol=1e-11, atol=1e-11)


@pytest.mark.slow
def test_the_shock_sensor_of_fast_flow_is_between_none_and_all_and_of_eighth_order_where_it_is_smooth():
    def sensor(pressures):
        states = np.full((4, 5), 1.2)
        states[:, 4] = pressures
        return shock_sensor(states, np.arange(4), 0.05)

    smooth = [sensor(1.0 + 0.3 * np.sin(h * np.arange(4.0))) for h in (0.02, 0.01)]
    assert sensor([1.0, 1.0, 1.0, 1.0]) == sensor([1.0, 2.0, 3.0, 4.0]) == 0.0
    assert sensor([1.0, 1.0, 4.5, 4.5]) > 0.95
    assert smooth[0] / smooth[1] > 2.0**7.8


def test_the_sensor_sees_no_cells_beyond_the_ends_of_lines():
    states = np.random.default_rng(9).uniform(0.5, 1.5, (4, 5))
    assert shock_sensor(states, np.arange(4), 0.05) > 0.1
    at_ends = states, np.array([1, 1, 2, 2]), 0.05
    first, left, right, last = shock_sensor_vjp(*at_ends, 1.0)
    assert not any((shock_sensor(*at_ends), *first, left, right, *last))


def test_the_sensor_is_shut_in_slow_flow():
    states = np.full((4, 5), 0.1)
    states[:, [0, 4]] = np.array([[1.0, 1.0, 4.5, 4.5]]).T
    first, left, right, last = shock_sensor_vjp(states, np.arange(4), 0.05, 1.0)
    assert not any((shock_sensor(states, np.arange(4), 0.05), *first, left, right, *last))


def test_the_sensor_is_open_where_fast_flow_comes_to_rest():
    states = np.tile([1.0, 1.4, 0.0, 0.0, 1.0 / 1.4], (4, 1))
    states[2:, [1, 4]] = 0.0, 2.0 / 1.4
    assert shock_sensor(states, np.arange(4), 0.05) > 0.9


@pytest.mark.parametrize("mach", [0.3, 0.75, 0.97])
def test_at_the_critical_pressure_the_flow_of_the_free_stream_s_entropy_and_enthalpy_is_sonic(mach):
    p = (1.0 + 0.5 * GAMMA * mach**2 * critical_pressure(mach)) / GAMMA
    rho = (GAMMA * p) ** (1.0 / GAMMA)
    speed = np.sqrt(mach**2 + 2.0 / (GAMMA - 1.0) * (1.0 - GAMMA * p / rho))
    np.testing.assert_allclose(mach_numbers(np.array([[rho, 0.6 * speed, 0.8 * speed, 0.0, p]])), 1.0, rtol=1e-12)
