"""Transonic flow: a section with a shock, its convergence, derivatives, and what the sensor leaves alone."""

import importlib
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from euler_cases import AXES, case_of

from bspline_mdao.flow.euler.flux import face_flux
from bspline_mdao.flow.euler.gas import GAMMA, free_stream, free_stream_partials
from bspline_mdao.flow.euler.krylov import solve_refined
from bspline_mdao.flow.euler.newton import solve_flow
from bspline_mdao.flow.euler.preconditioner import compact_factor
from bspline_mdao.flow.euler.residual import SHOCK_THRESHOLD
from bspline_mdao.flow.loads.stream import stream_axes
from bspline_mdao.flow.om.euler_state import EulerState
from bspline_mdao.generators import FarField, Spacing, infinite_wing_grid, naca_section
from bspline_mdao.grids.cells.hexahedron import cell_quality
from bspline_mdao.grids.topology.detection import find_topology

pytestmark = pytest.mark.slow

MACH, DEGREES = 0.8, 1.25
SPACING = Spacing(off_wall=8e-3, leading=1e-2, trailing=1e-2, tip=0.1)


@cache
def section_grid():
    return infinite_wing_grid(naca_section(0.12), ((13, 25, 13), 13), SPACING, FarField(distance=50.0))


@cache
def section(threshold=SHOCK_THRESHOLD):
    """NACA 0012, 1152 cells."""
    return case_of(section_grid(), mach=MACH, degrees=DEGREES, shock_threshold=threshold)


def solve(case, mach, degrees, **settings):
    """Solve for the flow at a Mach number and an angle."""
    stream, pattern = free_stream(mach, np.radians(degrees), AXES), case.pattern
    return solve_flow(case.discretization, case.areas, stream, pattern=pattern, **settings)


@cache
def transonic():
    return solve(section(), MACH, DEGREES, tolerance=1e-12)


def wall_load(case, mach, degrees):
    """Gradient of lift and drag coefficients in the states, two arrays of shape (n_cells, 5)."""
    wall, stencil = case.faces.faces_of("wall"), case.discretization.stencil
    drag, lift = stream_axes(np.radians(degrees), AXES)
    weights, loads = stencil.means[stencil.classes[wall]], []
    for axis in (lift, drag):
        by_pressure = case.areas[wall] @ axis / (0.5 * mach**2)
        gradient = np.zeros((case.faces.n_cells, 5))
        np.add.at(gradient[:, 4], stencil.cells[wall], weights * by_pressure[:, None])
        loads.append(gradient)
    return loads


def coefficients(case, states, mach, degrees):
    """Lift and drag; walls are closed, so that the constant in the pressure does not matter."""
    return np.array([np.vdot(load, states) for load in wall_load(case, mach, degrees)])


def upper_wall(case, states):
    """Pressure coefficients and Mach numbers of the cells on the upper side, from the leading edge."""
    (patch,) = (patch for patch in case.faces.boundary if patch.name == "wing_upper")
    rho, u, v, w, p = states[case.faces.left[patch.start : patch.stop]].T
    return (p - 1.0 / GAMMA) / (0.5 * MACH**2), np.sqrt((u**2 + v**2 + w**2) * rho / (GAMMA * p))


def test_the_grid_of_a_section_is_valid_and_all_of_its_boundary_is_declared():
    grid = section_grid()
    assert min(cell_quality(block.nodes).min_corner.min() for block in grid.blocks) > 0.0
    faces = find_topology(grid).boundary
    assert {face.kind for face in faces} == {"wall", "symmetry", "farfield"}
    for face in faces:
        z = grid.blocks[face.window.block].nodes[face.window.slices][..., 2]
        assert (np.ptp(z) == 0.0) == (face.kind == "symmetry")


def test_a_section_with_a_shock_converges_to_round_off():
    solution = transonic()
    assert solution.residual < 1e-11
    assert len(solution.history) <= 30


def test_lift_of_the_section_is_that_of_the_literature_but_for_the_coarse_grid():
    lift, drag = coefficients(section(), transonic().states, MACH, DEGREES)
    assert lift == pytest.approx(0.348, rel=0.12)
    assert drag == pytest.approx(0.0225, abs=0.002)


def test_the_shock_is_three_cells_wide_and_does_not_overshoot():
    pressure, mach = upper_wall(section(), transonic().states)
    last = np.flatnonzero(mach > 1.15).max()
    assert mach[last + 3] < 0.95
    assert mach.max() < 1.4
    behind, ahead = pressure[last + 3 : last + 6], pressure[last - 2 : last + 1]
    assert np.ptp(behind) < 0.1
    assert np.ptp(ahead) < 0.1
    assert pressure[last + 1 : last + 3].max() < behind.max() + 0.15


