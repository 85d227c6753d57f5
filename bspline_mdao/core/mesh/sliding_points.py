"""Points of a grid that moves without splines: after a move they return to the fixed surfaces that they slide on.

    p <- p + E (q(p_s; p0_s) - p_s)     p_s: points that slide, p0: all before the move

E is zero at the other points of the design surface, which stay at their given places. Points of tied periodic sides
take the mean of both sides.

Theory: ``docs/theory/sliding.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...grids.topology.node_numbering import node_copies, source_rows
from ...grids.topology.periodic_ties import Ties
from ...grids.topology.topology import Topology
from ..sliding.sliding_nodes import Slide, SlidingNodes, SlidNodes
from ..walls.sliding_correction import SlidingCorrection
from ..walls.wall_correction import WallCorrection

__all__ = ["SlidPoints", "SlidingPoints"]


@dataclass(frozen=True, eq=False)
class SlidingPoints(OneLine):
    """Map that takes points back to the surfaces that they slide on, and others along."""

    on_nodes: SlidingCorrection  # the same for all nodes of the grid, shared ones once per block
    point_ids: np.ndarray  # int (n_nodes,), the point of each node
    originals: np.ndarray  # int (n_points,), the node of each point that its other nodes are copies of
    ties: Ties | None  # points of periodic sides

    @classmethod
    def of(
        cls,
        topology: Topology,
        nodes: np.ndarray,  # (n_nodes, 3), the grid (m)
        point_ids: np.ndarray,  # int (n_nodes,), the point of each node
        surface_ids: np.ndarray,  # int, points of the design surface
        slides: Sequence[Slide],
        ties: Ties | None,
    ) -> SlidingPoints:
        """Find the nodes, and the correction that fades from them."""
        copies = node_copies(topology)
        rows = np.setdiff1d(np.arange(len(nodes)), copies[:, 0])
        originals = np.empty(point_ids.max() + 1, dtype=int)
        originals[point_ids[rows]] = rows
        sliding = SlidingNodes.of(topology, nodes, slides)
        asked = np.union1d(sliding.rows, source_rows(copies, originals[surface_ids]))
        correction = SlidingCorrection(WallCorrection.of(topology, nodes, asked), sliding.among(asked))
        return cls(correction, point_ids, originals, ties)

    def at(self, initial: np.ndarray, points: np.ndarray) -> SlidPoints:
        """Take points to the surfaces, given those before the move, both of shape (n_points, 3) (m)."""
        nodes = points[self.point_ids]
        slid = self.on_nodes.apply(nodes, initial[self.point_ids])
        found = nodes[self.originals]
        return SlidPoints(self, found if self.ties is None else initial + self.ties.alike(found - initial), slid)


@dataclass(frozen=True, eq=False)
class SlidPoints(OneLine):
    """Positions of points after sliding, with derivatives."""

    of: SlidingPoints
    points: np.ndarray  # (n_points, 3), in metres
    slid: SlidNodes

    def jvp(self, d_initial: np.ndarray, d_points: np.ndarray) -> np.ndarray:
        """Change of the points with changes before and after the move, each of shape (n_points, 3)."""
        of = self.of
        change = d_points[of.point_ids]
        of.on_nodes.jvp(self.slid, change, d_initial[of.point_ids])
        found = change[of.originals]
        return found if of.ties is None else d_initial + of.ties.alike(found - d_initial)

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""
        of, found_bar = self.of, bar if self.of.ties is None else self.of.ties.alike(bar.copy())
        nodes_bar = np.zeros((len(of.point_ids), 3))
        nodes_bar[of.originals] = found_bar
        initial_nodes_bar = np.zeros_like(nodes_bar)
        of.on_nodes.vjp(self.slid, nodes_bar, initial_nodes_bar)
        initial_bar, points_bar = bar - found_bar, np.zeros_like(bar)
        np.add.at(initial_bar, of.point_ids, initial_nodes_bar)
        np.add.at(points_bar, of.point_ids, nodes_bar)
        return initial_bar, points_bar
