"""Cells at both edges of a wing at half its span, and at its tip, by the kind of the grid.

x points downstream, and the span is along the longer of the other sides of the walls' box.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import singledispatch
from typing import Any, NamedTuple

import numpy as np

from ...errors import InputError
from ...flow.om.snapshots import Snapshot
from ...grids.cells.first_cells import FirstCells
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.cells.node_heights import NodeHeights
from ...grids.topology.grid import Grid
from ...grids.topology.index_space import Window
from .cuts import cut_lines
from .figures import net_quads
from .mesh_slices import mesh_slice
from .mesh_view import MeshView

__all__ = ["EdgeCells", "EdgePicture", "edge_cells_of"]

NEAR_TIP = 0.9
"""Fraction of the span beyond which the grid surface through the tip is searched for."""

SIDES = {"leading edge": -1.0, "trailing edge": 1.0, "tip": 1.0}
"""Edges, and the side of the wall on which each lies in its picture."""


class EdgePicture(NamedTuple):
    """Cells about an edge, in the coordinates of its picture (m)."""

    good: Sequence[np.ndarray]  # each (n_corners, 2), cells, or edges of cells in a slice
    bad: Sequence[np.ndarray]  # same for inverted cells
    walls: Sequence[np.ndarray]  # each (n, 2), lines of the wall
    centre: np.ndarray  # (2,), the edge


class EdgeCells(ABC):
    """Cells about the edges of a wing."""

    edges: tuple[str, ...]  # names of the available edges
    height: float  # median of the heights of first cells on the baseline (m)

    @abstractmethod
    def around(
        self,
        edge: str,  # one of the edges
        nodes: np.ndarray,  # (n_nodes, 3), nodes (m)
        reach: float,  # how far around the edge cells are shown (m)
    ) -> EdgePicture:
        """Cells around an edge with nodes."""


@singledispatch
def edge_cells_of(grid: Any, state: Snapshot) -> EdgeCells:
    """Take the cells of a state with a grid around the edges of its walls."""
    raise InputError(f"cells at the walls of a {type(grid).__name__} are not known; give a Grid or a MixedMesh")


class _Directions:
    """Axes and places of the pictures of a wing's walls."""

    def __init__(self, walls: np.ndarray):  # (n, 3), nodes of the walls (m)
        extent = np.ptp(walls, axis=0)
        self.span = 1 + int(np.argmax(extent[1:]))
        self.up = 3 - self.span
        self.middle = walls[:, self.span].min() + 0.5 * extent[self.span]
        self.near_tip = walls[:, self.span].min() + NEAR_TIP * extent[self.span]
        self.of_tip = float(np.mean(walls[walls[:, self.span] > self.near_tip, 0]))

    def seen(self, edge: str) -> list[int]:
        """Axes to the right and up in the picture of an edge."""
        return [self.span if edge == "tip" else 0, self.up]


class _BlockEdges(EdgeCells):
    """Grid surfaces of blocks that leave the wall."""

    def __init__(self, grid: Grid):
        self.grid = grid
        walls = [window for patch in grid.patches if patch.kind == "wall" for window in patch.windows]
        points = np.concatenate([grid.blocks[w.block].nodes[w.slices].reshape(-1, 3) for w in walls])
        at = self.directions = _Directions(points)
        self.height = float(np.median(FirstCells.of_baseline(grid).baseline))
        at_span = _surfaces(grid, walls, at.span, at.middle, -np.inf)
        self.surfaces = {"leading edge": at_span, "trailing edge": at_span}
        if not all(2 in shape for shape in grid.shapes):
            self.surfaces["tip"] = _surfaces(grid, walls, 0, at.of_tip, at.near_tip, at.span)
        self.edges = tuple(self.surfaces)

    def around(self, edge: str, nodes: np.ndarray, reach: float) -> EdgePicture:
        """Cells of the grid surfaces; they are inverted if they turn the other way than most."""
        blocks, seen = self.grid.with_vector(nodes.ravel()).blocks, self.directions.seen(edge)
        flat = [_surface(blocks[w.block].nodes, w, *place)[..., seen] for w, place in self.surfaces[edge]]
        walls = [surface[:, 0] for surface in flat]
        wall = np.concatenate(walls)
        centre = wall[np.argmax(SIDES[edge] * wall[:, 0])]
        good, bad = [], []
        for corners in map(net_quads, flat):
            first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
            area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
            is_drawn = (np.abs(corners - centre).max(axis=2) < reach).any(axis=1)
            is_bad = np.sign(area) != np.sign(np.median(area))
            good += [*corners[is_drawn & ~is_bad]]
            bad += [*corners[is_drawn & is_bad]]
        return EdgePicture(good, bad, walls, centre)


class _MeshEdges(EdgeCells):
    """Slices through the cells of an unstructured mesh."""

    def __init__(self, mesh: MixedMesh, kinds: Mapping[str, str]):
        self.mesh = mesh
        walls = [mesh.into_fluid(faces) for name, faces in (mesh.markers or {}).items() if kinds[name] == "wall"]
        if not walls:
            raise InputError(f"{mesh.source}: no marker is a wall; give the model of the mesh, with their kinds")
        self.walls = np.concatenate(walls)
        self.directions = _Directions(mesh.points[np.unique(self.walls)])
        if mesh.n_copies > 1:
            self.directions.span = int(np.argmax(np.abs(mesh.points[mesh.n_stored] - mesh.points[0])))
            self.directions.up = 3 - self.directions.span
        self.height = float(np.median(NodeHeights.of(mesh, self.walls).baseline))
        self.edges = tuple(SIDES)[: 2 if mesh.n_copies > 1 else 3]

    def around(self, edge: str, nodes: np.ndarray, reach: float) -> EdgePicture:
        """Edges of cells in the slice, and edges of inverted cells."""
        at, seen = self.directions, self.directions.seen(edge)
        axis, place = (0, at.of_tip) if edge == "tip" else (at.span, at.middle)
        walls = [line[:, seen] for line in cut_lines(nodes, self.walls, axis, place, diagonals=True)]
        wall = np.concatenate(walls)
        centre = wall[np.argmax(SIDES[edge] * wall[:, 0])]
        box = np.array([[-np.inf] * 3, [np.inf] * 3])
        box[:, seen] = centre + reach * np.array([[-1.0], [1.0]])
        is_bad = self.mesh.quality(nodes).is_inverted
        good, bad = (mesh_slice(self.mesh, nodes, axis, place, box, of)[..., seen] for of in (~is_bad, is_bad))
        return EdgePicture([*good], [*bad], walls, centre)


@edge_cells_of.register(Grid)
def _of_grid(grid: Grid, state: Snapshot) -> EdgeCells:
    return _BlockEdges(grid)


@edge_cells_of.register(MixedMesh)
def _of_mesh(mesh: MixedMesh, state: Snapshot) -> EdgeCells:
    return _MeshEdges(mesh, MeshView(state).kinds)


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
    """Grid surface of a block that leaves the wall along one of its lines, shape (n, m, 3), the wall first."""
    flat = window.shape.index(1)
    part: list[slice | int] = list(window.slices)
    part[flat] = slice(None) if window.lo[flat] == 0 else slice(None, None, -1)
    along = [d for d in range(3) if d != flat][direction]
    part[along] = window.lo[along] + index
    surface = nodes[tuple(part)]
    return surface if flat > 3 - flat - along else surface.swapaxes(0, 1)
