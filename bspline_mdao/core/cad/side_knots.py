"""Knots of sides that share edges: an edge passes its knots to the opposite edge, to the next side, and so on.

Theory: ``docs/theory/cad.rst``.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ..mesh.spline_sides import SplineSide
from ..splines.knots import ConstantKnots
from ..splines.side import VolumeSide

__all__ = ["SideKnots", "agreeing_directions", "starting_knots", "turned", "union_of"]

ONE_KNOT = 1e-7
"""Knots of edges closer than this are one: the difference for grids in single precision."""

MOST_SHIFTED = 1e-5
"""Upper limit of the tolerance, relative to the size of the walls, within which knots of edges are one: a tolerance
does not control normals on shorter spans, and a refit folds there."""

Direction = tuple[int, int]
"""Number of a side, and its u (0) or v (1)."""


@dataclass(frozen=True, eq=False)
class SideKnots(OneLine):
    """Starting knots for the surface of a side, which include all knots of its edges."""

    start: tuple[ConstantKnots, ConstantKnots]  # in u and v
    edges: tuple[tuple[ConstantKnots, ConstantKnots], tuple[ConstantKnots, ConstantKnots]]  # by axis and end

    @classmethod
    def of(cls, side: VolumeSide) -> SideKnots:
        """Take the union of opposite edges, without neighbours."""
        (u, u_edges), (v, v_edges) = (union_of([side.edge_knots(axis, end) for end in (0, 1)]) for axis in (0, 1))
        return cls((u, v), ((u_edges[0], u_edges[1]), (v_edges[0], v_edges[1])))


def union_of(
    parts: Sequence[ConstantKnots],  # knots of one order
    same: float = ONE_KNOT,  # knots closer than this are one
) -> tuple[ConstantKnots, list[ConstantKnots]]:
    """Union with the largest multiplicity of each knot, and the parts with identical numbers for equal knots."""
    values = np.sort(np.concatenate([part.knots for part in parts]))
    values = values[np.diff(values, prepend=-1.0) > same]
    counts = [np.bincount(np.searchsorted(values, part.knots, side="right") - 1) for part in parts]
    order = parts[0].order
    found = [ConstantKnots(np.repeat(values, count), order) for count in (np.max(counts, axis=0), *counts)]
    return found[0], found[1:]


def turned(knots: ConstantKnots, is_turned: bool) -> ConstantKnots:
    """Return knots, reversed if requested."""
    return ConstantKnots(1.0 - knots.knots[::-1], knots.order) if is_turned else knots


def starting_knots(
    sides: Sequence[SplineSide],  # sides of one model
    tolerance: float = 0.0,  # largest distance of surfaces from them, relative to their size
) -> list[SideKnots]:
    """Knots for each side, equal along shared edges."""
    start: dict[Direction, ConstantKnots] = {}
    edges: dict[Direction, tuple[ConstantKnots, ConstantKnots]] = {}
    same = max(ONE_KNOT, min(tolerance, MOST_SHIFTED))
    for members, is_symmetric in agreeing_directions(sides):
        places = [(way, end) for way in members for end in (0, 1)]
        parts = [turned(sides[n].surface.edge_knots(axis, end), members[n, axis]) for (n, axis), end in places]
        more = [turned(part, True) for part in parts] if is_symmetric else []
        union, renumbered = union_of([*parts, *more], same)
        for place, (way, is_turned) in enumerate(members.items()):
            start[way] = turned(union, is_turned)
            first, last = (turned(renumbered[2 * place + end], is_turned) for end in (0, 1))
            edges[way] = first, last
    return [SideKnots((start[n, 0], start[n, 1]), (edges[n, 0], edges[n, 1])) for n in range(len(sides))]


def agreeing_directions(
    sides: Sequence[SplineSide],  # sides of one model
) -> list[tuple[dict[Direction, bool], bool]]:
    """Groups of directions with common knots: whether each is reversed, and whether both senses are identified."""
    shared: dict[tuple[int, ...], list[tuple[Direction, bool]]] = defaultdict(list)
    folded: set[Direction] = set()
    for number, side in enumerate(sides):
        for axis, edge in ((0, side.ids[:, 0]), (0, side.ids[:, -1]), (1, side.ids[0]), (1, side.ids[-1])):
            if (edge == edge[0]).all():
                continue  # a point
            forth, back = tuple(edge.tolist()), tuple(edge[::-1].tolist())
            shared[(side.surface.orders[axis], *min(forth, back))].append(((number, axis), back < forth))
            if forth == back:
                folded.add((number, axis))
    neighbours: dict[Direction, list[tuple[Direction, bool]]] = defaultdict(list)
    for (first, is_turned), *others in shared.values():
        for other, other_turned in others:
            neighbours[first].append((other, is_turned != other_turned))
            neighbours[other].append((first, is_turned != other_turned))
    found: list[tuple[dict[Direction, bool], bool]] = []
    left = {(number, axis) for number in range(len(sides)) for axis in (0, 1)}
    while left:
        start = min(left)
        members, stack, is_symmetric = {start: False}, [start], start in folded
        while stack:
            here = stack.pop()
            for other, is_turned in neighbours[here]:
                if other not in members:
                    members[other] = members[here] != is_turned
                    stack.append(other)
                    is_symmetric |= other in folded
                is_symmetric |= members[other] != (members[here] != is_turned)
        left -= set(members)
        found.append((members, is_symmetric))
    return found
