"""Files without a structured grid: what they are, and what can be done with them.

PLOT3D has no signature, so files of no other format are taken for it. Files that are known to be something else are
named here instead.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from ...errors import InputError
from .disk import read_raw
from .formats import POLYMESH, read_names

__all__ = ["head_of_grid"]

_MESH = "is {} mesh, without structured blocks; {}; 'bspline-mdao ride MODEL.h5 {}' moves it with the model of one"
_NOT_READ = "is a {} file, which is not read here; {}"
_LEGACY = f"{_NOT_READ}, or save an unstructured mesh as .vtu, .msh or .su2"

_OTHERS = (
    (rb"\$MeshFormat", _MESH, "a Gmsh"),
    (rb"(?:[ \t\r]*(?:%.*)?\n)*[ \t]*(?:NDIME|NZONE)\s*=", _MESH, "an SU2"),
    (rb"(?:<\?xml.*\?>)?\s*(?:<!--.*-->\s*)?<VTKFile[^>]*UnstructuredGrid", _MESH, "a VTK"),
    (rb"(?:<\?xml.*\?>)?\s*(?:<!--.*-->\s*)?<VTKFile", _NOT_READ, "ParaView"),
    (rb"# vtk DataFile", _LEGACY, "legacy VTK"),
    (rb"\s*(?:TITLE|VARIABLES|FILETYPE)\s*=|#!TDV", _NOT_READ, "Tecplot"),
    (rb"ISO-10303-21", "is a CAD file ({}), of surfaces without a grid; {}", "STEP"),
    (rb"SQLite format 3", "is {} of an optimisation; {}; 'bspline-mdao report {}' shows it", "a case file"),
)
"""Beginnings of files, the message about them, and the name in it."""


def head_of_grid(
    path: str | os.PathLike,  # the file
    n_bytes: int,  # their number
) -> bytes:
    """Read the first bytes of a file that may contain a structured grid."""
    advice = f"give a {read_names()} grid"
    if Path(path).name == POLYMESH and Path(path).is_dir():
        raise InputError(f"{path}: {_MESH.format('an OpenFOAM', advice, path)}")
    head = read_raw(path, n_bytes)
    for beginning, text, name in _OTHERS:
        if re.match(beginning, head, re.IGNORECASE):
            raise InputError(f"{path}: {text.format(name, advice, path)}")
    return head
