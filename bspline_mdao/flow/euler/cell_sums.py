"""Sums over the faces of every cell, and work on ranges of faces and cells on several threads.

Contributions of faces are stored face by face first, then summed cell by cell, in the order of the faces: no two
threads write to the same number, and sums are bitwise the same on any number of threads.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from ...base.numerics.threads import run_tasks, thread_count
from ...base.numerics.vec5 import add_scaled, load, prefetch, store, zeros

__all__ = ["CellSums", "visit"]

PER_TASK, TASKS_PER_THREAD = 8_192, 4
"""Smallest number of faces or cells of a task, below which a thread is not worthwhile, and most tasks per thread."""

AHEAD = 24
"""Entries ahead of the current one whose numbers are prefetched."""


@dataclass(frozen=True, eq=False)
class CellSums:
    """Faces of every cell, and faces whose stencils a cell is in."""

    # (n_cells + 1,) of int, start of the faces of each cell, including cells of other processes
    starts: np.ndarray
    entries: np.ndarray  # of int, faces, ascending; faces with the cell on the right as ``-1 - face``
    stencil_starts: np.ndarray  # (n_cells + 1,) of int, start of the stencils with each cell
    stencil_entries: np.ndarray  # of int, four times the face, plus the place of the cell in its stencil

    @classmethod
    def of(
        cls,
        # (n_faces, 4) of int, stencil of each face; the second is on its left, the third on its right
        cells: np.ndarray,
        has_right: np.ndarray,  # (n_faces,) of bool, whether there is a cell on its right
    ) -> CellSums:
        """List the faces."""
        return cls(*_list(cells, has_right, int(cells.max(initial=-1)) + 1))

    def of_faces(self, flux: np.ndarray, n_cells: int) -> np.ndarray:
        """Sum the outflow of cells, shape (n_cells, 5), from fluxes from left to right, shape (n_faces, 5)."""
        out = np.empty((n_cells, flux.shape[1]), flux.dtype)
        kernel = _sum_single_faces if flux.dtype == np.float32 else _sum_faces
        visit(n_cells, lambda part: kernel(self.starts, self.entries, flux, part.start, part.stop, out))
        return out

    def of_stencils(self, contributions: np.ndarray, n_cells: int) -> np.ndarray:
        """Sum numbers, shape (n_faces, 4, 5), for the four cells of every stencil: shape (n_cells, 5)."""
        out = np.empty((n_cells, contributions.shape[2]), contributions.dtype)
        index = self.stencil_starts, self.stencil_entries
        kernel = _sum_single_stencils if contributions.dtype == np.float32 else _sum_stencils
        visit(n_cells, lambda part: kernel(*index, contributions, part.start, part.stop, out))
        return out


def visit(
    n: int,
    task: Callable[[slice], None],  # must not depend on the order of the calls, and release the interpreter lock
    per_task: int | None = None,  # smallest size of a range; by default `PER_TASK`
) -> None:
    """Call ``task(range)`` for ranges of ``n`` numbers, on several threads."""
    n_threads = thread_count(None)
    n_tasks = max(1, min(TASKS_PER_THREAD * n_threads, n // (per_task or PER_TASK)))
    n_tasks -= n_tasks % n_threads if n_tasks > n_threads else 0  # equal numbers for all
    run_tasks(lambda k: task(slice(k * n // n_tasks, (k + 1) * n // n_tasks)), range(n_tasks), n_threads)


@njit(cache=True, error_model="numpy")
def _list(cells, has_right, n_cells):
    """Count, then list the faces of every cell and the stencils that contain it."""
    starts, stencil_starts = np.zeros(n_cells + 1, np.int64), np.zeros(n_cells + 1, np.int64)
    for f in range(len(cells)):
        starts[cells[f, 1] + 1] += 1
        if has_right[f]:
            starts[cells[f, 2] + 1] += 1
        for k in range(4):
            stencil_starts[cells[f, k] + 1] += 1
    starts, stencil_starts = np.cumsum(starts), np.cumsum(stencil_starts)
    entries, stencil_entries = np.empty(starts[-1], np.int32), np.empty(stencil_starts[-1], np.int32)
    ends, stencil_ends = starts[:-1].copy(), stencil_starts[:-1].copy()
    for f in range(len(cells)):
        entries[ends[cells[f, 1]]] = f
        ends[cells[f, 1]] += 1
        if has_right[f]:
            entries[ends[cells[f, 2]]] = -1 - f
            ends[cells[f, 2]] += 1
        for k in range(4):
            stencil_entries[stencil_ends[cells[f, k]]] = 4 * f + k
            stencil_ends[cells[f, k]] += 1
    return starts, entries, stencil_starts, stencil_entries


@njit(cache=True, error_model="numpy", nogil=True)
def _sum_faces(starts, entries, flux, first, end, out):
    for c in range(first, end):
        for n in range(out.shape[1]):
            out[c, n] = 0.0
        if c + 1 >= len(starts):
            continue
        for at in range(starts[c], starts[c + 1]):
            f = entries[at]
            for n in range(5):
                if f >= 0:
                    out[c, n] += flux[f, n]
                else:
                    out[c, n] -= flux[-1 - f, n]


@njit(cache=True, error_model="numpy", nogil=True)
def _sum_stencils(starts, entries, contributions, first, end, out):
    for c in range(first, end):
        for n in range(out.shape[1]):
            out[c, n] = 0.0
        if c + 1 >= len(starts):
            continue
        for at in range(starts[c], starts[c + 1]):
            f, k = entries[at] >> 2, entries[at] & 3
            for n in range(5):
                out[c, n] += contributions[f, k, n]


@njit(cache=True, error_model="numpy", nogil=True)
def _sum_single_faces(starts, entries, flux, first, end, out):
    """`_sum_faces` in single precision, in vectors of five."""
    last = len(entries) - 1
    for cell in range(first, end):
        total = zeros()
        if cell + 1 < len(starts):
            for at in range(starts[cell], starts[cell + 1]):
                f, next_face = entries[at], entries[min(at + AHEAD, last)]
                prefetch(flux, 5 * (next_face if next_face >= 0 else -1 - next_face))
                one = np.float32(1.0 if f >= 0 else -1.0)
                total = add_scaled(total, one, load(flux, 5 * (f if f >= 0 else -1 - f)))
        store(out, 5 * cell, total)


@njit(cache=True, error_model="numpy", nogil=True)
def _sum_single_stencils(starts, entries, contributions, first, end, out):
    """`_sum_stencils` in single precision, in vectors of five."""
    last = len(entries) - 1
    for cell in range(first, end):
        total = zeros()
        if cell + 1 < len(starts):
            for at in range(starts[cell], starts[cell + 1]):
                prefetch(contributions, 5 * entries[min(at + AHEAD, last)])
                total = add_scaled(total, np.float32(1.0), load(contributions, 5 * entries[at]))
        store(out, 5 * cell, total)
