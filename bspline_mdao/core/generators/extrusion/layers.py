"""Heights of the layers of an extrusion: a geometric progression.

Theory: ``docs/theory/extrusion.rst``.
"""

from __future__ import annotations

import math

import numpy as np

from ....errors import InputError
from ..stretching import geometric_last

LARGEST_GROWTH = 3.0
"""Growth of layers beyond which a grid is useless."""


def layer_heights(
    first_cell: float,  # height of the first layer (m)
    layers: int | None,  # number of layers
    growth: float | None,  # height of a layer relative to the layer below
    outer: float | None,  # total height (m)
) -> np.ndarray:  # (layers,), heights (m)
    """Heights of layers from two of the number of layers, their growth and the outer distance."""
    if outer is not None and not (np.isfinite(outer) and outer > 0.0):
        raise InputError(f"extrusion: outer distance {outer!r}; give a positive length")
    if layers is not None and layers < 1:
        raise InputError(f"extrusion: {layers} layers; give 1 or more")
    if growth is not None and not 1.0 <= growth <= LARGEST_GROWTH:
        raise InputError(f"extrusion: layers that grow by {growth:g}; give a growth from 1 to {LARGEST_GROWTH:g}")
    if growth is not None and layers is not None:
        return first_cell * growth ** np.arange(layers)
    if outer is None or (layers is None and growth is None):
        raise InputError("extrusion: give two of the number of layers, their growth and the outer distance")
    count = _count(first_cell, growth, outer) if layers is None else layers  # the last layer ends at the distance
    return first_cell * _growth(first_cell, count, outer) ** np.arange(count)


def _count(first_cell: float, growth: float | None, outer: float) -> int:
    """Least number of layers with at most this growth that reach a distance."""
    parts = outer / first_cell
    count = parts if growth is None or growth == 1.0 else math.log1p(parts * (growth - 1.0)) / math.log(growth)
    return max(1, math.ceil(count - 1e-9))


def _growth(first_cell: float, layers: int, outer: float) -> float:
    """Growth with which layers reach a distance."""
    if first_cell * layers > outer * (1.0 + 1e-9):
        raise InputError(
            f"extrusion: {layers} layers from {first_cell:g} on reach farther than the outer distance {outer:g}; give "
            f"fewer layers, a lower first cell or a larger distance"
        )
    if layers == 1:
        return 1.0
    last = geometric_last(layers + 1, first_cell / outer) * outer
    growth = (last / first_cell) ** (1.0 / (layers - 1))
    if growth > LARGEST_GROWTH:
        raise InputError(
            f"extrusion: {layers} layers from {first_cell:g} to {outer:g} grow by {growth:.3g} each; give more layers, "
            f"a higher first cell or a smaller distance"
        )
    return growth
