"""Markers for meshes without any: planar sides of the mesh, and the connected parts of the rest of its boundary.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .mixed_cells import MixedMesh

__all__ = ["with_markers"]

AT_END = 1e-6
"""Distance of the nodes of a planar side from its box, relative to the size of a mesh: rounding of single precision."""


def with_markers(mesh: MixedMesh) -> MixedMesh:
    """Add markers to a mesh without any, such as from a VTK file.

    Parameters
    ----------
    mesh : MixedMesh
        The mesh.

    Returns
    -------
    MixedMesh
        The mesh itself if it has markers. Otherwise the mesh with markers ``x_min``, ``x_max`` and so on for the
        boundary faces in the sides of its box, and ``part_1`` and so on for the connected parts of the other faces, the
        largest first.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.meshes import MixedMesh, with_markers
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> list(with_markers(MixedMesh(corners, {"tetra": np.array([[0, 1, 2, 3]])})).markers)
    ['x_min', 'y_min', 'z_min', 'part_1']
    """
    if mesh.markers:
        return mesh
    skin = mesh.skin
    points, axes = mesh.points[: mesh.n_stored], [0, 1, 2]
    if mesh.n_copies == 2:
        is_upper = skin >= mesh.n_stored
        skin = skin[is_upper.any(axis=1) & ~is_upper.all(axis=1)]
        axes = [k for k in range(3) if np.ptp(points[:, k]) > 0.0]
    if not len(skin):
        return mesh
    low, high = points.min(axis=0), points.max(axis=0)
    near = AT_END * float(np.linalg.norm(high - low))
    found: dict[str, np.ndarray] = {}
    is_left = np.ones(len(skin), dtype=bool)
    for axis in axes:
        for name, end in (("min", low[axis]), ("max", high[axis])):
            is_in = is_left & (np.abs(mesh.points[skin][:, :, axis] - end) <= near).all(axis=1)
            if is_in.any():
                found[f"{'xyz'[axis]}_{name}"] = skin[is_in]
                is_left &= ~is_in
    rest = skin[is_left]
    if len(rest):
        starts, ends = rest.ravel(), np.roll(rest, -1, axis=1).ravel()
        graph = coo_matrix((np.ones(len(starts)), (starts, ends)), (mesh.n_points, mesh.n_points))
        part = connected_components(graph, directed=False)[1][rest[:, 0]]
        numbers, counts = np.unique(part, return_counts=True)
        for k, number in enumerate(numbers[np.argsort(-counts, kind="stable")].tolist(), start=1):
            found[f"part_{k}"] = rest[part == number]
    return replace(mesh, markers=found)
