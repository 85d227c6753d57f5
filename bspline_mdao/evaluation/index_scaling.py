"""The topology of a finer or coarser member of a grid family: the same, with all indices scaled.

The interval of indices between two cuts of a block gets ``round(F n)`` cells for its ``n``, one at least. Linked
segments have equal intervals, so that they agree again; windows that end between two cuts go to the nearest index.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np

from ..errors import InputError
from ..topology.index_space import Window
from ..topology.topology import NearMiss, Topology

MOST_NODES = 1e11
"""Nodes of a member beyond which no memory takes their indices."""


@dataclass(frozen=True, eq=False)
class IndexScaling:
    """Index of every node plane of a grid in the member.

    Parameters
    ----------
    planes : tuple of (tuple of three ndarray of int)
        For each block and direction, index in the member of each node plane of the grid; those at the ends of segments
        are mapped exactly.
    """

    planes: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]

    @classmethod
    def of(cls, topology: Topology, factor: float) -> IndexScaling:
        """Scale the segments of a topology.

        Parameters
        ----------
        topology : Topology
            Topology of the grid.
        factor : float
            Cells per direction of the member, by those of the grid.

        Raises
        ------
        InputError
            If the factor is not a positive number.
        """
        is_number = isinstance(factor, Real) and not isinstance(factor, bool)
        if not (is_number and np.isfinite(factor) and factor > 0):
            raise InputError(f"{topology.source}: factor {factor!r} for a family member; give a positive number")
        n_nodes = sum(math.prod(1.0 + factor * (n - 1) for n in shape) for shape in topology.shapes)
        if n_nodes > MOST_NODES:
            raise InputError(f"{topology.source}: factor {factor:g} makes {n_nodes:.1e} nodes, beyond memory; lower it")
        planes = []
        for block in range(len(topology.shapes)):
            segments = [segment for segment in topology.segments if segment.block == block]
            planes.append(tuple(_scaled_planes(segments, d, factor) for d in range(3)))
        return cls(tuple(planes))

    @property
    def shapes(self) -> tuple[tuple[int, int, int], ...]:
        """Shape of every block of the member."""
        return tuple(tuple(int(p[-1]) + 1 for p in planes) for planes in self.planes)

    def window(self, window: Window) -> Window:
        """Carry a window over to the member."""
        planes = self.planes[window.block]
        lo = tuple(int(p[at]) for p, at in zip(planes, window.lo))
        hi = tuple(int(p[at]) for p, at in zip(planes, window.hi))
        return Window(window.block, lo, hi)

    def nearest(self, block: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """For each direction, the node plane of the grid nearest to each one of the member."""
        return tuple(
            np.rint(np.interp(np.arange(p[-1] + 1), p, np.arange(len(p)))).astype(int) for p in self.planes[block]
        )


def _scaled_planes(segments, d: int, factor: float) -> np.ndarray:
    """Index in the member of each node plane of a block in direction ``d``."""
    cuts = sorted({segment.lo[d] for segment in segments} | {segment.hi[d] for segment in segments})
    planes = np.zeros(cuts[-1] + 1, dtype=int)
    for lo, hi in zip(cuts[:-1], cuts[1:]):
        n_cells = scaled_count(hi - lo + 1, factor) - 1
        planes[lo : hi + 1] = planes[lo] + np.floor(np.arange(hi - lo + 1) * n_cells / (hi - lo) + 0.5).astype(int)
    return planes


def scaled_count(n_nodes: int, factor: float) -> int:
    """Count the nodes in the member of a direction of ``n_nodes``: ``round(F (n - 1)) + 1``, at least two.

    A direction of one node keeps it.

    Examples
    --------
    >>> scaled_count(5, 2.0), scaled_count(5, 0.1), scaled_count(1, 2.0)
    (9, 2, 1)
    """
    return 1 if n_nodes == 1 else max(int(np.floor(factor * (n_nodes - 1) + 0.5)), 1) + 1


def refined_topology(topology: Topology, factor: float) -> Topology:
    """Topology of the member of the grid family with ``factor`` times the cells per direction.

    Parameters
    ----------
    topology : Topology
        Topology of the grid.
    factor : float
        Cells per direction of the member, by those of the grid.

    Returns
    -------
    Topology
        The same segments, links and collapses; all windows scaled.

    Raises
    ------
    InputError
        If the factor is not a positive number.
    """
    scaling = IndexScaling.of(topology, factor)
    window = scaling.window
    return replace(
        topology,
        shapes=scaling.shapes,
        interfaces=tuple(replace(i, a=window(i.a), b=window(i.b)) for i in topology.interfaces),
        boundary=tuple(replace(face, window=window(face.window)) for face in topology.boundary),
        collapsed=tuple(map(window, topology.collapsed)),
        near_misses=tuple(_scaled_near_miss(miss, window) for miss in topology.near_misses),
        joined_gaps=tuple(_scaled_near_miss(miss, window) for miss in topology.joined_gaps),
        segments=tuple(map(window, topology.segments)),
    )


def _scaled_near_miss(miss: NearMiss, window) -> NearMiss:
    return replace(miss, window=window(miss.window), other=None if miss.other is None else window(miss.other))
