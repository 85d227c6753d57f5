"""Doubts about the references of a flow: axes, reference area, and differences from OpenFOAM's own forces.

All of it may be intended: it is reported, and nothing is refused.
"""

from __future__ import annotations

import numpy as np

from ..loads.force_coefficients import seen_areas
from .wall_loads import CaseWalls

__all__ = ["doubts_about_axes_and_area", "doubts_about_forces"]

AREA_FACTOR = 1.5
"""Intended reference areas differ by less than this factor from the projected area of the walls: the trapezoid of a
wing from its planform with strakes by up to a third, half a body from the whole by 2."""

ACROSS = 0.02
"""Sine of the angle between a plane of symmetry and the stream, 1 degree, above which the stream crosses it."""

AGREE = 1e-5
"""Relative difference of coefficients, from the digits that OpenFOAM prints by default."""


def doubts_about_axes_and_area(
    walls: CaseWalls,
    planes: CaseWalls,  # patches of kind symmetry
    axes: np.ndarray,  # (3, 3), rows are the directions downstream, along the span, and up
    stream: np.ndarray,  # (3,), direction of the free stream
    area: float,  # reference area (m^2)
) -> list[str]:
    """Doubts before a flow is solved, with the numbers."""
    _, areas = walls.geometry()
    frontal, side, planform = seen_areas(areas, axes)
    found = []
    if not any(1.0 / AREA_FACTOR < area / each < AREA_FACTOR for each in (planform, frontal) if each > 0.0):
        found.append(
            f"the reference area is {area:g} m^2, and the walls cover {planform:g} m^2 seen from above and {frontal:g} "
            f"m^2 seen along the stream; of half a body give half of its area, in m^2"
        )
    if planform < 0.5 * max(frontal, side):
        found.append(
            f"the walls cover {planform:g} m^2 seen along 'up', {side:g} m^2 along the span and {frontal:g} m^2 "
            f"downstream; check the order of the axes"
        )
    for name, part in planes.patches.items():
        _, normals = planes.geometry()
        normal = normals[part].sum(axis=0)
        across = abs(float(normal @ stream)) / float(np.linalg.norm(normal))
        if across > ACROSS:
            found.append(
                f"the stream crosses the plane of symmetry '{name}' at {np.degrees(np.arcsin(min(1.0, across))):.0f} "
                f"degrees; check the axes, or to the kind of the patch"
            )
    return found


def doubts_about_forces(ours: dict[str, float], theirs: dict[str, float] | None) -> list[str]:
    """Doubts about coefficients, compared with OpenFOAM's."""
    if theirs is None:
        return ["OpenFOAM wrote no coefficients to compare with; check its log"]
    size = max(map(abs, theirs.values()))
    found = [
        f"{name} is {ours[name]:.8g}, and OpenFOAM finds {theirs[name]:.8g}; report this"
        for name in ours
        if abs(ours[name] - theirs[name]) > AGREE * size
    ]
    if ours["CD"] < 0.0:
        found.append(f"the drag is negative, CD = {ours['CD']:.3g}; check the axes and to the mesh")
    return found
