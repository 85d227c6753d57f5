"""A Cartesian box of cells around an extruded grid, which overlaps it: the background of an overset grid.

Theory: ``docs/theory/extrusion.rst``.
"""

from __future__ import annotations

import numpy as np

from ....errors import InputError
from ....grids.topology.grid import Block, Grid, Patch
from ....grids.topology.index_space import Window
from .rims import KINDS, Rim
from .surface import SurfaceMesh

GROWTH = 1.2
"""Growth of the cells of a box away from the grid in it."""

MOST_NODES = 2e7
"""Most nodes of a box; beyond, the cells next to the grid in it are too fine for it."""

ALIGNED = 1e-6
"""Cosine between normals of planes up to which they are normal to each other."""


def with_background(
    grid: Grid,  # extruded
    mesh: SurfaceMesh,  # its surface, and the surface's rim
    rim: Rim,
    distance: float,  # of the sides of the box from the surface (m)
) -> Grid:
    """Add a box that ends at planes of symmetry and is far elsewhere; the grid ends in it on patch ``overset``."""
    if not (np.isfinite(distance) and distance > 0.0):
        raise InputError(f"extrusion: a background of {distance!r}; give its distance, a positive length")
    tops = [block.nodes[:, :, -2:] for block in grid.blocks]
    width = float(np.median(np.concatenate([_edges(top[:, :, 1]) for top in tops])))
    bounding = _bounding_planes(mesh, rim)
    frame = _frame([normal for normal, _ in bounding])
    nodes = np.concatenate([block.nodes.reshape(-1, 3) for block in grid.blocks]) @ frame.T
    far = mesh.points @ frame.T
    lines, ends = [], []
    for axis, direction in enumerate(frame):
        planes = [among @ direction for normal, among in bounding if abs(normal @ direction) > 0.5]
        places = np.concatenate([np.zeros(0), *planes])
        low, high = nodes[:, axis].min(), nodes[:, axis].max()
        is_bounded = [bool(np.abs(places - end).min(initial=np.inf) < ALIGNED * (high - low)) for end in (low, high)]
        reach = [0.0 if bounds else end for bounds, end in zip(is_bounded, (low, high))]
        outer = far[:, axis].min() - distance, far[:, axis].max() + distance
        for bounds, end, edge, sign in zip(is_bounded, reach, outer, (-1.0, 1.0)):
            if not bounds and sign * (edge - end) <= 0.0:
                raise InputError(
                    f"{mesh.source}: a background {distance:g} {grid.length_unit} away from the surface ends inside of "
                    f"the grid around it; give a larger distance, or fewer layers"
                )
        lines.append(_line(low, high, width, [None if h else e for h, e in zip(is_bounded, outer)]))
        ends += is_bounded
    if np.prod([float(len(line)) for line in lines]) > MOST_NODES:
        raise InputError(
            f"{mesh.source}: a background with cells of {width:.3g} {grid.length_unit}, as wide as those it meets, has "
            f"{' x '.join(str(len(line)) for line in lines)} nodes; give a smaller outer distance of the layers"
        )
    box = Block(np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1) @ frame, "background")
    whole = Window.whole(len(grid.blocks), box.shape)
    return Grid((*grid.blocks, box), _patches(grid, whole, ends), source=grid.source, unit=grid.unit)


def _edges(nodes: np.ndarray) -> np.ndarray:
    """Lengths of the edges of a face, (n_edges,), without collapsed ones."""
    lengths = np.concatenate([np.linalg.norm(np.diff(nodes, axis=axis), axis=-1).ravel() for axis in (0, 1)])
    return lengths[lengths > 0.0]


def _bounding_planes(mesh: SurfaceMesh, rim: Rim) -> list[tuple[np.ndarray, np.ndarray]]:
    """Normals of the planes of symmetry, and nodes in them, (n_nodes, 3); parallel ones together."""
    bounding: list[tuple[np.ndarray, np.ndarray]] = []
    if (rim.kinds == KINDS.index("periodic")).any():
        raise InputError(f"{mesh.source}: a background around periodic edges is not supported; leave it out")
    for plane in np.unique(rim.planes[rim.kinds == KINDS.index("symmetry")]):
        normal, nodes = rim.normals[plane], mesh.points[np.unique(rim.edges[rim.planes == plane])]
        cosines = [abs(float(normal @ other)) for other, _ in bounding]
        same = [n for n, cosine in enumerate(cosines) if cosine > 1.0 - ALIGNED]
        if same:
            bounding[same[0]] = bounding[same[0]][0], np.concatenate([bounding[same[0]][1], nodes])
        elif max(cosines, default=0.0) > ALIGNED:
            raise InputError(
                f"{mesh.source}: planes of symmetry that are oblique to each other bound no box; leave the background "
                f"out"
            )
        else:
            bounding.append((normal, nodes))
    return bounding


def _frame(normals: list[np.ndarray]) -> np.ndarray:
    """Directions of the box as rows, (3, 3): the normals, and the directions nearest to the remaining axes."""
    frame, free = np.zeros((3, 3)), [0, 1, 2]
    for normal in normals:
        axis = max(free, key=lambda d: abs(normal[d]))
        frame[axis] = normal * (1.0 if normal[axis] > 0.0 else -1.0)
        free.remove(axis)
    for axis in free:
        row = np.eye(3)[axis]
        row = row - frame.T @ (frame @ row)
        frame[axis] = row / np.linalg.norm(row)
    if np.linalg.det(frame) < 0.0:
        frame[2] *= -1.0
    return frame


def _line(low: float, high: float, width: float, outer: list[float | None]) -> np.ndarray:
    """Places evenly spaced between two ends, with growing intervals beyond them to outer ends, if given."""
    cells = max(1, round((high - low) / width))
    line, width = np.linspace(low, high, cells + 1), (high - low) / cells
    for edge, sign, end in zip(outer, (-1.0, 1.0), (low, high)):
        if edge is None:
            continue
        gap = abs(edge - end)
        count = max(1, int(np.ceil(np.log1p((GROWTH - 1.0) * gap / (GROWTH * width)) / np.log(GROWTH))))
        steps = np.cumsum(GROWTH ** np.arange(1, count + 1))
        beyond = end + sign * gap * steps / steps[-1]
        line = np.concatenate([beyond[::-1], line]) if sign < 0.0 else np.concatenate([line, beyond])
    return line


def _patches(grid: Grid, whole: Window, is_bounded: list[bool]) -> tuple[Patch, ...]:
    """Patches of both: outer faces become overset, planes of symmetry stay, and the box has the far field."""
    kept = [patch for patch in grid.patches if patch.kind in ("wall", "symmetry")]
    outer = [window for patch in grid.patches if patch.kind not in ("wall", "symmetry") for window in patch.windows]
    sides = [whole.face(side) for side in range(6)]
    bounding = tuple(side for side, bounds in zip(sides, is_bounded) if bounds)
    far = tuple(side for side, bounds in zip(sides, is_bounded) if not bounds)
    found = [*kept, Patch("overset", "overset", tuple(outer)), Patch("farfield", "farfield", far)]
    return tuple([*found, Patch("symmetry of the background", "symmetry", bounding)] if bounding else found)
