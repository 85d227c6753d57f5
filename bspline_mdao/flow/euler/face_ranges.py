"""Sums over faces on several threads: each takes a range of faces and adds to an array of its own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...numerics.threads import run_tasks, thread_count

FACES_PER_THREAD = 10_000
"""Faces below which a thread is not worth its start."""


def face_ranges(n_faces: int) -> list[slice]:
    """Cut the list of faces into as many equal ranges as there are threads."""
    n = max(1, min(thread_count(None), n_faces // FACES_PER_THREAD))
    ends = [n_faces * k // n for k in range(n + 1)]
    return [slice(*pair) for pair in zip(ends[:-1], ends[1:])]


def visit_faces(n_faces: int, task: Callable[[slice], None]) -> None:
    """Call ``task(range)`` for all ranges, on as many threads."""
    ranges = face_ranges(n_faces)
    run_tasks(lambda n: task(ranges[n]), len(ranges), len(ranges))


def sum_over_faces(n_faces: int, task: Callable[[slice, np.ndarray], None], like: np.ndarray) -> np.ndarray:
    """Sum what ``task(range, out)`` adds to zeros, in the order of the ranges.

    Parameters
    ----------
    n_faces : int
    task : callable
        Must release the interpreter lock.
    like : ndarray
        Array of the shape and type of the sum.
    """
    ranges = face_ranges(n_faces)
    parts = [np.zeros_like(like) for _ in ranges]
    run_tasks(lambda n: task(ranges[n], parts[n]), len(ranges), len(ranges))
    for part in parts[1:]:
        parts[0] += part
    return parts[0]
