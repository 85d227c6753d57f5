"""PETSc solvers, if petsc4py is installed: a multigrid and a direct one, on one process or many.

`PetscMultigrid` is for meshes whose factors do not fit in memory, `PetscCholesky` for factors distributed over
processes. With a communicator each process passes its own rows, a `DistributedPattern`, and every process gets the
whole solution, with the same bits. Right-hand sides are also passed as a whole.

Theory: ``docs/theory/sparse_parallel.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Any

import numpy as np
from numba import njit

from ...errors import InputError, MovementError
from ..display import OneLine
from ..extras import library
from ..numerics.processes import together
from ..numerics.stopwatch import working_seconds
from .blocks import BlockMatrix, BlockPattern, LinearSolution, check_right, relative_residual
from .conjugate_gradient import System, preconditioned_solve
from .distributed import DistributedMatrix, DistributedPattern, FullRows

__all__ = [
    "PetscCholesky",
    "PetscCholeskyAnalysis",
    "PetscCholeskyFactor",
    "PetscMultigrid",
    "PetscMultigridAnalysis",
    "PetscMultigridFactor",
    "has_petsc",
]

MULTIGRID = {
    "pc_type": "hypre",
    "pc_hypre_type": "boomeramg",
    "pc_hypre_boomeramg_coarsen_type": "HMIS",
    "pc_hypre_boomeramg_interp_type": "ext+i",
    "pc_hypre_boomeramg_P_max": 4,
    "pc_hypre_boomeramg_relax_type_down": "l1-Gauss-Seidel",
    "pc_hypre_boomeramg_relax_type_up": "backward-l1-Gauss-Seidel",
}
"""Options of BoomerAMG: the fastest of those tried on grids with boundary layers."""

STRONG_THRESHOLD = "pc_hypre_boomeramg_strong_threshold"
"""Name of an option of BoomerAMG."""

CHOLESKY = {"pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps", "mat_mumps_icntl_14": 50}
"""Options of MUMPS: 50 % more memory than it estimates, for delayed pivots."""

NOT_DEFINITE = (-10, -40)
"""MUMPS errors for a zero pivot, or a negative one if not counted."""

N_NEGATIVE, TOTAL_MEGABYTES = 12, 22
"""Positions, from 1, of the number of negative pivots and of the total memory in MUMPS's global information."""

PREFIX = "bspline_mdao_"
"""Prefix of options in PETSc's database, which override the ones above, such as
``-bspline_mdao_pc_hypre_boomeramg_P_max 6`` in the environment variable PETSC_OPTIONS."""


@dataclass(frozen=True)
class PetscMultigrid(OneLine):
    """Conjugate gradients preconditioned with hypre's algebraic multigrid, BoomerAMG; needs the package petsc4py.

    The number of iterations hardly grows with the mesh, and memory is proportional to the number of points: for meshes
    whose Cholesky factor does not fit in memory, for example if all nodes of a grid are moved. The multigrid treats the
    three displacement components separately [Blaheta, Displacement decomposition (1994)]: a third of the entries, and
    half the time of a coupled one if Poisson's ratio is far from 0.5.

    Parameters
    ----------
    comm : communicator of mpi4py, optional
        Processes that share rows and work; by default only this one.
    tolerance : float, optional
        Residual to reach in the 2-norm, relative to the right-hand side, or the rounding level if that is higher.
    max_iterations : int, optional
        Iterations after which to give up.
    strong_threshold : float, optional
        Fraction of an unknown's largest coupling above which another coupling is strong: elements much longer than high
        need a large value.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import LinearElasticity, PetscMultigrid, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> LinearElasticity(mesh, solver=PetscMultigrid(tolerance=1e-10)).solver.name
    'CG, BoomerAMG'
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
class PetscMultigridAnalysis(OneLine):
    """A pattern, with the settings of the solver."""

    settings: PetscMultigrid
    pattern: BlockPattern  # as given
    distributed: DistributedPattern  # the same, as one process's part

    def factorize(self, matrix: BlockMatrix) -> PetscMultigridFactor:
        """Set up the multigrid of a matrix of the pattern; `MovementError` if its diagonal is not positive."""
        settings, distributed = self.settings, self.distributed
        if matrix.pattern is not self.pattern:
            raise InputError("multigrid: the matrix has another pattern; analyze its own")
        comm, options = _clean_comm(distributed.comm), {STRONG_THRESHOLD: settings.strong_threshold, **MULTIGRID}
        operator = _operator(FullRows.of(distributed), distributed, matrix, comm)
        return PetscMultigridFactor(settings, distributed, matrix, _preconditioner(operator, comm, options))


class _Factor:
    """Common base of factors and multigrids: apply PETSc's preconditioner to one right-hand side of own rows."""

    # Subclasses have the fields ``distributed``, ``matrix`` and ``inner``, a petsc4py.PETSc.PC.

    distributed: DistributedPattern
    matrix: BlockMatrix
    inner: Any

    def apply(self, right: np.ndarray) -> np.ndarray:
        """Apply it to own rows of a right-hand side, shape (n_owned, 3)."""
        right, x = np.ascontiguousarray(right), np.empty(right.shape)
        self.inner.apply(_vector(self.distributed, right), _vector(self.distributed, x))
        return x

    def _iterated(self, right: np.ndarray, matrix: BlockMatrix, **settings: Any) -> LinearSolution:
        """Solve for a right-hand side of all rows by conjugate gradients: the whole solution, on every process."""
        began, distributed = working_seconds(), self.distributed
        right = check_right(right, int(distributed.starts[-1]))
        found = preconditioned_solve(self._system(matrix), self, right[distributed.owned], **settings)
        seconds = working_seconds() - began
        return LinearSolution(distributed.gathered(found.x), found.iterations, found.residual, seconds)

    def _system(self, matrix: BlockMatrix) -> System:
        return (
            matrix if self.distributed.comm.size == 1 else DistributedMatrix(self.distributed, matrix, self._exchange)
        )

    @cached_property
    def _exchange(self) -> _Exchange:
        return _Exchange.of(self.distributed)


