"""Checks of user arguments.

Functions ``as_*`` return the argument in the form used in computations, and ``require_*`` refuse another kind. Their
argument ``what`` is its name in messages.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ..errors import InputError

__all__ = [
    "as_array",
    "as_axes",
    "as_direction",
    "as_finite_points",
    "as_numbers",
    "as_vector",
    "axes_text",
    "require_kind",
    "require_list",
]

ORDER_OF_AXES = "x, y and z in the order downstream, along the span, up"
"""How the axes of a flow are named."""

WITHOUT_SIGNS = "without signs: turn a grid whose axes run the other way"
"""What to do where one of them is a negative axis."""


def as_array(values: Any, what: str) -> np.ndarray:
    """Convert numbers to an array of 8-byte reals in C order; complex numbers, from complex steps, stay complex."""
    try:
        array = np.asarray(values)
        return np.ascontiguousarray(array, dtype=complex if array.dtype.kind == "c" else float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: no array of numbers ({error}); give an array") from error


def as_numbers(values: Any, what: str) -> np.ndarray:
    """Return numbers as a new array of floats, not necessarily finite."""
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{what}: '{values}' are no numbers; give an array of them") from None


def as_finite_points(values: Any, n_points: int, what: str) -> np.ndarray:
    """Return points as an array of shape (n_points, 3) of finite numbers."""
    array = as_array(values, what)
    if array.shape != (n_points, 3):
        raise InputError(f"{what} of shape {array.shape}; give shape ({n_points}, 3)")
    is_bad = ~np.isfinite(array).all(axis=1)
    if is_bad.any():
        number = int(np.argmax(is_bad))
        raise InputError(f"{what}: number {number + 1} of {n_points} is {array[number]}, not finite; correct it")
    return array


def as_vector(values: Any, what: str) -> np.ndarray:
    """Return a finite vector, shape (3,)."""
    vector = as_numbers(values, what)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError(f"{what} is {vector.tolist()}; give three finite numbers")
    return vector


def as_direction(values: Any, what: str) -> np.ndarray:
    """Return the unit vector, shape (3,), along a vector of any length."""
    vector = as_vector(values, what)
    if not vector.any():
        raise InputError(f"{what} is {vector.tolist()}; give three numbers that are not all zero")
    return vector / np.linalg.norm(vector)


def as_axes(axes: str, what: str) -> np.ndarray:
    """Return unit vectors downstream, along the span, and up, shape (3, 3), from axis names such as "xzy"."""
    if sorted(axes) != ["x", "y", "z"]:
        raise InputError(f"{what}: axes '{axes}'; name {ORDER_OF_AXES}, {WITHOUT_SIGNS}")
    return np.eye(3)[["xyz".index(axis) for axis in axes]]


def axes_text(axes: np.ndarray) -> str:
    """Name of the nearest coordinate axis of each direction, shape (n, 3); "xzy" for what `as_axes` makes of it."""
    return "".join("xyz"[axis] for axis in np.abs(axes).argmax(axis=1))


def require_kind(
    value: Any,  # the argument
    kind: type,  # what it should be
    what: str,  # what, advice: its name in messages, and what to do
    advice: str,
) -> None:
    """Refuse an argument of another type."""
    if not isinstance(value, kind):
        raise InputError(f"{what} is of type {type(value).__name__}; {advice}")


def require_list(items: Any, kind: str, members: Iterable[str], what: str) -> Sequence:
    """Return a list of objects of one kind, recognised by their required members."""
    if not isinstance(items, Sequence) or isinstance(items, str):
        raise InputError(f"{what}: the {kind}s are one {type(items).__name__}; give a list of them")
    for number, item in enumerate(items, start=1):
        missing = [member for member in members if not hasattr(item, member)]
        if missing or isinstance(item, type):
            found = f"the class {item.__name__}" if isinstance(item, type) else f"of type {type(item).__name__}"
            lacks = f", which has no '{missing[0]}'" if missing else ""
            raise InputError(f"{what}: {kind} {number} is {found}{lacks}; give a {kind}")
    return items
