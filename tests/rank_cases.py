"""Ranks that are threads of one process: a communicator with the calls of mpi4py that the package makes."""

import copy
import queue
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np

PATIENCE = 60.0
"""Time (s) after which a rank that waits for others in vain fails."""


class _Request:
    def __init__(self, finish=lambda: None):
        self.Wait = finish


class _Shared:
    def __init__(self, size):
        self.size = size
        self.barrier = threading.Barrier(size, timeout=PATIENCE)
        self.given = [None] * size
        self.mail = {(a, b): queue.Queue() for a in range(size) for b in range(size)}


class ThreadRank:
    """One rank; what it sends is copied."""

    def __init__(self, shared, rank):
        self._shared, self.rank, self.size = shared, rank, shared.size
        self.n_sent = 0

    def allgather(self, value):
        self._shared.given[self.rank] = value
        self._shared.barrier.wait()
        values = copy.deepcopy(self._shared.given)
        self._shared.barrier.wait()
        return values

    def gather(self, value, root=0):
        values = self.allgather(value)
        return values if self.rank == root else None

    def allreduce(self, value):
        first, *others = self.allgather(value)
        return sum(others, first)

    def bcast(self, value, root=0):
        return self.allgather(value)[root]

    def alltoall(self, values):
        return [row[self.rank] for row in self.allgather(values)]

    def Allreduce(self, array, total, op=None):
        first, *others = parts = self.allgather(np.array(array))
        assert {part.shape for part in parts} == {total.shape}, "ranks reduce arrays of different shapes"
        total[...] = sum(others, first) if op is None else np.min([first, *others], axis=0)

    def Isend(self, array, dest):
        assert array.flags.c_contiguous
        self.n_sent += array.nbytes
        self._shared.mail[self.rank, dest].put(array.copy())
        return _Request()

    def Irecv(self, array, source):
        assert array.flags.c_contiguous

        def finish():
            np.copyto(array, self._shared.mail[source, self.rank].get(timeout=PATIENCE), casting="no")

        return _Request(finish)


def on_ranks(n, task):
    """Results of ``task(comm)`` on every rank; what the first rank that fails raises otherwise."""
    shared = _Shared(n)

    def run(rank):
        try:
            return task(ThreadRank(shared, rank))
        except BaseException:
            shared.barrier.abort()
            raise

    with ThreadPoolExecutor(n) as pool:
        futures = [pool.submit(run, rank) for rank in range(n)]
    failures = [future.exception() for future in futures if future.exception()]
    for failure in failures:
        if not isinstance(failure, (threading.BrokenBarrierError, queue.Empty)):
            raise failure
    return [future.result() for future in futures]
