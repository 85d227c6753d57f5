"""Curves through coarse points go through them, keep edges, and add no waves."""

import numpy as np

from bspline_mdao.studio.plotting.smooth_lines import curve_through, outline_through


def section(n):
    """The NACA 0012 from its leading edge around it, closed, n points each side."""
    x = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, n))
    y = 0.6 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    return np.concatenate([np.stack([x, y], axis=1), np.stack([x, -y], axis=1)[-2::-1]])


def test_a_section_of_few_points_is_drawn_as_one_of_many():
    drawn, fine = outline_through(section(17)), section(2001)
    distance = np.array([np.linalg.norm(fine - point, axis=1).min() for point in drawn])
    polygon = section(17)
    middles = 0.5 * (polygon[1:] + polygon[:-1])
    coarse = np.array([np.linalg.norm(fine - point, axis=1).min() for point in middles])
    assert distance.max() < 0.3 * coarse.max()
    for point in polygon:
        assert np.linalg.norm(drawn - point, axis=1).min() < 1e-12


def test_the_edge_of_a_section_stays_sharp():
    drawn = outline_through(section(17))
    assert drawn[0, 0] == drawn[-1, 0] == drawn[:, 0].max()
    steps = np.diff(drawn, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    assert (np.sum(steps[1:] * steps[:-1], axis=1) > 0.9).all()  # but where it begins and ends


def test_straight_parts_stay_straight_beside_a_kink():
    z = np.linspace(0.0, 1.0, 11)
    edge = np.stack([z, np.where(z < 0.4, 0.9 * z, 0.36 + 0.2 * (z - 0.4))], axis=1)
    drawn = curve_through(edge)
    off = np.abs(drawn[:, 1] - np.interp(drawn[:, 0], *edge.T))
    assert off[np.abs(drawn[:, 0] - 0.4) > 0.1001].max() < 1e-12
    assert off.max() < 0.01


def test_points_that_coincide_are_taken_once():
    tip = np.array([[0.0, 1.0], [0.5, 1.0], [0.5, 1.0], [0.7, 1.0]])
    np.testing.assert_allclose(curve_through(tip)[:, 1], 1.0)
    assert curve_through(tip[:1]).shape == (1, 2)
