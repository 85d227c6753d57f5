"""Planes of the boundary of a grid, whether they bound all of it, and which surfaces end in them at a right angle.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.numerics.vectors import dots, is_line, lengths
from ..topology.grid import Grid
from ..topology.index_space import FACE_NAMES, Window

__all__ = ["BoundaryPlane", "find_planes"]

PLANAR = 1e-5
"""Nodes are in a plane if they are off it by less than this fraction of the radius of the grid."""

SAME = 1e-3
"""Planes are parallel if their normals differ by less than this (rad)."""

OBLIQUE = 0.35
"""A surface ends in a plane at a right angle if the sine of its deviation is less than this, in the median: 20 deg,
more than the dihedral of most wings."""

DEEP = 8
"""Angles are measured over this fraction of the lines of a surface: first cells in 4-byte reals have no direction."""


@dataclass(frozen=True, eq=False)
class BoundaryPlane:
    """A plane, and the windows of the boundary in it."""

    normal: np.ndarray  # (3,), its unit normal, to the side on which the grid lies, or extends farther
    offset: float  # product of the normal and its points (m)
    windows: tuple[Window, ...]  # windows in it, in the order of the boundary
    is_rim: bool  # whether the whole grid is on this side
    tolerance: float  # nodes nearer than this are in it (m)

    def opposes(self, other: BoundaryPlane) -> bool:
        """Whether another plane is parallel to it, and faces it."""
        return bool(lengths(self.normal + other.normal) < SAME)

    def edges(self, grid: Grid, window: Window) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Edges of a window that lie in the plane: nodes, shape (n, 3), and sines of the angles to its normal."""
        if window.shape.count(1) != 1:
            return
        nodes = np.squeeze(grid.blocks[window.block].nodes[window.slices], axis=window.shape.index(1))
        for lines in (nodes, nodes[::-1], nodes.swapaxes(0, 1), nodes.swapaxes(0, 1)[::-1]):
            if np.abs(lines[0] @ self.normal - self.offset).max() <= self.tolerance:
                inner = lines[max(1, len(lines) // DEEP)]
                across = np.cross(np.gradient(lines[0], axis=0), inner - lines[0])
                size = lengths(across)
                yield lines[0], np.abs(dots(across[size > 0.0], self.normal)) / size[size > 0.0]

    def ends(self, grid: Grid, windows: Sequence[Window]) -> bool:
        """Whether one of these other windows ends in the plane."""
        return any(True for window in windows if window not in self.windows for _ in self.edges(grid, window))

    def ends_normally(self, grid: Grid, windows: Sequence[Window], is_curved: bool = False) -> bool:
        """Whether these other windows end in it at a right angle, and, if requested, along a curved line."""
        found = [edge for window in windows if window not in self.windows for edge in self.edges(grid, window)]
        if not found or (is_curved and is_line(np.concatenate([nodes for nodes, _ in found]))):
            return False
        sines = np.concatenate([sines for _, sines in found])
        return bool(len(sines) and np.median(sines) < OBLIQUE)


def find_planes(
    grid: Grid,  # the grid
    windows: Sequence[Window],  # windows of its boundary
    radius: float,  # radius of the grid (m)
) -> list[BoundaryPlane]:
    """Find the planes in which windows of the boundary lie."""
    tolerance = PLANAR * radius
    nodes = {window: grid.blocks[window.block].nodes[window.slices].reshape(-1, 3) for window in windows}
    outline = np.concatenate(list(_block_faces(grid)))
    planes: list[tuple[np.ndarray, float]] = []
    is_rim: list[bool] = []
    members: list[list[Window]] = []
    faces = [window for window in windows if window.shape.count(1) == 1]  # a line lies in many planes
    for window in sorted(faces, key=lambda window: -_extent(nodes[window])):
        match = next((n for n, plane in enumerate(planes) if _is_in(nodes[window], *plane, tolerance)), None)
        if match is not None:
            members[match].append(window)
            continue
        middle = nodes[window].mean(axis=0)
        normal = np.linalg.svd(nodes[window] - middle, full_matrices=len(nodes[window]) < 3)[2][2]
        offset = float(normal @ middle)
        if not _is_in(nodes[window], normal, offset, tolerance) or is_line(nodes[window]):
            continue
        heights = outline @ normal - offset
        side = 1.0 if heights.max() > -heights.min() else -1.0
        planes.append((side * normal, side * offset))
        is_rim.append(bool((side * heights).min() >= -tolerance))
        members.append([window])
    order = {window: n for n, window in enumerate(windows)}
    return [
        BoundaryPlane(*plane, tuple(sorted(part, key=order.__getitem__)), rim, tolerance)
        for plane, part, rim in zip(planes, members, is_rim)
    ]


def _block_faces(grid: Grid) -> Iterator[np.ndarray]:
    """Nodes of the faces of all blocks, shape (n, 3) each."""
    for number, block in enumerate(grid.blocks):
        for face in range(len(FACE_NAMES)):
            yield block.nodes[Window.whole(number, block.shape).face(face).slices].reshape(-1, 3)


def _extent(nodes: np.ndarray) -> float:
    """Largest distance of nodes from their mean (m)."""
    return float(lengths(nodes - nodes.mean(axis=0)).max())


def _is_in(nodes: np.ndarray, normal: np.ndarray, offset: float, tolerance: float) -> bool:
    return bool(np.abs(nodes @ normal - offset).max() <= tolerance)
