"""Quality of cells of mixed kinds whose nodes several processes hold: each judges a part of the cells of all nodes.

A cell has nodes of several processes, so each process gets all nodes and judges an equal share of the cells. The
results are joined, and adjoints of nodes are summed, before each process takes its own rows.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.display import OneLine
from ...base.numerics.processes import from_all, summed
from ...errors import InputError
from .grid_quality import GridValues
from .mixed_quality import MixedQuality, MixedReport

__all__ = ["GatheredQuality"]


@dataclass(frozen=True, eq=False)
class GatheredQuality(OneLine):
    """Quality of a mesh from the nodes of each process; made by `of`."""

    part: MixedQuality  # of the cells of this process
    comm: Any  # the processes
    rows: tuple[np.ndarray, ...]  # of int, nodes of the mesh that each process holds
    is_first: np.ndarray  # of bool, whether this process is the first to hold each of its nodes

    @classmethod
    def of(
        cls,
        part: MixedQuality,  # the cells of this process
        comm: Any,
        rows: np.ndarray,  # of int, nodes of the mesh that this process holds
    ) -> GatheredQuality:
        """Ask all processes, which all call it, for their nodes; `InputError` if a node is held by none."""
        every, n = from_all(comm, rows), len(part.baseline)
        numbers = np.concatenate(every)
        _, first = np.unique(numbers, return_index=True)
        if len(first) < n:
            lost = np.setdiff1d(np.arange(n), numbers)
            raise InputError(
                f"{part.mesh.source}: {len(lost):,} nodes are held by no process, the first is node {lost[0] + 1}; "
                f"its cells cannot be judged: leave out the quality, or give all nodes"
            )
        is_first = np.zeros(len(numbers), dtype=bool)
        is_first[first] = True
        start = sum(map(len, every[: comm.rank]))
        return cls(part, comm, tuple(every), is_first[start : start + len(rows)])

    @property
    def baseline(self) -> np.ndarray:
        """Nodes of this process on the baseline (m)."""
        return self.part.baseline[self._here]

    @property
    def n_cells(self) -> int:
        """Number of cells of the mesh."""
        return self.part.n_cells

    @property
    def lines(self) -> Sequence[np.ndarray]:
        """Nodes around the faces of all cells, by their numbers here; -1 for nodes of other processes."""
        places = np.full(len(self.part.baseline) + 1, -1)
        places[self._here] = np.arange(len(self._here))
        return tuple(places[line] for line in self.part.lines)

    @property
    def aggregates(self) -> tuple[str, ...]:
        """Names of the aggregates that the mesh has."""
        return self.part.aggregates

    def require(self, names: Sequence[str], cells: bool = False) -> None:
        """See `MixedQuality.require`."""
        self.part.require(names, cells)

    def evaluate(self, nodes: np.ndarray, names: Sequence[str] | None = None, cells: bool = False) -> GridValues:
        """Aggregate the quality of the mesh with the nodes of this process, shape (n, 3)."""
        names = self.aggregates if names is None else names
        self.part.require(names, cells)
        return self.part.joined(from_all(self.comm, self.part.parts(self._gathered(nodes), names)))

    def jvp(self, nodes: np.ndarray, d_nodes: np.ndarray, values: GridValues) -> GridValues:
        """Change of the aggregates with the nodes of all processes."""
        change = self.part.jvp(self._gathered(nodes), self._gathered(d_nodes), values).aggregates
        return GridValues(dict(zip(change, summed(self.comm, np.array([*change.values()])).tolist())))

    def vjp(self, nodes: np.ndarray, values: GridValues, bar: GridValues) -> np.ndarray:
        """Adjoint of the nodes of this process, shape (n, 3); for a node that several hold, it goes to the first."""
        nodes_bar = summed(self.comm, self.part.vjp(self._gathered(nodes), values, bar))
        return nodes_bar[self._here] * self.is_first[:, None]

    def report(self, nodes: np.ndarray, n_bins: int = 50) -> MixedReport:
        """Report on the mesh with the nodes of this process, shape (n, 3)."""
        return MixedReport.joined(from_all(self.comm, self.part.report(self._gathered(nodes), n_bins)))

    def summary(self, nodes: np.ndarray) -> dict[str, float]:
        """Scalars to store for many meshes, see `MixedReport.summary`."""
        return self.report(nodes).summary

    def newly_inverted(self, nodes: np.ndarray) -> str:
        """Name the worst cell that is inverted and was not on the baseline, and the marker next to it."""
        return self.part.named(from_all(self.comm, self.part.worst_new(self._gathered(nodes))))

    @property
    def _here(self) -> np.ndarray:
        return self.rows[self.comm.rank]

    def _gathered(self, part: np.ndarray) -> np.ndarray:
        """Nodes of the mesh, shape (n_points, 3), from the nodes of each process."""
        whole = np.empty_like(self.part.baseline)
        for rows, found in reversed(list(zip(self.rows, from_all(self.comm, part)))):
            whole[rows[::-1]] = found[::-1]  # the first holder of a node is the last to write it
        return whole
