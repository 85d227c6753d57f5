"""Forces on the nodes of a wall: the sum and the moment of the pressures, exact derivatives, wrong surfaces."""

from functools import cache

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import EulerFlow, InputError, fit_grid
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.forces import FlowForces
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.euler.wall_forces import WallForces
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.measures import SurfaceGrid

AREA, CHORD, POINT = 1.16, 0.7, (0.3, 0.1, -0.2)


@cache
def wing():
    return fit_grid(onera_m6_grid((9, 7, 6)))


def random_case(seed=0):
    """Forces on the wing, states far from uniform, nodes off the baseline, Mach number and dynamic pressure (Pa)."""
    rng, nodes = np.random.default_rng(seed), wing().regenerate().to_vector().reshape(-1, 3)
    flow, surface = FlowGrid.of(wing().topology, nodes), SurfaceGrid.of(wing())
    states = flow.discretization.uniform(free_stream(0.4, 0.1, flow.axes))
    states *= rng.uniform(0.8, 1.2, states.shape)
    nodes = nodes + 1e-3 * rng.standard_normal(nodes.shape)
    return flow, WallForces.of(flow, surface.quads, surface.rows), (states, nodes, 0.4, 7e3)


@pytest.mark.slow
def test_the_nodes_carry_the_force_and_the_moment_of_the_faces():
    flow, wall_forces, (states, nodes, mach, pressure) = random_case()
    forces, places = wall_forces.evaluate(states, nodes, mach, pressure), nodes[SurfaceGrid.of(wing()).rows]
    exact = FlowForces.of(flow, nodes, AREA, CHORD, POINT).evaluate(states, nodes, 0.0, mach)
    drag, _, lift = flow.axes @ forces.sum(axis=0) / (pressure * AREA)
    moment = np.cross(places - np.array(POINT), forces).sum(axis=0) / (pressure * AREA * CHORD)
    np.testing.assert_allclose([lift, drag], [exact["CL"], exact["CD"]], rtol=1e-12)
    np.testing.assert_allclose(moment, exact["CM"], rtol=1e-12)


def directions(at, seed=1):
    rng = np.random.default_rng(seed)
    return [rng.standard_normal(np.shape(value)) if np.ndim(value) else rng.standard_normal() for value in at]


def test_forces_on_nodes_agree_with_complex_steps_in_everything():
    _, forces, at = random_case()
    along = directions(at)
    exact = np.imag(forces.evaluate(*(a + 1e-30j * d for a, d in zip(at, along)))) / 1e-30
    np.testing.assert_allclose(forces.jvp(*at, *along), exact, rtol=0, atol=1e-13 * np.abs(exact).max())


@pytest.mark.parametrize("only", range(4))
def test_products_with_forces_on_nodes_are_transposes(only):
    _, forces, at = random_case()
    along = [d if k == only else 0.0 * d for k, d in enumerate(directions(at))]
    change = forces.jvp(*at, *along)
    bar = np.random.default_rng(2).standard_normal(change.shape)
    back = forces.vjp(*at, bar)[only]
    assert np.sum(np.asarray(back) * along[only]) == pytest.approx(np.sum(change * bar), rel=1e-12)


def test_a_part_of_the_walls_carries_the_pressures_on_that_part():
    flow, whole, at = random_case()
    patches = sorted(set(SurfaceGrid.of(wing()).patches))
    parts, total = [], np.zeros((len(at[1]), 3))
    for patch in patches:
        surface = SurfaceGrid.of(wing(), patch)
        part = WallForces.of(flow, surface.quads, surface.rows)
        total[surface.rows] += part.evaluate(*at)
        parts.append(part.n_faces)
    assert len(patches) > 1
    assert sum(parts) == whole.n_faces
    np.testing.assert_allclose(total[SurfaceGrid.of(wing()).rows], whole.evaluate(*at), rtol=0, atol=1e-9)


def problem(loaded, **values):
    problem = om.Problem(reports=False)
    flow = EulerFlow(model=wing(), reference_area=AREA, loaded=loaded, iprint=0)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup()
    for name, value in values.items():
        problem.set_val(name, value)
    problem.run_model()
    return problem


def test_the_flow_hands_out_forces_in_newtons():
    flown = problem(SurfaceGrid.of(wing()), dynamic_pressure=6e3, alpha=3.0)
    force = flown.get_val("wall_forces", units="N").reshape(-1, 3).sum(axis=0)
    drag = force @ [np.cos(np.radians(3.0)), np.sin(np.radians(3.0)), 0.0]
    assert drag == pytest.approx(6e3 * AREA * flown.get_val("CD").item(), rel=1e-11)
    assert "wall_forces" not in {meta["prom_name"] for meta in problem(None).model.get_io_metadata().values()}


def test_forces_without_a_dynamic_pressure_are_refused():
    with pytest.raises(InputError, match="dynamic_pressure is nan; give the free stream's") as error:
        problem(SurfaceGrid.of(wing()))
    assert "\n" not in str(error.value)


def test_a_surface_that_is_no_wall_is_refused():
    (symmetry,) = {face.patch for face in wing().topology.boundary if face.kind == "symmetry"}
    with pytest.raises(InputError, match="faces of the surface are no walls of the flow; take a surface of walls"):
        problem(SurfaceGrid.of(wing(), symmetry), dynamic_pressure=1.0)
