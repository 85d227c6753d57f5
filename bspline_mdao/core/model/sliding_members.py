"""Members of a grid family whose nodes are on the surfaces that patches slide on, as well as the grid's nodes are.

The residual of the fit is interpolated, and nodes between the nodes of the grid leave a curved surface by the error of
the interpolation. So their heights over the surface are interpolated instead: nodes of the patch go to the nearest
points at these heights, and the displacement fades over the blocks.

Theory: ``docs/theory/sliding.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...grids.topology.sharing import boundary_sections
from ...grids.topology.topology import Topology
from ..evaluation.transfer import NodeTransfer
from ..sliding.sliding_nodes import Slide, SlidingNodes
from ..walls.sliding_correction import SlidingCorrection
from ..walls.wall_correction import WallCorrection

__all__ = ["onto_surfaces"]


def onto_surfaces(
    topology: Topology,  # of the grid
    nodes: np.ndarray,  # (n_nodes, 3), the grid (m)
    member: Topology,
    member_nodes: np.ndarray,  # (n_member_nodes, 3), nodes of the member (m)
    slides: Sequence[Slide],
) -> np.ndarray:
    """Displacements (m) of the nodes of a member, (n_member_nodes, 3), that take nodes of patches onto surfaces."""
    transfer, numbers = NodeTransfer.of(topology, member), topology.layout.numbers
    sides = [
        rows.ravel() for _, rows in boundary_sections(topology, [numbers[s.block][s.slices] for s in topology.segments])
    ]
    heights = {}
    for slide in slides:
        rows = np.unique(np.concatenate([sides[n] for n in slide.sides]))
        of_slide = np.zeros((len(nodes), 1))
        of_slide[rows, 0] = slide.surface.levels(nodes[rows]).values
        heights[id(slide.surface)] = transfer.prolong(of_slide)[:, 0]
    sliding = SlidingNodes.of(member, member_nodes, slides)
    groups = [
        replace(
            group,
            heights=np.array([heights[id(surface)][sliding.rows[group.places]] for surface in group.surfaces]),
        )
        for group in sliding.groups
    ]
    sliding = replace(sliding, groups=tuple(groups))
    moved = member_nodes.copy()
    SlidingCorrection(WallCorrection.of(member, member_nodes, sliding.rows), sliding).apply(moved)
    return moved - member_nodes
