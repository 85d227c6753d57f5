"""The part of a fitted grid that one of several processes needs.

Topology, control mesh and control points are the whole model's. Parameters and residual are known only for some nodes:
the process's own; the nodes that these are copies of, because a node that blocks share is evaluated in the volume of
the first; and the nodes of the boundary and of the layer next to it, which every process has, because anything near a
wall follows all of it. So a local model is a part of the grid and a few surfaces, and its nodes have the same bits as
in the whole grid, on any number of processes.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...base.checks import as_finite_points
from ...base.display import OneLine
from ...base.numerics.processes import ONE, on_first, together
from ...errors import InputError
from ...grids.topology.node_numbering import (
    NodeNumbering,
    NodesByRow,
    each_once,
    face_layer_rows,
    node_copies,
    source_rows,
)
from ...grids.topology.partition import Partition, Subdomain
from ...grids.topology.periodic_ties import row_ties
from ...grids.topology.topology import Topology
from ..evaluation.evaluator import Evaluator
from ..splines.mesh import BSplineMesh
from ..walls.grid_map import GridMap
from ..walls.grid_walls import GridWalls
from ..walls.wall_correction import WallCorrection
from .model import Model, nodes_at
from .model_file import read_fields
from .model_parts import opened_parts
from .records import FitReport, FitSettings, GridHeader

__all__ = ["LocalModel", "rows_of_subdomain"]


def rows_of_subdomain(topology: Topology, subdomain: Subdomain) -> np.ndarray:
    """Rows of the nodes whose parameters and residual a process needs, ascending, each once."""
    # The process's own nodes, the nodes of the grid's boundary and of the layer next to it, and the nodes that any of
    # these are copies of.
    boundary = [rows.ravel() for face in topology.boundary for rows in face_layer_rows(topology, face.window)]
    return each_once(NodeNumbering.of(topology, each_once(np.concatenate([subdomain.rows, *boundary]))).rows)


@dataclass(frozen=True, eq=False)
class LocalModel(OneLine, Model):
    """The part of a fitted grid that a process needs. Made by `FittedModel.local_model`, or by `LocalModel.of`."""

    subdomain: Subdomain  # nodes of the process
    # topology, mesh, control_points, header, report, settings, candidate_weights, residual_lengths: of the whole model,
    # see `bspline_mdao.core.model.fitted_model.FittedModel`
    topology: Topology
    mesh: BSplineMesh
    control_points: np.ndarray
    rows: np.ndarray  # (n,) of int, rows of the known nodes, see `rows_of_subdomain`
    parameters: np.ndarray  # (n, 3), parameters of each of them in the volume that evaluates it
    residual: np.ndarray | None  # (n, 3), their residual (m), if it is kept
    header: GridHeader
    report: FitReport
    settings: FitSettings
    candidate_weights: np.ndarray | None = None
    residual_lengths: np.ndarray | None = None

    @classmethod
    def of(
        cls,
        subdomain: Subdomain,  # nodes of the process
        topology: Topology,  # topology of the grid
        # takes the number of a segment and places in the C order of its nodes, ascending; returns their parameters,
        # shape (n, 3)
        parameters_at: Callable[[int, np.ndarray], np.ndarray],
        # takes ascending rows of the grid vector and returns their residual (m), shape (n, 3)
        residual_at: Callable[[np.ndarray], np.ndarray] | None,
        **others: Any,  # the other arguments of the class: ``mesh``, ``control_points``, ``header``, ..
    ) -> LocalModel:
        """Gather the part that a process needs, segment by segment."""
        if subdomain.n_nodes_of_grid != topology.n_nodes:
            raise InputError(
                f"{topology.source}: a subdomain of a grid of {subdomain.n_nodes_of_grid} nodes, but it has "
                f"{topology.n_nodes}; make the partition with the topology of the model"
            )
        nodes_here = NodeNumbering.of(topology, rows_of_subdomain(topology, subdomain))
        parameters = np.empty((nodes_here.n_nodes, 3))
        for segment, (numbers, places) in enumerate(zip(nodes_here.numbers, nodes_here.places)):
            if len(numbers):
                parameters[numbers] = parameters_at(segment, places)
        parameters[nodes_here.copies[:, 0]] = parameters[nodes_here.copies[:, 1]]
        residual = None if residual_at is None else residual_at(nodes_here.rows)
        return cls(
            subdomain=subdomain,
            topology=topology,
            rows=nodes_here.rows,
            parameters=parameters,
            residual=residual,
            **others,
        )

    @classmethod
    def load(
        cls,
        path: str | os.PathLike,  # the file, on a disk that all processes see
        comm: Any = ONE,  # the processes, such as ``mpi4py.MPI.COMM_WORLD``
        subdomain: Subdomain | None = None,  # nodes of this process; by default those that `Partition.of` gives it
    ) -> LocalModel:
        """Read the model of one process from the file of a model; all processes call this."""
        # The first process reads the file once, a piece at a time, to check it; each reads the slices that it needs.
        fields = on_first(comm, lambda: read_fields(path))
        topology, header, has_residual = fields["topology"], fields["header"], fields.pop("has_residual")
        with together(comm):
            if subdomain is None:
                subdomain = Partition.of(topology, comm.size).subdomain(comm.rank)
            with opened_parts(path, topology) as parts:
                nodes_here = {window.block for window in subdomain.windows or ()}
                iblanks = (
                    parts.iblank_of(block) if block in nodes_here else None for block in range(len(header.names))
                )
                fields["header"] = replace(header, iblanks=tuple(iblanks))
                fields["parameters_at"] = parts.parameters_at
                fields["residual_at"] = parts.residual_at if has_residual else None
                loaded = cls.of(subdomain, **fields)
        return loaded

    def __repr__(self) -> str:
        return f"<subdomain of fitted {self.topology.source}: {self.subdomain.n_nodes} of {self.n_nodes} nodes>"

    @property
    def ownership(self) -> Subdomain:
        """Nodes of the process."""
        return self.subdomain

    def part(self, subdomain: Subdomain) -> LocalModel:
        """Return the model itself, if it is made for these nodes."""
        if not self.fits(subdomain):
            raise InputError(
                f"{self.header.source}: the model is of another subdomain than the partition's; leave the partition out"
            )
        return self

    @property
    def n_bytes(self) -> int:
        """Memory of the data of nodes (B)."""
        arrays = (self.rows, self.parameters, self.residual, self.subdomain.rows)
        return sum(array.nbytes for array in arrays if array is not None)

    def parameters_of(self, nodes_here: NodeNumbering) -> list[np.ndarray]:
        """Parameters of the nodes that each segment evaluates, ``nodes_here.numbers``, each of shape (n_v, 3)."""
        return [self.parameters[self._places(nodes_here.rows[numbers])] for numbers in nodes_here.numbers]

    def residual_at(self, rows: np.ndarray) -> np.ndarray | None:
        """Residual of nodes by their rows, shape (n, 3); None if the model has none."""
        return None if self.residual is None else self.residual[self._places(rows)]

    def _places(self, rows: np.ndarray) -> np.ndarray:
        at = np.minimum(np.searchsorted(self.rows, rows), len(self.rows) - 1)
        if (self.rows[at] != rows).any():
            row = rows[np.argmax(self.rows[at] != rows)]
            raise InputError(
                f"{self.header.source}: node {row + 1} of the grid is not in this process's part of the model; ask "
                f"for nodes of its subdomain or of the boundary, or give the whole model"
            )
        return at

    def grid_map(self) -> GridMap:
        """Map from the control points to the nodes of the subdomain, made once and not pickled."""
        # The nodes of the subdomain come first, then the nodes that they need.
        return self._grid_map

    @cached_property
    def _grid_map(self) -> GridMap:
        return self._map_of(self, ())

    def corrected_map(self, rows: np.ndarray, whole: Model) -> tuple[GridMap, WallCorrection]:
        """Map to the subdomain's nodes for walls that are met exactly, and the part of the correction that it needs."""
        nodes = nodes_at(whole, np.arange(whole.n_nodes))
        wanted = NodeNumbering.of(self.topology, self.subdomain.rows, self._needed(()))
        part = WallCorrection.of(self.topology, nodes, rows).part(wanted.sources_of(wanted.rows))
        grid_map = self._map_of(whole, [part.needed])
        return grid_map, part.among(grid_map.numbering)

    @cached_property
    def _walls(self) -> GridWalls | None:
        if not self.settings.wall_layer:
            return None
        rows = GridWalls.rows_seen(self.topology)
        return GridWalls.of(self.topology, NodesByRow(rows, nodes_at(self, rows)))

    def _map_of(self, model: Model, needed: Sequence[np.ndarray]) -> GridMap:
        walls = self._walls
        nodes_here = NodeNumbering.of(self.topology, self.subdomain.rows, self._needed(needed))
        parameters, residual = model.parameters_of(nodes_here), model.residual_at(nodes_here.rows)
        evaluator = Evaluator.of_nodes(nodes_here, self.mesh, parameters)
        places = nodes_here, self.mesh, parameters, self.control_points, residual, self.residual_lengths
        return GridMap.of_nodes(*places, self.settings.wall_layer, walls, evaluator)

    def _needed(self, needed: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Rows of nodes that the process's nodes and others need: of walls, and tied to any of them."""
        rows = [*needed, *(() if self._walls is None else self._walls.needed)]
        ties = row_ties(self.topology)
        if ties is None:
            return rows
        sources = source_rows(node_copies(self.topology), np.concatenate([self.subdomain.rows, *rows]))
        return [*rows, ties.groups_of(sources)]

    def __getstate__(self) -> dict:
        return {name: value for name, value in self.__dict__.items() if name not in ("_grid_map", "_walls")}

    def local_nodes(self, control_points: np.ndarray | None = None) -> np.ndarray:
        """Nodes of the subdomain, see `regenerate`."""
        return self.regenerate(control_points)

    def regenerate(
        self,
        # (n_control_points, 3), moved control points (m); the fitted ones by default
        control_points: np.ndarray | None = None,
    ) -> np.ndarray:  # (subdomain.n_nodes, 3), in the order of the subdomain (m): as in the whole grid, to the last bit
        """Nodes of the subdomain at given control points."""
        if control_points is None:
            return nodes_at(self, self.subdomain.rows)
        what = f"{self.header.source}: control points"
        points = as_finite_points(control_points, self.mesh.n_control_points, what)
        return self.grid_map().at(points).nodes[: self.subdomain.n_nodes]
