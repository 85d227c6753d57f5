"""Order of accuracy of the Euler solver from exact solutions, and wings and spheres of other projects."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from euler_cases import (
    AXES,
    OpenEnds,
    bend,
    bend_grid,
    case_of,
    cell_centres,
    faces_of,
    sphere_quarters,
    vortex,
    with_guessed_patches,
)

from bspline_mdao.flow.euler.entropy_drag import EntropyDrag
from bspline_mdao.flow.euler.gas import GAMMA
from bspline_mdao.flow.loads.stream import stream_axes
from bspline_mdao.grids.io.files import read_grid

pytestmark = pytest.mark.slow

SPHERE_MACH = 0.2
CROSS_SECTION = 0.25 * np.pi
"""Of the quarter of a sphere of radius 1 (m^2)."""

SPHERE_SPEED = 1.5 + 551.0 / 1760.0 * SPHERE_MACH**2
"""Largest speed on a sphere by that of the stream: two terms of the expansion of Janzen and Rayleigh."""


def pressure_coefficient(speed, mach):
    """Of isentropic flow at a speed by that of the stream."""
    pressure = (1.0 + 0.5 * (GAMMA - 1.0) * mach**2 * (1.0 - speed**2)) ** (GAMMA / (GAMMA - 1.0))
    return (pressure - 1.0) / (0.5 * GAMMA * mach**2)


SPHERE_CP = pressure_coefficient(SPHERE_SPEED, SPHERE_MACH)


def orders(errors, ratios):
    """Observed orders between members of a family, the errors in rows and what they are of in columns."""
    return (np.log(errors[:-1] / errors[1:]).T / np.log(ratios)).T


def vortex_error(nodes):
    """Root mean square of the error of each state, of cells of equal weight, in a bend with a vortex."""
    grid = bend_grid(nodes)
    case = case_of(grid)
    middles = case.nodes[case.faces.corners].mean(axis=1)
    case = replace(case, discretization=OpenEnds.around(case.faces, vortex(middles)))
    exact = vortex(cell_centres(nodes))
    solution = case.solve(states=exact)
    assert solution.is_converged
    return np.sqrt(np.mean((solution.states - exact) ** 2, axis=0))


@pytest.mark.parametrize("wave", [0.0, 0.1])
def test_a_vortex_in_a_bend_is_solved_to_second_order(wave):
    errors = np.array([vortex_error(bend(n, wave)) for n in (12, 24, 48)])
    in_plane = errors[:, [0, 1, 2, 4]]
    assert orders(in_plane, [2.0, 2.0]).min() > 1.9
    assert in_plane[-1].max() < 5e-5
    assert errors[:, 3].max() < 1e-9


def test_a_vortex_among_grid_lines_curved_in_space_is_solved_to_second_order():
    errors = np.array([vortex_error(bend(n, 0.1, n_span=n)) for n in (12, 16, 20)])
    assert orders(errors, [16 / 12, 20 / 16]).min() > 1.9


def entropy_drag(case, solution):
    """Drag coefficient of the entropy that leaves a quarter of a sphere through the far field."""
    boundary, drag = case.areas[case.faces.n_inner :], EntropyDrag.of(case.discretization, np.eye(3))
    return drag.evaluate(solution.states, boundary, 0.0, SPHERE_MACH) / CROSS_SECTION


@cache
def spheres():
    """Cells along an eighth of a circle, least and largest pressure coefficient, drag and entropy drag of each."""
    rows = []
    for grid, n in zip(sphere_quarters([6, 4, 3]), (4, 6, 8)):
        case = case_of(grid, mach=SPHERE_MACH, degrees=0.0, axes=np.eye(3))
        solution = case.solve()
        assert solution.is_converged
        _, cp = case.pressure_coefficients(solution.states)
        rows.append(
            [n, cp.min(), cp.max(), case.force(solution.states, CROSS_SECTION)[0], entropy_drag(case, solution)]
        )
    return np.array(rows).T


def test_the_drag_of_a_sphere_falls_at_second_order():
    n, _, _, drag, _ = spheres()
    assert orders(drag, n[1:] / n[:-1]).min() > 1.9
    assert 0.0 < drag[-1] < 5e-3


def test_the_drag_of_a_sphere_is_that_of_the_entropy_that_leaves():
    *_, drag, entropy = spheres()
    np.testing.assert_allclose(entropy, drag, rtol=0.03)


def test_the_least_pressure_on_a_sphere_tends_to_that_of_compressible_flow():
    n, cp, _, _, _ = spheres()
    assert pytest.approx(-1.2712, abs=1e-4) == SPHERE_CP
    assert orders(np.abs(cp - SPHERE_CP), n[1:] / n[:-1]).min() > 1.9
    assert cp[-1] == pytest.approx(SPHERE_CP, rel=5e-3)


def test_the_pressure_at_the_nose_of_a_sphere_tends_to_that_of_stagnation():
    n, _, cp, _, _ = spheres()
    gap = pressure_coefficient(0.0, SPHERE_MACH) - cp
    assert (gap > 0.0).all()
    assert orders(gap, n[1:] / n[:-1]).min() > 1.5


def test_a_sphere_of_another_project_has_the_least_pressure_of_potential_flow_and_no_lift(real_grids):
    grid = read_grid(real_grids / "hopr_sphere_20blocks.cgns")
    names = {patch.name for patch in faces_of(grid).boundary}
    kinds = {name: "wall" if name == "BC_sphere" else "farfield" for name in names}
    case = case_of(grid, kinds, mach=SPHERE_MACH, degrees=0.0, axes=np.eye(3))
    solution = case.solve()
    _, cp = case.pressure_coefficients(solution.states)
    force = case.force(solution.states, np.pi * 500.0**2)
    assert solution.is_converged
    assert cp.min() == pytest.approx(-1.25, rel=0.02)
    assert np.abs(force[1:]).max() < 1e-3


def test_a_wing_has_the_lift_and_no_more_drag_than_other_solvers_find_on_its_grid(real_grids):
    case = case_of(with_guessed_patches(read_grid(real_grids / "hh_naca0012_12blocks.xyz")))
    solution = case.solve()
    drag, lift = stream_axes(np.radians(4.0), AXES) @ case.force(solution.states, 3.0)
    assert solution.residual < 1e-10
    assert lift == pytest.approx(0.3116, rel=0.03)  # ADflow
    assert lift == pytest.approx(0.3050, rel=0.05)  # OpenFOAM
    assert drag <= 0.0114
