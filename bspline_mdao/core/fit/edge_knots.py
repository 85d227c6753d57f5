"""Knots on the edges of a block from the parameters of its nodes, section II.D, and their agreement at interfaces.

Shared control points make neighbours continuous along an interface only if their bases are the same there. In every
shared direction, order and number of control points must be equal, and the knots the same function of the other shared
parameter, counted from the other end if one direction runs against the other.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from ...errors import InputError
from ...grids.topology.index_space import FACE_NAMES
from ...grids.topology.sharing import directed_classes
from ...grids.topology.topology import Link, Topology
from ..splines.knots import BilinearKnots, ConstantKnots, Knots
from ..splines.volume import Volume
from .fit_nodes import FitNodes

LARGEST_DIFFERENCE = 1e-6
"""Largest difference of equal knots, as between knots from the 4-byte coordinates of two blocks."""

SAMPLES = 33
"""Places along a shared parameter at which knots are compared."""

KNOT_KINDS = ("curved", "constant")
"""Blend the knots of four parallel edges bilinearly, Eq. (5), or take the mean of all edges that interfaces join."""

NARROWEST = 1e-10
"""Knot spans narrower than this (coincident nodes on an edge) pull the edge's knots towards uniform ones, since knots
have to increase."""

LEANING = 1e-3
"""Weight of the uniform knots where an edge's own knots coincide."""


def edge_knots(
    parameters: np.ndarray,  # (L,), parameters of the nodes of the edge, from 0 to 1
    # number of control points N and order p
    n_control: int,
    order: int,
) -> np.ndarray:  # (N + p,)
    """Open knots with about the same number of nodes in every span, section II.D.

    Examples
    --------
    >>> edge_knots(np.array([0.0, 0.1, 0.3, 0.6, 1.0]), n_control=4, order=3)
    array([0. , 0. , 0. , 0.3, 1. , 1. , 1. ])
    """
    # Inner knot ``T_i`` (i = p + 1 .. N) lies at the real node number ``q_i = (L - 1) (i - p) / (N + 1 - p)``, counted
    # from 0, between the parameters of the two nodes around it.
    breaks = _interpolate(parameters, n_control + 1 - order)
    if _is_narrow(breaks):
        breaks = (1 - LEANING) * breaks + LEANING * np.linspace(0, 1, breaks.size)
    return np.concatenate([np.zeros(order), breaks[1:-1], np.ones(order)])


def edge_knots_jvp(parameters: np.ndarray, n_control: int, order: int, d_parameters: np.ndarray) -> np.ndarray:
    """Differentiate `edge_knots` along ``d_parameters``; linear as long as no knots coincide."""
    breaks = _interpolate(parameters, n_control + 1 - order)
    d_breaks = (1 - LEANING * _is_narrow(breaks)) * _interpolate(d_parameters, n_control + 1 - order)
    return np.concatenate([np.zeros(order), d_breaks[1:-1], np.zeros(order)])


def edge_knots_vjp(parameters: np.ndarray, n_control: int, order: int, bar: np.ndarray) -> np.ndarray:
    """Transpose of `edge_knots_jvp`: from ``bar`` of the knots, shape (N + p,), to the parameters' cotangent."""
    n_spans = n_control + 1 - order
    is_narrow = _is_narrow(_interpolate(parameters, n_spans))
    inner_bar = (1 - LEANING * is_narrow) * bar[order:n_control]
    place = (np.arange(n_spans + 1) * ((parameters.size - 1) / n_spans))[1:-1]
    low = place.astype(int)
    parameters_bar = np.zeros(parameters.size + 1)
    np.add.at(parameters_bar, low, (1 - (place - low)) * inner_bar)
    np.add.at(parameters_bar, low + 1, (place - low) * inner_bar)
    return parameters_bar[:-1]


def edge_corners(knots: Knots) -> np.ndarray:
    """Knots on the four edges, shape (2, 2, N + p)."""
    if isinstance(knots, BilinearKnots):
        return knots.corners
    ends = np.array([0.0, 0.0, 1.0, 1.0]), np.array([0.0, 1.0, 0.0, 1.0])
    return knots.values(*ends).reshape(2, 2, -1)


def _interpolate(parameters: np.ndarray, n_spans: int) -> np.ndarray:
    """Values at ``n_spans + 1`` evenly spaced real node numbers."""
    places = np.arange(n_spans + 1) * ((parameters.size - 1) / n_spans)
    return np.interp(places, np.arange(parameters.size), parameters)


