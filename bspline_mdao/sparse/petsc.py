"""Solvers of PETSc, where petsc4py is installed: a multigrid and a direct one, on one process or on many.

`PetscMultigrid` is for meshes whose factors do not fit, `PetscCholesky` for factors that are spread over processes.
With a communicator each process hands over the rows that it owns, a `DistributedPattern`, and every one of them gets
the whole solution, with the same bits. Right-hand sides are given as a whole, too.

Theory: ``docs/theory/sparse_iterative.rst``.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit

from ..errors import InputError, MovementError
from ..numerics.processes import together
from .blocks import BlockMatrix, BlockPattern, LinearSolution, check_right
from .conjugate_gradient import System, preconditioned_solve
from .distributed import DistributedMatrix, DistributedPattern, FullRows

__all__ = ["PetscMultigrid", "PetscMultigridAnalysis", "PetscMultigridFactor"]

MULTIGRID = {
    "pc_type": "hypre",
    "pc_hypre_type": "boomeramg",
    "pc_hypre_boomeramg_coarsen_type": "HMIS",
    "pc_hypre_boomeramg_interp_type": "ext+i",
    "pc_hypre_boomeramg_P_max": 4,
    "pc_hypre_boomeramg_relax_type_down": "l1-Gauss-Seidel",
    "pc_hypre_boomeramg_relax_type_up": "backward-l1-Gauss-Seidel",
}
"""Options of BoomerAMG: of those that were tried, the least time on grids with boundary layers."""

PREFIX = "bspline_mdao_"
"""Of options in PETSc's database, which come before those above, such as ``-bspline_mdao_pc_hypre_boomeramg_P_max 6``
in the environment variable PETSC_OPTIONS."""

MISSING = 'PETSc: petsc4py is not installed; install it (pip install "bspline_mdao[mpi]"), or use Cholesky()'


@dataclass(frozen=True)
class PetscMultigrid:
    """Conjugate gradients preconditioned with the algebraic multigrid of hypre, BoomerAMG; needs the package petsc4py.

    Its iterations hardly grow with the mesh, and its memory is proportional to the number of points: for meshes whose
    Cholesky factor does not fit, as where all nodes of a grid are moved. The multigrid is that of the three components
    of the displacement by themselves [Blaheta, Displacement decomposition (1994)]: a third of the entries, and half of
    the time of a coupled one where Poisson's ratio is far from 0.5.

    Parameters
    ----------
    comm : communicator of mpi4py, optional
        Processes that share rows and work; by default this one alone.
    tolerance : float, optional
        Residual to reach in the 2-norm, relative to the right-hand side, or what rounding leaves if that is more.
    max_iterations : int, optional
        Iterations after which to give up.
    strong_threshold : float, optional
        Part of the largest coupling of an unknown from which another one is strong: elements much longer than high
        want a large one.
    """

    comm: Any = None
    tolerance: float = 1e-12
    max_iterations: int = 5000
    strong_threshold: float = 0.7

    @property
    def name(self) -> str:
        """Name of the solver in reports."""
        return "CG, BoomerAMG" + _on(self.comm)

    def analyze(self, pattern: BlockPattern, points: np.ndarray) -> PetscMultigridAnalysis:
        """Find the full rows of a pattern; the points are not used. `InputError` where petsc4py is not installed."""
        _petsc()
        return PetscMultigridAnalysis(self, pattern, DistributedPattern.whole(pattern))


@dataclass(frozen=True, eq=False)
class PetscMultigridAnalysis:
    """A pattern, with the settings of the solver.

    Parameters
    ----------
    settings : PetscMultigrid
    pattern : BlockPattern
        What was given.
    share : DistributedPattern
        The same, as what a process holds.
    """

    settings: PetscMultigrid
    pattern: BlockPattern
    share: DistributedPattern

    def factorize(self, matrix: BlockMatrix) -> PetscMultigridFactor:
        """Set up the multigrid of a matrix of the pattern; `MovementError` if its diagonal is not positive."""
        petsc, settings, share = _petsc(), self.settings, self.share
        if matrix.pattern is not self.pattern:
            raise InputError("multigrid: the matrix has another pattern; analyze its own")
        comm = _petsc_comm(share.comm)
        petsc.garbage_cleanup(comm)  # what is no more of earlier ones: where there are several processes, PETSc waits
        operator = _operator(FullRows.of(share), share, matrix, comm)
        multigrid = petsc.PC().create(comm)
        multigrid.setOptionsPrefix(PREFIX)
        _set_options({**MULTIGRID, "pc_hypre_boomeramg_strong_threshold": settings.strong_threshold})
        multigrid.setOperators(operator)
        multigrid.setFromOptions()
        multigrid.setUp()
        return PetscMultigridFactor(settings, share, matrix, multigrid)


@dataclass(frozen=True, eq=False)
class PetscMultigridFactor:
    """The multigrid of a matrix.

    Parameters
    ----------
    settings : PetscMultigrid
    share : DistributedPattern
    matrix : BlockMatrix
    multigrid : petsc4py.PETSc.PC
    """

    settings: PetscMultigrid
    share: DistributedPattern
    matrix: BlockMatrix
    multigrid: Any

    @property
    def cancellation(self) -> float:
        """Counterpart of `CholeskyFactor.cancellation`, from the tolerance: more digits take a smaller one."""
        return self.settings.tolerance / np.finfo(float).eps

    def apply(self, right: np.ndarray) -> np.ndarray:
        """Apply one cycle to own rows of a right-hand side, shape (n_own, 3)."""
        x = np.empty_like(right)
        vectors = (_vector(self.share, values) for values in (right, x))
        self.multigrid.apply(*vectors)
        return x

    def solve(self, right: np.ndarray, matrix: BlockMatrix | None = None) -> LinearSolution:
        """Solve for a right-hand side of all rows, shape (n, 3) or (n, 3, m); with ``matrix`` instead, if given.

        Every process gives the same and gets the whole solution.
        """
        began, share, settings = time.perf_counter(), self.share, self.settings
        right = check_right(right, int(share.starts[-1]))
        matrix = self.matrix if matrix is None else matrix
        system: System = matrix if share.comm.size == 1 else DistributedMatrix(share, matrix, self._exchange)
        found = preconditioned_solve(
            system, self, right[share.own], settings.tolerance, max_iterations=settings.max_iterations
        )
        seconds = time.perf_counter() - began
        return LinearSolution(share.gathered(found.x), found.iterations, found.residual, seconds)

    @cached_property
    def _exchange(self):
        return _Exchange.of(self.share)


@dataclass(frozen=True, eq=False)
class _Exchange:
    """Values of the rows of others from those of own ones, by a vector of PETSc with ghosts."""

    vector: Any
    n_own: int

    @classmethod
    def of(cls, share: DistributedPattern) -> _Exchange:
        size = (3 * share.n_own, 3 * int(share.starts[-1]))
        ghosts = np.asarray(share.others, _petsc().IntType)
        return cls(_petsc().Vec().createGhost(ghosts, size, bsize=3, comm=_petsc_comm(share.comm)), share.n_own)

    def __call__(self, own: np.ndarray) -> np.ndarray:
        """Values of the rows of others, shape (n - n_own, 3): collective."""
        self.vector.array = own.ravel()
        self.vector.ghostUpdate()
        with self.vector.localForm() as local:
            return local.array[3 * self.n_own :].reshape(-1, 3).copy()


def _petsc():
    """Module PETSc of petsc4py; `InputError` where it is not installed."""
    try:
        from petsc4py import PETSc
    except ImportError:
        raise InputError(MISSING) from None
    return PETSc


def _petsc_comm(comm):
    """Communicator for PETSc: this process alone where there is one."""
    return _petsc().COMM_SELF if comm is None or comm.size == 1 else comm


def _on(comm) -> str:
    """What a solver's name says of its processes."""
    return "" if comm is None or comm.size == 1 else f" on {comm.size} processes"


