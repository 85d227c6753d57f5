"""Curvature of surfaces at the nodes of structured faces, from differences along the grid lines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import block_array, csr_array, eye_array, kron

from ..mesh.surface import SurfaceGrid

__all__ = ["Forms", "difference_matrices", "face_differences", "forms", "forms_vjp"]


class Forms(NamedTuple):
    """Numerators of the curvatures and the area, by the numbers of the nodes; every array has the shape (n,).

    Parameters
    ----------
    mean : ndarray
        ``E n - 2 F m + G l``, twice the mean curvature times the area to the third.
    gaussian : ndarray
        ``l n - m^2``, the Gaussian curvature times the area to the fourth.
    square : ndarray
        Square of the area, ``E G - F^2``.
    """

    mean: np.ndarray
    gaussian: np.ndarray
    square: np.ndarray


def forms(vectors: np.ndarray) -> Forms:
    """Curvatures from derivatives of the surface.

    Parameters
    ----------
    vectors : ndarray, shape (5, n, 3)
        First derivatives along i and j, second derivatives ii, ij and jj.
    """
    along_i, along_j, *second = vectors
    normal = np.cross(along_i, along_j)
    (e, f, g), (l, m, n) = _metric(along_i, along_j), (_dot(part, normal) for part in second)
    return Forms(e * n - 2.0 * f * m + g * l, l * n - m * m, _dot(normal, normal))


def forms_vjp(vectors: np.ndarray, bar: Forms) -> list[np.ndarray]:
    """Derivatives in the five vectors, each of shape (n, 3), of derivatives in what `forms` gives."""
    along_i, along_j, *second = vectors
    normal = np.cross(along_i, along_j)
    (e, f, g), (l, m, n) = _metric(along_i, along_j), (_dot(part, normal) for part in second)
    e_bar, f_bar, g_bar = bar.mean * n, -2.0 * bar.mean * m, bar.mean * l
    l_bar, m_bar = bar.mean * g + bar.gaussian * n, -2.0 * (bar.mean * f + bar.gaussian * m)
    bars = [part[:, None] for part in (l_bar, m_bar, bar.mean * e + bar.gaussian * l)]
    normal_bar = 2.0 * bar.square[:, None] * normal + sum(part * vector for part, vector in zip(bars, second))
    along_i_bar = _times(2.0 * e_bar, along_i) + _times(f_bar, along_j) + np.cross(along_j, normal_bar)
    along_j_bar = _times(2.0 * g_bar, along_j) + _times(f_bar, along_i) + np.cross(normal_bar, along_i)
    return [along_i_bar, along_j_bar, *(part * normal for part in bars)]


def face_differences(surface: SurfaceGrid, faces: tuple[int, ...]) -> tuple[list[csr_array], np.ndarray]:
    """Find what makes the five vectors of `forms` at all nodes of some faces.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    faces : tuple of int
        Numbers of its faces, of three nodes at least each way.

    Returns
    -------
    matrices : list of csr_array, each of shape (n, n_points)
        First differences along i and j, second differences ii, ij and jj, by the numbers of the nodes.
    weights : ndarray, shape (n,)
        Weights of the trapezoidal rule.
    """
    chosen = [surface.faces[number] for number in faces]
    matrices = [_on_face(ids, surface.n_points) for ids in chosen]
    weights = [np.outer(*(_trapezoidal(n) for n in ids.shape)).ravel() for ids in chosen]
    return [csr_array(block_array([[part] for part in kind])) for kind in zip(*matrices)], np.concatenate(weights)


def difference_matrices(n: int) -> tuple[csr_array, csr_array]:
    """First and second differences of n numbers in a row, shape (n, n), of second order; n is 3 at least.

    With three numbers the second differences at the ends are of first order.
    """
    first, second = np.zeros((2, n, n))
    inner = np.arange(1, n - 1)
    first[inner, inner - 1], first[inner, inner + 1] = -0.5, 0.5
    second[inner, inner - 1], second[inner, inner], second[inner, inner + 1] = 1.0, -2.0, 1.0
    end = [2.0, -5.0, 4.0, -1.0] if n > 3 else [1.0, -2.0, 1.0]
    first[0, :3], first[-1, :-4:-1] = [-1.5, 2.0, -0.5], [1.5, -2.0, 0.5]
    second[0, : len(end)], second[-1, : -len(end) - 1 : -1] = end, end
    return csr_array(first), csr_array(second)


def _on_face(ids, n_points):
    (first_i, second_i), (first_j, second_j) = (difference_matrices(n) for n in ids.shape)
    here_i, here_j = (eye_array(n) for n in ids.shape)
    pick = csr_array((np.ones(ids.size), (np.arange(ids.size), ids.ravel())), shape=(ids.size, n_points))
    pairs = ((first_i, here_j), (here_i, first_j), (second_i, here_j), (first_i, first_j), (here_i, second_j))
    return [csr_array(kron(*pair)) @ pick for pair in pairs]


def _trapezoidal(n):
    return np.concatenate([[0.5], np.ones(n - 2), [0.5]])


def _metric(u, v):
    return _dot(u, u), _dot(u, v), _dot(v, v)


def _dot(u, v):
    return (u * v).sum(axis=1)


def _times(factors, vectors):
    return factors[:, None] * vectors
