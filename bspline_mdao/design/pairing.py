"""Which surface control points a linear constraint is about: rows, pairs and directions, checked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from ..checks import as_numbers
from ..errors import InputError
from ..mesh.mesh import MovingMesh
from .selection import Selection

__all__ = ["Directions", "Where", "axes_of", "pairs_of", "place_of", "rows_of"]

Where = Selection | np.ndarray | Sequence[int]
"""Surface control points: a selection, or rows of ``mesh.surface_ids``."""

Directions = str | np.ndarray | Sequence | None
"""Coordinates by letter (``"xz"``), one vector or several; None for all three coordinates."""


def place_of(mesh: MovingMesh, row: int) -> str:
    """Name a surface control point for a message."""
    return mesh.place_of_point(mesh.surface_ids[row])


def axes_of(directions: Directions, name: str) -> np.ndarray:
    """Rows of directions, shape (n, 3), scaled to length one where they are not along coordinates."""
    if directions is None or isinstance(directions, str):
        letters = "xyz" if directions is None else directions
        if not letters or set(letters) - set("xyz"):
            raise InputError(f"linear constraint '{name}': no direction is called '{directions}'; give some of 'xyz'")
        return np.eye(3)[["xyz".index(letter) for letter in letters]]
    vectors = np.atleast_2d(as_numbers(directions, f"linear constraint '{name}': direction"))
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if vectors.shape[1:] != (3,) or not np.isfinite(lengths).all() or not (lengths > 0.0).all():
        raise InputError(f"linear constraint '{name}': give directions of three coordinates that are not all zero")
    return vectors / lengths


def rows_of(where: Where, mesh: MovingMesh, what: str) -> np.ndarray:
    """Rows of surface control points, at least one; ``what`` is for messages."""
    if isinstance(where, Selection):
        return where.rows(mesh)
    rows, n = np.atleast_1d(where), len(mesh.surface_ids)
    if not rows.size or rows.ndim > 1 or not np.issubdtype(rows.dtype, np.integer):
        raise InputError(f"{what}: give a selection, or numbers of surface control points")
    if rows.min() < 0 or rows.max() >= n:
        wrong = rows[(rows < 0) | (rows >= n)][0]
        raise InputError(f"{what}: there is no surface control point {wrong}; give numbers from 0 to {n - 1}")
    return rows


def pairs_of(leaders: Where, followers: Where, mesh: MovingMesh, points: np.ndarray, name: str) -> np.ndarray:
    """Pairs (leader, follower) of rows, shape (n, 2).

    One leader leads all. Numbers are paired in their order; selections so that the sum of squared distances on the
    baseline is least, which a shift of one side as a whole does not change.

    Raises
    ------
    InputError
        If there are not as many followers as leaders.
    """
    first, second = (rows_of(where, mesh, f"linear constraint '{name}'") for where in (leaders, followers))
    if len(first) == 1:
        return np.column_stack([np.repeat(first, len(second)), second])
    if len(first) != len(second):
        raise InputError(
            f"linear constraint '{name}': {len(first)} points cannot be paired with {len(second)}; give as many"
        )
    if isinstance(leaders, Selection) or isinstance(followers, Selection):
        distances = cdist(points[second], points[first], "sqeuclidean")
        first = first[linear_sum_assignment(distances)[1]]
    return np.column_stack([first, second])
