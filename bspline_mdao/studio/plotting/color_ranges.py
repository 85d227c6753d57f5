"""Colour ranges with round ends, and colours on both sides of zero."""

from __future__ import annotations

from typing import Any

import numpy as np

from .figures import require

__all__ = ["color_map_about_zero", "colors_about_zero", "round_ticks"]

BLUE_TO_RED = (
    "#053061", "#2166ac", "#4393c3", "#92c5de", "#d1e5f0", "#f7f7f7", "#fddbc7", "#f4a582", "#d6604d", "#b2182b",
    "#67001f",
)  # fmt: skip
"""ColorBrewer's RdBu, from its blue end."""

MOST_STEPS = 6
"""Steps between the ticks of a colour bar, so that numbers of five characters stay apart on half of a picture."""


def round_ticks(
    low: float,
    high: float,  # larger than low
) -> np.ndarray:  # (n,), evenly spaced, the first at most low and the last at least high
    """Multiples of 1, 2, 2.5 or 5 times a power of ten around a range."""
    least = (high - low) / MOST_STEPS
    power = 10.0 ** np.floor(np.log10(least))
    step = power * next(factor for factor in (1.0, 2.0, 2.5, 5.0, 10.0) if factor * power >= least * (1.0 - 1e-9))
    first, last = np.floor(low / step + 1e-6), np.ceil(high / step - 1e-6)
    return step * np.arange(first, last + 1.0)


def colors_about_zero(
    low: float,
    high: float,  # larger than low
) -> list[tuple[float, str]]:  # fractions of the range from low to high, rising from 0 to 1, and colours there
    """Blue below zero, white at zero and red above it, as strong at -x as at x."""
    places = np.linspace(-1.0, 1.0, len(BLUE_TO_RED)) * max(-low, high)
    inside = places[(places > low) & (places < high)]
    at = np.concatenate([[low], inside, [high]])
    rgb = np.array([[int(color[n : n + 2], 16) for n in (1, 3, 5)] for color in BLUE_TO_RED])
    mixed = np.stack([np.interp(at, places, column) for column in rgb.T], axis=1).round().astype(int)
    parts = (at - low) / (high - low)
    return [(float(part), f"#{r:02x}{g:02x}{b:02x}") for part, (r, g, b) in zip(parts, mixed)]


def color_map_about_zero(limits: tuple[float, float]) -> Any:
    """`colors_about_zero` as a colour map of matplotlib."""
    return require("matplotlib.colors").LinearSegmentedColormap.from_list("about zero", colors_about_zero(*limits))
