"""The direct solver, in double and in single precision."""

import copy
import pickle
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
from sparse_cases import box_elements, definite_matrix, dense, random_pattern

from bspline_mdao.base.numerics.threads import Crew
from bspline_mdao.base.sparse import cholesky
from bspline_mdao.base.sparse.blocks import BlockMatrix, BlockPattern
from bspline_mdao.base.sparse.cholesky import Cholesky
from bspline_mdao.errors import InputError, MovementError

SOLVERS = [Cholesky(), Cholesky(single=True)]


def box_matrix(shape=(9, 8, 7), seed=0):
    rng = np.random.default_rng(seed)
    elements, points = box_elements(shape)
    return definite_matrix(BlockPattern.of_elements(elements, len(points)), rng), points


def dense_front(n=500):
    """Matrix in which all points are coupled, so that it has one front, its points, and the same as a dense array."""
    rng = np.random.default_rng(n)
    pattern = random_pattern(n, 1.0, rng)
    matrix = definite_matrix(pattern, rng)
    return matrix, rng.random((n, 3)), dense(matrix)


def factor_of(matrix, points, solver=None):
    return (solver or Cholesky()).analyze(matrix.pattern, points).factorize(matrix)


@pytest.mark.slow
@pytest.mark.parametrize("single", [False, True])
def test_cancellation_is_what_elimination_leaves_of_the_diagonal_whatever_the_scale(single):
    matrix, points = box_matrix((4, 3, 3))
    stretch = 10.0 ** np.random.default_rng(5).uniform(-6.0, 6.0, points.shape)
    pattern, scaled = matrix.pattern, matrix.data.copy()
    rows = np.repeat(np.arange(pattern.n), np.diff(pattern.indptr))
    scaled *= stretch[rows][:, :, None] * stretch[pattern.indices][:, None, :]
    factor = factor_of(BlockMatrix(pattern, scaled), points, Cholesky(single=single))
    order = (3 * factor.analysis.supernodes.order[:, None] + np.arange(3)).ravel()
    full = dense(matrix)[np.ix_(order, order)]
    expected = np.max(np.diag(full) / np.diag(np.linalg.cholesky(full)) ** 2)
    assert factor.cancellation == pytest.approx(expected, rel=1e-4 if single else 1e-10)
    assert expected > 1.02


@pytest.mark.slow
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
def test_solution_is_that_of_scipy(solver):
    matrix, points = box_matrix()
    right = np.random.default_rng(1).standard_normal(points.shape)
    solution = factor_of(matrix, points, solver).solve(right)
    expected = scipy.sparse.linalg.spsolve(scipy.sparse.csc_array(dense(matrix)), right.ravel())
    np.testing.assert_allclose(solution.x.ravel(), expected, rtol=1e-10, atol=1e-12 * np.abs(expected).max())
    own_residual = np.linalg.norm(matrix.dot(solution.x) - right) / np.linalg.norm(right)
    assert max(solution.residual, own_residual) < (1e-13 if solver == Cholesky() else 1e-12)
    assert solution.seconds > 0


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
def test_several_right_hand_sides_are_solved_at_once(solver):
    matrix, points = box_matrix((4, 5, 6))
    factor = factor_of(matrix, points, solver)
    right = np.random.default_rng(2).standard_normal((*points.shape, 4))
    together = factor.solve(right)
    assert together.x.shape == right.shape
    for side in range(4):
        np.testing.assert_allclose(together.x[..., side], factor.solve(right[..., side]).x, rtol=1e-9, atol=1e-13)


@pytest.mark.parametrize(("n", "density"), [(0, 0.0), (1, 0.0), (2, 1.0), (7, 0.0), (150, 0.01), (120, 1.0)])
def test_small_disconnected_and_dense_graphs_are_solved(n, density):
    rng = np.random.default_rng(n)
    matrix = definite_matrix(random_pattern(n, density, rng), rng)
    x = rng.standard_normal((n, 3))
    solution = factor_of(matrix, rng.random((n, 3))).solve(matrix.dot(x))
    np.testing.assert_allclose(solution.x, x, rtol=1e-10, atol=1e-12)


