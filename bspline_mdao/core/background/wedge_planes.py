"""Two symmetry planes at an angle, as in a wedge: a lattice around their line of intersection ends on both.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.topology.periodic_pair import Motion
from .end_planes import ALIGNED, FLAT, SYMMETRY, EndPlane
from .lattice_frame import AROUND, CylindricalFrame

__all__ = ["between_planes"]


def between_planes(
    mesh: MixedMesh,
    planes: Sequence[EndPlane],  # its end planes
    kinds: Mapping[str, str],
    wall_rows: np.ndarray,  # int, nodes of walls
) -> tuple[CylindricalFrame, tuple[EndPlane, ...]] | None:
    """Coordinates about the line where symmetry planes meet, and all planes in these; None if none meet."""
    pair = next((pair for pair in combinations(planes, 2) if _is_wedge(*pair, kinds)), None)
    if pair is None:
        return None
    size = float(np.linalg.norm(np.ptp(mesh.points, axis=0)))
    axis = np.cross(pair[0].normal, pair[1].normal)
    axis /= np.linalg.norm(axis)
    axis = next((plane.normal for plane in planes if abs(plane.normal @ axis) >= 1.0 - FLAT), axis)
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    levels = [float(np.median(mesh.points[plane.rows] @ plane.normal)) for plane in pair]
    point = np.linalg.solve(np.stack([pair[0].normal, pair[1].normal, axis]), [*levels, 0.0])
    point[np.abs(point) <= ALIGNED * size] = 0.0
    angle = float(np.arccos(-pair[0].normal @ pair[1].normal))
    motion = Motion(tuple(axis.tolist()), angle, tuple(point.tolist()), unit=mesh.length_unit)
    frame = CylindricalFrame.about(motion, mesh.points, mesh.points[wall_rows])
    return frame, tuple(_in_frame(plane, frame, mesh, size) for plane in planes)


def _is_wedge(first: EndPlane, second: EndPlane, kinds: Mapping[str, str]) -> bool:
    """Whether two planes are symmetry planes at an angle other than a right angle."""
    names = (*first.markers, *second.markers)
    is_symmetry = bool(names) and all(kinds.get(name) == SYMMETRY for name in names)
    return is_symmetry and ALIGNED < abs(first.normal @ second.normal) < 1.0 - FLAT


def _in_frame(plane: EndPlane, frame: CylindricalFrame, mesh: MixedMesh, size: float) -> EndPlane:
    """The lattice side of a plane: across the axis, or through it, ignoring nodes on the axis."""
    along = float(plane.normal @ frame.axes[0])
    if abs(along) >= 1.0 - FLAT:
        return replace(plane, axis=0, end=-1 if along > 0.0 else 0)
    off = float(np.abs((mesh.points[plane.rows] - frame.motion.point) @ plane.normal).max())
    if abs(along) > FLAT or off > 2.0 * FLAT * size:
        raise InputError(
            f"{mesh.source}: the plane of {', '.join(plane.markers)} is {off:.3g} {mesh.length_unit} off the line "
            f"where planes of symmetry meet at an angle, and not at right angles to it; give it another kind"
        )
    rows = plane.rows[~frame.is_on_axis(mesh.points[plane.rows])]
    is_ahead = frame.to_local(mesh.points[rows])[:, AROUND].mean() > 0.0
    return replace(plane, rows=rows, axis=AROUND, end=-1 if is_ahead else 0)
