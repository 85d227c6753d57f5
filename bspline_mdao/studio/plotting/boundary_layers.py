"""Pictures of grids with boundary layers: cells at leading edge, trailing edge and tip, and heights of first cells."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...grids.cells.first_cells import FirstCells
from ...grids.topology.grid import Grid
from ...grids.topology.index_space import Window
from .figures import BLUE, GRAY, ORANGE, RED, figure, net_quads, require

__all__ = ["draw_first_heights", "draw_wall_cells"]

REACH = {"leading edge": 30.0, "trailing edge": 40.0, "tip": 40.0}
"""Half the width of what is shown of each edge, relative to the median height of the first cells."""

HEIGHT_RANGE = (0.4, 2.5)
"""Range of what is shown of the heights; others are at its ends."""

NEAR_TIP = 0.9
"""Part of the span outside of which the grid surface through the tip is looked for."""


def draw_wall_cells(folder: str | os.PathLike, name: str, grid: Grid, moved: Mapping[str, np.ndarray]) -> None:
    """Draw the cells at half the span about both edges of a wing, and at half the chord about its tip.

    Parameters
    ----------
    folder : path-like
        Folder to write to.
    name : str
        File name without extension.
    grid : Grid
        The grid before the move, with patches.
    moved : mapping of str to ndarray, each of shape (n_nodes, 3)
        Nodes (m) by what made them. Cells that are inverted in the plane of the picture are red.

    Raises
    ------
    InputError
        If matplotlib is not installed.
    """
    walls = [window for patch in grid.patches if patch.kind == "wall" for window in patch.windows]
    points = np.concatenate([grid.blocks[w.block].nodes[w.slices].reshape(-1, 3) for w in walls])
    extent, height = np.ptp(points, axis=0), np.median(FirstCells.of_baseline(grid).baseline)
    span = 1 + int(np.argmax(extent[1:]))
    up = 3 - span
    at_span = _surfaces(grid, walls, span, points[:, span].min() + 0.5 * extent[span], -np.inf)
    views = {"leading edge": (at_span, 0, up, -1.0), "trailing edge": (at_span, 0, up, 1.0)}
    if not all(2 in shape for shape in grid.shapes):
        near_tip = points[:, span].min() + NEAR_TIP * extent[span]
        middle = np.mean(points[points[:, span] > near_tip, 0])
        views["tip"] = (_surfaces(grid, walls, 0, middle, near_tip, span), span, up, 1.0)
    with figure(folder, name, size=(2.0 * len(views) + 0.3, 1.5 * len(moved) + 0.3)) as canvas:
        panels = canvas.subplots(len(moved), len(views), squeeze=False)
        for row, (way, nodes) in zip(panels, moved.items()):
            blocks = grid.with_vector(nodes.ravel()).blocks
            for axes, (edge, (surfaces, right, upwards, side)) in zip(row, views.items()):
                flat = [_surface(blocks[w.block].nodes, w, *place)[..., [right, upwards]] for w, place in surfaces]
                _draw(axes, flat, side, REACH[edge] * height)
            row[0].set_ylabel(way)
        for axes, edge in zip(panels[0], views):
            axes.set_title(edge)
    file = Path(folder) / f"{name}.png"
    require("PIL.Image").open(file).convert("RGB").quantize(16).save(
        file, optimize=True
    )  # thin lines make large files otherwise


def draw_first_heights(folder: str | os.PathLike, name: str, ratios: Mapping[str, Mapping[str, np.ndarray]]) -> None:
    """Draw how the heights of first cells, relative to those before the move, are distributed.

    Parameters
    ----------
    folder : path-like
        Folder to write to.
    name : str
        File name without extension.
    ratios : mapping of str to mapping of str to ndarray
        The ratios of all wall nodes by what was asked, and by the way that it was done.

    Raises
    ------
    InputError
        If matplotlib is not installed.
    """
    with figure(folder, name, size=(2.3 * len(ratios) + 0.4, 2.3)) as canvas:
        panels = canvas.subplots(1, len(ratios), squeeze=False, sharey=True)[0]
        for axes, (asked, ways) in zip(panels, ratios.items()):
            for (way, values), color in zip(ways.items(), (ORANGE, BLUE, GRAY)):
                values = np.clip(np.sort(values), *HEIGHT_RANGE)
                axes.plot(100.0 * np.arange(len(values)) / max(1, len(values) - 1), values, color=color, label=way)
            axes.set(title=asked, xlabel="wall nodes (%)", yscale="log", ylim=HEIGHT_RANGE)
            axes.set_yticks([0.5, 0.7, 1.0, 1.4, 2.0], ["0.5", "0.7", "1", "1.4", "2"])
            axes.minorticks_off()
        panels[0].set_ylabel("height relative to that before")
        panels[0].legend()


def _surfaces(
    grid: Grid, walls: Sequence[Window], axis: int, value: float, outside: float, span: int = 1
) -> list[tuple[Window, tuple[int, int]]]:
    """Windows that have a grid surface off the wall at a value of a coordinate, with its direction and index."""
    found = []
    for window in walls:
        flat = window.shape.index(1)
        wall = grid.blocks[window.block].nodes[window.slices].squeeze(axis=flat)
        counts = wall[..., span] > outside
        if not counts.any():
            continue
        steps = [np.abs(np.diff(np.where(counts, wall[..., axis], np.nan), axis=d)) for d in (0, 1)]
        direction = int(np.argmax([np.nansum(step) / max(1, step.shape[d]) for d, step in enumerate(steps)]))
        level = np.nanmean(np.where(counts, wall[..., axis], np.nan), axis=1 - direction)
        if np.nanmin(level) <= value <= np.nanmax(level):
            found.append((window, (direction, int(np.nanargmin(np.abs(level - value))))))
    return found


def _surface(nodes: np.ndarray, window: Window, direction: int, index: int) -> np.ndarray:
    """Grid surface of a block that leaves the wall along a line of it, shape (n, m, 3), the wall first."""
    flat = window.shape.index(1)
    part: list[slice | int] = list(window.slices)
    part[flat] = slice(None) if window.lo[flat] == 0 else slice(None, None, -1)
    along = [d for d in range(3) if d != flat][direction]
    part[along] = window.lo[along] + index
    surface = nodes[tuple(part)]
    return surface if flat > 3 - flat - along else surface.swapaxes(0, 1)


def _draw(axes: Any, surfaces: Sequence[np.ndarray], side: float, reach: float) -> None:
    """Draw cells of grid surfaces, shape (n, m, 2), within reach of the wall's outermost point to one side."""
    wall = np.concatenate([surface[:, 0] for surface in surfaces])
    centre = wall[np.argmax(side * wall[:, 0])]
    for surface in surfaces:
        corners = net_quads(surface)
        first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
        area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        is_drawn = (np.abs(corners - centre).max(axis=2) < 3.0 * reach).any(axis=1)
        is_bad = np.sign(area) != np.sign(np.median(area))
        for which, color, width in ((is_drawn & ~is_bad, GRAY, 0.25), (is_drawn & is_bad, RED, 0.8)):
            lines = {"facecolors": "none", "edgecolors": color, "linewidths": width}
            axes.add_collection(require("matplotlib.collections").PolyCollection(corners[which], **lines))
        axes.plot(*surface[:, 0].T, color="black", linewidth=0.9)
    axes.set(xticks=[], yticks=[], aspect="equal")
    axes.set(xlim=centre[0] + np.array([-1.3, 1.3]) * reach, ylim=centre[1] + np.array([-1.0, 1.0]) * reach)
