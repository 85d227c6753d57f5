"""Figures in one style, written as PNG files, and the settings that all pictures share."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...base.extras import library

__all__ = ["BLUE", "GRAY", "GREEN", "ORANGE", "PURPLE", "RED", "draw_net", "figure", "net_quads", "require"]

BLUE, ORANGE, GREEN, RED, PURPLE, GRAY = "#0072b2", "#d55e00", "#009e73", "#cc3311", "#7b4f9d", "#666666"
"""Colours that the colour-blind can distinguish."""

STYLE = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 10,
    "axes.labelsize": 11,
    "axes.linewidth": 0.8,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "savefig.dpi": 200,
}
"""Settings of matplotlib: text as in the papers, thin axes."""


NEED = {"pictures": "pictures need", "report": "a report needs"}
"""Beginning of messages about missing libraries, by the extra that installs them."""


def require(name: str = "matplotlib", extra: str = "pictures") -> Any:
    """Import a module that draws or makes pages; `InputError` with the extra that installs it if it is missing."""
    return library(name, f"{NEED[extra]} {name.partition('.')[0]}", extra)


@contextlib.contextmanager
def figure(
    folder: str | os.PathLike, name: str, size: tuple[float, float], n_colours: int | None = None
) -> Iterator[Any]:
    """Yield an empty figure in the common style, and save it as a PNG file of 200 dots per inch.

    Parameters
    ----------
    folder : path-like
        Folder to write to, created if needed.
    name : str
        File name without extension.
    size : tuple of float
        Width and height in inches.
    n_colours : int, optional
        Number of colours of the file, at most 256: with few, pictures of many thin lines take a third of the bytes. All
        colours by default.

    Yields
    ------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If matplotlib is not installed.
    """
    make_figure = require("matplotlib.figure").Figure  # without pyplot: it needs no display and keeps no state
    with require().rc_context(STYLE):
        canvas = make_figure(figsize=size, layout="constrained")
        yield canvas
        Path(folder).mkdir(parents=True, exist_ok=True)
        file = Path(folder) / f"{name}.png"
        canvas.savefig(file)
        if n_colours is not None:
            reduce_colours(file, n_colours)


def reduce_colours(file: str | os.PathLike, n_colours: int) -> None:
    """Write a picture again with a few colours; those of thin lines stay, whatever else has many shades."""
    with require("PIL.Image").open(file) as image:  # median cuts alone average the colours of few pixels
        few = image.convert("RGB").quantize(n_colours, kmeans=2, dither=0)
    few.save(file, optimize=True)


def draw_net(axes: Any, points: np.ndarray, **style: Any) -> None:
    """Draw the lines of both directions of a net of points.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to draw.
    points : ndarray, shape (n, m, 2)
        The net, such as grid lines of a face in a coordinate plane. Lines end at points that are NaN.
    **style
        Keywords of ``plot``.
    """
    for net in (points, np.swapaxes(points, 0, 1)):
        axes.plot(net[..., 0].T, net[..., 1].T, **style)


def net_quads(
    points: np.ndarray,  # (n, m, d), the net
) -> np.ndarray:  # ((n - 1) (m - 1), 4, d)
    """Corners of the quadrilaterals of a net, in order around each."""
    corners = (points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:])
    return np.stack(corners, axis=2).reshape(-1, 4, points.shape[-1])
