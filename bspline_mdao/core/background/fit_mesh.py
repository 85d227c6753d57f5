"""From a mesh file to its mover: the counterpart of `fit_grid` for unstructured meshes.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

import os
from pathlib import Path

from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.cells.skin_parts import with_markers
from ...grids.io.marker_guess import MarkerGuess
from ...grids.io.marker_kinds import marker_kinds, undecided
from ...grids.io.meshes.blocks import MarkedGrid, read_marked_grid
from ...grids.io.meshes.files import is_mesh, read_mesh
from ...grids.topology.length_unit import in_unit
from .lattice_settings import DEFAULTS, LatticeSettings
from .mesh_model import MeshModel

__all__ = ["fit_mesh", "mesh_of_blocks", "read_marked_mesh"]


def fit_mesh(
    path: str | os.PathLike,
    patches: str | os.PathLike | None = None,
    settings: LatticeSettings = DEFAULTS,
    units: str | None = None,
) -> MeshModel:
    r"""Put a lattice around the mesh in a file.

    Parameters
    ----------
    path : path-like
        The file, or OpenFOAM's folder ``polyMesh``, see `read_mesh`; or a structured grid, PLOT3D or CGNS, see
        `read_grid`, whose blocks all move with the same lattice, whether joined or overlapping.
    patches : path-like, optional
        TOML file with the kinds of its markers, see `read_kinds`; missing kinds are guessed, see `guess_kinds`. For a
        grid, its patches, see `read_patches`.
    settings : LatticeSettings
        Settings of the lattice.
    units : str, optional
        Length unit of a file that does not state it, for example ``"mm"``: lengths are displayed in it and not
        converted. The default is metres.

    Returns
    -------
    MeshModel

    Raises
    ------
    InputError
        If a file is invalid, no marker seems to be a wall, or as for `MeshModel.of`.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from bspline_mdao.meshes import fit_mesh
    >>> nodes = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "cell.su2")
    ...     marker = "NMARK= 1\nMARKER_TAG= wing\nMARKER_ELEMS= 1\n5 0 1 2\n"
    ...     _ = path.write_text(f"NDIME= 3\nNELEM= 1\n10 0 1 2 3\nNPOIN= 4\n{nodes}{marker}")
    ...     fit_mesh(path).kinds
    {'wing': 'wall'}
    """
    mesh, kinds = read_marked_mesh(path, patches, units)
    return MeshModel.of(mesh, {name: guess.kind for name, guess in kinds.items()}, settings, Path(path).absolute())


def read_marked_mesh(
    path: str | os.PathLike, patches: str | os.PathLike | None, units: str | None = None
) -> tuple[MixedMesh, dict[str, MarkerGuess]]:
    """Read a mesh and the kinds of its markers; `InputError` if they do not define what moves."""
    if not is_mesh(path):
        mesh, kinds = mesh_of_blocks(path, read_marked_grid(path, patches))
        return in_unit(mesh, units), kinds
    mesh = in_unit(with_markers(read_mesh(path).mesh), units)
    kinds = marker_kinds(mesh, patches)
    complaint = undecided(mesh, kinds)
    if complaint:
        raise InputError(complaint)
    return mesh, kinds


def mesh_of_blocks(path: str | os.PathLike, marked: MarkedGrid) -> tuple[MixedMesh, dict[str, MarkerGuess]]:
    """Mesh of the blocks of a file, and the kinds of its markers; `InputError` if none of them moves."""
    if not any(guess.kind == "wall" for guess in marked.kinds.values()):
        raise InputError(
            f"{path}: no patch is a wall, or looks like one, so that nothing moves; 'bspline-mdao inspect {path} "
            f"--draft patches.toml' writes patches to mend, for --patches patches.toml"
        )
    return marked.mesh, marked.kinds
