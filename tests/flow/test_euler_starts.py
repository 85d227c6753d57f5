"""Where Newton's steps start from: coarser members of the grid, with either kind of time steps."""

from dataclasses import replace
from functools import cached_property

import numpy as np
import pytest
from euler_cases import one_of_each_kind

from bspline_mdao.core.generators.hh_wing import infinite_wing_grid
from bspline_mdao.core.generators.wing import naca_section
from bspline_mdao.core.generators.wing_spacing import Spacing
from bspline_mdao.flow.euler import newton
from bspline_mdao.flow.euler.cold_start import cold_solutions
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.euler.newton import solve_flow
from bspline_mdao.flow.euler.newton_step import NewtonStep
from bspline_mdao.flow.euler.sequencing import coarse_levels, states_from_coarse, useful_levels
from bspline_mdao.flow.euler.settings import NEWTON, STARTS
from bspline_mdao.generators import flat_plate_grid, onera_m6_grid
from bspline_mdao.grids.topology.detection import find_topology

pytestmark = pytest.mark.slow


class Flight:
    """A grid in a stream of Mach 0.3."""

    def __init__(self, grid, degrees):
        self.topology, self.nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
        self.flow = FlowGrid.of(self.topology, self.nodes)
        self.stream = free_stream(0.3, np.radians(degrees), self.flow.axes)
        self.field = self.flow.discretization, self.flow.areas(self.nodes), self.stream

    @cached_property
    def cold(self):
        return solve_flow(*self.field, pattern=self.flow.pattern)

    def start(self, n_levels):
        return states_from_coarse(coarse_levels(self.topology, self.nodes, n_levels), self.nodes, self.stream)


@pytest.fixture(scope="module")
def wing():
    return Flight(onera_m6_grid((10, 8, 7)), 4.0)


def boxes(nodes, faces):
    """Ends of every cell of boxes, two arrays."""
    low, high = np.full((faces.n_cells, 3), np.inf), np.full((faces.n_cells, 3), -np.inf)
    for cells in (faces.left, faces.right):
        corners = nodes[faces.corners[: len(cells)]]
        np.minimum.at(low, cells, corners.min(axis=1))
        np.maximum.at(high, cells, corners.max(axis=1))
    return low, high


def test_every_cell_lies_in_its_parent():
    box = np.stack(np.meshgrid(*(np.arange(n) ** 1.5 for n in (6, 8, 5)), indexing="ij"), axis=-1)
    grid = one_of_each_kind(box)
    topology, nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
    cells = boxes(nodes, FlowGrid.of(topology, nodes).faces)
    for level in coarse_levels(topology, nodes, 2):
        nodes = nodes[level.picked]
        coarse = boxes(nodes, level.flow.faces)
        assert (coarse[0][level.parents] <= cells[0]).all()
        assert (cells[1] <= coarse[1][level.parents]).all()
        cells = coarse


def test_without_levels_the_stream_is_uniform(wing):
    assert wing.start(0) is None


def test_a_uniform_stream_along_a_plate_stays_uniform():
    plate = Flight(flat_plate_grid((7, 8, 6)), 0.0)
    np.testing.assert_allclose(plate.start(2), plate.flow.discretization.uniform(plate.stream), atol=1e-12)


def test_a_flow_from_coarser_members_is_the_same(wing):
    solution = solve_flow(*wing.field, pattern=wing.flow.pattern, states=wing.start(1))
    np.testing.assert_allclose(solution.states, wing.cold.states, atol=1e-8)
    assert solution.is_converged


def cold_runs(flight, **limits):
    """Runs of a cold start with one coarser member."""
    levels = coarse_levels(flight.topology, flight.nodes, 1)
    return list(cold_solutions(flight.flow, levels, flight.nodes, *flight.field[1:], **limits))


def products(runs):
    return [[step.n_products for step in run.history] for run in runs]


def test_long_time_steps_come_first_where_the_flow_on_a_coarser_member_took_many_steps(wing):
    plain, long = products(cold_runs(wing, max_steps=3))
    assert plain != long
    assert products(cold_runs(wing, max_steps=3, settings=replace(STARTS, hard=1))) == [long, plain]


def test_flows_by_both_kinds_of_time_steps_are_the_same(wing):
    first, other = cold_runs(wing)
    assert products([first]) != products([other])
    for solution in (first, other):
        assert solution.is_converged
        np.testing.assert_array_equal(solution.stream, wing.stream)
        np.testing.assert_allclose(solution.states, wing.cold.states, atol=1e-8)


@pytest.mark.parametrize(("off_wall", "is_long"), [(1e-2, False), (1e-5, True)])
def test_long_time_steps_come_first_where_cells_at_walls_are_flat(off_wall, is_long):
    section = Flight(infinite_wing_grid(naca_section(0.12), (13, 17), Spacing(off_wall, 1e-2, 1e-2)), 2.0)
    levels = coarse_levels(section.topology, section.nodes, 1)
    first = next(cold_solutions(section.flow, levels, section.nodes, *section.field[1:]))
    start = states_from_coarse(levels, section.nodes, section.stream, is_long)
    alone = solve_flow(*section.field, pattern=section.flow.pattern, states=start, is_long=is_long)
    assert [step.n_products for step in first.history] == [step.n_products for step in alone.history]
    assert first.is_converged


def test_members_are_coarser_down_to_250_cells_also_where_a_grid_is_one_cell_deep():
    for grid in (
        onera_m6_grid((17, 17, 17)),
        infinite_wing_grid(naca_section(0.12), (29, 29), Spacing(0.01, 0.01, 0.01)),
    ):
        topology, nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
        n_levels = useful_levels(topology)
        n_cells = [level.flow.faces.n_cells for level in coarse_levels(topology, nodes, n_levels + 1)]
        assert n_levels >= 1
        assert n_cells[-1] < 250 <= n_cells[-2]


def test_linear_solves_are_rough_where_the_last_step_left_much():
    def forcing(*residuals):
        return newton._forcing(NEWTON, [NewtonStep(residual, 1.0, 1, 1.0) for residual in residuals], 1e-10)

    assert forcing(1e-1) == forcing(1e-5, 2e-4) == forcing(1e-5, 9e-6) == NEWTON.rough
    assert forcing(1e-5, 2e-6) == pytest.approx(0.04)
    assert forcing(1e-5) == forcing(1e-5, 1e-7) == NEWTON.forcing
    assert forcing(1e-6, 1e-9) == pytest.approx(0.05)
    assert forcing(1e-7, 1.2e-10) == NEWTON.rough
