"""Members of a grid family: the same mapping at a smoothly changed spacing of the parameters, section II.E.

The parameters of a fitted grid are smooth functions of the index. A finer or coarser member takes them at more or fewer
index positions, by cubic Hermite interpolation with slopes of fourth order, one index direction after the other. So

- integer factors keep the nodes of the grid, and factors 1/2, 1/3, ... pick from them;
- the nodes of a face depend on the face alone, and neighbours get the same;
- the stretching of the grid is kept: at factor m the ratio of neighbouring cells is the m-th root of the grid's.

The topology stays, with all indices scaled: the interval of indices between two cuts of a block gets ``round(F n)``
cells for its ``n``, one at least. Linked segments have equal intervals, so that they agree again; windows that end
between two cuts go to the nearest index.

Along its own direction a parameter increases strictly: slopes are limited to three times the smaller neighbouring
difference (Fritsch and Carlson), which ordinary grids never reach. Where interpolation *across* a line would fold it,
the line is interpolated linearly across. Theory: ``docs/theory/evaluation.rst``.

References
----------
F. N. Fritsch and R. E. Carlson, "Monotone piecewise cubic interpolation", SIAM J. Numer. Anal. 17 (1980), 238-246.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np

from ..errors import InputError
from ..splines.mesh import BSplineMesh
from ..topology.index_space import Window
from ..topology.topology import NearMiss, Topology
from .evaluator import Evaluator

MOST_NODES = 1e11
"""Nodes of a member above which no memory takes their indices."""


@dataclass(frozen=True, eq=False)
class FamilyMember:
    """A finer or coarser grid on the same control mesh.

    Parameters
    ----------
    topology : Topology
        Topology of the member.
    mesh : BSplineMesh
        The control mesh.
    parameters : tuple of ndarray, each of shape (L0, L1, L2, 3)
        Parameters of the nodes of every segment.
    """

    topology: Topology
    mesh: BSplineMesh
    parameters: tuple[np.ndarray, ...]

    def evaluator(self, n_threads: int | None = None) -> Evaluator:
        """Operator from the control points to the nodes of the member, Eq. (3)."""
        return Evaluator.of_grid(self.topology, self.mesh, self.parameters, n_threads)


def refine(topology: Topology, mesh: BSplineMesh, parameters: Sequence[np.ndarray], factor: float) -> FamilyMember:
    """Member of the family of a grid with ``factor`` times the cells per direction.

    Parameters
    ----------
    topology : Topology
        Topology of the grid.
    mesh : BSplineMesh
        Its control mesh.
    parameters : sequence of ndarray, each of shape (L0, L1, L2, 3)
        Parameters of the nodes of every segment.
    factor : float
        Cells per direction of the member relative to those of the grid; at least one in every segment.

    Returns
    -------
    FamilyMember

    Raises
    ------
    InputError
        If the factor is not a positive number.
    """
    member = refined_topology(topology, factor)
    refined = tuple(refine_parameters(x, s.shape) for x, s in zip(parameters, member.segments))
    return FamilyMember(member, mesh, refined)


def refine_parameters(parameters: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Parameters at other index positions, spread evenly over the same range of indices.

    Parameters
    ----------
    parameters : ndarray, shape (L0, L1, L2, 3)
        Parameters of a grid, each increasing along its own direction.
    shape : tuple of int
        Numbers of nodes wanted.

    Returns
    -------
    ndarray, shape (*shape, 3)
    """
    refined = np.empty((*shape, 3))
    for d in range(3):
        x = interpolate(parameters[..., d], d, shape[d], is_increasing=True)
        smooth = straight = x
        for other in ((d + 1) % 3, (d + 2) % 3):
            smooth = interpolate(smooth, other, shape[other])
            straight = _interpolate_linearly(straight, other, shape[other])
        is_folded = ((np.diff(smooth, axis=d) <= 0) & (np.diff(straight, axis=d) > 0)).any(axis=d, keepdims=True)
        refined[..., d] = np.where(is_folded, straight, smooth)
    return refined


