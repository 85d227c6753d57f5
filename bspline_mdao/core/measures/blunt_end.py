"""Which end of the sections of a body is blunt: the upstream one, unless its grid lies the other way round.

Theory: ``docs/theory/deformations.rst``, "Directions".
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ...base.checks import axes_text
from ..mesh.frame import Frame
from .edge_cuts import cut_edges, edges_of_quads

__all__ = ["is_blunt_downstream", "why_backwards"]

STATIONS = (0.2, 0.35, 0.5, 0.65, 0.8)
"""Fractions of the span at which sections are compared: away from a fuselage and from the tip."""

NEAR, NEARER = 0.1, 0.01
"""Fractions of the chord from an end at which a section's thickness is measured."""

BLUNTER = 2.0
"""Least ratio of thicknesses near both ends: 3.2 of a NACA 0012, 1 of an ellipse, a plate or a lens."""

CUT = 0.6
"""Ratio of the thicknesses nearer to an end and near it from which it is cut off, as the base of a wedge or a missile;
0.3 of a round nose."""


def is_blunt_downstream(
    points: np.ndarray,  # (n, 3), points of the surface (m)
    quads: np.ndarray,  # int (n_quads, 4), their quads; triangles have their last corner twice
    frame: Frame,  # its directions
) -> bool:
    """Whether sections are round at the end that the frame takes for the downstream one, and sharp at the other."""
    # Of one connected body only: a slat is thinner than a flap.
    n = len(points)
    edges = edges_of_quads(quads)
    used = np.unique(quads)
    labels = connected_components(coo_array((np.ones(len(edges)), edges.T), shape=(n, n)))[1]
    if not len(used) or len(np.unique(labels[used])) > 1:
        return False
    local = frame.to_local(points)
    triangles = local[np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])]
    found = []
    for station in STATIONS:
        level = station * frame.span
        stream = cut_edges(edges, local[:, 2] - level).at(local)[:, 0]
        if not len(stream):
            continue
        chord = np.ptp(stream)
        first, last, nearer = (
            _thickness(triangles, place, level)
            for place in (stream.min() + NEAR * chord, stream.max() - NEAR * chord, stream.max() - NEARER * chord)
        )
        found.append(last > BLUNTER * first and nearer < CUT * last)
    return 2 * sum(found) > len(found)


def why_backwards(points: np.ndarray, quads: np.ndarray, frame: Frame) -> str:
    """Say why a surface seems to lie the other way round, see `is_blunt_downstream`; empty if it does not."""
    if not is_blunt_downstream(points, quads, frame):
        return ""
    stream = axes_text(frame.axes[:1])
    return f"the stream is taken to run along +{stream}, and the downstream end of the sections is the blunt one"


def _thickness(triangles: np.ndarray, stream: float, span: float) -> float:
    """Distance between the lowest and the highest point of triangles, shape (n, 3, 3), on a line along the normal."""
    sides = np.moveaxis(triangles[:, 1:] - triangles[:, :1], 1, 0)[..., [0, 2]]
    off = [stream, span] - triangles[:, 0, [0, 2]]
    area = _cross(*sides)
    whole = np.where(area == 0.0, np.inf, area)
    second, third = _cross(off, sides[1]) / whole, _cross(sides[0], off) / whole
    weights = np.stack([1.0 - second - third, second, third], axis=1)
    is_met = (weights >= -1e-9).all(axis=1) & (area != 0.0)  # on an edge both of its triangles are met
    return float(np.ptp(np.sum(weights * triangles[..., 1], axis=1)[is_met])) if is_met.any() else 0.0


def _cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Cross products of vectors in a plane, shape (n, 2)."""
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
