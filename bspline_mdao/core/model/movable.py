"""A model that moves with control points, whatever its cells: the interface for surfaces, measures and components.

A fitted grid of blocks is one (`.model.Model`), and so is an unstructured mesh (through its lattice, see
`bspline_mdao.core.background.mesh_model`). Callers need not know which it is. The difference is behind these members,
and behind the functions that make a control mesh (`moving_mesh`), a surface (`SurfaceGrid.of`), its map (`surface_map`)
and a mover (`default_mover`), each of which has one implementation for each kind of model.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ...errors import InputError
from ...grids.cells.cell_judge import CellJudge
from ...grids.topology.node_partition import NodePartition
from ...grids.topology.partition import Partition, Subdomain
from ..evaluation.node_map import NodeState
from ..sliding.sliding_nodes import Slide
from ..splines.mesh import BSplineMesh
from ..walls.body_points import BodyPoints

__all__ = ["ControlPointMap", "EmbeddedMap", "Movable"]


class ControlPointMap(Protocol):
    """A map from control points to the nodes of a process, see `bspline_mdao.core.evaluation.node_map`."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, the control points first."""

    @property
    def nodes(self) -> np.ndarray:
        """Nodes of the baseline (m), shape (n_nodes, 3)."""

    @property
    def n_asked(self) -> int:
        """Number of the process's own nodes, which come first."""

    def at(self, *points: Any, **named: Any) -> NodeState:
        """Nodes and their derivative; `MovementError` if the map has no sensible value."""

    def padded(self, bar: np.ndarray) -> np.ndarray:
        """Derivatives with respect to all nodes, from those with respect to the process's own."""


class EmbeddedMap(Protocol):
    """A map to points other than nodes, some of which may ride on the walls of a body."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""

    @property
    def points(self) -> np.ndarray:
        """The points on the baseline (m), shape (n, 3)."""

    @property
    def in_volume(self) -> np.ndarray:
        """Numbers of the points outside the body."""

    @property
    def body(self) -> BodyPoints | None:
        """The map that moves points in the body."""

    @property
    def wall_rows(self) -> np.ndarray:
        """Rows of the nodes of walls that this map is made of."""

    @property
    def is_linear(self) -> bool:
        """Whether the map is linear (affine)."""

    @property
    def at(self) -> Callable[..., NodeState]:
        """Points and their derivative."""


class Movable(ABC):
    """Nodes that move with control points."""

    control_points: np.ndarray  # (n_control_points, 3), on the baseline (m)

    @property
    @abstractmethod
    def source(self) -> str:
        """Source of the model, for messages."""

    @property
    def length_unit(self) -> str:
        """Unit of its lengths: metres if no other is known."""
        return "m"

    @property
    @abstractmethod
    def n_nodes(self) -> int:
        """Number of nodes of the whole model."""

    @abstractmethod
    def with_nodes(self, nodes: np.ndarray) -> Any:
        """Grid or mesh with all of its nodes at given places (m), shape (n_nodes, 3)."""

    @property
    def baseline(self) -> Any:
        """Grid or mesh as it was fitted; `InputError` for a part of a model."""
        raise InputError(f"{self.source}: a process has a part of the grid alone; give the whole model")

    @property
    @abstractmethod
    def control_ids(self) -> tuple[np.ndarray, ...]:
        """Numbers of the control points of every volume, each of shape (N0, N1, N2)."""

    @abstractmethod
    def splines_at(self, control_points: np.ndarray) -> tuple[BSplineMesh, np.ndarray]:
        """Its volumes, and their control points out of all, shape (n_control_points, 3)."""

    @property
    @abstractmethod
    def spline_names(self) -> tuple[str, ...]:
        """Names of the volumes, for messages."""

    @property
    @abstractmethod
    def control_lines(self) -> Sequence[np.ndarray]:
        """Numbers of control points in blocks or lines; the distance of neighbours is the scale of changes of nodes."""

    @property
    @abstractmethod
    def node_map(self) -> ControlPointMap:
        """Map from the control points to the nodes of the process."""

    @property
    @abstractmethod
    def is_linear(self) -> bool:
        """Whether that map is linear (affine)."""

    @property
    @abstractmethod
    def is_linear_at_walls(self) -> bool:
        """Whether nodes of walls are linear in the control points of the design surface."""

    @property
    @abstractmethod
    def carries_all(self) -> bool:
        """Whether control points move all nodes; if not, some nodes of the boundary stay in any case."""

    @property
    @abstractmethod
    def why_no_fit(self) -> str:
        """Why control points cannot be fitted to other nodes, as `Fit` does; empty if they can."""

    @property
    @abstractmethod
    def ownership(self) -> Subdomain | None:
        """Nodes of the process whose model this is; None if it has all of them, in their order."""

    @abstractmethod
    def part(self, subdomain: Subdomain) -> Movable:
        """Part of the model that a process with some nodes needs; the model itself if it is made for these."""

    @abstractmethod
    def partition(self, n_ranks: int) -> Partition | NodePartition:
        """Distribute its nodes over processes."""

    def has_cells(self, subdomain: Subdomain | None) -> bool:
        """Whether processes with some nodes have its cells: subdomains made of rows have only nodes."""
        return subdomain is None or subdomain.windows is not None

    @abstractmethod
    def map_meeting(self, rows: np.ndarray, whole: Any, slides: Sequence[Slide] = ()) -> ControlPointMap:
        """Map to the process's nodes that puts nodes of walls, by their rows, exactly at their given places."""
        # ``whole`` is the model of all nodes; nodes of ``slides`` stay on their surfaces

    def map_sliding(self, slides: Sequence[Slide], whole: Any) -> ControlPointMap:
        """Map to the process's nodes that keeps nodes of patches on the surfaces that these slide on."""
        return self.map_meeting(np.zeros(0, dtype=int), whole, slides) if slides else self.node_map

    def embed_points(self, points: np.ndarray, tolerance: float | None = None) -> EmbeddedMap:
        """Embed points that are not nodes; `InputError` if nothing moves them, or for a part of a model."""
        raise InputError(f"{self.source}: points may be in any part of the grid; give the whole model, of one process")

    @abstractmethod
    def nodes_on_planes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Rows of the nodes on each plane of symmetry, and the unit normal of the plane."""

    @abstractmethod
    def judge(
        self,
        subdomain: Subdomain | None,  # nodes of this process; None if it has all
        comm: Any,  # the processes, all of which call it
        **settings: float,  # ``rho``, ``p`` and ``rho_height`` of the aggregates
    ) -> CellJudge:
        """The measure of its cells, relative to the baseline."""

    @property
    def file(self) -> Path | None:
        """File that it was last saved to or loaded from; None if neither."""
        return None

    @property
    def checksum(self) -> str | None:
        """Checksum of the whole model, by which case files identify it; None for a part of one."""
        return None
