"""Length of the residual of a fit around every corner of the spans, where knots meet.

These lengths are the distances over which rotations of the residual may not change, see `.rotation_filter`. They are
found once, when a grid is fitted, and belong to the model: one of several processes knows the residual only of some
nodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...base.numerics.processes import ONE
from ...grids.topology.topology import Topology, shared_ids
from ..splines.basis import basis
from ..splines.greville import span_breaks, span_corners
from ..splines.mesh import BSplineMesh
from ..splines.volume import Volume

__all__ = ["corner_numbers", "residual_lengths"]


def corner_numbers(topology: Topology, mesh: BSplineMesh) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Number the corners of the spans of all volumes, shared ones once."""
    # Returns places: list of ndarray, each of shape (M0, M1, M2, 3), parameters of the corners of every volume;
    # numbers: list of ndarray, each of shape (M0, M1, M2), their numbers.
    places = [span_corners(volume) for volume in mesh.volumes]
    shapes = [x.shape[:3] for x in places]
    return places, shared_ids(shapes, topology.links, topology.collapses, topology.segment_names)


def residual_lengths(
    topology: Topology,  # segments and links
    mesh: BSplineMesh,  # one volume per segment
    # each (L0, L1, L2, 3), parameters of the nodes of the segments
    parameters: Sequence[np.ndarray] | Mapping[int, np.ndarray],
    # each (n_nodes_of_block, 3), residual of the nodes of the blocks of this process (m)
    residuals: Mapping[int, np.ndarray],
    comm: Any = ONE,  # the processes, all of which call this
) -> np.ndarray:  # (n_corners,), on all processes (m)
    """Largest residual of the nodes in the spans around every corner."""
    numbers = corner_numbers(topology, mesh)[1]
    lengths = np.zeros(1 + max(int(ids.max()) for ids in numbers))
    for segment, (window, volume, ids) in enumerate(zip(topology.segments, mesh.volumes, numbers)):
        if window.block in residuals:
            residual = residuals[window.block].reshape(*topology.shapes[window.block], 3)[window.slices]
            size = np.linalg.norm(residual.reshape(-1, 3), axis=1)
            np.maximum.at(lengths, ids, _largest_at_corners(volume, parameters[segment].reshape(-1, 3), size))
    return lengths if comm.size == 1 else np.max(comm.allgather(lengths), axis=0)


def _largest_at_corners(volume: Volume, parameters: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Largest value of the nodes, shape (n,), in the spans around each corner, shape (M0, M1, M2)."""
    breaks = [span_breaks(knots) for knots in volume.knots]
    spans = []
    for d, knots in enumerate(volume.knots):
        found, _ = basis(knots, *(parameters[:, (d + offset) % 3] for offset in range(3)))
        spans.append(np.searchsorted(breaks[d], found))
    shape = tuple(len(b) - 1 for b in breaks)
    largest = np.zeros(shape)
    np.maximum.at(largest, tuple(spans), values)
    corners = np.zeros(tuple(n + 1 for n in shape))
    for ends in np.ndindex(2, 2, 2):
        part = corners[tuple(slice(end, end + n) for end, n in zip(ends, shape))]
        np.maximum(part, largest, out=part)
    return corners
