"""Sparse Cholesky factorisation: nested dissection, supernodes and multifrontal elimination.

Each stage has its own file: the order (`.ordering`, with separators from `.separators`), the elimination tree and the
supernodes (`.symbolic`), storage and schedule of their fronts (`.fronts`), and the arithmetic (`.multifrontal`).

Theory: ``docs/theory/sparse.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import zip_longest
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import DTypeLike

from ...errors import InputError, MovementError
from ..display import OneLine
from ..numerics.stopwatch import working_seconds
from ..numerics.threads import Crew, one_blas_thread, thread_count
from . import multifrontal
from .blocks import BlockMatrix, BlockPattern, LinearSolution, check_right, graph_of, residual_norm
from .conjugate_gradient import preconditioned_solve
from .fronts import Fronts, Stages, find_stages, lay_out
from .lapack import routines
from .multifrontal import rounds
from .ordering import fill_reducing_order
from .symbolic import Supernodes, find_supernodes

__all__ = ["Cholesky", "CholeskyAnalysis", "CholeskyFactor", "Memory"]


@dataclass(frozen=True)
class Cholesky(OneLine):
    """Direct solver that needs only numba and SciPy: the default.

    ``benchmarks/base/bench_cholesky.py`` compares it with PARDISO and SuperLU on control meshes.

    Parameters
    ----------
    single : bool, optional
        Factor in single precision, after scaling to unit diagonal, and solve by conjugate gradients with this factor as
        preconditioner: half the time and memory, but each solution takes three times as long.
    n_threads : int, optional
        Number of threads for a factorisation; ``NUMBA_NUM_THREADS`` by default. Results do not depend on it.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import Cholesky, LinearElasticity, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> LinearElasticity(mesh, solver=Cholesky(single=True)).solver
    Cholesky(single=True, n_threads=None)
    """

    single: bool = False
    n_threads: int | None = None

    @property
    def name(self) -> str:
        """Name of the solver in reports."""
        return "Cholesky, single precision" if self.single else "Cholesky"

    @property
    def threads(self) -> int:
        """Number of threads of a factorisation."""
        return thread_count(self.n_threads)

    def analyze(self, pattern: BlockPattern, points: np.ndarray) -> CholeskyAnalysis:
        """Find the order of elimination and the fronts of a pattern; points have shape (n, 3)."""
        graph = graph_of(pattern)
        supernodes = find_supernodes(*graph, fill_reducing_order(*graph))
        stages = find_stages(supernodes)
        fronts = lay_out(supernodes, stages, pattern.indptr, pattern.indices)
        return CholeskyAnalysis(self, pattern, supernodes, stages, fronts)


class Memory:
    """Reusable memory: fresh memory can take as long as the arithmetic that fills it."""

    # Lent memory returns when nothing refers to it any more, and is kept, as long as this object lives, for the next
    # request of its size. Memory of the first factorisation is not kept, since most first ones are also the last.
    # Threads may share one. Copies and pickles start empty.

    def __init__(self) -> None:
        self._idle: dict[int, list[np.ndarray]] = {}
        self._has_served = False

    def __reduce__(self) -> tuple[type[Memory], tuple[()]]:
        return Memory, ()

    def lend(self, size: int, dtype: DTypeLike) -> np.ndarray:
        """Array of shape (size,) with arbitrary contents."""
        n_bytes = size * np.dtype(dtype).itemsize
        idle = self._idle.setdefault(n_bytes, [])
        try:
            memory = idle.pop()
        except IndexError:
            memory = np.empty(n_bytes, np.uint8)
        return np.asarray(_Loan(memory, idle)).view(dtype)

    def end(self) -> None:
        """Report that a factorisation has ended."""
        if not self._has_served:
            self._idle, self._has_served = {}, True


class _Loan:
    """Base of an array and all its views; it is deleted with the last of these, and returns the memory."""

    def __init__(self, memory: np.ndarray, idle: list[np.ndarray]):
        self.memory, self.idle = memory, idle
        self.__array_interface__ = memory.__array_interface__

    def __del__(self) -> None:
        self.idle.append(self.memory)


@dataclass(frozen=True, eq=False)
class CholeskyAnalysis(OneLine):
    """The factorisation of a pattern: everything that does not depend on numbers."""

    settings: Cholesky
    pattern: BlockPattern
    supernodes: Supernodes
    stages: Stages
    fronts: Fronts
    # memory of deleted factors and factorisations, for the next ones
    memory: Memory = field(default_factory=Memory, repr=False)

    @property
    def n_factor(self) -> int:
        """Number of entries in the factor."""
        return int(self.fronts.panel_starts[-1])

    @property
    def factor_bytes(self) -> int:
        """Memory of a factor (bytes), known before there is a matrix."""
        return self.n_factor * self._itemsize

    @property
    def work_bytes(self) -> int:
        """Memory of a factorisation in addition to the factor (bytes): the updates, and scratch for every thread."""
        return (self.fronts.n_kept + self.settings.threads * self.fronts.n_scratch) * self._itemsize

    @property
    def _itemsize(self) -> int:
        return np.dtype(np.float32 if self.settings.single else np.float64).itemsize

    def factorize(self, matrix: BlockMatrix) -> CholeskyFactor:
        """Factor a matrix of the pattern. `MovementError` if the matrix is not positive definite."""
        if matrix.pattern is not self.pattern:
            raise InputError("Cholesky: the matrix has another pattern; analyze its own")
        try:
            return self._factorized(matrix)
        finally:
            self.memory.end()

    def _factorized(self, matrix: BlockMatrix) -> CholeskyFactor:
        """Factor in single precision first, if requested."""
        if self.settings.single:
            scale = _inverse_root_diagonal(self.pattern.indptr, matrix.data)
            scaled = _scaled_blocks(self.pattern.indptr, self.pattern.indices, matrix.data, scale)
            panels, failed = self._factor(scaled)  # rounded to single precision, a matrix may become indefinite
            if failed < 0:
                return CholeskyFactor(self, matrix, panels, scale)
        panels, failed = self._factor(matrix.data)
        if failed >= 0:
            row = self.supernodes.order[failed] + 1
            raise MovementError(
                f"Cholesky: the matrix is not positive definite, or not finite, at block row {row}; "
                "look for an inverted or collapsed element there, or for a point that nothing holds"
            )
        return CholeskyFactor(self, matrix, panels, None)

    def _factor(self, data: np.ndarray) -> tuple[np.ndarray, int]:
        """Factor in the precision of the blocks; return the position of the first non-positive pivot, or -1."""
        memory, fronts = self.memory, self.fronts
        panels, kept = memory.lend(self.n_factor, data.dtype), memory.lend(fronts.n_kept, data.dtype)
        structure = self.supernodes, fronts, routines(data.dtype), data, panels, kept
        failed = np.full(len(self.supernodes.parents), -1)
        ranges, starts = self.stages

        def factor_branch(number: int) -> None:
            first, last = ranges[number]
            scratch = memory.lend(fronts.n_scratch, data.dtype)
            failed[first] = multifrontal.factorize(first, last, *structure, scratch)

        with one_blas_thread, Crew(self.settings.threads) as crew:
            crew.run(factor_branch, int(starts[1]))
            for start, end in zip(starts[1:], starts[2:]):
                trunk = [rounds(int(s), *structure, failed) for s, _ in ranges[start:end]]
                for parts in zip_longest(*trunk, fillvalue=()):
                    if (failed >= 0).any():
                        break
                    tasks = [task for part in parts for task in part]
                    crew.run(lambda number, tasks=tasks: tasks[number](), len(tasks))
        return panels, int(failed[failed >= 0].min()) if (failed >= 0).any() else -1


@dataclass(frozen=True, eq=False)
class CholeskyFactor:
    """Cholesky factor of a matrix."""

    analysis: CholeskyAnalysis
    matrix: BlockMatrix  # the factored matrix
    panels: np.ndarray  # (n_factor,), the factor, in double or in single precision
    # factors applied to rows and columns of the matrix before factoring in single precision
    scale: np.ndarray | None = None  # (n, 3), or None

    @property
    def n_bytes(self) -> int:
        """Memory of the factor in bytes."""
        return self.panels.nbytes

    @cached_property
    def cancellation(self) -> float:
        """Largest ratio of a diagonal entry of the matrix to its remainder after elimination."""
        # Times the unit round-off it approximates the relative error of a solution; scaling the matrix does not change
        # it.
        pattern, supernodes = self.matrix.pattern, self.analysis.supernodes
        pivots = multifrontal.pivots(supernodes, self.analysis.fronts, self.panels)
        diagonal = np.einsum("ncc->nc", self.matrix.data[pattern.indptr[1:] - 1])[supernodes.order]
        if self.scale is not None:
            diagonal = diagonal * self.scale[supernodes.order] ** 2
        return float(np.max(diagonal / pivots, initial=1.0))

    def apply(self, right: np.ndarray) -> np.ndarray:
        """Solve with the factor as it is, shape (n, 3) or (n, 3, m): a preconditioner."""
        if self.scale is None:
            return self._substitute(right)
        scale = self.scale.reshape(self.scale.shape + (1,) * (right.ndim - 2))
        scaled = scale * right
        largest = np.abs(scaled).max(initial=0.0) or 1.0
        return largest * (scale * self._substitute(scaled / largest))

    def _substitute(self, right: np.ndarray) -> np.ndarray:
        """Solve with the factor as it is stored, by forward and backward substitution."""
        supernodes, dtype = self.analysis.supernodes, self.panels.dtype
        ranges, starts = self.analysis.stages
        firsts, n_sides = supernodes.firsts, int(np.prod(right.shape[2:]))
        x = right[supernodes.order].reshape(3 * len(right), n_sides).astype(dtype)
        structure = firsts, supernodes.row_starts, supernodes.rows, self.analysis.fronts.panel_starts, routines(dtype)
        stages = [ranges[start:end] for start, end in zip(starts, starts[1:])]
        with one_blas_thread, Crew(self.analysis.settings.threads) as crew:
            for tasks in stages:
                later = [np.zeros((len(x) - 3 * firsts[last], n_sides), dtype) for _, last in tasks]

                def forward(task: int, tasks: Any = tasks, later: Any = later) -> None:
                    multifrontal.solve_forward(*tasks[task], *structure, self.panels, x, later[task])

                crew.run(forward, len(tasks))
                for (_, last), part in zip(tasks, later):
                    x[3 * firsts[last] :] -= part
            for tasks in reversed(stages):

                def backward(task: int, tasks: Any = tasks) -> None:
                    multifrontal.solve_backward(*tasks[task], *structure, self.panels, x)

                crew.run(backward, len(tasks))
        return x.reshape(right.shape)[supernodes.rank].astype(np.float64)

    def solve(
        self,
        right: np.ndarray,  # (n, 3) or (n, 3, m), right-hand side, or m of them
        # matrix to solve with instead of the factored one: by conjugate gradients, with this factor as the
        # preconditioner. A factor in single precision is always used in this way
        matrix: BlockMatrix | None = None,
    ) -> LinearSolution:
        """Solve for a right-hand side. `cancellation` estimates the digits of the solution; refine it for more."""
        start = working_seconds()
        right = check_right(right, self.matrix.n)
        if self.panels.dtype != np.float64 or (matrix is not None and matrix is not self.matrix):
            return preconditioned_solve(self.matrix if matrix is None else matrix, self, right)
        x = self._substitute(right)  # in double precision nothing is scaled
        return LinearSolution(x, 0, residual_norm(self.matrix, x, right), working_seconds() - start)


@njit(cache=True)
def _inverse_root_diagonal(indptr, data):
    """Inverse square root of every diagonal entry, shape (n, 3); 1 if the entry is not positive."""
    n = len(indptr) - 1
    scale = np.ones((n, 3))
    for row in range(n):
        for r in range(3):
            entry = data[indptr[row + 1] - 1, r, r]
            if entry > 0.0:
                scale[row, r] = 1.0 / np.sqrt(entry)
    return scale


@njit(cache=True)
def _scaled_blocks(indptr, indices, data, scale):
    """Blocks with rows and columns multiplied by the scale, in single precision; float32, shape (n_blocks, 3, 3)."""
    scaled = np.empty(data.shape, np.float32)
    for row in range(len(indptr) - 1):
        for block in range(indptr[row], indptr[row + 1]):
            for r in range(3):
                for c in range(3):
                    scaled[block, r, c] = data[block, r, c] * scale[row, r] * scale[indices[block], c]
    return scaled
