"""Free stream, fluxes, boundary conditions and derivatives of the Euler solver."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from euler_cases import AXES, GRIDS, case_of, faces_of, one_of_each_kind, slip_faces
from topology_cases import ORIENTATIONS, box, grid_of, smooth_box, split, turned_and_shuffled

from bspline_mdao.errors import InputError
from bspline_mdao.flow.euler.areas import area_vectors, area_vectors_jvp, area_vectors_vjp
from bspline_mdao.flow.euler.face_states import shock_sensor
from bspline_mdao.flow.euler.flux import ROUNDING, face_flux
from bspline_mdao.flow.euler.gas import GAMMA, free_stream, free_stream_partials, stream_axes
from bspline_mdao.flow.euler.stencil import FARFIELD, MEAN, THIRD, Stencil
from bspline_mdao.generators import (
    ball_grid,
    brick_grid,
    flat_plate_grid,
    hh_wing_grid,
    onera_m6_grid,
    rectangular_wing,
)
from bspline_mdao.grids.files import read_grid

GENERATED = {
    "M6 wing": lambda: onera_m6_grid((13, 17, 11)),
    "flat plate": lambda: flat_plate_grid((13, 17, 11)),
    "rectangular wing": lambda: hh_wing_grid(rectangular_wing(), (13, 17, 11)),
    "ball": lambda: ball_grid((5, 6, 7, 8), off_wall=0.05),
    "octant of a ball": lambda: ball_grid((5, 6, 7, 8), octant=True),
    "brick": lambda: brick_grid((5, 6, 7, 8), (1.0, 2.0, 0.5)),
    "octant of a brick": lambda: brick_grid((5, 6, 7, 8), (1.0, 2.0, 0.5), octant=True),
}

REAL = {
    "aither_multiblock_cylinder.xyz": 2560,
    "aither_rae2822.xyz": 23552,
    "aither_uniform_10blocks.xyz": 1600,
    "cfl3d_axibump.fmt": 18000,
    "cfl3d_cylinder_ogrid.fmt": 10240,
    "cfl3d_delta_wing.fmt.gz": 147456,
    "cfl3d_ejector_nozzle.p3dfmt": 15300,
    "cfl3d_naca0012_cgrid.fmt": 32768,
    "cfl3d_rotorstator.fmt": 17244,
    "cfl3d_sduct.bin": 87600,
    "cgns_5blocks.cgns": 1809,
    "cgns_nozzle.cgns": 11264,
    "hh_naca0012_12blocks.xyz": 36864,
    "hopr_sphere_20blocks.cgns": 21168,
    "mach_naca0012.cgns": 31232,
    "multi-ascii.xyz": 1694,
    "multi-bin-C.xyz": 1694,
    "multi-bin.xyz": 1694,
    "pyhyp_m6_9blocks.xyz": 152320,
    "vtk_bluntfin.bin": 37479,
}
"""Cells of each."""


def uniform_residual(grid):
    """Largest residual of the free stream with the far field all around, in round-offs of the sums that make it.

    The area vector of a face is rounded by the product of its diagonals, which is much more than its area where the
    face is narrow and skewed.
    """
    case = case_of(grid, "farfield", degrees=7.0)
    faces = case.faces
    a, b, c, d = (case.nodes[faces.corners[:, n]] for n in range(4))
    size = np.linalg.norm(c - a, axis=1) * np.linalg.norm(d - b, axis=1)
    scale = np.bincount(faces.left, size, faces.n_cells)
    scale += np.bincount(faces.right, size[: faces.n_inner], faces.n_cells)
    residual = case.residual(states=case.discretization.uniform(case.stream))
    return np.max(np.abs(residual).max(axis=1) / np.maximum(scale, np.finfo(float).tiny)) / np.finfo(float).eps


@pytest.mark.parametrize("name", [*GRIDS, *GENERATED])
def test_the_free_stream_is_preserved_to_round_off(name):
    grid = (GRIDS | GENERATED)[name]()
    assert uniform_residual(grid) < 1.0
    assert uniform_residual(turned_and_shuffled(grid, np.random.default_rng(4))[0]) < 1.0


@pytest.mark.parametrize("name", REAL)
def test_the_free_stream_is_preserved_on_grids_of_other_projects(real_grids, name):
    grid = read_grid(real_grids / name)
    assert faces_of(grid).n_cells == REAL[name]
    assert uniform_residual(grid) < 1.0


@cache
def every_kind(shock_threshold=0.0):
    """One left-handed block with all boundary conditions, some of its faces moved together until they have no area."""
    nodes = smooth_box(6, 5, 4)[::-1]
    case = case_of(one_of_each_kind(nodes), shock_threshold=shock_threshold)
    moved = nodes.copy()
    moved[:, 0, 0] = moved[:, 1, 0]
    return replace(case, nodes=moved.reshape(-1, 3))


@cache
def turned_blocks(shock_threshold=0.0):
    """Three blocks that are permuted, one of them two cells deep, walls along one side."""
    left, middle, right = split(smooth_box(8, 4, 5), [2, 5], [], [])
    grid = grid_of(left, ORIENTATIONS[29].apply(middle), ORIENTATIONS[14].apply(right))
    return case_of(grid, "farfield", shock_threshold=shock_threshold)


CASES = pytest.mark.parametrize("case", [every_kind, turned_blocks])
SENSORS = pytest.mark.parametrize("threshold", [0.0, 0.05])
STEP = 1e-30


def directions(case):
    """One in the states, one in the area vectors, one in the stream."""
    rng = np.random.default_rng(5)
    return {
        "states": rng.standard_normal(case.states.shape),
        "areas": rng.standard_normal(case.areas.shape) * (np.abs(case.areas).max(axis=1, keepdims=True) > 0.0),
        "stream": rng.standard_normal(5),
    }


@CASES
@SENSORS
@pytest.mark.parametrize(("argument", "product"), [("states", "state"), ("areas", "area"), ("stream", "stream")])
def test_products_agree_with_complex_step(case, threshold, argument, product):
    case = case(threshold)
    direction = directions(case)[argument]
    moved = case.residual(**{argument: getattr(case, argument) + 1j * STEP * direction}).imag / STEP
    change = getattr(case.linearization, f"{product}_jvp")(direction)
    assert np.abs(change).max() > 0.1
    np.testing.assert_allclose(change, moved, rtol=0.0, atol=1e-12 * np.abs(moved).max())


@CASES
@SENSORS
@pytest.mark.parametrize(("argument", "product"), [("states", "state"), ("areas", "area"), ("stream", "stream")])
def test_products_and_their_transposes_agree(case, threshold, argument, product):
    case = case(threshold)
    direction, bar = directions(case)[argument], np.random.default_rng(6).standard_normal(case.states.shape)
    forward = np.vdot(getattr(case.linearization, f"{product}_jvp")(direction), bar)
    reverse = np.vdot(direction, getattr(case.linearization, f"{product}_vjp")(bar))
    assert forward == pytest.approx(reverse, rel=1e-13, abs=1e-13 * np.linalg.norm(direction) * np.linalg.norm(bar))


def test_area_vectors_and_their_derivatives_agree_with_complex_step():
    case = every_kind()
    rng = np.random.default_rng(7)
    d_nodes, bar = rng.standard_normal(case.nodes.shape), rng.standard_normal(case.areas.shape)
    corners = case.faces.corners
    change = area_vectors_jvp(case.nodes, corners, d_nodes)
    moved = area_vectors(case.nodes + 1j * STEP * d_nodes, corners).imag / STEP
    np.testing.assert_allclose(change, moved, atol=1e-14)
    assert np.vdot(change, bar) == pytest.approx(
        np.vdot(d_nodes, area_vectors_vjp(case.nodes, corners, bar)), rel=1e-13
    )


def test_area_vectors_of_flat_faces_are_their_areas_and_normals():
    case = case_of(grid_of(box([0.0, 2.0], [0.0, 3.0], [0.0, 5.0])), "farfield")
    np.testing.assert_allclose(np.sort(np.abs(case.areas).max(axis=1)), [6.0, 6.0, 10.0, 10.0, 15.0, 15.0])
    np.testing.assert_allclose(case.areas.sum(axis=0), 0.0, atol=1e-14)


def test_the_free_stream_turns_from_downstream_to_up():
    stream = free_stream(0.5, np.radians(30.0), AXES)
    np.testing.assert_allclose(stream, [1.0, 0.5 * np.cos(np.pi / 6.0), 0.25, 0.0, 1.0 / GAMMA])
    np.testing.assert_allclose(stream_axes(0.0, AXES), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    by_mach, by_angle = free_stream_partials(0.5, 0.3, AXES)
    np.testing.assert_allclose(free_stream(0.5 + 1j * STEP, 0.3, AXES).imag / STEP, by_mach, atol=1e-15)
    np.testing.assert_allclose(free_stream(0.5, 0.3 + 1j * STEP, AXES).imag / STEP, by_angle, atol=1e-15)


def averages(power):
    """Averages of x**power over the cells (-2, -1), (-1, 0), (0, 1) and (1, 2)."""
    ends = np.arange(-2.0, 3.0) ** (power + 1) / (power + 1)
    return np.diff(ends)


def weights_between(is_end_left, is_end_right):
    """Weights of an inner face of a row of cells, next to its ends or not."""
    n = 4 - is_end_left - is_end_right
    stencil = Stencil.of(faces_of(grid_of(box(np.arange(n + 1.0), [0.0, 1.0], [0.0, 1.0])), "farfield"))
    face = 1 - is_end_left
    return stencil.cells[face], stencil.weights[stencil.classes[face]]


def test_the_mean_is_of_fourth_order_and_the_third_difference_sees_cubics_alone():
    cells, (mean, first, third) = weights_between(0, 0)
    np.testing.assert_array_equal(cells, [0, 1, 2, 3])
    np.testing.assert_allclose([mean @ averages(k) for k in range(4)], [1.0, 0.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose([first @ averages(k) for k in range(2)], [0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose([third @ averages(k) for k in range(4)], [0.0, 0.0, 0.0, -6.0], atol=1e-14)


@pytest.mark.parametrize("ends", [(1, 0), (0, 1), (1, 1)])
def test_next_to_the_ends_of_lines_the_mean_is_of_second_order(ends):
    cells, weights = weights_between(*ends)
    x = np.where(weights[MEAN] != 0.0, cells - cells[1] - 0.5, 0.0)
    np.testing.assert_allclose([weights[MEAN].sum(), weights[MEAN] @ x], [1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose([weights[THIRD].sum(), weights[THIRD] @ x], [0.0, 0.0], atol=1e-14)


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
    return stencil.weights[stencil.classes[end], MEAN] @ states[stencil.cells[end], 4]


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
    with pytest.raises(
        InputError, match=r"patch 'unassigned' \(94 faces\) is of kind 'None'; declare it as one of wall"
    ):
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


def test_the_shock_sensor_is_between_none_and_all_and_of_eighth_order_in_smooth_flow():
    def sensor(pressures):
        states = np.ones((4, 5))
        states[:, 4] = pressures
        return shock_sensor(states, np.arange(4), 0.05)[0]

    smooth = [sensor(1.0 + 0.3 * np.sin(h * np.arange(4.0))) for h in (0.02, 0.01)]
    assert sensor([1.0, 1.0, 1.0, 1.0]) == sensor([1.0, 2.0, 3.0, 4.0]) == 0.0
    assert sensor([1.0, 1.0, 4.5, 4.5]) > 0.95
    assert smooth[0] / smooth[1] > 2.0**7.8


def test_the_sensor_sees_no_cells_beyond_the_ends_of_lines():
    states = np.random.default_rng(9).uniform(0.5, 1.5, (4, 5))
    share, by_pressure, by_mean = shock_sensor(states, np.array([1, 1, 2, 2]), 0.05)
    assert share == 0.0
    assert not any((*by_pressure, *by_mean))


def cells_by_place(case):
    """Cells in the order of the places of their centres."""
    faces, middles = case.faces, case.nodes[case.faces.corners].mean(axis=1)
    total = np.zeros((faces.n_cells, 3))
    np.add.at(total, faces.left, middles)
    np.add.at(total, faces.right, middles[: faces.n_inner])
    return np.lexsort(np.round(total, 9).T)


def test_blocks_turned_in_any_way_have_the_same_residual():
    whole, turned = case_of(grid_of(smooth_box(8, 4, 5)), "farfield", shock_threshold=0.05), turned_blocks(0.05)
    order, turned_order = cells_by_place(whole), cells_by_place(turned)
    states = np.empty_like(whole.states)
    states[turned_order] = whole.states[order]
    residual = turned.residual(states=states)
    np.testing.assert_allclose(residual[turned_order], whole.residual()[order], atol=1e-14)


def test_faces_without_area_are_among_the_cases():
    assert (every_kind().areas == 0.0).all(axis=1).sum() == 5
