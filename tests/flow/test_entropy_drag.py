"""Drag of the entropy that leaves through the far field: what is taken off, and what is left to first order."""

from functools import cache

import numpy as np
import pytest

from bspline_mdao import find_topology
from bspline_mdao.flow.euler.entropy_drag import EntropyDrag, entropy_flux, entropy_scale, relative_entropy
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.gas import GAMMA, free_stream
from bspline_mdao.generators import infinite_wing_grid, naca_section, onera_m6_grid

ALPHA, MACH = 0.1, 0.4

GRIDS = {"wing": lambda: onera_m6_grid((5, 6, 7)), "section": lambda: infinite_wing_grid(naca_section(0.12), (9, 7))}
"""The states outside the second one are those of a vortex."""

BOTH = pytest.mark.parametrize("name", GRIDS)


@cache
def case(name):
    """Flow grid, drag, random states and area vectors of all faces, one at the far field without any."""
    grid, rng = GRIDS[name](), np.random.default_rng(3)
    nodes = grid.to_vector().reshape(-1, 3)
    flow = FlowGrid.of(find_topology(grid), nodes)
    stream = free_stream(MACH, ALPHA, flow.axes)
    states = flow.discretization.uniform(stream) * rng.uniform(0.9, 1.1, (flow.faces.n_cells, 5))
    areas = flow.areas(nodes)
    areas += 1e-3 * np.abs(areas).max() * rng.standard_normal(areas.shape)
    areas[flow.faces.faces_of("farfield")[2]] = 0.0
    return flow, EntropyDrag.of(flow.discretization, flow.axes), states, areas


@BOTH
def test_drag_is_the_flux_of_the_entropy_less_the_sum_of_the_residuals(name):
    """Times the derivatives of the entropy in conservative variables, those of the stream."""
    flow, drag, states, areas = case(name)
    first, far, stream = flow.faces.n_inner, flow.faces.faces_of("farfield"), free_stream(MACH, ALPHA, flow.axes)
    areas = areas - areas[first:].sum(axis=0) / len(areas[first:]) * (np.arange(len(areas)) >= first)[:, None]
    u = stream[1:4]
    heat = GAMMA * (GAMMA - 1.0)
    by_conserved = np.concatenate([[0.5 * heat * (u @ u) - GAMMA], -heat * u, [heat]])
    outflow = flow.discretization.residual(states, areas, stream).sum(axis=0)
    entropy = np.sum(entropy_flux(states[flow.faces.left[far]], areas[far]))
    found = drag.evaluate(states, areas[first:], ALPHA, MACH)
    assert flow.discretization.vortex is not None if name == "section" else flow.discretization.vortex is None
    assert found * entropy_scale(MACH) == pytest.approx(entropy - by_conserved @ outflow, rel=1e-10)


def test_entropy_leaves_with_the_flow_and_hardly_against_it():
    rng = np.random.default_rng(4)
    w, s = free_stream(0.6, 0.0, np.eye(3)) * rng.uniform(0.9, 1.1, (7, 5)), np.tile([2.0, 0.0, 0.0], (7, 1))
    carried = w[:, 0] * (w[:, 1:4] * s).sum(axis=1) * relative_entropy(w)
    np.testing.assert_allclose(entropy_flux(w, s), carried, rtol=3e-3)
    np.testing.assert_allclose(entropy_flux(w, -s), 0.0, atol=3e-3 * np.abs(carried).max())


@BOTH
def test_nothing_at_the_far_field_is_left_to_first_order_about_the_stream(name):
    flow, drag, _, areas = case(name)
    nodes = areas[flow.faces.n_inner :]
    uniform = flow.discretization.uniform(free_stream(MACH, ALPHA, flow.axes))
    by_state, by_area, _, _ = drag.vjp(uniform, nodes, ALPHA, MACH, 1.0)
    at_walls = np.zeros_like(uniform)
    np.add.at(at_walls[:, 4], drag.slip_cells, drag.weights * (nodes[drag.slip] @ uniform[0, 1:4])[:, None])
    np.testing.assert_allclose(by_state, at_walls / (0.5 * MACH**3), rtol=1e-12, atol=1e-13 * np.abs(areas).max())
    np.testing.assert_allclose(by_area, 0.0, atol=1e-14)


@BOTH
def test_derivatives_are_those_of_complex_steps_and_transposes(name):
    flow, drag, states, areas = case(name)
    rng, at = np.random.default_rng(5), (states, areas[flow.faces.n_inner :], ALPHA, MACH)
    along = [rng.standard_normal(np.shape(part)) * (np.asarray(part) != 0.0) for part in at]
    step = 1e-30
    exact = np.imag(drag.evaluate(*(part + 1j * step * d for part, d in zip(at, along)))) / step
    assert drag.jvp(*at, *along) == pytest.approx(exact, rel=1e-12)
    back = drag.vjp(*at, 1.7)
    assert sum(np.sum(bar * d) for bar, d in zip(back, along)) == pytest.approx(1.7 * exact, rel=1e-12)
