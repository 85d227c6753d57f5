"""Members of a grid family: the same mapping at a smoothly changed spacing of the parameters, section II.E.

The parameters of a fitted grid are smooth functions of the index (`.index_map`), with as many continuous derivatives as
the splines have, and at least two. A finer or coarser member takes them at more or fewer index positions, one index
direction after the other. So

- integer factors keep the nodes of the grid, and factors 1/2, 1/3, ... pick from them;
- the nodes of a face depend only on the face, and neighbours get the same nodes;
- the stretching of the grid is kept: at factor m the ratio of neighbouring cells is the m-th root of the grid's ratio.

The topology stays, with all indices scaled: the interval of indices between two cuts of a block gets ``round(F n)``
cells for its ``n``, at least one. Linked segments have equal intervals, so they still agree. Windows that end between
two cuts go to the nearest index.

Along its own direction a parameter increases strictly. Where interpolation *across* a line would fold it, the line is
interpolated linearly across. Theory: ``docs/theory/evaluation.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np

from ...errors import InputError
from ...grids.topology.index_space import Window
from ...grids.topology.topology import NearMiss, Topology
from ..splines.mesh import BSplineMesh
from .evaluator import Evaluator
from .index_map import interpolate, interpolate_linearly

MOST_NODES = 1e11
"""Number of nodes above which no memory can store a member's indices."""


@dataclass(frozen=True, eq=False)
class FamilyMember:
    """A finer or coarser grid on the same control mesh."""

    topology: Topology  # topology of the member
    mesh: BSplineMesh  # the control mesh
    parameters: tuple[np.ndarray, ...]  # each (L0, L1, L2, 3), parameters of the nodes of every segment

    def evaluator(self, n_threads: int | None = None) -> Evaluator:
        """Operator from the control points to the nodes of the member, Eq. (3)."""
        return Evaluator.of_grid(self.topology, self.mesh, self.parameters, n_threads)


def refine(
    topology: Topology,  # topology of the grid
    mesh: BSplineMesh,  # its control mesh
    parameters: Sequence[np.ndarray],  # each (L0, L1, L2, 3), parameters of the nodes of every segment
    factor: float,  # cells per direction relative to the grid; at least one in every segment
) -> FamilyMember:
    """Member of the family of a grid with ``factor`` times the cells per direction."""
    # `InputError` if the factor is not a positive number
    member = refined_topology(topology, factor)
    continuity = continuity_of(mesh)
    refined = tuple(refine_parameters(x, s.shape, continuity) for x, s in zip(parameters, member.segments))
    return FamilyMember(member, mesh, refined)


def continuity_of(mesh: BSplineMesh) -> int:
    """Continuous derivatives of the map from indices to parameters: p - 2 for order p, and at least two."""
    return max(2, *(order - 2 for volume in mesh.volumes for order in volume.orders))


def refine_parameters(
    parameters: np.ndarray,  # (L0, L1, L2, 3), parameters of a grid, each increasing along its own direction
    shape: tuple[int, ...],  # numbers of nodes of the result
    continuity: int = 2,  # continuous derivatives of the parameters as functions of the index
) -> np.ndarray:  # (*shape, 3)
    """Parameters at other index positions, spread evenly over the same range of indices."""
    refined = np.empty((*shape, 3))
    for d in range(3):
        x = interpolate(parameters[..., d], d, shape[d], is_increasing=True, continuity=continuity)
        smooth = straight = x
        for other in ((d + 1) % 3, (d + 2) % 3):
            smooth = interpolate(smooth, other, shape[other], continuity=continuity)
            straight = interpolate_linearly(straight, other, shape[other])
        is_folded = ((np.diff(smooth, axis=d) <= 0) & (np.diff(straight, axis=d) > 0)).any(axis=d, keepdims=True)
        refined[..., d] = np.where(is_folded, straight, smooth)
    return refined


@dataclass(frozen=True, eq=False)
class IndexScaling:
    """Index of every node plane of a grid in the member."""

    # for each block and direction, index in the member of each node plane of the grid; planes at the ends of segments
    # are mapped exactly
    planes: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]

    @classmethod
    def of(
        cls,
        topology: Topology,  # topology of the grid
        factor: float,  # cells per direction relative to the grid
    ) -> IndexScaling:
        """Scale the segments of a topology."""
        is_number = isinstance(factor, Real) and not isinstance(factor, bool)
        if not (is_number and np.isfinite(factor) and factor > 0):
            raise InputError(f"{topology.source}: factor {factor!r} for a family member; give a positive number")
        n_nodes = sum(math.prod(1.0 + factor * (n - 1) for n in shape) for shape in topology.shapes)
        if n_nodes > MOST_NODES:
            raise InputError(f"{topology.source}: factor {factor:g} makes {n_nodes:.1e} nodes, beyond memory; lower it")
        planes = []
        for block in range(len(topology.shapes)):
            segments = [segment for segment in topology.segments if segment.block == block]
            xi, eta, zeta = (_scaled_planes(segments, d, factor) for d in range(3))
            planes.append((xi, eta, zeta))
        return cls(tuple(planes))

    @property
    def shapes(self) -> tuple[tuple[int, int, int], ...]:
        """Shape of every block of the member."""
        return tuple((int(xi[-1]) + 1, int(eta[-1]) + 1, int(zeta[-1]) + 1) for xi, eta, zeta in self.planes)

    def window(self, window: Window) -> Window:
        """Window of the member that corresponds to a window of the grid."""
        planes = self.planes[window.block]
        lo = tuple(int(p[at]) for p, at in zip(planes, window.lo))
        hi = tuple(int(p[at]) for p, at in zip(planes, window.hi))
        return Window(window.block, lo, hi)

    def nearest(self, block: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """For each direction, the node plane of the grid nearest to each node plane of the member."""
        return tuple(
            np.rint(np.interp(np.arange(p[-1] + 1), p, np.arange(len(p)))).astype(int) for p in self.planes[block]
        )


def _scaled_planes(segments: Sequence[Window], d: int, factor: float) -> np.ndarray:
    """Index in the member of each node plane of a block in direction ``d``."""
    cuts = sorted({segment.lo[d] for segment in segments} | {segment.hi[d] for segment in segments})
    planes = np.zeros(cuts[-1] + 1, dtype=int)
    for lo, hi in zip(cuts[:-1], cuts[1:]):
        n_cells = scaled_count(hi - lo + 1, factor) - 1
        planes[lo : hi + 1] = planes[lo] + np.floor(np.arange(hi - lo + 1) * n_cells / (hi - lo) + 0.5).astype(int)
    return planes


def scaled_count(n_nodes: int, factor: float) -> int:
    """Number of nodes in the member of a direction of ``n_nodes``: ``round(F (n - 1)) + 1``, at least two.

    Examples
    --------
    >>> scaled_count(5, 2.0), scaled_count(5, 0.1), scaled_count(1, 2.0)
    (9, 2, 1)
    """
    # A direction of one node keeps it.
    return 1 if n_nodes == 1 else max(int(np.floor(factor * (n_nodes - 1) + 0.5)), 1) + 1


def refined_topology(
    topology: Topology,  # topology of the grid
    factor: float,  # cells per direction relative to the grid
) -> Topology:  # the same segments, links and collapses; all windows scaled
    """Topology of the member of the grid family with ``factor`` times the cells per direction."""
    # `InputError` if the factor is not a positive number
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


def _scaled_near_miss(miss: NearMiss, window: Callable[[Window], Window]) -> NearMiss:
    return replace(miss, window=window(miss.window), other=None if miss.other is None else window(miss.other))
