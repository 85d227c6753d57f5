"""End planes of a mesh: their nodes slide in them, and the lattice has a side there.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ...base.display import OneLine
from ...base.numerics.vectors import nearest_plane
from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.cells.quads import area_vectors
from ..walls.embedded_points import ON_PLANE

__all__ = [
    "INNER",
    "PERIODIC",
    "SLIDING",
    "SYMMETRY",
    "WALL",
    "EndPlane",
    "find_end_planes",
    "lattice_axes",
    "section_axis",
]

FLAT = 1e-6
"""Fraction of the size of a mesh by which nodes of a symmetry plane may be off it: single precision."""

WALL, SYMMETRY, INNER, PERIODIC, SLIDING = "wall", "symmetry", "inner", "periodic", "sliding"
"""Kinds of markers: bodies, symmetry planes, faces inside the mesh, whose nodes move with it, sides that are copies of
each other, and surfaces on which nodes slide. Others are outer."""

PLANE_DIGITS = 4
"""Decimals of a face's unit normal, and of its position relative to the size of the mesh, that distinguish planes."""

ALIGNED = 1e-9
"""Components of unit normals below this are rounding errors."""


@dataclass(frozen=True, eq=False)
class EndPlane(OneLine):
    """A plane in which the mesh ends."""

    markers: tuple[str, ...]  # markers that lie in it; none if the mesh has no marker there
    rows: np.ndarray  # int, nodes of the mesh in it, ascending
    normal: np.ndarray  # (3,), unit normal
    # direction of the lattice along its normal, and which of its sides the plane is: 0 at its start, -1 at its end
    axis: int
    end: int


def find_end_planes(
    mesh: MixedMesh,
    kinds: Mapping[str, str],
    wall_rows: np.ndarray,
    tied: Collection[str] = (),  # markers whose nodes move like their copies
) -> tuple[EndPlane, ...]:
    """Find symmetry planes, and other end planes of a mesh at which its walls end."""
    # Walls that end at an inlet, an outlet or a wind tunnel side would tear cells if its nodes stayed.
    size = float(np.linalg.norm(np.ptp(mesh.points, axis=0)))
    found: list[EndPlane] = []
    for name, faces in (mesh.markers or {}).items():
        kind, rows = kinds.get(name), np.unique(faces)
        if kind in (WALL, INNER) or name in tied or not len(rows):
            continue
        if kind != SYMMETRY and not np.isin(rows, wall_rows).any():
            continue
        parts = [rows]
        if _plane_of(mesh.points[rows])[1] > FLAT * size:
            if kind != SYMMETRY:
                continue
            parts = _parts_in_planes(mesh.points, faces, size)
        found += [plane for rows in parts if (plane := _end_plane(mesh, name, rows, kind == SYMMETRY, size))]
    if mesh.n_copies == 2:
        found += _sides_of_layer(mesh)
    return tuple(_merged(found))


def _end_plane(mesh: MixedMesh, name: str, rows: np.ndarray, is_symmetry: bool, size: float) -> EndPlane | None:
    """The plane of a marker's nodes at an end of the mesh; None for a marker that need not be at an end and is not."""
    normal, off = _plane_of(mesh.points[rows])
    if off > FLAT * size:
        by = f"{off:.3g} {mesh.length_unit}"
        raise InputError(f"{mesh.source}: symmetry marker '{name}' is not plane, by {by}; mend the mesh")
    heights = mesh.points @ normal
    level = float(np.median(heights[rows]))
    low, high = level - heights.min(), heights.max() - level
    if min(low, high) > FLAT * size:
        if is_symmetry:
            raise InputError(
                f"{mesh.source}: symmetry marker '{name}' is not at an end of the mesh; give it another kind"
            )
        return None
    return EndPlane((name,), rows, (-1.0 if low <= high else 1.0) * normal, -1, -1)