@dataclass(frozen=True, eq=False)
class PetscMultigridFactor(_Factor):
    """The multigrid of a matrix."""

    settings: PetscMultigrid
    distributed: DistributedPattern
    matrix: BlockMatrix
    inner: Any

    @property
    def cancellation(self) -> float:
        """Counterpart of `CholeskyFactor.cancellation`, from the tolerance: more digits need a smaller one."""
        return self.settings.tolerance / np.finfo(float).eps

    def solve(self, right: np.ndarray, matrix: BlockMatrix | None = None) -> LinearSolution:
        """Solve for a right-hand side of all rows, shape (n, 3) or (n, 3, m); with ``matrix`` instead, if given."""
        # Every process passes the same data and gets the whole solution.
        settings, matrix = self.settings, self.matrix if matrix is None else matrix
        return self._iterated(right, matrix, tolerance=settings.tolerance, max_iterations=settings.max_iterations)


@dataclass(frozen=True)
class PetscCholesky(OneLine):
    """Cholesky factor by MUMPS, distributed over the processes of a communicator; needs the package petsc4py.

    On one process `Cholesky` is at least as fast and takes less memory; this solver is for factors too large for one
    process. It does not report its accuracy, so movers refine its solutions.

    Parameters
    ----------
    comm : communicator of mpi4py, optional
        Processes that share rows and work; by default only this one.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import LinearElasticity, PetscCholesky, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> LinearElasticity(mesh, solver=PetscCholesky()).solver.name
    'MUMPS'
    """

    comm: Any = None

    @property
    def name(self) -> str:
        """Name of the solver in reports."""
        return "MUMPS" + _on(self.comm)

    def analyze(self, pattern: BlockPattern, points: np.ndarray) -> PetscCholeskyAnalysis:
        """Find the full rows of a pattern; the points are not used. `InputError` where petsc4py is not installed.

        MUMPS itself analyses the pattern again for every matrix.
        """
        _petsc()
        distributed = DistributedPattern.whole(pattern)
        return PetscCholeskyAnalysis(pattern, distributed, FullRows.of(distributed))


@dataclass(frozen=True, eq=False)
class PetscCholeskyAnalysis(OneLine):
    """A pattern; MUMPS keeps no analysis of it."""

    pattern: BlockPattern  # as given
    distributed: DistributedPattern  # the same, as one process's part
    full: FullRows

    def factorize(self, matrix: BlockMatrix) -> PetscCholeskyFactor:
        """Factor a matrix of the pattern."""
        distributed = self.distributed
        if matrix.pattern is not self.pattern:
            raise InputError("MUMPS: the matrix has another pattern; analyze its own")
        comm = _clean_comm(distributed.comm)
        factor = _preconditioner(_upper_rows_matrix(self.full, distributed, matrix, comm), comm, CHOLESKY)
        code, detail, n_negative = map(factor.getFactorMatrix().getMumpsInfog, (1, 2, N_NEGATIVE))
        if code in NOT_DEFINITE or n_negative > 0:
            raise MovementError(
                "MUMPS: the matrix is not positive definite; look for an inverted or collapsed element, or for a point "
                "that nothing holds"
            )
        if code < 0:
            raise MovementError(
                f"MUMPS: error {code} ({detail}), which is mostly a lack of memory; take more processes, or "
                "PetscMultigrid()"
            )
        return PetscCholeskyFactor(distributed, matrix, factor)


