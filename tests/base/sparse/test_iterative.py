"""Incomplete factors and conjugate gradients."""

from dataclasses import replace

import numpy as np
import pytest
from sparse_iterative_cases import dense, stiffness

from bspline_mdao.base.sparse.blocks import BlockMatrix, BlockPattern, graph_of
from bspline_mdao.base.sparse.cholesky import Cholesky
from bspline_mdao.base.sparse.conjugate_gradient import ConjugateGradients, preconditioned_solve
from bspline_mdao.base.sparse.incomplete import fill_pattern, incomplete_factor, incomplete_pattern, narrow_order
from bspline_mdao.errors import MovementError

SHAPE = (4, 5, 6)
COMPLETE = 100
"""A level of fill that drops nothing."""


@pytest.fixture(scope="module")
def matrix():
    return stiffness(SHAPE, seed=1)


@pytest.fixture(scope="module")
def right(matrix):
    return np.random.default_rng(2).normal(size=(matrix.pattern.n, 3))


def factorize(settings, matrix):
    return settings.analyze(matrix.pattern, np.zeros((matrix.pattern.n, 3))).factorize(matrix)


def norm(x):
    return np.linalg.norm(x)


def levels_of_fill(matrix, order):
    """Levels of all blocks by the definition, with elimination in full."""
    n = matrix.pattern.n
    level = np.full((n, n), np.inf)
    rows = np.repeat(np.arange(n), np.diff(matrix.pattern.indptr))
    level[rows, matrix.pattern.indices] = level[matrix.pattern.indices, rows] = 0
    level = level[np.ix_(order, order)]
    for k in range(n):
        rest = slice(k + 1, n)
        level[rest, rest] = np.minimum(level[rest, rest], level[rest, k, None] + level[k, rest] + 1)
    return level


@pytest.mark.slow
@pytest.mark.parametrize("fill", [0, 1, 2, 3])
def test_pattern_holds_the_blocks_whose_level_of_fill_is_small_enough(matrix, fill):
    order = np.random.default_rng(3).permutation(matrix.pattern.n)
    starts, columns = fill_pattern(*graph_of(matrix.pattern), order, fill)
    expected = np.argwhere(np.tril(levels_of_fill(matrix, order) <= fill, -1))
    found = np.column_stack([np.repeat(np.arange(len(order)), np.diff(starts)), columns])
    np.testing.assert_array_equal(found, expected)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4, 5])
def test_factor_without_dropping_is_the_inverse(matrix, right, seed):
    order = np.random.default_rng(seed).permutation(matrix.pattern.n)
    factor = incomplete_factor(matrix, incomplete_pattern(graph_of(matrix.pattern), order, COMPLETE), 0.0, np.float64)
    assert factor.shift == 0.0
    assert norm(matrix.dot(factor.apply(right)) - right) < 1e-12 * norm(right)


def test_factor_agrees_with_the_matrix_on_its_pattern(matrix):
    graph = graph_of(matrix.pattern)
    pattern = incomplete_pattern(graph, narrow_order(graph), 1)
    factor = incomplete_factor(matrix, pattern, 0.0, np.float64)
    assert factor.shift == 0.0
    n, unknowns = matrix.pattern.n, (3 * pattern.order[:, None] + np.arange(3)).ravel()
    rows = np.repeat(np.arange(n), np.diff(pattern.starts))
    lower, diagonal, is_kept = np.zeros((n, 3, n, 3)), np.zeros((n, 3, n, 3)), np.eye(n, dtype=bool)
    lower[rows, :, pattern.columns] = factor.lower
    lower[range(n), :, range(n)] = np.eye(3)
    diagonal[range(n), :, range(n)] = np.linalg.inv(factor.inverse_diagonal)
    is_kept[rows, pattern.columns] = is_kept[pattern.columns, rows] = True
    lower, diagonal = lower.reshape(3 * n, -1), diagonal.reshape(3 * n, -1)
    rest = lower @ diagonal @ lower.T - dense(matrix)[np.ix_(unknowns, unknowns)]
    assert abs(rest[np.kron(is_kept, np.ones((3, 3), bool))]).max() < 1e-12 * abs(matrix.data).max()
    assert abs(rest).max() > 1e-6 * abs(matrix.data).max()


