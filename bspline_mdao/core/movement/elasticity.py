"""The mesh as a linear elastic solid: Eqs. (6) and (7), section III.B. Theory: ``docs/theory/elasticity.rst``.

The constitutive law is in one place, `stress`; everything else follows from it. The trilinear hexahedra of
`bspline_mdao.core.movement.trilinear` are the finite elements. With the slopes f_i of the coordinates at a Gauss point,
the rows a_i of their adjugate and the Jacobian J, a field u of slopes u_i has the gradient H(u) / J,

    H(u) = u_0 a_0^T + u_1 a_1^T + u_2 a_2^T,

and the work of the stresses of u on the strains of v is a sum over elements and their 2 x 2 x 2 Gauss points of

    w = E / (8 J) stress(H(u)) : H(v),

where E is the modulus of `bspline_mdao.core.movement.young_modulus`. The force on v, its derivatives with respect to
the coordinates and the stiffness matrix K of Eq. (7) are all derivatives of this one expression. J is needed only as a
divisor. In nearly flat or folded elements a positive number replaces it, so K stays positive definite.

Displacements and forces are sums of one or two parts, shape (n_parts, n_points, 3). Two are needed if the corners of an
element lie closer together than the digits of one can resolve: the second part holds the rounding error of the first.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from ...base.numerics.vectors import scaled
from ...base.sparse.cholesky import Cholesky
from ...errors import InputError
from ..mesh.moving_mesh import MovingMesh
from .equilibrium import ALL
from .equilibrium_mover import EquilibriumMover
from .increments import PAPER_INCREMENTS
from .trilinear import (
    FAST,
    SLOPES,
    add_element,
    add_slopes_transposed,
    add_slopes_transposed_to_sum,
    adjugate,
    adjugate_jvp,
    adjugate_vjp,
    at_point,
    divisor_gradient,
    divisor_of,
    gradient,
    put_at_point,
    slopes_of,
    slopes_of_sum,
    sum_of,
    work_of,
)
from .young_modulus import OrthogonalityLaw, StiffnessLaw

__all__ = ["ElasticElements", "LinearElasticity", "add_stiffness", "force", "force_jvp", "force_vjp", "lame_constants"]


@dataclass(frozen=True, eq=False)
class LinearElasticity(EquilibriumMover):
    """Moves a mesh as a linear elastic solid, one linear system per increment.

    Parameters
    ----------
    mesh : MovingMesh
        Mesh to move.
    poisson_ratio : float
        Between -1 and 0.5.
    n_increments : int
        The paper's m, 5 in the paper and by default. Another number is another function of the surface;
        `increments_for` finds the smallest that given designs need.
    stiffness : StiffnessLaw
        Young's modulus of the elements at the start of every increment; the paper's by default.
    solver : object
        Settings of a sparse solver of `bspline_mdao.base.sparse`; `Cholesky` by default.
    keep_factors : bool, optional
        Keep the factor of every increment for the lifetime of the movement, which makes a product with its derivative
        cost a fraction of the move. Otherwise only the factor of the first increment is kept, and each product
        factorises the others again. If None, `ControlMeshMove` keeps them in problems with derivatives, and a direct
        call of ``move`` does not.

    Raises
    ------
    InputError
        If Poisson's ratio is out of range, or the number of increments is not a positive integer.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import LinearElasticity, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> mover = LinearElasticity(mesh, n_increments=2)
    >>> movement = mover.move(mesh.points, mesh.points[mesh.surface_ids] * [1.0, 1.2, 1.0])  # 20 % thicker
    >>> movement.points.shape, movement.vjp(movement.points)[1].shape  # and derivatives with respect to the surface
    ((78, 3), (26, 3))
    """

    mesh: MovingMesh
    poisson_ratio: float = -0.2
    n_increments: int = PAPER_INCREMENTS
    stiffness: StiffnessLaw = field(default_factory=OrthogonalityLaw)
    solver: object = field(default_factory=Cholesky)
    keep_factors: bool | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not -1.0 < self.poisson_ratio < 0.5:
            raise InputError(f"elasticity: Poisson's ratio {self.poisson_ratio}; give a number between -1 and 0.5")

    def _elements(self, initial: np.ndarray, before: np.ndarray) -> ElasticElements:
        modulus = self.stiffness.modulus(self.mesh, initial, before)
        lame = lame_constants(self.poisson_ratio)
        return ElasticElements(self.mesh, self.stiffness, lame, initial, before, modulus)


@dataclass(frozen=True, eq=False)
class ElasticElements:
    """Elastic elements at given points, see `bspline_mdao.core.movement.equilibrium_mover.Elements`."""

    mesh: MovingMesh
    law: StiffnessLaw
    lame: tuple[float, float]
    initial: np.ndarray
    points: np.ndarray
    modulus: np.ndarray

    @property
    def _arguments(self) -> tuple:
        return self._arguments_of(ALL)

    def _arguments_of(self, ids: slice | np.ndarray) -> tuple:
        mesh = self.mesh
        return self.points, mesh.elements[ids], mesh.handedness[ids], self.modulus[ids], self.lame

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
        d_modulus = self.law.modulus_jvp(self.mesh, self.initial, self.points, d_initial, d_points)
        return force_jvp(*self._arguments, displacement, d_points, d_modulus)

    def force_vjp(self, displacement: np.ndarray, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `force_jvp` and of `force`."""
        points_bar, modulus_bar, displacement_bar = force_vjp(*self._arguments, displacement, bar)
        initial_bar, law_bar = self.law.modulus_vjp(self.mesh, self.initial, self.points, modulus_bar)
        return initial_bar, points_bar + law_bar, displacement_bar


