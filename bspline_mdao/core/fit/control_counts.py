"""Numbers of control points, and orders, in each direction of each segment.

Directions that interfaces join form a class (`bspline_mdao.grids.topology.sharing.direction_classes`); a class has one
number of control points and one order.

Chosen numbers are such that a mover can handle them. Linear elasticity factors a matrix of all control points in every
increment, and keeps the factors if derivatives are needed. Their memory grows faster than the number of control points.
It is known before there is a fit, only from the topology and the numbers of control points, by the symbolic analysis of
`bspline_mdao.base.sparse`.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.sparse.cholesky import Cholesky
from ...errors import InputError
from ...grids.topology.index_space import FACE_NAMES
from ...grids.topology.sharing import direction_classes
from ...grids.topology.topology import Topology, shared_ids
from ..mesh.boundary import boundary_points
from ..mesh.moving_mesh import MovingMesh
from ..movement.equilibrium import Unknowns
from .requested_counts import RequestedCounts, per_block
from .settings import FITTING, FittingSettings

HIGHEST_ORDER = 16
"""Highest order: beyond it B-splines of 8-byte reals lose too many digits, and a fit takes long."""

CHOSEN, PART_OF_ALL, OF_ALL, PART_OF_NAMED, OF_NAMED = range(5)
"""Levels of a number of control points, the highest of which counts if interfaces join directions. It is chosen, or
requested for all blocks or for a single one, and each of these for a part of a cut block or for a whole one."""

FIRM = OF_ALL, OF_NAMED
"""Levels at which different counts are a contradiction."""


@dataclass(frozen=True)
class ControlCounts:
    """Numbers of control points and orders."""

    # of each direction of each segment
    n_control: np.ndarray  # int (n_segments, 3)
    orders: np.ndarray  # int (n_segments, 3)
    warnings: tuple[str, ...] = ()  # where an order was lowered


def choose_affordable_counts(
    topology: Topology,  # segments and their links
    # see `choose_counts`. If numbers are not given, spans are widened until a factor takes no more than the largest
    n_control: Any = None,
    order: int | None = None,
    settings: FittingSettings = FITTING,
) -> tuple[ControlCounts, int | None]:  # factor_bytes: see `predict_factor_bytes`
    """Numbers of control points and orders, and the memory of a factor of the mover's matrix."""
    # `InputError` as for `choose_counts`
    requested, most, cells = RequestedCounts.of(n_control, topology), settings.largest_factor, settings.cells_per_span
    counts = choose_counts(topology, requested, order, settings)
    n_bytes = predict_factor_bytes(topology, counts.n_control, settings)
    while not requested.is_complete and n_bytes is not None and n_bytes > most and cells < settings.most_cells_per_span:
        cells *= 1.01 * (n_bytes / most) ** (1 / settings.factor_growth)
        counts = choose_counts(topology, requested, order, settings, cells)
        n_bytes = predict_factor_bytes(topology, counts.n_control, settings)
    return counts, n_bytes


def predict_factor_bytes(
    # segments, links and boundary; all of it counts as given or fixed, except planes of symmetry
    topology: Topology,
    n_control: np.ndarray,  # int (n_segments, 3), control points of every segment
    settings: FittingSettings = FITTING,
) -> int | None:  # bytes; None for small meshes, and for planar grids, which do not move
    """Memory of one factor of the matrix with which linear elasticity moves a control mesh."""
    shapes = [(int(n_0), int(n_1), int(n_2)) for n_0, n_1, n_2 in n_control]
    ids = tuple(shared_ids(shapes, topology.links, topology.collapses, topology.segment_names))
    n_points = 1 + max(int(block.max()) for block in ids)
    if n_points < settings.small_mesh or np.min(n_control) == 1:
        return None
    is_free = np.ones((n_points, 3), dtype=bool)
    for face, points in boundary_points(topology, ids):
        is_free[points] &= face.kind == "symmetry"
    nowhere = np.zeros((n_points, 3))
    mesh = MovingMesh(ids, topology.segment_names, nowhere, np.zeros(0, dtype=np.int32), is_free)
    unknowns = Unknowns(mesh)
    return Cholesky().analyze(unknowns.pattern, nowhere[unknowns.point_ids]).factor_bytes


