"""Kernels on several threads.

Plain Python threads drive kernels that release the interpreter lock. numba's own ``parallel=True`` is not used: its
only layer without further dependencies ends the process when two user threads call it at the same time, and the OpenMP
layer ends it after a fork.
"""

from __future__ import annotations

import itertools
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from typing import Any, TypeVar

import numba
from threadpoolctl import ThreadpoolController

Item = TypeVar("Item")
Result = TypeVar("Result")


def thread_count(n_threads: int | None) -> int:
    """Return the number of threads to use: the one given, or by default ``NUMBA_NUM_THREADS``."""
    return max(1, numba.config.NUMBA_NUM_THREADS if n_threads is None else n_threads)


class Crew:
    """Threads kept for several rounds of tasks; a context. The caller's thread is one of them."""

    def __init__(self, n_threads: int):
        self._n_others = n_threads - 1
        self._pool = ThreadPoolExecutor(self._n_others) if self._n_others > 0 else None

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._pool is not None:
            self._pool.shutdown()

    def run(
        self,
        task: Callable,  # callable, must not depend on the order of the calls
        n_tasks: int,  # number of calls
    ) -> None:
        """Call ``task(0) .. task(n_tasks - 1)``, each once, and return when all are done."""
        numbers, is_over = itertools.count(), threading.Event()

        def work() -> None:
            for number in iter(numbers.__next__, None):
                if number >= n_tasks or is_over.is_set():
                    return
                task(number)

        n_others = min(self._n_others, n_tasks - 1)
        others = [] if self._pool is None else [self._pool.submit(work) for _ in range(n_others)]
        try:
            work()
        except BaseException:  # a keyboard interrupt, which must not wait until everything is done
            is_over.set()
            raise
        finally:  # tasks not yet begun would find nothing to do, and may be queued behind others that wait for them
            begun = [other for other in others if not other.cancel()]
            wait(begun)
        for other in begun:
            other.result()


def run_tasks(task: Callable[[Item], Result], items: Sequence[Item], n_threads: int) -> list[Result]:
    """Results of ``task(item)`` for every item, in order, on up to ``n_threads`` threads; see `Crew.run`."""
    # The threads are kept for the next call: starting one takes as long as a product with a matrix of some thousand
    # rows.
    n_threads = min(n_threads, len(items))
    if n_threads < 2:
        return list(map(task, items))
    results: list[Any] = [None] * len(items)

    def run(number: int) -> None:
        results[number] = task(items[number])

    _crew(n_threads, os.getpid()).run(run, len(items))  # threads are not copied into a forked process
    return results


@cache
def _crew(n_threads: int, process: int) -> Crew:
    """The kept threads of a process."""
    return Crew(n_threads)


def map_tasks(
    task: Callable,  # callable, must not depend on the order of the calls
    items: Sequence,  # its arguments
    n_threads: int,  # number of threads; with one, the caller's does everything
) -> Iterator:
    """Yield ``task(item)`` of every item, in order; up to ``n_threads`` threads work ahead."""
    if min(n_threads, len(items)) < 2:
        yield from map(task, items)
        return
    with ThreadPoolExecutor(min(n_threads, len(items))) as pool:
        futures = [pool.submit(task, item) for item in items]
        try:
            for future in futures:
                yield future.result()
        finally:  # after an error or a keyboard interrupt nothing new is begun
            for future in futures:
                future.cancel()


class _BlasLimit:
    """Context in which BLAS uses one thread, however many user threads are inside at a time."""

    # The limit is per process: the first thread in sets it, and the last one out restores the old value. If each
    # restored what it found, a thread that leaves would remove the limit from threads still inside, whose sums would
    # then be split differently. threadpoolctl lets only the thread that first changed a limit change it again, as long
    # as that thread lives, so it is done in threads that end at once. A limit set by the user stays; if it is one
    # thread, as in test workers, there is nothing to do, and no thread is started.

    def __init__(self) -> None:
        self._lock, self._n_inside = threading.Lock(), 0
        self._restore: Any = None

    def __enter__(self) -> None:
        with self._lock:
            if self._n_inside == 0 and any(blas.num_threads != 1 for blas in _libraries().lib_controllers):
                self._restore = _in_a_thread(lambda: _libraries().limit(limits=1))
            self._n_inside += 1

    def __exit__(self, *exception: object) -> None:
        with self._lock:
            self._n_inside -= 1
            if self._n_inside == 0 and self._restore is not None:
                _in_a_thread(self._restore.restore_original_limits)
                self._restore = None


one_blas_thread = _BlasLimit()


@cache
def _libraries() -> ThreadpoolController:
    """BLAS libraries; finding them takes a millisecond, as long as a small solution."""
    return ThreadpoolController().select(user_api="blas")


def _in_a_thread(task: Callable) -> Any:
    """Call a function in a thread that ends afterwards; return its result, or raise what it raises."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(task).result()
