"""Gmsh's meshes (.msh): nodes, elements and physical groups; written back with new nodes in place.

Format: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import os

import numpy as np

from ....base.text import reason_of
from ....errors import InputError
from ...cells.mixed_cells import padded
from ..disk import read_raw
from .gmsh_elements import Block, find_gmsh_elements, physical_names
from .gmsh_nodes import find_gmsh_nodes
from .gmsh_sections import GmshFile
from .layer_of_cells import SectionSpan, volume_or_layer
from .stored_mesh import StoredMesh

__all__ = ["read_msh"]


def read_msh(
    path: str | os.PathLike,  # the file
    span: SectionSpan | None = None,  # the two planes of a two-dimensional mesh; its own by default
) -> StoredMesh:  # its markers are physical surfaces, in two dimensions physical lines
    """Read a mesh of Gmsh, format 2.2 or 4.1, in ASCII or binary."""
    file = GmshFile.of(read_raw(path), str(path))
    try:
        stored, tags = find_gmsh_nodes(file)
        blocks, names = find_gmsh_elements(file), physical_names(file)
        joined = [_with_rows(block, tags) for block in blocks]
    except (ValueError, OverflowError) as error:
        raise (
            error
            if isinstance(error, InputError)
            else InputError(f"{path}: its nodes or elements are damaged ({reason_of(error)}); save it again")
        ) from error
    volume, plane = ((_cells(joined, dimension), _markers(joined, names, dimension - 1)) for dimension in (3, 2))
    return volume_or_layer(stored, volume, plane, span, str(path))


def _with_rows(block: Block, tags: np.ndarray) -> Block:
    """A block with corners as nodes from 0, by their numbers; ValueError if a number is unknown."""
    order = np.argsort(tags, kind="stable")
    rows = np.searchsorted(tags, block.corners, sorter=order)
    is_known = rows < len(tags)
    is_known[is_known] = tags[order[rows[is_known]]] == block.corners[is_known]
    if not is_known.all():
        raise ValueError(f"an element has node {block.corners[~is_known][0]}, which does not exist")
    return Block(block.kind, block.dimension, order[rows], block.groups)


def _cells(blocks: list[Block], dimension: int) -> dict[str, np.ndarray]:
    """Corners of the elements of a dimension, kind by kind."""
    found: dict[str, list[np.ndarray]] = {}
    for block in blocks:
        if block.dimension == dimension:
            found.setdefault(block.kind, []).append(block.corners)
    return {kind: np.concatenate(parts) for kind, parts in found.items()}


def _markers(blocks: list[Block], names: dict[tuple[int, int], str], dimension: int) -> dict[str, np.ndarray]:
    """Elements of the physical groups of a dimension by name, or number if they have none."""
    found: dict[str, list[np.ndarray]] = {}
    for block in blocks:
        if block.dimension != dimension:
            continue
        corners = padded(block.corners) if dimension == 2 else block.corners
        for number in np.unique(block.groups[block.groups != 0]).tolist():
            rows = (block.groups == number).any(axis=1)
            found.setdefault(names.get((dimension, number), str(number)), []).append(corners[rows])
    return {name: np.concatenate(parts) for name, parts in found.items()}
