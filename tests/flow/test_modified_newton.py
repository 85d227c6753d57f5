"""Designs near one that is known are solved with its Jacobian and factor."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest
from euler_cases import case_of, sphere_quarters

from bspline_mdao.flow.euler import newton
from bspline_mdao.flow.euler.adjoint import FlowTangent
from bspline_mdao.flow.euler.block_factor import BlockFactor
from bspline_mdao.flow.euler.flow_grid import area_vectors
from bspline_mdao.flow.euler.modified_newton import solve_nearby
from bspline_mdao.flow.euler.preconditioner import compact_factor
from bspline_mdao.flow.euler.residual import Discretization


@dataclass(frozen=True, eq=False)
class Jacobian:
    """Jacobian of a solution, as often as it is asked for one."""

    case: object
    states: np.ndarray

    @cached_property
    def linearization(self):
        return self.case.discretization.linearize(self.states, self.case.areas, self.case.stream)

    @cached_property
    def factor(self):
        still = np.zeros((self.case.faces.n_cells, 5, 5))
        return compact_factor(self.linearization, self.case.pattern, still)


@pytest.fixture(scope="module")
def known():
    """Flow about a quarter of a ball, and its Jacobian."""
    (grid,) = sphere_quarters([6])
    case = case_of(grid, mach=0.2, degrees=0.0, axes=np.eye(3))
    solution = case.solve()
    return case, solution, Jacobian(case, solution.states)


def areas_of(case, stretch):
    """Area vectors of the grid stretched along x by as much at the ball, and not at all far away."""
    nodes = case.nodes.copy()
    nodes[:, 0] *= 1.0 + stretch * np.exp(1.0 - np.sum(nodes**2, axis=1))
    return area_vectors(nodes, case.faces.corners)


def test_a_design_nearby_is_solved_without_another_jacobian(known, monkeypatch):
    case, solution, tangent = known
    assert tangent.factor is not None
    monkeypatch.setattr(Discretization, "linearize", None)
    areas = areas_of(case, 0.01)
    nearby = solve_nearby(case.discretization, areas, case.stream, states=solution.states, tangent=tangent)
    assert nearby.is_converged, nearby.history
    monkeypatch.undo()
    own = newton.solve_flow(case.discretization, areas, case.stream, pattern=case.pattern)
    np.testing.assert_allclose(nearby.states, own.states, atol=1e-9)
    assert sum(s.n_products for s in nearby.history) < 0.8 * sum(s.n_products for s in own.history)


def test_a_tangent_keeps_one_factor_and_finds_the_other_from_it(known):
    case, solution, _ = known
    tangent = FlowTangent.of(case.discretization, solution.states, case.areas, case.stream, case.pattern)
    right = np.random.default_rng(3).standard_normal(solution.states.shape)
    first, transposed = tangent.factor.solve(right), tangent.transposed_factor.solve(right)
    assert "factor" not in vars(tangent)
    np.testing.assert_array_equal(tangent.factor.solve(right), first)
    assert "transposed_factor" not in vars(tangent)
    assert not np.allclose(first, transposed)


@pytest.mark.parametrize("names", [("factor", "transposed_factor"), ("transposed_factor", "factor")])
def test_a_factor_whose_transposition_was_interrupted_is_not_kept(known, monkeypatch, names):
    case, solution, _ = known
    tangent = FlowTangent.of(case.discretization, solution.states, case.areas, case.stream, case.pattern)
    getattr(tangent, names[0])

    def interrupt(factor):
        raise KeyboardInterrupt

    monkeypatch.setattr(BlockFactor, "into_transposed", interrupt)
    with pytest.raises(KeyboardInterrupt):
        getattr(tangent, names[1])
    assert not {"factor", "transposed_factor"} & set(vars(tangent))


def test_a_solution_takes_no_step_and_no_factor(known):
    case, solution, _ = known
    field = case.discretization, case.areas, case.stream
    nearby = solve_nearby(*field, states=solution.states, tangent=None)
    assert len(nearby.history) == 1
    assert nearby.states is solution.states


def test_a_design_far_away_is_given_up_with_states_no_worse_than_those_at_the_start(known):
    case, solution, tangent = known
    steps = []
    nearby = solve_nearby(
        case.discretization,
        areas_of(case, 0.8),
        case.stream,
        states=solution.states,
        tangent=tangent,
        progress=lambda step, states: steps.append(step),
    )
    assert not nearby.is_converged
    assert tuple(steps) == nearby.history[1:]
    assert nearby.residual <= nearby.history[0].residual
    assert nearby.residual == pytest.approx(
        newton.relative_residual(case.discretization, nearby.states, areas_of(case, 0.8), case.stream), rel=1e-6
    )
