"""The initial files of the chains of ``warm-up``: a study, a surface grid and an unstructured mesh."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...core.generators.canonical import onera_m6_grid
from ...core.generators.shell import ball_grid
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.io.files import write_grid
from ...grids.topology.grid import Block, Grid
from .warm_up_chains import EULER, MESH, STUDY, SURFACE

__all__ = ["INPUTS", "m6_mesh"]

SU2 = {"hexahedron": 12, "pyramid": 14}
"""Numbers of cell types in the SU2 format, the same as in VTK."""


def write_study(path: str) -> None:
    """Write the study of the Euler equations."""
    Path(path).write_text(EULER, encoding="utf-8")


def write_surface(path: str) -> None:
    """Write the surface of a ball, a block for each side."""
    sides = (Block(block.nodes[:, :, :1].copy(), block.name) for block in ball_grid((7, 6, 5, 3)).blocks)
    write_grid(path, Grid(tuple(sides)))


def write_mesh(path: str) -> None:
    """Write a mesh about the M6 in the format of SU2."""
    mesh, lines = m6_mesh(), ["NDIME= 3"]
    markers = mesh.markers or {}
    lines.append(f"NELEM= {mesh.n_cells}")
    for kind, cells in mesh.cells.items():
        lines += [f"{SU2[kind]} {' '.join(map(str, row))}" for row in cells.tolist()]
    lines.append(f"NPOIN= {mesh.n_points}")
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in mesh.points.tolist()]
    lines.append(f"NMARK= {len(markers)}")
    for name, faces in markers.items():
        lines += [f"MARKER_TAG= {name}", f"MARKER_ELEMS= {len(faces)}"]
        lines += [f"9 {' '.join(map(str, row))}" for row in faces.tolist()]
    Path(path).write_text("\n".join([*lines, ""]), encoding="utf-8")


def m6_mesh() -> MixedMesh:
    """Cells of a grid about the M6 as a mesh: hexahedra, every other one cut into pyramids, with markers."""
    grid = onera_m6_grid((9, 9, 7))
    points, numbers = np.unique(grid.to_vector().reshape(-1, 3), axis=0, return_inverse=True)
    cells, first = [], 0
    for shape in grid.shapes:
        ids = numbers.ravel()[first : first + np.prod(shape)].reshape(shape)
        first += ids.size
        around = (ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:])
        cells.append(np.stack([half for end in (np.s_[:-1], np.s_[1:]) for half in (a[..., end] for a in around)], -1))
    corners = np.concatenate([block.reshape(-1, 8) for block in cells])
    cut, middles = corners[1::2], len(points) + np.arange(len(corners[1::2]))
    faces = cut[:, [[0, 1, 2, 3], [7, 6, 5, 4], [0, 4, 5, 1], [1, 5, 6, 2], [2, 6, 7, 3], [3, 7, 4, 0]]]
    tops = np.broadcast_to(middles[:, None, None], (len(cut), 6, 1))
    pyramids = np.concatenate([faces, tops], axis=2).reshape(-1, 5)
    kinds = {"hexahedron": corners[::2], "pyramid": pyramids}
    points = np.concatenate([points, points[cut].mean(axis=1)])
    skin = MixedMesh(points, kinds).skin
    in_plane = (points[skin][..., 2] == 0.0).all(axis=1)
    on_wing = (np.abs(points[skin]) < 2.0).all(axis=(1, 2)) & ~in_plane
    markers = {"wing": skin[on_wing], "symmetry": skin[in_plane], "farfield": skin[~on_wing & ~in_plane]}
    return MixedMesh(points, kinds, markers)


INPUTS: dict[str, Callable[[str], None]] = {STUDY: write_study, SURFACE: write_surface, MESH: write_mesh}
"""Writers of the files."""
