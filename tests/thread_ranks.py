"""Several ranks in one process: each is a thread, with a communicator that does what mpi4py's does."""

import copy
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

LIMIT = 60.0
"""Time (s) that a rank waits for the others."""


class ThreadRank:
    """Communicator of one of several threads; objects are copied on their way, as they are between processes."""

    def __init__(self, rank: int, size: int, barrier: threading.Barrier, table: list):
        self.rank, self.size = rank, size
        self._barrier, self._table = barrier, table

    def allgather(self, item) -> list:
        """What every rank gives."""
        self._table[self.rank] = item
        self._barrier.wait()
        items = copy.deepcopy(self._table)
        self._barrier.wait()
        return items

    def gather(self, item, root: int = 0) -> list | None:
        """What every rank gives, on one of them."""
        items = self.allgather(item)
        return items if self.rank == root else None

    def bcast(self, item, root: int = 0):
        """What one rank gives."""
        return self.allgather(item)[root]

    def Allreduce(self, array: np.ndarray, total: np.ndarray) -> None:
        """Sum over the ranks, in their order."""
        arrays = self.allgather(array)
        assert {part.shape for part in arrays} == {total.shape}, "ranks reduce arrays of different shapes"
        total[...] = sum(arrays[1:], start=arrays[0])


def on_ranks(n: int, task: Callable) -> list:
    """Results of ``task(comm)`` on ``n`` ranks at a time; what the first one raises is raised here."""
    barrier, table = threading.Barrier(n, timeout=LIMIT), [None] * n

    def run(rank):
        try:
            return task(ThreadRank(rank, n, barrier, table))
        except BaseException:
            barrier.abort()  # or the others would wait for it
            raise

    with ThreadPoolExecutor(n) as pool:
        futures = [pool.submit(run, rank) for rank in range(n)]
    errors = [future.exception() for future in futures if future.exception() is not None]
    for error in sorted(errors, key=lambda error: isinstance(error, threading.BrokenBarrierError)):
        raise error
    return [future.result() for future in futures]