def test_numbering_of_the_points_does_not_matter():
    rng = np.random.default_rng(3)
    elements, points = box_elements((7, 6, 5))
    n, stiffness = len(points), rng.random(len(elements)) + 0.1
    new = rng.permutation(n)
    solutions = []
    for number in (np.arange(n), new):
        pattern = BlockPattern.of_elements(number[elements], n)
        rows = np.repeat(np.arange(n), np.diff(pattern.indptr))
        full = np.zeros((n, n))
        for weight, ids in zip(stiffness, number[elements]):
            full[np.ix_(ids, ids)] += weight * (8 * np.eye(8) - 1)
        scalar = full[rows, pattern.indices] + 0.1 * (rows == pattern.indices)
        matrix = BlockMatrix(pattern, scalar[:, None, None] * np.eye(3))
        right = np.empty((n, 3))
        right[number] = points
        solutions.append(factor_of(matrix, right).solve(right).x[number])
    np.testing.assert_allclose(solutions[0], solutions[1], rtol=1e-11)


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: solver.name)
def test_matrix_that_is_not_positive_definite_is_named_and_the_analysis_goes_on(solver):
    matrix, points = box_matrix((4, 5, 6))
    bad = BlockMatrix(matrix.pattern, matrix.data.copy())
    bad.data[matrix.pattern.indptr[18] - 1, 1, 1] *= -1
    analysis = solver.analyze(matrix.pattern, points)
    with pytest.raises(MovementError, match="block row 18"):
        analysis.factorize(bad)
    assert analysis.factorize(matrix).solve(points).residual < 1e-12


def test_matrix_that_is_not_finite_is_refused():
    matrix, points = box_matrix((4, 5, 6))
    matrix.data[40] = np.nan
    with pytest.raises(MovementError, match="not finite"):
        factor_of(matrix, points)


@pytest.mark.slow
@pytest.mark.parametrize("n_threads", [1, 2, 3])
def test_factor_has_the_same_bits_for_any_number_of_threads(n_threads):
    matrix, points = box_matrix((17, 16, 15))
    expected = factor_of(matrix, points, Cholesky(n_threads=1))
    for _ in range(2):
        factor = factor_of(matrix, points, Cholesky(n_threads=n_threads))
        assert np.array_equal(factor.apply(points), expected.apply(points))
    single = factor_of(matrix, points, Cholesky(single=True, n_threads=n_threads))
    assert np.array_equal(
        single.apply(points), factor_of(matrix, points, Cholesky(single=True, n_threads=1)).apply(points)
    )


@pytest.mark.slow
def test_bad_pivot_is_found_with_threads():
    matrix, points = box_matrix((17, 16, 15))
    matrix.data[matrix.pattern.indptr[1:] - 1] *= np.where(np.arange(matrix.pattern.n) == 2000, -1, 1)[:, None, None]
    with pytest.raises(MovementError, match="block row"):
        factor_of(matrix, points, Cholesky(n_threads=2))


def test_single_precision_takes_half_the_memory_and_any_scale():
    matrix, points = box_matrix((6, 5, 4))
    scaled = BlockMatrix(matrix.pattern, matrix.data * 1e150)
    double, single = (factor_of(scaled, points, Cholesky(single=single)) for single in (False, True))
    assert 2 * single.n_bytes == double.n_bytes
    np.testing.assert_allclose(single.apply(points), double.apply(points), rtol=1e-4, atol=1e-4 * 1e-150)


@pytest.mark.slow
@pytest.mark.parametrize("single", [False, True])
def test_memory_of_a_factorisation_is_known_before_it_is_made(single):
    matrix, points = box_matrix((17, 16, 15))
    Cholesky(single=single, n_threads=1).analyze(matrix.pattern, points).factorize(matrix)  # compiled before it counts
    analysis = Cholesky(single=single, n_threads=1).analyze(matrix.pattern, points)
    tracemalloc.start()
    factor = analysis.factorize(matrix)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert analysis.factor_bytes == factor.n_bytes > 1e6
    assert 0 <= peak - analysis.factor_bytes - analysis.work_bytes < 4 * matrix.data.nbytes


@pytest.mark.slow
def test_factor_that_is_gone_leaves_its_memory_to_the_next():
    matrix, points = box_matrix((17, 16, 15))
    analysis = Cholesky(n_threads=1).analyze(matrix.pattern, points)
    analysis.factorize(matrix)  # what served the first does not wait, see the next test
    for _ in range(2):
        tracemalloc.start()
        factor = analysis.factorize(matrix)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        del factor
    assert peak < 0.05 * analysis.factor_bytes


@pytest.mark.slow
def test_work_on_an_only_factor_leaves_no_memory_behind():
    matrix, points = box_matrix((17, 16, 15))
    analysis = Cholesky(n_threads=1).analyze(matrix.pattern, points)
    tracemalloc.start()
    factor = analysis.factorize(matrix)
    left, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak > factor.n_bytes + 0.9 * analysis.work_bytes
    assert left < 1.01 * factor.n_bytes


