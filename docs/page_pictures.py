"""What the scripts that draw one small picture for each of many pages share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from bspline_mdao.plotting import figure

IDEAS = Path(__file__).parent / "_static" / "ideas"
"""Pictures that pages of the theory begin with."""


def chosen(drawings: Iterable[Callable], names: list[str]) -> list[Callable]:
    """Functions with these names, or all."""
    return [draw for draw in drawings if not names or draw.__name__ in names]


def draw_pictures(folder: Path, sizes: Mapping[Callable, tuple[float, float]], names: list[str]) -> None:
    """Draw what is named, or all, each into a figure of its size in inches."""
    for draw in chosen(sizes, names):
        with figure(folder, draw.__name__, sizes[draw], n_colours=64) as drawing:
            draw(drawing)


def bare(axes, title: str, **settings) -> None:
    """Leave nothing of the axes but a title, and make both directions equal."""
    axes.set(**{"aspect": "equal", **settings})
    axes.set_title(title, fontsize=10)
    axes.axis("off")


def panels(drawing, titles: Sequence[str], n_rows: int = 1):
    """Panels with titles, row by row."""
    row = drawing.subplots(n_rows, len(titles) // n_rows, squeeze=False).ravel()
    for axes, title in zip(row, titles):
        axes.set_title(title, fontsize=10)
    return row


def bare_panels(drawing, titles: Sequence[str], n_rows: int = 1, **settings):
    """Panels of which nothing but titles is left."""
    row = panels(drawing, titles, n_rows)
    for axes, title in zip(row, titles):
        bare(axes, title, **settings)
    return row


def turned(points: np.ndarray, angle: float, about: tuple[float, float] = (0.5, 0.0)) -> np.ndarray:
    """Rotate points in the plane of x and y clockwise by an angle (rad), by default about the middle of the chord."""
    moved, cos, sin = points.copy(), np.cos(angle), np.sin(angle)
    x, y = points[..., 0] - about[0], points[..., 1] - about[1]
    moved[..., 0], moved[..., 1] = about[0] + cos * x + sin * y, about[1] - sin * x + cos * y
    return moved


def in_plane(block) -> np.ndarray:
    """Nodes of a section's grid in its first plane, shape (n, m, 2)."""
    return block.nodes[:, :, 0, :2]
