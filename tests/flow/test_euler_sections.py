"""Sections in the plane: the vortex of the far field."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from euler_cases import AXES, case_of, lifting_section, section_grid

from bspline_mdao import flat_plate_grid
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.gas import GAMMA
from bspline_mdao.flow.stream import stream_axes
from bspline_mdao.topology.detection import find_topology

MACH, DEGREES = 0.5, 1.25


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
