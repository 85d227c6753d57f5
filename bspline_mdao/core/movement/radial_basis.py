"""Movement by radial basis functions about the surface and the fixed points. Theory: ``docs/theory/movers.rst``.

With the functions A of all centres, the linear polynomials P at them (if any) and the prescribed displacements d,
strengths and coefficients solve ``A strengths + P coefficients = d``, ``P^T strengths = 0``. Sums over centres never
become a matrix of all targets and centres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from scipy import linalg
from scipy.linalg.lapack import dormqr

from ...base.numerics.stopwatch import working_seconds
from ...base.numerics.threads import one_blas_thread
from ...base.numerics.vectors import add, add_to, dot, less, row, scaled
from ...errors import InputError, MovementError
from ..mesh.moving_mesh import MovingMesh
from .increments import IncrementalMover
from .interpolation import CentredInterpolation, Centres, InterpolatedStep, find_centres, interpolated_step
from .mover import SolveReport, digits_of

__all__ = [
    "COMPACT",
    "GLOBAL",
    "MOST_CENTRES",
    "NEEDS_LINEAR",
    "RadialBasis",
    "RadialInterpolation",
    "RadialSystem",
    "radial_interpolation",
    "radial_matrix",
    "radial_sums",
    "radial_sums_jvp",
    "radial_sums_vjp",
]

COMPACT = ("wendland c0", "wendland c2", "wendland c4")
"""Functions that vanish from the radius on (Wendland 1995)."""

GLOBAL = ("volume", "thin plate", "multiquadric", "inverse multiquadric", "gaussian")
"""Functions with global support."""

NEEDS_LINEAR = ("volume", "thin plate", "multiquadric")
"""Functions that interpolate only together with a linear polynomial."""

MOST_CENTRES = 12_000
"""Most centres of the dense system; its factor then takes 1.2 GB per increment."""

SMALLEST_PIVOT = 1e-12
"""Centres this near to a plane, relative to their distance from the origin, count as lying in it."""

LARGEST_RESIDUAL = 1e-6
"""Largest relative residual of the displacements of the centres; above it the system counts as singular."""


@dataclass(frozen=True)
class RadialBasis(IncrementalMover):
    """Interpolate the prescribed displacements by radial functions about all surface points and all fixed points.

    Parameters
    ----------
    mesh : MovingMesh
        Mesh to move.
    kernel : str
        ``"wendland c0"``, ``"wendland c2"`` or ``"wendland c4"``, zero from the radius on; or one with global support:
        ``"volume"``, ``"thin plate"``, ``"multiquadric"``, ``"inverse multiquadric"`` or ``"gaussian"``.
    radius : float
        Radius of the functions, in units of the mesh's size.
    has_linear : bool, optional
        Whether a linear polynomial is added, which reproduces affine displacements; by default for the kernels that
        need it: volume, thin plate and multiquadric.
    n_increments : int
        Increments of the move; each has its own dense factor, which is kept for the derivatives.

    References
    ----------
    S. Jakobsson and O. Amoignon, "Mesh deformation using radial basis functions for gradient-based aerodynamic shape
    optimization", Computers & Fluids 36, 2007.

    A. de Boer, M. S. van der Schoot and H. Bijl, "Mesh deformation based on radial basis function interpolation",
    Computers & Structures 85, 2007.

    H. Wendland, "Piecewise polynomial, positive definite and compactly supported radial functions of minimal degree",
    Advances in Computational Mathematics 4, 1995.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import RadialBasis, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> mover = RadialBasis(mesh, kernel="wendland c2", radius=0.5)
    >>> movement = mover.move(mesh.points, mesh.points[mesh.surface_ids] * [1.0, 1.2, 1.0])
    >>> mesh.tangled(movement.points).n_invalid
    0
    """

    mesh: MovingMesh
    kernel: str = "wendland c2"
    radius: float = 0.5
    has_linear: bool | None = None
    n_increments: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.kernel not in (*COMPACT, *GLOBAL):
            raise InputError(f"radial basis: no kernel '{self.kernel}'; take one of {', '.join((*COMPACT, *GLOBAL))}")
        if not 0.0 < self.radius < np.inf:
            raise InputError(f"radial basis: radius {self.radius}; give a positive number, in units of the mesh's size")
        if self.has_linear is False and self.kernel in NEEDS_LINEAR:
            raise InputError(f"radial basis: kernel '{self.kernel}' needs the linear polynomial; leave it in")
        n_centres = len(self.mesh.surface_ids) + len(self.mesh.fixed_ids)
        if n_centres > MOST_CENTRES:
            raise InputError(
                f"radial basis: {n_centres} prescribed points are more than the {MOST_CENTRES} of a dense system; "
                "move the control mesh instead of the grid, or take another mover"
            )

    def _step(self, initial: np.ndarray, before: np.ndarray, surface: np.ndarray) -> InterpolatedStep:
        centres = self._centres
        scattered = radial_interpolation(
            self.kernel,
            self.radius * self.mesh.size,
            self.kernel in NEEDS_LINEAR if self.has_linear is None else self.has_linear,
            before[centres.target_ids],
            centres.position @ before,
            centres.displacement(surface - before[self.mesh.surface_ids]),
        )
        interpolation = CentredInterpolation(centres, scattered)
        return interpolated_step(self.mesh, before, surface, interpolation, scattered.report)

    @cached_property
    def _centres(self) -> Centres:
        return find_centres(self.mesh)


def radial_interpolation(
    kernel: str,  # one of `COMPACT` and `GLOBAL`
    radius: float,  # radius of the functions (m)
    has_linear: bool,  # whether a linear polynomial is added
    # targets, centres: (n_targets, 3), where it is evaluated, and where displacements are given (m)
    targets: np.ndarray,
    centres: np.ndarray,
    displacement: np.ndarray,  # (n_centres, 3), displacements of the centres (m)
) -> RadialInterpolation:
    """Interpolate displacements by radial functions."""
    start = working_seconds()
    function = ((*COMPACT, *GLOBAL).index(kernel), radius)
    right = np.concatenate([displacement, np.zeros((4 if has_linear else 0, 3))])
    terms = np.column_stack([np.ones(len(centres)), centres])[:, : len(right) - len(centres)]
    system = _factorized(radial_matrix(*function, centres), terms, kernel)
    solution = system.solve(right)
    strengths, coefficients = np.ascontiguousarray(solution[: len(centres)]), solution[len(centres) :]
    matched = radial_sums(*function, centres, centres, strengths) + _polynomials(centres, coefficients)
    residual = float(np.linalg.norm(matched - displacement) / (np.linalg.norm(displacement) or 1.0))
    if not residual < LARGEST_RESIDUAL:
        raise MovementError(_singular(kernel, f"leaves a residual of {residual:.2g}"))
    values = radial_sums(*function, targets, centres, strengths) + _polynomials(targets, coefficients)
    report = SolveReport("dense Cholesky", 0, residual, working_seconds() - start, digits_of(residual))
    return RadialInterpolation(function, targets, centres, strengths, coefficients, system, values, report)


@dataclass(frozen=True, eq=False)
class RadialInterpolation:
    """A completed interpolation."""

    function: tuple[int, float]  # number of the radial function, and its radius (m)
    # targets, centres: (n_targets, 3), where it is evaluated, and where displacements are given (m)
    targets: np.ndarray
    centres: np.ndarray
    strengths: np.ndarray  # (n_centres, 3), factors of the functions
    coefficients: np.ndarray  # (4, 3) or (0, 3), coefficients of the linear polynomial: constant, x, y, z
    system: RadialSystem  # the system: strengths above coefficients, from displacements above zeros
    values: np.ndarray  # (n_targets, 3), displacements of the targets (m)
    report: SolveReport  # solution of the system

    def jvp(self, d_targets: np.ndarray, d_centres: np.ndarray, d_displacement: np.ndarray) -> np.ndarray:
        """Change of the values for changes of the targets, of the centres and of their displacements."""
        slopes = self.coefficients[1:]
        right = np.zeros((len(self.centres) + len(self.coefficients), 3))
        right[: len(self.centres)] = d_displacement - self._sums_jvp(self.centres, d_centres, d_centres)
        if len(slopes):
            right[: len(self.centres)] -= d_centres @ slopes
            right[-3:] = -d_centres.T @ self.strengths
        d_strengths, d_coefficients = self._parts(self.system.solve(right))
        d_values = self._sums_jvp(self.targets, d_targets, d_centres)
        d_values += radial_sums(*self.function, self.targets, self.centres, d_strengths)
        return d_values + d_targets[:, : len(slopes)] @ slopes + _polynomials(self.targets, d_coefficients)

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""
        bar, slopes = np.ascontiguousarray(bar), self.coefficients[1:]
        right = np.zeros((len(self.centres) + len(self.coefficients), 3))
        right[: len(self.centres)] = radial_sums(*self.function, self.centres, self.targets, bar)
        right[len(self.centres) :] = _polynomials_transpose(self.targets, bar, len(self.coefficients))
        displacement_bar, constraint_bar = self._parts(self.system.solve(right))
        targets_bar, centres_bar = self._sums_vjp(self.targets, bar)
        centres_bar -= np.add(*self._sums_vjp(self.centres, displacement_bar))
        if len(slopes):
            targets_bar += bar @ slopes.T
            centres_bar -= displacement_bar @ slopes.T + self.strengths @ constraint_bar[1:].T
        return targets_bar, centres_bar, displacement_bar

    def _parts(self, solution: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.ascontiguousarray(solution[: len(self.centres)]), solution[len(self.centres) :]

    def _sums_jvp(self, targets: np.ndarray, d_targets: np.ndarray, d_centres: np.ndarray) -> np.ndarray:
        return radial_sums_jvp(*self.function, targets, self.centres, self.strengths, d_targets, d_centres)

    def _sums_vjp(self, targets: np.ndarray, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return radial_sums_vjp(*self.function, targets, self.centres, self.strengths, bar)


@dataclass(frozen=True, eq=False)
class RadialSystem:
    """The factored symmetric system ``[A P; P^T 0]``; all functions are definite on the null space of ``P^T``."""

    # With ``P = Q [R; 0]``, which has t columns, ``Q^T A Q`` beyond its first t rows and columns is positive or
    # negative definite, and takes half the arithmetic of an LU factorisation of the whole.

    factor: np.ndarray  # (n, n), lower Cholesky factor of this part, bordered by an identity
    sign: float  # -1 if this part is negative definite
    border: np.ndarray  # (n, t), first columns of ``Q^T A Q``
    # reflectors, scales: (n, t) and (t,), Q in LAPACK's form, and R in the upper triangle
    reflectors: np.ndarray
    scales: np.ndarray

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Strengths, shape (n, m), above coefficients, shape (t, m), for a right-hand side of shape (n + t, m)."""
        n, t = self.border.shape
        with one_blas_thread:
            if not t:
                return linalg.cho_solve((self.factor, True), right)
            triangle = self.reflectors[:t]
            rest = _apply_q(self.reflectors, self.scales, right[:n], transposed=True)
            first = linalg.solve_triangular(triangle, right[n:], trans="T")
            rest -= self.border @ first
            inner = np.concatenate([np.zeros_like(first), self.sign * rest[t:]])
            inner = linalg.cho_solve((self.factor, True), inner)
            coefficients = linalg.solve_triangular(triangle, rest[:t] - self.border[t:].T @ inner[t:])
            inner[:t] = first
            return np.concatenate([_apply_q(self.reflectors, self.scales, inner), coefficients])


