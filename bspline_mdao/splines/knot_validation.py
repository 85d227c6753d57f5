"""Checks that knots are open and increase, with messages that say which do not."""

from __future__ import annotations

import numpy as np

from ..errors import InputError


def check_counts(n_control: int, order: int) -> None:
    """Raise `InputError` unless ``n_control`` control points are enough for the order."""
    if order < 1:
        raise InputError(f"knots: order {order}; the order is at least 1 (4 is cubic)")
    if n_control < order:
        raise InputError(f"knots: {n_control} control points for order {order}; use at least {order} or a lower order")


def check_open(knots: np.ndarray, order: int, n_dimensions: int, multiplicity: int) -> None:
    """Raise `InputError` unless the knots are open.

    Parameters
    ----------
    knots : ndarray, shape (N + p,) or (2, 2, N + p)
        Knots along the last axis.
    order : int
        Order p.
    n_dimensions : int
        Dimensions that the array must have, 1 or 3.
    multiplicity : int
        How often an inner knot may be repeated.
    """
    if knots.ndim != n_dimensions or knots.shape[:-1] not in ((), (2, 2)):
        expected = "(N + p,)" if n_dimensions == 1 else "(2, 2, N + p)"
        raise InputError(f"knots: an array of shape {knots.shape}; give shape {expected}")
    n_control = knots.shape[-1] - order
    check_counts(n_control, order)
    if not np.isfinite(knots).all():
        raise InputError("knots: a value is not finite; give numbers from 0 to 1")
    if (knots[..., :order] != 0).any() or (knots[..., n_control:] != 1).any():
        raise InputError(f"knots: they are not open; the first {order} must be 0 and the last {order} must be 1")
    _check_increasing(knots, order, n_control, multiplicity)


def _check_increasing(knots: np.ndarray, order: int, n_control: int, multiplicity: int) -> None:
    """Check that no knot falls and no more than `multiplicity` inner ones are equal."""
    falls = np.argwhere(np.diff(knots) < 0)
    if len(falls):
        i = falls[0, -1] + 1
        raise InputError(f"knots: knot {i + 1} is below knot {i}; make the inner knots increase from 0 to 1")
    first = order - multiplicity
    repeats = np.argwhere(knots[..., order : n_control + multiplicity] <= knots[..., first:n_control])
    if len(repeats):
        i = first + repeats[0, -1] + 1
        raise InputError(
            f"knots: knots {i} to {i + multiplicity} are equal; inner knots lie between 0 and 1 and at most "
            f"{multiplicity} may be equal"
        )
