"""Walls of a mesh moved by a lattice: what follows them, and which of their nodes are copies of others.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.spatial import cKDTree

from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.cells.quads import area_vectors
from ..riding.riding_walls import RidingWalls
from ..riding.wall_faces import WallFaces
from ..walls.embedded_points import ON_PLANE
from ..walls.wall_images import WallImages
from .background_lattice import BackgroundLattice
from .end_planes import WALL
from .node_copies import copies_among
from .periodic_sides import PeriodicSides

__all__ = ["FADE", "copies_of_walls", "faces_of_walls", "following_walls", "images_of_walls"]

FADE = 4.0, 0.02
"""Like the fade of meshes embedded in a fitted grid, but shorter, since lattices match the walls better. Smallest
volumes of pyHyp's M6 agree with 8 and 0.03 to three digits; with 2 and 0.01 they are 7 to 12 % smaller."""


REACH = 10.0, 0.03
"""Distance beyond a periodic side from which walls may be followed, in widths of their faces, but at least this
fraction of their size: more than the reach of fading and wall layers."""


def faces_of_walls(mesh: MixedMesh, kinds: Mapping[str, str]) -> np.ndarray:
    """Quads of the markers of a mesh that are walls; `InputError` if there are none, or kinds of other markers."""
    markers = mesh.markers or {}
    unknown = [name for name in kinds if name not in markers]
    if unknown:
        raise InputError(f"{mesh.source}: no marker is '{unknown[0]}'; its markers are {', '.join(markers) or 'none'}")
    walls = [name for name, faces in markers.items() if kinds.get(name) == WALL and len(faces)]
    if not walls:
        raise InputError(
            f"{mesh.source}: no marker is a wall, or it has no faces, so that nothing moves; say which are"
        )
    return np.concatenate([markers[name] for name in walls])


def following_walls(
    mesh: MixedMesh,
    faces: WallFaces,  # its walls
    planes: Sequence[tuple[np.ndarray, np.ndarray]],  # nodes of its end planes, and the planes' unit normals
    at_rest: np.ndarray,  # int, nodes that stay
    # int, ascending: the nodes considered, including wall nodes; all by default
    nodes: np.ndarray | None = None,
    images: WallImages | None = None,  # walls beyond periodic sides
) -> RidingWalls:
    """Find what follows walls, independent of the lattice."""
    walls = RidingWalls.of(mesh, faces, list(planes), at_rest, np.zeros_like(mesh.points), FADE, nodes, images)
    resting = at_rest if nodes is None else np.flatnonzero(np.isin(nodes, at_rest))
    return replace(walls, fading=_without_rows(walls.fading, resting))


def _without_rows(matrix: csr_array, rows: np.ndarray) -> csr_array:
    """Matrix without entries in some rows."""
    kept = np.ones(matrix.shape[0])
    kept[rows] = 0.0
    matrix = csr_array(diags_array(kept) @ matrix)
    matrix.eliminate_zeros()
    return matrix


def images_of_walls(mesh: MixedMesh, walls: WallFaces, sides: Sequence[PeriodicSides]) -> WallImages | None:
    """Walls beyond periodic sides, as far as nodes inside may follow them; None if there are none."""
    corners = mesh.points[walls.faces]
    reach = np.maximum(
        REACH[0] * np.sqrt(np.linalg.norm(area_vectors(corners), axis=1)),
        REACH[1] * np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)),
    )
    pairs = ((each.motion, *each.pairs.T) for each in sides)
    return WallImages.of(mesh.points, walls.faces, walls.marker, reach, pairs)


def copies_of_walls(
    mesh: MixedMesh,
    wall_rows: np.ndarray,  # int (n_walls,), nodes of the walls
    lattice: BackgroundLattice,
    periodic: Sequence[PeriodicSides],
) -> np.ndarray:
    """Positions among wall nodes: for each set of copies, pairs of the first and each other node."""
    copies = _copies_in_layer(mesh, wall_rows, lattice)
    if not periodic:
        return copies
    pairs = np.concatenate([each.pairs for each in periodic])
    pairs = np.searchsorted(wall_rows, pairs[np.isin(pairs, wall_rows).all(axis=1)])
    return copies_among(np.concatenate([copies, pairs]), len(wall_rows))


def _copies_in_layer(mesh: MixedMesh, wall_rows: np.ndarray, lattice: BackgroundLattice) -> np.ndarray:
    """Positions among wall nodes of nodes in the file, and of their copies in the other plane of a section."""
    axis = next((axis for axis, line in enumerate(lattice.lines) if line.is_tied), None)
    if axis is None:
        return np.zeros((0, 2), dtype=int)
    places = lattice.frame.to_local(mesh.points[wall_rows])
    is_low = places[:, axis] < lattice.lines[axis].breaks.mean()
    first, second = np.flatnonzero(is_low), np.flatnonzero(~is_low)
    in_plane = np.delete(places, axis, axis=1)
    distances, nearest = cKDTree(in_plane[second]).query(in_plane[first])
    is_copied = distances <= ON_PLANE * np.linalg.norm(np.ptp(mesh.points, axis=0))
    return np.stack([first[is_copied], second[nearest[is_copied]]], axis=1)