def _is_narrow(breaks: np.ndarray) -> bool:
    return bool(np.diff(breaks).min() < NARROWEST)


def knots_of_segments(
    topology: Topology,  # segments and links
    parameters: Sequence[np.ndarray],  # each (L0, L1, L2, 3), parameters of the nodes of every segment
    # number of control points and order in each direction
    n_control: Sequence[Sequence[int]],  # three for every segment
    orders: Sequence[Sequence[int]],  # three for every segment
    kind: str = "curved",  # one of `KNOT_KINDS`
    sharing: FitNodes | None = None,  # segments whose parameters this process has; all by default
) -> list[tuple[Knots, ...]]:
    """Knots of all segments, the same on both sides of every interface. `InputError` if the kind is unknown."""
    here = range(len(topology.segments)) if sharing is None else sharing.here
    knots = [knots_of_segment(parameters[s], n_control[s], orders[s], kind) for s in here]
    if sharing is not None:
        knots = sharing.of_all_segments(knots)
    if kind == "curved":
        return knots
    means = [[edge_corners(k)[:1, :1] for k in triple] for triple in knots]  # the same on all four edges
    joined = joined_corners(topology, means, is_change=False)
    return [
        tuple(ConstantKnots(c[0, 0], k.order) for c, k in zip(corners, triple))
        for corners, triple in zip(joined, knots)
    ]


def joined_corners(
    topology: Topology,  # segments and links
    corners: list[list[np.ndarray]],  # each (2, 2, N + p), edge knots of every segment
    is_change: bool = True,  # whether they are changes, or cotangents, of knots; the map is symmetric
) -> list[list[np.ndarray]]:
    """Replace edge knots by their mean over all edges that interfaces join, reversed where directions are."""
    classes, members = directed_classes(topology), defaultdict(list)
    for (segment, d), (forwards, backwards) in zip(np.ndindex(classes.shape[:2]), classes.reshape(-1, 2)):
        mean = corners[segment][d].mean(axis=(0, 1))
        members[forwards].append(mean)
        members[backwards].append((0 if is_change else 1) - mean[::-1])
    means = {number: np.mean(arrays, axis=0) for number, arrays in members.items()}
    return [
        [np.broadcast_to(means[number], array.shape) for number, array in zip(numbers, triple)]
        for numbers, triple in zip(classes[..., 0], corners)
    ]


def knots_of_segment(
    parameters: np.ndarray,  # (L0, L1, L2, 3), parameters of the nodes
    # number of control points and order in each direction
    n_control: Sequence[int],  # three
    orders: Sequence[int],  # three
    kind: str = "curved",  # one of `KNOT_KINDS`
) -> tuple[Knots, ...]:
    """Knots of the three directions of a single segment from the parameters on its twelve edges."""
    if kind not in KNOT_KINDS:
        raise InputError(f'knots: "{kind}" is unknown; use one of {", ".join(KNOT_KINDS)} or give knots')
    return tuple(_direction_knots(parameters, d, int(n_control[d]), int(orders[d]), kind) for d in range(3))


def knots_of_segment_jvp(
    parameters: np.ndarray, n_control: Sequence[int], orders: Sequence[int], kind: str, d_parameters: np.ndarray
) -> list[np.ndarray]:
    """Differentiate the knots on the edges: one array of shape (2, 2, N + p) per direction, as in `BilinearKnots`."""
    d_corners = []
    for d, (n, p) in enumerate(zip(n_control, orders)):
        lines, d_lines = _along(parameters, d), _along(d_parameters, d)
        corners = [[edge_knots_jvp(lines[:, s, t], n, p, d_lines[:, s, t]) for t in (0, -1)] for s in (0, -1)]
        d_corners.append(np.array(corners) if kind == "curved" else _mean_of_edges(np.array(corners)))
    return d_corners


