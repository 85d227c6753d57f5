"""Files of the states of a flow, for restarts: on any number of processes, or another member of the family.

Layout, version 1 (HDF5)::

    /           attributes: format, version, checksum
    /document   JSON (UTF-8): shapes of the blocks (nodes), alpha (deg), Mach number, residual
    /states     (n_cells, 5), blocks in order, each in C order
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import h5py
import numpy as np

from ...core.evaluation.family import IndexScaling, refined_topology
from ...core.evaluation.transfer import CellTransfer
from ...core.model.model_file import checksum_of, datasets_of
from ...errors import InputError
from ...grids.io.disk import deferred_interrupts, replaced_hdf5_file
from ...grids.topology.block_layout import BlockLayout
from ...grids.topology.topology import Topology
from .gas import N_STATES

__all__ = ["StatesFile", "read_states"]

FORMAT, VERSION = "bspline_mdao flow states", 1

LARGEST = 9
"""Numerators and denominators of the factors of members to try."""

_DAMAGE = (OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError, ArithmeticError, MemoryError)
"""Exceptions of h5py, JSON and types on damaged files."""


@dataclass(frozen=True, eq=False)
class StatesFile:
    """States of a flow, with its grid and conditions."""

    states: np.ndarray  # (n_cells, 5), states of all cells
    shapes: tuple[tuple[int, ...], ...]  # nodes of every block in each direction
    # alpha, mach: angle of attack (deg) and Mach number
    alpha: float
    mach: float
    residual: float  # residual, relative to the uniform stream's

    def __post_init__(self) -> None:
        """Refuse states from which no flow can start, whatever their source."""
        if any(len(shape) != 3 or not all(type(n) is int and n > 1 for n in shape) for shape in self.shapes):
            raise InputError("the blocks of states have no three numbers of nodes of two and more; save them again")
        n_cells = BlockLayout.of(self.shapes).cells.size
        if self.states.dtype.kind != "f" or self.states.shape != (n_cells, N_STATES):
            found = f"{self.states.dtype} of shape {self.states.shape}"
            raise InputError(f"the states are {found}, no reals of shape ({n_cells}, {N_STATES}); save them again")
        is_gas = np.isfinite(self.states).all(axis=1) & (self.states[:, [0, -1]] > 0.0).all(axis=1)
        if not is_gas.all():
            cell = int(np.argmin(is_gas))
            raise InputError(
                f"the state of cell {cell + 1} is {self.states[cell].tolist()}, no gas of positive density and "
                f"pressure; run the flow without the states and save it again"
            )
        for name, value in (("alpha", self.alpha), ("Mach number", self.mach), ("residual", self.residual)):
            if isinstance(value, bool) or not (isinstance(value, int | float) and abs(value) < math.inf):
                raise InputError(f"the states have {name} {value!r:.40}, which is no number; save them again")

    def save(self, path: str | os.PathLike) -> None:
        """Write the file; an existing one is replaced only when the new one is complete."""
        numbers = {"alpha": self.alpha, "Mach_number": self.mach, "residual": self.residual}
        document = json.dumps({"shapes": self.shapes, **numbers}).encode()
        with replaced_hdf5_file(path) as file, deferred_interrupts():
            checksum = checksum_of(document, {"states": self.states})
            file.attrs.update({"format": FORMAT, "version": VERSION, "checksum": checksum})
            file["document"] = np.frombuffer(document, np.uint8)
            file["states"] = self.states

    @classmethod
    def load(cls, path: str | os.PathLike) -> StatesFile:
        """Read a file and check it."""
        if not Path(path).is_file():
            raise InputError(f"{path}: there is no such file; save states by save_states of a flow")
        if not h5py.is_hdf5(path):
            raise InputError(f"{path}: is no file of states, or its beginning is damaged; save states by save_states")
        try:
            with deferred_interrupts(), h5py.File(path, "r") as file:
                if file.attrs.get("format") != FORMAT:
                    raise InputError(f"{path}: is an HDF5 file, but no file of states; save states by save_states")
                if file.attrs["version"] > VERSION:
                    raise InputError(f"{path}: is of version {file.attrs['version']}; update the program")
                arrays = datasets_of(path, file)
                document = arrays.pop("document")[()].tobytes()
                if file.attrs["checksum"] != checksum_of(document, arrays):
                    raise ValueError("checksum")
                states = arrays["states"][()]
            found = json.loads(document)
            shapes = tuple(map(tuple, found["shapes"]))
            return cls(states, shapes, found["alpha"], found["Mach_number"], found["residual"])
        except InputError as error:
            raise error if str(error).startswith(str(path)) else InputError(f"{path}: {error}") from error
        except _DAMAGE as error:
            raise InputError(f"{path}: the states are damaged; run the flow without them and save it again") from error


def read_states(
    path: str | os.PathLike,  # file that `StatesFile.save` made
    topology: Topology,  # topology of the grid
) -> tuple[np.ndarray, float]:  # states: (n_cells, 5), states of all cells; alpha: their angle of attack (deg)
    """Read states for a grid: its own, or interpolated in index space from another member of its family."""
    file = StatesFile.load(path)
    if file.shapes == tuple(map(tuple, topology.shapes)):
        return file.states, file.alpha
    member = _member(topology, file.shapes)
    if member is None:
        raise InputError(
            f"{path}: the states are of a grid of {len(file.shapes)} blocks and {len(file.states)} cells that is no "
            f"member of the family of {topology.source}; give states of that grid, or start without them"
        )
    # piecewise means, not polynomials: densities and pressures stay positive, even at shocks
    return CellTransfer.of(member, topology).spread(file.states), file.alpha


def _member(topology: Topology, shapes: Sequence[tuple[int, ...]]) -> Topology | None:
    """Topology of the member of the family with these shapes, if there is one."""
    if len(shapes) != len(topology.shapes):
        return None
    ratio = _edges(shapes) / _edges(topology.shapes)
    tried = {Fraction(p, q) for p in range(1, LARGEST + 1) for q in range(1, LARGEST + 1)}
    for factor in sorted(tried, key=lambda one: abs(math.log(one / ratio))):
        if IndexScaling.of(topology, float(factor)).shapes == shapes:
            return refined_topology(topology, float(factor))
    return None


def _edges(shapes: Sequence[tuple[int, ...]]) -> int:
    """Cells along the edges of all blocks."""
    return sum(n - 1 for shape in shapes for n in shape)
