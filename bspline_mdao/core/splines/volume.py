"""The mapping of a B-spline volume from parameters to points, Eq. (3), with its first and second derivatives.

Curves and surfaces are volumes with one or two degenerate directions: one control point, order 1 and knots (0, 1).

The sums over the sub-net of control points that a point depends on are here for every use except the evaluator's own
kernel (`bspline_mdao.core.evaluation.simd_contraction`). `basis_products` gives the factors of the control points, rows
of the matrix of an evaluation or a fit, and `partial_sums` the derivatives. Theory: ``docs/theory/splines.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ...base.display import OneLine
from ...base.numerics.rows import copy_row
from ...errors import InputError
from .basis import basis, basis_gradients, basis_jets
from .knots import ConstantKnots, Knots

_CHUNK = 2048  # points at a time: their basis functions stay in the cache


@dataclass(frozen=True, eq=False)
class Volume(OneLine):
    """A B-spline volume without its control points."""

    knots: tuple[Knots, ...]  # knots of the directions xi, eta and zeta; they carry order and number of control points

    def __post_init__(self) -> None:
        if len(self.knots) != 3:
            raise InputError(f"volume: knots of {len(self.knots)} directions; give three, or use Volume.of(...)")
        object.__setattr__(self, "knots", tuple(self.knots))

    @classmethod
    def of(cls, *knots: Knots) -> Volume:
        """Make a volume, surface or curve; directions that are not given are degenerate."""
        return cls(knots + (ConstantKnots.uniform(1, 1),) * (3 - len(knots)))

    @property
    def orders(self) -> tuple[int, int, int]:
        """Order of the basis in each direction."""
        xi, eta, zeta = self.knots
        return int(xi.order), int(eta.order), int(zeta.order)

    @property
    def n_control(self) -> tuple[int, int, int]:
        """Number of control points in each direction."""
        xi, eta, zeta = self.knots
        return int(xi.n_control), int(eta.n_control), int(zeta.n_control)


def evaluate(
    volume: Volume,  # orders and knots
    control_points: np.ndarray,  # (N0, N1, N2, d), control points, of any dimension d
    parameters: np.ndarray,  # (n, 3), parameters in [0, 1]; the polynomials of the end spans continue beyond
) -> np.ndarray:  # (n, d)
    """Points of the volume, Eq. (3).

    Examples
    --------
    >>> import numpy as np
    >>> bezier = Volume.of(ConstantKnots.uniform(n_control=3, order=3))
    >>> evaluate(bezier, np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]])[:, None, None], np.array([[0.5, 0.0, 0.0]]))
    array([[1., 1.]])
    """
    # `InputError` if an array has the wrong shape
    control_points, parameters = _as_arrays(volume, control_points, parameters)
    points = np.empty((len(parameters), control_points.shape[3]))
    for at in _chunks(parameters):
        firsts, values = volume_basis(volume, parameters[at])
        _sum_values(control_points, volume.orders, firsts, values, points[at])
    return points


def evaluate_gradients(volume: Volume, control_points: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """First derivatives of the points in xi, eta and zeta (grid metrics), including the effect of curved knots.

    Parameters
    ----------
    volume : Volume
        Knots of a block, such as ``model.mesh.volumes[b]`` of a fitted grid.
    control_points : ndarray, shape (ni, nj, nk, d)
        Its control points, such as ``model.mesh.nets(model.control_points)[b]``.
    parameters : ndarray, shape (n, 3)
        Parameters of the points, from 0 to 1.

    Returns
    -------
    ndarray, shape (n, d, 3)
        Derivatives of every coordinate in xi, eta and zeta.

    Raises
    ------
    InputError
        If an array has the wrong shape.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.splines import evaluate_gradients
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> net = model.mesh.nets(model.control_points)[0]
    >>> evaluate_gradients(model.mesh.volumes[0], net, np.array([[0.5, 0.5, 0.5]])).shape
    (1, 3, 3)
    """
    control_points, parameters = _as_arrays(volume, control_points, parameters)
    gradients = np.empty((len(parameters), control_points.shape[3], 3))
    for at in _chunks(parameters):
        _sum_gradients(control_points, volume.orders, *volume_basis_gradients(volume, parameters[at]), gradients[at])
    return gradients


def evaluate_hessians(
    volume: Volume,
    control_points: np.ndarray,
    parameters: np.ndarray,
) -> np.ndarray:  # (n, d, 6), derivatives in (0, 0), (0, 1), (0, 2), (1, 1), (1, 2) and (2, 2)
    """Second derivatives of the points, including the effect of curved knots."""
    # `InputError` if an array has the wrong shape, or knots come without second derivatives
    # volume, control_points, parameters: as for `evaluate`
    control_points, parameters = _as_arrays(volume, control_points, parameters)
    hessians = np.empty((len(parameters), control_points.shape[3], 6))
    for at in _chunks(parameters):
        cyclic = [[parameters[at, (d + offset) % 3] for offset in range(3)] for d in range(3)]
        spans, jets = zip(*[basis_jets(knots, xi, s, t) for knots, (xi, s, t) in zip(volume.knots, cyclic)])
        firsts = np.stack([s - p + 1 for s, p in zip(spans, volume.orders)], axis=1)
        _sum_hessians(control_points, volume.orders, firsts, np.concatenate(jets, axis=1), hessians[at])
    return hessians


def volume_basis(
    volume: Volume,  # orders and knots
    parameters: np.ndarray,  # (n, 3), parameters of the points
) -> tuple[np.ndarray, np.ndarray]:
    """Basis functions of all three directions at points."""
    # returns firsts int (n, 3): first control point that each point depends on, in each direction
    # returns values (n, p0 + p1 + p2): the non-zero functions of xi, then eta, then zeta
    cyclic = [[parameters[:, (d + offset) % 3] for offset in range(3)] for d in range(3)]
    spans, values = zip(*[basis(knots, *is_cyclic) for knots, is_cyclic in zip(volume.knots, cyclic)])
    return np.stack([s - p + 1 for s, p in zip(spans, volume.orders)], axis=1), np.concatenate(values, axis=1)


def volume_basis_gradients(volume: Volume, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `volume_basis`, with each value followed by its derivatives: shape (n, p0 + p1 + p2, 4)."""
    spans, gradients = zip(*[basis_gradients(knots, d, parameters) for d, knots in enumerate(volume.knots)])
    return np.stack([s - p + 1 for s, p in zip(spans, volume.orders)], axis=1), np.concatenate(gradients, axis=1)


