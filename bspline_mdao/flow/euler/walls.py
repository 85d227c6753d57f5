"""The walls of a flow, complete on all processes: their pressures and nodes are few, and forces need them all.

The process that has the cell behind a wall face provides its pressure, the one that holds a node its place; a sum over
the processes distributes them. With one process nothing is sent, and nodes are the grid's.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.numerics.halo import Halo
from ...base.numerics.processes import ONE, summed
from ...grids.cells.cell_faces import CellFaces
from ...grids.topology.ownership import Ownership
from ...grids.topology.partition import Partition

__all__ = ["Walls"]


@dataclass(frozen=True, eq=False)
class Walls:
    """Wall faces of all processes, in the order of the patches."""

    comm: Any  # the processes
    corners: np.ndarray  # (n_wall, 4) of int, corners of all wall faces, in `nodes`
    # (n_nodes,) of int, rows in the grid vector of these nodes, ascending; None if they are all nodes of the grid, on
    # one process
    rows: np.ndarray | None
    owned: np.ndarray  # (n_own,) of int, wall faces whose cells this process has
    # held, places: (n_here,) of int, nodes of this process that are on walls, and their numbers in `nodes`
    rows_here: np.ndarray
    places: np.ndarray
    n_here: int  # nodes of this process

    @classmethod
    def of(cls, faces: CellFaces) -> Walls:
        """List the walls among the faces of one process."""
        corners, none = faces.corners_of("wall"), np.zeros(0, int)
        return cls(ONE, corners, None, np.arange(len(corners)), none, none, 0)

    @classmethod
    def of_subdomain(cls, faces: CellFaces, partition: Partition, exchange: Halo) -> Walls:
        """List the walls of all processes, from the faces of each and the exchange of their nodes."""
        comm, wall = exchange.comm, faces.faces_of("wall")
        assert faces.numbers_in_grid is not None  # true for a subdomain
        owned_rows = partition.subdomain(comm.rank).rows
        corners = exchange.extend(owned_rows)[faces.corners[wall]]
        numbers = faces.numbers_in_grid[wall - faces.n_inner]
        parts = comm.allgather((numbers, corners))
        all_numbers, all_corners = (np.concatenate(lists) for lists in zip(*parts))
        order = np.argsort(all_numbers)
        rows, corners = np.unique(all_corners[order], return_inverse=True)
        ranks, rows_here = Ownership.of_nodes(partition).find(rows)
        places = np.flatnonzero(ranks == comm.rank)
        owned = np.searchsorted(all_numbers[order], numbers)
        return cls(comm, corners.reshape(-1, 4), rows, owned, rows_here[places], places, len(owned_rows))

    @property
    def rows_of_corners(self) -> np.ndarray:
        """Rows in the grid vector of the corners of all wall faces, shape (n_wall, 4)."""
        return self.corners if self.rows is None else self.rows[self.corners]

    def faces_on(self, quads: np.ndarray) -> np.ndarray:
        """Numbers of the wall faces that are among some quads, given by rows in the grid vector, shape (n, 4)."""
        return np.flatnonzero(np.isin(_keys(self.rows_of_corners), _keys(quads)))

    def nodes(self, nodes: np.ndarray) -> np.ndarray:
        """Nodes of all walls, shape (n_nodes, 3), from nodes of this process."""
        if self.rows is None:
            return nodes
        on_walls = np.zeros((len(self.rows), 3), nodes.dtype)
        on_walls[self.places] = nodes[self.rows_here]
        return summed(self.comm, on_walls)

    def nodes_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Apply the transpose of `nodes` to a derivative that all processes have."""
        if self.rows is None:
            return bar
        owned = np.zeros((self.n_here, 3), bar.dtype)
        owned[self.rows_here] = bar[self.places]
        return owned

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Values on all wall faces, shape (n_wall,), from the faces of this process, shape (n_own,)."""
        if self.rows is None:
            return values
        on_walls = np.zeros(len(self.corners), values.dtype)
        on_walls[self.owned] = values
        return summed(self.comm, on_walls)


def _keys(corners: np.ndarray) -> np.ndarray:
    """One value for each quad that identifies it, whichever corner comes first: shape (n,)."""
    ordered = np.ascontiguousarray(np.sort(corners, axis=1), dtype=np.int64)
    return ordered.view([("", np.int64)] * 4).ravel()
