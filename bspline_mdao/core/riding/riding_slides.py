"""Nodes of an embedded mesh on patches of the grid that slide on fixed surfaces.

Their positions are prescribed like wall nodes': at the points of their surfaces nearest to where the volumes put them,
at the same height as on the baseline. So their faces that are not on walls count as wall faces.

Theory: ``docs/theory/ride.rst``, ``docs/theory/sliding.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.topology.sharing import boundary_sides
from ...grids.topology.topology import Topology
from ..sliding.fixed_surface import Plane
from ..sliding.sliding_nodes import Slide, SlidingNodes
from .wall_faces import GridBoundary, WallFaces, markers_mostly

__all__ = ["RidingSlides"]

ON_PLANE = 1e-9
"""A sliding node nearer to a plane than this fraction of the size of the mesh slides in it as well."""


@dataclass(frozen=True, eq=False)
class RidingSlides(OneLine):
    """Sliding nodes among the nodes with prescribed positions."""

    slides: tuple[Slide, ...]  # their surfaces
    nodes: SlidingNodes  # by their rows in the mesh; ``places`` are positions among the nodes of all faces
    is_given: np.ndarray  # bool (n_wall,), which of these are on walls, so that they may be given; others only slide

    @classmethod
    def of(
        cls,
        mesh: MixedMesh,
        slides: Sequence[Slide],  # of the grid, see `bspline_mdao.core.mesh.moving_mesh.MovingMesh`
        topology: Topology,  # of the grid
        boundary: GridBoundary,  # of the grid
        walls: WallFaces,
        fixed: np.ndarray,  # int, nodes that stay
    ) -> tuple[RidingSlides | None, WallFaces]:
        """Find them, and the wall faces followed by sliding faces on no wall; None if no nodes slide."""
        patches = [str(face.patch) for face, *_ in boundary_sides(topology)]
        found, members, more = [], [], {}
        for slide in slides:
            if isinstance(slide.surface, Plane):
                continue
            faces = _faces_on(mesh, boundary, patches[slide.sides[0]])
            rows = np.setdiff1d(faces, fixed)
            if len(rows):
                found.append(slide)
                members.append(rows)
                more[slide.what] = faces[~_are_among(faces, walls.faces)]
        if not found:
            return None, walls
        rows, near = np.unique(np.concatenate(members)), ON_PLANE * np.linalg.norm(np.ptp(mesh.points, axis=0))
        planes = [slide for slide in slides if isinstance(slide.surface, Plane)]
        ends = [rows[plane.surface.distances(mesh.points[rows]) <= near] for plane in planes]
        nodes = SlidingNodes.of_members([*found, *planes], [*members, *ends], mesh.points)
        both = walls.followed_by(more)
        asked = np.unique(both.faces)
        return cls(tuple(found), nodes.among(asked), np.isin(asked, walls.faces)), both


def _are_among(faces: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Whether faces, (n, 4), are among others, (m, 4), in any orientation."""
    _, which = np.unique(np.sort(np.concatenate([others, faces]), axis=1), axis=0, return_inverse=True)
    which = which.ravel()
    return np.isin(which[len(others) :], which[: len(others)])


def _faces_on(mesh: MixedMesh, boundary: GridBoundary, patch: str) -> np.ndarray:
    """Faces of a mesh on a patch of the grid, (n, 4): whole markers, or single faces if there are no markers."""
    if not mesh.markers:
        skin = mesh.skin
        return skin[boundary.on_patch(mesh.points[skin], patch)][:, ::-1]
    names = markers_mostly(mesh, lambda x: boundary.on_patch(x, patch))
    return np.concatenate([np.zeros((0, 4), dtype=int), *(mesh.into_fluid(mesh.markers[name]) for name in names)])