def knots_of_segment_vjp(
    parameters: np.ndarray,
    n_control: Sequence[int],
    orders: Sequence[int],
    kind: str,
    corners_bar: Sequence[np.ndarray],
) -> np.ndarray:
    """Transpose of `knots_of_segment_jvp`: cotangent of the parameters, shape (L0, L1, L2, 3)."""
    parameters_bar = np.zeros(parameters.shape)
    for d, (n, p) in enumerate(zip(n_control, orders)):
        lines, lines_bar = _along(parameters, d), _along(parameters_bar, d)
        bars = corners_bar[d] if kind == "curved" else _mean_of_edges(corners_bar[d])
        for a, b in np.ndindex(2, 2):
            lines_bar[:, -a, -b] += edge_knots_vjp(lines[:, -a, -b], n, p, bars[a, b])
    return parameters_bar


def _mean_of_edges(corners: np.ndarray) -> np.ndarray:
    """Mean of the four edges, on each of them: symmetric, hence its own transpose."""
    return np.broadcast_to(corners.mean(axis=(0, 1)), corners.shape)


def _along(parameters: np.ndarray, d: int) -> np.ndarray:
    """Parameters of direction d with axes in the cyclic order of the knots: (d, d + 1, d + 2)."""
    return parameters[..., d].transpose(d, (d + 1) % 3, (d + 2) % 3)


def _direction_knots(parameters: np.ndarray, d: int, n_control: int, order: int, kind: str) -> Knots:
    if n_control == 1:
        return ConstantKnots.uniform(1, 1)
    lines = _along(parameters, d)
    corners = np.array([[edge_knots(lines[:, s, t], n_control, order) for t in (0, -1)] for s in (0, -1)])
    return BilinearKnots(corners, order) if kind == "curved" else ConstantKnots(corners.mean(axis=(0, 1)), order)


def require_agreement(
    topology: Topology,  # segments and their links
    volumes: Sequence[Volume],  # one for each segment
) -> None:
    """Refuse volumes that do not agree along the faces and edges that they share."""
    for link in topology.alike:
        for d in (d for d in range(3) if link.a_section[d] is None):
            difference = _difference(link, d, volumes)
            if difference:
                turned = ", which run against each other," if link.orientation.flip[d] else ""
                raise InputError(
                    f"{topology.source}: the splines of {_places(topology, link, d)}{turned} meet with {difference}; "
                    f"give both the same"
                )


def _difference(link: Link, d: int, volumes: Sequence[Volume]) -> str:
    """Difference in direction d of the first section and its partner of the second, in words; empty if they agree."""
    e, is_turned = link.orientation.perm[d], link.orientation.flip[d]
    a, b = volumes[link.a].knots[d], volumes[link.b].knots[e]
    if a.order != b.order:
        return f"orders {a.order} and {b.order}"
    if a.n_control != b.n_control:
        return f"{a.n_control} and {b.n_control} control points"
    first, second = _shared_parameters(link)
    first, second = a.values(*_others(first, d)), b.values(*_others(second, e))
    if is_turned:
        second = 1 - second[:, ::-1]
    gaps = np.abs(first - second)
    place = np.unravel_index(np.argmax(gaps), gaps.shape)
    if gaps[place] <= LARGEST_DIFFERENCE:
        return ""
    return f"knots that differ, number {place[1] + 1} most: {first[place]:.6g} and {second[place]:.6g}"


def _shared_parameters(link: Link) -> tuple[np.ndarray, np.ndarray]:
    """Points of a shared section in the parameters of both segments, each of shape (3, SAMPLES)."""
    along = np.linspace(0, 1, SAMPLES)
    first, second = (
        np.array([np.full(SAMPLES, float(end == -1)) for end in section])
        for section in (link.a_section, link.b_section)
    )
    for d in (d for d in range(3) if link.a_section[d] is None):
        first[d] = along
        second[link.orientation.perm[d]] = 1 - along if link.orientation.flip[d] else along
    return first, second


def _others(parameters: np.ndarray, d: int) -> tuple[np.ndarray, np.ndarray]:
    """The two parameters that the knots of direction d depend on."""
    return parameters[(d + 1) % 3], parameters[(d + 2) % 3]


def _places(topology: Topology, link: Link, d: int) -> str:
    """Name both sides of a link, for example ``block 1 imax in j and block 2 jmax in k``."""
    sides = ((link.a, link.a_section, d), (link.b, link.b_section, link.orientation.perm[d]))
    texts = []
    for segment, section, direction in sides:
        ends = [FACE_NAMES[2 * e + (end == -1)] for e, end in enumerate(section) if end is not None]
        texts.append(" ".join([topology.segment_names[segment], *ends, "in", "ijk"[direction]]))
    return " and ".join(texts)