def choose_counts(
    topology: Topology,  # segments and their links
    # control points of blocks, see `RequestedCounts.of`; at most as many as nodes. A request for a single block takes
    # precedence over a request for all. Segments of a cut block share the block's number in proportion to their cells.
    # Blocks without a request follow the blocks that they are joined to. The rest get about one span per four cells,
    # fewer in blocks of millions of nodes. Up to six nodes get two control points less than nodes, but three nodes get
    # three, and all get as many as nodes if an order is requested
    n_control: Any = None,  # optional
    # order p, from 2 to `HIGHEST_ORDER`, for all directions, per direction, or per block and direction; lowered if a
    # direction has fewer control points. None: 4, or 3 in short directions if the number of control points is also
    # chosen
    order: int | None = None,  # None, int, triple of int or sequence of triples
    settings: FittingSettings = FITTING,
    cells: float | None = None,  # cells along a knot span if numbers are chosen; by default from the settings
) -> ControlCounts:
    """Numbers of control points and orders of all segments, equal on both sides of every interface."""
    # `InputError` if numbers do not fit the blocks or each other
    requested = RequestedCounts.of(n_control, topology)
    cells = settings.cells_per_span if cells is None else cells
    if order is None:
        orders = np.where(requested.counts > 0, settings.long_order, 0)
    else:
        orders = per_block(order, topology, "order")
    requests = [
        [_request(topology, s, d, requested, orders, settings, cells) for d in range(3)]
        for s in range(len(topology.segments))
    ]
    classes = direction_classes(topology)
    n_result, p_result = np.empty_like(classes), np.empty_like(classes)
    for number in range(classes.max() + 1):
        members = [tuple(m) for m in np.argwhere(classes == number)]
        n_result[classes == number], p_result[classes == number] = _agree(topology, members, requests)
    is_chosen = np.array([[request.level == CHOSEN for request in row] for row in requests])
    is_open = np.isin(classes, classes[~is_chosen], invert=True)
    said = [*_warn_of_clipped(topology, requested)]
    if is_open.any():
        said += _warn_of_wide_spans(topology, cells, settings.cells_per_span)
        said += _limit_size(topology, classes, n_result, p_result, is_open, settings.largest_choice)
    return ControlCounts(n_result, p_result, (*said, *_warn_of_lowered_orders(topology, orders, p_result)))


@dataclass(frozen=True)
class _Request:
    """Request for one direction of a segment; a requested order of 0 means none."""

    count: int
    order: int
    level: int
    asked_order: int


def _request(
    topology: Topology,
    segment: int,
    d: int,
    requested: RequestedCounts,
    orders: np.ndarray,
    settings: FittingSettings,
    cells: float,
) -> _Request:
    window = topology.segments[segment]
    n_nodes, n_block = window.shape[d], topology.shapes[window.block][d]
    order = int(orders[window.block, d])
    if order and not min(2, n_block) <= order <= HIGHEST_ORDER:
        raise InputError(f"{topology.source}: order {order} of block {window.block + 1}; give 2 to {HIGHEST_ORDER}")
    whole = min(int(requested.counts[window.block, d]), n_block)
    if not whole:
        count = _sound_count(n_nodes, order, settings, cells)
        return _Request(count, min(order or sound_order(n_nodes, settings), count), CHOSEN, order)
    if n_block > 1 and whole == 1:
        raise InputError(
            f"{topology.source}: 1 control point in direction {'ijk'[d]} of block {window.block + 1} does not go "
            f"with its {n_block} nodes; give 2 to {n_block}"
        )
    is_named = requested.is_named[window.block]
    if n_nodes == n_block:
        return _Request(whole, min(order, whole), OF_NAMED if is_named else OF_ALL, order)
    n_spans = max(round((whole + 1 - order) * (n_nodes - 1) / (n_block - 1)), 1)
    count = min(n_spans + order - 1, n_nodes)
    return _Request(count, min(order, count), PART_OF_NAMED if is_named else PART_OF_ALL, order)


def sound_order(n_nodes: int, settings: FittingSettings = FITTING) -> int:
    """Order for a number of nodes that rarely folds where their spacing varies strongly."""
    return settings.short_order if n_nodes < settings.long else settings.long_order


def _sound_count(n_nodes: int, order: int, settings: FittingSettings, cells: float) -> int:
    """Control points of a direction with a number of nodes."""
    if n_nodes <= settings.few_planes:
        return n_nodes if order else max(min(n_nodes, settings.short_order), n_nodes - 2)
    order = order or settings.long_order
    return min(max(round((n_nodes - 1) / cells) + order - 2, order + 1), n_nodes)


def _warn_of_wide_spans(topology: Topology, cells: float, usual: float) -> Iterator[str]:
    """Warn in one line if spans are wider than usual."""
    if cells != usual:
        yield (
            f"a grid of {topology.n_nodes:,} nodes gets one span per {cells:.1f} cells instead of {usual}, so "
            f"that movers can take its control mesh; give numbers of control points for others (n_control, --n-control)"
        )


def _warn_of_clipped(topology: Topology, requested: RequestedCounts) -> Iterator[str]:
    """Warn in one line if a block has fewer nodes than requested control points."""
    shapes = np.array(topology.shapes)
    places = [
        f"block {block + 1} {'ijk'[d]} ({shapes[block, d]})"
        for block, d in np.argwhere((requested.counts > shapes) & (shapes > 1))
    ]
    if places:
        listed = ", ".join(places[:8]) + (", ..." if len(places) > 8 else "")
        yield f"no more control points than nodes where more were asked for ({len(places)}): {listed}"


