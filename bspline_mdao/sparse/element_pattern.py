"""From elements to a block pattern: which points meet, and where each pair of an element's corners is stored."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse

if TYPE_CHECKING:
    from .blocks import BlockPattern

__all__ = ["slots"]


def slots(pattern: BlockPattern, element_points: np.ndarray) -> np.ndarray:
    """Where the blocks of element matrices go.

    Parameters
    ----------
    pattern : BlockPattern
        Pattern that holds all pairs of an element's points, as `BlockPattern.of_elements` makes it.
    element_points : ndarray of int32, shape (n_elements, m)
        Block row of every corner; -1 where a point has no freedom.

    Returns
    -------
    ndarray of int32, shape (n_elements, m (m + 1) / 2)
        Place in ``data`` of the pair of corners (a, b), b <= a, in column ``a (a + 1) / 2 + b``; -1 where one of them
        has no freedom. With p = ``element_points[e]`` and the element's block ``K_ab``, what is to be added there is

        - ``K_ab`` where ``p[a] > p[b]`` or a = b,
        - ``K_ab^T`` where ``p[a] < p[b]``, because only the lower triangle is stored,
        - ``K_ab + K_ab^T`` where ``p[a] == p[b]`` but a > b, in an element with a collapsed edge.
    """
    points = np.asarray(element_points, np.int64)
    a, b = np.tril_indices(points.shape[1])
    rows, columns = np.maximum(points[:, a], points[:, b]), np.minimum(points[:, a], points[:, b])
    row_of = np.repeat(np.arange(pattern.n), np.diff(pattern.indptr))
    places = np.searchsorted(row_of * pattern.n + pattern.indices, rows * pattern.n + columns)
    return np.where(columns < 0, -1, places).astype(np.int32)


def lower_pattern(element_points: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Lower triangle of the pattern that couples all points of an element, see `BlockPattern.of_elements`.

    Parameters
    ----------
    element_points : ndarray of int, shape (n_elements, m)
        Block row of every corner; -1 where a point has no freedom.
    n : int
        Block rows.

    Returns
    -------
    indptr : ndarray of int64, shape (n + 1,)
    indices : ndarray of int32
        Columns of every row, ascending, the diagonal always among them.
    """
    elements, corners = np.nonzero(element_points >= 0)
    shape = (len(element_points), n)
    holds = scipy.sparse.csr_array(
        (np.ones(len(elements), np.int32), (elements, element_points[elements, corners])), shape=shape
    )
    coupled = scipy.sparse.tril(holds.T @ holds + scipy.sparse.eye_array(n, dtype=np.int32), format="csr")
    coupled.sort_indices()
    return coupled.indptr.astype(np.int64), coupled.indices.astype(np.int32)