def test_derivatives_at_a_shock_are_those_of_the_residual_by_complex_step():
    case, states, rng = section(), transonic().states, np.random.default_rng(1)
    stream = free_stream(MACH, np.radians(DEGREES), AXES)
    linearization = case.discretization.linearize(states, case.areas, stream)
    sensor = linearization.jacobians.shocks[:, 0]
    assert ((sensor > 0.1) & (sensor < 0.9)).sum() >= 10
    along, other = rng.standard_normal((2, *states.shape))
    areas = rng.standard_normal(case.areas.shape)
    by_state = case.discretization.residual(states + 1e-30j * along, case.areas, stream).imag / 1e-30
    by_area = case.discretization.residual(states, case.areas + 1e-30j * areas, stream).imag / 1e-30
    np.testing.assert_allclose(linearization.state_jvp(along), by_state, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(linearization.area_jvp(areas), by_area, rtol=1e-11, atol=1e-13)
    forward = np.vdot(linearization.state_jvp(along), other)
    assert np.vdot(along, linearization.state_vjp(other)) == pytest.approx(forward, rel=1e-12)


def adjoint_gradients(case, states):
    """Derivatives of lift and drag in the angle (1/deg) by the adjoint."""
    stream, angle = free_stream(MACH, np.radians(DEGREES), AXES), np.radians(DEGREES)
    linearization = case.discretization.linearize(states, case.areas, stream)
    blocks = np.zeros((len(states), 5, 5))
    factor = compact_factor(linearization, case.pattern, blocks).into_transposed()
    rough = linearization.jacobians.transposed_product
    lift, drag = coefficients(case, states, MACH, DEGREES)
    by_stream = linearization.stream_jvp(free_stream_partials(MACH, angle, AXES)[1])
    for load, turned in zip(wall_load(case, MACH, DEGREES), (-drag, lift)):
        adjoint = solve_refined(linearization.state_vjp, rough, factor.solve, load, 1e-12)
        assert adjoint.is_converged
        yield np.radians(turned - np.vdot(adjoint.x, by_stream))


def test_the_adjoint_of_a_flow_with_a_shock_agrees_with_converged_differences():
    case, states, step = section(), transonic().states, 1e-4
    moved = [solve(case, MACH, DEGREES + h, states=states, tolerance=1e-12) for h in (step, -step)]
    after, before = (coefficients(case, s.states, MACH, DEGREES + h) for s, h in zip(moved, (step, -step)))
    np.testing.assert_allclose(list(adjoint_gradients(case, states)), (after - before) / (2.0 * step), rtol=1e-6)


def test_subcritical_flow_does_not_notice_the_sensor():
    slow, without = (solve(section(t), 0.3, DEGREES).states for t in (SHOCK_THRESHOLD, 0.0))
    np.testing.assert_array_equal(slow, without)
    fast = [
        coefficients(section(t), solve(section(t), 0.5, DEGREES).states, 0.5, DEGREES) for t in (SHOCK_THRESHOLD, 0.0)
    ]
    np.testing.assert_allclose(*fast, rtol=1e-6)


@pytest.mark.parametrize("mach", [1.2, 2.0])
def test_a_steady_normal_shock_leaves_nothing_but_dissipation_in_the_flux(mach):
    ratio, rise = (GAMMA + 1) * mach**2 / ((GAMMA - 1) * mach**2 + 2), 1 + 2 * GAMMA / (GAMMA + 1) * (mach**2 - 1)
    ahead = np.array([1.0, mach, 0.0, 0.0, 1.0 / GAMMA])
    behind = np.array([ratio, mach / ratio, 0.0, 0.0, rise / GAMMA])
    mean, jump, s = tuple(0.5 * (ahead + behind)), tuple(behind - ahead), (1.0, 0.0, 0.0)
    one_way, other_way = (np.array(face_flux(mean, j, s, 1.0)) for j in (jump, tuple(ahead - behind)))
    exact = np.array(face_flux(tuple(ahead), (0.0,) * 5, s))
    np.testing.assert_allclose(0.5 * (one_way + other_way), exact, atol=1e-13)


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "run_scripts"))
    return importlib.import_module


def test_the_run_script_flies_the_section_and_draws_it(script, tmp_path):
    numbers = script("transonic_naca0012").main(quick=True, figures=tmp_path)
    for found in numbers.values():
        assert found["residual"] < 1e-10
        assert found["CL"] == pytest.approx(found["CL_literature"], rel=0.12)
    assert numbers["transonic"]["CD"] > 10.0 * numbers["subcritical"]["CD"]
    assert (tmp_path / "transonic_naca0012.png").stat().st_size > 50_000


def test_derivatives_of_the_component_in_the_mach_number_agree_with_differences_at_a_shock(script):
    runs, step, ends = script("transonic_naca0012"), 1e-5, []
    problem = runs.problem_of(runs.section_model(16), MACH, iprint=0)
    problem.final_setup()
    (state,) = problem.model.system_iter(typ=EulerState)
    state.options["tolerance"] = 1e-12  # differences see what is left of the residual
    problem.run_model()
    totals = problem.compute_totals(["CL", "CD"], ["Mach_number"])
    for mach in (MACH + step, MACH - step):
        problem.set_val("Mach_number", mach)
        problem.run_model()
        ends.append(np.array([problem.get_val(of).item() for of in ("CL", "CD")]))
    slopes = [totals[of, "Mach_number"].item() for of in ("CL", "CD")]
    np.testing.assert_allclose(slopes, (ends[0] - ends[1]) / (2.0 * step), rtol=1e-5)