@dataclass(frozen=True, eq=False)
class PetscCholeskyFactor(_Factor):
    """Part of a MUMPS factor on this process."""

    distributed: DistributedPattern
    matrix: BlockMatrix
    inner: Any

    @property
    def n_bytes(self) -> int:
        """Memory of MUMPS on all processes together (bytes), in whole megabytes."""
        return 1_000_000 * int(self.inner.getFactorMatrix().getMumpsInfog(TOTAL_MEGABYTES))

    @property
    def cancellation(self) -> float:
        """Infinite, since MUMPS does not report it; see `CholeskyFactor.cancellation`."""
        return np.inf

    def solve(self, right: np.ndarray, matrix: BlockMatrix | None = None) -> LinearSolution:
        """Solve for a right-hand side of all rows, shape (n, 3) or (n, 3, m)."""
        # With another matrix, conjugate gradients use this factor as the preconditioner. Every process passes the same
        # data and gets the whole solution.
        if matrix is not None and matrix is not self.matrix:
            return self._iterated(right, matrix)
        began, distributed = working_seconds(), self.distributed
        right = check_right(right, int(distributed.starts[-1]))
        sides = right.reshape(len(right), 3, -1)
        x = np.stack(
            [distributed.gathered(self.apply(side[distributed.owned])) for side in np.moveaxis(sides, 2, 0)], axis=-1
        )
        x = x.reshape(right.shape)
        rest = right[distributed.owned] - self._product(x)
        residual = distributed.gathered(rest)
        return LinearSolution(x, 0, relative_residual(residual, right), working_seconds() - began)

    def _product(self, x: np.ndarray) -> np.ndarray:
        """Own rows of the product of the matrix with all rows of x, without a message."""
        distributed = self.distributed
        return self.matrix.dot(x[distributed.rows])[: distributed.n_owned]


@dataclass(frozen=True, eq=False)
class _Exchange:
    """Values of the rows of others from own values, by a PETSc vector with ghosts."""

    vector: Any
    n_owned: int

    @classmethod
    def of(cls, distributed: DistributedPattern) -> _Exchange:
        ghosts, comm = np.asarray(distributed.others, _petsc().IntType), _petsc_comm(distributed.comm)
        return cls(_petsc().Vec().createGhost(ghosts, _sizes(distributed)[0], bsize=3, comm=comm), distributed.n_owned)

    def __call__(self, owned: np.ndarray) -> np.ndarray:
        """Values of the rows of others, shape (n - n_owned, 3): collective."""
        self.vector.array = owned.ravel()
        self.vector.ghostUpdate()
        with self.vector.localForm() as local:
            return local.array[3 * self.n_owned :].reshape(-1, 3).copy()


def has_petsc() -> bool:
    """Whether petsc4py is installed; it is not imported."""
    return find_spec("petsc4py") is not None


def _petsc() -> Any:
    """Module PETSc of petsc4py; `InputError` if it is not installed."""
    return library("petsc4py.PETSc", "PETSc needs petsc4py", "mpi", "use Cholesky()")


def _petsc_comm(comm: Any) -> Any:
    """Communicator for PETSc: only this process if there is just one."""
    return _petsc().COMM_SELF if comm is None or comm.size == 1 else comm


def _clean_comm(comm: Any) -> Any:
    """Communicator for PETSc, after freeing deleted objects: with several processes, PETSc must be told to."""
    comm = _petsc_comm(comm)
    _petsc().garbage_cleanup(comm)
    return comm


def _preconditioner(operator: Any, comm: Any, options: dict) -> Any:
    """PETSc preconditioner of an operator; the user's options override the given ones."""
    preconditioner, database = _petsc().PC().create(comm), _petsc().Options(PREFIX)
    ours = {name: value for name, value in options.items() if not database.hasName(name)}
    for name, value in ours.items():
        database[name] = value
    preconditioner.setOptionsPrefix(PREFIX)
    preconditioner.setOperators(operator)
    preconditioner.setFromOptions()
    preconditioner.setUp()
    for name in ours:
        del database[name]
    return preconditioner


