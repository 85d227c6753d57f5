"""Several processes: the communicator of one process, failures raised together by all, and sums over all.

Kernels take an mpi4py communicator, or anything with its ``rank`` and ``size``, and do not depend on mpi4py themselves.
One process needs none: `ONE`, and everything with a ``size`` of 1, such as OpenMDAO's stand-in, sends nothing.

A process that raises while others wait for it in a collective call leaves them waiting forever. So whatever may fail on
only one process is done inside `together`, between collective calls::

    with together(comm):
        part = local_part(own_values)  # may raise, and sends nothing
    total = summed(comm, part)

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the command line's help, which needs the number of processes, does not wait for NumPy
    import numpy as np

__all__ = [
    "ONE",
    "OneProcess",
    "from_all",
    "from_first",
    "gathered",
    "largest",
    "n_launched",
    "norm",
    "on_first",
    "summed",
    "summed_number",
    "together",
    "world",
]

SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS", "SLURM_STEP_NUM_TASKS", "MP_PROCS", "FJMPI_PROCS")
"""Environment variables in which MPI launchers store the number of processes."""


class OneProcess:
    """Communicator of a single process."""

    rank = 0
    size = 1


ONE = OneProcess()


def world() -> Any:
    """Return the communicator of all processes started by an MPI launcher.

    Returns
    -------
    communicator
        mpi4py's communicator; without a launcher one process, with ``rank`` 0 and ``size`` 1.

    Examples
    --------
    >>> from bspline_mdao.parallel import world
    >>> world().rank < world().size
    True
    """
    # mpi4py is imported only if the environment says that there are several.
    if n_launched() < 2:
        return ONE
    try:
        from mpi4py import MPI
    except ImportError as error:
        raise ImportError('several processes need mpi4py: pip install "bspline_mdao[mpi]"') from error
    return MPI.COMM_WORLD


def n_launched() -> int:
    """Number of processes started by an MPI launcher."""
    return max((int(os.environ[name]) for name in SIZES if os.environ.get(name, "").isdigit()), default=1)


@contextmanager
def together(comm: Any) -> Iterator[None]:
    """Raise the exception of one process on all of them, in a body without collective calls.

    Nested in another one it does nothing; the outer one acts.

    Parameters
    ----------
    comm : communicator
        The processes, all of which must call this.

    Raises
    ------
    Exception
        The exception of the failed process of lowest rank, with its message, on all processes. On the others an
        exception that cannot be sent becomes a RuntimeError.

    Examples
    --------
    >>> from bspline_mdao.parallel import together, world
    >>> with together(world()):
    ...     part = 2.0  # what may fail on some process
    """
    if comm.size == 1 or _INSIDE.get():
        yield
        return
    failure, token = None, _INSIDE.set(True)
    try:
        yield
    except Exception as error:
        failure = error
    finally:
        _INSIDE.reset(token)
    first = _first_that(comm, failure is not None)
    if first == comm.size:
        return
    sent = comm.bcast(_packed(failure) if comm.rank == first else None, root=first)
    if comm.rank == first and failure is not None:
        raise failure
    raise pickle.loads(sent) from failure


_INSIDE: ContextVar[bool] = ContextVar("inside together", default=False)


def _first_that(comm: Any, is_so: bool) -> int:
    """Lowest rank for which something is true; the number of processes if there is none."""
    import numpy as np

    flags = np.zeros(comm.size, dtype=np.int8)
    flags[comm.rank] = is_so
    flags = summed(comm, flags)
    return int(flags.argmax()) if flags.any() else comm.size


def _packed(failure: Exception | None) -> bytes:
    """An exception as bytes; a RuntimeError with its message if it cannot be unpacked elsewhere."""
    try:
        packed = pickle.dumps(failure)
        pickle.loads(packed)
    except Exception:
        packed = pickle.dumps(RuntimeError(f"{type(failure).__name__}: {failure}"))
    return packed


def summed(comm: Any, array: np.ndarray) -> np.ndarray:
    """Sum an array over all processes, with the same bits on every one.

    Parameters
    ----------
    comm : communicator
        The processes, all of which must call this.
    array : ndarray
        Array of the same shape on all of them.

    Returns
    -------
    ndarray
        The sum; the array itself if there is one process.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.parallel import summed, world
    >>> comm = world()
    >>> summed(comm, np.ones(2)) / comm.size
    array([1., 1.])
    """
    if comm.size == 1:
        return array
    import numpy as np

    total = np.empty_like(array, order="C")
    comm.Allreduce(np.ascontiguousarray(array), total)
    return total


def summed_number(comm: Any, number: float) -> float:
    """Sum of one number per process, on all processes with the same bits."""
    return number if comm.size == 1 else comm.allreduce(number)


def gathered(
    comm: Any,  # communicator, the processes
    array: np.ndarray,  # (n, ...), n may differ between processes
) -> np.ndarray:  # (sum of n, ...)
    """Concatenated rows of the arrays of all processes, on all processes."""
    import numpy as np

    return np.concatenate(from_all(comm, array))


def from_all(comm: Any, item: Any) -> list:
    """Gather a value from every process, in the order of ranks, on all of them.

    Parameters
    ----------
    comm : communicator
        The processes, all of which must call this.
    item : object
        Value of this process; it is pickled.

    Returns
    -------
    list
        One value per process.

    Examples
    --------
    >>> from bspline_mdao.parallel import from_all, world
    >>> comm = world()
    >>> from_all(comm, comm.rank) == list(range(comm.size))
    True
    """
    return [item] if comm.size == 1 else comm.allgather(item)


def from_first(comm: Any, value: Any) -> Any:
    """The first process's value, on all processes."""
    return value if comm.size == 1 else comm.bcast(value, root=0)


def node_of(comm: Any) -> Any:
    """Communicator of the processes that share memory with this one; the caller frees it."""
    from mpi4py import MPI

    return comm.Split_type(MPI.COMM_TYPE_SHARED)


def norm(array: np.ndarray, comm: Any = ONE) -> float:
    """Euclidean norm of an array distributed by rows; the same bits on all processes."""
    import numpy as np

    if comm.size == 1:
        return float(np.linalg.norm(array))
    return float(np.sqrt(summed(comm, np.array([np.linalg.norm(array) ** 2]))[0]))


def largest(comm: Any, value: float) -> float:
    """Largest number over all processes, on all processes."""
    return float(value) if comm.size == 1 else float(max(comm.allgather(float(value))))


def on_first(comm: Any, task: Callable[[], Any]) -> Any:
    """Result of a task that the first process does for all; all raise what it raises."""
    if comm.size == 1:
        return task()
    result = None
    with together(comm):
        if comm.rank == 0:
            result = task()
    return from_first(comm, result)