def _factorized(matrix: np.ndarray, terms: np.ndarray, kernel: str) -> RadialSystem:
    """Factor the symmetric system of functions, shape (n, n), and polynomials at the centres, shape (n, t)."""
    t, matrix = terms.shape[1], matrix.T  # symmetric; LAPACK overwrites it in Fortran's order
    reflectors, scales, sign = terms, np.zeros(0), 1.0
    try:
        with one_blas_thread:
            if t:
                (reflectors, scales), triangle = linalg.qr(terms, mode="raw")
                _check_polynomials(np.abs(np.diag(triangle)), kernel)
                matrix = _apply_q(reflectors, scales, matrix, transposed=True, overwrites=True)
                matrix = _apply_q(reflectors, scales, matrix, side="R", overwrites=True)
            border = matrix[:, :t].copy()
            matrix[:t], matrix[:, :t] = 0.0, 0.0
            if t and len(matrix) > t and matrix[t, t] < 0.0:
                sign = -1.0
                np.negative(matrix, out=matrix)
            matrix[range(t), range(t)] = 1.0
            factor, _ = linalg.cho_factor(matrix, lower=True, overwrite_a=True)
    except linalg.LinAlgError as error:
        raise MovementError(_singular(kernel, "is singular to round-off")) from error
    return RadialSystem(factor, sign, border, reflectors, scales)


