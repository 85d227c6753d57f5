"""Heights of the first nodes above walls of unstructured meshes.

Theory: ``docs/theory/quality.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .mixed_cells import MixedMesh
from .node_heights import NodeHeights
from .wall_spacing import WallSpacing

__all__ = ["LEVELS", "height_quantiles", "mesh_wall_spacings"]

LEVELS = {"min": 0.0, "p01": 0.01, "median": 0.5, "p99": 0.99, "max": 1.0}
"""Quantiles by name."""


def mesh_wall_spacings(mesh: MixedMesh, walls: Sequence[str]) -> tuple[WallSpacing, ...]:
    """Measure the spacings at the wall markers of a mesh; the growth is missing, as it needs layers."""
    found = []
    for name in walls:
        faces = (mesh.markers or {})[name]
        first = NodeHeights.of(mesh, mesh.into_fluid(faces))
        heights, rows = first.baseline, first.rows
        if not len(heights):
            continue
        aspect = _longest_edges(mesh, faces)[rows] / heights
        found.append(
            WallSpacing(
                patch=name,
                n_nodes=len(mesh.stored_ids(rows)),
                height_min=float(heights.min()),
                height_median=float(np.median(heights)),
                height_max=float(heights.max()),
                growth_median=np.nan,
                growth_max=np.nan,
                aspect_median=float(np.median(aspect)),
                aspect_max=float(aspect.max()),
                extents=tuple(np.sort(np.ptp(mesh.points[np.unique(faces)], axis=0)).tolist()),
            )
        )
    return tuple(found)


def height_quantiles(heights: np.ndarray) -> dict[str, float]:
    """Quantiles of heights, see `LEVELS`; empty if there are none."""
    return {name: float(np.quantile(heights, level)) for name, level in LEVELS.items()} if len(heights) else {}


def _longest_edges(mesh: MixedMesh, faces: np.ndarray) -> np.ndarray:
    """Longest edge of faces at every node of a mesh (m), shape (n,), except for edges across a layer of cells."""
    starts, ends = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    lengths = np.linalg.norm(mesh.points[ends] - mesh.points[starts], axis=1)
    if mesh.n_copies == 2:
        lengths[(starts < mesh.n_stored) != (ends < mesh.n_stored)] = 0.0
    longest = np.zeros(mesh.n_points)
    np.maximum.at(longest, starts, lengths)
    np.maximum.at(longest, ends, lengths)
    return longest