def test_factor_that_is_kept_is_not_written_over():
    matrix, points = box_matrix((9, 8, 7))
    other = BlockMatrix(matrix.pattern, 2.0 * matrix.data)
    analysis = Cholesky().analyze(matrix.pattern, points)
    first = analysis.factorize(matrix)
    solution, piece = first.apply(points), first.panels[10:500]
    expected = piece.copy()
    second = analysis.factorize(other)
    assert np.array_equal(first.apply(points), solution)
    del first, second
    third = analysis.factorize(other)
    np.testing.assert_allclose(third.apply(points), 0.5 * solution, rtol=1e-12)
    assert np.array_equal(piece, expected)


def test_copies_of_a_factor_solve_and_carry_no_idle_memory():
    matrix, points = box_matrix((9, 8, 7))
    analysis = Cholesky().analyze(matrix.pattern, points)
    size = len(pickle.dumps(analysis))
    factor = analysis.factorize(matrix)
    for copied in (pickle.loads(pickle.dumps(factor)), copy.deepcopy(factor)):
        assert np.array_equal(copied.apply(points), factor.apply(points))
        assert np.array_equal(copied.analysis.factorize(copied.matrix).apply(points), factor.apply(points))
    del factor
    assert len(pickle.dumps(analysis)) == size


@pytest.mark.parametrize(("single", "tolerance"), [(False, 1e-13), (True, 1e-4)])
def test_front_that_threads_share_is_factored_as_by_lapack(single, tolerance):
    matrix, points, dense_matrix = dense_front()
    factor = factor_of(matrix, points, Cholesky(single=single, n_threads=3))
    expected = scipy.linalg.cho_solve(scipy.linalg.cho_factor(dense_matrix), points.ravel())
    np.testing.assert_allclose(factor.apply(points).ravel(), expected, rtol=0, atol=tolerance * abs(expected).max())


def test_no_thread_has_a_large_front_to_itself(monkeypatch):
    n_tasks = []

    class CountingCrew(Crew):
        def run(self, task, n):
            n_tasks.append(n)
            super().run(task, n)

    monkeypatch.setattr(cholesky, "Crew", CountingCrew)
    matrix, points, _ = dense_front()
    factor_of(matrix, points, Cholesky(n_threads=2))
    assert sum(n_tasks) > 3 * sum(n > 0 for n in n_tasks)


@pytest.mark.parametrize("row", [0, 250, 499])
@pytest.mark.parametrize("value", [-1.0, np.nan])
def test_bad_pivot_of_a_front_that_threads_share_is_found(row, value):
    matrix, points, _ = dense_front()
    analysis = Cholesky(n_threads=2).analyze(matrix.pattern, points)
    first_row = analysis.supernodes.order[row]
    matrix.data[matrix.pattern.indptr[first_row + 1] - 1] *= value
    with pytest.raises(MovementError, match=f"block row {first_row + 1};"):
        analysis.factorize(matrix)


def test_factor_of_an_earlier_matrix_solves_a_changed_one():
    matrix, points = box_matrix()
    changed = BlockMatrix(matrix.pattern, matrix.data.copy())
    changed.data[matrix.pattern.indptr[1:] - 1] *= 1.3
    solution = factor_of(matrix, points).solve(points, changed)
    assert solution.iterations > 1
    assert np.linalg.norm(changed.dot(solution.x) - points) < 1e-11 * np.linalg.norm(points)


def test_zero_right_hand_side_and_none_are_answered():
    matrix, points = box_matrix((4, 5, 6))
    factor = factor_of(matrix, points)
    zero = factor.solve(np.zeros_like(points))
    assert zero.residual == 0
    assert not zero.x.any()
    assert factor.solve(np.zeros((*points.shape, 0))).x.shape == (*points.shape, 0)


def test_unusable_input_is_refused():
    matrix, points = box_matrix((4, 5, 6))
    factor = factor_of(matrix, points)
    with pytest.raises(InputError, match=r"shape \(120, 3\)"):
        factor.solve(points[:-1])
    other = box_matrix((4, 5, 6))[0]
    with pytest.raises(InputError, match="another pattern"):
        factor.analysis.factorize(other)


def test_solver_has_a_name_for_reports():
    assert Cholesky().name == "Cholesky"
    assert replace(Cholesky(), single=True).name == "Cholesky, single precision"
