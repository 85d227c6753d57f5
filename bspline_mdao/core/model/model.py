"""A fitted grid as far as a process knows its nodes: what meshes, surfaces, maps and components take.

A process that is alone knows all of them, and its model is a `.fitted_model.FittedModel`; one of several has a
`.local_model.LocalModel`. Both give the same bits for the nodes that they know.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from ...grids.topology.node_numbering import NodeNumbering
from ...grids.topology.partition import Subdomain
from ...grids.topology.topology import Topology
from ..evaluation.evaluator import Evaluator
from ..splines.mesh import BSplineMesh
from ..walls.grid_map import GridMap
from ..walls.wall_correction import WallCorrection
from .records import FitReport, FitSettings, GridHeader

__all__ = ["Model", "nodes_at"]


class Model(ABC):
    """A fitted grid: all of it, or what one of several processes needs of it."""

    # Topology, control mesh and control points are those of the whole grid in any case.

    topology: Topology
    mesh: BSplineMesh  # one volume per segment
    control_points: np.ndarray  # (n_control_points, 3), fitted ones (m)
    header: GridHeader
    report: FitReport
    settings: FitSettings
    residual: np.ndarray | None  # baseline minus fitted points of the nodes that are known (m), where it is kept
    candidate_weights: np.ndarray | None

    @property
    def n_nodes(self) -> int:
        """Nodes of all blocks of the grid."""
        return self.topology.n_nodes

    @property
    @abstractmethod
    def residual_lengths(self) -> np.ndarray | None:
        """How long the residual is around every corner of the spans of the whole grid (m); None if it does not turn."""

    @property
    @abstractmethod
    def ownership(self) -> Subdomain | None:
        """Nodes of the process whose model this is; None where it has all of them, in the order of the grid."""

    @abstractmethod
    def part(self, subdomain: Subdomain) -> Model:
        """Take what a process with some nodes needs of the model: the model itself where it is made for these."""

    @abstractmethod
    def parameters_of(self, numbering: NodeNumbering) -> list[np.ndarray]:
        """Parameters of the nodes that each segment evaluates, ``numbering.numbers``, each of shape (n_v, 3)."""

    @abstractmethod
    def residual_at(self, rows: np.ndarray) -> np.ndarray | None:
        """Residual of nodes by their rows, shape (n, 3); None where there is none."""

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
        whole: Model,  # model of the whole grid: where blocks are cut, nodes of the pieces' neighbours take part
    ) -> tuple[GridMap, WallCorrection]:
        """Map to the nodes of the process for walls that are met exactly, and what of the correction it needs."""

    def fits(self, subdomain: Subdomain) -> bool:
        """Whether the model is of the whole grid, or made for just these nodes."""
        return self.ownership is None or np.array_equal(self.ownership.rows, subdomain.rows)


def nodes_at(model: Model, rows: np.ndarray) -> np.ndarray:
    """Nodes of the baseline by their rows in the grid vector, shape (n, 3), with the bits of the whole grid (m)."""
    numbering = NodeNumbering.of(model.topology, np.asarray(rows))
    nodes = Evaluator.of_nodes(numbering, model.mesh, model.parameters_of(numbering)).forward(model.control_points)
    nodes, residual = nodes[: numbering.n_asked], model.residual_at(numbering.rows[: numbering.n_asked])
    return nodes if residual is None else nodes + residual
