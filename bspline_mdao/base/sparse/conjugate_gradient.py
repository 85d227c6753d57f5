"""Conjugate gradients for symmetric matrices of 3 x 3 blocks, preconditioned with any factor, as in section III.B.

Theory: ``docs/theory/sparse_iterative.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numba import njit

from ...errors import MovementError
from ..display import OneLine
from ..numerics.processes import summed_number
from ..numerics.stopwatch import working_seconds
from .blocks import BlockMatrix, BlockPattern, LinearSolution, check_right, graph_of
from .incomplete import IncompleteFactor, IncompletePattern, incomplete_factor, incomplete_pattern, narrow_order

__all__ = [
    "ConjugateGradients",
    "ConjugateGradientsAnalysis",
    "PreconditionedMatrix",
    "Preconditioner",
    "StoredFactor",
    "System",
    "preconditioned_solve",
]

ROUNDING_MARGIN = 4.0
"""Factor by which a stagnating residual may exceed ``eps |A| |x|``, an estimate of rounding."""

ADVICE = "give more shift or a higher fill, or use a direct solver"


class Preconditioner(Protocol):
    """A symmetric positive definite approximation of a matrix that can be solved with."""

    def apply(self, right: np.ndarray) -> np.ndarray:
        """Solve for a right-hand side, shape (n, 3)."""


class StoredFactor(Preconditioner, Protocol):
    """A preconditioner that reports its memory."""

    @property
    def n_bytes(self) -> int:
        """Its memory in bytes."""


class System(Protocol):
    """A symmetric matrix with a product: a `BlockMatrix`, or one distributed over several processes."""

    @property
    def comm(self) -> Any:
        """Its processes."""

    @property
    def n(self) -> int:
        """Number of block rows that this process owns."""

    def dot(self, x: np.ndarray) -> np.ndarray:
        """Own rows of the product with a vector given by own rows."""

    def dot_of_sizes(self, x: np.ndarray) -> np.ndarray:
        """The same with the absolute values of all numbers."""


@dataclass(frozen=True)
class ConjugateGradients(OneLine):
    """Conjugate gradients preconditioned with ILU(p), the solver of section III.B.

    Parameters
    ----------
    fill : int, optional
        Fill level p of the incomplete factor.
    shift : float, optional
        Fraction of the diagonal blocks added to them before factoring. It is increased if a pivot is not positive
        otherwise.
    tolerance : float, optional
        Residual to reach in the 2-norm, relative to the right-hand side, or the rounding level if that is higher: see
        `preconditioned_solve`.
    max_iterations : int, optional
        Iterations after which to give up.

    single : bool, optional
        Store the factor in single precision, which halves its memory. The solution has the same accuracy.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import ConjugateGradients, LinearElasticity, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> mover = LinearElasticity(mesh, solver=ConjugateGradients(tolerance=1e-10), n_increments=1)
    >>> mover.move(mesh.points, mesh.points[mesh.surface_ids] * [1.0, 1.2, 1.0]).points.shape
    (78, 3)
    """

    fill: int = 1
    shift: float = 4e-3
    tolerance: float = 1e-12
    max_iterations: int = 20_000
    single: bool = True

    @property
    def name(self) -> str:
        """Name of the solver in reports."""
        return f"CG, ILU({self.fill})"

    def analyze(self, pattern: BlockPattern, points: np.ndarray) -> ConjugateGradientsAnalysis:
        """Find the pattern of the factor; the points, shape (n, 3), are not used."""
        graph = graph_of(pattern)
        return ConjugateGradientsAnalysis(self, incomplete_pattern(graph, narrow_order(graph), self.fill))


@dataclass(frozen=True, eq=False)
class ConjugateGradientsAnalysis(OneLine):
    """The pattern of an incomplete factor, with the settings of the solver."""

    settings: ConjugateGradients
    pattern: IncompletePattern

    def factorize(self, matrix: BlockMatrix) -> PreconditionedMatrix:
        """Factor a matrix incompletely; `MovementError` if no reasonable shift makes its pivots positive."""
        settings = self.settings
        dtype = np.float32 if settings.single else np.float64
        factor: IncompleteFactor = incomplete_factor(matrix, self.pattern, settings.shift, dtype)
        return PreconditionedMatrix(matrix, factor, settings.tolerance, settings.max_iterations)


@dataclass(frozen=True, eq=False)
class PreconditionedMatrix:
    """A matrix with its preconditioner and the tolerance of the iteration."""

    matrix: BlockMatrix
    preconditioner: StoredFactor
    tolerance: float
    max_iterations: int

    @property
    def n_bytes(self) -> int:
        """Memory of the preconditioner in bytes."""
        return self.preconditioner.n_bytes

    @property
    def cancellation(self) -> float:
        """Counterpart of `CholeskyFactor.cancellation`, from the tolerance: more digits need a smaller one."""
        return self.tolerance / np.finfo(float).eps

    def apply(self, right: np.ndarray) -> np.ndarray:
        """Apply the preconditioner to a right-hand side, shape (n, 3)."""
        return self.preconditioner.apply(right)

    def solve(self, right: np.ndarray, matrix: BlockMatrix | None = None) -> LinearSolution:
        """Solve for a right-hand side, shape (n, 3) or (n, 3, m); with ``matrix`` instead of its own, if given."""
        matrix = self.matrix if matrix is None else matrix
        return preconditioned_solve(
            matrix, self.preconditioner, right, self.tolerance, max_iterations=self.max_iterations
        )


def preconditioned_solve(
    matrix: System,  # symmetric positive definite matrix. If distributed, each process passes and gets its own rows
    factor: Preconditioner,  # factor of any solver, for example of an earlier increment
    right: np.ndarray,  # (n, 3) or (n, 3, m), right-hand side, or m of them
    # residual to reach in the 2-norm, relative to the right-hand side, or the rounding level if that is higher
    tolerance: float = 1e-12,
    start: np.ndarray | None = None,  # where to start; zero by default
    max_iterations: int = 20_000,  # iterations after which to give up
) -> LinearSolution:
    """Solve with conjugate gradients and the factor of this matrix or a similar one."""
    # The iteration's own residual drifts from the true one by rounding. So the true one is computed when the former is
    # small enough, and the iteration is restarted from there if necessary. The residual of the exact solution rounded
    # to double precision is of the size of ``eps |A| |x|``, with absolute values of all entries. If the solution is
    # large relative to the right-hand side, as for a random one with a soft matrix, that exceeds any small tolerance,
    # and the iteration ends there, as accurate as a direct solver. `MovementError` if the residual is not reached, and
    # by how much, or if matrix or factor is not positive definite or not finite
    # returns the true residual as well, and the largest number of iterations if there are several right-hand sides
    clock = working_seconds()
    right = check_right(right, matrix.n)
    start = np.zeros_like(right) if start is None else check_right(start, matrix.n)
    sides = [...] if right.ndim == 2 else [(..., side) for side in range(right.shape[2])]
    x, found = np.empty_like(right), [(0, 0.0)]
    for side in sides:
        x[side], n, residual = _solve_one(matrix, factor, right[side], tolerance, start[side], max_iterations)
        found.append((n, residual))
    iterations, residuals = zip(*found)
    return LinearSolution(x, max(iterations), max(residuals), working_seconds() - clock)


def _solve_one(
    matrix: System, factor: Preconditioner, right: np.ndarray, tolerance: float, start: np.ndarray, max_iterations: int
) -> tuple[np.ndarray, int, float]:
    """Solution, iterations and true relative residual for one right-hand side."""
    right = np.ascontiguousarray(right)
    size = _norm(matrix, right)
    if size == 0.0:
        return np.zeros_like(right), 0, 0.0
    if not np.isfinite(size):
        raise MovementError("conjugate gradients: the right-hand side is not finite; look for points that are not")
    x = np.array(start, order="C")
    rest = right - matrix.dot(x)
    iterations, residual = 0, _norm(matrix, rest) / size
    while not residual <= tolerance:  # also if it is NaN, which _iterate then refuses
        # to half the tolerance, so that a small drift of the recurrence does not cost a restart
        step, n_steps = _iterate(matrix, factor, rest, 0.5 * tolerance * size, max_iterations - iterations)
        x += step
        iterations += n_steps
        rest = right - matrix.dot(x)
        before, residual = residual, _norm(matrix, rest) / size
        if residual > tolerance:
            rounding, stays = _rounding(matrix, x, right) / size, not residual < 0.5 * before
            if residual <= (ROUNDING_MARGIN if stays else 1.0) * rounding:
                break
            if stays:
                raise MovementError(
                    f"conjugate gradients: the residual stays at {residual:.1e}, {residual / tolerance:.1g} times the "
                    f"tolerance, after {iterations} iterations, where rounding leaves {rounding:.1e}; {ADVICE}"
                )
    return x, iterations, float(residual)


def _rounding(matrix: System, x: np.ndarray, right: np.ndarray) -> float:
    """2-norm of the residual due to rounding of a solution and of its product."""
    return np.finfo(float).eps * _norm(matrix, matrix.dot_of_sizes(x) + np.abs(right))


def _norm(matrix: System, vector: np.ndarray) -> float:
    """2-norm of a vector, of all processes of the matrix together."""
    return np.sqrt(_inner(matrix, vector, vector))


def _inner(matrix: System, a: np.ndarray, b: np.ndarray) -> float:
    """Inner product of two vectors, of all processes of the matrix together."""
    return summed_number(matrix.comm, _dot(a, b))


def _iterate(
    matrix: System, factor: Preconditioner, right: np.ndarray, target: float, max_iterations: int
) -> tuple[np.ndarray, int]:
    """Iterate from zero until the recurrence's residual is at most ``target``: solution and number of iterations."""
    # Line numbers are those of Saad, Iterative Methods for Sparse Linear Systems, 2nd ed., Algorithm 9.1.
    x, residual = np.zeros_like(right), right.copy()
    z = factor.apply(residual)
    direction, energy = z, _inner(matrix, residual, z)  # line 1
    for iteration in range(1, max_iterations + 1):
        image = matrix.dot(direction)
        curvature = _inner(matrix, direction, image)
        _require_positive(energy, curvature, iteration)
        square = _advance(x, residual, direction, image, energy / curvature)  # lines 3 to 5
        size = np.sqrt(summed_number(matrix.comm, square))
        if size <= target:
            return x, iteration
        z = factor.apply(residual)  # line 6
        before, energy = energy, _inner(matrix, residual, z)
        _turn(direction, z, energy / before)  # lines 7 and 8
    raise MovementError(
        f"conjugate gradients: residual {size / target:.1e} times the tolerance after {max_iterations} iterations; "
        f"allow more, {ADVICE}"
    )


