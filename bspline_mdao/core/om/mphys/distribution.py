"""Which nodes of a surface or a grid each process of a solver has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ....base.numerics.processes import summed, together
from ....errors import InputError
from ..component import as_node_numbers

__all__ = ["nodes_of_rank"]


def nodes_of_rank(
    # given by the user, on every process its own, possibly none. By default all nodes are distributed in order, equally
    # many to each process.
    numbers: Sequence[int] | np.ndarray | None,
    n: int,  # number of nodes there are
    name: str,  # name, pathname: option and component, for messages
    comm: Any,  # the processes
    pathname: str,
) -> np.ndarray:  # of int
    """Numbers of this process's nodes."""
    if comm.size == 1:
        return as_node_numbers(numbers, n, name, pathname)
    with together(comm):
        if numbers is None:
            here = np.arange(n * comm.rank // comm.size, n * (comm.rank + 1) // comm.size)
        elif np.size(numbers) == 0:
            here = np.zeros(0, dtype=int)
        else:
            here = as_node_numbers(numbers, n, name, pathname)
    if not summed(comm, np.array([len(here)])).any():
        raise InputError(f"{pathname}: no process gives any of '{name}'; give the solver's node numbers on each")
    return here
