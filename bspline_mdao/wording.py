"""Words of messages and tables."""

from __future__ import annotations

__all__ = ["counted", "reason_of"]


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
