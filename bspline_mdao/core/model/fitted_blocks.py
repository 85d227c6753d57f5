"""The blocks of a fitted grid on one of several processes: the result of a parallel fit.

Topology, control mesh and control points are the whole model's; of its nodes each process holds the parameters and the
residual of whole blocks. From there the model is saved, and each process gets the part that it evaluates.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ...base.display import OneLine
from ...grids.topology.node_numbering import NodeNumbering
from ...grids.topology.partition import Partition, Subdomain
from ...grids.topology.topology import Topology
from ..splines.mesh import BSplineMesh
from ..walls.residual_lengths import residual_lengths
from .local_model import LocalModel, rows_of_subdomain
from .model_parts import write_by_turns
from .records import FitReport, FitSettings, GridHeader

__all__ = ["FittedBlocks"]


@dataclass(frozen=True, eq=False)
class FittedBlocks(OneLine):
    """A fitted grid distributed over processes by blocks. Made by `bspline_mdao.splines.fit_blocks`."""

    comm: Any  # the processes
    # topology, mesh, control_points, report, settings, candidate_weights: of the whole model, see
    # `bspline_mdao.core.model.fitted_model.FittedModel`
    topology: Topology
    mesh: BSplineMesh
    control_points: np.ndarray
    header: GridHeader  # as of the whole model, except that blanking is only of the blocks here
    report: FitReport
    settings: FitSettings
    candidate_weights: np.ndarray | None
    homes: tuple[int, ...]  # process of every block
    # of every segment of the blocks here, parameters of its nodes, shape (L0, L1, L2, 3)
    parameters: Mapping[int, np.ndarray]
    # of every block here, baseline minus fitted points (m), shape (n, 3), where it is kept
    residual: Mapping[int, np.ndarray] | None

    @property
    def blocks(self) -> tuple[int, ...]:
        """Blocks of this process."""
        return tuple(block for block, rank in enumerate(self.homes) if rank == self.comm.rank)

    def residual_lengths(self) -> np.ndarray | None:
        """As `bspline_mdao.FittedModel.residual_lengths`; all processes call this."""
        if self.residual is None or not self.settings.wall_layer:
            return None
        return residual_lengths(self.topology, self.mesh, self.parameters, self.residual, self.comm)

    def local_model(
        self,
        subdomain: Subdomain | None = None,  # nodes of this process; by default those that `Partition.of` gives it
    ) -> LocalModel:
        """Collect the part that this process evaluates from its holders; all processes call this."""
        topology = self.topology
        if subdomain is None:
            subdomain = Partition.of(topology, self.comm.size).subdomain(self.comm.rank)
        numbering = NodeNumbering.of(topology, rows_of_subdomain(topology, subdomain))
        parameters = self._parameters_of(numbering)
        residual = None if self.residual is None else self._residual_of(numbering.rows)

        def residual_at(rows: np.ndarray) -> np.ndarray:
            assert residual is not None
            return residual

        return LocalModel.of(
            subdomain,
            topology,
            lambda segment, places: parameters[segment],
            None if residual is None else residual_at,
            mesh=self.mesh,
            control_points=self.control_points,
            header=self.header,
            report=self.report,
            settings=self.settings,
            candidate_weights=self.candidate_weights,
            residual_lengths=self.residual_lengths(),
        )

    def save(
        self,
        path: str | os.PathLike,  # the file, on a disk that all processes see
        compress: bool = True,  # compress the arrays
    ) -> None:
        """Write the model to one HDF5 file, the same as `FittedModel.save`; all processes call this."""
        parts = {f"parameters/{s}": array for s, array in self.parameters.items()}
        parts |= {f"residual/{block}": array for block, array in (self.residual or {}).items()}
        iblanks = {f"iblank/{block}": self.header.iblanks[block] for block in self.blocks}
        parts |= {name: iblank for name, iblank in iblanks.items() if iblank is not None}
        contents = {f.name: getattr(self, f.name) for f in fields(self)} | {"residual_lengths": self.residual_lengths()}
        write_by_turns(path, self.comm, contents, parts, compress)

    def _parameters_of(self, numbering: NodeNumbering) -> dict[int, np.ndarray]:
        """Parameters of the nodes that each segment evaluates."""
        asked: list[dict[int, np.ndarray]] = [{} for _ in range(self.comm.size)]
        for segment, places in enumerate(numbering.places):
            if len(places):
                asked[self.homes[self.topology.segments[segment].block]][segment] = places
        given = [
            {segment: self.parameters[segment].reshape(-1, 3)[places] for segment, places in wanted.items()}
            for wanted in _exchanged(self.comm, asked)
        ]
        return {segment: values for part in _exchanged(self.comm, given) for segment, values in part.items()}

    def _residual_of(self, rows: np.ndarray) -> np.ndarray:
        """Residual of nodes by their rows in the grid vector."""
        assert self.residual is not None
        layout = self.topology.layout
        rank, result = np.asarray(self.homes)[layout.owner(rows)], np.empty((len(rows), 3))
        asked = _exchanged(self.comm, [rows[rank == home] for home in range(self.comm.size)])
        given = []
        for wanted in asked:
            values, block = np.empty((len(wanted), 3)), layout.owner(wanted)
            for number in np.unique(block):
                is_there = block == number
                values[is_there] = self.residual[int(number)][wanted[is_there] - layout.starts[number]]
            given.append(values)
        for home, values in enumerate(_exchanged(self.comm, given)):
            result[rank == home] = values
        return result


def _exchanged(comm: Any, parts: list) -> list:
    """All-to-all exchange: the parts that every process has for this one."""
    return parts if comm.size == 1 else comm.alltoall(parts)