def lame_constants(poisson_ratio: float) -> tuple[float, float]:
    """Lame's constants lambda and mu for a Young's modulus of 1."""
    nu = poisson_ratio
    return nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 / (1.0 + nu)


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc", "nnan"}, forceinline=True)
def stress(h, lame):
    """Stress of Eq. (6), tau = lambda tr(e) I + 2 mu e with e = (h + h^T) / 2: components xx, yy, zz, yz, zx, xy."""
    # h is the gradient of the displacement, three rows. This is the only statement of the elastic law. The flag "nnan"
    # lets the compiler drop the products with the zeros of `_pair_block`; NaN stays NaN.
    pressure, twice = lame[0] * (h[0][0] + h[1][1] + h[2][2]), 2.0 * lame[1]
    return (
        pressure + twice * h[0][0],
        pressure + twice * h[1][1],
        pressure + twice * h[2][2],
        lame[1] * (h[1][2] + h[2][1]),
        lame[1] * (h[2][0] + h[0][2]),
        lame[1] * (h[0][1] + h[1][0]),
    )


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def _stress(u, a, lame):
    """Stress of H(u)."""
    return stress(gradient(u, a), lame)


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def _traction(tau, v):
    """Force of a stress tau on an area, given as its normal times its size."""
    xx, yy, zz, yz, zx, xy = tau
    return (
        xx * v[0] + xy * v[1] + zx * v[2],
        xy * v[0] + yy * v[1] + yz * v[2],
        zx * v[0] + yz * v[1] + zz * v[2],
    )


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def _fluxes(tau, a, factor):
    """Derivatives of the work on v with respect to its slopes v_i."""
    return (
        scaled(factor, _traction(tau, a[0])),
        scaled(factor, _traction(tau, a[1])),
        scaled(factor, _traction(tau, a[2])),
    )


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _element_force(f_s, u_s, sign, weight, lame, out):
    """Fluxes of u at the Gauss points: their transposed slopes are the force."""
    for g in range(8):
        f = at_point(f_s, g)
        a = adjugate(f)
        divisor, _, _ = divisor_of(f, a, sign)
        put_at_point(_fluxes(_stress(at_point(u_s, g), a, lame), a, weight / divisor), g, out)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _element_force_jvp(f_s, u_s, df_s, sign, weight, d_weight, lame, out):
    """Change of the fluxes of a given u."""
    for g in range(8):
        f, u, df = at_point(f_s, g), at_point(u_s, g), at_point(df_s, g)
        a, da = adjugate(f), adjugate_jvp(f, df)
        divisor, jacobian_slope, length_slope = divisor_of(f, a, sign)
        d_divisor = work_of(divisor_gradient(f, a, jacobian_slope, length_slope), df)
        factor, tau = weight / divisor, _stress(u, a, lame)
        changes = (
            _fluxes(tau, a, (d_weight - factor * d_divisor) / divisor),
            _fluxes(_stress(u, da, lame), a, factor),
            _fluxes(tau, da, factor),
        )
        for i in range(3):
            for d in range(3):
                out[i, d, g] = changes[0][i][d] + changes[1][i][d] + changes[2][i][d]


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _element_force_vjp(f_s, u_s, v_s, sign, weight, lame, f_bar, u_bar):
    """Derivatives of the work w of u on v with respect to the slopes of x and u; returns the work over the weight."""
    total = 0.0 * weight
    for g in range(8):
        f, u, v = at_point(f_s, g), at_point(u_s, g), at_point(v_s, g)
        a = adjugate(f)
        divisor, jacobian_slope, length_slope = divisor_of(f, a, sign)
        tau_u, tau_v, factor = _stress(u, a, lame), _stress(v, a, lame), weight / divisor
        fluxes = _fluxes(tau_v, a, factor)
        work = work_of(fluxes, u)
        a_bar = sum_of(_fluxes(tau_u, v, factor), _fluxes(tau_v, u, factor))
        divisor_slope = -work / divisor
        divisor_bar = divisor_gradient(f, a, divisor_slope * jacobian_slope, divisor_slope * length_slope)
        put_at_point(sum_of(adjugate_vjp(f, a_bar), divisor_bar), g, f_bar)
        put_at_point(fluxes, g, u_bar)
        total += work
    return total / weight