def _on(comm: Any) -> str:
    """Part of a solver's name that describes its processes."""
    return "" if comm is None or comm.size == 1 else f" on {comm.size} processes"


def _vector(distributed: DistributedPattern, values: np.ndarray) -> Any:
    """PETSc vector in the memory of own values, shape (n_owned, 3)."""
    return (
        _petsc()
        .Vec()
        .createWithArray(values.reshape(-1), size=_sizes(distributed)[0], comm=_petsc_comm(distributed.comm))
    )


def _operator(full: FullRows, distributed: DistributedPattern, matrix: BlockMatrix, comm: Any) -> Any:
    """The couplings of each component with itself, as a hypre matrix, without a copy in the end."""
    petsc = _petsc()
    with together(distributed.comm):
        _require_room(3 * len(full.columns), "multigrid")
        rows = _component_rows(full.indptr, full.columns, full.places, matrix.data)
        _require_definite(distributed, matrix, rows[2], "multigrid")
    csr = tuple(np.asarray(part, kind) for part, kind in zip(rows, (petsc.IntType, petsc.IntType, float)))
    scalar = petsc.Mat().createAIJWithArrays(_sizes(distributed), csr, comm=comm)
    operator = scalar.convert("hypre", petsc.Mat())
    scalar.destroy()
    operator.setBlockSize(3)
    return operator


def _upper_rows_matrix(full: FullRows, distributed: DistributedPattern, matrix: BlockMatrix, comm: Any) -> Any:
    """The upper triangle by rows, as PETSc and MUMPS need it for a symmetric matrix."""
    petsc = _petsc()
    with together(distributed.comm):
        _require_room(9 * len(full.columns), "MUMPS")
        rows = _upper_rows(full.indptr, full.columns, full.places, matrix.data, distributed.owned.start)
        _require_definite(distributed, matrix, rows[2], "MUMPS")
    csr = tuple(np.asarray(part, kind) for part, kind in zip(rows, (petsc.IntType, petsc.IntType, float)))
    upper = petsc.Mat().createSBAIJ(_sizes(distributed), 1, csr=csr, comm=comm)
    upper.setOption(petsc.Mat.Option.SPD, True)
    return upper


def _sizes(distributed: DistributedPattern) -> tuple[tuple[int, int | None], tuple[int, int | None]]:
    """Sizes of a matrix for PETSc: own and all rows, and the same for columns."""
    size = (3 * distributed.n_owned, 3 * int(distributed.starts[-1]))
    return size, size


def _require_room(n_entries: int, what: str) -> None:
    """Refuse more entries on one process than PETSc's integers can count."""
    if n_entries > np.iinfo(_petsc().IntType).max:
        raise InputError(
            f"{what}: {n_entries:,} entries on one process are more than this PETSc can count; take more processes, "
            "or a PETSc with 64-bit indices"
        )


def _require_definite(distributed: DistributedPattern, matrix: BlockMatrix, values: np.ndarray, what: str) -> None:
    """Refuse entries that are not finite and diagonals that are not positive, which these solvers do not check."""
    diagonal = np.einsum("ncc->nc", matrix.data[distributed.indptr[1 : distributed.n_owned + 1] - 1])
    if np.isfinite(values.sum()) and (diagonal > 0.0).all():
        return
    row = distributed.owned.start + int(np.argmin((diagonal > 0.0).all(axis=1))) + 1
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


@njit(cache=True)
def _upper_rows(indptr, columns, places, data, first):
    """Scalar rows of the upper triangle, of own block rows from ``first``: starts, columns and values."""
    n, size = len(indptr) - 1, 0
    for row in range(n):
        for entry in range(indptr[row], indptr[row + 1]):
            size += 0 if columns[entry] < first + row else 6 if columns[entry] == first + row else 9
    starts, of, values, end = np.empty(3 * n + 1, np.int32), np.empty(size, np.int32), np.empty(size), 0
    starts[0] = 0
    for row in range(n):
        for r in range(3):
            for entry in range(indptr[row], indptr[row + 1]):
                column, place = columns[entry], places[entry]
                for c in range(3 if column < first + row else r if column == first + row else 0, 3):
                    of[end] = 3 * column + c
                    values[end] = data[place, r, c] if place >= 0 else data[-1 - place, c, r]
                    end += 1
            starts[3 * row + r + 1] = end
    return starts, of, values
