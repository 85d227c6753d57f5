"""Names that users give, or patterns of them, among those that exist."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

from ..errors import InputError

__all__ = ["MARKERS", "PATCHES", "matching_names"]

PATCHES, MARKERS = ("patch", "patches"), ("marker", "markers")
"""What named parts of the boundary are called: of grids of blocks, and of unstructured meshes."""


def matching_names(
    names: Iterable[str],  # existing names
    patterns: str | Sequence[str],  # names or patterns (``"wing*"``)
    what: str,  # what has them, for messages
    called: tuple[str, str] = PATCHES,  # what they are called, singular and plural
) -> frozenset[str]:
    """Names, usually of patches, that match any of the patterns."""
    found: set[str] = set()
    for pattern in (patterns,) if isinstance(patterns, str) else patterns:
        matches = {name for name in names if name == pattern or fnmatchcase(name, pattern)}
        if not matches:
            existing = ", ".join(sorted(names)) or "none"
            raise InputError(f"{what}: no {called[0]} is called '{pattern}'; the {called[1]} are {existing}")
        found |= matches
    return frozenset(found)
