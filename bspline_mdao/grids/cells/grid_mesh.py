"""The cells of a grid of blocks as a mesh: hexahedra, and what remains of collapsed ones.

Nodes that blocks share, and nodes that coincide because a face is collapsed, are one node of the mesh. A cell with
coincident corners is a polyhedron of its remaining faces: a wedge at a singular line, a pyramid at a pole.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..topology.boundary_surface import corners_in_turn
from ..topology.grid import Grid
from ..topology.index_space import Window
from ..topology.node_numbering import face_rows, node_copies, source_rows
from ..topology.topology import Topology
from .mixed_cells import FACES, MixedMesh

__all__ = ["grid_mesh"]


def grid_mesh(
    grid: Grid,  # the grid
    topology: Topology,  # its topology
    names: Mapping[Window, str],  # names of the markers that windows of its boundary belong to
    # direction of each block across the single layer of cells of a lifted planar grid; None for other grids
    lifted: tuple[int, ...] | None = None,
) -> MixedMesh:
    """Take the cells of the blocks of a grid, and windows of its boundary as markers."""
    vector = grid.to_vector().reshape(-1, 3)
    sources = source_rows(node_copies(topology), np.arange(len(vector)))
    first = sources
    if lifted is not None:
        first = np.concatenate([np.take(ids, 0, axis=d).ravel() for ids, d in zip(_blocks(grid, sources), lifted)])
    unique, numbers = np.unique(first, return_inverse=True)
    points, numbers, of_vector = vector[unique], numbers.ravel(), numbers.ravel()
    if lifted is not None:
        of_vector, second = _of_both_planes(grid, numbers, lifted)
        points = np.concatenate([points, vector[second]])
    ids = _blocks(grid, of_vector)
    across = lifted or (2,) * len(ids)
    cells = np.concatenate([_upright(_hexahedra(block, d), points) for block, d in zip(ids, across)])
    markers: dict[str, list[np.ndarray]] = {}
    for window, name in names.items():
        if lifted is not None and window.lo[lifted[window.block]] == window.hi[lifted[window.block]]:
            continue
        layer = of_vector[face_rows(topology, window)]
        quads = corners_in_turn(layer.squeeze(layer.shape.index(1))).reshape(-1, 4)
        markers.setdefault(name, []).append(_reduced(quads)[0])
    hexahedra, polyhedra = _with_collapsed(cells)
    return MixedMesh(
        points,
        {"hexahedron": hexahedra} if len(hexahedra) else {},
        {name: np.concatenate(parts) for name, parts in markers.items()},
        polyhedra,
        grid.source,
        1 if lifted is None else 2,
        numbers=numbers,
        unit=grid.unit,
    )


def _blocks(grid: Grid, values: np.ndarray) -> list[np.ndarray]:
    """Cut an array over all nodes into an array for each block."""
    return grid.layout.split(values)


def _of_both_planes(grid: Grid, numbers: np.ndarray, lifted: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Number of each node of a lifted grid, and the rows of nodes in the second plane, by their numbers."""
    n, parts, at = int(numbers.max()) + 1, [], 0
    second = np.zeros(n, dtype=np.int64)
    for rows, direction in zip(_blocks(grid, np.arange(grid.n_nodes)), lifted):
        plane = np.take(rows, 0, axis=direction)
        ids = numbers[at : at + plane.size].reshape(plane.shape)
        at += plane.size
        second[ids] = np.take(rows, 1, axis=direction)
        parts.append(np.stack([ids, ids + n], axis=direction))
    return grid.layout.join(parts), second


def _hexahedra(ids: np.ndarray, across: int) -> np.ndarray:
    """Corners of the cells of a block, shape (n_cells, 8), from the numbers of its nodes; layers go ``across``."""
    ids = np.moveaxis(ids, across, 2)
    quads = corners_in_turn(ids)  # (ni - 1, nj - 1, nk, 4)
    return np.concatenate([quads[:, :, :-1], quads[:, :, 1:]], axis=-1).reshape(-1, 8)


def _upright(cells: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Turn the cells of a left-handed block, so that volumes are positive in all blocks."""
    x, y, z = (points[cells[:, corner]] - points[cells[:, 0]] for corner in (1, 3, 4))
    return cells if np.einsum("nd,nd->", np.cross(x, y), z) >= 0.0 else np.roll(cells, 4, axis=1)


def _with_collapsed(cells: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray] | None]:
    """Hexahedra, and those with repeated corners as faces and their cells; None if there are none."""
    ordered = np.sort(cells, axis=1)
    is_collapsed = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    collapsed = cells[is_collapsed]
    if not len(collapsed):
        return cells, None
    faces, kept = _reduced(collapsed[:, np.array(FACES["hexahedron"])].reshape(-1, 4))
    of = np.repeat(np.arange(len(collapsed)), len(FACES["hexahedron"]))[kept]
    has_volume = np.bincount(of, minlength=len(collapsed)) >= 4  # fewer faces do not close a cell
    number = np.cumsum(has_volume) - 1
    return cells[~is_collapsed], (faces[has_volume[of]], number[of[has_volume[of]]])


def _reduced(quads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quads without those that are lines, triangles with their last corner twice, and the numbers of the quads."""
    quads = quads.copy()
    same = quads == np.roll(quads, -1, axis=1)  # a corner and the next one
    at = np.flatnonzero(same.sum(axis=1) == 1)
    turn = (np.argmax(same[at], axis=1)[:, None] + 2 + np.arange(4)) % 4
    quads[at] = np.take_along_axis(quads[at], turn, axis=1)
    kept = np.flatnonzero(same.sum(axis=1) <= 1)
    return quads[kept], kept
