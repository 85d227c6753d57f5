"""The parts of a flow that do not change with the shape of the grid: faces, stencils, preconditioner pattern, axes.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...base.checks import as_axes
from ...base.numerics.halo import ALONE, Halo
from ...base.numerics.processes import ONE, largest, summed_number, together
from ...grids.cells import quads
from ...grids.cells.cell_faces import CellFaces
from ...grids.cells.subdomain_faces import faces_of_subdomain
from ...grids.topology.partition import Partition
from ...grids.topology.topology import Topology
from .factor_pattern import FactorPattern, factor_pattern
from .far_field import FarVortex
from .irregular_faces import IrregularFaces
from .linearization import Linearization
from .mean_weights import mean_jvp, mean_vjp
from .residual import Discretization
from .walls import Walls

__all__ = ["FlowGrid"]


_FLAT = 1e-9
"""Height of a face, relative to the size of the grid, below which it is collapsed."""


@dataclass(frozen=True, eq=False)
class FlowGrid:
    """Faces and stencils, the pattern of the preconditioner, and the axes of the flow."""

    discretization: Discretization  # on the baseline, see `at`
    axes: np.ndarray  # (3, 3), rows are the directions downstream, along the span, and up
    walls: Walls  # walls of all processes
    irregular_faces: IrregularFaces  # faces with weights of their own
    face_sizes: np.ndarray  # (n_faces,), areas of the faces of the baseline (m^2)
    corners: Halo = ALONE  # exchange of nodes with other processes; all arrays of nodes are local to this process

    @classmethod
    def of(
        cls,
        topology: Topology,  # connections of its blocks, with declared patches
        nodes: np.ndarray,  # (n_nodes, 3), baseline nodes (m), of the subdomain of this process
        axes: str = "xzy",  # axes of the grid that point downstream, along the span, and up
        *,
        partition: Partition | None = None,  # ownership of cells, if there are several processes
        comm: Any = ONE,  # the processes
        **settings: Any,  # of the `Discretization`
    ) -> FlowGrid:
        """Find the faces, stencils and preconditioner pattern of a grid."""
        if comm.size == 1:
            discretization, corners = Discretization.of(CellFaces.of(topology, nodes), **settings), ALONE
            walls = Walls.of(discretization.faces)
        else:
            partition = partition or Partition.of(topology, comm.size)
            faces, cells, corners = faces_of_subdomain(topology, partition, comm, nodes)
            discretization = Discretization.of(faces, **settings, halo=cells)
            walls = Walls.of_subdomain(faces, partition, corners)
        directions, seen = as_axes(axes, "flow"), corners.extend(nodes)
        faces, stencil, halo = discretization.faces, discretization.stencil, discretization.halo
        vortex = FarVortex.of(faces, stencil, seen, directions, halo)
        irregular_faces = IrregularFaces.of(stencil, faces, seen, halo)
        discretization = replace(discretization, stencil=irregular_faces.stencil(seen), vortex=vortex)
        face_sizes = np.linalg.norm(area_vectors(seen, faces.corners), axis=1).astype(np.float32)
        return cls(discretization, directions, walls, irregular_faces, face_sizes, corners)

    def at(self, nodes: np.ndarray) -> Discretization:
        """Discretisation with the weights of other nodes, shape (n_nodes, 3), in metres; real or complex."""
        if not self.irregular_faces.n_of_grid:
            return self.discretization
        return replace(self.discretization, stencil=self.irregular_faces.stencil(self.corners.extend(nodes)))

    @cached_property
    def pattern(self) -> FactorPattern:
        """Pattern of the preconditioner, found when a flow is first solved."""
        return factor_pattern(self.discretization, self.face_sizes)

    def __repr__(self) -> str:
        return f"<flow grid of {self.faces.n_cells} cells>"

    @property
    def comm(self) -> Any:
        """The processes."""
        return self.corners.comm

    @property
    def faces(self) -> CellFaces:
        """Cells and faces of the grid."""
        return self.discretization.faces

    def least_height(self, nodes: np.ndarray) -> float:
        """Height (m) of the flattest face, its area divided by its longest edge; collapsed faces do not count."""
        corners = self.corners.extend(nodes)[self.faces.corners]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)
        heights = np.linalg.norm(self.areas(nodes), axis=1) / np.maximum(edges, np.finfo(float).tiny)
        least = heights.min(where=heights > _FLAT * self.extent(nodes), initial=np.inf)
        return -largest(self.comm, -least)

    @property
    def n_cells_of_grid(self) -> int:
        """Number of the cells of all processes."""
        return int(summed_number(self.comm, self.faces.n_cells))

    def extent(self, nodes: np.ndarray) -> float:
        """Length (m) of the longest side of the bounding box of all nodes."""
        ends = np.stack([nodes, -nodes]).max(axis=1, initial=-np.inf)
        if self.comm.size > 1:
            ends = np.max(self.comm.allgather(ends), axis=0)
        return float(ends.sum(axis=0).max())

    def require_volumes(self, nodes: np.ndarray) -> None:
        """Refuse cells with negative volumes."""
        seen = self.corners.extend(nodes)
        with together(self.comm):
            self.faces.require_volumes(seen)

    def areas(self, nodes: np.ndarray) -> np.ndarray:
        """Area vectors (m^2), shape (n_faces, 3), of nodes, shape (n_nodes, 3)."""
        return area_vectors(self.corners.extend(nodes), self.faces.corners)

    def areas_jvp(self, nodes: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
        """Change of the area vectors with the nodes."""
        seen = self.corners.extend(nodes), self.faces.corners, self.corners.extend(d_nodes)
        return area_vectors_jvp(*seen)

    def areas_vjp(self, nodes: np.ndarray, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `areas_jvp`."""
        return self.corners.fold(area_vectors_vjp(self.corners.extend(nodes), self.faces.corners, bar))

    def nodes_jvp(
        self,
        nodes: np.ndarray,  # (n_nodes, 3), point of differentiation (m)
        tangent: Linearization,  # the linearization of `at` there
        d_nodes: np.ndarray,  # (n_nodes, 3), the direction (m)
    ) -> np.ndarray:
        """Change of the residual, shape (n_cells, 5), with the nodes, shape (n_nodes, 3)."""
        change = tangent.area_jvp(self.areas_jvp(nodes, d_nodes))
        if self.irregular_faces.n_of_grid:
            d_weights = self.irregular_faces.changes_jvp(self.corners.extend(nodes), self.corners.extend(d_nodes))
            change += mean_jvp(tangent, self.irregular_faces.ids, d_weights)
        return change

    def nodes_vjp(self, nodes: np.ndarray, tangent: Linearization, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `nodes_jvp`: from rows of the residual, (n_cells, 5), to nodes, (n_nodes, 3)."""
        change = self.areas_vjp(nodes, tangent.area_vjp(bar))
        if self.irregular_faces.n_of_grid:
            weights_bar = mean_vjp(tangent, self.irregular_faces.ids, bar)
            change += self.corners.fold(self.irregular_faces.changes_vjp(self.corners.extend(nodes), weights_bar))
        return change


def area_vectors(nodes: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Area vectors (m^2), shape (n_faces, 3), from the nodes, shape (n_nodes, 3), at corners, shape (n_faces, 4)."""
    # Half the cross product of the diagonals: the contributions of the boundary edges of neighbouring faces cancel for
    # any nodes, so the area vectors of a cell sum to zero and uniform flow is a solution on any grid.
    return quads.area_vectors(nodes[corners])


def area_vectors_jvp(nodes: np.ndarray, corners: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
    """Change of the area vectors with the nodes."""
    return quads.area_vectors_jvp(nodes[corners], d_nodes[corners])


def area_vectors_vjp(nodes: np.ndarray, corners: np.ndarray, bar: np.ndarray) -> np.ndarray:
    """Transposed product of `area_vectors_jvp`, shape (n_nodes, 3)."""
    return quads.add_to_nodes(corners, quads.area_vectors_vjp(nodes[corners], bar), len(nodes))