def _apply_q(
    reflectors: np.ndarray,
    scales: np.ndarray,
    matrix: np.ndarray,
    side: str = "L",
    transposed: bool = False,
    overwrites: bool = False,
) -> np.ndarray:
    """Product of an orthogonal matrix in LAPACK's form with another matrix on the given side."""
    work = 64 * max(matrix.shape)
    return dormqr(side, "T" if transposed else "N", reflectors, scales, matrix, work, overwrite_c=overwrites)[0]


def _check_polynomials(pivots: np.ndarray, kernel: str) -> None:
    """Refuse centres at which the polynomials, orthogonalised one after the other, are linearly dependent."""
    if len(pivots) < 4 or pivots.min() < SMALLEST_PIVOT * pivots.max():
        raise MovementError(
            f"radial basis: the centres lie in one plane, where the polynomial of kernel '{kernel}' is not unique; "
            "take a kernel without one, such as 'wendland c2'"
        )


def _singular(kernel: str, what: str) -> str:
    return f"radial basis: the system of kernel '{kernel}' {what}; take a smaller radius or another kernel"


def _polynomials(points: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Linear polynomials at points; zero without coefficients."""
    return coefficients[0] + points @ coefficients[1:] if len(coefficients) else np.zeros_like(points)


def _polynomials_transpose(points: np.ndarray, bar: np.ndarray, n_terms: int) -> np.ndarray:
    return np.vstack([bar.sum(axis=0), points.T @ bar])[:n_terms]


_WENDLAND_C0, _WENDLAND_C2, _WENDLAND_C4, _VOLUME, _THIN_PLATE, _MULTIQUADRIC, _INVERSE_MULTIQUADRIC = range(7)


@njit(cache=True, error_model="numpy")
def _function(kind, r):
    """Value of a radial function at the distance r in radii, and its derivative in r divided by r."""
    # The latter is not finite at 0 for functions with a peak there, where no direction is special: it counts as 0.
    if kind <= _WENDLAND_C4:
        return _wendland(kind, r) if r < 1.0 else (0.0, 0.0)
    if kind == _VOLUME:
        return r, 1.0 / r if r > 0.0 else 0.0
    if kind == _THIN_PLATE:
        return (r * r * np.log(r), 2.0 * np.log(r) + 1.0) if r > 0.0 else (0.0, 0.0)
    if kind == _MULTIQUADRIC:
        root = np.sqrt(1.0 + r * r)
        return root, 1.0 / root
    if kind == _INVERSE_MULTIQUADRIC:
        inverse = 1.0 / np.sqrt(1.0 + r * r)
        return inverse, -(inverse**3)
    value = np.exp(-r * r)
    return value, -2.0 * value


@njit(cache=True, error_model="numpy")
def _wendland(kind, r):
    left = 1.0 - r
    if kind == _WENDLAND_C0:
        return left**2, -2.0 * left / r if r > 0.0 else 0.0
    if kind == _WENDLAND_C2:
        return left**4 * (4.0 * r + 1.0), -20.0 * left**3
    return left**6 * ((35.0 * r + 18.0) * r + 3.0) / 3.0, -56.0 / 3.0 * left**5 * (5.0 * r + 1.0)


@njit(cache=True, error_model="numpy", nogil=True)
def radial_matrix(kind, radius, centres):
    """Values at all centres of the functions about all centres, shape (n_centres, n_centres), symmetric."""
    n, columns = len(centres), np.ascontiguousarray(centres.T)
    matrix = np.empty((n, n))
    for i in range(n):
        _values(kind, radius, row(centres, i), columns[:, : i + 1], matrix[i, : i + 1])
        for j in range(i):
            matrix[j, i] = matrix[i, j]
    return matrix


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "reassoc"})
def radial_sums(kind, radius, targets, centres, strengths):
    """Sums at the targets, (n_targets, 3), of the functions about the centres times strengths, (n_centres, 3)."""
    columns, factors = np.ascontiguousarray(centres.T), np.ascontiguousarray(strengths.T)
    values, sums = np.empty(len(centres)), np.zeros_like(targets)
    for j in range(len(targets)):
        _values(kind, radius, row(targets, j), columns, values)
        x = y = z = 0.0
        for i in range(len(centres)):
            x += values[i] * factors[0, i]
            y += values[i] * factors[1, i]
            z += values[i] * factors[2, i]
        sums[j, 0], sums[j, 1], sums[j, 2] = x, y, z
    return sums


@njit(cache=True, error_model="numpy", nogil=True)
def _values(kind, radius, target, columns, values):
    """Values at one target of the functions about centres, shape (3, n), in loops that vectorise as far as possible."""
    for i in range(len(values)):
        x, y, z = target[0] - columns[0, i], target[1] - columns[1, i], target[2] - columns[2, i]
        values[i] = np.sqrt(x * x + y * y + z * z) / radius
    if kind != _VOLUME:  # the volume function is the distance itself
        for i in range(len(values)):
            values[i] = _function(kind, values[i])[0]


@njit(cache=True, error_model="numpy")
def radial_sums_jvp(kind, radius, targets, centres, strengths, d_targets, d_centres):
    """Change of `radial_sums` for changes of targets and centres."""
    d_sums = np.zeros_like(targets)
    for j in range(len(targets)):
        total = (0.0, 0.0, 0.0)
        for i in range(len(centres)):
            along = less(row(targets, j), row(centres, i))
            _, slope = _function(kind, np.sqrt(dot(along, along)) / radius)
            change = slope * dot(along, less(row(d_targets, j), row(d_centres, i))) / radius**2
            total = add(total, scaled(change, row(strengths, i)))
        add_to(d_sums, j, total)
    return d_sums


@njit(cache=True, error_model="numpy")
def radial_sums_vjp(kind, radius, targets, centres, strengths, bar):
    """Transpose of `radial_sums_jvp`: derivatives with respect to targets and centres."""
    targets_bar, centres_bar = np.zeros_like(targets), np.zeros_like(centres)
    for j in range(len(targets)):
        total = (0.0, 0.0, 0.0)
        for i in range(len(centres)):
            along = less(row(targets, j), row(centres, i))
            _, slope = _function(kind, np.sqrt(dot(along, along)) / radius)
            pull = scaled(slope * dot(row(strengths, i), row(bar, j)) / radius**2, along)
            total = add(total, pull)
            add_to(centres_bar, i, scaled(-1.0, pull))
        add_to(targets_bar, j, total)
    return targets_bar, centres_bar
