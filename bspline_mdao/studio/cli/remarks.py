"""What commands say of a deformation: what its order means, and what may be wrong with it."""

from __future__ import annotations

from typing import Any

from ...core.design.deformation import Deformation
from ...core.design.deformation_warnings import plane_warnings, section_warnings, stream_warnings
from .output import print_lines, print_warnings

__all__ = ["show_remarks", "still_lines"]

STILL = 1e-12
"""Displacement, relative to the size of the grid, that counts as none: a hinge far off in another unit leaves 1e-61."""


def show_remarks(
    deformation: Deformation,  # of the walls
    model: Any,  # the fitted grid or mesh
    is_section: bool,  # whether its walls are a section, the same along the span
) -> None:
    """Print remarks on a deformation, which come before the first move: it may be refused for what they say."""
    along_span = section_warnings(deformation) if is_section else ()
    print_lines(deformation.notes)
    print_warnings([*stream_warnings(deformation, model), *plane_warnings(deformation, model.length_unit), *along_span])


def still_lines(
    largest: float,  # largest displacement of a point of the surface (m)
    size: float,  # size of the grid (m)
) -> list[str]:
    """Say if a deformation moves nothing."""
    said = "the deformation moves no point of the design surface; check its axis, place and unit"
    return [said] if largest <= STILL * size else []
