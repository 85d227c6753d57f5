"""Spring analogy: the mesh as a network of lineal springs, and torsional springs at the corners of elements.

Theory: ``docs/theory/springs.rst``. The stiffness is updated at the start of every increment.

Every spring resists the change of one number Q of an element, with a stiffness of 1: its energy for a displacement u
is (g . u)^2 / 2 with g the gradient of Q with respect to the corners
(`bspline_mdao.core.movement.spring_gradients`). Its stiffness in the usual sense is contained in Q:

- along an edge, a face diagonal or a body diagonal of length L, dQ = dL / L: stiffness 1 / L^2;
- between two edges at a corner with angle theta, dQ = d theta / sin(theta): stiffness 1 / sin(theta)^2;
- at a corner with triple product t of unit edges, dQ = dt / t.

The last two are regularised (`bspline_mdao.core.movement.trilinear`). An edge counts a quarter and a face diagonal a
half, since four and two elements share them. The second derivatives of Q are symmetric, so the change of g along a
field gives the derivatives of the force in both directions.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from ...base.numerics.vectors import add_to, dot, row, scaled
from ...base.sparse.cholesky import Cholesky
from ..mesh.moving_mesh import MovingMesh
from .equilibrium import ALL
from .equilibrium_mover import EquilibriumMover
from .increments import PAPER_INCREMENTS
from .spring_gradients import COUNTS, N_LINEAL, N_SPRINGS, POINTS, gradient, gradient_change
from .trilinear import add_element, add_exactly

__all__ = ["SpringElements", "TorsionalSprings", "add_stiffness", "force", "force_jvp", "force_vjp"]


@dataclass(frozen=True, eq=False)
class TorsionalSprings(EquilibriumMover):
    """Moves a mesh as lineal springs of stiffness 1 / L^2 and torsional springs at the corners of its elements.

    Parameters
    ----------
    mesh : MovingMesh
        Mesh to move.
    n_increments : int
        Number of increments, as for `bspline_mdao.core.movement.elasticity.LinearElasticity`.
    torsion : float
        Stiffness of the torsional springs relative to the lineal ones.
    solver : object
        Settings of a sparse solver of `bspline_mdao.base.sparse`; `Cholesky` by default.
    keep_factors : bool, optional
        As for `bspline_mdao.core.movement.elasticity.LinearElasticity`.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import TorsionalSprings, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> moved_surface = mesh.points[mesh.surface_ids] * [1.0, 1.2, 1.0]
    >>> movement = TorsionalSprings(mesh, torsion=0.1).move(mesh.points, moved_surface)
    >>> mesh.tangled(movement.points).n_invalid
    0
    """

    mesh: MovingMesh
    n_increments: int = PAPER_INCREMENTS
    torsion: float = 0.01
    solver: object = field(default_factory=Cholesky)
    keep_factors: bool | None = None

    def _elements(self, initial: np.ndarray, before: np.ndarray) -> SpringElements:
        return SpringElements(self.mesh, float(np.sqrt(self.torsion)), before)


@dataclass(frozen=True, eq=False)
class SpringElements:
    """Springs of all elements at given points, see `bspline_mdao.core.movement.equilibrium_mover.Elements`."""

    mesh: MovingMesh
    torsion: float  # factor of dQ for torsional springs
    points: np.ndarray

    @property
    def _arguments(self) -> tuple:
        return self._arguments_of(ALL)

    def _arguments_of(self, ids: slice | np.ndarray) -> tuple:
        mesh = self.mesh
        of_elements = mesh.elements[ids], mesh.handedness[ids], mesh.degenerate_corners[ids]
        return self.points, *of_elements, self.torsion

    def add_stiffness(
        self, element_rows: np.ndarray, slots: np.ndarray, data: np.ndarray, element_ids: slice | np.ndarray = ALL
    ) -> None:
        """Add the stiffness of all elements, or of some, to blocks."""
        add_stiffness(*self._arguments_of(element_ids), element_rows, slots, data)

    def force(self, displacement: np.ndarray) -> np.ndarray:
        """Force on all points."""
        return force(*self._arguments, displacement)

    def force_jvp(self, displacement: np.ndarray, d_initial: np.ndarray, d_points: np.ndarray) -> np.ndarray:
        """Change of the force of a given displacement."""
        return force_jvp(*self._arguments, displacement, d_points)

    def force_vjp(self, displacement: np.ndarray, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `force_jvp` and of `force`."""
        points_bar, displacement_bar = force_vjp(*self._arguments, displacement, bar)
        return np.zeros_like(self.points), points_bar, displacement_bar


