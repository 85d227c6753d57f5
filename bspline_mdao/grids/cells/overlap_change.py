"""Effect of a move on the overlap of component grids: places of fringes in the cells of others, before and after.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ..topology.donors import INSIDE, places_in_cells
from ..topology.grid import Grid
from ..topology.overset import donors_of_others
from ..topology.topology import first_joined
from .mixed_cells import MixedMesh

__all__ = ["OverlapChange"]


@dataclass(frozen=True)
class OverlapChange(OneLine):
    """Motion of the nodes of fringes in the cells of other component grids that contain them, their donors."""

    n_fringe: int  # nodes of fringes
    n_donors: int  # nodes that lie in a cell of another component grid before the move
    n_left: int  # nodes that have left that cell after it
    largest: float  # largest change of a coordinate in that cell, whose sides are 1
    median: float  # median of the largest change of each node
    farthest: float  # distance of the farthest node from its cell

    @classmethod
    def of(
        cls,
        grid: Grid,  # the grid of the file
        mesh: MixedMesh,  # the same as a mesh
        fringe: np.ndarray,  # int, nodes of the mesh on overset faces
        points: np.ndarray,  # (n, 3), its nodes after the move (m)
    ) -> OverlapChange:
        """Measure a move; nodes blanked as interpolated, with a negative IBLANK, belong to the fringe as well."""
        ids = _block_ids(grid, mesh)
        components = _components(ids)
        before, after = [mesh.points[block] for block in ids], [points[block] for block in ids]
        is_fringe = np.zeros(mesh.n_points, dtype=bool)
        is_fringe[fringe] = True
        places, n_fringe = [np.zeros((0, 2, 3))], 0
        for component in range(components.max() + 1):
            mine = np.zeros(mesh.n_points, dtype=bool)
            for number in np.flatnonzero(components == component):
                mine[ids[number][is_fringe[ids[number]]]] = True
                iblank = grid.blocks[number].iblank
                if iblank is not None:
                    mine[ids[number][np.broadcast_to(iblank < 0, ids[number].shape)]] = True
            rows = np.flatnonzero(mine[: mesh.n_stored])  # both planes of a section move together
            n_fringe += len(rows)
            donors = donors_of_others(before, components, component, mesh.points[rows])
            has_donor = donors.block >= 0
            found = places_in_cells(after, donors, points[rows])
            places.append(np.stack([donors.place, found], axis=1)[has_donor])
        was, now = np.concatenate(places).transpose(1, 0, 2)
        change = np.abs(now - was).max(axis=1)
        out = np.maximum(-now, now - 1.0).max(axis=1, initial=0.0)
        return cls(
            n_fringe,
            len(change),
            int((out > INSIDE).sum()),
            float(change.max(initial=0.0)),
            float(np.median(change)) if len(change) else 0.0,
            float(out.max(initial=0.0)),
        )

    def lines(self) -> list[str]:
        """Describe it; empty if no node has a donor."""
        if not self.n_donors:
            return []
        left = f"; {self.n_left:,} are out of it by up to {self.farthest:.2g}" if self.n_left else ""
        return [
            f"overlap: {self.n_donors:,} of {self.n_fringe:,} nodes of fringes lie in cells of other component grids; "
            f"their places there change by up to {self.largest:.2g} of the cell, {self.median:.2g} in the median{left}"
        ]


def _block_ids(grid: Grid, mesh: MixedMesh) -> list[np.ndarray]:
    """Nodes of the mesh for the nodes of each block; a planar grid is one cell deep."""
    assert mesh.numbers is not None
    ids = grid.layout.split(mesh.numbers)
    if mesh.n_copies == 1:
        return ids
    return [np.concatenate([block, block + mesh.n_stored], axis=block.shape.index(1)) for block in ids]


def _components(ids: Sequence[np.ndarray]) -> np.ndarray:
    """Number of the component grid of each block: blocks that share nodes belong together."""
    nodes = np.concatenate([block.ravel() for block in ids])
    blocks = np.repeat(np.arange(len(ids)), [block.size for block in ids])
    order = np.argsort(nodes, kind="stable")
    is_shared = nodes[order][1:] == nodes[order][:-1]
    pairs = np.stack([blocks[order][:-1][is_shared], blocks[order][1:][is_shared]])
    return np.unique(first_joined(len(ids), [pairs]), return_inverse=True)[1]
