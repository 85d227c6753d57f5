"""Solvers of PETSc on several processes: moves, derivatives and failures are those of one process, alike everywhere."""

from functools import partial

import numpy as np
from mover_cases import assert_derivative_is_transposed, bent_surface, oblique_channel, random_changes, wing
from parallel_checks import assert_same_everywhere, raised_everywhere

from bspline_mdao.base.numerics.processes import world
from bspline_mdao.base.sparse.blocks import BlockMatrix
from bspline_mdao.core.movement.equilibrium import Unknowns
from bspline_mdao.movers import LinearElasticity, PetscCholesky, PetscMultigrid, TorsionalSprings

comm = world()

DIRECT, ITERATED = (PetscCholesky(comm), 1e-13), (PetscMultigrid(comm), 3e-10)

for mesh, solvers in ((oblique_channel(), (DIRECT, ITERATED)), (wing(), (DIRECT,))):
    initial, surface = bent_surface(mesh, 0.05)
    changes = random_changes(mesh)
    for mover in (LinearElasticity, TorsionalSprings):
        expected = mover(mesh, n_increments=2).move(initial, surface)
        for solver, tolerance in solvers:
            movement = mover(mesh, n_increments=2, solver=solver).move(initial, surface)
            np.testing.assert_allclose(movement.points, expected.points, rtol=0.0, atol=tolerance * mesh.size)
            assert_derivative_is_transposed(movement)
            found, exact = movement.jvp(*changes), expected.jvp(*changes)
            assert abs(found - exact).max() <= tolerance * abs(exact).max()
            assert_same_everywhere(comm, movement.points, found, *movement.vjp(found))
            assert movement.report.increments[0].solve.solver.endswith(f"on {comm.size} processes")

mesh = wing()
elements = LinearElasticity(mesh)._elements(mesh.points, mesh.points)
whole, own = Unknowns(mesh), Unknowns(mesh, comm)
matrix = own.matrix(elements.add_stiffness)
assert comm.allreduce(own.pattern.n_owned) == whole.pattern.n
assert own.pattern.n_blocks < (0.8 if comm.size == 2 else 0.7) * whole.pattern.n_blocks
x = np.random.default_rng(0).normal(size=(whole.pattern.n, 3))
product = own.pattern.gathered(matrix.dot(x[own.rows])[: own.pattern.n_owned])
expected = whole.matrix(elements.add_stiffness).dot(x)
np.testing.assert_allclose(product, expected, rtol=0.0, atol=1e-13 * abs(expected).max())

for solver in (PetscCholesky(comm), PetscMultigrid(comm)):
    analysis = solver.analyze(own.pattern, mesh.points)
    bad = BlockMatrix(own.pattern, matrix.data.copy())
    if comm.rank == comm.size - 1:
        bad.data[own.pattern.indptr[2] - 1, 1, 1] *= -1.0
    row = whole.pattern.n * (comm.size - 1) // comm.size + 2
    error = raised_everywhere(comm, partial(analysis.factorize, bad))
    assert f"block row {row};" in str(error), error
    assert analysis.factorize(matrix).solve(x).residual < 1e-10
print("done", comm.rank)
