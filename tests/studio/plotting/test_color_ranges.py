"""Colour bars have round ticks, and fields of two signs are white at zero."""

import numpy as np
import pytest

from bspline_mdao.studio.plotting.color_ranges import color_map_about_zero, colors_about_zero, round_ticks


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ((-1.2, 0.87), [-1.5, -1.0, -0.5, 0.0, 0.5, 1.0]),
        ((0.0, 1.0), [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]),
        ((1.3e-5, 4.1e-5), [1e-5, 1.5e-5, 2e-5, 2.5e-5, 3e-5, 3.5e-5, 4e-5, 4.5e-5]),
        ((-340.0, -20.0), [-400.0, -300.0, -200.0, -100.0, 0.0]),
    ],
)
def test_ticks_are_round(limits, expected):
    np.testing.assert_allclose(round_ticks(*limits), expected, atol=1e-12)


def test_ticks_enclose_any_range_with_few_steps():
    rng = np.random.default_rng(3)
    for low, width in zip(rng.normal(size=50) * 10.0 ** rng.integers(-6, 6, 50), 10.0 ** rng.uniform(-4, 4, 50)):
        ticks = round_ticks(low, low + width)
        slack = 1e-5 * width
        assert ticks[0] <= low + slack
        assert ticks[-1] >= low + width - slack
        assert 2 <= len(ticks) <= 9


@pytest.mark.parametrize("limits", [(-1.5, 1.0), (-0.1, 0.9), (-2.0, 0.0), (0.0, 3.0)])
def test_zero_is_white_and_both_sides_are_as_strong(limits):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    low, high = limits
    parts, colors = zip(*colors_about_zero(low, high))
    assert (parts[0], parts[-1]) == (0.0, 1.0)
    assert (np.diff(parts) > 0.0).all()
    assert all(len(color) == 7 for color in colors)
    at = color_map_about_zero(limits)

    def color(value):
        return np.array(at((value - low) / (high - low))[:3])

    np.testing.assert_allclose(color(0.0), 0.968, atol=0.03)  # of 256 steps
    if low < 0.0 < high:
        both = min(-low, high)
        assert color(-both)[2] > color(-both)[0]
        assert color(both)[0] > color(both)[2]
        assert abs(color(-both).min() - color(both).min()) < 0.2
