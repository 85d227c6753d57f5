"""Kinds of values in a study: what each accepts, with limits that keep computations bounded; and kinds of keys."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import prod
from typing import Any

from ...base.checks import ORDER_OF_AXES, WITHOUT_SIGNS

__all__ = ["Key", "Kind", "list_of", "number", "one_of", "slices_of", "whole"]

LARGEST = 1e20
"""Largest size of a number; OpenMDAO takes bounds from 1e30 on for none."""

LONGEST = 1000
"""Largest number of entries of a list."""

MOST_LETTERS = 2000
"""Largest number of letters of a text."""

MOST_POINTS = 10_000
"""Largest number of points of a free-form lattice."""

_SLICE = re.compile(r"(-?\d{1,6})?(?::(-?\d{1,6})?)?(?::(-?\d{1,6})?)?", re.ASCII)


@dataclass(frozen=True)
class Kind:
    """A kind of value."""

    words: str  # its description, for messages and tables: "a positive number"
    accepts: Callable[[Any], bool]  # whether it accepts a value of TOML


def number(words: str, least: float = -LARGEST, most: float = LARGEST) -> Kind:
    """A number from the least to the most."""
    return Kind(words, lambda value: type(value) in (int, float) and least <= value <= most)


def whole(least: int, most: int) -> Kind:
    """A whole number from the least to the most."""
    return Kind(f"a whole number from {least} to {most:,}", lambda value: type(value) is int and least <= value <= most)


def list_of(kind: Kind, words: str, n: int | None = None) -> Kind:
    """A list of values of one kind, of any length up to `LONGEST` or of the given one."""

    def accepts(value: Any) -> bool:
        fits = isinstance(value, list) and 0 < len(value) <= LONGEST and n in (None, len(value))
        return fits and all(map(kind.accepts, value))

    return Kind(words, accepts)


def one_of(*names: Any) -> Kind:
    """One of some values."""
    return Kind("one of " + ", ".join(map(str, names)), lambda value: not isinstance(value, bool) and value in names)


def slices_of(text: str) -> tuple[slice | int, ...] | None:
    """Read three slices or numbers, as in the brackets of an index; None if a text is not of this form.

    Examples
    --------
    >>> slices_of(":, 1::2, -1")
    (slice(None, None, None), slice(1, None, 2), -1)
    """
    found: list[slice | int] = []
    for part in text.split(","):
        match = _SLICE.fullmatch(part.strip())
        if not match or not match[0] or (match[3] is not None and int(match[3]) == 0):
            return None
        ends = [None if end is None else int(end) for end in match.groups()]
        found.append(slice(*ends) if ":" in match[0] else int(match[0]))
    return tuple(found) if len(found) == 3 else None


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and bool(value.strip()) and len(value) <= MOST_LETTERS


def _are_axes(value: Any) -> bool:
    return _is_text(value) and set(value) <= set("xyz") and len(set(value)) == len(value)


def _is_rising(value: list[float]) -> bool:
    return all(a < b for a, b in pairwise(value))


NUMBER = number("a number up to 1e20 in size")
POSITIVE = number("a positive number from 1e-20 to 1e20", 1e-20)
FINER = number("a number from 1.1 to 8", 1.1, 8.0)
_WEIGHT = number("", 1e-6, 1e6)
WEIGHT = Kind(
    "0 or a positive number from 1e-6 to 1e6",
    lambda value: _WEIGHT.accepts(value) or (value == 0 and not isinstance(value, bool)),
)
PART = number("a number from 0 to 1", 0.0, 1.0)
WHOLE = whole(1, LONGEST)
FLAG = Kind("true or false", lambda value: isinstance(value, bool))
TEXT = Kind(f"a text of up to {MOST_LETTERS:,} letters", _is_text)
BOUND = Kind(
    "a number up to 1e20 in size, or a list of one for each value",
    lambda value: NUMBER.accepts(value) or list_of(NUMBER, "").accepts(value),
)
POINT = list_of(number("", -1e9, 1e9), "a list of three numbers up to 1e9 in size", 3)
_LINE = list_of(POINT, "", 2)
LINE = Kind(
    "a list of two different points, each of three numbers up to 1e9 in size",
    lambda value: _LINE.accepts(value) and value[0] != value[1],
)
CORNER = list_of(number("", -math.inf, math.inf), "a list of three numbers, -inf or inf where there is no limit", 3)
TRIPLE = list_of(whole(1, 10_000), "a list of three whole numbers", 3)
_COUNTS = list_of(whole(2, MOST_POINTS), "", 3)
LATTICE = Kind(
    f"a list of three whole numbers from 2 on, {MOST_POINTS:,} points in all",
    lambda value: _COUNTS.accepts(value) and prod(value) <= MOST_POINTS,
)
_PARTS = list_of(PART, "", 2)
PARTS = Kind("a list of two rising numbers from 0 to 1", lambda value: _PARTS.accepts(value) and _is_rising(value))
_TEXTS = list_of(TEXT, "")
NAMES = Kind("a name or pattern such as 'wing*', or a list of them", lambda v: _is_text(v) or _TEXTS.accepts(v))
FILES = Kind("a file, or a list of them", NAMES.accepts)
OF_VARIABLES = Kind("the name of a variable, or a list of them", NAMES.accepts)
_BETWEEN = list_of(number("", 1e-6, 1.0 - 1e-6), "")
PLACES = Kind(
    "how many, up to 50, or a list of numbers between 0 and 1",
    lambda value: whole(1, 50).accepts(value) or _BETWEEN.accepts(value),
)
BETWEEN = Kind("a list of numbers between 0 and 1", _BETWEEN.accepts)
NUMBERS = list_of(WHOLE, "a list of whole numbers from 1 on")
FRACTIONS = list_of(PART, "a list of numbers from 0 to 1")
STATIONS = Kind(
    f"how many, up to {LONGEST:,}, or a list of rising places from 0 (root) to 1 (tip)",
    lambda value: WHOLE.accepts(value) or (FRACTIONS.accepts(value) and _is_rising(value)),
)
SLICES = Kind("three slices such as ':, :, 1:'", lambda value: _is_text(value) and slices_of(value) is not None)
OPTIONS = Kind("a table of options", lambda value: isinstance(value, dict))
AXES = Kind(
    f"{ORDER_OF_AXES}, such as 'xzy', {WITHOUT_SIGNS}",
    lambda value: _are_axes(value) and len(value) == 3,
)
_COORDINATES = "one or more of x, y and z such as 'y' or 'xy', without signs: values and bounds have them"
COORDINATES = Kind(_COORDINATES, _are_axes)
DIRECTION = Kind(f"'normal', or {_COORDINATES}", lambda value: value == "normal" or _are_axes(value))


@dataclass(frozen=True)
class Key:
    """A key of a table."""

    kind: Kind  # accepted values
    meaning: str  # what it means, with its unit
    default: Any = None  # value if it is left out; None if there is none to write down
    otherwise: str = ""  # what happens if it is left out and there is no default to write down
    is_required: bool = False  # whether it must be given


WHICH_KIND = {"kind": Key(TEXT, "one of the kinds below", otherwise="the name of the table")}
