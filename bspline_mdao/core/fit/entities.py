"""The corners, edges, faces and interiors of all segments in the order in which they are fitted, section II.D.

Every node and every control point belongs to exactly one entity. An entity that several segments share belongs to the
first of them. A section that coincides with an earlier one (an interface, a collapsed face) is not an entity.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...grids.topology.index_space import FACE_NAMES, Section, inner_slices, sections_of, whole_slices
from ...grids.topology.topology import Topology, shared_ids
from .fit_nodes import FitNodes

_KINDS = ("corner", "edge", "face", "interior")


@dataclass(frozen=True, eq=False)
class Entity:
    """A corner, edge, face or interior with the nodes and control points that it owns."""

    segment: int  # number of the segment
    section: Section  # ends at which it lies; None in its free directions
    rows: np.ndarray  # int (n,), numbers of its inner nodes, in C order; none if another process has the segment
    # ids of all control points of the section, including its boundary; ``M = 1`` in a direction that is not free
    control_ids: np.ndarray  # int (M0, M1, M2)
    unknown_ids: np.ndarray  # int (n_columns,), ids of the control points that it solves for
    # place in ``unknown_ids`` of each control point of the section; -1 if an earlier entity solves for it
    columns: np.ndarray  # int (M0 M1 M2,)

    @property
    def is_free(self) -> tuple[bool, ...]:
        """The directions in which it extends."""
        return tuple(end is None for end in self.section)

    @property
    def inner(self) -> tuple[slice, ...]:
        """Slices that cut its inner nodes out of the segment's arrays."""
        return inner_slices(self.section)

    def net(self, control_points: np.ndarray) -> np.ndarray:
        """Control points of its section, shape (M0 M1 M2, 3), out of all, shape (n_control_points, 3)."""
        return control_points[self.control_ids].reshape(-1, 3)

    @property
    def kind(self) -> str:
        """One of corner, edge, face and interior."""
        return _KINDS[sum(self.is_free)]

    def describe(self, names: Sequence[str]) -> str:
        """Readable name; ``names`` are the segments' names."""
        ends = [FACE_NAMES[2 * d + (end == -1)] for d, end in enumerate(self.section) if end is not None]
        return " ".join([names[self.segment], self.kind, *ends])


def entities_in_order(
    control_ids: Sequence[np.ndarray],  # of int, control point ids of every segment
    sharing: FitNodes,  # nodes of this process, and which of them coincide
    n_control_points: int,  # number of unique control points
) -> Iterator[Entity]:
    """Corners, then edges, faces and interiors of all segments, each without what belongs to earlier entities."""
    source, points = sharing.source_rows(), _sample_points(sharing.topology)
    is_solved, is_seen = np.zeros(n_control_points, dtype=bool), np.zeros(1 + max(map(np.max, points)), dtype=bool)
    for n_free in range(4):
        for segment, (ids, rows, sample) in enumerate(zip(control_ids, sharing.rows, points)):
            for section in sections_of(sample.shape, n_free):
                edge_ids, inner = ids[whole_slices(section)], sample[inner_slices(section)]
                if is_seen[inner].all() and is_solved[edge_ids].all():
                    continue
                unknown_ids, columns = _number_unknowns(edge_ids, is_solved)
                is_seen[inner] = True
                is_solved[unknown_ids] = True
                inner_rows = source[rows[inner_slices(section)].ravel()] if rows.size else rows.ravel()
                yield Entity(segment, section, inner_rows, edge_ids, unknown_ids, columns)


def _sample_points(topology: Topology) -> list[np.ndarray]:
    """Number points that represent the nodes of each section: up to three per direction, coincident ones alike."""
    # Links and collapses join whole sections, so one inner node represents all.
    shapes = [tuple(min(n, 3) for n in segment.shape) for segment in topology.segments]
    return shared_ids(shapes, topology.links, topology.collapses, topology.segment_names)


def _number_unknowns(control_ids: np.ndarray, is_solved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unknown control points, with the longest direction outermost for a narrow band of the Gram matrix."""
    axes = np.argsort([-n for n in control_ids.shape], kind="stable")
    places = np.arange(control_ids.size).reshape(control_ids.shape).transpose(axes).ravel()
    places = places[~is_solved[control_ids.ravel()[places]]]
    unique_ids, first, inverse = np.unique(control_ids.ravel()[places], return_index=True, return_inverse=True)
    sequence = np.argsort(first)
    rank = np.empty(len(sequence), dtype=np.int64)
    rank[sequence] = np.arange(len(sequence))
    columns = np.full(control_ids.size, -1, dtype=np.int64)
    columns[places] = rank[inverse]
    return unique_ids[sequence], columns
