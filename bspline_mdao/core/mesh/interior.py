"""Directions in which control points may move while the surface, and the rest of the boundary, stays.

Points of symmetry planes slide in them, and so do points of planar patches on request. All others of the boundary are
fixed: walls, far field, undeclared faces, and edges where patches meet. Points on collapsed lines and faces are fixed
too. A point of an interface is one point of all its blocks and moves with them.

Theory: ``docs/theory/adaptation.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...base.numerics.vectors import nearest_plane
from ...grids.topology.index_space import section_rows
from ...grids.topology.periodic import find_periodic
from ...grids.topology.periodic_pair import PeriodicPair
from ..model.fitted_model import FittedModel
from .allowed_directions import AllowedDirections, required_planes
from .boundary import boundary_points, matching_patches

__all__ = ["fixed_periodic_planes", "interior_directions"]


def interior_directions(
    model: FittedModel,  # the fitted grid
    # planar patches, by name or pattern, whose points slide in their planes, in addition to kind ``symmetry``
    sliding: str | Sequence[str] = (),
) -> np.ndarray:
    """Directions in which each control point may move."""
    # Returns (n_control_points, 3, 3), orthogonal projectors onto these directions: the identity if a point is free,
    # zero if it is fixed.
    topology, points, blocks = model.topology, model.control_points, model.mesh.control_ids
    asked = matching_patches(topology, sliding)
    allowed = AllowedDirections.of(len(points))
    faces = list(boundary_points(topology, blocks))
    asked_for = [(face, ids) for face, ids in faces if face.patch in asked]
    symmetry = [(face, ids) for face, ids in faces if face.patch not in asked and face.kind == "symmetry"]
    for part, reason in ((asked_for, ("is to slide", "leave it out")), (symmetry, ())):
        whats = [f"{topology.source}: patch {face.patch}" for face, _ in part]
        for (_, ids), plane in zip(part, required_planes([points[ids] for _, ids in part], whats, *reason)):
            allowed.keep_in_plane(ids, plane.normal)
    for face, ids in faces:
        if face.patch not in asked and face.kind != "symmetry":
            allowed.fix(ids)
    for collapse in topology.collapses:
        ids = blocks[collapse.segment]
        allowed.fix(ids.ravel()[section_rows(ids.shape, collapse.section, 0).ravel()])
    projectors = np.eye(3) - np.einsum("nki,nkj->nij", allowed.basis, allowed.basis)
    projectors[allowed.fixed] = 0.0
    return projectors


def fixed_periodic_planes(
    model: FittedModel,  # the fitted grid
    sliding: str | Sequence[str] = (),  # patches that slide already, by name or pattern
) -> tuple[PeriodicPair, ...]:
    """Find the periodic planes whose points are fixed but could slide."""
    # Returns planar boundaries of kind ``other`` or of no kind that a rotation maps onto each other.
    asked, grid = matching_patches(model.topology, sliding), model.regenerate()
    windows = []
    for face in model.topology.boundary:
        _, distances, tolerance = nearest_plane(grid.blocks[face.window.block].nodes[face.window.slices].reshape(-1, 3))
        if face.kind in (None, "other") and face.patch not in asked and distances.max() <= tolerance:
            windows.append(face.window)
    return find_periodic(grid, windows)
