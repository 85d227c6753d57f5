"""The map from wall nodes and the control points of a lattice to the nodes of a mesh.

Both are the control points of the mesh: first its wall nodes, which are matched exactly, then the control points of the
lattice, which moves everything else. What follows walls, and how, is the same as for embedded meshes
(`..riding.riding_mesh`).

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...names import CONTROL_POINTS
from ..evaluation.node_map import require_inputs
from ..riding.riding_mesh import WALL, EmbeddedMesh, EmbeddedMeshState
from ..sliding.sliding_nodes import SlidNodes
from ..walls.wall_images import WallImages
from .node_copies import TiedNodes
from .sliding_markers import SlidingWalls

__all__ = ["MeshMap", "MeshState"]


@dataclass(frozen=True, eq=False)
class MeshMap(OneLine):
    """A mesh as a function of its control points."""

    embedded: EmbeddedMesh  # its nodes, moved by the lattice and the walls
    n_walls: int  # number of wall nodes, the first control points
    tied: TiedNodes  # nodes of `embedded` on periodic sides
    # int, positions of this process's nodes among the nodes of `embedded`, which also include wall nodes; None if it
    # has all
    places: np.ndarray | None = None
    images: WallImages | None = None  # walls beyond periodic sides, from the wall nodes of which they are images
    sliding: SlidingWalls | None = None  # nodes that slide on surfaces, with prescribed positions like wall nodes

    inputs = (CONTROL_POINTS,)

    @property
    def n_asked(self) -> int:
        """Number of nodes of this process."""
        return self.embedded.n_points if self.places is None else len(self.places)

    @property
    def nodes(self) -> np.ndarray:
        """Nodes of the baseline (m), shape (n, 3)."""
        return self.taken(self.embedded.mesh.points)

    def taken(self, of_embedded: np.ndarray) -> np.ndarray:
        """Vectors of this process's nodes, shape (n_asked, 3), from the vectors of `embedded`."""
        return of_embedded if self.places is None else of_embedded[self.places]

    def spread(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `taken`."""
        if self.places is None:
            return bar
        whole = np.zeros((self.embedded.n_points, 3))
        np.add.at(whole, self.places, bar)
        return whole

    def at(self, control_points: np.ndarray) -> MeshState:
        """Nodes at control points, shape (n_control_points, 3), in metres, with their derivative."""
        walls, lattice = control_points[: self.n_walls], control_points[self.n_walls :]
        assert self.embedded.walls is not None
        at_rest, closest = self.embedded.walls.initial[: self.n_given], None
        if self.sliding is not None:
            walls, closest = self.sliding.at(walls, lattice - self.embedded.control_points, at_rest)
        if self.images is not None:
            walls = self.images.beyond(walls, at_rest)
        state = self.embedded.at(lattice, walls)
        rows = self.tied.rows
        if len(rows):
            before = self.embedded.mesh.points
            state.nodes[rows] = before[rows] + self.alike(state.nodes - before)[rows]
        return MeshState(self, state, closest)

    @property
    def n_given(self) -> int:
        """Number of nodes with prescribed positions: wall nodes and sliding nodes."""
        return self.n_walls if self.sliding is None else self.sliding.n_asked

    def alike(self, change: np.ndarray) -> np.ndarray:
        """Average the changes of `embedded`'s nodes, shape (n, 3), over copies, in place."""
        # The lattice moves copies equally; what fades around walls on only one side, and what follows them, does not.
        return self.tied.alike(change)

    def with_images(self, change: np.ndarray) -> np.ndarray:
        """Changes of the prescribed nodes, shape (n_given, 3), followed by the changes of their images."""
        return change if self.images is None else self.images.changes(change)

    def with_images_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `with_images`."""
        return bar if self.images is None else self.images.changes_vjp(bar)

    def padded(self, bar: np.ndarray) -> np.ndarray:
        """Pad derivatives with respect to this process's nodes to all nodes; here its nodes are all."""
        return bar


@dataclass(frozen=True, eq=False)
class MeshState:
    """Nodes of a mesh, and their derivative."""

    of: MeshMap
    embedded_state: EmbeddedMeshState
    closest: SlidNodes | None = None  # prescribed positions of sliding nodes

    @property
    def nodes(self) -> np.ndarray:
        """The nodes (m), shape (n, 3)."""
        return self.of.taken(self.embedded_state.nodes)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self.of.inputs

    def jvp(self, control_points: np.ndarray | None = None) -> np.ndarray:
        """Change of the nodes from a change of the control points, shape (n_control_points, 3)."""
        if control_points is None:
            return np.zeros_like(self.nodes)
        of, walls, lattice = self.of, control_points[: self.of.n_walls], control_points[self.of.n_walls :]
        if of.sliding is not None and self.closest is not None:
            walls = of.sliding.jvp(self.closest, walls, lattice)
        change = self.embedded_state.jvp(lattice, of.with_images(walls))
        return of.taken(of.alike(change))

    def vjp(self, bar: np.ndarray, wrt: Collection[str] | None = None) -> dict[str, np.ndarray]:
        """Transpose of `jvp`."""
        bars, bar = {}, self.of.alike(self.of.spread(np.array(bar, dtype=float)))
        for name in require_inputs(wrt, self.inputs):
            found, of = self.embedded_state.vjp(bar), self.of
            walls, lattice = of.with_images_vjp(found[WALL]), found[CONTROL_POINTS]
            if of.sliding is not None and self.closest is not None:
                walls, moved = of.sliding.vjp(self.closest, walls)
                lattice = lattice + moved
            bars[name] = np.concatenate([walls, lattice])
        return bars
