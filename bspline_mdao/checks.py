"""Checks of what users hand over: numbers, and lists of objects of one kind."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from .errors import InputError

__all__ = ["given_axes", "given_direction", "given_list", "given_numbers", "given_vector"]


def given_numbers(values, what: str) -> np.ndarray:
    """Numbers as an array of floats; not necessarily finite.

    Raises
    ------
    InputError
        If they are no numbers, or lists of unequal lengths.
    """
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{what}: '{values}' are no numbers; give an array of them") from None


def given_vector(values, what: str) -> np.ndarray:
    """A finite vector, shape (3,).

    Raises
    ------
    InputError
        If it is none.
    """
    vector = given_numbers(values, what)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError(f"{what} is {vector.tolist()}; give three finite numbers")
    return vector


def given_direction(values, what: str) -> np.ndarray:
    """A unit vector, shape (3,), of a vector of any length.

    Raises
    ------
    InputError
        If it is no finite vector, or zero.
    """
    vector = given_vector(values, what)
    if not vector.any():
        raise InputError(f"{what} is {vector.tolist()}; give three numbers that are not all zero")
    return vector / np.linalg.norm(vector)


def given_axes(axes: str, what: str) -> np.ndarray:
    """Directions downstream, along the span, and up, shape (3, 3), from the names of the axes, such as "xzy".

    Raises
    ------
    InputError
        If they are not x, y and z in some order.
    """
    if sorted(axes) != ["x", "y", "z"]:
        raise InputError(f"{what}: axes '{axes}'; name x, y and z in the order downstream, along the span, up")
    return np.eye(3)[["xyz".index(axis) for axis in axes]]


def given_list(items, kind: str, members: Iterable[str], what: str) -> Sequence:
    """Objects of one kind, told by the members that they need.

    Raises
    ------
    InputError
        If there is no list, or something in it is of another kind.
    """
    if not isinstance(items, Sequence) or isinstance(items, str):
        raise InputError(f"{what}: the {kind}s are one {type(items).__name__}; give a list of them")
    for number, item in enumerate(items, start=1):
        missing = [member for member in members if not hasattr(item, member)]
        if missing or isinstance(item, type):
            found = f"the class {item.__name__}" if isinstance(item, type) else f"of type {type(item).__name__}"
            lacks = f", which has no '{missing[0]}'" if missing else ""
            raise InputError(f"{what}: {kind} {number} is {found}{lacks}; give a {kind}")
    return items
