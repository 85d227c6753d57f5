"""Tasks in step: one pass over a factor for all that ask for it, and none hears of the others."""

import numpy as np
import pytest
from scipy.sparse import csc_array, diags_array

from bspline_mdao.base.sparse.blocks import LinearSolution
from bspline_mdao.base.sparse.scalar import ScalarCholesky
from bspline_mdao.base.sparse.solved_together import solved, solved_together
from bspline_mdao.errors import MovementError


class Diagonal:
    """A factor that counts its passes, and gives up with negative numbers."""

    def __init__(self, diagonal):
        self.diagonal, self.passes = diagonal, []

    def solve(self, right):
        self.passes.append(right.shape)
        if (right < 0.0).any():
            raise MovementError("the matrix is not definite")
        return LinearSolution((right.T / self.diagonal).T, 0, 0.0, 0.0)


def powers(factor, right, n):
    """The matrix's inverse, n times."""
    for _ in range(n):
        right = (yield factor, right).x
    return right


def test_tasks_of_any_length_go_in_step_with_one_pass_for_each_factor():
    first, second = Diagonal(np.array([2.0, 4.0])), Diagonal(np.array([5.0, 8.0]))
    lengths, right = (0, 3, 1, 2), np.array([40.0, 64.0])
    tasks = [powers(first, right + n, n) for n in lengths] + [powers(second, right, 2)]
    *found, last = solved_together(tasks)
    for n, x in zip(lengths, found, strict=True):
        np.testing.assert_array_equal(x, (right + n) / first.diagonal**n)
    np.testing.assert_array_equal(last, right / second.diagonal**2)
    np.testing.assert_array_equal(solved(powers(Diagonal(second.diagonal), right, 2)), last)
    assert first.passes == [(2, 3), (2, 2), (2,)]
    assert second.passes == [(2,), (2,)]


def test_a_factor_that_gives_up_with_one_of_them_fails_that_one_alone():
    factor = Diagonal(np.array([2.0, 4.0]))

    def guarded():
        try:
            return (yield factor, np.array([1.0, -1.0])).x
        except MovementError as error:
            raise MovementError(f"increment 1 of 2: {error}") from error

    first, second = solved_together([powers(factor, np.ones(2), 2), guarded()])
    np.testing.assert_array_equal(first, [0.25, 0.0625])
    assert str(second) == "increment 1 of 2: the matrix is not definite"
    with pytest.raises(MovementError, match="increment 1 of 2"):
        solved(guarded())


def test_scalars_are_solved_for_several_sides_at_once():
    random = np.random.default_rng(0)
    matrix = csc_array(diags_array([np.arange(3.0, 9.0), -np.ones(5), -np.ones(5)], offsets=[0, 1, -1]))
    factor, sides = ScalarCholesky().factorize(matrix), random.normal(size=(4, 6))
    for side, x in zip(sides, solved_together([powers(factor, side, 1) for side in sides]), strict=True):
        np.testing.assert_allclose(x, np.linalg.solve(matrix.toarray(), side), rtol=1e-13)
