"""Lower bounds of the Jacobians of cells of mixed kinds with straight edges, by Bernstein coefficients.

======================== ==================================================================================
tetrahedron              constant: the triple product of the edges at a corner
wedge                    linear in the triangle and quadratic across it: three at each corner of the triangle
pyramid                  quadratic over the base, times (1 - zeta)^2: nine, those of the hexahedron whose upper
                         corners all coincide with the apex
hexahedron               27, see `.jacobian_bounds`
======================== ==================================================================================

A wedge is positive if it is on its three edges across, each a polynomial of one variable. Polyhedra have no map, and
no bound. Programs disagree about the orientation of cells, so the sign of most cells of a kind is taken.

Theory: ``docs/theory/validity.rst``.

References
----------
A. Johnen, J.-F. Remacle and C. Geuzaine, Geometrical validity of curvilinear finite elements, *Journal of Computational
Physics* 233, 2013, pp. 359-372.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from ...base.numerics.threads import run_tasks, thread_count
from .bernstein import INVALID, MAX_HALVINGS, VALID, decide
from .certificate import BlockCertificate, of_statuses
from .jacobian_bounds import ROUNDING, SMALLEST, coefficients_of, edges_of, triple
from .mixed_cells import MixedMesh

__all__ = ["certify_mixed", "jacobian_bounds"]

ORDER = np.array(
    [[0, 1, 2, 3, 0, 0, 0, 0], [0, 1, 3, 2, 4, 4, 4, 4], [0, 1, 2, 3, 4, 5, 0, 0], [0, 1, 3, 2, 4, 5, 7, 6]]
)
"""Corners of tetrahedra, pyramids, wedges and hexahedra in the order needed: the first corner of a hexahedron is joined
to corners 1, 2 and 4."""

TETRA, PYRAMID, WEDGE, HEXAHEDRON = 0, 1, 2, 3
SHAPES = np.array([[1, 1, 1], [1, 3, 3], [1, 1, 3], [3, 3, 3]])
"""Numbers of each kind, and the shapes of its coefficients; a wedge has three of these in sequence."""

KIND = {"tetra": TETRA, "pyramid": PYRAMID, "wedge": WEDGE, "hexahedron": HEXAHEDRON}

PIECE = 1 << 15
"""Number of cells that a thread takes at once."""


def jacobian_bounds(
    mesh: MixedMesh,  # the mesh on the baseline
    points: np.ndarray | None = None,  # (n, 3), its nodes (m); by default the baseline's
    n_threads: int | None = None,
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Statuses of the cells of each kind, and lower bounds of their Jacobians, of pyramids at their base."""
    found = {}
    for kind, cells in mesh.cells.items():
        if len(cells):
            # the mean of the coefficients, a multiple of the volume, has the sign of the cells
            means = np.empty(len(cells))
            _over_pieces(_means, KIND[kind], mesh.points, cells, 1.0, means, n_threads=n_threads)
            sign = -1.0 if np.count_nonzero(means < 0.0) > 0.5 * len(cells) else 1.0
            status, bounds = np.empty(len(cells), dtype=np.uint8), np.empty(len(cells))
            at = mesh.points if points is None else points
            _over_pieces(_decide, KIND[kind], at, cells, sign, status, bounds, n_threads=n_threads)
            found[kind] = status, bounds
    return found


def certify_mixed(
    mesh: MixedMesh,  # the mesh on the baseline
    points: np.ndarray | None = None,  # (n, 3), its nodes (m); by default the baseline's
) -> tuple[BlockCertificate, ...]:  # one for each kind of cells that have a map; none for polyhedra
    """Prove which cells are valid: cells whose maps have a positive Jacobian everywhere inside."""
    return tuple(
        of_statuses(mesh.kind_in_file(kind), "cell", status)
        for kind, (status, _) in jacobian_bounds(mesh, points).items()
    )


def _over_pieces(
    kernel: Callable,
    kind: int,
    points: np.ndarray,
    cells: np.ndarray,
    sign: float,
    *results: np.ndarray,
    n_threads: int | None,
) -> None:
    """Call a kernel for pieces of the cells, on several threads."""
    pieces = [slice(k, k + PIECE) for k in range(0, len(cells), PIECE)]
    points = np.ascontiguousarray(points)

    def run(piece: slice) -> None:
        kernel(kind, points, cells[piece], sign, *(result[piece] for result in results))

    run_tasks(run, pieces, thread_count(n_threads))


