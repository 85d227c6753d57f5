"""Periodic sides of a mesh, copies of each other by a shift or a rotation, along which the lattice is periodic.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ...base.display import OneLine
from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.io.marker_pairs import inward_directions, turned_sides
from ...grids.topology.periodic_pair import Motion
from ...grids.topology.rotation_fit import CLOSE, fit_turn
from .end_planes import FLAT, PERIODIC, SYMMETRY, EndPlane, find_end_planes, lattice_axes
from .lattice_frame import AROUND, CylindricalFrame, LatticeFrame
from .wedge_planes import between_planes

__all__ = ["PeriodicSides", "along_axes", "find_periodic_sides", "sides_of"]

SHIFTED = 1e-6
"""Fraction of the size of a mesh by which copies of nodes may be off: single precision."""

UPRIGHT = 1e-6
"""Largest sine of the angle between a shift and a direction of the lattice."""


@dataclass(frozen=True, eq=False)
class PeriodicSides(OneLine):
    """Two sides of a mesh, one a copy of the other."""

    markers: tuple[str, str]
    pairs: np.ndarray  # int (n, 2), nodes of the first side and their copies
    motion: Motion  # from the first to the second
    axis: int = -1  # direction of the lattice along it
    period: float = 0.0  # period of the lattice in that direction (m)

    def gap(self, points: np.ndarray) -> float:
        """Largest distance (m) between nodes of the mesh, shape (n, 3), and images of their copies by the motion."""
        return float(
            np.linalg.norm(self.motion.move(points[self.pairs[:, 0]]) - points[self.pairs[:, 1]], axis=1).max()
        )


def sides_of(
    mesh: MixedMesh,
    kinds: Mapping[str, str],
    wall_rows: np.ndarray,  # int, nodes of walls
) -> tuple[LatticeFrame, tuple[EndPlane, ...], tuple[PeriodicSides, ...]]:
    """Coordinates of a mesh's lattice, its end planes, and its periodic sides that can be tied."""
    sides = find_periodic_sides(mesh, kinds)
    for each in sides:
        if not each.motion.is_translation:
            found = _around(mesh, kinds, wall_rows, each, sides)
            if found is not None:
                return found
    wedge = between_planes(mesh, find_end_planes(mesh, kinds, wall_rows), kinds, wall_rows)
    if wedge is not None:
        return *wedge, ()
    sides = tuple(each for each in sides if each.motion.is_translation)
    axes, planes = _axes_and_planes(mesh, kinds, wall_rows, sides)
    kept = along_axes(sides, axes)
    if len(kept) == len(sides):
        return LatticeFrame(axes), planes, kept
    axes, planes = _axes_and_planes(mesh, kinds, wall_rows, kept)
    return LatticeFrame(axes), planes, along_axes(kept, axes)


def find_periodic_sides(mesh: MixedMesh, kinds: Mapping[str, str]) -> tuple[PeriodicSides, ...]:
    """Find pairs of periodic markers whose nodes coincide after a shift or a rotation."""
    found = []
    markers = {n: faces for n, faces in (mesh.markers or {}).items() if kinds.get(n) == PERIODIC and len(faces)}
    sides = {name: np.unique(faces) for name, faces in markers.items()}
    names, taken = list(sides), set[str]()
    for find in (_shifted, turned_sides):
        for k, first in enumerate(names):
            for second in names[k + 1 :]:
                if len(sides[first]) != len(sides[second]) or {first, second} & taken:
                    continue
                laid = find(mesh, markers[first], markers[second])
                if laid is not None:
                    taken |= {first, second}
                    found.append(PeriodicSides((first, second), *laid))
    return tuple(found)


def along_axes(sides: Sequence[PeriodicSides], axes: np.ndarray) -> tuple[PeriodicSides, ...]:
    """Sides whose shift is along a direction of the lattice, rows of ``axes``, and is its period."""
    found: list[PeriodicSides] = []
    for each in sides:
        period = float(np.linalg.norm(each.motion.shift))
        along = np.abs(axes @ each.motion.shift) / period
        axis = int(np.argmax(along))
        others = [other.period for other in found if other.axis == axis]
        is_same = all(abs(period - other) <= SHIFTED * period for other in others)
        if np.sqrt(max(1.0 - along[axis] ** 2, 0.0)) <= UPRIGHT and is_same:
            found.append(replace(each, axis=axis, period=period))
    return tuple(found)


def _shifted(mesh: MixedMesh, side: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, Motion] | None:
    """Pairs of face nodes of two markers that are copies by a shift, and the shift."""
    size = float(np.linalg.norm(np.ptp(mesh.points, axis=0)))
    rows, others = np.unique(side), np.unique(other)
    shift = mesh.points[others].mean(axis=0) - mesh.points[rows].mean(axis=0)
    distances, nearest = cKDTree(mesh.points[others]).query(mesh.points[rows] + shift)
    if distances.max() > SHIFTED * size or len(np.unique(nearest)) < len(rows):
        return None
    return np.stack([rows, others[nearest]], axis=1), Motion(shift=tuple(shift.tolist()), unit=mesh.length_unit)