def _set_options(options: dict) -> None:
    """Put options into PETSc's database, but for those that the user has put there."""
    database = _petsc().Options(PREFIX)
    for name, value in options.items():
        if not database.hasName(name):
            database[name] = value


def _vector(share: DistributedPattern, values: np.ndarray):
    """Vector of PETSc in the memory of own values, shape (n_own, 3)."""
    size = (3 * share.n_own, 3 * int(share.starts[-1]))
    return _petsc().Vec().createWithArray(values.reshape(-1), size=size, comm=_petsc_comm(share.comm))


def _operator(full: FullRows, share: DistributedPattern, matrix: BlockMatrix, comm):
    """The couplings of each component with itself, as a matrix of hypre; nothing of it is there twice at the end."""
    petsc = _petsc()
    with together(share.comm):
        _require_room(3 * len(full.columns), "multigrid")
        rows = _component_rows(full.indptr, full.columns, full.places, matrix.data)
        _require_definite(share, matrix, rows[2], "multigrid")
    size = (3 * share.n_own, 3 * int(share.starts[-1]))
    csr = tuple(np.asarray(part, kind) for part, kind in zip(rows, (petsc.IntType, petsc.IntType, float)))
    scalar = petsc.Mat().createAIJWithArrays((size, size), csr, comm=comm)
    operator = scalar.convert("hypre", petsc.Mat())
    scalar.destroy()
    operator.setBlockSize(3)
    return operator


def _require_room(n_entries: int, what: str) -> None:
    """Refuse more entries on one process than the integers of PETSc can count."""
    if n_entries > np.iinfo(_petsc().IntType).max:
        raise InputError(
            f"{what}: {n_entries:,} entries on one process are more than this PETSc can count; take more processes, "
            "or a PETSc with 64-bit indices"
        )


def _require_definite(share: DistributedPattern, matrix: BlockMatrix, values: np.ndarray, what: str) -> None:
    """Refuse entries that are not finite and diagonals that are not positive, which these engines do not look for."""
    diagonal = np.einsum("ncc->nc", matrix.data[share.indptr[1 : share.n_own + 1] - 1])
    if np.isfinite(values.sum()) and (diagonal > 0.0).all():
        return
    row = share.own.start + int(np.argmin((diagonal > 0.0).all(axis=1))) + 1
    raise MovementError(
        f"{what}: the matrix is not positive definite, or not finite, at or beside block row {row}; "
        "look for an inverted or collapsed element there, or for a point that nothing holds"
    )


@njit(cache=True)
def _component_rows(indptr, columns, places, data):
    """Scalar rows of the diagonals of all blocks: starts, columns and values."""
    n = len(indptr) - 1
    starts, of = np.empty(3 * n + 1, np.int32), np.empty(3 * len(columns), np.int32)
    values, end = np.empty(3 * len(columns)), 0
    starts[0] = 0
    for row in range(n):
        for r in range(3):
            for entry in range(indptr[row], indptr[row + 1]):
                place = places[entry]
                of[end], values[end] = 3 * columns[entry] + r, data[place if place >= 0 else -1 - place, r, r]
                end += 1
            starts[3 * row + r + 1] = end
    return starts, of, values
