"""Linear constraints among surface control points, handled by elimination: equations, row reduction, and the map E.

The equations of all constraints, ``A d = 0`` on the displacements d, are solved for as many coordinates as their rank:
these follow from the others, which stay free. The symmetry planes of the mesh are always included.

Equations are brought to reduced row echelon form one after the other, each reduced by the earlier ones. What remains of
an equation gives a coordinate in terms of others, or nothing if the equation is redundant. Coefficients 0, 1 and -1
stay exact: values within round-off of zero become zero, and values within round-off of one become one. Theory:
``docs/theory/linear_constraints.rst``.

References
----------
I. S. Duff, A. M. Erisman and J. K. Reid, *Direct Methods for Sparse Matrices*, 1986: threshold pivoting.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numba import njit
from scipy.sparse import block_array, coo_array, csr_array, vstack
from scipy.sparse.csgraph import connected_components

from ...base.display import OneLine
from ...errors import InputError
from ..mesh.moving_mesh import MovingMesh

__all__ = [
    "INDEPENDENT",
    "PIVOT",
    "ROUND_OFF",
    "Elimination",
    "Equations",
    "LinearConstraint",
    "eliminate",
    "reduced_rows",
]

INDEPENDENT = 1e-6
"""An equation counts if it leaves the span of the earlier ones by more than this fraction of its largest coefficient:
two normals of one plane, found from nodes in single precision, must not fix a point between them."""

PIVOT = 0.01
"""A preferred coordinate becomes the pivot if its coefficient is at least this fraction of the largest one: a threshold
that bounds the growth of coefficients by 100 per step."""

ROUND_OFF = 8.0 * np.finfo(float).eps
"""A sum smaller than this fraction of its terms is zero: the round-off of a few operations."""

Rows = namedtuple("Rows", "starts columns values")
"""Concatenated sparse rows, each without its pivot, whose coefficient is one."""

Work = namedtuple("Work", "values is_in columns n")
"""A working row: a value for every column, and the ``n[0]`` columns touched so far."""

SYMMETRY = "symmetry plane"
"""Name of the constraint from the symmetry planes of a mesh."""

SECTION = "both planes of a section, or periodic sides"
"""Name of the constraint that copies of surface points move like their originals."""


@dataclass(frozen=True, eq=False)
class Equations(OneLine):
    """Homogeneous equations ``matrix @ d = 0`` on displacements d of the surface control points, xyz interleaved."""

    matrix: csr_array  # (n_equations, 3 n_surface), coefficients
    at: np.ndarray  # int (n_equations,), the surface control point of each equation, for messages
    # the coordinate, of 3 n_surface, that each equation prefers as dependent; -1 for any
    preferred: np.ndarray  # int (n_equations,)

    @classmethod
    def of(
        cls,
        n_surface: int,  # number of surface control points
        rows: np.ndarray,  # int (m, k), the points of each group
        coefficients: np.ndarray,  # factors of the displacements of the points
        # number, in its group, of the point that is to follow the others, in the coordinate of its largest coefficient
        follower: int = -1,
    ) -> Equations:
        """Collect q equations about each of m groups of k points."""
        rows = np.asarray(rows, dtype=np.int64)
        coefficients = np.broadcast_to(coefficients, (len(rows), *np.shape(coefficients)[-3:]))
        m, q, k, _ = coefficients.shape
        columns = np.broadcast_to((3 * rows[:, :, None] + np.arange(3))[:, None], coefficients.shape)
        starts = np.arange(m * q + 1) * (3 * k)
        shape = (m * q, 3 * n_surface)
        matrix = csr_array((coefficients.flatten(), columns.flatten(), starts), shape=shape)
        matrix.sum_duplicates()
        matrix.eliminate_zeros()
        main = np.abs(coefficients[:, :, follower]).argmax(axis=-1)
        return cls(matrix, np.repeat(rows[:, follower], q), (3 * rows[:, follower, None] + main).ravel())


class LinearConstraint(Protocol):
    """A linear constraint among surface control points."""

    @property
    def name(self) -> str:
        """For messages."""

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations on the displacements from these surface control points, shape (n_surface, 3), in metres."""
        # `InputError` if the constraint cannot be satisfied: it names the constraint and the place


