"""The unit of the lengths of a grid, from its file or its user.

Numbers are never rescaled: the unit is written next to them. Without a unit, metres are assumed.

Theory: ``docs/theory/grid_files.rst``, "Units".
"""

from __future__ import annotations

from dataclasses import Field, replace
from typing import Any, ClassVar, Protocol, TypeVar

from ...errors import InputError

__all__ = ["LENGTH_UNITS", "in_unit", "metres_of"]

_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}

LENGTH_UNITS = tuple(_METRES)
"""Units of lengths."""


class WithUnit(Protocol):
    """A grid, or an unstructured mesh."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def source(self) -> str:
        """Its origin, for messages."""

    @property
    def unit(self) -> str:
        """Unit of its lengths; empty if unknown."""


AnyGrid = TypeVar("AnyGrid", bound=WithUnit)


def in_unit(
    grid: AnyGrid,  # the grid, or unstructured mesh
    unit: str | None,  # one of `LENGTH_UNITS`; None keeps the unit of its file
) -> AnyGrid:
    """Set the unit of the lengths of a grid; its numbers stay."""
    from .grid import Grid  # here: help of the commands lists the units, and loads nothing heavy
    from .stored_grid import StoredGrid

    if unit is None:
        return grid
    if unit not in LENGTH_UNITS:
        raise InputError(f"{grid.source}: no unit is called '{unit}'; choose one of {', '.join(LENGTH_UNITS)}")
    if grid.unit not in ("", unit):
        raise InputError(f"{grid.source}: its file says that lengths are in {grid.unit}, not {unit}; leave out --units")
    changes: dict[str, Any] = {"unit": unit}
    if isinstance(grid, Grid | StoredGrid):
        changes["periodic"] = tuple(replace(pair, motion=replace(pair.motion, unit=unit)) for pair in grid.periodic)
    return replace(grid, **changes)


def metres_of(unit: str) -> float:
    """Length of a unit in metres."""
    return _METRES[unit]