@njit(cache=True)
def force(
    points: np.ndarray,  # (n_points, 3), coordinates (m)
    # (n_elements, 8) of int, points at the corners, see `bspline_mdao.core.mesh.moving_mesh.MovingMesh.elements`
    elements: np.ndarray,
    signs: np.ndarray,  # (n_elements,) of int, handedness
    modulus: np.ndarray,  # (n_elements,), Young's modulus, positive
    lame: tuple[float, float],  # from `lame_constants`
    # (n_parts, n_points, 3), the field u as a sum of parts (m). Two are needed if the corners of an element lie closer
    # together than the digits of one can resolve: the second holds the rounding error of the first.
    displacement: np.ndarray,
) -> np.ndarray:  # (n_parts, n_points, 3), as a sum of equally many parts
    """Compute the force K u on every point, matrix-free."""
    total = np.zeros_like(displacement)
    x, u, fluxes = (
        np.empty((3, 3, 8), points.dtype),
        np.empty((3, 3, 8), points.dtype),
        np.empty((3, 3, 8), points.dtype),
    )
    for e in range(len(elements)):
        corners = elements[e]
        slopes_of(points, corners, x)
        slopes_of_sum(displacement, corners, u)
        _element_force(x, u, float(signs[e]), 0.125 * modulus[e], lame, fluxes)
        add_slopes_transposed_to_sum(fluxes, corners, total)
    return total


@njit(cache=True)
def force_jvp(points, elements, signs, modulus, lame, displacement, d_points, d_modulus):
    """Change of `force` for changes of the points and the modulus; in the displacement, `force` is linear."""
    # The result is a sum of as many parts as the displacement.
    total = np.zeros_like(displacement)
    x, u, fluxes = (
        np.empty((3, 3, 8), points.dtype),
        np.empty((3, 3, 8), points.dtype),
        np.empty((3, 3, 8), points.dtype),
    )
    dx = np.empty((3, 3, 8), points.dtype)
    for e in range(len(elements)):
        corners = elements[e]
        slopes_of(points, corners, x)
        slopes_of_sum(displacement, corners, u)
        slopes_of(d_points, corners, dx)
        weight, d_weight = 0.125 * modulus[e], 0.125 * d_modulus[e]
        _element_force_jvp(x, u, dx, float(signs[e]), weight, d_weight, lame, fluxes)
        add_slopes_transposed_to_sum(fluxes, corners, total)
    return total


