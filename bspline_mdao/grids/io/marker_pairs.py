"""Markers of a mesh that a rotation maps onto each other: periodic sides, which face each other.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..cells.mixed_cells import MixedMesh
from ..cells.quads import area_vectors
from ..topology.periodic_pair import Motion
from ..topology.rotation_fit import rotation_between

__all__ = ["inward_directions", "turned_markers", "turned_sides"]


def turned_sides(
    mesh: MixedMesh,
    side: np.ndarray,  # int (n_faces, 4), faces of a marker
    other: np.ndarray,  # int (n_others, 4), faces of another
) -> tuple[np.ndarray, Motion] | None:
    """Pairs of nodes of two markers, shape (n, 2), that are copies by a rotation, and the rotation; else None."""
    rows, others = np.unique(side), np.unique(other)
    inwards = inward_directions(mesh, np.concatenate([side, other]))
    size = float(np.linalg.norm(np.ptp(mesh.points, axis=0)))
    found = rotation_between(mesh.points[rows], mesh.points[others], inwards[rows], inwards[others], size)
    if found is None:
        return None
    return np.stack([rows, others[found[1]]], axis=1), replace(found[0], unit=mesh.length_unit)


def inward_directions(mesh: MixedMesh, faces: np.ndarray) -> np.ndarray:
    """Directions into the mesh at its nodes, shape (n_points, 3): zero except at faces with cells on one side."""
    faces, found = mesh.into_fluid(faces), np.zeros_like(mesh.points)
    np.add.at(found, faces.ravel(), np.repeat(area_vectors(mesh.points[faces]), 4, axis=0))
    return found


def turned_markers(
    mesh: MixedMesh,
    markers: Mapping[str, bool],  # markers to search, and whether each is a plane
) -> dict[str, tuple[str, Motion]]:  # partner of each that has one, and the rotation onto it
    """Find pairs of markers; planes only count for rotations by other than right angles, which map boxes too."""
    faces = {name: (mesh.markers or {})[name] for name in markers}
    counts = {name: len(np.unique(of)) for name, of in faces.items()}
    found: dict[str, tuple[str, Motion]] = {}
    names = list(markers)
    for k, first in enumerate(names):
        for second in names[k + 1 :]:
            if counts[first] != counts[second] or counts[first] < 3 or {first, second} & found.keys():
                continue
            laid = turned_sides(mesh, faces[first], faces[second])
            if laid is not None and not (markers[first] and laid[1].is_of_box):
                found[first], found[second] = (second, laid[1]), (first, laid[1].inverse())
    return found
