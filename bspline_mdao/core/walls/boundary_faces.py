"""Boundary faces of the segments of a grid, and the planes that some of them share, for the corners of spans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.numerics.mean_planes import mean_planes, near_enough
from ...grids.topology.boundary_surface import quads_in_turn
from ...grids.topology.node_numbering import NodeNumbering, face_rows
from ...grids.topology.periodic_ties import tied_sides
from ...grids.topology.sharing import boundary_sides
from .planes import PlaneNormal

__all__ = ["BoundaryFace", "boundary_faces"]

PLANAR = 1e-5
"""A face is planar if its corners leave the plane by less than this fraction of its size: single-precision files."""


@dataclass(frozen=True, eq=False)
class BoundaryFace:
    """A boundary face of a segment: its quads of corners and its nodes, which corners see it, and its plane."""

    quads: np.ndarray
    rows: np.ndarray
    rank: int
    plane: int | None


def boundary_faces(numbering: NodeNumbering, ids: Sequence[np.ndarray], points: np.ndarray) -> list[BoundaryFace]:
    """Gather the boundary faces; areas of quads of faces in one plane point to one side."""
    numbers: dict[tuple, int] = {}
    topology, faces = numbering.topology, []
    size = np.linalg.norm(np.ptp(points, axis=0))
    tied = tied_sides(topology)  # their nodes count as inner ones
    sides = [
        (face, number, side, np.take(ids[number], -(side % 2), axis=side // 2))
        for face, number, side in boundary_sides(topology)
        if (number, side) not in tied
    ]
    parts = [points[corners.ravel()] for face, _, _, corners in sides if face.kind == "symmetry"]
    near, mirrors = near_enough(parts), iter(mean_planes(parts))  # planes of symmetry, which may be rough
    for face, number, side, corners in sides:
        rows = numbering.numbers_of(face_rows(topology, topology.segments[number].face(side)).ravel())
        quads, plane = quads_in_turn(corners), None
        normal, area = PlaneNormal.of_quads(quads).normal_and_area(points)
        offsets = points[corners.ravel()] @ normal
        offset, is_planar = offsets.mean(), np.ptp(offsets) <= PLANAR * np.sqrt(area)
        if face.kind == "symmetry":
            mirror = next(mirrors)
            sign = 1.0 if mirror.normal @ normal > 0.0 else -1.0
            normal, offset, is_planar = sign * mirror.normal, sign * mirror.offset, mirror.roughness <= near
        if face.kind != "wall" and area > 0.0 and is_planar:
            sign = np.sign(normal[np.argmax(np.abs(normal))])
            key = tuple(np.round([*(sign * normal), sign * offset / size], 5))
            plane, quads = numbers.setdefault(key, len(numbers)), quads if sign > 0.0 else quads[:, ::-1]
        rank = {"wall": 0, "symmetry": 2}.get(face.kind or "", 1)
        faces.append(BoundaryFace(quads, rows[rows >= 0], rank, plane))
    on_wall = np.unique(np.concatenate([np.zeros(0, int), *(face.quads.ravel() for face in faces if face.rank == 0)]))
    sliding = {face.plane for face in faces if np.isin(face.quads, on_wall).any()} - {None}
    return [replace(face, rank=2) if face.plane in sliding else face for face in faces]
