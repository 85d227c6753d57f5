"""Block matrices: storage, product, assembly from elements."""

import numpy as np
import pytest
from sparse_cases import box_elements, definite_matrix, dense, random_pattern

from bspline_mdao.base.sparse.blocks import BlockMatrix, BlockPattern, slots
from bspline_mdao.errors import InputError


def assembled(element_points, element_matrices, n):
    """Matrix put together as the documentation of `slots` says."""
    pattern = BlockPattern.of_elements(element_points, n)
    places, data = slots(pattern, element_points), np.zeros((pattern.n_blocks, 3, 3))
    m = element_points.shape[1]
    for points, blocks, row in zip(element_points, element_matrices, places):
        for a in range(m):
            for b in range(a + 1):
                place = row[a * (a + 1) // 2 + b]
                if place >= 0 and (a == b or points[a] >= points[b]):
                    data[place] += blocks[a, :, b]
                if place >= 0 and a != b and points[a] <= points[b]:
                    data[place] += blocks[a, :, b].T
    return BlockMatrix(pattern, data)


def dense_sum(element_points, element_matrices, n):
    """Sum of element matrices in a dense matrix."""
    full = np.zeros((n + 1, 3, n + 1, 3))
    for points, blocks in zip(element_points, element_matrices):
        for a, p in enumerate(points):
            for b, q in enumerate(points):
                full[p, :, q, :] += blocks[a, :, b]
    return full[:n, :, :n, :].reshape(3 * n, 3 * n)


def symmetric_blocks(n_elements, m, rng):
    matrices = rng.standard_normal((n_elements, 3 * m, 3 * m))
    return (matrices + matrices.transpose(0, 2, 1)).reshape(n_elements, m, 3, m, 3)


def test_product_agrees_with_the_scalar_matrix():
    rng = np.random.default_rng(1)
    matrix = definite_matrix(random_pattern(37, 0.2, rng), rng)
    x = rng.standard_normal((37, 3))
    np.testing.assert_allclose(matrix.dot(x).ravel(), dense(matrix) @ x.ravel(), rtol=1e-13, atol=1e-12)


def test_assembly_is_right_with_shuffled_held_and_repeated_points():
    rng = np.random.default_rng(2)
    elements, points = box_elements((4, 5, 6))
    n = 60
    numbers = np.full(len(points), -1, np.int32)
    numbers[rng.permutation(len(points))[:n]] = rng.permutation(n)
    elements = numbers[elements]
    elements[3, [1, 5]] = elements[3, [0, 4]]  # two collapsed edges
    elements[7, :4] = elements[7, 0]  # a collapsed face
    matrices = symmetric_blocks(len(elements), 8, rng)
    matrix = assembled(elements, matrices, n)
    np.testing.assert_allclose(dense(matrix), dense_sum(elements, matrices, n), atol=1e-12)


def test_pattern_holds_each_pair_once_and_points_without_element():
    pattern = BlockPattern.of_elements(np.array([[2, 0, 2, -1], [0, 2, 3, 3]], np.int32), 5)
    assert pattern.indptr.tolist() == [0, 1, 2, 4, 7, 8]
    assert pattern.indices.tolist() == [0, 1, 0, 2, 0, 2, 3, 4]


def test_scalar_columns_have_ascending_rows():
    rng = np.random.default_rng(3)
    lower = definite_matrix(random_pattern(20, 0.3, rng), rng).to_scipy()
    assert lower.has_canonical_format
    assert (lower.indices[lower.indptr[:-1]] == np.arange(60)).all()


def test_unusable_input_is_refused():
    with pytest.raises(InputError, match="row 2 lacks its diagonal"):
        BlockPattern(np.array([0, 1, 2]), np.array([0, 0], np.int32))
    pattern = BlockPattern(np.array([0, 1]), np.array([0], np.int32))
    with pytest.raises(InputError, match=r"give shape \(1, 3, 3\)"):
        BlockMatrix(pattern, np.ones((2, 3, 3)))
    with pytest.raises(InputError, match=r"give shape \(1, 3\)"):
        BlockMatrix(pattern, np.ones((1, 3, 3))).dot(np.ones(3))