def _checked(name: str, equations: Equations, n_surface: int) -> Equations:
    """Refuse equations of a wrong shape, about points that do not exist, or with coefficients that are not finite."""
    n, width = equations.matrix.shape
    if width != 3 * n_surface or not len(equations.at) == len(equations.preferred) == n:
        raise InputError(
            f"linear constraint '{name}': equations of shape ({n}, {width}) at {len(equations.at)} points; "
            f"give one point for each and shape (n, {3 * n_surface})"
        )
    for what, numbers, stop in (("point", equations.at, n_surface), ("coordinate", equations.preferred, width)):
        if n and not (numbers.min() >= -1 and numbers.max() < stop):
            raise InputError(f"linear constraint '{name}': there is no {what} {numbers.max()}; give 0 to {stop - 1}")
    if not np.isfinite(equations.matrix.data).all():
        raise InputError(f"linear constraint '{name}': a coefficient is not finite; check what it is made of")
    return equations


@dataclass(frozen=True, eq=False)
class Elimination(OneLine):
    """Displacements that satisfy the constraints."""

    # Coordinates are numbered xyz interleaved, like the columns of `Equations`.

    mesh: MovingMesh  # the control mesh whose surface is constrained
    # maps any displacements d to displacements E d that satisfy the constraints: dependent coordinates follow from the
    # others, which keep their values. ``E E = E``, and ``A E = 0``
    matrix: csr_array  # (3 n_surface, 3 n_surface)
    # coordinates that follow from others, and the ones among them that cannot move
    dependent: np.ndarray  # bool (3 n_surface,)
    fixed: np.ndarray  # bool (3 n_surface,)
    # the equation that makes each coordinate dependent; -1 if it is free
    sources: np.ndarray  # int (3 n_surface,)
    # names and equations of all constraints, in the order counted by ``sources``
    constraints: tuple[tuple[str, Equations], ...]

    def reason(self, coordinate: int) -> str:
        """Name the constraint that makes a coordinate dependent, and its place; empty if it is free."""
        source = self.sources[coordinate]
        for name, equations in self.constraints:
            if 0 <= source < len(equations.at):
                place = self.mesh.place_of_surface_point(equations.at[source])
                return f"{name}: {place}"
            source -= len(equations.at) if source >= 0 else 0
        return ""


def eliminate(
    mesh: MovingMesh,  # the control mesh, whose symmetry planes and copies are always constraints
    points: np.ndarray,  # (n_surface, 3), surface control points of the baseline (m)
    constraints: Sequence[LinearConstraint] = (),  # further constraints
) -> Elimination:
    """Solve linear constraints for the coordinates that are to depend on others."""
    # An equation is redundant if it leaves the span of the earlier ones by less than 1e-6 of its largest coefficient.
    # Equations with one coordinate, which fix it, come first; then the symmetry planes and the constraints as declared.
    # `InputError`, with its name, if a constraint cannot be satisfied on this baseline
    in_planes = Equations.of(len(mesh.surface_ids), mesh.in_plane_rows[:, None], mesh.in_plane_normals[:, None, None])
    named = [(SYMMETRY, in_planes)]
    if len(mesh.copies):
        turns = np.eye(3) if mesh.copy_turns is None else mesh.copy_turns
        alike = np.stack(np.broadcast_arrays(turns, -np.eye(3)), axis=-2)
        named.append((SECTION, Equations.of(len(mesh.surface_ids), mesh.copies, alike)))
    named += [(item.name, _checked(item.name, item.equations(mesh, points), len(points))) for item in constraints]
    matrix = vstack([equations.matrix for _, equations in named], format="csr")
    preferred = np.concatenate([equations.preferred for _, equations in named])
    pivots, sources, rows = _solve(matrix, preferred)
    return _elimination(mesh, pivots, sources, rows, tuple(named))