def interpolate(values: np.ndarray, axis: int, n: int, is_increasing: bool = False) -> np.ndarray:
    """Cubic Hermite interpolation of values at integers, at ``n`` evenly spread positions.

    Parameters
    ----------
    values : ndarray
        Values.
    axis : int
        Axis along which they are interpolated.
    n : int
        Number of positions, the first and the last value being two of them.
    is_increasing : bool
        Limit slopes so that increasing values are interpolated by an increasing function.

    Returns
    -------
    ndarray
        ``n`` long along the axis. Positions at integers get the values themselves, and equal values their own bits.
    """
    x = np.moveaxis(values, axis, -1)
    if x.shape[-1] == 1:
        return np.moveaxis(np.repeat(x, n, axis=-1), -1, axis)
    steps = np.diff(x, axis=-1)
    slopes = _slopes(steps)
    if is_increasing:
        slopes = np.clip(slopes, 0.0, _largest_slopes(steps))
    at, s = _positions(x.shape[-1], n)
    step, bend_low, bend_high = steps[..., at], slopes[..., at] - steps[..., at], slopes[..., at + 1] - steps[..., at]
    inner = x[..., at] + s * (step + (1 - s) * ((1 - s) * bend_low - s * bend_high))
    return np.moveaxis(np.where(s == 1.0, x[..., at + 1], inner), -1, axis)


def _interpolate_linearly(values: np.ndarray, axis: int, n: int) -> np.ndarray:
    x = np.moveaxis(values, axis, -1)
    if x.shape[-1] == 1:
        return np.moveaxis(np.repeat(x, n, axis=-1), -1, axis)
    at, s = _positions(x.shape[-1], n)
    return np.moveaxis((1 - s) * x[..., at] + s * x[..., at + 1], -1, axis)


def _positions(n_values: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Interval of each position, and the fraction of it that lies before the position."""
    position = np.arange(n) * (n_values - 1) / max(n - 1, 1)
    at = np.minimum(position.astype(int), n_values - 2)
    return at, position - at


def _slopes(steps: np.ndarray) -> np.ndarray:
    """Slopes at the integers from the differences between them: of fourth order inside, of third at the ends."""
    n = steps.shape[-1]
    if n < 3:
        inner = [(steps[..., 0] + steps[..., 1]) / 2] if n == 2 else []
        first = (3 * steps[..., 0] - steps[..., 1]) / 2 if n == 2 else steps[..., 0]
        last = (3 * steps[..., -1] - steps[..., -2]) / 2 if n == 2 else steps[..., 0]
        return np.stack([first, *inner, last], axis=-1)
    ends = [_end_slopes(*(steps[..., m] for m in order)) for order in ((0, 1, 2), (-1, -2, -3))]
    inner = (7 * (steps[..., 1:-2] + steps[..., 2:-1]) - steps[..., :-3] - steps[..., 3:]) / 12
    return np.concatenate([np.stack(ends[0], axis=-1), inner, np.stack(ends[1][::-1], axis=-1)], axis=-1)


def _end_slopes(h_0, h_1, h_2) -> tuple[np.ndarray, np.ndarray]:
    """Slopes at the end and next to it of the cubic through the last four values."""
    return (11 * h_0 - 7 * h_1 + 2 * h_2) / 6, (2 * h_0 + 5 * h_1 - h_2) / 6


def _largest_slopes(steps: np.ndarray) -> np.ndarray:
    """Three times the smaller neighbouring difference, at every integer."""
    padded = np.concatenate([steps[..., :1], steps, steps[..., -1:]], axis=-1)
    return 3 * np.minimum(padded[..., :-1], padded[..., 1:])


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
            Cells per direction of the member relative to those of the grid.

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
            xi, eta, zeta = (_scaled_planes(segments, d, factor) for d in range(3))
            planes.append((xi, eta, zeta))
        return cls(tuple(planes))

    @property
    def shapes(self) -> tuple[tuple[int, int, int], ...]:
        """Shape of every block of the member."""
        return tuple((int(xi[-1]) + 1, int(eta[-1]) + 1, int(zeta[-1]) + 1) for xi, eta, zeta in self.planes)

    def window(self, window: Window) -> Window:
        """Window of the member that a window of the grid becomes."""
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
        Cells per direction of the member relative to those of the grid.

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
