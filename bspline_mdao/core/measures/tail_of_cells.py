"""Tangents of both sides of plane sections at the trailing edge of a wing of triangles and quads.

Theory: ``docs/theory/geometry.rst``, "Angle of the trailing edge".
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, diags_array, vstack

from ...base.numerics.vectors import dots, lengths
from ...errors import InputError
from ...grids.cells.quads import area_vectors
from .edge_cuts import EdgeCuts, cut_edges
from .jets import KINK, SmoothCorners, jets
from .nose_of_cells import CellSections
from .probes import FLAT
from .section_lines import polynomial_weights

__all__ = ["tail_lines", "tail_tangents"]

FACING = 0.5
"""Cosine of the angle to the planform normal, in the plane of a section, from which a cell belongs to the upper or
lower side: the base of a blunt trailing edge faces downstream."""

LEVEL = 1e-6
"""Fraction of the chord within which points of a section are equally far downstream: the accuracy of fits."""

SIDES = {"upper": 1.0, "lower": -1.0}
"""Sides, and the signs of their normals."""


def tail_tangents(sections: CellSections) -> list[csr_array]:
    """Find the forward tangents of the upper and lower side at the trailing edge, as combinations of nodes."""
    # 1. The end of a side is the point furthest downstream at an edge of one of its cells, where the side has a kink.
    # 2. At both nodes of that edge the side has derivatives with respect to u and v. Their combination in the plane of
    #    the section on the baseline is its tangent there.
    # 3. The section's tangent is interpolated between them like the point.
    corners, edges = SmoothCorners(sections.wing.points, sections.wing.quads), _edges_of(sections)
    cuts, found = list(_cuts(sections, edges)), []
    for side in SIDES:
        ends = [_end(sections, edges, cut, side) for cut in cuts]  # step 1
        nodes, weights = (np.array(parts) for parts in zip(*ends))
        tangent = csr_array((len(cuts), sections.wing.n_points))
        for at, weight in zip(nodes.T, weights.T):
            at_nodes = _in_planes(sections, corners, at, SIDES[side], weight > 0.0)
            tangent = csr_array(tangent + diags_array(weight) @ at_nodes)  # step 3
        found.append(tangent)
    return found


def tail_lines(
    sections: CellSections,
    between: tuple[float, float],  # fractions of the chord
) -> list[csr_array]:
    """Fit straight lines to the upper and lower side between two fractions of the chord: forward tangents."""
    # 1. Points of a section are where its plane cuts edges of cells, fixed combinations of nodes. Each is on the side
    #    faced by the cells at its edge.
    # 2. A line is fitted to the points of a side, with their chordwise distances from the trailing edge as parameters.
    wing, edges = sections.wing, _edges_of(sections)
    start, chord = sections.leading.at(wing.points), sections.chord @ wing.points
    found: list[list[csr_array]] = [[] for _ in SIDES]
    for number, cut in enumerate(_cuts(sections, edges)):  # step 1
        size = chord[number] @ chord[number]
        fractions = (cut.points.at(wing.points) - start[number]) @ chord[number] / size
        facing = edges.normals[cut.edges] @ sections.frame.axes[1]
        for rows, sense in zip(found, SIDES.values()):
            is_used = (fractions >= between[0]) & (fractions <= between[1]) & (sense * facing > 0.0)
            if len(np.unique(fractions[is_used])) < 2:
                raise InputError(
                    f"{sections.what}: less than two points of a side are between {between[0]} and {between[1]} of the "
                    f"chord at {sections.places[number]:.4g} m along the span; take fractions further apart"
                )
            distances = (1.0 - fractions[is_used]) * np.sqrt(size)
            weights = polynomial_weights(distances[None], 1, derivative=1)  # step 2
            rows.append(csr_array(csr_array(weights) @ cut.points.matrix(wing.n_points)[is_used]))
    return [csr_array(vstack(rows, format="csr")) for rows in found]


class _Edges(NamedTuple):
    """Edges of cells, each once and in ascending order."""

    nodes: np.ndarray  # int (n, 2)
    normals: np.ndarray  # (n, 3), sums of the unit normals of their cells
    has_kink: np.ndarray  # bool (n,), whether cells on both sides form a kink, or there is only one side
    is_of: dict[str, np.ndarray]  # bool (n,) each, whether a cell of the upper or lower side is at the edge


class _Cut(NamedTuple):
    """Points of a section, where its plane cuts edges."""

    points: EdgeCuts
    edges: np.ndarray  # int (n,), numbers of the edges


def _edges_of(sections: CellSections) -> _Edges:
    quads, (_, up, span) = sections.wing.quads, sections.frame.axes
    unit = area_vectors(sections.wing.points[quads])
    unit /= np.maximum(lengths(unit), np.finfo(float).tiny)[:, None]
    sides = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    is_side = sides[:, 0] != sides[:, 1]
    nodes, number = np.unique(sides[is_side], axis=0, return_inverse=True)
    cell, number = np.repeat(np.arange(len(quads)), 4)[is_side], number.ravel()
    normals = np.stack([np.bincount(number, column) for column in unit[cell].T], axis=1)
    has_kink = (np.bincount(number) != 2) | (dots(normals, normals) <= 2.0 + 2.0 * KINK)
    facing = unit @ up / np.maximum(lengths(unit - (unit @ span)[:, None] * span), np.finfo(float).tiny)
    is_of = {side: np.bincount(number, (sense * facing > FACING)[cell]) > 0.0 for side, sense in SIDES.items()}
    return _Edges(nodes, normals, has_kink, is_of)


def _cuts(sections: CellSections, edges: _Edges) -> Iterator[_Cut]:
    wing, n = sections.wing, sections.wing.n_points
    for cut in sections.cuts:
        heights = (wing.points - cut.origin) @ sections.frame.axes[2]
        points = cut_edges(edges.nodes, heights, FLAT * wing.size)
        yield _Cut(points, np.searchsorted(edges.nodes @ [n, 1], points.nodes @ [n, 1]))


def _end(sections: CellSections, edges: _Edges, cut: _Cut, side: str) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of the end of one side of a section."""
    along = cut.points.at(sections.wing.points) @ sections.frame.axes[0]
    is_of = edges.is_of[side][cut.edges]
    is_last = is_of & (along >= along[is_of].max(initial=-np.inf) - LEVEL * np.ptp(along))
    ends = np.flatnonzero(is_last & edges.has_kink[cut.edges])
    if not len(ends):
        x, y, z = cut.points.at(sections.wing.points)[np.argmax(along)]
        raise InputError(
            f"{sections.what}: the {side} side has no corner at the trailing edge near ({x:g}, {y:g}, {z:g}), as where "
            f"that is round; give between=(0.9, 0.98) for the angle of the wedge ahead of it, or leave the section out"
        )
    return cut.points.nodes[ends[0]], cut.points.weights[ends[0]]


