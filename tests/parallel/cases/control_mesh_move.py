"""Every mover behind `ControlMeshMove` on several processes: control points, products and failures are those of one."""

import logging
import sys
from functools import partial

import numpy as np
import openmdao.api as om
from mover_cases import MOVERS, bent_surface, channel, made, random_changes
from parallel_checks import assert_same_everywhere, raised_everywhere

from bspline_mdao import ControlMeshMove
from bspline_mdao.base.numerics.processes import world
from bspline_mdao.core.movement import shared
from bspline_mdao.core.movement.equilibrium_mover import EquilibriumMover
from bspline_mdao.movers import LinearElasticity, PetscMultigrid
from bspline_mdao.names import CONTROL_CORNER_KS, CONTROL_POINTS, CONTROL_POINTS_INITIAL, SURFACE_CONTROL_POINTS

comm, mesh = world(), channel()
WRT = [CONTROL_POINTS_INITIAL, SURFACE_CONTROL_POINTS]
SOLVERS = ["MUMPS", "BoomerAMG"] if "petsc4py" in sys.argv else []


def problem_of(mover, **options):
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("move", ControlMeshMove(mover=mover, **options), promotes=["*"])
    problem.setup()
    return problem


def run(problem, initial, surface):
    problem[CONTROL_POINTS_INITIAL], problem[SURFACE_CONTROL_POINTS] = initial.ravel(), surface.ravel()
    problem.run_model()
    return problem[CONTROL_POINTS].reshape(-1, 3)


def check_products(problem, expected, tolerance):
    """Products both ways: transposes of each other, those of one process, and the same on all."""
    changes = random_changes(mesh)
    seeds = {name: change.ravel() for name, change in zip(WRT, changes)}
    bar = np.random.default_rng(5).normal(size=mesh.points.size)
    forward = problem.compute_jacvec_product([CONTROL_POINTS], WRT, "fwd", seeds)[CONTROL_POINTS]
    reverse = problem.compute_jacvec_product([CONTROL_POINTS], WRT, "rev", {CONTROL_POINTS: bar})
    reverse = [reverse[name] for name in WRT]
    there, back = bar @ forward, sum(r.ravel() @ c.ravel() for r, c in zip(reverse, changes))
    assert abs(there - back) <= 1e-11 * np.linalg.norm(bar) * np.linalg.norm(forward)
    assert_same_everywhere(comm, forward, *reverse)
    exact = expected.jvp(*changes), *expected.vjp(bar.reshape(-1, 3))
    for found, wanted in zip((forward, *reverse), exact):
        assert abs(found - wanted.ravel()).max() <= tolerance * abs(wanted).max()


for kind, case in MOVERS.items():
    initial, surface = bent_surface(mesh, case.slope_bend)
    mover = made(kind, mesh, 2)
    expected = mover.move(initial, surface)
    problem = problem_of(mover)
    points = run(problem, initial, surface)
    np.testing.assert_array_equal(points, expected.points)
    check_products(problem, expected, 1e-13)
    component = problem.model.move
    assert f"on the first of {comm.size} processes (" in str(component.report)
    assert (comm.rank == 0) == (component._last.movement.movement is not None)  # no other has a factor
    if not issubclass(kind, EquilibriumMover):
        assert f"{kind.__name__} shares no system" in component.report.where
        forced = problem_of(mover, processes="all")
        error = raised_everywhere(comm, forced.run_model)
        assert "give processes='first'" in str(error)
    elif SOLVERS:
        forced = problem_of(mover, processes="all")
        points = run(forced, initial, surface)
        assert_same_everywhere(comm, points)
        np.testing.assert_allclose(points, expected.points, rtol=0.0, atol=1e-13 * mesh.size)
        check_products(forced, expected, 1e-12)
        assert f"by MUMPS on {comm.size} processes" in str(forced.model.move.report)
        assert f"on all {comm.size} processes (as asked)" in str(forced.model.move.report)

initial, surface = bent_surface(mesh, 0.02)
if SOLVERS:
    own = problem_of(LinearElasticity(mesh, n_increments=2, solver=PetscMultigrid()))
    expected = LinearElasticity(mesh, n_increments=2).move(initial, surface)
    assert abs(run(own, initial, surface) - expected.points).max() < 3e-10 * mesh.size
    check_products(own, expected, 3e-9)
    assert "on all" in own.model.move.report.where
    kept, shared.PART_OF_MEMORY = (shared.PART_OF_MEMORY, shared._memory), 1e-12
    too_little, enough = (lambda comm: 10**10), (lambda comm: 10**24)  # after the part of it that factors may take
    for memory, name in ((too_little, "BoomerAMG"), (enough, "MUMPS")):
        shared._memory = memory
        large = problem_of(LinearElasticity(mesh, n_increments=1))
        run(large, initial, surface)
        assert name in large.model.move.report.increments[0].solve.solver
        assert "GB, more than" in large.model.move.report.where
    shared.PART_OF_MEMORY, shared._memory = kept

for way in ("first", "all")[: 2 if SOLVERS else 1]:
    problem = problem_of(LinearElasticity(mesh, n_increments=1), processes=way)
    good = run(problem, initial, surface)
    far = surface + np.array([0.0, 0.0, 3.0]) * np.sin(5.0 * surface[:, :1])
    run(problem, initial, far)
    assert problem.model.move.report.first_tangled()
    assert_same_everywhere(comm, problem.get_val(CONTROL_CORNER_KS))
    broken = surface.copy()
    if comm.rank == comm.size - 1:
        broken[3, 1] = np.nan
    error = raised_everywhere(comm, partial(run, problem, initial, broken))
    assert isinstance(error, om.AnalysisError)
    assert "point 4" in str(error)
    np.testing.assert_allclose(run(problem, initial, surface), good, rtol=0.0, atol=1e-14 * mesh.size)


class Kept(logging.Handler):
    """Keeps what is logged."""

    def __init__(self):
        super().__init__()
        self.records = []

    def emit(self, record):
        self.records.append(record.getMessage())


kept = Kept()
logging.getLogger("bspline_mdao.core.om.control_mesh_move").addHandler(kept)
problem = problem_of(LinearElasticity(mesh, n_increments=1))
far = surface + np.array([0.0, 0.0, 3.0]) * np.sin(5.0 * surface[:, :1])
for points in (surface, far, far, surface):
    run(problem, initial, points)
assert len(kept.records) == (1 if comm.rank == 0 else 0), kept.records
print("done", comm.rank)
