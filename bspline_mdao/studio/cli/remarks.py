"""What commands say of a deformation: what its order means, and what may be wrong with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...core.design.deformation import Deformation
from ...core.design.deformation_warnings import plane_warnings, section_warnings, stream_warnings

__all__ = ["Remarks", "still_lines"]

STILL = 1e-12
"""Displacement, relative to the size of the grid, that counts as none: a hinge far off in another unit leaves 1e-61."""


@dataclass(frozen=True)
class Remarks:
    """Remarks on a deformation; none on given points."""

    notes: tuple[str, ...] = ()  # for the report
    warnings: tuple[str, ...] = ()

    @classmethod
    def of(cls, deformation: Deformation, model: Any, is_section: bool = False) -> Remarks:
        """Remarks on a deformation of a fitted grid or mesh, whose walls may be a section, the same along the span."""
        across = plane_warnings(deformation, model.length_unit)
        along_span = section_warnings(deformation) if is_section else ()
        return cls(deformation.notes, (*stream_warnings(deformation, model), *across, *along_span))


def still_lines(
    largest: float,  # largest displacement of a point of the surface (m)
    size: float,  # size of the grid (m)
) -> list[str]:
    """Say if a deformation moves nothing."""
    said = "the deformation moves no point of the design surface; check its axis, place and unit"
    return [said] if largest <= STILL * size else []
