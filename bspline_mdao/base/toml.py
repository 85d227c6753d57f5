"""Text of TOML files: parsed, or refused with the line."""

from __future__ import annotations

import tomlkit
from tomlkit.exceptions import InvalidControlChar, TOMLKitError

from ..errors import InputError
from .text import reason_of

__all__ = ["parse_toml"]


def parse_toml(text: str, source: str) -> dict:
    """Parse the text of a TOML file."""
    try:
        return tomlkit.parse(f"{text}\n").unwrap()  # a string that is not closed in the last line has an end, too
    except (TOMLKitError, ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        line = getattr(error, "line", None)
        at = f"line {line}: " if line else ""
        raise InputError(f"{source}: {at}is not TOML ({_reason(error, text)})") from error


def _reason(error: Exception, text: str) -> str:
    """Message of the parser, which takes the end of a line in a string for a character to be escaped."""
    if isinstance(error, InvalidControlChar) and error.col >= len(text.split("\n")[error.line - 1].rstrip("\r")):
        return f"a string is not closed at line {error.line} col {error.col}"
    return reason_of(error)
