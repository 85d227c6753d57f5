"""The first layer of an extrusion: displacements with the requested height above every block.

Theory: ``docs/theory/extrusion.rst``.
"""

from __future__ import annotations

import numpy as np

from ....base.numerics.vectors import lengths, unit_vectors

SHARPEST = 0.1
"""Tangent of half the angle of a wedge, 11 degrees, below which heights above its sides are not exact."""


def with_exact_heights(
    moves: np.ndarray,  # (n, 3), of nodes, relative to the height
    nodes: np.ndarray,  # int (n_places,), the node of each place of a block's side
    areas: np.ndarray,  # (n_places, 3), area vectors there
    projectors: np.ndarray,  # (n, 3, 3), onto allowed moves of nodes
    largest: np.ndarray,  # (n,), largest lengths of moves
) -> np.ndarray:  # (n, 3)
    """Change moves as little as possible to give nodes with several places the height 1 above each of them."""
    # heights are measured along the sum of the area vectors of a block's quads around a node, see `FirstCells`
    found = moves.copy()
    order = np.argsort(nodes, kind="stable")
    normals = unit_vectors(areas[order], np.zeros(3), 1e-300)
    counts = np.bincount(nodes, minlength=len(moves))
    first = np.cumsum(counts) - counts
    for count in np.unique(counts[counts > 1]):
        at = np.flatnonzero(counts == count)
        rows = normals[first[at, None] + np.arange(count)]
        lacks = 1.0 - np.einsum("nij,nj->ni", rows, moves[at])
        change = np.einsum("nij,nj->ni", np.linalg.pinv(rows @ projectors[at], rcond=SHARPEST), lacks)
        fits = lengths(moves[at] + change) < largest[at]
        found[at[fits]] += change[fits]
    return found
