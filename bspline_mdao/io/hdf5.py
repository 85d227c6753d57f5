"""Write HDF5 files whole or not at all, and lose no interrupt from the keyboard in h5py."""

from __future__ import annotations

import io
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import h5py

from .atomic import replaced_file

__all__ = ["held_interrupts", "replaced_hdf5_file"]


@contextmanager
def held_interrupts() -> Iterator[None]:
    """Hold an interrupt from the keyboard back until the block ends.

    The first Python code that runs after a call of the HDF5 library is often a callback of one of h5py's weak
    references, and Python drops what is raised there.
    """
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield
        return
    received = []
    signal.signal(signal.SIGINT, lambda *arguments: received.append(arguments))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if received:
            handler(*received[0])


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
        When the file cannot be written, see `bspline_mdao.io.atomic.replaced_file`.
    """
    buffer = io.BytesIO()
    with held_interrupts():
        file = h5py.File(buffer, "w", track_order=True)
    try:
        yield file
    finally:
        with held_interrupts():
            file.close()
    with replaced_file(path) as temporary:
        temporary.write_bytes(buffer.getvalue())
