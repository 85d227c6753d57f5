"""How far the sides of periodic pairs have drifted apart in a moved grid.

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
from .rotation_fit import CLOSE
from .topology import Topology, describe

__all__ = ["PeriodicGap", "periodic_gaps"]


@dataclass(frozen=True)
class PeriodicGap:
    """Sides of a pair of which some nodes no longer lie on each other."""

    pair: PeriodicPair  # both sides, and the motion between them
    gap: float  # largest distance of a node, moved by it, from its partner (m)
    node: Window  # the node of the first side where it is largest

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
    # baseline, moved: the grid at rest, in which pairs are looked for among faces of the kind ``other`` or of none, and
    # the moved one
    baseline: Grid,
    moved: Grid,
) -> tuple[PeriodicGap, ...]:  # those of which nodes are further apart than pairs may be, and than they were
    """Find the periodic pairs of a grid whose sides have drifted apart."""
    windows = [face.window for face in topology.boundary if face.kind in (None, "other")]
    return tuple(found for pair in find_periodic(baseline, windows) for found in _drifted(pair, baseline, moved))


def _drifted(pair: PeriodicPair, baseline: Grid, moved: Grid) -> Iterable[PeriodicGap]:
    """Yield the gap of a pair where there is one."""
    initial, others = _nodes(baseline, pair.windows), _nodes(baseline, pair.others)
    before, partners = cKDTree(others).query(pair.motion.move(initial))
    gaps = lengths(pair.motion.move(_nodes(moved, pair.windows)) - _nodes(moved, pair.others)[partners])
    size = np.ptp(np.concatenate([initial, others]), axis=0).max()
    worst = int(np.argmax(gaps - before))
    if gaps[worst] > before[worst] + CLOSE * size:
        yield PeriodicGap(pair, float(gaps[worst]), _node(pair.windows, worst))


def _nodes(grid: Grid, windows: Iterable[Window]) -> np.ndarray:
    """Nodes of windows, shape (n, 3)."""
    return np.concatenate([grid.blocks[window.block].nodes[window.slices].reshape(-1, 3) for window in windows])


def _node(windows: Iterable[Window], number: int) -> Window:
    """Give the place of a node that is counted through windows."""
    for window in windows:
        size = int(np.prod(window.shape))
        if number < size:
            place = tuple(int(n + lo) for n, lo in zip(np.unravel_index(number, window.shape), window.lo))
            return Window(window.block, place, place)
        number -= size
    raise IndexError("no such node")
