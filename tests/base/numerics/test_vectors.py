"""Vectors as tuples in kernels and as rows of arrays, and planes."""

import numpy as np

from bspline_mdao.base.numerics import vectors


def test_tuples_in_kernels_are_the_vectors_of_numpy():
    u, v, w = np.random.default_rng(0).standard_normal((3, 3))
    a, b, c = tuple(u), tuple(v), tuple(w)
    np.testing.assert_allclose(vectors.cross(a, b), np.cross(u, v), rtol=1e-14)
    np.testing.assert_allclose(vectors.dot(a, b), u @ v, rtol=1e-14)
    np.testing.assert_allclose(vectors.triple(a, b, c), np.linalg.det([u, v, w]), rtol=1e-13)
    np.testing.assert_allclose(vectors.add(vectors.less(a, b), vectors.scaled(2.0, c)), u - v + 2.0 * w, rtol=1e-14)
    points = np.zeros((2, 3))
    vectors.add_to(points, 1, a)
    np.testing.assert_array_equal(vectors.row(points, 1), u)


def test_rows_of_arrays_are_vectors_real_or_complex():
    rng = np.random.default_rng(1)
    u, v = rng.standard_normal((2, 5, 2)) + 1e-3j * rng.standard_normal((2, 5, 2))
    np.testing.assert_allclose(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], vectors.cross_2d(u, v), rtol=1e-13)
    np.testing.assert_allclose(vectors.lengths(u) ** 2, vectors.dots(u, u), rtol=1e-13)
    assert (vectors.cross_2d(np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])) == 1.0).all()


def test_vectors_that_are_too_short_become_the_other_one():
    units = vectors.unit_vectors(np.array([[3.0, 4.0, 0.0], [0.0, 1e-12, 0.0]]), np.array([0.0, 0.0, 1.0]), 1e-9)
    np.testing.assert_array_equal(units, [[0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])


def test_the_nearest_plane_of_points_of_a_plane_goes_through_them():
    rng = np.random.default_rng(2)
    tilted = rng.standard_normal((20, 2)) @ rng.standard_normal((2, 3)) + [1.0, 2.0, 3.0]
    normal, distances, near = vectors.nearest_plane(tilted)
    assert abs(np.linalg.norm(normal) - 1.0) < 1e-14
    assert distances.max() < 1e-14 < near
    assert vectors.nearest_plane(tilted * [1.0, 0.0, 1.0])[0].tolist() == [0.0, 1.0, 0.0]
    assert not vectors.is_line(tilted)
    assert vectors.is_line(np.outer(rng.random(5), [1.0, 2.0, 3.0]))
