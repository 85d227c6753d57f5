"""The words of a deformation: ``name=value@place,key=value+name=...``."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from ..errors import InputError

__all__ = ["Request", "parse_requests"]

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


@dataclass(frozen=True)
class Request:
    """One deformation as it was asked for.

    Parameters
    ----------
    text : str
        The words, for messages.
    name, value : str
        What is asked for, and how much.
    at : str or None
        What follows an ``@``.
    options : dict of str
        Further values by name.
    """

    text: str
    name: str
    value: str
    at: str | None
    options: dict[str, str]

    def fail(self, reason: str) -> InputError:
        """Error that names these words."""
        return InputError(f"deformation '{self.text}': {reason}")

    def only(self, *keys: str) -> None:
        """Refuse options other than these; ``"@"`` stands for a place."""
        unknown = [key for key in (*self.options, *(["@"] if self.at is not None else [])) if key not in keys]
        if unknown:
            known = " and ".join(keys) if keys else "no option"
            raise self.fail(f"'{unknown[0]}' is not known here; {self.name} takes {known}")

    def number(self, key: str | None = None, default: float | None = None, low=-math.inf, high=math.inf) -> float:
        """Read a number, the value itself or an option (``"@"``: the place), between bounds, both excluded."""
        text = self.value if key is None else self.at if key == "@" else self.options.get(key)
        if text is None:
            return default
        return self._between(self._match(text, f"({_NUMBER})", "a number"), low, high)

    def angle(self, limit: float = 360.0) -> float:
        """Read the value as an angle below a limit (deg); in radians. Degrees are understood without a unit."""
        text = self.value.removesuffix("deg")
        if text.endswith("rad"):
            degrees = math.degrees(self._match(text, f"({_NUMBER})rad", "an angle such as 30deg"))
        else:
            degrees = self._match(text, f"({_NUMBER})", "an angle such as 30deg")
        return math.radians(self._between(degrees, -limit, limit))

    def vector(self) -> tuple[float, float, float]:
        """Read the value as three numbers."""
        match = re.fullmatch(f"({_NUMBER})/({_NUMBER})/({_NUMBER})", self.value)
        if match is None:
            raise self.fail("give three lengths with strokes between them, such as translate=0.1/0/0")
        return tuple(float(word) for word in match.groups())

    def _match(self, text, pattern, what) -> float:
        match = re.fullmatch(pattern, text)
        if match is None:
            raise self.fail(f"'{text}' is not {what}")
        return float(match[1])

    def _between(self, number, low, high) -> float:
        if not low < number < high:
            bounds = f"above {low:g}" if math.isinf(high) else f"between {low:g} and {high:g}"
            raise self.fail(f"{number:g} is out of bounds; give a number {bounds}")
        return number


def parse_requests(text: str) -> list[Request]:
    """Take deformations joined by ``+`` apart.

    Raises
    ------
    InputError
        If the words are not of the form ``name=value``.

    Examples
    --------
    >>> [(request.name, request.value, request.at) for request in parse_requests("stretch=2+bend=120deg@0.7")]
    [('stretch', '2', None), ('bend', '120deg', '0.7')]
    """
    return [_parse(part.strip()) for part in re.split(r"\+(?=\s*[a-z])", text)]


def _parse(text: str) -> Request:
    first, *rest = text.split(",")
    pairs = [re.fullmatch(r"\s*([a-z]+)\s*=\s*([^=]+?)\s*", word) for word in (first, *rest)]
    if not all(pairs):
        raise InputError(f"deformation '{text}' is not of the form name=value; write for example twist=30deg")
    (name, value), *options = [pair.groups() for pair in pairs]
    value, *place = value.split("@", 1)
    return Request(text, name, value.strip(), place[0].strip() if place else None, dict(options))
