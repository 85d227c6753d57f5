"""Factors belong to whoever asked for a move: components that share a mover do not disturb each other."""

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np
import openmdao.api as om
import pytest
from mover_cases import CountingSolver, bent_surface, channel

from bspline_mdao import ControlMeshMove
from bspline_mdao.movers import LinearElasticity, TorsionalSprings
from bspline_mdao.names import CONTROL_POINTS, CONTROL_POINTS_INITIAL, SURFACE_CONTROL_POINTS

NAMES = "first", "second"
KINDS = LinearElasticity, TorsionalSprings


def designs(mesh):
    """Initial points of each of two components, and three surfaces for each."""
    found = {}
    for number, name in enumerate(NAMES):
        initial = (1.0 + 0.01 * number) * mesh.points
        bends = [bent_surface(mesh, size=0.015, seed=seed)[1] - mesh.points[mesh.surface_ids] for seed in range(3)]
        found[name] = initial, [initial[mesh.surface_ids] + bend for bend in bends]
    return found


def problem_of(mover, *names):
    problem = om.Problem(reports=False)
    for name in names:
        problem.model.add_subsystem(name, ControlMeshMove(mover=mover))
    problem.setup()
    return problem


def run(problem, name, initial, surface):
    """Points and a reverse product of one component at one design."""
    problem.set_val(f"{name}.{CONTROL_POINTS_INITIAL}", initial.ravel())
    problem.set_val(f"{name}.{SURFACE_CONTROL_POINTS}", surface.ravel())
    problem.run_model()
    points = problem.get_val(f"{name}.{CONTROL_POINTS}").copy()
    inputs = [f"{name}.{CONTROL_POINTS_INITIAL}", f"{name}.{SURFACE_CONTROL_POINTS}"]
    product = problem.compute_jacvec_product(
        [f"{name}.{CONTROL_POINTS}"], inputs, "rev", {f"{name}.{CONTROL_POINTS}": points}
    )
    return [points, *(product[name].copy() for name in inputs)]


def alone(kind, mesh):
    """What each component gives with a mover of its own."""
    return {
        name: [run(problem_of(kind(mesh, n_increments=2), name), name, initial, surface) for surface in surfaces]
        for name, (initial, surfaces) in designs(mesh).items()
    }


def assert_equal(found, expected):
    for mine, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(mine, other)


@pytest.mark.parametrize("kind", KINDS)
def test_two_components_with_one_mover_make_the_factor_of_their_initial_points_once_each(kind):
    mesh, solver = channel(), CountingSolver()
    expected = alone(kind, mesh)
    problem = problem_of(kind(mesh, n_increments=2, keep_factors=True, solver=solver), *NAMES)
    cases = designs(mesh)
    for name in NAMES:
        problem.set_val(f"{name}.{CONTROL_POINTS_INITIAL}", cases[name][0].ravel())
        problem.set_val(f"{name}.{SURFACE_CONTROL_POINTS}", cases[name][0][mesh.surface_ids].ravel())
    problem.run_model()
    solver.factorised.clear()
    for number in range(3):
        for name in NAMES:
            initial, surfaces = cases[name]
            assert_equal(run(problem, name, initial, surfaces[number]), expected[name][number])
    assert len(solver.factorised) == 3 * len(NAMES)  # of the second increments alone


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_two_threads_with_one_mover_get_what_each_gets_alone(kind):
    mesh, solver, together = channel(), CountingSolver(), Barrier(2)
    expected, cases = alone(kind, mesh), designs(mesh)
    mover = kind(mesh, n_increments=2, keep_factors=True, solver=solver)

    def all_of(name):
        initial, surfaces = cases[name]
        problem, found = problem_of(mover, name), []
        for surface in surfaces * 2:
            together.wait(60.0)
            found.append(run(problem, name, initial, surface))
        return found

    with ThreadPoolExecutor(2) as threads:
        found = dict(zip(NAMES, threads.map(all_of, NAMES)))
    for name in NAMES:
        for mine, other in zip(found[name], expected[name] * 2, strict=True):
            assert_equal(mine, other)
    assert len(solver.factorised) == len(NAMES) * (1 + 6)
