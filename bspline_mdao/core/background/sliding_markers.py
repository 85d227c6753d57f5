"""Markers of a mesh whose nodes slide on surfaces that are not planes: casings, tunnels, outer faces.

Nodes of such a marker are asked to be at the closest point of their surface to where the lattice takes them, or, where
they are nodes of walls as well, to where these are asked to be. What follows walls follows them, too.

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
    """Surfaces of the markers that are to slide, by their names; `InputError` where nodes are on none."""
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
    planes: Sequence[EndPlane],  # planes that the mesh ends in
    at_rest: np.ndarray,  # int, nodes that stay
) -> SlidingNodes | None:
    """Nodes of these markers, but for those that stay, on their surfaces and in planes; None where there are none."""
    markers = mesh.markers or {}
    members = [np.setdiff1d(markers[name], at_rest) for name in slides]
    if not any(map(len, members)):
        return None
    flat = [Slide("plane", Plane(each.normal, float(mesh.points[each.rows[0]] @ each.normal))) for each in planes]
    rows = np.concatenate(members)
    ends = [np.intersect1d(each.rows, rows) for each in planes]
    return SlidingNodes.of_members([*slides.values(), *flat], [*members, *ends], mesh.points)


def with_sliding(mesh: MixedMesh, walls: WallFaces, slides: Mapping[str, Slide]) -> WallFaces:
    """Faces of walls, and those of markers that slide behind them."""
    markers = mesh.markers or {}
    return walls.followed_by({name: mesh.into_fluid(markers[name]) for name in slides})


@dataclass(frozen=True, eq=False)
class SlidingWalls(OneLine):
    """Where nodes that slide are asked to be, by nodes of walls and control points of the lattice."""

    nodes: SlidingNodes  # those that slide, by their rows among the nodes of the map
    at_rest: np.ndarray  # (n, 3), where they are on the baseline (m)
    evaluator: Evaluator | TurnedEvaluator  # A of those that are none of walls
    is_wall: np.ndarray  # bool (n,), whether they are nodes of walls
    of_wall: np.ndarray  # int, which of the nodes of walls these are
    walls_at: np.ndarray  # int (n_walls,), places of the nodes of walls among all that are asked for
    slides_at: np.ndarray  # int (n,), places of those that slide
    n_asked: int  # number of all that are asked for

    @classmethod
    def of(
        cls,
        nodes: SlidingNodes,  # those that slide
        wall_rows: np.ndarray,  # int, nodes of walls, ascending
        asked_rows: np.ndarray,  # int, nodes that are asked for, ascending: both of these, or more that stay
        points: np.ndarray,  # (n_points, 3), nodes on the baseline (m)
        lattice: BackgroundLattice,
        planes: Sequence[tuple[np.ndarray, int, int]],  # nodes of planes, the axis across each, and its end
    ) -> SlidingWalls:
        """Sort the nodes that slide."""
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
        """All that are asked for, (n_asked, 3), of nodes of walls and changes of control points of the lattice (m)."""
        # ``asked``, (n_asked, 3), are the places on the baseline, of those that neither are walls nor slide
        points = self.at_rest.copy()
        points[~self.is_wall] += self.evaluator.forward(change)
        points[self.is_wall] = walls[self.of_wall]
        closest, found = self.nodes.at(points), asked.copy()
        found[self.walls_at] = walls
        found[self.slides_at] = closest.points
        return found, closest

    def jvp(self, closest: SlidNodes, walls: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Change of all that are asked for with those of nodes of walls and control points."""
        moved = np.zeros_like(self.at_rest)
        moved[~self.is_wall] = self.evaluator.forward(change)
        moved[self.is_wall] = walls[self.of_wall]
        found = np.zeros((self.n_asked, 3))
        found[self.walls_at] = walls
        found[self.slides_at] = closest.jvp(moved)
        return found

    def vjp(self, closest: SlidNodes, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`: for the nodes of walls and for the control points."""
        others = bar.copy()
        others[self.slides_at] = 0.0
        walls, moved = others[self.walls_at], closest.vjp(bar[self.slides_at])
        walls[self.of_wall] += moved[self.is_wall]
        return walls, self.evaluator.adjoint(np.ascontiguousarray(moved[~self.is_wall]))