def _parts_in_planes(points: np.ndarray, faces: np.ndarray, size: float) -> list[np.ndarray]:
    """Nodes of a marker's faces, grouped by plane: both sides of a section may be one marker."""
    areas = area_vectors(points[faces])
    lengths = np.linalg.norm(areas, axis=1)
    faces, normals = faces[lengths > 0.0], areas[lengths > 0.0] / lengths[lengths > 0.0][:, None]
    largest = np.take_along_axis(normals, np.abs(normals).argmax(axis=1)[:, None], axis=1)
    normals *= np.sign(largest)
    levels = np.einsum("nd,nd->n", points[faces].mean(axis=1), normals) / size
    keys = np.round(np.column_stack([normals, levels]), PLANE_DIGITS) + 0.0
    _, number = np.unique(keys, axis=0, return_inverse=True)
    return [np.unique(faces[number.ravel() == k]) for k in range(number.max() + 1)]


def _sides_of_layer(mesh: MixedMesh) -> list[EndPlane]:
    """The two planes of a two-dimensional mesh."""
    n = mesh.n_stored
    normal = mesh.points[n] - mesh.points[0]
    normal /= np.linalg.norm(normal)
    return [EndPlane((), np.arange(n), -normal, -1, -1), EndPlane((), np.arange(n, 2 * n), normal, -1, -1)]


def _plane_of(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Unit normal of the plane through points, and their largest distance from it."""
    if len(points) < 3:
        return np.zeros(3), np.inf
    normal, distances, _ = nearest_plane(points)
    return normal, float(distances.max())


def _merged(found: Sequence[EndPlane]) -> list[EndPlane]:
    """Merge planes that coincide."""
    planes: list[EndPlane] = []
    for plane in found:
        for k, other in enumerate(planes):
            if plane.normal @ other.normal > 1.0 - FLAT:
                names, rows = other.markers + plane.markers, np.union1d(other.rows, plane.rows)
                planes[k] = replace(other, markers=names, rows=rows)
                break
        else:
            planes.append(plane)
    return planes


def lattice_axes(
    source: str,
    planes: Sequence[EndPlane],
    shifts: Sequence[np.ndarray] = (),  # (3,), from periodic sides to their copies, used as directions if possible
) -> tuple[np.ndarray, tuple[EndPlane, ...]]:
    """Directions of the lattice, as rows, from space or from planes; and the lattice sides of the planes."""
    axes: list[np.ndarray] = []
    for plane in planes:
        along = [abs(axis @ plane.normal) for axis in axes]
        if any(ALIGNED < part < 1.0 - FLAT for part in along):
            names = ", ".join(name for each in planes for name in each.markers)
            raise InputError(
                f"{source}: the planes of {names} are not at right angles, as the sides of a lattice are; "
                f"sides of a sector may be of kind periodic"
            )
        if not any(part >= 1.0 - FLAT for part in along):
            axes.append(plane.normal)
    for shift in shifts:
        along = shift / np.linalg.norm(shift)
        if all(abs(axis @ along) <= ALIGNED for axis in axes):
            axes.append(along)
    while len(axes) < 3:
        rest = np.eye(3) - sum((np.outer(axis, axis) for axis in axes), np.zeros((3, 3)))
        lengths = np.linalg.norm(rest, axis=1)
        axes.append(rest[np.argmax(lengths)] / lengths.max())
    places, which = linear_sum_assignment(-np.abs(np.array(axes).T))
    rows = np.array(axes)[which[np.argsort(places)]]
    rows *= np.sign(np.diag(rows))[:, None]
    sides = []
    for plane in planes:
        along = rows @ plane.normal
        axis = int(np.argmax(np.abs(along)))
        sides.append(replace(plane, axis=axis, end=-1 if along[axis] > 0.0 else 0))
    return rows, tuple(sides)


def section_axis(points: np.ndarray, planes: tuple[EndPlane, ...], axes: np.ndarray) -> int | None:
    """Direction of the lattice across a section, whose nodes are all in two planes."""
    for axis in range(3):
        pair = [plane for plane in planes if plane.axis == axis]
        if len(pair) == 2:
            across = points @ axes[axis]
            low, high = across.min(), across.max()
            if (np.minimum(across - low, high - across) <= ON_PLANE * np.linalg.norm(np.ptp(points, axis=0))).all():
                return axis
    return None
