"""Warnings of deformations that are likely not meant: by the stream, the planes of symmetry, or a section.

Theory: ``docs/theory/deformations.rst``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..measures.blunt_end import why_backwards
from ..mesh.frame import surface_frame
from ..mesh.surface import SurfaceGrid
from .deformation import (
    Bend,
    Deformation,
    Pitch,
    PrescribedPoints,
    RotateSections,
    ShearDownstream,
    ShearUpwards,
    apply_maps,
)
from .selection import designed_patches

__all__ = ["plane_warnings", "section_warnings", "stream_warnings"]

_STREAMWISE = RotateSections, Pitch, ShearDownstream
"""Maps whose signs depend on which end of the surface is upstream."""

_OUT_OF_PLANE = 1e-3
"""Displacement across a plane of symmetry, relative to the surface, that is warned of.

Deformations that keep their planes leave them by 0 on the M6 and the NACA 0012, even a twist of 60 degrees. A shift by
a tenth of the span leaves by 0.08.
"""

_SPANWISE = {RotateSections: "twist", Bend: "bend", ShearDownstream: "sweep", ShearUpwards: "dihedral"}
"""Maps that differ along the span, and their names."""


def stream_warnings(deformation: Deformation, model: Any) -> tuple[str, ...]:
    """Warnings of a surface whose stream may be taken the wrong way, if the deformation depends on that."""
    if not any(isinstance(point_map, _STREAMWISE) for point_map in deformation.maps):
        return ()
    walls = SurfaceGrid.of(model, designed_patches(model, deformation.mesh) or None)
    why = why_backwards(walls.points, walls.quads, surface_frame(walls.points, walls.planes))
    return (f"{why}; turn the mesh, or change the signs of twist, pitch and sweep",) if why else ()


def plane_warnings(deformation: Deformation, unit: str) -> tuple[str, ...]:
    """Warnings of a deformation that would take points of the surface out of their planes of symmetry."""
    mesh, maps = deformation.mesh, deformation.maps
    rows = mesh.in_plane_rows
    if not len(rows) or any(isinstance(point_map, PrescribedPoints) for point_map in maps):  # these are refused
        return ()
    points = mesh.points[mesh.surface_ids]
    change = apply_maps(maps, points) - points
    off = float(np.abs(np.sum(change[rows] * mesh.in_plane_normals, axis=1)).max())
    if off <= _OUT_OF_PLANE * float(np.ptp(points, axis=0).max()):
        return ()
    return (
        f"the deformation would take points out of their plane of symmetry, by up to {off:.3g} {unit}; they stay in "
        f"it, and the others move as asked",
    )


def section_warnings(deformation: Deformation) -> tuple[str, ...]:
    """Warnings of a deformation of a section, if it differs along the span."""
    names = " and ".join(f"'{_SPANWISE[type(each)]}'" for each in deformation.maps if type(each) in _SPANWISE)
    if not names:
        return ()
    return (
        f"the walls are a section, the same along the span, and {names} would change it along the span; 'pitch' turns "
        f"all of it",
    )