@njit(cache=True)
def _relative(u, n, c):
    """Displacement of corner c of spring n relative to its first corner; u is a sum of two parts."""
    start, end = POINTS[n, 0], POINTS[n, c]
    return (  # in this order, which `bspline_mdao.base.numerics.vectors` would be free to change
        (u[0, end, 0] - u[0, start, 0]) + (u[1, end, 0] - u[1, start, 0]),
        (u[0, end, 1] - u[0, start, 1]) + (u[1, end, 1] - u[1, start, 1]),
        (u[0, end, 2] - u[0, start, 2]) + (u[1, end, 2] - u[1, start, 2]),
    )


@njit(cache=True)
def _stretch(g, n, u):
    """Product g . u of spring n, with relative displacements: the rows of g sum to zero, and more digits are kept."""
    total = 0.0
    for c in range(1, COUNTS[n]):
        total += dot(row(g, c), _relative(u, n, c))
    return total


@njit(cache=True)
def _add_force(g, n, factor, f):
    """Add factor times g to the corners of spring n."""
    for c in range(COUNTS[n]):
        add_to(f, POINTS[n, c], scaled(factor, row(g, c)))


@njit(cache=True)
def _add_force_to_sum(g, n, factor, n_parts, f):
    """Add factor times g to the corners of spring n, as a sum of two parts if given: the total is exactly zero."""
    if n_parts == 1:
        _add_force(g, n, factor, f[0])
        return
    for c in range(1, COUNTS[n]):
        for d in range(3):
            add_exactly(f, POINTS[n, c], d, factor * g[c, d])
            add_exactly(f, POINTS[n, 0], d, -factor * g[c, d])


@njit(cache=True)
def _combine(n, a, u, b, v, w):
    """Set w to a u + b v at the corners of spring n, beyond its first corner."""
    for c in range(COUNTS[n]):
        p, q = _relative(u, n, c), _relative(v, n, c)
        for d in range(3):
            w[POINTS[n, c], d] = a * p[d] + b * q[d]


@njit(cache=True)
def _is_degenerate(n, bits):
    """True for a spring at a corner with a collapsed edge."""
    return n >= N_LINEAL and (bits >> POINTS[n, 0]) & 1 != 0


@njit(cache=True)
def _gather(values, corners, local):
    for c in range(8):
        for d in range(3):
            local[c, d] = values[corners[c], d]


@njit(cache=True)
def _gather_sum(parts, corners, local):
    """Gather a sum of one or two parts as two parts."""
    for part in range(len(parts)):
        _gather(parts[part], corners, local[part])
    local[len(parts) :] = 0.0


@njit(cache=True)
def _scatter(local, corners, values):
    for c in range(8):
        for d in range(3):
            values[corners[c], d] += local[c, d]


@njit(cache=True)
def _scatter_sum(local, corners, parts):
    """Add the values at the corners, two parts, to a sum of one or two parts."""
    if len(parts) == 1:
        _scatter(local[0], corners, parts[0])
        return
    for c in range(8):
        for d in range(3):
            add_exactly(parts, corners[c], d, local[0, c, d])
            parts[1, corners[c], d] += local[1, c, d]


@njit(cache=True)
def force(
    points: np.ndarray,  # (n_points, 3), coordinates (m)
    elements: np.ndarray,  # (n_elements, 8) of int, points at the corners
    signs: np.ndarray,  # (n_elements,) of int, handedness
    degenerate_corners: np.ndarray,  # (n_elements,), bits of the corners without torsional springs
    torsion: float,  # factor of dQ for torsional springs
    # (n_parts, n_points, 3), the field u as a sum of parts (m), see `bspline_mdao.core.movement.elasticity.force`
    displacement: np.ndarray,
) -> np.ndarray:  # (n_parts, n_points, 3), as a sum of equally many parts
    """Compute the force K u on every point."""
    total, n_parts = np.zeros_like(displacement), len(displacement)
    x, u, f, g = np.empty((8, 3)), np.empty((2, 8, 3)), np.empty((2, 8, 3)), np.empty((4, 3))
    for e in range(len(elements)):
        _gather(points, elements[e], x)
        _gather_sum(displacement, elements[e], u)
        f[:] = 0.0
        for n in range(N_SPRINGS):
            if not _is_degenerate(n, degenerate_corners[e]):
                gradient(x, n, float(signs[e]), torsion, g)
                _add_force_to_sum(g, n, _stretch(g, n, u), n_parts, f)
        _scatter_sum(f, elements[e], total)
    return total