def sort_by_key(
    keys: np.ndarray,  # int (n,), a number below ``n_keys`` for the sub-net of each point
    n_keys: int,  # number of keys
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sort points by the sub-net of control points that they depend on, stably."""
    # returns used int (m,): the keys that occur, ascending
    # returns starts int (m + 1,): first sorted point of each
    # returns order int (n,): number of each sorted point
    starts, order = _counting_sort(keys, n_keys)
    used = np.flatnonzero(np.diff(starts))
    return used, np.append(starts[used], keys.size), order


@njit(cache=True, nogil=True, error_model="numpy")
def _counting_sort(keys, n_keys):
    """First place of each key, shape (n_keys + 1,), and the stable order that sorts the keys."""
    starts, order = np.zeros(n_keys + 1, dtype=np.int64), np.empty(keys.size, dtype=np.int64)
    for key in keys:
        starts[key + 1] += 1
    for key in range(n_keys):
        starts[key + 1] += starts[key]
    places = starts[:-1].copy()
    for q in range(keys.size):
        order[places[keys[q]]] = q
        places[keys[q]] += 1
    return starts, order


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def sub_net_ids(
    orders,  # tuple of three int
    corner,  # int, number of the first of them in the volume
    steps,  # tuple of three int, from one to the next in each direction
    ids,  # int (p0 * p1 * p2,), receives the numbers
):
    """Write the numbers of the control points of a sub-net to ``ids``, in the order of `basis_products`."""
    m = 0
    for a in range(orders[0]):
        for b in range(orders[1]):
            for c in range(orders[2]):
                ids[m] = corner + a * steps[0] + b * steps[1] + c * steps[2]
                m += 1


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def basis_products(
    orders,  # tuple of three int
    values,  # (p0 + p1 + p2,), functions of one point, see `volume_basis`
    products,  # (p0 * p1 * p2,), receives the products, the last direction fastest
):
    """Write the factors of the control points of a sub-net in Eq. (3): products of functions of three directions."""
    p_0, p_1, p_2 = orders
    for a in range(p_0):
        for b in range(p_1):
            product = values[a] * values[p_0 + b]
            first = (a * p_1 + b) * p_2
            for c in range(p_2):
                products[first + c] = product * values[p_0 + p_1 + c]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def partial_sums(
    B,  # (N0, N1, N2, d), control points
    first,  # sequence of three int, first control point of the sub-net in each direction
    orders,  # tuple of three int
    values,  # (p0 + p1 + p2,), functions of one point, see `volume_basis`
    sums,  # (p0 + p1 + p2, d), receives the sums
):
    """Write the derivatives of the triple sum of Eq. (3) in the basis functions to ``sums``."""
    # They are the control points summed with the functions of two directions. All derivatives of a point follow: summed
    # with derivatives of the functions in a variable as factors, they give the derivative of the point in the variable.
    p_0, p_1, p_2 = orders
    sums[:] = 0.0
    for a in range(p_0):
        for b in range(p_1):
            v_0, v_1 = values[a], values[p_0 + b]
            v_01 = v_0 * v_1
            line = B[first[0] + a, first[1] + b]
            for x in range(B.shape[3]):
                sum_2 = 0.0
                for c in range(p_2):
                    point = line[first[2] + c, x]
                    sum_2 += values[p_0 + p_1 + c] * point
                    sums[p_0 + p_1 + c, x] += v_01 * point
                sums[a, x] += v_1 * sum_2
                sums[p_0 + b, x] += v_0 * sum_2


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_values(B, orders, firsts, values, out):
    """Write the triple sum of Eq. (3) to ``out``, shape (n, d)."""
    products = np.empty(orders[0] * orders[1] * orders[2])
    for q in range(out.shape[0]):
        basis_products(orders, values[q], products)
        i, j, k = firsts[q]
        m = 0
        out[q] = 0.0
        for a in range(orders[0]):
            for b in range(orders[1]):
                for c in range(orders[2]):
                    for x in range(out.shape[1]):
                        out[q, x] += B[i + a, j + b, k + c, x] * products[m]
                    m += 1


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_gradients(B, orders, firsts, gradients, out):
    """Write the first derivatives of Eq. (3) to ``out``, shape (n, d, 3)."""
    sums, point = np.empty((gradients.shape[1], B.shape[3])), np.empty(B.shape[3])
    for q in range(out.shape[0]):
        point_and_gradient(B, firsts[q], orders, gradients[q], sums, point, out[q])


@njit(cache=True, nogil=True, error_model="numpy")
def point_and_gradient(
    B,
    first,
    orders,
    gradients,  # (p0 + p1 + p2, 4), functions of the point and their derivatives, see `volume_basis_gradients`
    sums,  # (p0 + p1 + p2, d), scratch
    # receive the point and its derivatives
    point,  # (d,)
    gradient,  # (d, 3)
):
    """Write one point of Eq. (3) and its derivatives in xi, eta and zeta, for use inside numba kernels."""
    # B, first, orders: as for `partial_sums`
    partial_sums(B, first, orders, gradients[:, 0], sums)
    for x in range(sums.shape[1]):
        value, d_0, d_1, d_2 = 0.0, 0.0, 0.0, 0.0
        for m in range(orders[0]):
            value += gradients[m, 0] * sums[m, x]
        for m in range(sums.shape[0]):
            d_0 += gradients[m, 1] * sums[m, x]
            d_1 += gradients[m, 2] * sums[m, x]
            d_2 += gradients[m, 3] * sums[m, x]
        point[x], gradient[x, 0], gradient[x, 1], gradient[x, 2] = value, d_0, d_1, d_2


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_hessians(B, orders, firsts, jets, out):
    """Write the second derivatives of Eq. (3) to ``out``, shape (n, d, 6)."""
    # Each is a sum of a part with two directions differentiated once and a part with one differentiated twice. Jets of
    # direction ``d`` are in the parameters ``d, d + 1, d + 2`` modulo 3.
    n_functions, n_0, n_01 = jets.shape[1], orders[0], orders[0] + orders[1]
    sums, values = np.empty((n_functions, B.shape[3])), np.empty(n_functions)
    number = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # of the derivative in two parameters
    out[:] = 0.0
    for q in range(out.shape[0]):
        partial_sums(B, firsts[q], orders, jets[q, :, 0], sums)
        for m in range(n_functions):  # direction d twice
            d = 0 if m < n_0 else 1 if m < n_01 else 2
            for k in range(3):
                for l in range(k, 3):
                    for x in range(out.shape[1]):
                        out[q, x, number[k, l]] += jets[q, m, 4 + number[(k - d) % 3, (l - d) % 3]] * sums[m, x]
        for e, start, end in ((0, 0, n_0), (1, n_0, n_01), (2, n_01, n_functions)):
            for k in range(3):  # direction e in parameter k, another direction in l
                copy_row(jets[q, :, 0], values)
                copy_row(jets[q, start:end, 1 + (k - e) % 3], values[start:end])
                partial_sums(B, firsts[q], orders, values, sums)
                for m in range(n_functions):
                    if start <= m < end:
                        continue
                    d = 0 if m < n_0 else 1 if m < n_01 else 2
                    for l in range(k, 3):
                        for x in range(out.shape[1]):
                            out[q, x, number[k, l]] += jets[q, m, 1 + (l - d) % 3] * sums[m, x]


def _as_arrays(volume: Volume, control_points: np.ndarray, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Control points and parameters as arrays of the right shapes."""
    control_points = np.ascontiguousarray(control_points, dtype=float)
    parameters = np.ascontiguousarray(parameters, dtype=float)
    if control_points.ndim != 4 or control_points.shape[:3] != volume.n_control:
        raise InputError(f"volume: control points of shape {control_points.shape}; give {(*volume.n_control, 'd')}")
    if parameters.ndim != 2 or parameters.shape[1] != 3:
        raise InputError(f"volume: parameters of shape {parameters.shape}; give shape (n, 3)")
    return control_points, parameters


def _chunks(parameters: np.ndarray) -> list[slice]:
    return [slice(start, start + _CHUNK) for start in range(0, len(parameters), _CHUNK)]
