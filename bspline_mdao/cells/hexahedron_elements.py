"""Measures of a list of hexahedral elements and their derivatives: what the stiffness of an element depends on.

Numbering of corners, handedness and left-out corners are those of `.hexahedron`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .hexahedron_runs import as_points, list_jvp, list_measures, list_vjp

__all__ = [
    "ElementMeasures",
    "element_measures",
    "element_measures_jvp",
    "element_measures_vjp",
    "orthogonality",
    "orthogonality_jvp",
    "orthogonality_vjp",
]


@dataclass(frozen=True)
class ElementMeasures:
    """Measures of elements, relative to their handedness; or changes or adjoints of them.

    Parameters
    ----------
    triples : ndarray, shape (n_e, 8)
        Corner triple products of unit edges; 1 at corners that are left out.
    jacobians : ndarray, shape (n_e, 8)
        Corner Jacobians, triple products of the edges themselves (m^3); infinite at corners that are left out.
    volume : ndarray, shape (n_e,)
        Volumes of the trilinear elements (m^3).
    """

    triples: np.ndarray
    jacobians: np.ndarray
    volume: np.ndarray


def element_measures(corners: np.ndarray, handedness: np.ndarray, left_out: np.ndarray) -> ElementMeasures:
    """Measure elements.

    Parameters
    ----------
    corners : ndarray, shape (n_e, 8, 3)
        Corners (m), numbered a + 2 b + 4 d.
    handedness : ndarray, shape (n_e,)
        +1 or -1 for each element, or one number for all.
    left_out : ndarray of uint8, shape (n_e,)
        Bit c is set where corner c is left out.

    Returns
    -------
    ElementMeasures

    Raises
    ------
    InputError
        If the arrays do not fit each other.
    """
    sign = _signs(corners, handedness, left_out)
    measures = _empty(len(corners))
    list_measures(_corner_rows(corners), left_out, *measures)
    return _handed(measures, sign, _masks(left_out), 1.0, np.inf)


def element_measures_jvp(
    corners: np.ndarray, d_corners: np.ndarray, handedness: np.ndarray, left_out: np.ndarray
) -> ElementMeasures:
    """Change of the measures with the corners.

    Parameters
    ----------
    corners, d_corners : ndarray, shape (n_e, 8, 3)
        Corners and their change (m).
    handedness, left_out
        See `element_measures`.

    Returns
    -------
    ElementMeasures
        Changes; 0 at corners that are left out.
    """
    sign = _signs(corners, handedness, left_out)
    changes = _empty(len(corners))
    list_jvp(_corner_rows(corners), _corner_rows(d_corners), left_out, *changes)
    return _handed(changes, sign, _masks(left_out), 0.0, 0.0)


def element_measures_vjp(
    corners: np.ndarray,
    handedness: np.ndarray,
    left_out: np.ndarray,
    triples_bar: np.ndarray,
    volume_bar: np.ndarray,
    jacobians_bar: np.ndarray | None = None,
) -> np.ndarray:
    """Adjoint of the corners from those of the measures.

    Parameters
    ----------
    corners, handedness, left_out
        See `element_measures`.
    triples_bar, jacobians_bar : ndarray, shape (n_e, 8)
        Adjoints of the corner measures; those of corners that are left out are not looked at.
    volume_bar : ndarray, shape (n_e,)
        Adjoints of the volumes.

    Returns
    -------
    ndarray, shape (n_e, 8, 3)
    """
    sign = _signs(corners, handedness, left_out)
    if jacobians_bar is None:
        jacobians_bar = np.zeros((len(corners), 8))
    bars = [np.ascontiguousarray(sign * np.transpose(bar)) for bar in (triples_bar, jacobians_bar, volume_bar)]
    rows_bar = np.zeros((8, len(corners), 3))
    list_vjp(_corner_rows(corners), left_out, *bars, as_points(rows_bar))
    return np.ascontiguousarray(rows_bar.transpose(1, 0, 2))


def orthogonality(triples: np.ndarray, axis: int = -1) -> np.ndarray:
    """Q of Eq. (9), the product of the corner triple products.

    Parameters
    ----------
    triples : ndarray
        Corner triple products, the corners along ``axis``.
    axis : int
        Axis of the corners.

    Returns
    -------
    ndarray
    """
    return np.prod(triples, axis=axis)


def orthogonality_jvp(triples: np.ndarray, d_triples: np.ndarray, axis: int = -1) -> np.ndarray:
    """Change of Q with the corner triple products, arrays as for `orthogonality`."""
    return np.sum(_products_of_others(triples, axis) * d_triples, axis=axis)


def orthogonality_vjp(triples: np.ndarray, q_bar: np.ndarray, axis: int = -1) -> np.ndarray:
    """Adjoint of the corner triple products from that of Q, arrays as for `orthogonality`."""
    return _products_of_others(triples, axis) * np.expand_dims(q_bar, axis)


def _products_of_others(triples, axis):
    """Products of all corners but one, which may be zero themselves."""
    corners = np.moveaxis(triples, axis, 0)
    others = np.ones_like(corners)
    np.cumprod(corners[:-1], axis=0, out=others[1:])
    following = np.ones_like(corners[0])
    for corner in range(len(corners) - 2, -1, -1):
        following *= corners[corner + 1]
        others[corner] *= following
    return np.moveaxis(others, 0, axis)


def _signs(corners, handedness, left_out):
    """Check the arrays and return the handedness as numbers."""
    sign = np.asarray(handedness, dtype=np.float64)
    n = len(corners)
    if corners.shape != (n, 8, 3) or sign.shape not in ((), (n,)) or left_out.shape != (n,):
        raise InputError(
            f"elements: corners of shape {corners.shape}, handedness of {sign.shape} and left-out corners of "
            f"{left_out.shape} do not fit; give (n, 8, 3), (n,) and (n,)"
        )
    return sign


def _corner_rows(corners):
    return as_points(corners.transpose(1, 0, 2))


def _empty(n):
    return np.empty((8, n)), np.empty((8, n)), np.empty(n)


def _masks(left_out):
    """Which corners are left out, (8, n_e); None if none is."""
    return np.unpackbits(left_out[None], axis=0, bitorder="little").astype(bool) if left_out.any() else None


def _handed(measures, sign, masks, triple, jacobian):
    """Turn right-handed measures by the handedness; corners that are left out keep their values."""
    triples, jacobians, volume = (sign * values for values in measures)
    if masks is not None:
        triples[masks], jacobians[masks] = triple, jacobian
    return ElementMeasures(triples.T, jacobians.T, volume)
