"""Rotations that lay points onto others are found, whether it is known which onto which or not."""

import numpy as np
import pytest

from bspline_mdao.grids.topology.periodic_pair import Motion
from bspline_mdao.grids.topology.rotation_fit import fit_rotation, fit_turn, rotation_between


def motion_by(angle: float) -> Motion:
    """A rotation about an oblique axis that does not go through the origin."""
    axis = np.array([0.3, -0.5, 0.9]) / np.linalg.norm([0.3, -0.5, 0.9])
    motion = Motion.about(axis, angle, np.cross(axis, [1.0, 2.0, -0.5]), 1e-12)
    assert motion is not None
    return motion


@pytest.mark.parametrize("angle", [0.04, -0.7, 2.4, np.pi, -3.1412])
def test_the_rotation_of_points_that_are_known_is_found_up_to_half_a_turn_both_ways(angle):
    points, motion = np.random.default_rng(0).normal(size=(17, 3)), motion_by(angle)
    found = fit_rotation(points, motion.move(points), 5.0)
    np.testing.assert_allclose(found.move(points), motion.move(points), atol=1e-12)
    assert abs(found.angle) == pytest.approx(abs(angle), abs=1e-12)


def test_screws_and_shifts_are_no_rotations():
    points, motion = np.random.default_rng(1).normal(size=(9, 3)), motion_by(0.5)
    assert fit_rotation(points, points + [0.1, 0.2, 0.3], 5.0) is None
    assert fit_rotation(points, motion.move(points) + 0.1 * np.array(motion.axis), 5.0) is None


@pytest.mark.parametrize("angle", [0.2, -2.0])
def test_sides_are_laid_onto_each_other_whatever_the_order_of_their_nodes(angle):
    rng, motion = np.random.default_rng(2), motion_by(angle)
    nodes, inwards, order = rng.normal(size=(40, 3)), rng.normal(size=(40, 3)), rng.permutation(40)
    found, met = rotation_between(nodes, motion.move(nodes)[order], inwards, -motion.turn(inwards)[order], 5.0)
    np.testing.assert_allclose(found.move(nodes), motion.move(nodes), atol=1e-12)
    assert np.array_equal(order[met], np.arange(40))
    assert rotation_between(nodes, motion.move(nodes)[order], inwards, motion.turn(inwards)[order], 5.0) is None
    nodes[3] += 0.1
    assert rotation_between(nodes, motion.move(nodes - [0.1, 0.0, 0.0])[order], inwards, inwards, 5.0) is None


def test_of_the_rotations_of_a_regular_side_the_least_is_taken():
    x, r = np.meshgrid(np.linspace(-1.0, 1.0, 5), np.linspace(1.0, 3.0, 4))
    nodes = np.column_stack([x.ravel(), r.ravel(), np.zeros(x.size)])  # half a turn about its own normal as well
    motion = Motion((1.0, 0.0, 0.0), 0.3)
    inwards = np.tile([0.0, 0.0, 1.0], (x.size, 1))
    found, met = rotation_between(nodes, motion.move(nodes), inwards, -motion.turn(inwards), 3.0)
    assert found.axis == (1.0, 0.0, 0.0)
    assert found.angle == pytest.approx(0.3, abs=1e-12)
    assert np.array_equal(met, np.arange(len(nodes)))


def test_a_part_of_a_full_turn_is_one_to_the_last_digit_and_other_angles_stay():
    points, axis = np.random.default_rng(3).normal(size=(30, 3)), np.array([0.0, 0.0, 1.0])
    for angle, expected in ((2.0 * np.pi / 38 + 1e-7, 2.0 * np.pi / 38), (-0.4, -0.4), (2.0, 2.0)):
        motion = Motion((0.0, 0.0, 1.0), angle, (0.5, -0.2, 0.0))
        found = fit_turn(axis, points, motion.move(points), 5.0)
        assert found.angle == pytest.approx(expected, abs=1e-14)
        np.testing.assert_allclose(found.point, (0.5, -0.2, 0.0), atol=1e-6)
