"""The map from control points to the nodes of a mesh, or to the nodes of one process.

Each process has the lattice, all wall nodes, which the rotations of walls need, and all nodes of periodic sides, whose
copies move equally. Otherwise it has only its own nodes.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...grids.cells.mixed_cells import MixedMesh
from ..riding.riding_mesh import EmbeddedMesh
from ..riding.riding_walls import RidingWalls
from ..sliding.sliding_nodes import SlidingNodes
from ..walls.wall_images import WallImages
from .background_lattice import BackgroundLattice
from .end_planes import EndPlane
from .mesh_map import MeshMap
from .node_copies import TiedNodes
from .sliding_markers import SlidingWalls

__all__ = ["map_of_nodes"]


def map_of_nodes(
    mesh: MixedMesh,
    planes: tuple[EndPlane, ...],  # its end planes
    resting: np.ndarray,  # int, nodes that stay, ascending
    pairs: np.ndarray,  # int (n_pairs, 2), nodes of periodic sides and their copies
    walls: RidingWalls,  # what follows the walls among the nodes `here`
    lattice: BackgroundLattice,
    asked: np.ndarray | None = None,  # int, the nodes of a process, in any order, possibly repeated; else all
    here: np.ndarray | None = None,  # int, ascending: these, and nodes of walls and of periodic sides
    images: WallImages | None = None,  # walls beyond periodic sides
    wall_rows: np.ndarray | None = None,  # int, wall nodes, ascending: the nodes of `walls` without sliding ones
    nodes: SlidingNodes | None = None,  # sliding nodes
) -> MeshMap:
    """Make the map to the nodes."""
    ends, places = [plane.rows for plane in planes], None
    if asked is not None and here is not None:
        wall_rows = None if wall_rows is None else np.searchsorted(here, wall_rows)
        nodes = None if nodes is None else replace(nodes, rows=np.searchsorted(here, nodes.rows))
        resting, *ends = (np.flatnonzero(np.isin(here, rows)) for rows in (resting, *ends))
        mesh = MixedMesh(mesh.points[here], {}, source=mesh.source)
        pairs, places = np.searchsorted(here, pairs), np.searchsorted(here, asked)
        images = None if images is None else replace(images, originals=np.searchsorted(here, images.originals))
    n, beyond = mesh.n_points, None
    if images is not None:
        at_walls = np.searchsorted(walls.rows, images.originals)
        beyond = replace(images, originals=at_walls)
        ends = [np.union1d(rows, n + np.flatnonzero(np.isin(images.originals, rows))) for rows in ends]
        mesh = MixedMesh(images.beyond(mesh.points, mesh.points), {}, source=mesh.source)
        places = np.arange(n) if places is None else places
        n = mesh.n_points
    moving = np.delete(np.arange(n), resting)
    sides = [
        (np.searchsorted(moving, np.setdiff1d(rows, resting)), plane.axis, plane.end)
        for rows, plane in zip(ends, planes)
    ]
    evaluator, none = lattice.evaluator(mesh.points[moving], sides), np.zeros(0, dtype=int)
    embedded = EmbeddedMesh(
        mesh, lattice.control_points, evaluator, moving, none, None, np.zeros(n), walls, mesh.points
    )
    n_walls, tied = (
        len(walls.rows) - (0 if images is None else len(images.points)),
        TiedNodes.of(pairs, mesh.points, lattice.frame),
    )
    if nodes is None or wall_rows is None:
        return MeshMap(embedded.with_baseline(), n_walls, tied, places, beyond)
    flat = [(rows, plane.axis, plane.end) for rows, plane in zip(ends, planes)]
    sliding = SlidingWalls.of(nodes, wall_rows, walls.rows[:n_walls], mesh.points, lattice, flat)
    return MeshMap(embedded.with_baseline(), len(wall_rows), tied, places, beyond, sliding)
