"""Common knots of surfaces along shared edges, so that control points of both coincide there.

A refit halves spans of one surface but not of its neighbour. Their edges are still the same curves, but with two sets
of control points, and moving these in CAD opens the edge. All surfaces whose knots agree along edges get the union of
their knots, by knot insertion, which changes no surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..mesh.spline_sides import SplineSide
from ..splines.knot_insertion import insertion_matrix
from ..splines.knots import ConstantKnots
from .side_knots import agreeing_directions, turned, union_of
from .tensor_surface import SAME_KNOT, TensorSurface

__all__ = ["with_common_knots"]


def with_common_knots(
    sides: Sequence[SplineSide],  # the walls
    surfaces: Sequence[TensorSurface],  # the surface of each
) -> list[TensorSurface]:
    """Insert knots until surfaces that share an edge have the same knots along it."""
    found = list(surfaces)
    for members, is_symmetric in agreeing_directions(sides):
        parts = [turned(surfaces[n].knots[axis], is_turned) for (n, axis), is_turned in members.items()]
        more = [turned(part, True) for part in parts] if is_symmetric else []
        union, renumbered = union_of([*parts, *more], SAME_KNOT)
        for ((n, axis), is_turned), old in zip(members.items(), renumbered):
            if old.n_control < union.n_control:
                found[n] = _inserted(found[n], axis, turned(old, is_turned), turned(union, is_turned))
    return found


def _inserted(surface: TensorSurface, axis: int, old: ConstantKnots, new: ConstantKnots) -> TensorSurface:
    """Insert knots in one direction."""
    knots = [surface.knots[0], surface.knots[1]]
    knots[axis] = new
    net = np.tensordot(insertion_matrix(old, new), surface.control_points, axes=(1, axis))
    return replace(surface, knots=(knots[0], knots[1]), control_points=np.moveaxis(net, 0, axis))
