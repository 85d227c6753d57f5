"""What factors of scalars are to do: pieces that do not meet, digits that are measured, copies, and errors."""

import copy
import pickle

import numpy as np
import pytest
from scipy.sparse import block_diag, csc_array, diags_array

from bspline_mdao.base.sparse.scalar import ScalarCholesky
from bspline_mdao.errors import MovementError


def line(n, weight=1.0):
    """Springs along a line of points, the first of which is held."""
    main = np.full(n, 2.0 * weight)
    main[-1] = weight
    return diags_array([main, np.full(n - 1, -weight), np.full(n - 1, -weight)], offsets=[0, 1, -1])


def pieces():
    """Two equal pieces, a longer one, and one of the same pattern with other numbers, their rows mixed."""
    matrix = block_diag([line(7), line(9, 3.0), line(7), line(7, 2.0)]).tocsc()
    order = np.argsort([*range(7), *range(9), *range(7), *range(7)], kind="stable")
    return csc_array(matrix[:, order][order])


def test_pieces_that_do_not_meet_are_solved_apart_and_equal_ones_share_a_factor():
    matrix = pieces()
    factor, right = ScalarCholesky().factorize(matrix), np.random.default_rng(1).standard_normal(30)
    solution = factor.solve(right)
    np.testing.assert_allclose(solution.x, np.linalg.solve(matrix.toarray(), right), rtol=1e-12)
    assert solution.residual < 1e-13
    assert sorted(rows.shape for rows, _ in factor._pieces) == [(7, 1), (7, 2), (9, 1)]


@pytest.mark.parametrize("soft", [1e-2, 1e-5, 1e-8])
def test_cancellation_says_how_many_digits_a_solution_loses(soft):
    held = line(40).tolil()
    held[0, 0] = 1.0 + soft  # all else is held by a soft spring
    factor = ScalarCholesky().factorize(csc_array(held))
    assert 0.01 < factor.cancellation * soft < 100.0
    assert ScalarCholesky().factorize(csc_array(line(40))).cancellation < 1e4


def test_copies_of_a_factor_give_equal_bits():
    matrix = pieces()
    factor, right = ScalarCholesky().factorize(matrix), np.random.default_rng(2).standard_normal(30)
    expected = factor.solve(right).x
    for copied in (pickle.loads(pickle.dumps(factor)), copy.deepcopy(factor)):
        np.testing.assert_array_equal(copied.solve(right).x, expected)


def test_a_singular_matrix_and_numbers_that_are_none_are_refused():
    loose = line(6).tolil()
    loose[0, 0] = 1.0
    with pytest.raises(MovementError, match="a point that nothing holds"):
        ScalarCholesky().factorize(csc_array(loose))
    wrong = pieces()
    wrong.data[3] = np.nan
    with pytest.raises(MovementError, match="not finite"):
        ScalarCholesky().factorize(wrong)


def test_a_matrix_without_rows_has_solutions_without_rows():
    factor = ScalarCholesky().factorize(csc_array((0, 0)))
    assert factor.cancellation == 0.0
    assert factor.solve(np.empty(0)).x.shape == (0,)
    assert factor.solve(np.empty((0, 4))).x.shape == (0, 4)
