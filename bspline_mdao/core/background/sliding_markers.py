"""Markers of a mesh whose nodes slide on curved surfaces: casings, tunnels, outer faces.

Nodes of such a marker move to the point of their surface closest to their position in the lattice, or, for nodes that
are also on walls, to their prescribed position. What follows walls follows them, too.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...base.numerics.mean_planes import near_enough
from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ..evaluation.evaluator import Evaluator
from ..evaluation.turned_evaluator import TurnedEvaluator
from ..riding.wall_faces import WallFaces
from ..sliding.fixed_surface import Plane
from ..sliding.recognition import recognised_surface
from ..sliding.sliding_nodes import Slide, SlidingNodes, SlidNodes
from .background_lattice import BackgroundLattice
from .end_planes import SLIDING, EndPlane

__all__ = ["SlidingWalls", "markers_that_slide", "nodes_that_slide", "with_sliding"]


def markers_that_slide(mesh: MixedMesh, kinds: Mapping[str, str]) -> dict[str, Slide]:
    """Surfaces of the sliding markers by name; `InputError` if nodes are on none."""
    found = {}
    for name, faces in (mesh.markers or {}).items():
        if kinds.get(name) != SLIDING or not len(faces):
            continue
        quads = mesh.points[faces]
        corners = np.stack([np.stack([quads[:, 0], quads[:, 3]]), np.stack([quads[:, 1], quads[:, 2]])])
        what, near = f"{mesh.source}: marker '{name}'", near_enough([mesh.points[np.unique(faces)]])
        try:
            found[name] = Slide(f"marker '{name}'", recognised_surface([corners], near, what))
        except InputError as error:
            complaint = str(error).partition("; give its surface")[0]
            raise InputError(f"{complaint}; give the marker another kind") from None
    return found


def nodes_that_slide(
    mesh: MixedMesh,
    slides: Mapping[str, Slide],  # by names of markers
    planes: Sequence[EndPlane],  # end planes of the mesh
    at_rest: np.ndarray,  # int, nodes that stay
) -> SlidingNodes | None:
    """Nodes of these markers, except fixed ones, on their surfaces and in planes; None if there are none."""
    markers = mesh.markers or {}
    members = [np.setdiff1d(markers[name], at_rest) for name in slides]
    if not any(map(len, members)):
        return None
    flat = [Slide("plane", Plane(each.normal, float(mesh.points[each.rows[0]] @ each.normal))) for each in planes]
    rows = np.concatenate(members)
    ends = [np.intersect1d(each.rows, rows) for each in planes]
    return SlidingNodes.of_members([*slides.values(), *flat], [*members, *ends], mesh.points)


def with_sliding(mesh: MixedMesh, walls: WallFaces, slides: Mapping[str, Slide]) -> WallFaces:
    """Faces of walls, followed by faces of sliding markers."""
    markers = mesh.markers or {}
    return walls.followed_by({name: mesh.into_fluid(markers[name]) for name in slides})


@dataclass(frozen=True, eq=False)
class SlidingWalls(OneLine):
    """Positions of sliding nodes, from wall nodes and control points of the lattice."""

    nodes: SlidingNodes  # sliding nodes, by their rows among the nodes of the map
    at_rest: np.ndarray  # (n, 3), where they are on the baseline (m)
    evaluator: Evaluator | TurnedEvaluator  # A of the ones not on walls
    is_wall: np.ndarray  # bool (n,), whether they are on walls
    of_wall: np.ndarray  # int, their positions among wall nodes
    walls_at: np.ndarray  # int (n_walls,), positions of wall nodes among all prescribed nodes
    slides_at: np.ndarray  # int (n,), positions of sliding nodes
    n_asked: int  # number of prescribed nodes

    @classmethod
    def of(
        cls,
        nodes: SlidingNodes,  # sliding nodes
        wall_rows: np.ndarray,  # int, nodes of walls, ascending
        asked_rows: np.ndarray,  # int, prescribed nodes, ascending: both of these, and possibly fixed ones
        points: np.ndarray,  # (n_points, 3), nodes on the baseline (m)
        lattice: BackgroundLattice,
        planes: Sequence[tuple[np.ndarray, int, int]],  # nodes of planes, the axis across each, and its end
    ) -> SlidingWalls:
        """Sort the sliding nodes."""
        rows = nodes.rows
        is_wall = np.isin(rows, wall_rows)
        free = rows[~is_wall]
        sides = [(np.flatnonzero(np.isin(free, ids)), axis, end) for ids, axis, end in planes]
        return cls(
            nodes,
            points[rows],
            lattice.evaluator(points[free], sides),
            is_wall,
            np.searchsorted(wall_rows, rows[is_wall]),
            np.searchsorted(asked_rows, wall_rows),
            np.searchsorted(asked_rows, rows),
            len(asked_rows),
        )

    def at(self, walls: np.ndarray, change: np.ndarray, asked: np.ndarray) -> tuple[np.ndarray, SlidNodes]:
        """All prescribed nodes (m), (n_asked, 3), from wall nodes and changes of control points of the lattice."""
        # ``asked``, (n_asked, 3), are the baseline positions, used for nodes that are neither on walls nor slide
        points = self.at_rest.copy()
        points[~self.is_wall] += self.evaluator.forward(change)
        points[self.is_wall] = walls[self.of_wall]
        closest, found = self.nodes.at(points), asked.copy()
        found[self.walls_at] = walls
        found[self.slides_at] = closest.points
        return found, closest

    def jvp(self, closest: SlidNodes, walls: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Change of all prescribed nodes from changes of wall nodes and control points."""
        moved = np.zeros_like(self.at_rest)
        moved[~self.is_wall] = self.evaluator.forward(change)
        moved[self.is_wall] = walls[self.of_wall]
        found = np.zeros((self.n_asked, 3))
        found[self.walls_at] = walls
        found[self.slides_at] = closest.jvp(moved)
        return found

    def vjp(self, closest: SlidNodes, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`, for wall nodes and control points."""
        others = bar.copy()
        others[self.slides_at] = 0.0
        walls, moved = others[self.walls_at], closest.vjp(bar[self.slides_at])
        walls[self.of_wall] += moved[self.is_wall]
        return walls, self.evaluator.adjoint(np.ascontiguousarray(moved[~self.is_wall]))
