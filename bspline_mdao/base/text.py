"""Words of messages and tables."""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["counted", "reason_of", "value_name", "value_names"]


def counted(n: int, noun: str, plural: str = "") -> str:
    """Write a number and what it counts.

    Parameters
    ----------
    n : int
        The number.
    noun : str
        What there is one of.
    plural : str
        What there are several of; the noun and an s by default.

    Examples
    --------
    >>> counted(1, "interface"), counted(45084, "node"), counted(0, "near miss", "near misses")
    ('1 interface', '45,084 nodes', '0 near misses')
    """
    return f"{n:,} {noun if n == 1 else plural or noun + 's'}"


def reason_of(error: BaseException) -> str:
    r"""Write what an error of another library says on a line, at most 160 characters of it.

    Examples
    --------
    >>> reason_of(ValueError("no number:\n  'x'"))
    "no number: 'x'"
    """
    return " ".join(str(error).split())[:160]


def value_name(name: str, place: int, n: int | None = None) -> str:
    """Name a value of a variable as Python finds it: by the variable and, of several, its place in it from 0.

    Parameters
    ----------
    name : str
        Name of the variable.
    place : int
        Place of the value in the flat variable, of all of its values and not only those that are optimised.
    n : int, optional
        Number of values of the variable; it counts as one of several by default.

    Examples
    --------
    >>> value_name("twist", 2, 3), value_name("CL", 0, 1)
    ('twist[2]', 'CL')
    """
    return name if n == 1 else f"{name}[{place}]"


def value_names(name: str, n: int, places: Iterable[int] | None = None) -> tuple[str, ...]:
    """Names of the n values of a variable, or of those at some places in a variable of several; see `value_name`."""
    if places is None:
        return tuple(value_name(name, place, n) for place in range(n))
    return tuple(value_name(name, place) for place in places)