@njit(cache=True)
def force_jvp(points, elements, signs, degenerate_corners, torsion, displacement, d_points):
    """Change of `force` for a change of the points, in equally many parts; `force` is linear in the displacement."""
    total, n_parts = np.zeros_like(displacement), len(displacement)
    x, u, f, g = np.empty((8, 3)), np.empty((2, 8, 3)), np.empty((2, 8, 3)), np.empty((4, 3))
    dx, dg = np.empty((8, 3)), np.empty((4, 3))
    for e in range(len(elements)):
        sign = float(signs[e])
        _gather(points, elements[e], x)
        _gather_sum(displacement, elements[e], u)
        _gather(d_points, elements[e], dx)
        f[:] = 0.0
        for n in range(N_SPRINGS):
            if not _is_degenerate(n, degenerate_corners[e]):
                gradient(x, n, sign, torsion, g)
                gradient_change(x, dx, n, sign, torsion, dg)
                _add_force_to_sum(dg, n, _stretch(g, n, u), n_parts, f)
                _add_force_to_sum(g, n, _stretch(dg, n, u), n_parts, f)
        _scatter_sum(f, elements[e], total)
    return total


@njit(cache=True)
def force_vjp(points, elements, signs, degenerate_corners, torsion, displacement, bar):
    """Transpose of `force_jvp` and of `force`: derivatives with respect to the points and the displacement."""
    # ``bar``, shape (n_parts, n_points, 3), is the derivative of a scalar with respect to the force, a sum of parts.
    points_bar, displacement_bar = np.zeros_like(points), np.zeros_like(points)
    x, w, u, v = np.empty((8, 3)), np.empty((8, 3)), np.empty((2, 8, 3)), np.empty((2, 8, 3))
    x_bar, u_bar = np.empty((8, 3)), np.empty((8, 3))
    g, dg = np.empty((4, 3)), np.empty((4, 3))
    for e in range(len(elements)):
        sign = float(signs[e])
        _gather(points, elements[e], x)
        _gather_sum(displacement, elements[e], u)
        _gather_sum(bar, elements[e], v)
        x_bar[:] = 0.0
        u_bar[:] = 0.0
        for n in range(N_SPRINGS):
            if not _is_degenerate(n, degenerate_corners[e]):
                gradient(x, n, sign, torsion, g)
                u_stretch, v_stretch = _stretch(g, n, u), _stretch(g, n, v)
                _combine(n, v_stretch, u, u_stretch, v, w)
                gradient_change(x, w, n, sign, torsion, dg)
                _add_force(g, n, v_stretch, u_bar)
                _add_force(dg, n, 1.0, x_bar)
        _scatter(x_bar, elements[e], points_bar)
        _scatter(u_bar, elements[e], displacement_bar)
    return points_bar, displacement_bar


@njit(cache=True)
def add_stiffness(points, elements, signs, degenerate_corners, torsion, rows, slots, data):
    """Add the stiffness of all springs to blocks, see `bspline_mdao.core.movement.elasticity.add_stiffness`."""
    x, g, stiffness = np.empty((8, 3)), np.empty((4, 3)), np.empty((8, 8, 3, 3))
    for e in range(len(elements)):
        _gather(points, elements[e], x)
        stiffness[:] = 0.0
        for n in range(N_SPRINGS):
            if not _is_degenerate(n, degenerate_corners[e]):
                gradient(x, n, float(signs[e]), torsion, g)
                _add_square(g, n, stiffness)
        add_element(stiffness, rows[e], slots[e], data)


@njit(cache=True)
def _add_square(g, n, stiffness):
    """Add g g^T of spring n for each pair of its corners."""
    for a in range(COUNTS[n]):
        for b in range(COUNTS[n]):
            for c in range(3):
                for d in range(3):
                    stiffness[POINTS[n, a], POINTS[n, b], c, d] += g[a, c] * g[b, d]