def _limit_size(
    topology: Topology,
    classes: np.ndarray,
    n_control: np.ndarray,
    orders: np.ndarray,
    is_open: np.ndarray,
    largest: int,
) -> Iterator[str]:
    """Lower open counts in place until the least squares of interiors have reasonable size; warn in one line."""
    chosen = n_control.copy()
    for s in range(len(classes)):
        is_lower = np.zeros(3, dtype=bool)
        while not is_lower.all() and _gram_bytes(n_control[s], orders[s]) > largest:
            is_lower = ~is_open[s] | (n_control[s] <= orders[s])
            steps = np.where(is_lower, 0, n_control[s] - orders[s]) // 16
            steps[np.argmax(np.where(is_lower, 0, n_control[s]))] += not (steps.any() or is_lower.all())
            for number in set(classes[s]):
                n_control[classes == number] -= steps[classes[s] == number].max()
    lowered = sorted({topology.segments[s].block + 1 for s in np.flatnonzero((chosen != n_control).any(axis=1))})
    if lowered:
        yield (
            f"large blocks get fewer control points than others: "
            f"block {', '.join(map(str, lowered[:8]))}{', ...' if len(lowered) > 8 else ''}"
        )


def is_affordable(n_control: np.ndarray, orders: np.ndarray, settings: FittingSettings = FITTING) -> bool:
    """Whether least squares of all interiors have reasonable size, for counts and orders of all segments."""
    return all(_gram_bytes(*segment) <= settings.largest_choice for segment in zip(n_control, orders))


def _gram_bytes(n_control: np.ndarray, orders: np.ndarray) -> int:
    """Bytes of the Gram matrix of an interior, banded with the longest direction outermost if this is less work."""
    n_free = sorted(max(int(n) - 2, 1) for n in n_control)
    n_unknown, plane = math.prod(n_free), n_free[0] * n_free[1]
    bandwidth = (int(orders.max()) - 1) * (plane + n_free[0] + 1)
    return 8 * n_unknown * (bandwidth + 1 if 3 * bandwidth < n_unknown else n_unknown)


def _agree(
    topology: Topology, members: Sequence[tuple[int, int]], requests: Sequence[Sequence[_Request]]
) -> tuple[int, int]:
    """Agree on the number of control points and the order of a class: the largest of the highest level."""
    found = {(s, d): requests[s][d] for s, d in members}
    level = max(request.level for request in found.values())
    highest = {member: request for member, request in found.items() if request.level == level}
    with_order = {member: request for member, request in found.items() if request.asked_order}
    for group, name in ((with_order, "asked_order"), (highest if level in FIRM else {}, "count")):
        for member, request in group.items():
            first, first_request = next(iter(group.items()))
            if getattr(request, name) != getattr(first_request, name):
                raise _disagreement(topology, first, first_request, member, request)
    return max(w.count for w in highest.values()), max(w.order for w in highest.values())


def _disagreement(
    topology: Topology, first: tuple[int, int], first_request: _Request, other: tuple[int, int], other_request: _Request
) -> InputError:
    """Name two blocks with different requested numbers in directions that interfaces join."""
    texts = []
    for (segment, d), request in ((first, first_request), (other, other_request)):
        block = topology.segments[segment].block
        faces = _faces_along(topology, segment, d)
        texts.append(f"block {block + 1} has {request.count} of order {request.order} in {'ijk'[d]} (on {faces})")
    return InputError(
        f"{topology.source}: numbers of control points disagree along interfaces: {' and '.join(texts)}; "
        f"give both the same"
    )


def _faces_along(topology: Topology, segment: int, d: int) -> str:
    """Names of the linked faces of a segment that contain direction ``d``."""
    names = set()
    for link in topology.alike:
        for s, section in ((link.a, link.a_section), (link.b, link.b_section)):
            flat = [e for e in range(3) if section[e] is not None]
            if s == segment and d not in flat and len(flat) == 1:
                names.add(FACE_NAMES[2 * flat[0] + (section[flat[0]] == -1)])
    return ", ".join(sorted(names)) or "an edge"


def _warn_of_lowered_orders(topology: Topology, orders: np.ndarray, result: np.ndarray) -> Iterator[str]:
    """Warn in one line if a direction with several nodes got a lower order than requested."""
    lowest: dict[tuple[int, int], int] = {}
    for window, row in zip(topology.segments, result):
        for d in range(3):
            if window.shape[d] > 1 and row[d] < orders[window.block, d]:
                key = (window.block, d)
                lowest[key] = min(int(row[d]), lowest.get(key, int(row[d])))
    if lowest:
        places = [f"block {block + 1} {'ijk'[d]} (order {order})" for (block, d), order in lowest.items()]
        listed = ", ".join(places[:4]) + (", ..." if len(places) > 4 else "")
        yield f"the order is lowered where a direction has fewer control points ({len(places)}): {listed}"
