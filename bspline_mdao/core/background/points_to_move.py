"""Wall nodes and control points of the lattice, with the constraints of each.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...grids.cells.mixed_cells import MixedMesh
from ..mesh.moving_mesh import MovingMesh
from ..riding.wall_faces import WallFaces
from .background_lattice import BackgroundLattice
from .end_planes import EndPlane
from .mesh_walls import copies_of_walls
from .periodic_sides import PeriodicSides

__all__ = ["points_to_move"]


def points_to_move(
    mesh: MixedMesh,
    walls: WallFaces,
    wall_rows: np.ndarray,  # int (n_walls,), nodes of the walls, ascending
    control_points: np.ndarray,  # (n_points, 3), wall nodes and points of the lattice (m)
    lattice: BackgroundLattice,
    planes: Sequence[EndPlane],  # end planes of the mesh
    periodic: Sequence[PeriodicSides],  # sides that are copies of each other
    ids: tuple[np.ndarray, ...],  # numbers of the points of the lattice among all, in its shape
    names: tuple[str, ...],  # its name in messages
) -> MovingMesh:
    """Walls are the surface; points of the lattice stay in the planes of the mesh, and are fixed at its other ends."""
    n = len(wall_rows)
    is_free = np.ones((*lattice.shape, 3), dtype=bool)
    closed = {(plane.axis, plane.end) for plane in planes}
    at_walls = lattice.sides_at(mesh.points[wall_rows])  # fixed points there would oppose the walls
    for axis in range(3):
        for end in (0, -1):
            side = np.moveaxis(is_free, axis, 0)[end]
            if lattice.lines[axis].is_periodic:
                continue
            if (axis, end) == lattice.frame.side_on_axis(lattice.lines[axis].breaks[0]):
                side[..., 1:] = False
            elif (axis, end) in closed:
                side[..., axis] = False
            elif (axis, end) not in at_walls:
                side[...] = False
    all_free = np.concatenate([np.zeros((n, 3), dtype=bool), is_free.reshape(-1, 3)])
    frame, frames = lattice.frame, None
    if not np.array_equal(frame.axes, np.eye(3)) or not frame.is_cartesian:
        frames = np.broadcast_to(frame.axes, (len(all_free), 3, 3)).copy()
        frames[n:] = lattice.control_directions.rows
    ends = [(plane.normal, np.flatnonzero(np.isin(wall_rows, plane.rows))) for plane in planes]
    ends += [(normal, np.flatnonzero(frame.is_on_axis(control_points[:n]))) for normal in frame.across_axis]
    on_walls, copies = [rows for _, rows in ends], copies_of_walls(mesh, wall_rows, lattice, periodic)
    normals = [np.tile(normal, (len(rows), 1)) for normal, rows in ends]
    return MovingMesh(
        blocks=ids,
        names=names,
        points=control_points,
        surface_ids=np.arange(n, dtype=np.int32),
        is_free=all_free,
        frames=frames,
        in_plane_rows=np.concatenate([np.zeros(0, dtype=int), *on_walls]),
        in_plane_normals=np.concatenate([np.zeros((0, 3)), *normals]),
        volumes=lattice.mesh.volumes,
        surface_faces=np.searchsorted(wall_rows, walls.faces),
        markers=tuple(_places(mesh, walls, wall_rows)),
        copies=copies,
        copy_turns=frame.turns_of_copies(control_points[copies[:, 1]], control_points[copies[:, 0]]),
    )


def _places(mesh: MixedMesh, walls: WallFaces, wall_rows: np.ndarray) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Nodes of each wall, for messages: its name, their positions among wall nodes, and their numbers."""
    for number, name in enumerate(walls.names):
        rows = np.unique(walls.faces[walls.marker == number])
        yield name, np.searchsorted(wall_rows, rows), rows % mesh.n_stored + 1
