"""Whether volumes agree in orders and knots along everything that they share, section II.D.

Shared control points make neighbours one along an interface only if their bases are the same there: in every shared
direction the same order and number of control points, and knots that are the same function of the other shared
parameter, counted from the other end where one direction runs against the other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..splines.volume import Volume
from ..topology.index_space import FACE_NAMES
from ..topology.topology import Link, Topology

LARGEST_DIFFERENCE = 1e-6
"""Knots may differ by so much, as those do that follow the 4-byte coordinates of two blocks."""

SAMPLES = 33
"""Places along a shared parameter at which knots are compared."""


def require_agreement(topology: Topology, volumes: Sequence[Volume]) -> None:
    """Refuse volumes that do not agree along the faces and edges that they share.

    Parameters
    ----------
    topology : Topology
        Segments and their links.
    volumes : sequence of Volume
        One for each segment.

    Raises
    ------
    InputError
        If orders, numbers of control points or knots differ: names two blocks with their faces and directions.
    """
    for link in topology.links:
        for d in (d for d in range(3) if link.a_section[d] is None):
            difference = _difference(link, d, volumes)
            if difference:
                turned = ", which run against each other," if link.orientation.flip[d] else ""
                raise InputError(
                    f"{topology.source}: the splines of {_places(topology, link, d)}{turned} meet with {difference}; "
                    f"give both the same"
                )


def _difference(link: Link, d: int, volumes: Sequence[Volume]) -> str:
    """What differs in direction d of the first section and its partner of the second; empty where they agree."""
    e, is_turned = link.orientation.perm[d], link.orientation.flip[d]
    a, b = volumes[link.a].knots[d], volumes[link.b].knots[e]
    if a.order != b.order:
        return f"orders {a.order} and {b.order}"
    if a.n_control != b.n_control:
        return f"{a.n_control} and {b.n_control} control points"
    first, second = _parameters(link)
    first, second = a.values(*_others(first, d)), b.values(*_others(second, e))
    if is_turned:
        second = 1 - second[:, ::-1]
    gaps = np.abs(first - second)
    place = np.unravel_index(np.argmax(gaps), gaps.shape)
    if gaps[place] <= LARGEST_DIFFERENCE:
        return ""
    return f"knots that differ, number {place[1] + 1} most: {first[place]:.6g} and {second[place]:.6g}"


def _parameters(link: Link) -> tuple[np.ndarray, np.ndarray]:
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
