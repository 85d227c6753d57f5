"""The part of a grid that is drawn: its walls, its planes of symmetry and one layer of grid planes off the walls.

Nodes and cells that are drawn are known by their rows and numbers in the grid, so a change of shape takes a few of
them and no new cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...grids.topology.boundary_surface import quads_in_turn
from ...grids.topology.index_space import Window
from ...grids.topology.topology import Topology

__all__ = ["DIRECTIONS", "Drawn"]

DIRECTIONS = ("i", "j", "k")
"""Names of the directions of blocks."""


@dataclass(frozen=True, eq=False)
class Drawn(OneLine):
    """Nodes that are drawn, and the quads between them."""

    rows: np.ndarray  # int (n,), row of each node in the grid, ascending
    quads: np.ndarray  # int (n_quads, 4), corners among the nodes
    cells: np.ndarray  # int (n_quads,), the cell of the grid at each quad, as `GridQuality` numbers them
    n_walls: int  # the first quads, which are walls

    @classmethod
    def of(cls, topology: Topology, symmetry: bool = False, direction: int | None = None, part: float = 0.5) -> Drawn:
        """Take the walls, planes of symmetry on request, and one grid plane of each block at walls."""
        # direction: of the blocks, from 0, that is cut, none by default; part: index of the cut, from 0 to 1
        walls = [face.window for face in topology.boundary if face.kind == "wall"]
        others = [face.window for face in topology.boundary if face.kind == "symmetry"] if symmetry else []
        if direction is not None:
            others += [_plane(topology, block, direction, part) for block in sorted({wall.block for wall in walls})]
        corners, cells = zip(*(_sheet(topology, window) for window in (*walls, *others)))
        rows, quads = np.unique(np.concatenate(corners), return_inverse=True)
        n_walls = sum(len(each) for each in cells[: len(walls)])
        return cls(rows, quads.reshape(-1, 4), np.concatenate(cells), n_walls)

    def of_nodes(self, rows: np.ndarray, values: np.ndarray, otherwise: float) -> np.ndarray:
        """Values, given at some rows of the grid, at the nodes that are drawn; ``otherwise`` where none is given."""
        found = np.full(len(self.rows), otherwise)
        places = np.minimum(np.searchsorted(self.rows, rows), len(self.rows) - 1)
        is_drawn = self.rows[places] == rows
        found[places[is_drawn]] = values[is_drawn]
        return found


def _plane(topology: Topology, block: int, direction: int, part: float) -> Window:
    """Grid plane of a block at a fraction of one of its directions."""
    shape = topology.shapes[block]
    low, high = [0, 0, 0], [n - 1 for n in shape]
    low[direction] = high[direction] = round(part * (shape[direction] - 1))
    return Window(block, (low[0], low[1], low[2]), (high[0], high[1], high[2]))


def _sheet(topology: Topology, window: Window) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the corners of the quads of a window one node thick, (n, 4), and the cell at each of them."""
    flat = window.shape.index(1)
    numbers = topology.layout.numbers[window.block]
    corners = np.squeeze(numbers[window.slices], axis=flat)
    cells = topology.layout.cells.numbers[window.block]
    at = [slice(low, high) for low, high in zip(window.lo, window.hi)]
    layer = min(window.lo[flat], cells.shape[flat] - 1)
    at[flat] = slice(layer, layer + 1)
    quads = quads_in_turn(np.ascontiguousarray(corners))
    return quads, cells[tuple(at)].ravel()
