"""Requested heights of first cells, in units of length or in viscous units."""

from __future__ import annotations

import numpy as np

from ...errors import InputError
from ...grids.cells.wall_spacing import flat_plate_y_plus

__all__ = ["first_cell_of"]


def first_cell_of(
    length: float,  # length of the chord, or other reference length of the Reynolds number (m)
    first_cell: float | None,  # height of the first cells (m)
    y_plus: float | None,  # the same in viscous units
    reynolds: float | None,  # Reynolds number of the length
) -> float | None:  # height of the first cells (m); None if none is requested
    """Find the requested height of first cells."""
    given = {"first_cell": first_cell, "y_plus": y_plus, "reynolds": reynolds}
    for name, value in given.items():
        if value is not None and not (np.isfinite(value) and value > 0.0):
            raise InputError(f"first cells: {name} of {value}; give a positive number")
    if first_cell is not None and (y_plus is not None or reynolds is not None):
        raise InputError("first cells: a height, and y+ or a Reynolds number as well; give one of both")
    if (y_plus is None) != (reynolds is None):
        raise InputError("first cells: y+ and the Reynolds number go together; give both")
    if y_plus is None or reynolds is None:
        return first_cell
    return y_plus / flat_plate_y_plus(1.0, reynolds / length, length)
