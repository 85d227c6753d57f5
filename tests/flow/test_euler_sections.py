"""Sections in the plane: the vortex of the far field, orders of lift and drag, and weights where grid lines turn."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from euler_cases import AXES, case_of, lifting_section, section_grid
from topology_cases import box, grid_of, o_grid, smooth_box

from bspline_mdao.base.numerics.halo import ALONE
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.gas import GAMMA
from bspline_mdao.flow.euler.irregular_faces import IrregularFaces
from bspline_mdao.flow.loads.stream import stream_axes
from bspline_mdao.generators import FarField, Spacing, flat_plate_grid, infinite_wing_grid, naca_section
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.grid import Block, Patch
from bspline_mdao.grids.topology.index_space import Window

MACH, DEGREES = 0.5, 1.25

LIFT = 0.17896
"""Of the section NACA 0012 with a closed trailing edge, by the full potential equation in the plane of its circle."""


@cache
def flow_of(n_away, n_side, distance, with_vortex=True):
    """Case of a section, and its flow."""
    grid = section_grid(n_away, n_side, distance)
    flow = FlowGrid.of(find_topology(grid), grid.to_vector().reshape(-1, 3))
    discretization = flow.discretization if with_vortex else replace(flow.discretization, vortex=None)
    case = replace(case_of(grid, mach=MACH, degrees=DEGREES), discretization=discretization)
    solution = case.solve()
    assert solution.is_converged
    return case, solution.states


def lift(*args):
    """Lift coefficient of a section."""
    case, states = flow_of(*args)
    return stream_axes(np.radians(DEGREES), AXES)[1] @ case.force(states, 1.0)


@pytest.mark.slow
def test_lift_does_not_depend_on_the_distance_of_the_far_field():
    near, far = lift(25, 17, 10.0), lift(25, 17, 60.0)
    assert near == pytest.approx(far, rel=3e-3)
    assert lift(25, 17, 10.0, False) < 0.96 * far


def test_the_vortex_of_the_far_field_has_the_circulation_of_the_lift():
    case, states = flow_of(17, 17, 10.0)
    circulation = case.discretization.vortex._circulation(states, case.areas, case.stream)
    assert circulation == pytest.approx(0.5 * MACH * lift(17, 17, 10.0), rel=1e-12)


def test_the_vortex_has_the_entropy_and_the_enthalpy_of_the_stream_and_turns_about_the_section():
    case = lifting_section()
    outside = case.discretization.vortex.outside(case.states, case.areas, case.stream)
    rho, u, p = outside[:, 0], outside[:, 1:4], outside[:, 4]
    np.testing.assert_allclose(GAMMA * p / rho**GAMMA, 1.0, rtol=1e-12)
    speed = case.stream[1:4] @ case.stream[1:4]
    np.testing.assert_allclose(GAMMA / (GAMMA - 1.0) * p / rho + 0.5 * np.sum(u * u, axis=1), 2.5 + 0.5 * speed)
    assert np.ptp(u, axis=0).max() > 1e-3


def test_faster_than_sound_there_is_no_vortex():
    case = lifting_section()
    stream = case.stream * [1.0, 6.0, 6.0, 6.0, 1.0]
    outside = case.discretization.vortex.outside(case.states, case.areas, stream)
    np.testing.assert_array_equal(outside, np.tile(stream, (len(outside), 1)))
    linearization = case.discretization.linearize(case.states, case.areas, stream)
    bar, d_states = np.random.default_rng(2).standard_normal((2, *case.states.shape))
    forward = np.vdot(bar, linearization.state_jvp(d_states))
    assert np.vdot(d_states, linearization.state_vjp(bar)) == pytest.approx(forward, rel=1e-12)


def test_a_wing_has_no_vortex_in_its_far_field():
    grid = flat_plate_grid((5, 5, 5))
    assert FlowGrid.of(find_topology(grid), grid.to_vector().reshape(-1, 3)).discretization.vortex is None


def every_node(grid, step):
    """The member of a grid one cell deep with every ``step``-th node."""

    def window(w):
        return Window(w.block, *((end[0] // step, end[1] // step, end[2]) for end in (w.lo, w.hi)))

    blocks = [Block(np.ascontiguousarray(block.nodes[::step, ::step]), block.name) for block in grid.blocks]
    patches = [Patch(one.name, one.kind, tuple(map(window, one.windows))) for one in grid.patches]
    return replace(grid, blocks=tuple(blocks), patches=tuple(patches))


@cache
def family(n_side, steps):
    """Lift and drag coefficients on the members of a family, the coarsest first, in rows."""
    n_away, wide = 3 * n_side // 4 + 1, 32.0 / n_side
    spacing = Spacing(off_wall=6e-3 * wide, leading=8e-3 * wide, trailing=8e-3 * wide)
    shape = ((n_away, n_side + 1, n_away), n_away)
    fine = infinite_wing_grid(naca_section(0.12), shape, spacing, FarField(distance=50.0))
    drag_and_lift = []
    for step in steps:
        grid = every_node(fine, step)
        flow = FlowGrid.of(find_topology(grid), grid.to_vector().reshape(-1, 3))
        case = replace(case_of(grid, mach=MACH, degrees=DEGREES), discretization=flow.discretization)
        solution = case.solve()
        assert solution.is_converged
        drag_and_lift.append(stream_axes(np.radians(DEGREES), AXES) @ case.force(solution.states, 1.0))
    return np.array(drag_and_lift).T


@pytest.mark.slow
def test_lift_is_near_that_of_potential_flow_and_drag_falls_at_second_order_on_small_grids():
    drag, lift = family(32, (2, 1))
    np.testing.assert_allclose(lift, LIFT, rtol=0.035)
    assert lift[-1] == pytest.approx(LIFT, rel=0.012)
    assert np.log2(drag[0] / drag[1]) > 1.9


@pytest.mark.slow
def test_lift_and_drag_converge_at_second_order_to_those_of_potential_flow():
    drag, lift = family(64, (2, 1))
    assert np.log2((LIFT - lift[0]) / (LIFT - lift[1])) > 1.9
    assert np.log2(drag[0] / drag[1]) > 1.9
    assert lift[-1] == pytest.approx(LIFT, rel=3e-3)


def weighed(nodes):
    """Weights of smooth lines and of this grid in the means of all inner faces, and the places that these are of."""
    case = case_of(grid_of(nodes), "farfield")
    faces, plain = case.faces, case.discretization.stencil
    irregular = IrregularFaces.of(plain, faces, case.nodes, ALONE).stencil(case.nodes)
    inner = slice(0, faces.n_inner)
    centres = case.nodes[faces.corners[inner]].mean(axis=1)
    return [one.means[one.classes[inner]] for one in (plain, irregular)], plain.cells[inner], centres


def test_weights_of_even_grids_are_those_of_smooth_lines():
    (plain, irregular), _, _ = weighed(box(np.arange(7.0), 2.0 * np.arange(6.0), np.arange(5.0)))
    np.testing.assert_array_equal(plain, irregular)


def test_weights_sum_to_one_and_are_near_those_of_smooth_lines_on_smooth_grids():
    (plain, irregular), _, _ = weighed(smooth_box(8, 7, 6))
    np.testing.assert_allclose(irregular.sum(axis=1), 1.0, rtol=1e-13)
    assert np.abs(irregular - plain).max() < 0.3


def test_about_an_axis_no_mean_turns_the_sign_of_what_alternates():
    """Mid-faces of thin wedges are nearer to the axis than all cells along the line: no weights are of the face."""
    (plain, irregular), _, _ = weighed(o_grid(n_around=33, radius=0.0))
    phases = np.linspace(0.0, 0.5 * np.pi, 91)[:, None]
    inner, outer = irregular[:, 1] + irregular[:, 2], irregular[:, 0] + irregular[:, 3]
    means = inner * np.cos(phases) + outer * np.cos(3.0 * phases)
    assert np.abs(irregular - plain).max() > 0.2
    assert means.min() > -1e-12


def test_where_spacing_jumps_the_mean_is_of_the_face():
    x = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 7.0, 10.0, 13.0])
    (plain, irregular), cells, centres = weighed(box(x, np.arange(3.0), np.arange(2.0)))
    middles = np.repeat(0.5 * (x[1:] + x[:-1]), 2)
    away = [np.abs(np.sum(w * middles[cells], axis=1) - centres[:, 0]).max() for w in (plain, irregular)]
    assert away[0] > 0.3
    assert away[1] < 0.3 * away[0]  # what is left is of changes that are not worth a class
