"""Files of a flow: fields for ParaView or Tecplot, and states for restarts.

With several processes, the first one reads and writes for all of them.

Theory: ``docs/flow.rst``.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import openmdao.api as om

from ...base.numerics.processes import from_all, on_first
from ...core.model.records import GridHeader
from ...errors import InputError
from ...grids.topology.partition import Partition
from ...grids.topology.topology import Topology
from ...names import GRID
from ..euler.fields import write_flow
from ..euler.gas import N_STATES
from ..euler.newton import FlowSolution
from ..euler.states_file import StatesFile, read_states
from .euler_state import EulerState

__all__ = ["load_states", "save_states", "write_fields"]


def write_fields(
    path: str | os.PathLike,  # ``something.vtm`` or ``something.dat``
    state: EulerState,  # the solved states
    forces: om.ExplicitComponent,  # provides the pressure coefficients on the walls
    topology: Topology,  # of the grid
    header: GridHeader,  # names and patches of the grid
    partition: Partition,  # the distribution to processes
) -> None:
    """Write the fields of a flow that has been run, see `write_flow`."""
    _require_flow(state)
    nodes = _whole(state.comm, state.get_val(GRID, from_src=False).reshape(-1, 3), partition, "rows")
    states = _whole(state.comm, state.get_val("states").reshape(-1, N_STATES), partition, "cells")
    pressures, mach = forces.get_val("Cp"), state.get_val("Mach_number", from_src=False).item()
    on_first(
        state.comm, lambda: write_flow(path, topology, header.grid(topology.shapes, nodes), states, pressures, mach)
    )


def save_states(path: str | os.PathLike, state: EulerState, topology: Topology, partition: Partition) -> None:
    """Save the states of a flow that has been run, with its grid and conditions."""
    solution = _require_flow(state)
    states = _whole(state.comm, state.get_val("states").reshape(-1, N_STATES), partition, "cells")
    values = {name: state.get_val(name, from_src=False).item() for name in ("alpha", "Mach_number")}
    file = StatesFile(states, topology.shapes, values["alpha"], values["Mach_number"], solution.residual)
    on_first(state.comm, lambda: file.save(path))


def load_states(
    path: str | os.PathLike, comm: Any, topology: Topology, partition: Partition
) -> tuple[np.ndarray, float]:  # states: (n_cells, 5), of the cells of this process; alpha: their angle of attack (deg)
    """Read states to start from, possibly of another member of the grid's family."""
    whole, alpha = on_first(comm, lambda: read_states(path, topology))
    return (whole if comm.size == 1 else whole[partition.subdomain(comm.rank).cells]), alpha


def _require_flow(state: EulerState) -> FlowSolution:
    """Refuse a flow that has not been run."""
    if state.solution is None:
        raise InputError(f"{state.msginfo}: there is no flow yet; run the model first")
    return state.solution


def _whole(comm: Any, part: np.ndarray, partition: Partition, what: str) -> Any:
    """Rows of the whole grid, from the rows of each process: nodes (``rows``) or ``cells``."""
    if comm.size == 1:
        return part
    numbers = [getattr(partition.subdomain(rank), what) for rank in range(comm.size)]
    whole = np.empty((1 + max(int(local.max(initial=-1)) for local in numbers), part.shape[1]))
    for local, values in zip(numbers, from_all(comm, part)):
        whole[local] = values
    return whole
