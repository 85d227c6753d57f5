"""Text of messages and tables."""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["counted", "reason_of", "value_name", "value_names"]


def counted(n: int, noun: str, plural: str = "") -> str:
    """Write a number with a noun, or its plural, by default the noun and an s.

    Examples
    --------
    >>> counted(1, "interface"), counted(45084, "node"), counted(0, "near miss", "near misses")
    ('1 interface', '45,084 nodes', '0 near misses')
    """
    return f"{n:,} {noun if n == 1 else plural or noun + 's'}"


def reason_of(error: BaseException) -> str:
    r"""Write the message of another library's error on one line, at most 160 characters.

    Examples
    --------
    >>> reason_of(ValueError("no number:\n  'x'"))
    "no number: 'x'"
    """
    return " ".join(str(error).split())[:160]


def value_name(name: str, place: int, n: int | None = None) -> str:
    """Name a value of a variable as Python indexes it: by the variable and, for several, its index from 0.

    The index counts all values of the flat variable, not only optimised ones; without ``n`` there are several.

    Examples
    --------
    >>> value_name("twist", 2, 3), value_name("CL", 0, 1)
    ('twist[2]', 'CL')
    """
    return name if n == 1 else f"{name}[{place}]"


def value_names(name: str, n: int, places: Iterable[int] | None = None) -> tuple[str, ...]:
    """Names of the n values of a variable, or of the values at some indices; see `value_name`."""
    if places is None:
        return tuple(value_name(name, place, n) for place in range(n))
    return tuple(value_name(name, place) for place in places)
