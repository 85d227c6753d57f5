"""Kernels on several threads.

Plain Python threads drive kernels that release the interpreter lock. numba's own ``parallel=True`` is left alone: its
one layer that needs nothing beyond numba itself ends the process when two threads of the user's call it at a time, and
the OpenMP layer ends it after a fork.
"""

from __future__ import annotations

import itertools
import threading
from concurrent.futures import ThreadPoolExecutor

import numba


def thread_count(n_threads: int | None) -> int:
    """Return the number of threads to use: the one given, or by default ``NUMBA_NUM_THREADS``."""
    return max(1, numba.config.NUMBA_NUM_THREADS if n_threads is None else n_threads)


def run_tasks(task, n_tasks: int, n_threads: int):
    """Call ``task(0) .. task(n_tasks - 1)``, each once, on up to ``n_threads`` threads; the caller's is one of them.

    Parameters
    ----------
    task : callable
        Must not depend on the order of the calls.
    n_tasks, n_threads : int
        Number of calls and of threads.
    """
    numbers, is_over = itertools.count(), threading.Event()

    def work():
        for number in iter(numbers.__next__, None):
            if number >= n_tasks or is_over.is_set():
                return
            task(number)

    n_others = min(n_threads, n_tasks) - 1
    if n_others < 1:
        return work()
    with ThreadPoolExecutor(n_others) as pool:
        others = [pool.submit(work) for _ in range(n_others)]
        try:
            work()
        except BaseException:  # an interrupt from the keyboard, which is not to wait until all is done
            is_over.set()
            raise
    for other in others:
        other.result()
