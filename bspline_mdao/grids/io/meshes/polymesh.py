"""OpenFOAM's ``polyMesh``: points, faces, owner, neighbour and boundary; written with new points.

Format: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import gzip
import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ....base.display import OneLine
from ....errors import InputError
from ...cells.mixed_cells import MixedMesh, fans
from ..disk import replaced_folder
from .foam_lists import FoamFile
from .stored_mesh import StoredPoints

__all__ = ["PolyMeshFolder", "patches_of", "read_polymesh"]

LEVEL = 6
"""Compression level: zlib's default, as in OpenFOAM."""

_PATCH = re.compile(r"([^\s{}();]+)\s*\{([^{}]*)\}")


@dataclass(frozen=True, eq=False)
class PolyMeshFolder(OneLine):
    """A ``polyMesh`` and its folder."""

    mesh: MixedMesh  # the mesh
    file: FoamFile  # its file ``points``
    stored: StoredPoints  # this file, with the places of the coordinates

    def write(self, path: str | os.PathLike, points: np.ndarray) -> None:
        """Write the folder with new nodes, shape (n, 3), in the format of its file; all else in it is copied."""
        target, data = self.file.path, self.stored.replaced(self.mesh.as_nodes(points))
        stays, twin = data == self.file.data, {"points": "points.gz", "points.gz": "points"}[target.name]
        if (Path(path) / twin).is_file():
            raise InputError(f"{Path(path) / twin}: is there beside what would be {target.name}; remove it")
        with replaced_folder(path) as new:
            for file in sorted(target.parent.rglob("*")):
                if file.is_file() and file != target.with_name(twin) and (stays or file != target):
                    copy = new / file.relative_to(target.parent)
                    copy.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(file, copy)
            if not stays:
                (new / target.name).write_bytes(
                    gzip.compress(data, LEVEL, mtime=0) if self.file.is_compressed else data
                )


def read_polymesh(
    path: str | os.PathLike,  # the folder
) -> PolyMeshFolder:
    """Read a ``polyMesh``."""
    folder = Path(path)
    if not folder.is_dir():
        raise InputError(f"{path}: is no folder; give the folder polyMesh of a case")
    files = {name: FoamFile.read(folder, name) for name in ("points", "faces", "owner", "neighbour", "boundary")}
    stored = files["points"].points()
    points, (corners, sizes) = stored.values, files["faces"].faces()
    owner, neighbour = files["owner"].labels(), files["neighbour"].labels()
    neighbour = neighbour[: len(np.trim_zeros(neighbour + 1, "b"))]  # older meshes list -1 for boundary faces
    if len(owner) != len(sizes) or len(neighbour) > len(owner):
        raise InputError(f"{path}: has {len(sizes):,} faces and {len(owner):,} owners; write it again")
    if (sizes < 3).any():
        raise InputError(
            f"{files['faces'].path}: face {int(np.argmin(sizes))} has {sizes.min()} corners; write it again"
        )
    quads, face = fans(corners, sizes)
    is_inner = face < len(neighbour)
    of_cells = np.concatenate([owner[face], neighbour[face[is_inner]]])
    seen = np.concatenate([quads, quads[is_inner][:, ::-1]])
    markers, stated = {}, {}
    for name, kind, first, n in patches_of(files["boundary"], len(sizes)):
        markers[name] = quads[(face >= first) & (face < first + n)]
        stated[name] = kind
    polygons = np.concatenate([face, face[is_inner]])
    mesh = MixedMesh(points, {}, markers, (seen, of_cells), str(path), stated=stated, polygons=polygons)
    return PolyMeshFolder(mesh, files["points"], stored)


def patches_of(file: FoamFile, n_faces: int) -> list[tuple[str, str, int, int]]:
    """Name, type, first face and number of faces of every patch; the type is empty if it has none."""
    text, n_patches = file.dictionaries()
    found: list[tuple[str, str, int, int]] = []
    for match in _PATCH.finditer(text):
        sizes = [re.search(rf"\b{key}\s+(\d+)\s*;", match[2]) for key in ("startFace", "nFaces")]
        if None in sizes or sum(int(size[1]) for size in sizes if size) > n_faces:
            raise InputError(f"{file.path}: patch '{match[1]}' has no faces of the mesh; write it again")
        first, n = (int(size[1]) for size in sizes if size)
        kind = re.search(r"\btype\s+([^\s;]+)\s*;", match[2])
        found.append((match[1], kind[1] if kind else "", first, n))
    names = {name for name, *_ in found}
    if _PATCH.sub("", text).split() != [")"]:
        raise InputError(f"{file.path}: has other text besides its patches; write it again")
    announced = len(found) if n_patches is None else n_patches
    if not len(names) == len(found) == announced:
        raise InputError(f"{file.path}: announces {announced:,} patches and holds {len(names):,}; write it again")
    return found