def _solve(matrix: csr_array, preferred: np.ndarray) -> tuple[np.ndarray, np.ndarray, csr_array]:
    """Pivots, their equations, and their rows of coefficients with the sign of E."""
    group = _groups(matrix)
    order = np.lexsort((np.diff(matrix.indptr) > 1, group))
    is_first = np.diff(group[order], prepend=-1) != 0
    ordered = csr_array(matrix[order])
    parts = ordered.indptr.astype(np.int64), ordered.indices.astype(np.int64), ordered.data.astype(float)
    n, preferred = matrix.shape[1], preferred[order].astype(np.int64)
    pivots, sources, starts, columns, values = reduced_rows(*parts, n, preferred, is_first)
    rows = csr_array((-values, columns, starts), shape=(len(pivots), n))
    return pivots, order[sources], rows


def _groups(matrix: csr_array) -> np.ndarray:
    """Number of the group of each equation: groups share no coordinate."""
    joint = block_array([[None, matrix], [matrix.T, None]], format="csr")
    return connected_components(joint, directed=False)[1][: matrix.shape[0]]


def _elimination(
    mesh: MovingMesh, pivots: np.ndarray, sources: np.ndarray, rows: csr_array, named: tuple[tuple[str, Equations], ...]
) -> Elimination:
    """Identity in the independent coordinates, and the rows of the dependent ones."""
    n = rows.shape[1]
    source = np.full(n, -1)
    source[pivots] = sources
    fixed = np.zeros(n, dtype=bool)
    fixed[pivots[np.diff(rows.indptr) == 0]] = True
    free, rows = np.flatnonzero(source < 0), rows.tocoo()
    lines, columns = np.concatenate([free, pivots[rows.row]]), np.concatenate([free, rows.col])
    values = np.concatenate([np.ones(len(free)), rows.data])
    matrix = coo_array((values, (lines, columns)), shape=(n, n)).tocsr()
    return Elimination(mesh, matrix, source >= 0, fixed, source, named)


@njit(cache=True)
def reduced_rows(
    # Equations as rows of a CSR matrix, in the order of use; equations that share coordinates, directly or through
    # others, are adjacent
    indptr,
    indices,
    data,
    n_columns,  # int, number of coordinates
    preferred,  # int (n_equations,), the coordinate that each equation prefers as pivot; -1 for none
    is_first,  # bool (n_equations,), equations that share no coordinate with any earlier one
):
    """Reduce equations by rows, which gives dependent coordinates in terms of independent ones."""
    # 1. Each equation is loaded, and multiples of earlier rows are subtracted to eliminate their pivots.
    # 2. If at most `INDEPENDENT` of its largest coefficient is left, it is redundant.
    # 3. Its pivot is the preferred coordinate, or else the one of its largest coefficient; the row is scaled to one
    #    there.
    # 4. From the last row to the first, later pivots are replaced by their rows.
    # returns pivots, sources int (rank,): dependent coordinates, and the equation of each
    # returns starts int (rank + 1,): start of each row in the columns and values
    # returns columns, values (n_values,): independent coordinates and their coefficients: ``pivot = - sum(values *
    # columns)``
    work = _new_work(n_columns)
    order = np.full(n_columns, -1, dtype=np.int64)
    pivots, sources, rows = _forward(indptr, indices, data, preferred, is_first, order, work)
    reduced = _backward(pivots, order, rows, work)
    n_values = reduced.starts[-1]
    return pivots[::-1], sources[::-1], reduced.starts, reduced.columns[:n_values], reduced.values[:n_values]


@njit(cache=True)
def _forward(indptr, indices, data, preferred, is_first, order, work):
    """Reduce each equation by the earlier ones, steps 1 to 3; `order` becomes the number of each pivot."""
    n = len(indptr) - 1
    pivots, sources = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    rows = _new_rows(n, len(indices))
    rank = first = 0
    for row in range(n):
        first = rank if is_first[row] else first  # earlier groups share no coordinate with this one
        # step 1
        for at in range(indptr[row], indptr[row + 1]):
            _add(work, indices[at], data[at])
        size = _largest(work)
        for k in range(first, rank):
            _subtract_row(work, rows, k, pivots[k])
        pivot = _pivot(work, size, preferred[row])  # steps 2 and 3
        if pivot >= 0:
            rows = _append(rows, rank, work, pivot)
            pivots[rank], sources[rank], order[pivot] = pivot, row, rank
            rank += 1
        _clear(work)
    return pivots[:rank], sources[:rank], rows


