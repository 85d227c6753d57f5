"""Free stream and derivatives of the Euler solver."""

from dataclasses import replace

import numpy as np
import pytest
from euler_cases import (
    AXES,
    GRIDS,
    case_of,
    every_kind,
    faces_of,
    lifting_section,
    mach_of_cases,
    turned_blocks,
    two_cells_across,
)
from topology_cases import box, grid_of, smooth_box, turned_and_shuffled

from bspline_mdao.flow.euler.flow_grid import area_vectors, area_vectors_jvp, area_vectors_vjp
from bspline_mdao.flow.euler.gas import GAMMA, free_stream, free_stream_partials
from bspline_mdao.flow.loads.stream import stream_axes
from bspline_mdao.generators import (
    ball_grid,
    brick_grid,
    flat_plate_grid,
    hh_wing_grid,
    onera_m6_grid,
    rectangular_wing,
)
from bspline_mdao.grids.io.files import read_grid

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


@pytest.mark.slow
@pytest.mark.parametrize("name", [*GRIDS, *GENERATED])
def test_the_free_stream_is_preserved_to_round_off(name):
    grid = (GRIDS | GENERATED)[name]()
    assert uniform_residual(grid) < 1.0
    assert uniform_residual(turned_and_shuffled(grid, np.random.default_rng(4))[0]) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_the_free_stream_is_preserved_on_grids_of_other_projects(real_grids, name):
    grid = read_grid(real_grids / name)
    assert faces_of(grid).n_cells == REAL[name]
    assert uniform_residual(grid) < 1.0


CASES = pytest.mark.parametrize("case", [every_kind, two_cells_across, turned_blocks, lifting_section])
SENSORS = pytest.mark.parametrize("threshold", [0.0, 0.15])
STEP = 1e-30


def directions(case):
    """One in the states, one in the area vectors, one in the stream."""
    rng = np.random.default_rng(5)
    return {
        "states": rng.standard_normal(case.states.shape),
        "areas": rng.standard_normal(case.areas.shape) * (np.abs(case.areas).max(axis=1, keepdims=True) > 0.0),
        "stream": rng.standard_normal(5),
    }


@pytest.mark.slow
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


@CASES
@SENSORS
def test_products_in_single_precision_are_the_exact_ones_to_single_precision(case, threshold):
    case, single = case(threshold), np.finfo(np.float32).eps
    direction, bar = np.random.default_rng(6).standard_normal((2, *case.states.shape))
    exact, jacobians = case.linearization, case.linearization.jacobians
    assert (len(jacobians.shocks) > 0) == (threshold > 0.0)
    for ours, theirs in (
        (jacobians.product(direction), exact.state_jvp(direction)),
        (jacobians.transposed_product(bar), exact.state_vjp(bar)),
    ):
        assert ours.dtype == np.float32
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=20.0 * single * np.abs(theirs).max())


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


def cells_by_place(case):
    """Cells in the order of the places of their centres."""
    faces, middles = case.faces, case.nodes[case.faces.corners].mean(axis=1)
    total = np.zeros((faces.n_cells, 3))
    np.add.at(total, faces.left, middles)
    np.add.at(total, faces.right, middles[: faces.n_inner])
    return np.lexsort(np.round(total, 9).T)


def test_blocks_turned_in_any_way_have_the_same_residual():
    whole, turned = (
        case_of(grid_of(smooth_box(8, 4, 5)), "farfield", mach=mach_of_cases(0.15), shock_threshold=0.15),
        turned_blocks(0.15),
    )
    order, turned_order = cells_by_place(whole), cells_by_place(turned)
    states = np.empty_like(whole.states)
    states[turned_order] = whole.states[order]
    residual = turned.residual(states=states)
    np.testing.assert_allclose(residual[turned_order], whole.residual()[order], atol=1e-14)


def test_the_sensor_is_at_work_in_the_cases():
    case = turned_blocks(0.15)
    plain = replace(case, discretization=replace(case.discretization, shock_threshold=0.0))
    assert np.abs(case.residual() - plain.residual()).max() > 1e-3


def test_faces_without_area_are_among_the_cases():
    assert (every_kind().areas == 0.0).all(axis=1).sum() == 5
