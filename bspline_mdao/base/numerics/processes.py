"""Several processes: the communicator of one process, failures that all processes raise together, sums over them.

Kernels take a communicator of mpi4py, or what has its ``rank`` and ``size``, and know nothing of mpi4py themselves. One
process needs none: `ONE`, and everything with a ``size`` of 1, such as OpenMDAO's stand-in, sends nothing.

A process that raises while others wait for it in a collective call leaves them waiting for ever. So whatever may fail
on one process alone is done inside `together`, between collective calls::

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

if TYPE_CHECKING:  # help of the command line, which asks how many processes there are, does not wait for NumPy
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
"""Environment variables in which launchers of MPI tell the number of processes."""


class OneProcess:
    """Communicator of a process that is alone."""

    rank = 0
    size = 1


ONE = OneProcess()


def world() -> Any:
    """Communicator of all processes that a launcher of MPI has started.

    Returns
    -------
    communicator
        mpi4py's; where there is no launcher one process, with ``rank`` 0 and ``size`` 1.

    Examples
    --------
    >>> from bspline_mdao.parallel import world
    >>> world().rank < world().size
    True
    """
    # mpi4py is imported only where the environment says that there are several.
    if n_launched() < 2:
        return ONE
    try:
        from mpi4py import MPI
    except ImportError as error:
        raise ImportError('several processes need mpi4py: pip install "bspline_mdao[mpi]"') from error
    return MPI.COMM_WORLD


def n_launched() -> int:
    """Number of processes that a launcher of MPI has started."""
    return max((int(os.environ[name]) for name in SIZES if os.environ.get(name, "").isdigit()), default=1)


@contextmanager
def together(comm: Any) -> Iterator[None]:
    """Raise the exception of one process on all of them, in a body without collective calls.

    Within another one it does nothing: the outer one does it.

    Parameters
    ----------
    comm : communicator
        The processes, all of which come here.

    Raises
    ------
    Exception
        What the process of lowest rank that failed has raised, with its words: on that process itself, and on all
        others as well, where one that cannot be sent is a RuntimeError.

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
    """Lowest rank of which something is true; the number of processes where it is true of none."""
    import numpy as np

    flags = np.zeros(comm.size, dtype=np.int8)
    flags[comm.rank] = is_so
    flags = summed(comm, flags)
    return int(flags.argmax()) if flags.any() else comm.size


def _packed(failure: Exception | None) -> bytes:
    """An exception as bytes; a RuntimeError with its words where it cannot be unpacked elsewhere."""
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
        The processes, all of which come here.
    array : ndarray
        Of the same shape on all of them.

    Returns
    -------
    ndarray
        The sum; the array itself where there is one process.

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
    """Sum of a number of every process, on every one of them: the same bits everywhere."""
    return number if comm.size == 1 else comm.allreduce(number)


def gathered(
    comm: Any,  # communicator, the processes
    array: np.ndarray,  # (n, ...), n may differ between them
) -> np.ndarray:  # (sum of n, ...)
    """Rows of the arrays of all processes one after another, on every one of them."""
    import numpy as np

    return np.concatenate(from_all(comm, array))


def from_all(comm: Any, item: Any) -> list:
    """Gather a value from every process, in the order of ranks, on all of them.

    Parameters
    ----------
    comm : communicator
        The processes, all of which come here.
    item : object
        Of this process; it is pickled.

    Returns
    -------
    list
        One item of each.

    Examples
    --------
    >>> from bspline_mdao.parallel import from_all, world
    >>> comm = world()
    >>> from_all(comm, comm.rank) == list(range(comm.size))
    True
    """
    return [item] if comm.size == 1 else comm.allgather(item)


def from_first(comm: Any, value: Any) -> Any:
    """What the first process has, on all of them."""
    return value if comm.size == 1 else comm.bcast(value, root=0)


def node_of(comm: Any) -> Any:
    """Communicator of the processes that share memory with this one, of several; whoever asks frees it."""
    from mpi4py import MPI

    return comm.Split_type(MPI.COMM_TYPE_SHARED)


def norm(array: np.ndarray, comm: Any = ONE) -> float:
    """Euclidean norm of an array whose rows several processes hold; the same bits on all of them."""
    import numpy as np

    if comm.size == 1:
        return float(np.linalg.norm(array))
    return float(np.sqrt(summed(comm, np.array([np.linalg.norm(array) ** 2]))[0]))


def largest(comm: Any, value: float) -> float:
    """Largest of the numbers of all processes, on every one of them."""
    return float(value) if comm.size == 1 else float(max(comm.allgather(float(value))))


def on_first(comm: Any, task: Callable[[], Any]) -> Any:
    """Result of a task that the first process does for all; what it raises, all raise."""
    if comm.size == 1:
        return task()
    result = None
    with together(comm):
        if comm.rank == 0:
            result = task()
    return from_first(comm, result)
