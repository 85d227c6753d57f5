"""The file of a fitted model in parts: parameters and residual of some nodes are read by slices, and written in turns.

HDF5 as it is installed with h5py lets many processes read a file at once, but only one write. So the first makes the
file with room for everything, one after the other writes its part, and the file takes its name when all have done so.
The result is the same file as from `bspline_mdao.core.model.model_file.write_model`, and each module reads the other's.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ...base.numerics.processes import together
from ...errors import InputError
from ...grids.io.disk import deferred_interrupts, replaced_file
from ...grids.topology.topology import Topology
from .model_file import (
    arrays_of,
    attributes_of,
    check_parameters,
    checksum_of,
    damaged_is_input_error,
    dataset_options,
    document_of,
    is_of_grid,
    opened_model,
)

__all__ = ["ModelParts", "opened_parts", "write_by_turns"]

DENSE = 8
"""A box that is read may have this many times the requested nodes."""


@contextmanager
def opened_parts(
    path: str | os.PathLike,  # the file
    topology: Topology,  # its topology, see `bspline_mdao.core.model.model_file.read_fields`
) -> Iterator[ModelParts]:
    """Open the file of a model to read parts of it; any damage is an `InputError`."""
    with damaged_is_input_error(path), opened_model(path) as file:
        yield ModelParts(file, topology)


@dataclass(frozen=True, eq=False)
class ModelParts:
    """Parameters and residual in the file of a model."""

    file: h5py.File  # the file
    topology: Topology  # its topology

    def parameters_at(self, segment: int, places: np.ndarray) -> np.ndarray:
        """Parameters, shape (n, 3), of nodes of a segment by their places in its C order."""
        data = self.file[f"parameters/{segment}"]
        values = _at(data, np.unravel_index(places, self.topology.segments[segment].shape))
        check_parameters(self.topology, segment, data.shape, values)
        return values

    def residual_at(self, rows: np.ndarray) -> np.ndarray:
        """Residual (m), shape (n, 3), of nodes by their rows in the grid vector, ascending."""
        data, ends = self.file["residual"], np.searchsorted(rows, self.topology.layout.starts)
        parts = [_at(data, (rows[start:stop],)) for start, stop in zip(ends, ends[1:]) if start < stop]
        return np.concatenate([np.zeros((0, 3)), *parts])

    def iblank_of(self, block: int) -> np.ndarray | None:
        """Blanking of a block, if it has one."""
        name = f"iblank/{block}"
        return self.file[name][()] if name in self.file else None


def _at(data: h5py.Dataset, indices: tuple[np.ndarray, ...]) -> np.ndarray:
    """Values at some indices along the first axes, shape (n, ...), from boxes that hold little else."""
    # Nodes on the ends of an axis and in the layers next to them, as on faces of blocks, are read by layers, the rest
    # in one box.
    values = np.empty((len(indices[0]), *data.shape[len(indices) :]), data.dtype)
    left = np.arange(len(values))
    if len(left) * DENSE < math.prod(data.shape[: len(indices)]):
        for d, n in enumerate(data.shape[: len(indices)] if len(indices) > 1 else ()):
            for layer in {0, 1, n - 2, n - 1}:
                is_there = indices[d][left] == layer
                _read_box(data, indices, left[is_there], values)
                left = left[~is_there]
    _read_box(data, indices, left, values)
    return values


def _read_box(data: h5py.Dataset, indices: tuple[np.ndarray, ...], which: np.ndarray, values: np.ndarray) -> None:
    """Read some of the indices, all from the smallest box that contains them."""
    if len(which):
        wanted = [index[which] for index in indices]
        low = [int(index.min()) for index in wanted]
        box = data[tuple(slice(lo, int(index.max()) + 1) for lo, index in zip(low, wanted))]
        values[which] = box[tuple(index - lo for lo, index in zip(low, wanted))]


def write_by_turns(
    path: str | os.PathLike,  # the file, on a disk that all processes see
    comm: Any,  # the processes, all of which call this
    # fields of a `bspline_mdao.core.model.fitted_model.FittedModel` by name, without parameters; its residual is None
    # if none is kept, the blanking of its header only of the blocks here
    fields: Mapping[str, Any],
    # arrays of this process by their names in the file; ``residual/<block>`` stands for the rows of a block
    parts: Mapping[str, np.ndarray],
    compress: bool = True,  # compress the arrays
) -> None:
    """Write a model distributed over processes; an existing file is replaced only when the new one is complete."""
    # `InputError` on all processes if the file cannot be written, or the model's knots are the user's functions
    arrays, document = _room_for(comm, fields), document_of(**fields)
    slices = fields["topology"].layout.slices
    with ExitStack() as stack:
        made: Path | None = None
        with together(comm):
            if comm.rank == 0:
                made = stack.enter_context(replaced_file(path))
                _make(made, path, arrays, dataset_options(compress), document, attributes_of(**fields))
        made = comm.bcast(made) if comm.size > 1 else made
        for rank in range(comm.size):
            with together(comm):
                if rank == comm.rank:
                    _write_parts(made, path, parts, slices)
        with together(comm):
            if comm.rank == 0:
                with deferred_interrupts(), h5py.File(made, "r+") as file:
                    file.attrs["checksum"] = checksum_of(document, {name: file[name] for name in arrays})
                stack.close()


def _room_for(comm: Any, fields: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Arrays of a model by their names in the file; those of the grid's size only give their shapes."""
    topology, header = fields["topology"], fields["header"]
    zero = np.zeros(1)
    parameters = [np.broadcast_to(zero, (*segment.shape, 3)) for segment in topology.segments]
    residual = None if fields["residual"] is None else np.broadcast_to(zero, (topology.n_nodes, 3))
    has_iblank = [iblank is not None for iblank in header.iblanks]
    if comm.size > 1:
        has_iblank = np.any(comm.allgather(has_iblank), axis=0).tolist()
    arrays = arrays_of(**{**fields, "parameters": parameters, "residual": residual})
    whole = np.zeros(1, np.int32)
    shapes = {f"iblank/{b}": shape for b, shape in enumerate(topology.shapes) if has_iblank[b]}
    return arrays | {name: np.broadcast_to(whole, shape) for name, shape in shapes.items()}


def _make(
    made: Path,
    path: str | os.PathLike,
    arrays: Mapping[str, np.ndarray],
    options: Mapping[str, Any],
    document: bytes,
    attributes: Mapping[str, object],
) -> None:
    """Make a file with all small arrays, and room for the others."""
    needed, free = sum(array.nbytes for array in arrays.values()), shutil.disk_usage(made.parent).free
    if needed > free:  # the HDF5 library ends the process when a disk is full
        raise InputError(f"{path}: needs up to {needed} bytes, and the disk has {free} left; choose another place")
    with deferred_interrupts(), h5py.File(made, "w", track_order=True) as file:
        file.attrs.update({**attributes, "checksum": ""})
        file["document"] = np.frombuffer(document, np.uint8)
        for name, array in arrays.items():
            if is_of_grid(name):
                file.create_dataset(name, array.shape, array.dtype, **options)
            else:
                file.create_dataset(name, data=array, **options)


def _write_parts(
    made: Path | None, path: str | os.PathLike, parts: Mapping[str, np.ndarray], slices: Sequence[slice]
) -> None:
    """Write the arrays of this process into the file."""
    try:
        with deferred_interrupts(), h5py.File(made, "r+") as file:
            for name, array in parts.items():
                kind, _, number = name.partition("/")
                if kind == "residual":
                    file["residual"][slices[int(number)]] = array
                else:
                    file[name][...] = array
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); choose another place") from error
