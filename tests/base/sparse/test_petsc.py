"""Solvers of PETSc, on one process."""

import importlib.util
import sys

import numpy as np
import pytest
from mover_cases import assert_derivative_is_transposed, bent_surface, channel
from sparse_cases import box_elements, definite_matrix, dense
from sparse_iterative_cases import stiffness

from bspline_mdao.base.sparse.blocks import BlockMatrix, BlockPattern
from bspline_mdao.base.sparse.distributed import DistributedPattern, FullRows
from bspline_mdao.errors import InputError, MovementError
from bspline_mdao.movers import LinearElasticity, PetscCholesky, PetscMultigrid

needs_petsc = pytest.mark.skipif(not importlib.util.find_spec("petsc4py"), reason="no petsc4py")
SHAPE = (5, 6, 7)
SOLVERS = (PetscCholesky(), PetscMultigrid())


@pytest.fixture(scope="module")
def matrix():
    return stiffness(SHAPE, seed=1)


def points_of(matrix):
    return np.random.default_rng(2).normal(size=(matrix.pattern.n, 3))


def factor_of(solver, matrix):
    return solver.analyze(matrix.pattern, points_of(matrix)).factorize(matrix)


def test_full_rows_hold_both_halves(matrix):
    full = FullRows.of(DistributedPattern.whole(matrix.pattern))
    n, found = matrix.pattern.n, np.zeros((matrix.pattern.n, 3, matrix.pattern.n, 3))
    for row in range(n):
        for entry in range(full.indptr[row], full.indptr[row + 1]):
            place = full.places[entry]
            found[row, :, full.columns[entry]] = matrix.data[place] if place >= 0 else matrix.data[-1 - place].T
        assert (np.diff(full.columns[full.indptr[row] : full.indptr[row + 1]]) > 0).all()
    np.testing.assert_allclose(found.reshape(3 * n, 3 * n), dense(matrix), rtol=0.0, atol=1e-12)


@needs_petsc
@pytest.mark.parametrize("n_sides", [None, 2])
def test_multigrid_solves(matrix, n_sides):
    right = np.random.default_rng(3).normal(size=(matrix.pattern.n, 3) + ((n_sides,) if n_sides else ()))
    solution = factor_of(PetscMultigrid(), matrix).solve(right)
    assert solution.residual <= 1e-12
    assert 0 < solution.iterations < 150
    error = dense(matrix) @ solution.x.reshape(3 * matrix.pattern.n, -1) - right.reshape(3 * matrix.pattern.n, -1)
    assert np.linalg.norm(error) < 3e-12 * np.linalg.norm(right)


@needs_petsc
@pytest.mark.parametrize("n_sides", [None, 2])
def test_mumps_solves(matrix, n_sides):
    right = np.random.default_rng(3).normal(size=(matrix.pattern.n, 3) + ((n_sides,) if n_sides else ()))
    factor = factor_of(PetscCholesky(), matrix)
    solution = factor.solve(right)
    error = dense(matrix) @ solution.x.reshape(3 * matrix.pattern.n, -1) - right.reshape(3 * matrix.pattern.n, -1)
    assert np.linalg.norm(error) < 1e-13 * np.linalg.norm(right)
    assert solution.residual < 1e-13
    assert factor.n_bytes > matrix.data.nbytes


@needs_petsc
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
def test_factor_of_another_matrix_preconditions(matrix, solver):
    other = BlockMatrix(matrix.pattern, 1.5 * matrix.data)
    factor, right = factor_of(solver, matrix), points_of(matrix)
    np.testing.assert_allclose(1.5 * factor.solve(right, other).x, factor.solve(right).x, rtol=1e-9)


@needs_petsc
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
def test_moves_are_those_by_cholesky(solver):
    mesh = channel()
    initial, surface = bent_surface(mesh, 0.05)
    expected = LinearElasticity(mesh, n_increments=2).move(initial, surface)
    movement = LinearElasticity(mesh, n_increments=2, solver=solver).move(initial, surface)
    np.testing.assert_allclose(movement.points, expected.points, rtol=0.0, atol=1e-11 * mesh.size)
    assert movement.report.increments[0].solve.solver == solver.name
    assert_derivative_is_transposed(movement)


@needs_petsc
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
@pytest.mark.parametrize("value", [-1.0, np.nan])
def test_what_is_not_positive_definite_is_named(solver, value):
    elements, points = box_elements((4, 5, 6))
    matrix = definite_matrix(BlockPattern.of_elements(elements, len(points)), np.random.default_rng(0))
    matrix.data[matrix.pattern.indptr[18] - 1, 1, 1] *= value
    with pytest.raises(MovementError, match="block row 18"):
        factor_of(solver, matrix)


@needs_petsc
def test_matrix_that_only_elimination_shows_not_to_be_definite_is_refused(matrix):
    bad = BlockMatrix(matrix.pattern, matrix.data.copy())
    bad.data[matrix.pattern.indptr[1] - 1] *= 1e-3
    with pytest.raises(MovementError, match="MUMPS: the matrix is not positive definite; look for"):
        factor_of(PetscCholesky(), bad)


@needs_petsc
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
def test_matrix_of_another_pattern_is_refused(matrix, solver):
    with pytest.raises(InputError, match="another pattern"):
        solver.analyze(stiffness((3, 3, 3), 0).pattern, None).factorize(matrix)


@needs_petsc
def test_options_of_the_user_come_first_and_nothing_stays_behind(matrix):
    from petsc4py import PETSc

    database = PETSc.Options("bspline_mdao_")
    database["pc_hypre_boomeramg_max_levels"] = 2
    try:
        poor = factor_of(PetscMultigrid(), matrix).solve(points_of(matrix))
        assert set(database.getAll()) == {"pc_hypre_boomeramg_max_levels"}
    finally:
        del database["pc_hypre_boomeramg_max_levels"]
    assert poor.iterations != factor_of(PetscMultigrid(), matrix).solve(points_of(matrix)).iterations


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
def test_without_petsc4py_one_line_says_what_to_install(matrix, monkeypatch, solver):
    monkeypatch.setitem(sys.modules, "petsc4py.PETSc", None)
    with pytest.raises(InputError, match=r'PETSc needs petsc4py: pip install "bspline_mdao\[mpi\]"'):
        solver.analyze(matrix.pattern, points_of(matrix))
