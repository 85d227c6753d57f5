"""Drift between the sides of periodic pairs in a moved grid.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...base.numerics.vectors import lengths
from .grid import Grid
from .index_space import Window
from .periodic import find_periodic
from .periodic_pair import PeriodicPair
from .periodic_ties import tied_sides
from .rotation_fit import CLOSE
from .sharing import boundary_sides
from .topology import Topology, describe

__all__ = ["PeriodicGap", "pair_gaps", "periodic_gaps"]


@dataclass(frozen=True)
class PeriodicGap:
    """Sides of an untied pair, and the distance of their nodes from each other."""

    pair: PeriodicPair  # both sides, and the motion between them
    gap: float  # largest distance of a node, moved by the motion, from its partner (m)
    before: float  # the same in the grid at rest (m)
    node: Window  # the node of the first side where the distance has grown most
    has_grown: bool  # whether nodes there are farther apart than the tolerance of pairs, and than before

    def __str__(self) -> str:
        unit = self.pair.motion.unit
        return (
            f"periodic faces drift apart: {describe(self.pair.windows[0])} and {describe(self.pair.others[0])}, by a "
            f"{self.pair.motion}, are {self.gap:.3g} {unit} apart at {describe(self.node)}; nothing ties them, and "
            f"flow solvers will not take them for periodic. A fit ties them where their nodes match one to one: fit "
            f"again where the model is older. The lattice of 'fit --lattice' ties them as well; or deform walls alike "
            f"where they end on both, or not there"
        )


def periodic_gaps(
    topology: Topology,  # topology of both grids
    # baseline, moved: the grid at rest, searched for pairs among faces of the kind ``other`` or of none, and the moved
    # one
    baseline: Grid,
    moved: Grid,
) -> tuple[PeriodicGap, ...]:  # those whose nodes are farther apart than the tolerance of pairs, and than before
    """Find the periodic pairs of a grid whose sides have drifted apart."""
    return tuple(found for found in pair_gaps(topology, baseline, moved) if found.has_grown)


def pair_gaps(topology: Topology, baseline: Grid, moved: Grid) -> tuple[PeriodicGap, ...]:
    """Find all untied periodic pairs of a grid; arguments as in `periodic_gaps`."""
    of_ties = tied_sides(topology)
    tied = {face.window for face, *side in boundary_sides(topology) if tuple(side) in of_ties} if of_ties else set()
    windows = [f.window for f in topology.boundary if f.kind in (None, "other") and f.window not in tied]
    return tuple(_gap(pair, baseline, moved) for pair in find_periodic(baseline, windows))


def _gap(pair: PeriodicPair, baseline: Grid, moved: Grid) -> PeriodicGap:
    """Measure the gap of a pair."""
    initial, others = _nodes(baseline, pair.windows), _nodes(baseline, pair.others)
    before, partners = cKDTree(others).query(pair.motion.move(initial))
    gaps = lengths(pair.motion.move(_nodes(moved, pair.windows)) - _nodes(moved, pair.others)[partners])
    size = np.ptp(np.concatenate([initial, others]), axis=0).max()
    worst = int(np.argmax(gaps - before))
    has_grown = bool(gaps[worst] > before[worst] + CLOSE * size)
    gap = gaps[worst] if has_grown else gaps.max()
    return PeriodicGap(pair, float(gap), float(before.max()), _node(pair.windows, worst), has_grown)


def _nodes(grid: Grid, windows: Iterable[Window]) -> np.ndarray:
    """Nodes of windows, shape (n, 3)."""
    return np.concatenate([grid.blocks[window.block].nodes[window.slices].reshape(-1, 3) for window in windows])


def _node(windows: Iterable[Window], number: int) -> Window:
    """Place of a node, numbered through the windows."""
    for window in windows:
        size = int(np.prod(window.shape))
        if number < size:
            place = tuple(int(n + lo) for n, lo in zip(np.unravel_index(number, window.shape), window.lo))
            return Window(window.block, place, place)
        number -= size
    raise IndexError("no such node")
