"""Files of meshes by the names of their formats.

To add a format, write its module next to the others and add a line to `FORMATS`. The table imports none of them: the
help of the command line shows it.
"""

from __future__ import annotations

import os
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Protocol

from ....errors import InputError
from ..formats import POLYMESH

if TYPE_CHECKING:
    import numpy as np

    from ...cells.mixed_cells import MixedMesh
    from .layer_of_cells import SectionSpan

__all__ = ["FORMATS", "MeshFile", "check_same_format", "is_mesh", "mesh_names", "read_mesh"]

FORMATS = {
    ".su2": "bspline_mdao.grids.io.meshes.su2.read_su2",
    ".cgns": "bspline_mdao.grids.io.meshes.cgns.read_cgns_mesh",
    ".msh": "bspline_mdao.grids.io.meshes.gmsh.read_msh",
    ".vtu": "bspline_mdao.grids.io.meshes.vtu.read_vtu",
    POLYMESH: "bspline_mdao.grids.io.meshes.polymesh.read_polymesh",
}
"""Reader of the files of each suffix, and of OpenFOAM's folder."""

IN_PLANES = (".su2", ".cgns", ".msh", ".vtu")
"""Formats that may be two-dimensional, whose readers accept the two planes of a layer of cells as well."""


class MeshFile(Protocol):
    """A mesh and its file."""

    @property
    def mesh(self) -> MixedMesh:
        """The mesh."""

    def write(self, path: str | os.PathLike, points: np.ndarray) -> None:
        """Write the file with new nodes, shape (n, 3), whole or not at all; all else in it stays."""


def mesh_names() -> str:
    """Name the suffixes of meshes, such as ``.su2 or .cgns or a folder polyMesh``."""
    names = (f"a folder {name}" if name == POLYMESH else name for name in FORMATS)
    return " or ".join(names)


def read_mesh(path: str | os.PathLike, span: SectionSpan | None = None) -> MeshFile:
    r"""Read a mesh that is not fitted.

    Parameters
    ----------
    path : path-like
        The file, whose suffix gives the format, or OpenFOAM's folder ``polyMesh``.
    span : SectionSpan, optional
        The two planes of a two-dimensional mesh (SU2, CGNS, Gmsh or VTK), which becomes one layer of cells between
        them: its first nodes are the file's, and the others are copies of these. `section_span` finds the planes of a
        fitted section. By default the first is the plane of the file, z = 0 for nodes with two coordinates, and the
        other is one unit of length above it.

    Returns
    -------
    MeshFile
        With the ``mesh``, and ``write(path, points)``, which writes the file with new nodes.

    Raises
    ------
    InputError
        If no format has the suffix, or the file cannot be used.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from bspline_mdao.files import read_mesh
    >>> nodes = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "cell.su2")
    ...     _ = path.write_text(f"NDIME= 3\nNELEM= 1\n10 0 1 2 3\nNPOIN= 4\n{nodes}NMARK= 0\n")
    ...     file = read_mesh(path)
    ...     file.write(path, file.mesh.points * [1.0, 1.0, 2.0])
    ...     print(path.read_text().splitlines()[7])
    0.0 0.0 2.0
    """
    suffix = _suffix(path)
    read = resolve_name(FORMATS[suffix])
    return read(path, span) if suffix in IN_PLANES else read(path)


def is_mesh(path: str | os.PathLike) -> bool:
    """Whether a path is an unstructured mesh: CGNS by the content of the file, others by name."""
    suffix = POLYMESH if Path(path).name == POLYMESH else Path(path).suffix.lower()
    if suffix != ".cgns":
        return suffix in FORMATS
    return resolve_name("bspline_mdao.grids.io.meshes.cgns.is_unstructured")(path)


def check_same_format(path: str | os.PathLike, output: str | os.PathLike) -> None:
    """Refuse to write a mesh in another format than its own."""
    if _suffix(path) != _suffix(output):
        raise InputError(f"{output}: the mesh is written as it is read, as {_suffix(path)}; name it so")


def _suffix(path: str | os.PathLike) -> str:
    suffix = POLYMESH if Path(path).name == POLYMESH else Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{path}: is no unstructured mesh; give {mesh_names()}")
    return suffix
