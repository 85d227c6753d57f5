"""Periodic sides of a mesh that are shifted copies of each other: the lattice repeats itself, and copies move alike.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ...base.display import OneLine
from ...grids.cells.mixed_cells import MixedMesh
from .end_planes import PERIODIC, EndPlane, find_end_planes, lattice_axes

__all__ = ["PeriodicSides", "along_axes", "copies_among", "find_periodic_sides", "means_of_copies", "sides_of"]

SHIFTED = 1e-6
"""Part of the size of a mesh by which copies of nodes may be off: digits of single precision."""

UPRIGHT = 1e-6
"""Sine of the angle that a shift may have with a direction of the lattice."""


@dataclass(frozen=True, eq=False)
class PeriodicSides(OneLine):
    """Two sides of a mesh, one the copy of the other."""

    markers: tuple[str, str]
    pairs: np.ndarray  # int (n, 2), nodes of the first side and their copies
    shift: np.ndarray  # (3,), from the first to the second (m)
    axis: int = -1  # direction of the lattice along the shift

    @property
    def period(self) -> float:
        """Length of the shift (m)."""
        return float(np.linalg.norm(self.shift))


def sides_of(
    mesh: MixedMesh,
    kinds: Mapping[str, str],
    wall_rows: np.ndarray,  # int, nodes of walls
) -> tuple[np.ndarray, tuple[EndPlane, ...], tuple[PeriodicSides, ...]]:
    """Directions of the lattice of a mesh, the planes that it ends in, and its periodic sides that can be tied."""
    sides = find_periodic_sides(mesh, kinds)
    tied = {name for each in sides for name in each.markers}
    axes, planes = lattice_axes(
        mesh.source, find_end_planes(mesh, kinds, wall_rows, tied), [each.shift for each in sides]
    )
    kept = along_axes(sides, axes)
    if len(kept) == len(sides):
        return axes, planes, kept
    tied = {name for each in kept for name in each.markers}
    axes, planes = lattice_axes(
        mesh.source, find_end_planes(mesh, kinds, wall_rows, tied), [each.shift for each in kept]
    )
    return axes, planes, along_axes(kept, axes)


def find_periodic_sides(mesh: MixedMesh, kinds: Mapping[str, str]) -> tuple[PeriodicSides, ...]:
    """Find pairs of periodic markers whose nodes are those of the other but for a shift."""
    size, found = float(np.linalg.norm(np.ptp(mesh.points, axis=0))), []
    sides = {
        n: np.unique(faces) for n, faces in (mesh.markers or {}).items() if kinds.get(n) == PERIODIC and len(faces)
    }
    names, taken = list(sides), set[str]()
    for k, first in enumerate(names):
        for second in names[k + 1 :]:
            rows, others = sides[first], sides[second]
            if len(rows) != len(others) or {first, second} & taken:
                continue
            shift = mesh.points[others].mean(axis=0) - mesh.points[rows].mean(axis=0)
            distances, nearest = cKDTree(mesh.points[others]).query(mesh.points[rows] + shift)
            if distances.max() > SHIFTED * size or len(np.unique(nearest)) < len(rows):
                continue
            taken |= {first, second}
            found.append(PeriodicSides((first, second), np.stack([rows, others[nearest]], axis=1), shift))
    return tuple(found)


def along_axes(sides: Sequence[PeriodicSides], axes: np.ndarray) -> tuple[PeriodicSides, ...]:
    """Those sides whose shift is along a direction of the lattice, rows of axes, and is the period of it."""
    found: list[PeriodicSides] = []
    for each in sides:
        along = np.abs(axes @ each.shift) / each.period
        axis = int(np.argmax(along))
        others = [other.period for other in found if other.axis == axis]
        is_same = all(abs(period - each.period) <= SHIFTED * period for period in others)
        if np.sqrt(max(1.0 - along[axis] ** 2, 0.0)) <= UPRIGHT and is_same:
            found.append(replace(each, axis=axis))
    return tuple(found)


def copies_among(pairs: np.ndarray, n: int) -> np.ndarray:
    """Pairs of the first of all that are copies of each other, among n, and each other one, from pairs (m, 2)."""
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    _, first = np.unique(label, return_index=True)
    root = first[label]
    others = np.flatnonzero(root != np.arange(n))
    return np.stack([root[others], others], axis=1)


def means_of_copies(pairs: np.ndarray, n: int) -> tuple[np.ndarray, csr_array]:
    """Nodes of n that have copies, ascending, and the matrix that gives each the mean of itself and its copies."""
    copies = copies_among(pairs, n)
    rows = np.unique(copies)
    root = rows.copy()
    root[np.searchsorted(rows, copies[:, 1])] = copies[:, 0]
    _, group = np.unique(root, return_inverse=True)
    shape = (int(group.max(initial=-1)) + 1, len(rows))
    members = csr_array((np.ones(len(rows)), (group, np.arange(len(rows)))), shape=shape)
    counts = np.asarray(members.sum(axis=1)).ravel()
    return rows, csr_array((members.T @ members).multiply(1.0 / counts[group][:, None]))