def _axes_and_planes(
    mesh: MixedMesh, kinds: Mapping[str, str], wall_rows: np.ndarray, sides: Iterable[PeriodicSides]
) -> tuple[np.ndarray, tuple[EndPlane, ...]]:
    """Directions of a Cartesian lattice, as rows, and planes."""
    tied = {name for each in sides for name in each.markers}
    shifts = [np.array(each.motion.shift) for each in sides]
    return lattice_axes(mesh.source, find_end_planes(mesh, kinds, wall_rows, tied), shifts)


def _around(
    mesh: MixedMesh,
    kinds: Mapping[str, str],
    wall_rows: np.ndarray,
    turned: PeriodicSides,
    sides: Sequence[PeriodicSides],
) -> tuple[LatticeFrame, tuple[EndPlane, ...], tuple[PeriodicSides, ...]] | None:
    """The same in cylindrical coordinates about the axis of some sides; None if these cannot be tied."""
    size, axis = float(np.linalg.norm(np.ptp(mesh.points, axis=0))), np.array(turned.motion.axis)
    planes = find_end_planes(mesh, kinds, wall_rows, {name for each in sides for name in each.markers})
    is_across = [abs(plane.normal @ axis) >= 1.0 - FLAT for plane in planes]
    if any(is_across):  # exact to the last bit, so sliding nodes stay in their plane
        normal = planes[is_across.index(True)].normal
        axis = normal if normal @ axis > 0.0 else -normal
    first, second = mesh.points[turned.pairs.T]
    motion = fit_turn(axis, first, second, size)
    assert motion is not None
    motion = replace(motion, angle=_angle_through(mesh, turned, motion), unit=mesh.length_unit)
    frame = CylindricalFrame.about(motion, mesh.points, mesh.points[wall_rows])
    bent = [plane for plane, across in zip(planes, is_across) if not across and _is_needed(plane, kinds)]
    if bent:
        raise InputError(
            f"{mesh.source}: the plane of {', '.join(bent[0].markers)} is not at right angles to the axis of the "
            f"{turned.motion} between {' and '.join(turned.markers)}; give either another kind"
        )
    kept = [tied for each in sides if (tied := _tied(each, frame, mesh.points, size)) is not None]
    if all(each.motion.is_translation for each in kept):
        return None
    ends = (
        replace(plane, axis=0, end=-1 if plane.normal @ frame.axes[0] > 0.0 else 0)
        for plane, across in zip(planes, is_across)
        if across
    )
    return frame, tuple(ends), tuple(kept)


def _angle_through(mesh: MixedMesh, sides: PeriodicSides, motion: Motion) -> float:
    """Angle of rotation from the first side to the second through the mesh (rad), possibly the longer way."""
    faces = (mesh.markers or {})[sides.markers[0]]
    rows = np.unique(faces)
    ahead = np.cross(motion.axis, mesh.points[rows] - motion.point)
    towards = float(np.median(np.einsum("nd,nd->n", inward_directions(mesh, faces)[rows], ahead)))
    is_other = towards * motion.angle < 0.0
    return motion.angle - float(np.copysign(2.0 * np.pi, motion.angle)) if is_other else motion.angle


def _is_needed(plane: EndPlane, kinds: Mapping[str, str]) -> bool:
    """Whether nodes must stay in a plane: nodes of other planes at which walls end may also be fixed."""
    return not plane.markers or any(kinds.get(name) == SYMMETRY for name in plane.markers)


def _tied(sides: PeriodicSides, frame: CylindricalFrame, points: np.ndarray, size: float) -> PeriodicSides | None:
    """Sides related by a period of a cylindrical lattice; None for others."""
    first, second = (frame.to_local(points[rows]) for rows in sides.pairs.T)
    if sides.motion.is_translation:
        return next(iter(along_axes([sides], frame.axes[:1])), None)
    steps = (second - first)[first[:, 1] > frame.near, AROUND] / frame.radius
    tied = [
        replace(sides, motion=motion, axis=AROUND, period=frame.period)
        for motion in (frame.motion, frame.motion.inverse())
    ]
    gaps = [each.gap(points) for each in tied]
    if min(gaps) > CLOSE * size:
        return None
    found = tied[int(np.argmin(gaps))]
    # if sides go around the whole circle, some steps are off by a full turn, which must be a multiple of the period
    is_cut = (np.abs(steps - found.motion.angle) > np.pi).any()
    turns = 2.0 * np.pi / abs(found.motion.angle)
    return None if is_cut and abs(turns - round(turns)) > SHIFTED else found