@njit(cache=True)
def _backward(pivots, order, rows, work):
    """Replace later pivots in every row by their rows, step 4; the last row comes first."""
    last = len(pivots) - 1
    reduced = _new_rows(len(pivots), len(rows.columns))
    for done in range(len(pivots)):
        k = last - done
        for at in range(rows.starts[k], rows.starts[k + 1]):
            _add(work, rows.columns[at], rows.values[at])
        for at in range(rows.starts[k], rows.starts[k + 1]):
            later = order[rows.columns[at]]
            if later >= 0:
                _subtract_row(work, reduced, last - later, pivots[later])
        _add(work, pivots[k], 1.0)
        reduced = _append(reduced, done, work, pivots[k])
        _clear(work)
    return reduced


@njit(cache=True)
def _pivot(work, size, preferred):
    """Pivot column of a row: the preferred, or the largest, the last of equals; -1 if the row is redundant."""
    largest = _largest(work)
    # step 2
    if largest <= INDEPENDENT * size:
        return -1
    # step 3
    if preferred >= 0 and abs(work.values[preferred]) >= PIVOT * largest:
        return preferred
    pivot = -1
    for column in work.columns[: work.n[0]]:
        if abs(work.values[column]) >= (1.0 - ROUND_OFF) * largest and column > pivot:
            pivot = column
    return pivot


@njit(cache=True)
def _subtract_row(work, rows, k, pivot):
    """Subtract the multiple of row k that eliminates its pivot."""
    factor = work.values[pivot]
    if factor == 0.0:
        return
    work.values[pivot] = 0.0
    for at in range(rows.starts[k], rows.starts[k + 1]):
        _add(work, rows.columns[at], -factor * rows.values[at])


@njit(cache=True)
def _append(rows, k, work, pivot):
    """Store row k, scaled to one at its pivot, without the pivot."""
    rows = _with_room(rows, rows.starts[k] + work.n[0])
    at, scale = rows.starts[k], work.values[pivot]
    for column in np.sort(work.columns[: work.n[0]]):
        value = work.values[column] / scale
        if column != pivot and value != 0.0:
            rows.columns[at] = column
            rows.values[at] = np.sign(value) if abs(abs(value) - 1.0) <= ROUND_OFF else value
            at += 1
    rows.starts[k + 1] = at
    return rows


@njit(cache=True)
def _with_room(rows, n):
    """The same rows, with room for n values."""
    if n <= len(rows.columns):
        return rows
    columns, values = np.empty(2 * n, dtype=np.int64), np.empty(2 * n)
    columns[: len(rows.columns)] = rows.columns
    values[: len(rows.values)] = rows.values
    return Rows(rows.starts, columns, values)


@njit(cache=True)
def _add(work, column, value):
    """Add to one column; a result within round-off of zero becomes zero."""
    if not work.is_in[column]:
        work.is_in[column] = True
        work.columns[work.n[0]] = column
        work.n[0] += 1
    old = work.values[column]
    new = old + value
    work.values[column] = 0.0 if abs(new) <= ROUND_OFF * (abs(old) + abs(value)) else new


@njit(cache=True)
def _largest(work):
    """Return the largest absolute value of the working row."""
    largest = 0.0
    for column in work.columns[: work.n[0]]:
        largest = max(largest, abs(work.values[column]))
    return largest


@njit(cache=True)
def _clear(work):
    """Clear the touched columns of the working row."""
    for column in work.columns[: work.n[0]]:
        work.values[column] = 0.0
        work.is_in[column] = False
    work.n[0] = 0


@njit(cache=True)
def _new_work(n_columns):
    """Return an empty working row."""
    is_in, columns = np.zeros(n_columns, dtype=np.bool_), np.empty(n_columns, dtype=np.int64)
    return Work(np.zeros(n_columns), is_in, columns, np.zeros(1, dtype=np.int64))


@njit(cache=True)
def _new_rows(n, n_values):
    """No rows yet, with room for n of them."""
    return Rows(np.zeros(n + 1, dtype=np.int64), np.empty(n_values, dtype=np.int64), np.empty(n_values))
