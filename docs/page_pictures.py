"""What the scripts that draw one small picture for each of many pages share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
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


def in_plane(block) -> np.ndarray:
    """Nodes of a section's grid in its first plane, shape (n, m, 2)."""
    return block.nodes[:, :, 0, :2]
