"""The parts of a flow that do not change with the shape of the grid: faces, stencils, preconditioner pattern, axes.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...cells import quads
from ...cells.cell_faces import CellFaces
from ...checks import as_axes
from ...topology.topology import Topology
from .discretization import Discretization
from .preconditioner import FactorPattern, factor_pattern

__all__ = ["FlowGrid"]


_FLAT = 1e-9
"""Height of a face, relative to the size of the grid, below which it is collapsed."""


@dataclass(frozen=True, eq=False)
class FlowGrid:
    """Faces and stencils, the pattern of the preconditioner, and the axes of the flow.

    Parameters
    ----------
    discretization : Discretization
    pattern : FactorPattern
    axes : ndarray, shape (3, 3)
        Rows are the directions downstream, along the span, and up.
    """

    discretization: Discretization
    pattern: FactorPattern
    axes: np.ndarray

    @classmethod
    def of(cls, topology: Topology, nodes: np.ndarray, axes: str = "xzy", **settings) -> FlowGrid:
        """Find the faces, stencils and preconditioner pattern of a grid.

        Parameters
        ----------
        topology : Topology
            Connections of its blocks, with declared patches.
        nodes : ndarray, shape (n_nodes, 3)
            Baseline nodes (m).
        axes : str
            Axes of the grid that point downstream, along the span, and up.
        **settings
            Of the `Discretization`.

        Raises
        ------
        InputError
            If a part of the boundary is not declared as wall, symmetry or far field, or the axes cannot be used.
        """
        discretization = Discretization.of(CellFaces.of(topology, nodes), **settings)
        return cls(discretization, factor_pattern(discretization), as_axes(axes, "flow"))

    @property
    def faces(self) -> CellFaces:
        """Cells and faces of the grid."""
        return self.discretization.faces

    def least_height(self, nodes: np.ndarray) -> float:
        """Height (m) of the flattest face, its area divided by its longest edge; collapsed faces do not count."""
        corners = nodes[self.faces.corners]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        heights = np.linalg.norm(self.areas(nodes), axis=1) / np.maximum(edges, np.finfo(float).tiny)
        return float(heights.min(where=heights > _FLAT * np.ptp(nodes, axis=0).max(), initial=np.inf))

    def areas(self, nodes: np.ndarray) -> np.ndarray:
        """Area vectors (m^2), shape (n_faces, 3), of nodes, shape (n_nodes, 3)."""
        return area_vectors(nodes, self.faces.corners)

    def areas_jvp(self, nodes: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
        """Change of the area vectors with the nodes."""
        return area_vectors_jvp(nodes, self.faces.corners, d_nodes)

    def areas_vjp(self, nodes: np.ndarray, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `areas_jvp`."""
        return area_vectors_vjp(nodes, self.faces.corners, bar)


def area_vectors(nodes: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Area vectors (m^2), shape (n_faces, 3), of the nodes, shape (n_nodes, 3), at corners, shape (n_faces, 4).

    Half the cross product of the diagonals: the parts of the boundary edges of neighbouring faces cancel, whatever the
    nodes, so that the area vectors of a cell sum to zero and uniform flow is a solution on any grid.
    """
    return quads.area_vectors(nodes[corners])


def area_vectors_jvp(nodes: np.ndarray, corners: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
    """Change of the area vectors with the nodes."""
    return quads.area_vectors_jvp(nodes[corners], d_nodes[corners])


def area_vectors_vjp(nodes: np.ndarray, corners: np.ndarray, bar: np.ndarray) -> np.ndarray:
    """Transposed product of `area_vectors_jvp`, shape (n_nodes, 3)."""
    return quads.add_to_nodes(corners, quads.area_vectors_vjp(nodes[corners], bar), len(nodes))
