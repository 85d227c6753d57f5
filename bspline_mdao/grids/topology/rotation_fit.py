"""The rotation that maps points onto others, with or without known partners.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from ...base.numerics.vectors import lengths
from .periodic_pair import SMALLEST, Motion

__all__ = ["CLOSE", "congruent_triangles", "fit_rotation", "fit_turn", "rotation_between"]

CLOSE = 1e-5
"""Nodes of both sides coincide if they are closer than this fraction of the size of the grid."""

MOST_CANDIDATES = 1_000
"""Largest number of points onto which corners of a triangle may be mapped."""


def fit_rotation(
    points: np.ndarray,  # (n, 3), n > 2
    laid: np.ndarray,  # (n, 3), target of each (m)
    size: float,  # size of the grid (m)
) -> Motion | None:  # None if it is a screw or a translation
    """Fit the rotation that best maps points onto others."""
    middle, other = points.mean(axis=0), laid.mean(axis=0)
    u, _, vt = np.linalg.svd((laid - other).T @ (points - middle))
    turn = (u * [1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    sine = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    angle = float(np.arctan2(lengths(sine), 0.5 * (np.trace(turn) - 1.0)))
    if angle <= SMALLEST:
        return None
    axis = sine / lengths(sine) if angle < np.pi - SMALLEST else _axis_of_half_turn(turn, sine)
    return Motion.about(axis, angle, other - turn @ middle, CLOSE * size)


def _axis_of_half_turn(turn: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """Axis of a rotation by nearly half a turn, whose sine says little about it."""
    square = 0.5 * (turn + turn.T) - 0.5 * (np.trace(turn) - 1.0) * np.eye(3)
    axis = square[:, np.argmax(np.diag(square))]
    return axis / lengths(axis) * (-1.0 if axis @ sine < 0.0 else 1.0)


def fit_turn(
    axis: np.ndarray,  # (3,), direction of the axis, of length 1
    points: np.ndarray,  # (n, 3), n > 1
    laid: np.ndarray,  # (n, 3), target of each (m)
    size: float,  # size of the grid (m)
) -> Motion | None:
    """Fit the rotation about an axis of a given direction: a fraction of a full turn if it is one up to digits."""
    middle, other = points.mean(axis=0), laid.mean(axis=0)
    from_axis = [vectors - np.outer(vectors @ axis, axis) for vectors in (points - middle, laid - other)]
    sine, cosine = np.cross(*from_axis) @ axis, np.einsum("nd,nd->n", *from_axis)
    angle = float(np.arctan2(sine.sum(), cosine.sum()))
    if abs(angle) <= SMALLEST:
        return None
    part = np.copysign(2.0 * np.pi / round(2.0 * np.pi / abs(angle)), angle)
    angle = float(part) if abs(part - angle) <= CLOSE else angle
    shift = other - Motion(tuple(axis.tolist()), angle).turn(middle[None])[0]
    return Motion.about(axis, angle, shift - (shift @ axis) * axis, CLOSE * size)


def congruent_triangles(
    corners: np.ndarray,  # (n, 3), points to search
    apart: np.ndarray,  # (n, n), distances between them
    triangle: np.ndarray,  # (3, 3), the corners of one
    near: float,  # tolerance of the sides (m)
) -> np.ndarray:
    """Find all triangles of corners, shape (m, 3, 3), congruent to a given one."""
    sides = lengths(triangle[[0, 0, 1]] - triangle[[1, 2, 2]])
    is_first, is_second, is_third = (np.abs(apart - length) <= near for length in sides)
    a, b = np.nonzero(is_first)
    rows, c = np.nonzero(is_second[a] & is_third[b])
    return corners[np.stack([a[rows], b[rows], c], axis=1)]


def rotation_between(
    nodes: np.ndarray,  # (n, 3), nodes of a side (m)
    others: np.ndarray,  # (n, 3), nodes of another, in any order
    inwards: np.ndarray,  # (n, 3), directions from both into the mesh; zero if there is none
    others_inwards: np.ndarray,
    size: float,  # size of the grid (m)
) -> tuple[Motion, np.ndarray] | None:  # and the number of the other node for each node
    """Find the smallest rotation that maps all nodes of one side onto another that faces it."""
    tree, near = cKDTree(others), CLOSE * size
    found: list[tuple[float, Motion, np.ndarray]] = []
    for triangle, laid in _laid_triangles(nodes, others, near):
        motion = fit_rotation(triangle, laid, size)
        if motion is None or any(abs(motion.angle) >= abs(angle) - SMALLEST for angle, _, _ in found):
            continue
        distances, met = tree.query(motion.move(nodes))
        facing = np.einsum("nd,nd->n", motion.turn(inwards), others_inwards[met])
        if distances.max() > 10.0 * near or np.median(facing) > 0.0 or len(np.unique(met)) < len(nodes):
            continue  # ten times: a rotation from three corners is only as exact as they are
        motion = fit_rotation(nodes, others[met], size) or motion
        if lengths(motion.move(nodes) - others[met]).max() <= near:
            found.append((abs(motion.angle), motion, met))
    return min(found, key=lambda each: each[0])[1:] if found else None


def _laid_triangles(nodes: np.ndarray, others: np.ndarray, near: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield a large triangle of nodes, shape (3, 3), with each triangle of others onto which it may be mapped."""
    middle, other = nodes.mean(axis=0), others.mean(axis=0)
    off, others_off = lengths(nodes - middle), lengths(others - other)
    first = nodes[np.argmax(off)]
    second = nodes[np.argmax(lengths(nodes - first))]
    third = nodes[np.argmax(lengths(np.cross(nodes - first, second - first)))]
    triangle = np.stack([first, second, third])
    may_be = np.abs(others_off[:, None] - lengths(triangle - middle)) <= 2.0 * near
    corners = others[may_be.any(axis=1)]
    if len(corners) > MOST_CANDIDATES:
        return
    for laid in congruent_triangles(corners, cdist(corners, corners), triangle, 2.0 * near):
        yield triangle, laid