@njit(cache=True, nogil=True, error_model="numpy")
def _vector(corners, p, q, out):
    """Write the edge from one corner to another, and return its size in the sum norm."""
    size = 0.0
    for c in range(3):
        out[c] = corners[q, c] - corners[p, c]
        size += abs(out[c])
    return size


@njit(cache=True, nogil=True, error_model="numpy")
def _longest(edges):
    """Product of the sizes of the longest edges of three directions, in the sum norm."""
    product = 1.0
    for d in range(3):
        longest = 0.0
        for e in range(4):
            longest = max(longest, abs(edges[d, e, 0]) + abs(edges[d, e, 1]) + abs(edges[d, e, 2]))
        product *= longest
    return product


@njit(cache=True, nogil=True, error_model="numpy")
def _wedge(corners, sign, edges, out):
    """Write three coefficients for each corner of the triangle of a wedge, and return their error bound."""
    a, b, c = edges[0], edges[1], edges[2]
    along_a = max(_vector(corners, 0, 1, a[0]), _vector(corners, 3, 4, a[1]))
    along_b = max(_vector(corners, 0, 2, b[0]), _vector(corners, 3, 5, b[1]))
    along_c = 0.0
    for v in range(3):
        along_c = max(along_c, _vector(corners, v, v + 3, c[v]))
        out[3 * v] = sign * triple(a[0], b[0], c[v])
        out[3 * v + 1] = 0.5 * sign * (triple(a[0], b[1], c[v]) + triple(a[1], b[0], c[v]))
        out[3 * v + 2] = sign * triple(a[1], b[1], c[v])
    return ROUNDING * along_a * along_b * along_c + SMALLEST


@njit(cache=True, nogil=True, error_model="numpy")
def _coefficients(kind, corners, sign, edges, out):
    """Write the coefficients of a cell; return their number and their error bound."""
    if kind == WEDGE:
        return 9, _wedge(corners, sign, edges, out)
    if kind == TETRA:
        e = edges[0]
        sizes = _vector(corners, 0, 1, e[0]), _vector(corners, 0, 2, e[1]), _vector(corners, 0, 3, e[2])
        out[0] = sign * triple(e[0], e[1], e[2])
        return 1, ROUNDING * sizes[0] * sizes[1] * sizes[2] + SMALLEST
    edges_of(corners, edges)
    coefficients_of(edges, sign, out)
    return (9 if kind == PYRAMID else 27), ROUNDING * _longest(edges) + SMALLEST


@njit(cache=True, nogil=True, error_model="numpy")
def _corners_of(points, cell, order, corners):
    """Write the corners of a cell, shape (8, 3)."""
    for c in range(8):
        node = cell[order[c]]
        for d in range(3):
            corners[c, d] = points[node, d]


@njit(cache=True, nogil=True, error_model="numpy")
def _means(kind, points, cells, sign, means):
    """Write the mean coefficient of each cell."""
    corners, edges, out = np.empty((8, 3)), np.zeros((3, 4, 3)), np.empty(27)
    for cell in range(len(cells)):
        _corners_of(points, cells[cell], ORDER[kind], corners)
        n, _ = _coefficients(kind, corners, sign, edges, out)
        means[cell] = np.mean(out[:n])


@njit(cache=True, nogil=True, error_model="numpy")
def _decide(kind, points, cells, sign, status, bound):
    """Write the status of each cell and a lower bound of its Jacobian, halving if coefficients do not suffice."""
    corners, edges, out = np.empty((8, 3)), np.zeros((3, 4, 3)), np.empty(27)
    for cell in range(len(cells)):
        _corners_of(points, cells[cell], ORDER[kind], corners)
        n, margin = _coefficients(kind, corners, sign, edges, out)
        least = np.min(out[:n])
        if least > margin:
            status[cell], bound[cell] = VALID, least - margin
            continue
        status[cell], bound[cell] = VALID, np.inf
        l, m, k = SHAPES[kind]
        for first in range(0, n, l * m * k):
            box = out[first : first + l * m * k].reshape((l, m, k))
            known, found = decide(box, box, margin, False, MAX_HALVINGS)
            status[cell], bound[cell] = max(status[cell], known), min(bound[cell], found)
        if status[cell] == INVALID:
            bound[cell] = least - margin