@pytest.mark.parametrize("single", [True, False])
def test_preconditioner_is_symmetric(matrix, right, single):
    factor = factorize(ConjugateGradients(single=single), matrix)
    other = np.random.default_rng(6).normal(size=right.shape)
    assert np.vdot(other, factor.apply(right)) == pytest.approx(np.vdot(right, factor.apply(other)), rel=1e-12)


@pytest.mark.parametrize("single", [True, False])
@pytest.mark.parametrize("tolerance", [1e-4, 1e-12])
def test_true_residual_is_reached_and_reported(matrix, right, single, tolerance):
    solution = factorize(ConjugateGradients(single=single, tolerance=tolerance), matrix).solve(right)
    assert solution.residual <= tolerance
    residual = norm(right - matrix.dot(solution.x)) / norm(right)
    assert solution.residual == pytest.approx(residual, rel=0.05)


def test_solution_is_that_of_a_direct_solver(matrix, right):
    x = factorize(ConjugateGradients(), matrix).solve(right).x
    np.testing.assert_allclose(x.ravel(), np.linalg.solve(dense(matrix), right.ravel()), rtol=0.0, atol=1e-9 * norm(x))


@pytest.mark.slow
def test_more_fill_takes_fewer_iterations():
    matrix = stiffness((9, 10, 11), seed=7)
    right = np.random.default_rng(8).normal(size=(matrix.pattern.n, 3))
    iterations = [factorize(ConjugateGradients(fill=p), matrix).solve(right).iterations for p in (0, 1, 2, COMPLETE)]
    assert sorted(set(iterations), reverse=True) == iterations


def test_several_right_hand_sides_are_solved_one_by_one(matrix, right):
    factor = factorize(ConjugateGradients(), matrix)
    sides = np.stack([right, 0.0 * right, right[::-1]], axis=2)
    solution = factor.solve(sides)
    assert solution.residual <= 1e-12
    for side in range(3):
        np.testing.assert_array_equal(solution.x[..., side], factor.solve(sides[..., side]).x)


def test_nothing_is_iterated_for_a_zero_right_hand_side(matrix, right):
    solution = factorize(ConjugateGradients(), matrix).solve(0.0 * right)
    assert solution.iterations == 0
    assert solution.residual == 0.0
    assert not solution.x.any()


def test_nothing_is_iterated_from_the_solution(matrix, right):
    factor = factorize(ConjugateGradients(), matrix)
    x = factor.solve(right).x
    again = preconditioned_solve(matrix, factor, right, start=x)
    assert again.iterations == 0
    np.testing.assert_array_equal(again.x, x)


@pytest.mark.parametrize("settings", [Cholesky(), Cholesky(single=True), ConjugateGradients()])
def test_factor_of_a_nearby_matrix_preconditions(matrix, right, settings):
    n = matrix.pattern.n
    scale = np.exp(0.02 * np.random.default_rng(9).normal(size=n))
    rows = np.repeat(np.arange(n), np.diff(matrix.pattern.indptr))
    nearby = replace(matrix, data=matrix.data * (scale[rows] * scale[matrix.pattern.indices])[:, None, None])
    solution = preconditioned_solve(nearby, factorize(settings, matrix), right)
    assert norm(right - nearby.dot(solution.x)) <= 1.1e-12 * norm(right)
    if isinstance(settings, Cholesky):
        assert 1 < solution.iterations < 20


def test_everything_is_the_same_to_the_last_bit_when_done_again(matrix, right):
    first, second = (factorize(ConjugateGradients(), matrix).solve(right) for _ in range(2))
    np.testing.assert_array_equal(first.x, second.x)
    assert first.iterations == second.iterations


def indefinite(matrix, factor):
    """The matrix with the diagonal block of its row 8 times ``factor``."""
    data = matrix.data.copy()
    data[matrix.pattern.indptr[8] - 1] *= factor
    return replace(matrix, data=data)


