"""Write HDF5 files whole or not at all."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager

import h5py

from .atomic import replaced_file


@contextmanager
def replaced_hdf5_file(path: str | os.PathLike) -> Iterator[h5py.File]:
    """Give an empty HDF5 file, which takes the place of ``path`` when the block ends well.

    It is kept in memory until then: the HDF5 library takes the process down with it when a disk is full.

    Parameters
    ----------
    path : path-like
        File to make or to replace.

    Yields
    ------
    h5py.File

    Raises
    ------
    InputError
        When the file cannot be written, see `bspline_mdao.grids.atomic.replaced_file`.
    """
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", track_order=True) as file:
        yield file
    with replaced_file(path) as temporary:
        temporary.write_bytes(buffer.getvalue())
