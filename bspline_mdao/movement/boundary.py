"""What the points of a mesh may do, from the patches of its grid.

The points of the design surface are given. Those on symmetry planes slide in them; all others on the boundary are
held, wherever they are not released. Where patches meet, the surface goes before the held and those before symmetry.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from fnmatch import fnmatchcase

import numpy as np

from ..errors import InputError
from ..grids.entities import BoundaryFace
from ..grids.topology import Topology
from ..model import FittedModel
from ..splines.greville import greville_abscissae
from .freedom import Freedom
from .mesh import MovingMesh

__all__ = [
    "boundary_points",
    "matching_names",
    "matching_patches",
    "moving_grid",
    "moving_mesh",
    "require_mesh_of",
    "wall_patches",
]

Selection = str | np.ndarray
"""Patches by name or pattern, or points by number."""


def moving_mesh(
    model: FittedModel,
    design: str | Sequence[str] | None = None,
    pinned: Selection | Sequence[Selection] = (),
    released: str | Sequence[str] = (),
) -> MovingMesh:
    """Make the control mesh of a model ready to move.

    Parameters
    ----------
    model : FittedModel
        The fitted grid.
    design : str or sequence of str, optional
        Patches whose control points are the design surface, by name or pattern (``"wing*"``); all walls by default.
    pinned : str, ndarray of int, or sequence of them
        Patches, or numbers of control points (from 0), that are held where they are.
    released : str or sequence of str
        Patches whose control points are free.

    Returns
    -------
    MovingMesh

    Raises
    ------
    InputError
        If a patch does not exist, a symmetry patch is not planar, there is no design surface, or a block is planar.
    """
    parameters = tuple(greville_abscissae(volume) for volume in model.mesh.volumes)
    return _mesh(
        model.topology, model.mesh.control_ids, model.control_points, design, pinned, released, parameters=parameters
    )


def require_mesh_of(model: FittedModel, mesh: MovingMesh, what: str) -> None:
    """Refuse the control mesh of another model; ``what`` names the mesh.

    Raises
    ------
    InputError
        If its control points are not numbered as those of the model.
    """
    ids = model.mesh.control_ids
    if len(mesh.blocks) != len(ids) or not all(map(np.array_equal, mesh.blocks, ids)):
        raise InputError(f"{what} is not the control mesh of {model.header.source}; make it with moving_mesh(model)")


def moving_grid(
    topology: Topology,
    nodes: np.ndarray,
    design: str | Sequence[str] | None = None,
    pinned: Selection | Sequence[Selection] = (),
    released: str | Sequence[str] = (),
) -> tuple[MovingMesh, np.ndarray]:
    """Make a grid ready to move node by node, as the paper's comparator does.

    Parameters
    ----------
    topology : Topology
        Topology of the grid.
    nodes : ndarray, shape (n_nodes, 3)
        All nodes of the grid (m), blocks in order, each in C order.
    design, pinned, released
        As for `moving_mesh`; numbers are those of the points of the mesh.

    Returns
    -------
    mesh : MovingMesh
        Every node of the grid once.
    point_ids : ndarray of int32, shape (n_nodes,)
        The point of each node: ``nodes = points[point_ids]``.

    Raises
    ------
    InputError
        As `moving_mesh`.
    """
    blocks = topology.node_ids()
    rows = np.split(np.arange(topology.n_nodes), np.cumsum([np.prod(shape) for shape in topology.shapes])[:-1])
    rows = [block.reshape(shape) for block, shape in zip(rows, topology.shapes)]
    point_ids = np.empty(topology.n_nodes, dtype=np.int32)
    for segment, ids in zip(topology.segments, blocks):
        point_ids[rows[segment.block][segment.slices]] = ids
    points = np.empty((max(int(ids.max()) for ids in blocks) + 1, 3))
    points[point_ids] = nodes
    return _mesh(topology, blocks, points, design, pinned, released), point_ids


def _mesh(topology: Topology, blocks, points: np.ndarray, design, pinned, released, parameters=None) -> MovingMesh:
    """Sort the boundary faces of all blocks by what is asked of them."""
    for name, ids in zip(topology.segment_names, blocks):
        if 1 in ids.shape:
            raise InputError(f"{topology.source}: {name} is planar; movement needs cells in all three directions")
    pins, pinned_ids = _split(pinned, len(points))
    design = wall_patches(topology) if design is None else design
    design, pins, released = (matching_patches(topology, patterns) for patterns in (design, pins, released))
    freedom = Freedom.of(len(points))
    freedom.hold(pinned_ids)
    for face, ids in boundary_points(topology, blocks):
        if face.patch in design:
            freedom.surface[ids] = True
        elif face.patch in pins:
            freedom.hold(ids)
        elif face.kind == "symmetry" and face.patch not in released:
            freedom.keep_in_plane(ids, points, f"{topology.source}: patch {face.patch}")
        elif face.patch not in released:
            freedom.hold(ids)
    names = topology.segment_names
    return MovingMesh(tuple(blocks), names, points, **freedom.fields(), parameters=parameters)


def boundary_points(topology: Topology, blocks: Sequence[np.ndarray]) -> Iterator[tuple[BoundaryFace, np.ndarray]]:
    """Boundary faces, each with the points of every face of a segment that is on it.

    Declared patches cover whole faces of segments. What nobody declared may end inside one, and counts for all of it.

    Parameters
    ----------
    topology : Topology
        The boundary and the segments.
    blocks : sequence of ndarray of int, each of shape (N0, N1, N2)
        Numbers of the points of every segment, such as those of its control points.
    """
    for face in topology.boundary:
        for number, segment in enumerate(topology.segments):
            for side in range(6) if segment.block == face.window.block else ():
                if segment.face(side).overlaps(face.window):
                    yield face, np.unique(np.take(blocks[number], -(side % 2), axis=side // 2))


def wall_patches(topology: Topology) -> tuple[str, ...]:
    """Names of all patches that are walls.

    Raises
    ------
    InputError
        If none is.
    """
    walls = tuple(sorted({face.patch for face in topology.boundary if face.kind == "wall"}))
    if not walls:
        raise InputError(
            f"{topology.source}: no patch is a wall, so there is no design surface; name the patches in 'design'"
        )
    return walls


def matching_patches(topology: Topology, patterns: str | Sequence[str]) -> frozenset[str]:
    """Names of all patches that match any of the patterns (``"wing*"``).

    Raises
    ------
    InputError
        If a pattern matches none.
    """
    names = {face.patch for face in topology.boundary if face.patch is not None}
    return matching_names(names, patterns, topology.source)


def matching_names(names: Iterable[str], patterns: str | Sequence[str], what: str) -> frozenset[str]:
    """Names of patches that match any of the patterns (``"wing*"``); ``what`` has the patches, for messages.

    Raises
    ------
    InputError
        If a pattern matches none.
    """
    found: set[str] = set()
    for pattern in (patterns,) if isinstance(patterns, str) else patterns:
        matches = {name for name in names if fnmatchcase(name, pattern)}
        if not matches:
            known = ", ".join(sorted(names)) or "none"
            raise InputError(f"{what}: no patch is called '{pattern}'; the patches are {known}")
        found |= matches
    return frozenset(found)


def _split(pinned, n_points: int) -> tuple[list[str], np.ndarray]:
    """Names and numbers of what is pinned."""
    items = [pinned] if isinstance(pinned, np.ndarray) or np.isscalar(pinned) else list(pinned)
    ids = [np.asarray(item).ravel() for item in items if not isinstance(item, str)]
    ids = [numbers for numbers in ids if len(numbers)]
    for numbers in ids:
        if not np.issubdtype(numbers.dtype, np.integer) or numbers.min() < 0 or numbers.max() >= n_points:
            raise InputError(f"pinned points: give numbers from 0 to {n_points - 1}")
    return [item for item in items if isinstance(item, str)], np.concatenate([np.zeros(0, dtype=int), *ids])
