"""Mean planes of boundary parts that are planar up to roughness; parts of one plane share it.

In files of 4-byte numbers with an offset, nodes of a plane are off it by about 1e-6 of the grid's size. A small part of
such a plane is rougher, relative to its own size, and tilted, so planarity is judged by the size of all parts together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .vectors import nearest_plane

__all__ = ["MeanPlane", "mean_planes", "near_enough"]

ROUGH = 1e-5
"""Parts are planar if their points are within this fraction of the size of all parts from the plane."""


@dataclass(frozen=True, eq=False)
class MeanPlane:
    """A plane through points."""

    normal: np.ndarray  # (3,), unit normal
    offset: float  # product of the normal and the mean of the points (m)
    roughness: float  # largest distance of a point (m)

    @classmethod
    def through(cls, points: np.ndarray) -> MeanPlane:
        """Make the plane nearest to points, shape (n, 3)."""
        normal, distances, _ = nearest_plane(points)
        return cls(normal, float(normal @ points.mean(axis=0)), float(distances.max()))


def mean_planes(
    parts: Sequence[np.ndarray],  # each (n, 3), points of the parts (m)
) -> list[MeanPlane]:
    """Find the planes of parts."""
    # returns the plane of each part, the same object for parts of one plane. A part rougher than `near_enough` is in no
    # plane
    tolerance = near_enough(parts)
    groups: list[list[int]] = []
    first: list[MeanPlane] = []
    for n in sorted(range(len(parts)), key=lambda n: -_extent(parts[n])):
        group = next((g for g, plane in enumerate(first) if _distance(parts[n], plane) <= tolerance), None)
        if group is None:
            first.append(MeanPlane.through(parts[n]))
            groups.append([n])
        else:
            groups[group].append(n)
    found = [MeanPlane.through(np.concatenate([parts[n] for n in sorted(group)])) for group in groups]
    of_part = {n: plane for group, plane in zip(groups, found) for n in group}
    return [of_part[n] for n in range(len(parts))]


def near_enough(parts: Sequence[np.ndarray]) -> float:
    """Distance up to which points of parts are in a plane (m)."""
    return ROUGH * _extent(np.concatenate([np.zeros((0, 3)), *parts]))


def _extent(points: np.ndarray) -> float:
    """Diagonal of the box of points (m)."""
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0


def _distance(points: np.ndarray, plane: MeanPlane) -> float:
    return float(np.abs(points @ plane.normal - plane.offset).max())
