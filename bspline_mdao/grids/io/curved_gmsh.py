"""Curved hexahedra as a mesh file of Gmsh, format 4.1, written through meshio.

The volume is the physical group ``fluid``, and every patch is a group of surfaces. Theory:
``docs/theory/high_order.rst``.
"""

from __future__ import annotations

import os

import numpy as np

from ...base.extras import library
from ..cells.curved_grid import CurvedGrid
from .disk import replaced_file
from .element_order import gmsh_order

__all__ = ["VOLUME", "write_msh"]

VOLUME = "fluid"
"""Name of the physical group of all hexahedra."""

HEXAHEDRA = {1: "hexahedron", 2: "hexahedron27", 3: "hexahedron64", 4: "hexahedron125"}
QUADRANGLES = {1: "quad", 2: "quad9", 3: "quad16", 4: "quad25"}
"""Names of the element types in meshio, by degree."""

_EDGES = [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15]
_FACES_AND_CENTRE = [22, 23, 21, 24, 20, 25, 26]
_VTK_OF_27 = np.array(_EDGES + _FACES_AND_CENTRE)
"""Nodes of Gmsh's hexahedron of 27 in the order of VTK, which meshio expects; others stay the same."""


def write_msh(
    path: str | os.PathLike,  # the file to create or replace
    grid: CurvedGrid,  # the elements
) -> None:
    """Write curved hexahedra as a binary mesh of Gmsh, whole or not at all."""
    meshio = library("meshio", f"{path}: files of Gmsh need meshio", "gmsh", "write CGNS (.cgns)")
    hexahedra = grid.elements.reshape(len(grid.elements), -1)[:, gmsh_order(grid.degree)]
    cells = [(HEXAHEDRA[grid.degree], hexahedra[:, _VTK_OF_27] if grid.degree == 2 else hexahedra)]
    order = gmsh_order(grid.degree, 2)
    cells += [(QUADRANGLES[grid.degree], patch.faces.reshape(len(patch.faces), -1)[:, order]) for patch in grid.patches]
    tags = [1, *range(1, len(grid.patches) + 1)]  # of volumes and of surfaces, each counted from 1
    tag_data = [np.full(len(numbers), tag) for tag, (_, numbers) in zip(tags, cells)]
    groups = {VOLUME: np.array([1, 3])} | {p.name: np.array([tag, 2]) for tag, p in zip(tags[1:], grid.patches)}
    mesh = meshio.Mesh(
        grid.nodes,
        cells,
        point_data={"gmsh:dim_tags": _owners(grid)},
        cell_data={"gmsh:physical": tag_data, "gmsh:geometrical": tag_data},
        field_data=groups,
    )
    with replaced_file(path) as temporary:
        meshio.write(temporary, mesh, file_format="gmsh", binary=True)


def _owners(grid: CurvedGrid) -> np.ndarray:
    """Dimension and tag of the first surface of each node, or of the volume; shape (n_nodes, 2)."""
    owners = np.tile([3, 1], (len(grid.nodes), 1))
    for number in range(len(grid.patches), 0, -1):
        owners[grid.patches[number - 1].faces] = 2, number
    return owners
