"""What moves with control points, whatever its cells: what surfaces, measures, components and case files take.

A grid of blocks that was fitted is one (`.model.Model`), a mesh without structure is one (its lattice is behind it, see
`bspline_mdao.core.background.mesh_model`). Nobody asks which it is: what differs is behind these members, and behind
the functions that make a control mesh (`moving_mesh`), a surface (`SurfaceGrid.of`), its map (`surface_map`) and a
mover (`default_mover`), each of which has one way for each kind of model.
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
        """Number of nodes that are the process's own: they come first."""

    def at(self, *points: Any, **named: Any) -> NodeState:
        """Nodes and their derivative; `MovementError` where the map has no sensible value."""

    def padded(self, bar: np.ndarray) -> np.ndarray:
        """Derivatives by all nodes of those by the nodes that are the process's own."""


class EmbeddedMap(Protocol):
    """A map to points that are no nodes, some of which may ride on the walls around a body."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""

    @property
    def points(self) -> np.ndarray:
        """The points on the baseline (m), shape (n, 3)."""

    @property
    def in_volume(self) -> np.ndarray:
        """Numbers of those that are not in the body."""

    @property
    def body(self) -> BodyPoints | None:
        """What those in the body ride on."""

    @property
    def wall_rows(self) -> np.ndarray:
        """Rows of the nodes of walls that this is made of."""

    @property
    def is_linear(self) -> bool:
        """Whether the map is linear (affine)."""

    @property
    def at(self) -> Callable[..., NodeState]:
        """Points and their derivative."""


class Movable(ABC):
    """Nodes that move with control points."""

    control_points: np.ndarray  # (n_control_points, 3), those of the baseline (m)

    @property
    @abstractmethod
    def source(self) -> str:
        """Where it comes from, for messages."""

    @property
    @abstractmethod
    def n_nodes(self) -> int:
        """Number of nodes of all of it."""

    @abstractmethod
    def with_nodes(self, nodes: np.ndarray) -> Any:
        """Grid or mesh with all of its nodes somewhere (m), shape (n_nodes, 3)."""

    @property
    def baseline(self) -> Any:
        """Grid or mesh as it was fitted; `InputError` of a part of a model."""
        raise InputError(f"{self.source}: a process has a part of the grid alone; give the whole model")

    @property
    @abstractmethod
    def control_ids(self) -> tuple[np.ndarray, ...]:
        """Numbers of the control points of every volume, each of shape (N0, N1, N2)."""

    @abstractmethod
    def splines_at(self, control_points: np.ndarray) -> tuple[BSplineMesh, np.ndarray]:
        """Its volumes, and their control points among all, shape (n_control_points, 3)."""

    @property
    @abstractmethod
    def spline_names(self) -> tuple[str, ...]:
        """Names of the volumes, for messages."""

    @property
    @abstractmethod
    def control_lines(self) -> Sequence[np.ndarray]:
        """Numbers of control points in blocks or lines: neighbours are as far apart as its nodes change over."""

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
        """Whether all nodes go where control points take them; if not, some of the boundary stay, whatever they do."""

    @property
    @abstractmethod
    def why_no_fit(self) -> str:
        """Why control points cannot be fitted to other nodes, as `Fit` does; empty where they can."""

    @property
    @abstractmethod
    def ownership(self) -> Subdomain | None:
        """Nodes of the process whose model this is; None where it has all of them, in their order."""

    @abstractmethod
    def part(self, subdomain: Subdomain) -> Movable:
        """Take what a process with some nodes needs of the model: the model itself where it is made for these."""

    @abstractmethod
    def partition(self, n_ranks: int) -> Partition | NodePartition:
        """Deal its nodes out to processes."""

    def has_cells(self, subdomain: Subdomain | None) -> bool:
        """Whether processes with some nodes have its cells: subdomains that are made of rows have nodes alone."""
        return subdomain is None or subdomain.windows is not None

    @abstractmethod
    def map_meeting(self, rows: np.ndarray, whole: Any, slides: Sequence[Slide] = ()) -> ControlPointMap:
        """Map to the nodes of the process that puts nodes of walls, by their rows, exactly where they are given."""
        # `whole` is the model of all nodes; nodes of ``slides`` stay on their surfaces

    def map_sliding(self, slides: Sequence[Slide], whole: Any) -> ControlPointMap:
        """Map to the nodes of the process that keeps nodes of patches on the surfaces that these slide on."""
        return self.map_meeting(np.zeros(0, dtype=int), whole, slides) if slides else self.node_map

    def embed_points(self, points: np.ndarray, tolerance: float | None = None) -> EmbeddedMap:
        """Find what moves points that are no nodes; `InputError` where nothing does, or of a part of a model."""
        raise InputError(f"{self.source}: points may be in any part of the grid; give the whole model, of one process")

    @abstractmethod
    def nodes_on_planes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Rows of the nodes on each plane of symmetry, and the unit normal of the plane."""

    @abstractmethod
    def judge(
        self,
        subdomain: Subdomain | None,  # nodes of this process; none where it has all
        comm: Any,  # the processes, all of which call it
        **settings: float,  # ``rho``, ``p`` and ``rho_height`` of the aggregates
    ) -> CellJudge:
        """Take what judges its cells, by those of the baseline."""

    @property
    def file(self) -> Path | None:
        """File that it was saved to or loaded from last; None where it was neither."""
        return None

    @property
    def checksum(self) -> str | None:
        """Checksum of all that it is, by which case files know their model; None of a part of one."""
        return None
