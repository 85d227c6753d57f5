"""The mapping of a B-spline volume from parameters to points, Eq. (3), with its first and second derivatives.

Curves and surfaces are volumes with one or two degenerate directions: one control point, order 1 and knots (0, 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ..errors import InputError
from .basis import basis, basis_jets
from .jets import JET_SIZES, jet_product
from .knots import ConstantKnots, Knots

_CHUNK = 2048  # points at a time, so that knots and basis jets stay in the cache

# Jets of direction d are in (d, d + 1, d + 2) modulo 3: entry of theirs for each entry of a jet in (0, 1, 2).
_JET_ORDERS = np.array(
    [
        [0, 1, 2, 3, 4, 5, 6, 7, 8, 9],
        [0, 3, 1, 2, 9, 6, 8, 4, 5, 7],
        [0, 2, 3, 1, 7, 8, 5, 9, 6, 4],
    ]
)


@dataclass(frozen=True, eq=False)
class Volume:
    """A B-spline volume without its control points.

    Parameters
    ----------
    knots : tuple of three Knots
        Knots of the directions xi, eta and zeta; they carry order and number of control points.
    """

    knots: tuple[Knots, Knots, Knots]

    def __post_init__(self):
        if len(self.knots) != 3:
            raise InputError(f"volume: knots of {len(self.knots)} directions; give three, or use Volume.of(...)")
        object.__setattr__(self, "knots", tuple(self.knots))

    @classmethod
    def of(cls, *knots: Knots) -> Volume:
        """Make a volume, surface or curve; the directions left out are degenerate."""
        return cls(knots + (ConstantKnots.uniform(1, 1),) * (3 - len(knots)))

    @property
    def orders(self) -> tuple[int, int, int]:
        """Order of the basis in each direction."""
        return tuple(int(k.order) for k in self.knots)

    @property
    def n_control(self) -> tuple[int, int, int]:
        """Number of control points in each direction."""
        return tuple(int(k.n_control) for k in self.knots)


def evaluate(volume: Volume, control_points: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """Points of the volume, Eq. (3).

    Parameters
    ----------
    volume : Volume
        Orders and knots.
    control_points : ndarray, shape (N0, N1, N2, d)
        Control points, of any dimension d.
    parameters : ndarray, shape (n, 3)
        Parameters in [0, 1]; beyond, the polynomials of the nearest span continue.

    Returns
    -------
    ndarray, shape (n, d)

    Raises
    ------
    InputError
        If an array has the wrong shape.

    Examples
    --------
    >>> import numpy as np
    >>> bezier = Volume.of(ConstantKnots.uniform(n_control=3, order=3))
    >>> evaluate(bezier, np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]])[:, None, None], np.array([[0.5, 0.0, 0.0]]))
    array([[1., 1.]])
    """
    return _evaluate(volume, control_points, parameters, 0)[..., 0]


def evaluate_gradients(volume: Volume, control_points: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """First derivatives of the points in xi, eta and zeta, through curved knots as well.

    Parameters
    ----------
    volume, control_points, parameters
        As for `evaluate`.

    Returns
    -------
    ndarray, shape (n, d, 3)

    Raises
    ------
    InputError
        If an array has the wrong shape.
    """
    return _evaluate(volume, control_points, parameters, 1)[..., 1:4]


def evaluate_hessians(volume: Volume, control_points: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """Second derivatives of the points, through curved knots as well.

    Parameters
    ----------
    volume, control_points, parameters
        As for `evaluate`.

    Returns
    -------
    ndarray, shape (n, d, 6)
        Derivatives in (0, 0), (0, 1), (0, 2), (1, 1), (1, 2) and (2, 2).

    Raises
    ------
    InputError
        If an array has the wrong shape, or knots come without second derivatives.
    """
    return _evaluate(volume, control_points, parameters, 2)[..., 4:]


def _evaluate(volume: Volume, control_points, parameters, degree: int) -> np.ndarray:
    """Jets of the points in the parameters, shape (n, d, size)."""
    control_points = np.ascontiguousarray(control_points, dtype=float)
    parameters = np.ascontiguousarray(parameters, dtype=float)
    if control_points.ndim != 4 or control_points.shape[:3] != volume.n_control:
        raise InputError(f"volume: control points of shape {control_points.shape}; give {(*volume.n_control, 'd')}")
    if parameters.ndim != 2 or parameters.shape[1] != 3:
        raise InputError(f"volume: parameters of shape {parameters.shape}; give shape (n, 3)")
    points = np.zeros((len(parameters), control_points.shape[3], JET_SIZES[degree]))
    contract = _contract_jets if degree else _contract
    for start in range(0, len(parameters), _CHUNK):
        chunk = slice(start, start + _CHUNK)
        spans, bases = zip(*[_direction_basis(volume.knots[d], d, parameters[chunk], degree) for d in range(3)])
        contract(control_points, *spans, *bases, points[chunk])
    return points


def _direction_basis(knots: Knots, d: int, parameters: np.ndarray, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Spans of direction ``d``, and its basis functions as values (degree 0) or as jets in (xi, eta, zeta)."""
    xi, s, t = (parameters[:, (d + offset) % 3] for offset in range(3))
    if degree == 0:
        return basis(knots, xi, s, t)
    spans, jets = basis_jets(knots, xi, s, t, degree)
    return spans, np.ascontiguousarray(jets[..., _JET_ORDERS[d, : JET_SIZES[degree]]])


@njit(cache=True, error_model="numpy")
def _contract(B, spans_0, spans_1, spans_2, values_0, values_1, values_2, out):
    """Add the triple sum of Eq. (3) to ``out``, shape (n, d, 1)."""
    p_0, p_1, p_2 = values_0.shape[1], values_1.shape[1], values_2.shape[1]
    for q in range(out.shape[0]):
        i, j, k = spans_0[q] - p_0 + 1, spans_1[q] - p_1 + 1, spans_2[q] - p_2 + 1
        for a in range(p_0):
            for b in range(p_1):
                product_01 = values_0[q, a] * values_1[q, b]
                for c in range(p_2):
                    product = product_01 * values_2[q, c]
                    for x in range(out.shape[1]):
                        out[q, x, 0] += B[i + a, j + b, k + c, x] * product


@njit(cache=True, error_model="numpy")
def _contract_jets(B, spans_0, spans_1, spans_2, jets_0, jets_1, jets_2, out):
    """Add the same sum in jet arithmetic to ``out``, shape (n, d, size)."""
    product_01, product = np.empty(out.shape[2]), np.empty(out.shape[2])
    p_0, p_1, p_2 = jets_0.shape[1], jets_1.shape[1], jets_2.shape[1]
    for q in range(out.shape[0]):
        i, j, k = spans_0[q] - p_0 + 1, spans_1[q] - p_1 + 1, spans_2[q] - p_2 + 1
        for a in range(p_0):
            for b in range(p_1):
                jet_product(jets_0[q, a], jets_1[q, b], product_01)
                for c in range(p_2):
                    jet_product(product_01, jets_2[q, c], product)
                    for x in range(out.shape[1]):
                        for m in range(product.size):
                            out[q, x, m] += B[i + a, j + b, k + c, x] * product[m]
