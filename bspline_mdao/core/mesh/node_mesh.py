"""Nodes of walls of a fitted grid as the mesh that variables move, instead of its control points.

Where a wing meets a body, control points do not lie on either: a node that is to stay on the body has to be moved
itself. The control points then follow the nodes (`bspline_mdao.core.fit.surface_fit`), and the grid meets them.

Theory: ``docs/theory/free_form.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...errors import InputError
from ..model.model import Model
from .moving_mesh import MovingMesh
from .surface import SurfaceGrid

__all__ = ["node_mesh", "part_of_nodes"]


def node_mesh(model: Model, surface: SurfaceGrid) -> MovingMesh:
    """Nodes of a surface of a grid as the design surface of a mesh without elements."""
    # `InputError` if the grid has periodic faces, whose nodes would have to move alike
    if model.topology.periodic:
        raise InputError(f"{model.source}: nodes of periodic faces do not move alike one by one; take control points")
    planes = surface.on_planes(model)
    rows = [numbers for numbers, _ in planes]
    normals = [np.tile(normal, (len(numbers), 1)) for numbers, normal in planes]
    return MovingMesh(
        blocks=(),
        names=(),
        points=surface.points,
        surface_ids=np.arange(surface.n_points, dtype=np.int32),
        is_free=np.zeros((surface.n_points, 3), dtype=bool),
        in_plane_rows=np.concatenate([np.zeros(0, dtype=int), *rows]),
        in_plane_normals=np.concatenate([np.zeros((0, 3)), *normals]),
        surface_faces=surface.quads,
        markers=tuple(_places(surface)),
    )


def part_of_nodes(mesh: MovingMesh, surface: SurfaceGrid, patches: str | Sequence[str]) -> MovingMesh:
    """The same mesh with some of its patches as the design surface."""
    faces = np.concatenate([surface.parts[number] for number in surface.part(patches)])
    ids = np.unique(faces).astype(np.int32)
    rows = np.full(mesh.n_points, -1)
    rows[ids] = np.arange(len(ids))
    kept = rows[mesh.in_plane_rows] >= 0
    return replace(
        mesh,
        surface_ids=ids,
        in_plane_rows=rows[mesh.in_plane_rows[kept]],
        in_plane_normals=mesh.in_plane_normals[kept],
        surface_faces=rows[faces],
    )


def _places(surface: SurfaceGrid) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Nodes of each patch, for messages: its name, the nodes, and their numbers in the grid, from 1."""
    found: dict[str, list[np.ndarray]] = {}
    for patch, quads in zip(surface.patches, surface.parts):
        found.setdefault(patch, []).append(quads.ravel())
    ids = {patch: np.unique(np.concatenate(parts)) for patch, parts in found.items()}
    return [(patch, numbers, surface.rows[numbers] + 1) for patch, numbers in ids.items()]