def _in_planes(
    sections: CellSections,
    corners: SmoothCorners,
    nodes: np.ndarray,  # int (n,), one for each section
    sense: float,  # sign of the side's normals
    is_used: np.ndarray,  # bool (n,), whether a node has a weight
) -> csr_array:
    """Matrix of the unit tangents of one side at nodes, in the planes of sections, pointing upstream."""
    stream, up, span = sections.frame.axes
    order = np.argsort(corners.nodes, kind="stable")
    ends = np.searchsorted(corners.nodes[order], np.stack([nodes, nodes + 1], axis=1))
    heights = sense * corners.normals @ up
    places = np.array([here[np.argmax(heights[here])] for here in (order[slice(*each)] for each in ends)])
    (by_u, by_v, *_), is_found = jets(corners, places)
    if not (is_found | ~is_used).all():
        x, y, z = sections.wing.points[nodes[is_used & ~is_found][0]]
        raise InputError(
            f"{sections.what}: too few nodes on one side of the trailing edge near ({x:g}, {y:g}, {z:g}); take a finer "
            f"mesh, give between=(0.9, 0.98), or leave the section out"
        )
    u, v = by_u @ sections.wing.points, by_v @ sections.wing.points
    a, b = -v @ span, u @ span  # step 2
    tangents = a[:, None] * u + b[:, None] * v
    size = np.where(tangents @ stream > 0.0, -1.0, 1.0) * np.where(is_used, lengths(tangents), 1.0)
    return csr_array(diags_array(a / size) @ by_u + diags_array(b / size) @ by_v)
