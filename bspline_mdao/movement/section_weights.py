"""Weights of transfinite interpolation, section by section: from corners to edges, faces and insides of blocks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import sparse

from ..numerics.transfinite import boolean_sum
from ..topology.index_space import inner_slices, sections_of, whole_slices

__all__ = ["arc_lengths", "transfinite_weights"]


def arc_lengths(points: np.ndarray) -> np.ndarray:
    """Place of every point on the three grid lines through it, from 0 to 1 by arc length.

    Parameters
    ----------
    points : ndarray, shape (N0, N1, N2, 3)
        Points of a block (m).

    Returns
    -------
    ndarray, shape (N0, N1, N2, 3)
        By direction; uniform along lines without length.
    """
    places = np.empty_like(points)
    for d in range(3):
        lengths = np.linalg.norm(np.diff(points, axis=d), axis=-1)
        lengths = np.where(lengths.sum(axis=d, keepdims=True) > 0.0, lengths, 1.0)
        sums = np.insert(np.cumsum(lengths, axis=d), 0, 0.0, axis=d)
        places[..., d] = sums / sums.take([-1], axis=d)
    return places


def transfinite_weights(
    blocks: Sequence[np.ndarray], places: Sequence[np.ndarray], known_ids: np.ndarray, n_points: int
) -> sparse.csr_array:
    """Weights by which all points follow the known ones.

    Inside a section whose boundary is known, the interpolant is that of `bspline_mdao.numerics.transfinite`. Points
    that are known, or belong to an earlier section, keep what they have: shared sections are interpolated once, and all
    blocks agree.

    Parameters
    ----------
    blocks : sequence of ndarray of int, each of shape (N0, N1, N2)
        Points of every block.
    places : sequence of ndarray, each of shape (N0, N1, N2, 3)
        Where each point stands between the two ends of every direction, from 0 to 1.
    known_ids : ndarray of int, shape (n_known,)
        Known points; all corners of all blocks are among them.
    n_points : int
        Number of points.

    Returns
    -------
    scipy.sparse.csr_array, shape (n_points, n_known)
    """
    shape = (n_points, len(known_ids))
    weights = sparse.csr_array((np.ones(len(known_ids)), (known_ids, np.arange(len(known_ids)))), shape=shape)
    is_done = np.zeros(n_points, dtype=bool)
    is_done[known_ids] = True
    for n_free in (1, 2, 3):
        parts = [(rows, section @ weights) for rows, section in _sections(blocks, places, is_done, n_free)]
        weights = weights + _in_rows(parts, shape)
    return weights


def _in_rows(parts, shape) -> sparse.csr_array:
    """Matrix of the given rows, zero in the others."""
    rows = np.concatenate([np.zeros(0, dtype=int), *(rows for rows, _ in parts)])
    stacked = sparse.vstack([sparse.csr_array((0, shape[1])), *(part for _, part in parts)], format="csr")
    spread = sparse.csr_array((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(shape[0], len(rows)))
    return spread @ stacked


def _sections(blocks, places, is_done: np.ndarray, n_free: int) -> Iterator[tuple[np.ndarray, sparse.csr_array]]:
    """Points of every section that are not done yet, and their weights of all points; marks them as done."""
    for ids, place in zip(blocks, places):
        for section in sections_of(ids.shape, n_free):
            inner = ids[inner_slices(section)].ravel()
            rows, first = np.unique(inner, return_index=True)  # a folded section holds points twice
            first, rows = first[~is_done[rows]], rows[~is_done[rows]]
            is_done[rows] = True
            if len(rows):
                whole = whole_slices(section)
                columns, values = boolean_sum(place[whole], first)
                numbers = np.tile(np.arange(len(rows)), len(columns))
                entries = values.ravel(), (numbers, ids[whole].ravel()[columns.ravel()])
                yield rows, sparse.csr_array(entries, shape=(len(rows), len(is_done)))
