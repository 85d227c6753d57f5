"""More control points along the directions in which splines miss a grid by several of its cells.

A residual much larger than the cells around it folds some of them when the grid moves. If the fit with the numbers that
are chosen from the grid alone has one, directions whose grid lines are missed (`line_errors`) are raised, each class of
joined directions separately, until its lines are met or its limit is reached, as long as a mover can handle the control
mesh.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...grids.topology.sharing import direction_classes
from ...grids.topology.topology import Topology
from .control_counts import ControlCounts, is_affordable, predict_factor_bytes
from .fit_nodes import FitNodes
from .line_errors import class_errors
from .requested_counts import RequestedCounts
from .settings import FITTING, FittingSettings


@dataclass(frozen=True)
class CloserCounts:
    """Numbers of control points that fit a grid more closely."""

    # factor_bytes: see `bspline_mdao.core.fit.control_counts.predict_factor_bytes`

    counts: ControlCounts  # the numbers
    factor_bytes: int | None

    def is_affordable(self, settings: FittingSettings = FITTING) -> bool:
        """Whether least squares and a mover can handle them."""
        if not is_affordable(self.counts.n_control, self.counts.orders, settings):
            return False
        return self.factor_bytes is None or self.factor_bytes <= settings.largest_factor


def closer_counts(
    topology: Topology,  # segments and their links
    requested: RequestedCounts,  # directions with requested numbers are left unchanged
    counts: ControlCounts,  # numbers chosen from the grid alone
    sharing: FitNodes,  # nodes of the segments of this process; all processes call this
    nodes: np.ndarray,  # (n_rows, 3), its nodes (m)
    parameters: Sequence[np.ndarray],  # each (L0, L1, L2, 3), parameters of the nodes of every segment
    most_per_node: float,  # one of the values in the settings
    settings: FittingSettings = FITTING,
) -> CloserCounts:
    """Raise numbers of control points where lines of the grid are missed."""
    classes = direction_classes(topology)
    first, lengths = _of_classes(classes, counts.n_control), _of_classes(classes, _lengths(topology))
    most = np.maximum(first, (most_per_node * lengths).astype(int))
    raised, tried, least = first.copy(), first.copy(), np.full(len(first), np.inf)
    is_wanted = _open_classes(topology, requested, classes)
    while is_wanted.any():
        numbers = set(np.flatnonzero(is_wanted).tolist())
        errors = class_errors(classes, numbers, sharing, nodes, parameters, tried[classes], counts.orders)
        is_less = is_wanted & (errors < least)
        raised[is_less], least[is_less] = tried[is_less], errors[is_less]
        is_wanted &= (errors > settings.largest_line_miss) & (tried < most)
        tried[is_wanted] = np.minimum(tried + np.maximum(tried // settings.points_per_rise, 1), most)[is_wanted]
    closer = replace(counts, n_control=raised[classes])
    return CloserCounts(closer, predict_factor_bytes(topology, closer.n_control, settings))


def _open_classes(topology: Topology, requested: RequestedCounts, classes: np.ndarray) -> np.ndarray:
    """Mark the classes of directions without requests, shape (n_classes,)."""
    is_asked = np.array([requested.counts[segment.block] > 0 for segment in topology.segments])
    return ~np.isin(np.arange(classes.max() + 1), classes[is_asked])


def _lengths(topology: Topology) -> np.ndarray:
    """Nodes of every direction of every segment, shape (n_segments, 3)."""
    return np.array([segment.shape for segment in topology.segments])


def _of_classes(classes: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values of directions, shape (n_segments, 3), as one for each class, within which they are equal."""
    result = np.zeros(classes.max() + 1, dtype=int)
    result[classes] = values
    return result


def warn_of_misses(
    topology: Topology,  # segments and their links
    counts: ControlCounts,  # numbers in use
    found: CloserCounts | None,  # numbers that a mover could not handle, if any
    missed: float,  # largest error relative to the width of the cells
) -> str:
    """Warning that a grid is still missed by several cells, with the request that would help."""
    what = f"the splines miss the grid by up to {missed:.3g} widths of its cells, which moves may fold"
    if found is None:
        return f"{what}; no more control points along the lines that they miss come closer"
    request = request_for(topology, counts, found.counts.n_control)
    options = " ".join(f"--n-control {block}={'x'.join(map(str, n))}" for block, n in request.items())
    cost = f"factors of {found.factor_bytes / 1e9:.2g} GB to move" if found.factor_bytes else "long to fit"
    return (
        f"{what}; more control points along the lines that they miss would take {cost}: {options} (n_control={request})"
    )


def request_for(
    topology: Topology,  # segments and their links
    counts: ControlCounts,  # numbers so far
    wanted: np.ndarray,  # int (n_segments, 3), numbers at least as large
) -> dict[int, tuple[int, ...]]:
    """Request by block number, from 1, for wanted numbers in all directions, with as few blocks as cover them."""
    classes, lengths = direction_classes(topology), _lengths(topology)
    is_met = np.zeros(classes.max() + 1, dtype=bool)
    request: dict[int, tuple[int, ...]] = {}
    for s, d in np.argwhere(wanted > counts.n_control):
        block = topology.segments[s].block
        if not is_met[classes[s, d]]:
            parts = [number for number, part in enumerate(topology.segments) if part.block == block]
            request[block + 1] = tuple(
                _whole(wanted[parts, e], counts.orders[parts, e], lengths[parts, e], topology.shapes[block][e])
                for e in range(3)
            )
            is_met[classes[parts]] = True
    return request


def _whole(numbers: np.ndarray, orders: np.ndarray, lengths: np.ndarray, n_block: int) -> int:
    """Number for a whole block that gives each part at least its number."""
    if n_block == 1:
        return 1
    spans = np.ceil((numbers + 1 - orders) * (n_block - 1) / (lengths - 1)).max()
    return min(int(spans) + int(orders.max()) - 1, n_block)
