"""Which nodes of a grid each process of a component holds: its model, and its option ``partition``."""

from __future__ import annotations

import numpy as np
import openmdao.api as om

from ..errors import InputError
from ..model.fitted_model import FittedModel
from ..model.model_share import ModelShare, boundary_layers
from ..topology.partition import Partition, Share
from .component import difference_step


def declare_partition(component: om.ExplicitComponent) -> None:
    """Declare the option ``partition``, in ``initialize``."""
    component.options.declare(
        "partition",
        default=None,
        types=(Partition, Share),
        recordable=False,
        desc="nodes that each process holds: a Partition, or the Share of this one; dealt out by default",
    )


def share_of(component: om.ExplicitComponent) -> Share | None:
    """Take the nodes that this process holds, by the option ``partition`` or else by the option ``model``.

    Returns
    -------
    Share or None
        None where one process has all of the grid, in its order.

    Raises
    ------
    InputError
        If the partition is one of another number of processes, or the model is a share of other nodes.
    """
    model, partition, n_ranks = component.options["model"], component.options["partition"], component.comm.size
    if partition is None:
        if isinstance(model, ModelShare):
            return model.share
        return None if n_ranks == 1 else Partition.of(model.topology, n_ranks).share(component.comm.rank)
    if isinstance(partition, Share):
        return partition
    if partition.n_ranks != n_ranks:
        raise InputError(
            f"{component.msginfo}: the partition is one of {partition.n_ranks} processes, and there are {n_ranks}; "
            f"make it by Partition.of(model.topology, {n_ranks})"
        )
    return partition.share(component.comm.rank)


def part_of_model(component: om.ExplicitComponent) -> FittedModel | ModelShare:
    """Take what this process holds of the option ``model``: all of it where `share_of` gives none.

    Raises
    ------
    InputError
        As `share_of`; also if the partition is of another grid, or the model is a share of other nodes.
    """
    model, share = component.options["model"], share_of(component)
    if share is None:
        return model
    if isinstance(model, FittedModel):
        return model.share(share)
    if not np.array_equal(model.share.rows, share.rows):
        raise InputError(
            f"{component.msginfo}: the model is a share of other nodes than the partition's; leave the partition out"
        )
    return model


def check_step(model: FittedModel | ModelShare) -> float:
    """Find the step (m) of differences of a grid, the same on all processes; see `.component.difference_step`."""
    if isinstance(model, FittedModel):
        return difference_step(block.nodes for block in model.regenerate().blocks)
    return difference_step(boundary_layers(model))