def _require_positive(energy: float, curvature: float, iteration: int) -> None:
    """Stop if the preconditioner or the matrix shows that it is not positive definite, or not finite."""
    for value, what in ((energy, "preconditioner"), (curvature, "matrix")):
        if not (value > 0.0 and np.isfinite(value)):
            raise MovementError(
                f"conjugate gradients: the {what} is not positive definite (iteration {iteration}, {value:.1e}); "
                f"{ADVICE}"
            )


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _dot(a, b):
    """Inner product of two arrays, shape (n, 3)."""
    total = 0.0
    for i in range(len(a)):
        total += a[i, 0] * b[i, 0] + a[i, 1] * b[i, 1] + a[i, 2] * b[i, 2]
    return total


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _advance(x, residual, direction, image, length):
    """Step along ``direction``, whose product with the matrix is ``image``; return the squared residual norm."""
    total = 0.0
    for i in range(len(x)):
        for a in range(3):
            x[i, a] += length * direction[i, a]
            residual[i, a] -= length * image[i, a]
            total += residual[i, a] * residual[i, a]
    return total


@njit(cache=True, nogil=True, fastmath={"contract"})
def _turn(direction, z, ratio):
    """Next direction, in place: ``z`` plus ``ratio`` times the previous one."""
    for i in range(len(z)):
        for a in range(3):
            direction[i, a] = z[i, a] + ratio * direction[i, a]
