"""Runs that stagnate: how fast what a step is made of grows, and flows that are found behind the end of another."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from bspline_mdao.base.numerics.halo import ALONE, Halo
from bspline_mdao.base.numerics.processes import ONE
from bspline_mdao.flow.euler import newton
from bspline_mdao.flow.euler.cold_start import cold_solutions
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.euler.newton_step import Course, NewtonStep
from bspline_mdao.flow.euler.sequencing import coarse_levels, useful_levels
from bspline_mdao.flow.euler.settings import NEWTON
from bspline_mdao.flow.euler.stagnation import (
    begins_to_stagnate,
    course_of,
    lowest_before,
    since_stagnation,
    stagnation_cfl,
)
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.io.files import read_grid
from bspline_mdao.grids.io.patch_guess import with_guessed_patches
from bspline_mdao.grids.topology.detection import find_topology


@pytest.mark.parametrize("growth", [-3.0, 0.25, 0.9, 1.1, 40.0])
def test_a_part_of_the_states_that_grows_alone_tells_its_rate(growth):
    rng = np.random.default_rng(3)
    part = rng.standard_normal((7, 5))
    held = 2.0 * part  # T dW / CFL
    residual = -(1.0 - growth) * held  # of (T/CFL + J) dW = -R with J dW = -growth T dW / CFL
    assert course_of(part, None, residual, held, ONE).growth == pytest.approx(growth)


def test_a_turn_is_the_cosine_of_two_updates():
    rng = np.random.default_rng(4)
    update, other = rng.standard_normal((2, 7, 5))
    other -= np.sum(other * update) / np.sum(update * update) * update
    for last, cosine in (
        (3.0 * update, 1.0),
        (-update, -1.0),
        (other, 0.0),
        (update / np.linalg.norm(update) + other / np.linalg.norm(other), 0.5**0.5),
    ):
        assert course_of(update, last, update, update, ONE).turn == pytest.approx(cosine, abs=1e-12)
    assert course_of(update, None, update, update, ONE).turn == 0.0


def run(*residuals, turn=0.0, growth=-1.0, cfl=800.0, length=1.0):
    """Steps with these residuals and one course, as `solve_flow` records them."""
    history = []
    for residual in residuals:
        history.append(NewtonStep(residual, cfl, 1, length, Course(turn, growth)))
        history[-1] = replace(history[-1], stagnates_from=lowest_before(NEWTON, history))
    return history


def test_a_run_stagnates_after_eight_low_residuals_without_a_lowest_one():
    assert not begins_to_stagnate(NEWTON, run(1e-4, *7 * [2e-4]))
    assert begins_to_stagnate(NEWTON, run(1e-4, *8 * [2e-4]))
    assert not begins_to_stagnate(NEWTON, run(2e-3, *20 * [4e-3]))  # where shocks travel


def test_a_run_stagnates_as_soon_as_a_step_goes_back_and_its_residual_rises():
    assert begins_to_stagnate(NEWTON, run(1e-5, 4e-6, 6e-6, turn=-0.6))
    assert not begins_to_stagnate(NEWTON, run(1e-5, 6e-6, 4e-6, turn=-0.6))
    assert not begins_to_stagnate(NEWTON, run(1e-5, 4e-6, 6e-6, turn=-0.4))
    assert not begins_to_stagnate(NEWTON, run(2e-3, 4e-6, 6e-6, turn=-0.6))


@pytest.mark.parametrize("level", [1e-5, 1e-3, 1e-2])
def test_a_run_stagnates_where_two_whole_steps_in_a_row_go_back_at_any_residual(level):
    residuals = 1.1 * level, 1.9 * level, level
    assert begins_to_stagnate(NEWTON, run(*residuals, turn=-0.6))
    assert not begins_to_stagnate(NEWTON, run(*residuals, turn=-0.6, length=0.5))
    assert not begins_to_stagnate(NEWTON, run(*residuals, turn=-0.4))
    assert not begins_to_stagnate(NEWTON, run(*residuals[:2], turn=0.3) + run(level, turn=-0.6))
    assert not begins_to_stagnate(NEWTON, run(*residuals[:2], 0.4 * level, turn=-0.6))


def test_a_run_stagnates_until_its_residual_is_a_tenth_of_the_lowest_before():
    history = run(1e-4, *8 * [2e-4], 5e-2, 2e-5, 0.9e-5, 2e-5)
    assert [step.stagnates_from for step in history] == [*8 * [0.0], *3 * [1e-4], *2 * [0.0]]


@pytest.mark.parametrize(("is_long", "rest"), [(False, 20.0), (True, 5.0)])
def test_a_run_that_begins_to_hover_goes_back_to_short_time_steps(is_long, rest):
    history = run(1e-4, *8 * [2e-4])
    assert newton._next_cfl(NEWTON, history, 2.0, 2.0, is_long) == rest
    assert newton._next_cfl(NEWTON, run(1e-4, *8 * [2e-4], cfl=0.5), 2.0, 2.0, is_long) == 0.5


@pytest.mark.parametrize(
    ("after", "growth", "length", "factor"),
    [
        (3e-4, -1.0, 1.0, 1.5),  # the residual rises, but nothing that a longer step could reverse
        (1e-4, -1.0, 1.0, 2.0),  # as it falls
        (1e-6, -1.0, 1.0, 10.0),
        (1e-4, -1.0, 0.5, 0.75),  # never after a part of a step
        (1e-4, -1.0, 0.0, 0.2),
        (1e-4, 0.1, 1.0, 2.0),
        (1e-4, 0.4, 1.0, 1.0),
        (3e-4, 0.8, 1.0, 0.5),
        (3e-4, 4.0, 1.0, 0.1),
    ],
)
def test_time_steps_of_a_run_that_stagnates_grow_as_far_as_growth_allows(after, growth, length, factor):
    history = run(1e-4, *8 * [2e-4], after, growth=growth, length=length, cfl=100.0)
    assert stagnation_cfl(NEWTON, history, True) == pytest.approx(100.0 * factor)


def test_a_run_may_take_its_steps_anew_from_where_it_began_to_hover():
    history = run(1e-4, *8 * [2e-4], 3e-3, 2e-4)
    assert since_stagnation(history) == history[8:]
    assert since_stagnation(history[:8]) == history[:8]


GAP = 1e-5
"""How far the states a = 0 are from steady ones: they met and ended there."""


@dataclass(frozen=True)
class Fold:
    """One cell whose x-velocity a moves by da/dt = (1 - a) (a^2 + GAP): past a fold at 0, to a flow at 1."""

    halo: Halo = ALONE

    def sizes(self, areas):
        return np.ones((1, 1))

    def norm(self, rows):
        return float(np.linalg.norm(rows))

    def uniform(self, stream):
        return stream[None].copy()

    def residual(self, states, areas, stream):
        a = states[0, 1]
        return np.array([[0.0, (a - 1.0) * (a * a + GAP), 0.0, 0.0, 0.0]])


class FoldSystem(newton._StepSystem):
    """Linear system of a step of it, solved exactly."""

    @classmethod
    def of(cls, at, pattern, states, cfl, is_long, factor=None):
        a = states[0, 1]
        slope = a * a + GAP + 2.0 * a * (a - 1.0)
        return cls(at, slope, np.eye(5, dtype=np.float32)[None] / np.float32(cfl), None)

    def solve(self, settings, residual, part, is_rough):
        return -residual / (self.diagonal[0, 0, 0] + self.linearization), 1


@pytest.fixture
def past_a_fold(monkeypatch):
    """A run on the near side of where steady states have ended."""
    monkeypatch.setattr(newton, "_StepSystem", FoldSystem)
    stream = np.array([1.0, -1.0, 0.0, 0.0, 1.0])

    def fly(a):
        return newton.solve_flow(
            Fold(), np.zeros((0, 3)), stream, pattern=None, states=stream[None] * np.array([1.0, -a, 1.0, 1.0, 1.0])
        )

    return fly


STARTS = pytest.mark.parametrize("start", [-0.01, -0.02, -0.05, -0.1])


@STARTS
def test_a_run_is_carried_past_the_end_of_steady_states_to_the_flow_behind_it(past_a_fold, start):
    solution = past_a_fold(start)
    assert any(step.stagnates_from for step in solution.history)
    assert solution.is_converged
    np.testing.assert_allclose(solution.states[0, 1], 1.0, atol=1e-9)


@STARTS
def test_steps_that_let_only_the_residual_lead_the_time_step_go_to_and_fro_there(past_a_fold, monkeypatch, start):
    monkeypatch.setattr(newton, "lowest_before", lambda settings, history: 0.0)
    solution = past_a_fold(start)
    assert not solution.is_converged
    assert abs(solution.states[0, 1]) < 0.01


def test_a_step_that_takes_back_what_grows_is_not_taken(past_a_fold, monkeypatch):
    monkeypatch.setitem(globals(), "GAP", 1e-6)
    backward = [step for step in past_a_fold(-0.01).history if step.stagnates_from and step.course.is_backward]
    assert len(backward) > 1
    assert all(step.length == 0.0 for step in backward[1:])  # the first one is what tells that the run stagnates


@pytest.mark.slow
def test_a_flow_with_shocks_about_a_fine_grid_of_another_project_is_found(real_grids):
    whole = read_grid(real_grids / "pyhyp_m6_9blocks.xyz")
    blocks = tuple(replace(block, nodes=block.nodes[:, :, ::2].copy()) for block in whole.blocks)
    grid = with_guessed_patches(replace(whole, blocks=blocks))  # every other layer off the wing
    topology, nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
    flow = FlowGrid.of(topology, nodes, "xzy", shock_threshold=0.05)
    levels = coarse_levels(topology, nodes, useful_levels(topology), "xzy", shock_threshold=0.05)
    stream = free_stream(0.84, np.radians(3.0), flow.axes)
    solutions = []
    for solution in cold_solutions(flow, levels, nodes, flow.areas(nodes), stream):
        solutions.append(solution)
        if solution.is_converged:  # which way it is depends on rounding; the first one where this was written
            break
    assert solutions[-1].is_converged
    assert any(step.stagnates_from for solution in solutions for step in solution.history)


@pytest.mark.slow
def test_a_flow_whose_residual_goes_to_and_fro_above_the_level_of_others_is_found_at_once():
    grid = onera_m6_grid((17, 17, 13))
    topology, nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
    flow = FlowGrid.of(topology, nodes, "xzy", shock_threshold=0.05)
    levels = coarse_levels(topology, nodes, useful_levels(topology), "xzy", shock_threshold=0.05)
    stream = free_stream(0.92, np.radians(5.0), flow.axes)
    solution = next(cold_solutions(flow, levels, nodes, flow.areas(nodes), stream))
    assert solution.is_converged  # from the first start, in whatever order BLAS sums up: steps are others each time
