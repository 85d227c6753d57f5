"""The part of a grid that is made during a drag: cells that are drawn, and the worst ones on the baseline.

Which cells these are depends only on the model and on what is visible, and their nodes are bitwise equal to the nodes
of the whole grid, so nothing that is shown depends on what was shown before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...base.display import OneLine
from ...core.mesh.surface import SurfaceGrid
from ...core.model.fitted_model import FittedModel
from ...core.model.local_model import LocalModel
from ...core.model.movable import ControlPointMap
from ...core.sliding.sliding_nodes import Slide
from ...core.walls.grid_map import GridMap
from ...grids.cells.block_cells import BlockCells
from ...grids.cells.hexahedron import element_measures
from ...grids.cells.orthogonality import orthogonality
from ...grids.topology.partition import Subdomain

__all__ = ["Part", "corners_of"]

STEPS = tuple((c & 1, c >> 1 & 1, c >> 2) for c in range(8))
"""Corners of a cell, numbered ``i + 2 j + 4 k``."""


def corners_of(model: FittedModel, cells: np.ndarray) -> np.ndarray:
    """Rows of the corners of some cells, shape (n, 8), by `STEPS`."""
    layout = model.topology.layout
    blocks, index = layout.cells.unravel(cells)
    return np.stack([layout.ravel(blocks, index + np.array(step)) for step in STEPS], axis=1)


@dataclass(frozen=True, eq=False)
class Part(OneLine):
    """Some cells of a grid, with the walls, and the maps to their nodes."""

    model: FittedModel
    surface: SurfaceGrid  # its walls
    slides: Sequence[Slide]  # patches that slide
    cells: np.ndarray  # int (n_cells,), numbers of the cells in the grid, ascending
    corners: np.ndarray  # int (n_cells, 8), rows of their corners
    rows: np.ndarray  # int (n,), rows of the nodes of the part, ascending
    handedness: np.ndarray  # (n_cells,), of their blocks
    degenerate: np.ndarray  # uint8 (n_cells,), corners that are degenerate on the baseline

    @classmethod
    def of(
        cls,
        model: FittedModel,
        surface: SurfaceGrid,
        slides: Sequence[Slide],
        cells: np.ndarray,  # int, in any order
        blocks: Sequence[BlockCells],  # cells of the whole grid on the baseline, block by block
    ) -> Part:
        """Take cells of a grid, whose blocks have cells in all three directions, as in every moving grid."""
        cells = np.unique(cells)
        corners = corners_of(model, cells)
        signs = np.repeat([block.sign for block in blocks], [block.n_cells for block in blocks])
        bits = np.concatenate([block.degenerate_corners.ravel() for block in blocks])
        rows = np.unique(np.concatenate([corners.ravel(), surface.rows]))
        return cls(model, surface, slides, cells, corners, rows, signs[cells], bits[cells])

    @cached_property
    def wall_map(self) -> GridMap:
        """Map to its nodes with exact walls; wall nodes come first."""
        return self._local.map_meeting(self.surface.rows, self.model, self.slides)

    @cached_property
    def free_map(self) -> ControlPointMap:
        """Map to its nodes from control points only."""
        return self._local.map_sliding(self.slides, self.model)

    @cached_property
    def _local(self) -> LocalModel:
        return self.model.local_model(Subdomain.of_rows(self.rows, self.model.n_nodes))

    def spread(self, nodes: np.ndarray) -> np.ndarray:
        """Nodes of the part, the first ones given, among all of the grid (m), shape (n_nodes, 3); NaN elsewhere."""
        spread = np.full((self.model.n_nodes, 3), np.nan)
        spread[self.rows] = nodes[: len(self.rows)]
        return spread

    def measured(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Q and smallest corner of its cells with the nodes of the grid (m), shape (n_nodes, 3)."""
        triples = element_measures(nodes[self.corners], self.handedness, self.degenerate).triples
        return orthogonality(triples, axis=1), triples.min(axis=1)

    def among_all(self, values: np.ndarray, n_cells: int) -> np.ndarray:
        """Values of its cells among all cells of the grid, shape (n_cells,); infinity elsewhere."""
        spread = np.full(n_cells, np.inf)
        spread[self.cells] = values
        return spread
