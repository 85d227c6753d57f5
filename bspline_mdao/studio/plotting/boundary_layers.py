"""Pictures of grids with boundary layers: cells at leading edge, trailing edge and tip, and heights of first cells."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.background.mesh_model import MeshModel
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.topology.grid import Grid
from .figures import BLUE, GRAY, ORANGE, RED, figure, require

if TYPE_CHECKING:
    from .edge_cells import EdgePicture

__all__ = ["draw_first_heights", "draw_wall_cells"]

REACH = {"leading edge": 30.0, "trailing edge": 40.0, "tip": 40.0}
"""Half the width of the view of each edge, relative to the median height of the first cells."""

HEIGHT_RANGE = (0.4, 2.5)
"""Range of the heights that are shown; others are at its ends."""


def draw_wall_cells(
    folder: str | os.PathLike, name: str, grid: Grid | MixedMesh | MeshModel, moved: Mapping[str, np.ndarray]
) -> None:
    """Draw the cells at both edges of a wing at half its span, and at its tip at half its chord.

    Parameters
    ----------
    folder : path-like
        Folder to write to.
    name : str
        File name without extension.
    grid : Grid, MixedMesh or MeshModel
        The grid before the move, with patches; for an unstructured mesh, slices through its cells are drawn.
    moved : mapping of str to ndarray, each of shape (n_nodes, 3)
        Nodes (m), by the name of the mover. Inverted cells are red; for a grid, those in the plane of the picture.

    Raises
    ------
    InputError
        If matplotlib is not installed, or there are no walls.
    """
    from ...flow.om.snapshots import Snapshot  # here: heights are drawn without the framework, which loads matplotlib
    from .edge_cells import edge_cells_of

    state = Snapshot.of(grid)
    cells = edge_cells_of(state.grid, state)
    edges = cells.edges
    with figure(folder, name, (2.0 * len(edges) + 0.3, 1.5 * len(moved) + 0.3), n_colours=16) as canvas:
        panels = canvas.subplots(len(moved), len(edges), squeeze=False)
        for row, (way, nodes) in zip(panels, moved.items()):
            for axes, edge in zip(row, edges):
                reach = REACH[edge] * cells.height
                _draw(axes, cells.around(edge, np.reshape(nodes, (-1, 3)), 3.0 * reach), reach)
            row[0].set_ylabel(way)
        for axes, edge in zip(panels[0], edges):
            axes.set_title(edge)


def draw_first_heights(folder: str | os.PathLike, name: str, ratios: Mapping[str, Mapping[str, np.ndarray]]) -> None:
    """Draw the distribution of the heights of first cells relative to the heights before the move.

    Parameters
    ----------
    folder : path-like
        Folder to write to.
    name : str
        File name without extension.
    ratios : mapping of str to mapping of str to ndarray
        The ratios at all wall nodes, by the deformation and by the mover.

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
        panels[0].set_ylabel("height relative to before")
        panels[0].legend()


def _draw(axes: Any, picture: EdgePicture, reach: float) -> None:
    """Draw cells and wall about the wall's outermost point."""
    for cells, color, width in ((picture.good, GRAY, 0.25), (picture.bad, RED, 0.8)):
        lines = {"facecolors": "none", "edgecolors": color, "linewidths": width}
        axes.add_collection(require("matplotlib.collections").PolyCollection(cells, **lines))
    for wall in picture.walls:
        axes.plot(*wall.T, color="black", linewidth=0.9)
    axes.set(xticks=[], yticks=[], aspect="equal")
    centre = picture.centre
    axes.set(xlim=centre[0] + np.array([-1.3, 1.3]) * reach, ylim=centre[1] + np.array([-1.0, 1.0]) * reach)
