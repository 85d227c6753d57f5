"""Knot insertion and order elevation: more control points, the same geometry.

Both follow from the *blossom* of a spline of order p, the symmetric function ``f(x_1, .., x_{p-1})`` that is affine in
each argument and equals the spline's polynomial for equal arguments. Control point ``i`` is its value
``f(T_{i+1}, .., T_{i+p-1})``. On other knots, the control points are values of the same blossom at other arguments. The
blossom of a basis function is the de Boor triangle with one argument in each step.

A knot can be inserted into curved knots if its weights do not depend on the other parameters. Each weight is a quotient
of two bilinear functions, so this holds everywhere if it holds on the four edges.
Theory: ``docs/theory/splines.rst``.

References
----------
L. Ramshaw, Blossoms are polar forms, *Computer Aided Geometric Design* 6, 1989.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError
from .basis import find_span, raise_order
from .knots import BilinearKnots, ConstantKnots, Knots
from .volume import Volume

SAME = 1e-13
"""Difference of weights between edges that is round-off."""

EDGES = ((0, 0), (0, 1), (1, 0), (1, 1))
"""The four edges of a direction, numbered as in `BilinearKnots`."""


def insert_knots(
    volume: Volume,  # a volume with constant or bilinear knots in this direction; the others may be curved
    control_points: np.ndarray,  # (N0, N1, N2, d)
    direction: int,  # 0, 1 or 2
    # values to add, repeated for a higher multiplicity; into bilinear knots also curved ones, by their values on the
    # four edges, numbered as in `BilinearKnots`
    new_knots: ArrayLike,  # array_like (m,) or (2, 2, m)
) -> tuple[
    Volume, np.ndarray
]:  # volume Volume: the volume with ``m`` more knots; control_points: its control points, ``m`` more in this direction
    """Insert knots in one direction of a volume without changing its geometry.

    Examples
    --------
    >>> import numpy as np
    >>> line = Volume.of(ConstantKnots.uniform(n_control=2, order=2))
    >>> finer, points = insert_knots(line, np.array([0.0, 8.0]).reshape(2, 1, 1, 1), 0, [0.25])
    >>> points.ravel()
    array([0., 2., 8.])
    """
    # `InputError` if the new knots are outside (0, 1) or would be too many of one value, or if the knots are curved and
    # no control points keep the geometry: everywhere, the new knot and the ``2 p - 2`` knots around it must be an
    # affine image of the same numbers
    if isinstance(volume.knots[direction], BilinearKnots):
        for new_knot in np.moveaxis(_on_edges(new_knots), 2, 0):
            volume, control_points = _insert_curved(volume, control_points, direction, new_knot)
        return volume, control_points
    old = _constant_knots(volume, direction)
    new = ConstantKnots(np.sort(np.concatenate([old.knots, np.atleast_1d(new_knots)])), old.order)
    return _on_new_knots(volume, control_points, direction, new, insertion_matrix(old, new))


def elevate_order(volume: Volume, control_points: np.ndarray, direction: int) -> tuple[Volume, np.ndarray]:
    """Raise the order in one direction of a volume by one; geometry and continuity stay the same.

    Examples
    --------
    >>> import numpy as np
    >>> line = Volume.of(ConstantKnots.uniform(n_control=2, order=2))
    >>> parabola, points = elevate_order(line, np.array([0.0, 8.0]).reshape(2, 1, 1, 1), 0)
    >>> points.ravel()
    array([0., 4., 8.])
    """
    # `InputError` if the knots are not constant, or the order is 1 with inner knots (jumps cannot be kept)
    # volume, control_points, direction: as for `insert_knots`
    # returns volume Volume: the volume of higher order; each distinct knot is repeated once more
    # returns control_points: its control points
    old = _constant_knots(volume, direction)
    new = ConstantKnots(np.sort(np.concatenate([old.knots, np.unique(old.knots)])), old.order + 1)
    return _on_new_knots(volume, control_points, direction, new, elevation_matrix(old, new))


def insertion_matrix(
    # all old knots are among the new ones
    old: ConstantKnots,
    new: ConstantKnots,
) -> np.ndarray:  # (new N, old N), its rows are non-negative and sum to one: control points are averaged
    """Matrix from control points to the control points on a finer knot vector of the same order."""
    p = old.order
    return np.array([_blossom(old, new.knots[i], new.knots[i + 1 : i + p]) for i in range(new.n_control)])


def elevation_matrix(
    # the new knots repeat each distinct old knot once more, and are one order higher
    old: ConstantKnots,
    new: ConstantKnots,
) -> np.ndarray:  # (new N, old N), its rows sum to one
    """Matrix from control points to the control points of the order above."""
    # The blossom of the higher order is the mean of the lower one over all ways to leave out one argument.
    p = old.order
    rows = np.zeros((new.n_control, old.n_control))
    for i, row in enumerate(rows):
        arguments = new.knots[i + 1 : i + p + 1]
        for omitted in range(p):
            row += _blossom(old, new.knots[i], np.delete(arguments, omitted)) / p
    return rows


def _on_edges(new_knots: ArrayLike) -> np.ndarray:
    """New knots on the four edges, shape (2, 2, m)."""
    new = np.asarray(new_knots, dtype=float)
    if new.ndim < 2:
        return np.tile(np.atleast_1d(new), (2, 2, 1))
    if new.ndim != 3 or new.shape[:2] != (2, 2):
        raise InputError(f"refinement: new knots of shape {new.shape}; give shape (m,) or (2, 2, m)")
    return new


def _insert_curved(
    volume: Volume, control_points: np.ndarray, direction: int, new_knot: np.ndarray
) -> tuple[Volume, np.ndarray]:
    """Insert one knot, given on the four edges, shape (2, 2), into bilinear knots."""
    old = volume.knots[direction]
    assert isinstance(old, BilinearKnots)
    new = BilinearKnots(np.sort(np.concatenate([old.corners, new_knot[..., None]], axis=2)), old.order)
    edges = [(ConstantKnots(old.corners[e], old.order), ConstantKnots(new.corners[e], old.order)) for e in EDGES]
    weights = np.array([insertion_matrix(*edge) for edge in edges])
    off = np.ptp(weights, axis=0).max()
    if off > SAME:
        raise InputError(
            f"refinement: the knots of direction {direction + 1} are curved, and the weights of the new knot at "
            f"{new_knot[0, 0]:g} differ by {off:.2g} between edges, so no new control points keep the geometry; "
            f"refine a direction with constant knots, or move the control points through a CoarseNet"
        )
    return _on_new_knots(volume, control_points, direction, new, weights.mean(axis=0))


def _blossom(knots: ConstantKnots, xi: float, arguments: np.ndarray) -> np.ndarray:
    """Blossoms of all basis functions, shape (N,), on the span of ``xi``, at ``p - 1`` ascending arguments."""
    T, p = knots.knots, knots.order
    s = find_span(T, p, knots.n_control, xi)
    values = np.ones(p)
    for r, argument in enumerate(arguments, start=1):
        raise_order(T, s, r, argument, values)
    row = np.zeros(knots.n_control)
    row[s + 1 - p : s + 1] = values
    return row


def _constant_knots(volume: Volume, direction: int) -> ConstantKnots:
    knots = volume.knots[direction]
    if not isinstance(knots, ConstantKnots):
        raise InputError(
            f"refinement: the knots of direction {direction + 1} are curved, so no new control points keep the "
            f"geometry; refine a direction with constant knots"
        )
    return knots


def _on_new_knots(
    volume: Volume, control_points: np.ndarray, direction: int, new: Knots, matrix: np.ndarray
) -> tuple[Volume, np.ndarray]:
    knots = volume.knots[:direction] + (new,) + volume.knots[direction + 1 :]
    moved = np.moveaxis(np.tensordot(matrix, control_points, axes=(1, direction)), 0, direction)
    return replace(volume, knots=knots), moved
