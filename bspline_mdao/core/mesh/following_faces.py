"""Outer faces that follow the design surface where it ends on them.

The edge of a wall that ends on a curved face, such as the cone behind a sphere-cone, has to take the points next to it
along, or the cells between them fold. So the points of such a face are free and move with the mover like interior
points. The edges that it shares with fixed faces stay, so the motion of the wall fades over the face. Faces of periodic
pairs do not follow: tied ones are free in any case, and others would drift apart.

Theory: ``docs/theory/movers.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...base.numerics.vectors import is_line
from ...grids.topology.grid import Block, Grid
from ...grids.topology.index_space import Window
from ...grids.topology.periodic import find_periodic
from ...grids.topology.sharing import boundary_sides
from ...grids.topology.topology import Topology

__all__ = ["following_sides"]


def following_sides(
    topology: Topology,  # the boundary and the segments
    # each int (N0, N1, N2), numbers of the points of every segment
    blocks: Sequence[np.ndarray],
    points: np.ndarray,  # (n_points, 3), all points (m)
    surface: np.ndarray,  # (n_points,) of bool, points on the design surface
    # of int, points of the sides that may follow, by their numbers in
    # `bspline_mdao.grids.topology.sharing.boundary_sides`
    candidates: Mapping[int, np.ndarray],
) -> frozenset[int]:  # the sides that follow
    """Find the sides of segments that follow the surface: it ends on them, and they are not periodic."""
    met = frozenset(n for n, ids in candidates.items() if surface[ids].any() and not is_line(points[ids]))
    sides = list(boundary_sides(topology)) if met else []
    is_periodic = any(sides[n][0].kind != "farfield" for n in met)
    return met - _periodic_sides(sides, blocks, points) if is_periodic else met


def _periodic_sides(sides: Sequence[tuple], blocks: Sequence[np.ndarray], points: np.ndarray) -> set[int]:
    """Numbers of the sides that a rotation or translation maps onto others, without the far field."""
    mesh = Grid(tuple(Block(points[ids], f"segment {n}") for n, ids in enumerate(blocks, start=1)))
    windows = {
        Window.whole(segment, blocks[segment].shape).face(side): n
        for n, (face, segment, side) in enumerate(sides)
        if face.kind in (None, "other")
    }
    pairs = find_periodic(mesh, list(windows))
    return {windows[window] for pair in pairs for window in (*pair.windows, *pair.others)}
