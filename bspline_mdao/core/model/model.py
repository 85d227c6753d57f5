"""A fitted grid as far as a process knows its nodes: the interface for meshes, surfaces, maps and components.

A single process knows all of them, and its model is a `.fitted_model.FittedModel`. One of several has a
`.local_model.LocalModel`. Both give the same bits for the nodes that they know.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...base.numerics.mean_planes import mean_planes
from ...base.numerics.processes import from_all, together
from ...errors import InputError
from ...grids.cells.cell_judge import BlocksJudge
from ...grids.cells.pieces import Pieces
from ...grids.topology.grid import Grid
from ...grids.topology.node_numbering import NodeNumbering, face_rows, node_copies, source_rows
from ...grids.topology.partition import Partition, Subdomain
from ...grids.topology.topology import Topology
from ..evaluation.evaluator import Evaluator
from ..sliding.sliding_nodes import Slide, SlidingNodes
from ..splines.mesh import BSplineMesh
from ..walls.grid_map import GridMap
from ..walls.wall_correction import WallCorrection
from .movable import Movable
from .records import FitReport, FitSettings, GridHeader

__all__ = ["Model", "nodes_at"]


class Model(Movable):
    """A fitted grid, or the part of it that one of several processes needs."""

    # Topology, control mesh and control points are always the whole grid's.

    topology: Topology
    mesh: BSplineMesh  # one volume per segment
    header: GridHeader
    report: FitReport
    settings: FitSettings
    residual: np.ndarray | None  # baseline minus fitted points of the known nodes (m), if it is kept
    candidate_weights: np.ndarray | None

    @property
    def n_nodes(self) -> int:
        """Nodes of all blocks of the grid."""
        return self.topology.n_nodes

    def with_nodes(self, nodes: np.ndarray) -> Grid:
        """Grid of these nodes, with the names and patches."""
        return self.header.grid(self.topology.shapes, nodes)

    @property
    def length_unit(self) -> str:
        """Unit of its lengths: metres if no other is known."""
        return self.header.length_unit

    @property
    def source(self) -> str:
        """File of the grid."""
        return self.header.source

    @property
    def control_ids(self) -> tuple[np.ndarray, ...]:
        """Numbers of the control points of the segments."""
        return self.mesh.control_ids

    def splines_at(self, control_points: np.ndarray) -> tuple[BSplineMesh, np.ndarray]:
        """The control mesh, with all control points."""
        return self.mesh, control_points

    @property
    def spline_names(self) -> tuple[str, ...]:
        """Names of the segments."""
        return self.topology.segment_names

    @property
    def control_lines(self) -> Sequence[np.ndarray]:
        """The control mesh, volume by volume."""
        return self.mesh.control_ids

    @property
    def node_map(self) -> GridMap:
        """See `grid_map`."""
        return self.grid_map()

    @property
    def is_linear(self) -> bool:
        """Whether neither the residual turns nor nodes follow walls or the other one of two periodic sides."""
        has_walls = any(face.kind == "wall" for face in self.topology.boundary)
        follows = self.settings.wall_layer and (self.residual is not None or has_walls)
        return not follows and not self.topology.periodic

    @property
    def is_linear_at_walls(self) -> bool:
        """Whether the residual does not turn."""
        return self.residual is None or not self.settings.wall_layer

    @property
    def carries_all(self) -> bool:
        """True: the far field is made of control points like everything else."""
        return True

    @property
    def why_no_fit(self) -> str:
        """Why, if the process has only some nodes of the grid."""
        return "" if self.ownership is None else "a local model has neither a fit nor nodes of a surface that are given"

    @property
    @abstractmethod
    def residual_lengths(self) -> np.ndarray | None:
        """Length of the residual around every corner of the whole grid's spans (m); None if it does not turn."""

    @abstractmethod
    def part(self, subdomain: Subdomain) -> Model:
        """Part of the model that a process with some nodes needs; the model itself if it is made for these."""

    @abstractmethod
    def parameters_of(self, numbering: NodeNumbering) -> list[np.ndarray]:
        """Parameters of the nodes that each segment evaluates, ``numbering.numbers``, each of shape (n_v, 3)."""

    @abstractmethod
    def residual_at(self, rows: np.ndarray) -> np.ndarray | None:
        """Residual of nodes by their rows, shape (n, 3); None if the model has none."""

    @abstractmethod
    def local_nodes(self, control_points: np.ndarray | None = None) -> np.ndarray:
        """Nodes of the process at given control points (m), the fitted ones by default, shape (n, 3)."""

    @abstractmethod
    def grid_map(self) -> GridMap:
        """Map from the control points to the nodes of the process, which come first in it."""

    @abstractmethod
    def corrected_map(
        self,
        rows: np.ndarray,  # (n,) of int, rows of the nodes of the walls that are given
        whole: Model,  # model of the whole grid: if blocks are cut, nodes of neighbouring pieces take part
    ) -> tuple[GridMap, WallCorrection]:
        """Map to the process's nodes for walls that are met exactly, and the part of the correction that it needs."""

    def map_meeting(self, rows: np.ndarray, whole: Model, slides: Sequence[Slide] = ()) -> GridMap:
        """The map with a correction: it has ``surface`` as another input if nodes are given."""
        if not slides:
            grid_map, correction = self.corrected_map(rows, whole)
            return grid_map.meeting(correction)
        topology, nodes = whole.topology, nodes_at(whole, np.arange(whole.n_nodes))
        sliding, given = SlidingNodes.of(topology, nodes, slides), source_rows(node_copies(topology), rows)
        asked = np.concatenate([given, np.setdiff1d(sliding.rows, given)])
        grid_map, correction = self.corrected_map(asked, whole)
        return grid_map.meeting(correction, len(rows), sliding.among(asked))

    def partition(self, n_ranks: int) -> Partition:
        """Distribute the blocks, see `Partition.of`."""
        return Partition.of(self.topology, n_ranks)

    def nodes_on_planes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Nodes of the faces of symmetry; of coincident nodes, the first."""
        copies = node_copies(self.topology)
        faces = [face for face in self.topology.boundary if face.kind == "symmetry"]
        rows = [face_rows(self.topology, face.window).ravel() for face in faces]
        planes = mean_planes([nodes_at(self, of_face) for of_face in rows])
        return [(source_rows(copies, of_face), plane.normal) for of_face, plane in zip(rows, planes)]

    def judge(self, subdomain: Subdomain | None, comm: Any, **settings: Any) -> BlocksJudge:
        """The measure of cells of the blocks, or of their pieces on the processes."""
        with together(comm):
            if subdomain is None:
                nodes = self.local_nodes()
                grid = self.header.grid(self.topology.shapes, nodes)
                return BlocksJudge.of_baseline(grid, baseline=nodes, **settings)
            windows = subdomain.windows
            if windows is None:
                raise InputError(
                    f"a subdomain of rows has no cells; give the partition by Partition.of(model.topology, {comm.size})"
                )
            nodes = nodes_at(self, subdomain.rows)
        partition = Partition(subdomain.shapes_of_grid, tuple(from_all(comm, windows)))
        pieces = Pieces(partition, self.header.names, self.header.patches, self.header.source, comm)
        return BlocksJudge.of_pieces(pieces, nodes, baseline=nodes, **settings)

    def fits(self, subdomain: Subdomain) -> bool:
        """Whether the model has the whole grid, or was made for exactly these nodes."""
        return self.ownership is None or np.array_equal(self.ownership.rows, subdomain.rows)


def nodes_at(model: Model, rows: np.ndarray) -> np.ndarray:
    """Nodes of the baseline by their rows in the grid vector, shape (n, 3), to the bit as in the whole grid (m)."""
    numbering = NodeNumbering.of(model.topology, np.asarray(rows))
    nodes = Evaluator.of_nodes(numbering, model.mesh, model.parameters_of(numbering)).forward(model.control_points)
    nodes, residual = nodes[: numbering.n_asked], model.residual_at(numbering.rows[: numbering.n_asked])
    return nodes if residual is None else nodes + residual
