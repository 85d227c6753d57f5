"""Transfinite (Coons) interpolation of the interior of an index space from its boundary, as weights.

With ``P_d`` the linear interpolation between the two ends of direction d, the interior is the Boolean sum
``I - (I - P_0) (I - P_1) (I - P_2)``, that is ``P_0 + P_1 - P_0 P_1`` on a face, and so on.

References
----------
W. J. Gordon and C. A. Hall, "Construction of curvilinear co-ordinate systems and applications to mesh generation",
International Journal for Numerical Methods in Engineering 7, 1973.

Theory: ``docs/theory/movers.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product

import numpy as np

__all__ = ["boolean_sum", "inner_of"]


def inner_of(shape: Sequence[int]) -> tuple[slice, ...]:
    """Slices of the inner points of an index space; all of a direction with one point, which has no ends."""
    return tuple(slice(1, -1) if n > 1 else slice(None) for n in shape)


def boolean_sum(
    places: np.ndarray,  # (N0, N1, N2, 3), position of each point between the two ends of every direction, from 0 to 1
    chosen: np.ndarray | None = None,  # int (n,), inner points, numbered in C order; all by default
) -> tuple[np.ndarray, np.ndarray]:
    """Weights with which inner points follow points of the boundary.

    Examples
    --------
    >>> line = np.zeros((3, 1, 1, 3))
    >>> line[:, 0, 0, 0] = [0.0, 0.25, 1.0]
    >>> columns, values = boolean_sum(line)
    >>> columns.tolist(), values.tolist()
    ([[0], [2]], [[0.75], [0.25]])
    """
    # returns columns int (n_terms, n): numbers, in C order, of the boundary points followed by each inner point: for
    # every set of one, two, then three directions, one for every choice of their ends. Directions with one point are
    # ignored; if there are no others, there are no terms
    # returns values (n_terms, n): weights of these points
    shape = places.shape[:3]
    inner, free = inner_of(shape), [d for d in range(3) if shape[d] > 1]
    some: slice | np.ndarray = slice(None) if chosen is None else chosen
    indices = np.indices(shape)
    index = np.stack([indices[d][inner].ravel()[some] for d in range(3)])
    place = places[inner].reshape(-1, 3)[some].T
    columns, values = [], []
    for n in range(1, len(free) + 1):
        for directions in combinations(free, n):
            for ends in product((0, 1), repeat=n):
                source, value = index.copy(), np.full(index.shape[1], (-1.0) ** (n + 1))
                for d, end in zip(directions, ends):
                    source[d] = end * (shape[d] - 1)
                    value *= place[d] if end else 1.0 - place[d]
                columns.append(np.ravel_multi_index(tuple(source), shape))
                values.append(value)
    terms = len(columns), index.shape[1]
    return np.array(columns, dtype=np.int64).reshape(terms), np.array(values).reshape(terms)
