"""Overlapping component grids: blocks without interfaces between them, one of which extends into the other.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from .donors import Donors, find_donors
from .grid import Grid
from .index_space import Window, face_layers
from .topology import Topology, first_joined

__all__ = ["component_numbers", "donors_of_others", "is_fringe", "lies_in_others"]

SAMPLE = 200
"""Number of sampled nodes per face: more than half of an overset face lies inside another component."""


def component_numbers(topology: Topology) -> np.ndarray:
    """Number of the component grid of each block: blocks that interfaces join belong together."""
    pairs = [np.array([[item.a.block], [item.b.block]]) for item in topology.interfaces]
    first = first_joined(len(topology.shapes), pairs)
    return np.unique(first, return_inverse=True)[1]


def donors_of_others(
    nodes: Sequence[np.ndarray],  # (ni, nj, nk, 3), nodes of all blocks (m)
    components: np.ndarray,  # int, component grid of each block
    component: int,  # the component of the points
    points: np.ndarray,  # (n, 3), the points (m)
    apart: Sequence[int] = (),  # blocks to leave out
) -> Donors:
    """Find the cells of the other component grids that contain points."""
    others = [b for b in range(len(nodes)) if components[b] != component and b not in apart]
    found = find_donors([nodes[b] for b in others], points)
    return Donors(np.where(found.block < 0, -1, np.array([*others, -1])[found.block]), found.cell, found.place)


def is_fringe(grid: Grid, window: Window) -> bool:
    """Whether most nodes of a window are blanked as interpolated: IBLANK is negative there."""
    iblank = grid.blocks[window.block].iblank
    return iblank is not None and bool(np.mean(iblank[window.slices] < 0) > 0.5)


def lies_in_others(grid: Grid, topology: Topology, windows: Sequence[Window]) -> Iterator[bool]:
    """Say for faces of the boundary whether the layer of nodes next to them lies inside other component grids."""
    # the next layer, as sides that slide on each other are on the same surface, with cells on either side
    components, nodes = component_numbers(topology), [block.nodes for block in grid.blocks]
    repeated = [block for pair in topology.repeated for block in pair]
    for window in windows:
        inner = face_layers(nodes[window.block], window)[1].reshape(-1, 3)
        inner = inner[:: 1 + len(inner) // SAMPLE]
        apart = repeated if window.block in repeated else []
        donors = donors_of_others(nodes, components, components[window.block], inner, apart)
        yield bool(np.mean(donors.block >= 0) > 0.5)