@njit(cache=True)
def force_vjp(
    points: np.ndarray,  # points, elements, signs, modulus, lame, displacement: as for `force`
    elements: np.ndarray,
    signs: np.ndarray,
    modulus: np.ndarray,
    lame: tuple[float, float],
    displacement: np.ndarray,
    bar: np.ndarray,  # (n_parts, n_points, 3), derivative of a scalar with respect to the force, as a sum of parts
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Transpose of `force_jvp` and of `force`."""
    # Returns points_bar: (n_points, 3), derivative with respect to the points; modulus_bar: (n_elements,), the same for
    # the modulus; displacement_bar: (n_points, 3), the same for the displacement: the force of ``bar``.
    points_bar, modulus_bar, displacement_bar = np.zeros_like(points), np.empty_like(modulus), np.zeros_like(points)
    x, u, v = np.empty((3, 3, 8), points.dtype), np.empty((3, 3, 8), points.dtype), np.empty((3, 3, 8), points.dtype)
    x_bar, u_bar = np.empty((3, 3, 8), points.dtype), np.empty((3, 3, 8), points.dtype)
    for e in range(len(elements)):
        corners = elements[e]
        slopes_of(points, corners, x)
        slopes_of_sum(displacement, corners, u)
        slopes_of_sum(bar, corners, v)
        modulus_bar[e] = 0.125 * _element_force_vjp(x, u, v, float(signs[e]), 0.125 * modulus[e], lame, x_bar, u_bar)
        add_slopes_transposed(x_bar, corners, points_bar)
        add_slopes_transposed(u_bar, corners, displacement_bar)
    return points_bar, modulus_bar, displacement_bar


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _shape_gradients(f_s, sign, weight, gradients, weighted):
    """Gradients of the corners' shape functions times J at all Gauss points g."""
    # Component d of corner c is in ``gradients[g, 8 d + c]``, and times the weight divided by J in ``weighted[8 d + c,
    # g]``: the corners lie side by side in memory, as SIMD lanes.
    for g in range(8):
        f = at_point(f_s, g)
        a = adjugate(f)
        divisor, _, _ = divisor_of(f, a, sign)
        factor = weight / divisor
        for d in range(3):
            for c in range(8):
                value = a[0][d] * SLOPES[g, 0, c] + a[1][d] * SLOPES[g, 1, c] + a[2][d] * SLOPES[g, 2, c]
                gradients[g, 8 * d + c] = value
                weighted[8 * d + c, g] = factor * value


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _element_products(gradients, weighted, products):
    """Integrals of dN_a/dx_c dN_b/dx_d in ``products[8 c + a, 8 d + b]`` for c >= d: sums over the Gauss points."""
    for row in range(24):
        w_0, w_1, w_2, w_3 = weighted[row, 0], weighted[row, 1], weighted[row, 2], weighted[row, 3]
        w_4, w_5, w_6, w_7 = weighted[row, 4], weighted[row, 5], weighted[row, 6], weighted[row, 7]
        for column in range(8 * (row // 8 + 1)):
            products[row, column] = (
                (w_0 * gradients[0, column] + w_1 * gradients[1, column])
                + (w_2 * gradients[2, column] + w_3 * gradients[3, column])
                + (w_4 * gradients[4, column] + w_5 * gradients[5, column])
                + (w_6 * gradients[6, column] + w_7 * gradients[7, column])
            )


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc", "nnan"}, forceinline=True)
def _pair_force(h_x, h_y, h_z, lame):
    """Force on a corner: along each axis j, the row of the stress of h_j that belongs to its slope along j."""
    x, y, z = stress(h_x, lame), stress(h_y, lame), stress(h_z, lame)
    return x[0] + y[5] + z[4], x[5] + y[1] + z[3], x[4] + y[3] + z[2]


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _pair_block(products, a, b, lame, block):
    """Stiffness between corners a and b: column d is the force on a for a displacement of b along d."""
    # With S_jl the integral of dN_a/dx_j dN_b/dx_l, this displacement has the gradients whose row d is S_j, one for
    # each slope j of corner a, and whose other rows are zero.
    none = (0.0, 0.0, 0.0)
    x = (products[a, b], products[8 + b, a], products[16 + b, a])
    y = (products[8 + a, b], products[8 + a, 8 + b], products[16 + b, 8 + a])
    z = (products[16 + a, b], products[16 + a, 8 + b], products[16 + a, 16 + b])
    of_x = _pair_force((x, none, none), (y, none, none), (z, none, none), lame)
    of_y = _pair_force((none, x, none), (none, y, none), (none, z, none), lame)
    of_z = _pair_force((none, none, x), (none, none, y), (none, none, z), lame)
    for c in range(3):
        block[c, 0], block[c, 1], block[c, 2] = of_x[c], of_y[c], of_z[c]


@njit(cache=True)
def add_stiffness(
    points: np.ndarray,  # points, elements, signs, modulus, lame: as for `force`
    elements: np.ndarray,
    signs: np.ndarray,
    modulus: np.ndarray,
    lame: tuple[float, float],
    rows: np.ndarray,  # (n_elements, 8) of int, block row of every corner, -1 for none
    # (n_elements, 36) of int, place of every pair of corners, see `bspline_mdao.base.sparse.blocks.slots`
    slots: np.ndarray,
    data: np.ndarray,  # (n_blocks, 3, 3), blocks of the lower triangle, added to
) -> None:
    """Add the stiffness K of Eq. (7) of all elements to the blocks of a symmetric matrix."""
    # The products S of the gradients of all corners are sums over the Gauss points of products of two vectors of 24,
    # and the block of two corners follows from their nine by the law.
    x, stiffness = np.empty((3, 3, 8), points.dtype), np.empty((8, 8, 3, 3), points.dtype)
    gradients, weighted = np.empty((8, 24), points.dtype), np.empty((24, 8), points.dtype)
    products = np.empty((24, 24), points.dtype)
    for e in range(len(elements)):
        slopes_of(points, elements[e], x)
        _shape_gradients(x, float(signs[e]), 0.125 * modulus[e], gradients, weighted)
        _element_products(gradients, weighted, products)
        for a in range(8):
            for b in range(a + 1):
                _pair_block(products, a, b, lame, stiffness[a, b])
        add_element(stiffness, rows[e], slots[e], data)
