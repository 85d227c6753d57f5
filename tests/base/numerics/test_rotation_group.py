"""Rotations as vectors: exact for all angles, and continued along a surface."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bspline_mdao.base.numerics.rotation_group import (
    turns,
    turns_jvp,
    turns_vjp,
    unwrapped,
    vectors_jvp,
    vectors_vjp,
)
from bspline_mdao.testing import central_difference


def vectors(seed=0, n=60):
    """Random vectors of lengths from 1e-9 to nearly a full turn, with both sides of where series begin."""
    random = np.random.default_rng(seed)
    w = random.normal(size=(n, 3))
    lengths = np.concatenate([np.geomspace(1e-9, 0.49, n // 2), np.linspace(0.51, 6.0, n - n // 2)])
    return w / np.linalg.norm(w, axis=1)[:, None] * lengths[:, None]


def rotations(w):
    return np.eye(3) + turns(w)


def chain(n):
    """First neighbours and neighbours of points in a row."""
    sides = np.array([(i, j) for i in range(n) for j in (i - 1, i + 1) if 0 <= j < n])
    return np.searchsorted(sides[:, 0], np.arange(n + 1)), sides[:, 1].astype(np.int32)


def test_turns_are_rotations_less_the_identity_without_cancellation():
    w = vectors()
    np.testing.assert_allclose(rotations(w), Rotation.from_rotvec(w).as_matrix(), atol=1e-15)
    tiny = 1e-30 * w
    np.testing.assert_allclose(turns(tiny)[:, 2, 1], tiny[:, 0], rtol=1e-15)


def test_derivatives_of_turns_are_exact_and_transposed():
    w, random = vectors(), np.random.default_rng(1)
    dw, bar = random.normal(size=w.shape), random.normal(size=(len(w), 3, 3))
    change = turns_jvp(w, dw)
    difference = central_difference(lambda t: turns(w + t * dw), 1e-3, levels=2)
    np.testing.assert_allclose(difference, change, atol=1e-10)
    assert abs((bar * change).sum() - (turns_vjp(w, bar) * dw).sum()) < 1e-13 * np.linalg.norm(bar)


def test_derivatives_of_vectors_invert_those_of_turns_whatever_the_whole_turns():
    w, random = vectors(), np.random.default_rng(2)
    dw, bar = random.normal(size=w.shape), random.normal(size=w.shape)
    d_matrices = turns_jvp(w, dw)
    np.testing.assert_allclose(vectors_jvp(w, rotations(w), d_matrices), dw, atol=1e-13)
    back = vectors_vjp(w, rotations(w), bar)
    assert abs((bar * dw).sum() - (back * d_matrices).sum()) < 1e-12 * np.linalg.norm(bar)


@pytest.mark.parametrize("largest", [0.3, 3.1, 6.1])
def test_vectors_are_continued_along_a_line_as_far_as_they_turn(largest):
    axis = np.array([2.0, -1.0, 2.0]) / 3.0 + 0.05 * np.random.default_rng(3).normal(size=(40, 3))
    w = np.linspace(0.0, largest, 40)[:, None] * axis / np.linalg.norm(axis, axis=1)[:, None]
    np.testing.assert_allclose(unwrapped(rotations(w), *chain(40)), w, atol=1e-12)


def test_half_a_turn_has_one_sense_for_all_that_is_joined():
    w = np.full((20, 1), np.pi) * np.array([[0.6, 0.0, 0.8]])
    noise = 1e-15 * np.random.default_rng(5).normal(size=(20, 3, 3))
    found = unwrapped(rotations(w) + noise, *chain(20))
    assert np.ptp(found, axis=0).max() < 1e-13
    np.testing.assert_allclose(np.abs(found[0]), np.abs(w[0]), atol=1e-13)


def test_what_is_at_rest_does_not_turn():
    noise = 1e-16 * np.random.default_rng(6).normal(size=(5, 3, 3))
    np.testing.assert_array_equal(unwrapped(np.eye(3) + noise, *chain(5)), np.zeros((5, 3)))
