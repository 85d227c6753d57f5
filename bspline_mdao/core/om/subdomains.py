"""Which grid nodes each process of a component has: its model, and its option ``partition``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import openmdao.api as om

from ...errors import InputError
from ...grids.topology.index_space import Window
from ...grids.topology.partition import Partition, Subdomain
from ..fit.fit_nodes import whole_blocks
from ..model.movable import Movable


def declare_partition(component: om.ExplicitComponent) -> None:
    """Declare the option ``partition``, in ``initialize``."""
    component.options.declare(
        "partition",
        default=None,
        types=(Partition, Subdomain),
        recordable=False,
        desc="nodes that each process holds: a Partition, or the Subdomain of this one; dealt out by default",
    )


def subdomain_of(
    component: om.ExplicitComponent,
) -> Subdomain | None:  # None if one process has the whole grid, in its order
    """Take the nodes of this process from the option ``partition``, or else from the option ``model``."""
    model, partition, n_ranks = component.options["model"], component.options["partition"], component.comm.size
    if partition is None:
        if model.ownership is not None:
            return model.ownership
        return None if n_ranks == 1 else model.partition(n_ranks).subdomain(component.comm.rank)
    if isinstance(partition, Subdomain):
        return partition
    if partition.n_ranks != n_ranks:
        raise InputError(
            f"{component.msginfo}: the partition is one of {partition.n_ranks} processes, and there are {n_ranks}; "
            f"make it by Partition.of(model.topology, {n_ranks})"
        )
    return partition.subdomain(component.comm.rank)


def part_of_model(component: om.ExplicitComponent) -> Movable:
    """Take this process's part of the option ``model``: all of it if `subdomain_of` gives none."""
    model, subdomain = component.options["model"], subdomain_of(component)
    return model if subdomain is None else model.part(subdomain)


def blocks_of(component: om.ExplicitComponent) -> Partition:
    """Take the partition of a component that needs whole blocks: its option, or a default that cuts no block."""
    topology, partition, n_ranks = (
        component.options["model"].topology,
        component.options["partition"],
        component.comm.size,
    )
    advice = f"make it by Partition.of(model.topology, {n_ranks}, imbalance=math.inf)"
    if partition is None:
        return whole_blocks(topology, n_ranks)
    if isinstance(partition, Subdomain) or partition.n_ranks != n_ranks or partition.shapes != topology.shapes:
        raise InputError(f"{component.msginfo}: needs a partition of all blocks to {n_ranks} processes; {advice}")
    for window in (window for windows in partition.pieces for window in windows):
        if window != Window.whole(window.block, topology.shapes[window.block]):
            raise InputError(f"{component.msginfo}: needs whole blocks, and block {window.block + 1} is cut; {advice}")
    return partition


@dataclass(frozen=True, eq=False)
class WholeNodes:
    """Nodes of the whole grid gathered on every process, for maps that need all of them."""

    comm: Any  # the processes
    rows: tuple[np.ndarray, ...]  # of int, rows in the grid vector of the nodes of each process

    @classmethod
    def of(cls, comm: Any, partition: Partition) -> WholeNodes:
        """Take the rows of a partition."""
        return cls(comm, tuple(partition.subdomain(rank).rows for rank in range(partition.n_ranks)))

    def gather(self, nodes: np.ndarray) -> np.ndarray:
        """Nodes of the grid, shape (n_nodes, 3), from the nodes of each process, shape (n, 3)."""
        if self.comm.size == 1:
            return nodes
        whole = np.empty((sum(map(len, self.rows)), 3), nodes.dtype)
        for rows, part in zip(self.rows, self.comm.allgather(nodes)):
            whole[rows] = part
        return whole

    def local(self, whole: np.ndarray) -> np.ndarray:
        """Nodes of this process, shape (n, 3), from the nodes of the grid."""
        return whole if self.comm.size == 1 else whole[self.rows[self.comm.rank]]
