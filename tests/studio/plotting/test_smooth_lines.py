"""Curves through coarse points go through them, keep edges, and add no waves."""

import numpy as np
from scipy.spatial import ConvexHull

from bspline_mdao.studio.plotting.cuts import cut_lines
from bspline_mdao.studio.plotting.smooth_lines import curve_through, outline_through, outlines_at


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


def test_a_steep_distribution_does_not_double_back():
    x = np.array([0.008, 0.012, 0.014, 0.020, 0.028, 0.040, 0.060, 0.120])
    pressures = np.array([0.75, 0.49, 0.48, 0.47, 0.26, 0.24, 0.16, 0.02])  # on the lower side behind a blunt nose
    drawn = curve_through(np.stack([x, pressures], axis=1))
    assert (np.diff(drawn[:, 0]) > 0.0).all()


def test_points_that_coincide_are_taken_once():
    tip = np.array([[0.0, 1.0], [0.5, 1.0], [0.5, 1.0], [0.7, 1.0]])
    np.testing.assert_allclose(curve_through(tip)[:, 1], 1.0)
    nearly = tip + np.array([[0.0, 0.0], [0.0, 0.0], [1e-17, 1e-17], [0.0, 0.0]])
    np.testing.assert_allclose(curve_through(nearly)[:, 1], 1.0)
    assert curve_through(tip[:1]).shape == (1, 2)


def test_a_wall_that_is_cut_between_its_grid_lines_is_drawn_through_these_alone():
    angles, z = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False), np.linspace(0.0, 1.0, 4)
    turn = angles + np.zeros((4, 1))
    points = np.stack([np.cos(turn), 0.4 * np.sin(turn), z[:, None] + np.zeros(24)], axis=-1).reshape(-1, 3)
    rows = np.arange(96).reshape(4, 24)
    after = np.roll(rows, -1, axis=1)
    quads = np.stack([rows[:-1], after[:-1], after[1:], rows[1:]], axis=-1).reshape(-1, 4)
    (line,) = outlines_at(0.41, points, quads, (0, 1, 2))
    assert np.linalg.norm(line[0] - line[-1]) < 1e-12
    assert len(line) == 24 * 8 + 1
    assert np.abs(np.hypot(line[:, 0], line[:, 1] / 0.4) - 1.0).max() < 1e-3
    first, last = line[1] - line[0], line[-1] - line[-2]  # it is as round where it closes
    assert np.degrees(np.arccos(first @ last / np.linalg.norm(first) / np.linalg.norm(last))) < 6.0
    (with_diagonals,) = cut_lines(points, quads, 2, 0.41, diagonals=True)
    assert len(with_diagonals) == 2 * 24 + 1
    assert np.hypot(with_diagonals[:, 0], with_diagonals[:, 1] / 0.4).min() < 0.995  # beside the wall


def test_curves_through_a_cut_of_triangles_swing_nowhere():
    rng = np.random.default_rng(0)
    for n in (150, 600, 1500):
        for _ in range(6):
            points = rng.normal(size=(n, 3))
            points /= np.linalg.norm(points, axis=1, keepdims=True)
            triangles = ConvexHull(points).simplices[:, [0, 1, 2, 2]]
            (polygon,) = cut_lines(points * [1.0, 0.3, 1.0], triangles, 2, 0.2)
            (drawn,) = outlines_at(0.2, points * [1.0, 0.3, 1.0], triangles, (0, 1, 2))
            off, middles = np.abs(np.hypot(drawn[:, 0], drawn[:, 1] / 0.3) - 0.96**0.5), polygon[1:] + polygon[:-1]
            assert off.max() < 1.1 * np.abs(np.hypot(0.5 * middles[:, 0], middles[:, 1] / 0.6) - 0.96**0.5).max()


def test_a_cut_that_is_a_point_or_a_segment_is_drawn_as_it_is():
    tiny = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    np.testing.assert_array_equal(outline_through(tiny), tiny[[1, 0, 0, 1]])
    assert outline_through(np.zeros((2, 2))).shape == (1, 2)
