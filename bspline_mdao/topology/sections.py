"""Sections of an index space: its corners, edges, faces and inside, by the ends at which they lie."""

from __future__ import annotations

from itertools import product

from .entities import Section

__all__ = ["inner_slices", "sections_of", "whole_slices"]


def sections_of(shape: tuple[int, int, int], n_free: int) -> list[Section]:
    """Sections with a number of free directions; a direction of one node has one end and is never free.

    Examples
    --------
    >>> sections_of((5, 1, 4), n_free=1)
    [(0, 0, None), (None, 0, 0), (None, 0, -1), (-1, 0, None)]
    """
    ends = [(0,) if n == 1 else (0, None, -1) for n in shape]
    return [section for section in product(*ends) if section.count(None) == n_free]


def inner_slices(section: Section) -> tuple[slice, slice, slice]:
    """Slices of the inner points of a section."""
    return tuple(slice(1, -1) if end is None else slice(end, end + 1 or None) for end in section)


def whole_slices(section: Section) -> tuple[slice, slice, slice]:
    """Slices of all points of a section."""
    return tuple(slice(None) if end is None else slice(end, end + 1 or None) for end in section)
