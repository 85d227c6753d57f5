"""Grids of blocks as meshes: PLOT3D and CGNS with structured zones, written back with new nodes.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ....base.display import OneLine
from ....errors import InputError
from ...cells.grid_mesh import grid_mesh
from ...cells.mixed_cells import MixedMesh
from ...topology.detection import find_topology
from ...topology.grid import Grid
from ...topology.topology import Topology
from ..cgns import CgnsDialect
from ..files import check_grid_name, read_grid, write_grid
from ..formats import format_of_name
from ..marker_guess import MarkerGuess, guess_kinds, kind_of_words
from ..overset_guess import OVERSET
from ..patch_certainty import FaceGuess, how_sure
from ..patch_guess import guess_undeclared
from ..patches import read_patches
from ..plane_grids import PlaneDialect, lift_plane_grid

__all__ = ["BlockMeshFile", "MarkedGrid", "open_blocks", "read_marked_grid"]


PERIODIC = "periodic"
"""Kind of markers, and the beginning of names of guessed patches."""

KIND_OF_MARKER = {OVERSET: "inner"}
"""Kinds of markers for kinds of patches, if they differ: overset faces are inside the mesh, and move along."""


@dataclass(frozen=True, eq=False)
class BlockMeshFile(OneLine):
    """A grid of blocks as a mesh, and its file."""

    mesh: MixedMesh  # the mesh
    grid: Grid  # the grid of the file

    def write(self, path: str | os.PathLike, points: np.ndarray) -> None:
        """Write the file with new nodes, shape (n, 3), whole or not at all; all else in it stays."""
        self.check_name(path)
        moved = self.grid.with_vector(self.mesh.nodes_of_file(points).ravel())
        topology = None
        if isinstance(moved.dialect, CgnsDialect):  # no undeclared interface is added
            topology = replace(find_topology(self.grid), interfaces=())
        write_grid(path, moved, topology)

    def check_name(self, path: str | os.PathLike) -> None:
        """Refuse a name of another format than the file's."""
        check_grid_name(path, self.grid)
        dialect, named = self.grid.dialect, format_of_name(Path(path))
        stored = "CGNS" if isinstance(dialect, CgnsDialect) else "PLOT3D"
        if named is not None and named.name != stored and Path(path).suffix != Path(self.grid.source).suffix:
            raise InputError(f"{path}: the grid is written as it is read, as {stored}; name it so")


@dataclass(frozen=True, eq=False)
class MarkedGrid(OneLine):
    """A grid of blocks as a mesh, with the kinds of its boundary."""

    mesh: MixedMesh  # the mesh, with patches and guessed patches as markers
    kinds: dict[str, MarkerGuess]  # their kinds
    grid: Grid  # the grid, lifted to one cell if it is planar
    topology: Topology  # its topology


def read_marked_grid(path: str | os.PathLike, patches: str | os.PathLike | None = None) -> MarkedGrid:
    """Read a grid of blocks as a mesh, with the kinds of its patches; `InputError` if it cannot be used."""
    grid = lift_plane_grid(read_grid(path))
    if patches is None:
        return marked_grid(grid)
    return marked_grid(read_patches(patches, grid), are_declared=True)


def marked_grid(
    grid: Grid,
    topology: Topology | None = None,
    are_declared: bool = False,  # whether its patches were declared, so that kind other is intended
) -> MarkedGrid:
    """Convert a grid to a mesh: patches become markers, and undeclared boundary is guessed."""
    topology = topology or find_topology(grid)
    guesses = guess_undeclared(grid, topology)
    names = {face.window: face.patch for face in topology.boundary if face.patch is not None}
    names |= {guess.window: guess.name for guess in guesses}
    lifted = grid.dialect.directions if isinstance(grid.dialect, PlaneDialect) else None
    mesh = grid_mesh(grid, topology, names, lifted)
    known = {
        patch.name: MarkerGuess(KIND_OF_MARKER.get(patch.kind, patch.kind), "sure", f"declared as {patch.kind}")
        for patch in grid.patches
        if patch.kind != "other" or (are_declared and kind_of_words(patch.name) == "other")
    }
    known |= _periodic(grid, topology) | _guessed(guesses)
    known = {name: guess for name, guess in known.items() if name in (mesh.markers or {})}
    return MarkedGrid(mesh, guess_kinds(mesh, known), grid, topology)


def _periodic(grid: Grid, topology: Topology) -> dict[str, MarkerGuess]:
    """Patches of kind other that the file declares as periodic sides."""
    found = {}
    for pair in grid.periodic:
        for windows, motion in ((pair.windows, pair.motion), (pair.others, pair.motion.inverse())):
            for face in topology.boundary:
                if face.kind == "other" and face.patch and any(window.contains(face.window) for window in windows):
                    why = f"its file says that a {motion} maps it onto its partner"
                    found[face.patch] = MarkerGuess(PERIODIC, "sure", why)
    return found


def _guessed(guesses: tuple[FaceGuess, ...]) -> dict[str, MarkerGuess]:
    """Guessed kinds of patches, and their certainty."""
    found = {}
    kinds = {guess.name: guess.kind for guess in guesses}
    for name, sure in zip(kinds, how_sure(guesses)):
        kind = PERIODIC if name.startswith(PERIODIC) else KIND_OF_MARKER.get(kinds[name], kinds[name])
        found[name] = MarkerGuess(kind, sure.level, sure.reason)
    return found


def open_blocks(path: str | os.PathLike, mesh: MixedMesh) -> BlockMeshFile:
    """Open the file of a mesh of blocks, to write moved nodes; `InputError` if it has changed."""
    grid = read_grid(path)
    numbers = mesh.numbers
    assert numbers is not None
    nodes, (_, first) = grid.to_vector().reshape(-1, 3), np.unique(numbers, return_index=True)
    if len(nodes) != len(numbers) or not np.array_equal(nodes[first], mesh.points[: mesh.n_stored]):
        raise InputError(f"{path}: has changed since it was fitted; fit it again")
    return BlockMeshFile(mesh, grid)