def test_larger_shifts_are_tried_where_a_pivot_is_not_positive(matrix):
    factor = factorize(ConjugateGradients(shift=1e-3), indefinite(matrix, 0.3)).preconditioner
    shifts = [shift for shift, _ in factor.breakdowns]
    assert shifts[0] == 1e-3
    assert factor.shift > shifts[-1]
    assert all(n_wrong > 0 for _, n_wrong in factor.breakdowns)


def test_matrix_that_no_shift_helps_is_an_error_that_names_the_row(matrix):
    with pytest.raises(MovementError, match=r"incomplete factor: .*not positive .* block row 8; .*direct solver"):
        factorize(ConjugateGradients(), indefinite(matrix, -1.0))


def test_indefinite_matrix_is_an_error_with_advice(matrix, right):
    factor = factorize(ConjugateGradients(), matrix)
    with pytest.raises(MovementError, match=r"the matrix is not positive definite .*direct solver"):
        factor.solve(right, indefinite(matrix, -1.0))


def test_right_hand_side_that_is_not_finite_is_an_error(matrix, right):
    factor = factorize(ConjugateGradients(), matrix)
    with pytest.raises(MovementError, match="not finite"):
        factor.solve(np.where(np.arange(3) == 1, np.nan, right))


def test_iterations_without_end_are_an_error_with_advice(matrix, right):
    factor = factorize(ConjugateGradients(max_iterations=3), matrix)
    with pytest.raises(MovementError, match=r"after 3 iterations; allow more, .*higher fill"):
        factor.solve(right)


def rounding(matrix, x):
    """Residual that the rounding of a solution leaves."""
    return np.finfo(float).eps * norm(BlockMatrix(matrix.pattern, np.abs(matrix.data)).dot(np.abs(x)))


def test_tolerance_below_rounding_ends_at_what_rounding_leaves(matrix, right):
    solution = factorize(ConjugateGradients(tolerance=1e-20), matrix).solve(right)
    assert solution.residual <= rounding(matrix, solution.x) / norm(right) < 1e-14


@pytest.mark.parametrize("hold", [1e-4, 1e-7])
def test_random_right_hand_sides_of_a_soft_matrix_are_solved_at_the_defaults_as_well_as_by_a_direct_solver(hold):
    matrix, random = stiffness((6, 4, 5), seed=3, hold=hold), np.random.default_rng(7)
    factor, direct = factorize(ConjugateGradients(), matrix), factorize(Cholesky(), matrix)
    for _ in range(3):
        right = random.standard_normal((matrix.pattern.n, 3))
        solution, exact = factor.solve(right), direct.solve(right)
        assert 1e-12 < solution.residual <= 4.0 * rounding(matrix, solution.x) / norm(right)
        assert solution.residual <= 10.0 * exact.residual
        assert solution.residual == pytest.approx(norm(right - matrix.dot(solution.x)) / norm(right), rel=0.3)


class Coarse(BlockMatrix):
    """A matrix whose products are rounded to single precision."""

    def dot(self, x):
        return super().dot(x).astype(np.float32).astype(float)


def test_residual_that_stays_above_rounding_is_an_error_that_says_by_how_much(matrix, right):
    factor = factorize(ConjugateGradients(), matrix)
    message = r"stays at \d\.\de-0[78], \de\+0[45] times the tolerance, .* rounding leaves \d\.\de-1[456]; .*direct"
    with pytest.raises(MovementError, match=message):
        factor.solve(right, Coarse(matrix.pattern, matrix.data))


def test_points_without_neighbours_are_solved():
    pattern = BlockPattern(np.arange(4), np.arange(3, dtype=np.int32))
    matrix = BlockMatrix(pattern, np.eye(3) * np.array([1.0, 4.0, 9.0])[:, None, None])
    right = np.arange(9.0).reshape(3, 3)
    np.testing.assert_allclose(factorize(ConjugateGradients(), matrix).solve(right).x, right / [[1.0], [4.0], [9.0]])
