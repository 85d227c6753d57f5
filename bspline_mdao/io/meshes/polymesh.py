"""OpenFOAM's ``polyMesh``: points, faces, owner, neighbour and boundary, in ASCII; written with other points.

Format: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...cells.mixed_cells import MixedMesh
from ...errors import InputError
from ...shown import OneLine
from ..disk import read_raw, replaced_folder
from .text_numbers import TextPoints

__all__ = ["PolyMeshFolder", "read_polymesh"]

_HEAD = re.compile(rb"\A.*?FoamFile\s*\{(.*?)\}", re.S)
_LIST = re.compile(rb"(\d+)\s*\(")
_COMMENTS = re.compile(rb"/\*.*?\*/|//[^\n]*", re.S)
_PATCH = re.compile(r"([^\s{}();]+)\s*\{([^{}]*)\}")


@dataclass(frozen=True, eq=False)
class PolyMeshFolder(OneLine):
    """A ``polyMesh`` and its folder.

    Parameters
    ----------
    mesh : MixedMesh
        The mesh.
    folder : str
        The folder.
    text : TextPoints
        The file ``points``, with the places of the coordinates.
    """

    mesh: MixedMesh
    folder: str
    text: TextPoints

    def write(self, path: str | os.PathLike, points: np.ndarray) -> None:
        """Write the folder with other nodes, shape (n, 3); all else in it is copied."""
        with replaced_folder(path) as new:
            for file in sorted(Path(self.folder).iterdir()):
                if file.is_file() and file.name != "points":
                    shutil.copyfile(file, new / file.name)
            (new / "points").write_bytes(self.text.replaced(points))


def read_polymesh(path: str | os.PathLike) -> PolyMeshFolder:
    """Read a ``polyMesh`` in ASCII.

    Parameters
    ----------
    path : path-like
        The folder.

    Returns
    -------
    PolyMeshFolder

    Raises
    ------
    InputError
        If a file is missing, binary, compressed or damaged.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise InputError(f"{path}: is no folder; give the folder polyMesh of a case")
    texts = {name: _text(folder, name) for name in ("points", "faces", "owner", "neighbour", "boundary")}
    where = f"{folder / 'points'}"
    n_points, start = _list(texts["points"], where)
    points = _points(texts["points"], n_points, start, where)
    corners, sizes = _faces(texts["faces"], f"{folder / 'faces'}")
    owner, neighbour = (_labels(texts[name], f"{folder / name}") for name in ("owner", "neighbour"))
    if len(owner) != len(sizes) or len(neighbour) > len(owner):
        raise InputError(f"{path}: has {len(sizes):,} faces and {len(owner):,} owners; write it again")
    if corners.size and not 0 <= corners.min() <= corners.max() < n_points:
        raise InputError(f"{folder / 'faces'}: has point {corners.max()} of {n_points:,}, from 0; write it again")
    quads, face = _fans(corners, sizes)
    is_inner = face < len(neighbour)
    of_cells = np.concatenate([owner[face], neighbour[face[is_inner]]])
    seen = np.concatenate([quads, quads[is_inner][:, ::-1]])
    markers = {}
    for name, first, n in _patches(texts["boundary"], f"{folder / 'boundary'}", len(sizes)):
        markers[name] = quads[(face >= first) & (face < first + n)]
    return PolyMeshFolder(MixedMesh(points.values, {}, markers, (seen, of_cells), str(path)), str(folder), points)


def _text(folder: Path, name: str) -> bytes:
    """Read a file of the folder, in ASCII."""
    if not (folder / name).is_file() and (folder / f"{name}.gz").is_file():
        raise InputError(f"{folder / name}.gz: is compressed; decompress it with gunzip")
    text = read_raw(folder / name)
    head = _HEAD.match(text)
    if head and re.search(rb"format\s+binary", head[1]):
        raise InputError(f"{folder / name}: is binary; write it in ASCII with foamFormatConvert (writeFormat ascii)")
    return text


def _list(text: bytes, what: str) -> tuple[int, int]:
    """Length of the list of a file, and the byte behind its opening bracket."""
    head = _HEAD.match(text)
    found = _LIST.search(text, head.end() if head else 0)
    if not found:
        raise InputError(f"{what}: holds no list; write it again")
    return int(found[1]), found.end()


def _points(text: bytes, n: int, start: int, what: str) -> TextPoints:
    """Points of the list, each on a line of its own."""
    points = TextPoints.of(text, start, text.rindex(b")"), 3, 0, what)
    if len(points.values) != n:
        raise InputError(f"{what}: announces {n:,} points and holds {len(points.values):,}, one a line; write it again")
    return points


def _labels(text: bytes, what: str) -> np.ndarray:
    """Whole numbers of a list."""
    n, start = _list(text, what)
    try:
        values = np.array(_COMMENTS.sub(b"", text[start:]).partition(b")")[0].split(), dtype=np.int64)
    except ValueError as error:
        raise InputError(f"{what}: is no list of whole numbers ({error}); write it again") from error
    if len(values) != n:
        raise InputError(f"{what}: announces {n:,} numbers and holds {len(values):,}; write it again")
    return values


def _faces(text: bytes, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Corners of all faces one after the other, and how many each has."""
    n, start = _list(text, what)
    body = _COMMENTS.sub(b"", text[start:])
    try:
        numbers = np.array(body.translate(_BRACKETS).split(), dtype=np.int64)
    except ValueError as error:
        raise InputError(f"{what}: is no list of faces ({error}); write it again") from error
    sizes = np.array(re.findall(rb"(\d+)\s*\(", body), dtype=np.int64)
    if len(sizes) != n or len(numbers) != n + sizes.sum():
        raise InputError(f"{what}: announces {n:,} faces and holds {len(sizes):,}; write it again")
    is_corner = np.ones(len(numbers), dtype=bool)
    is_corner[np.cumsum(sizes + 1) - sizes - 1] = False
    return numbers[is_corner], sizes


_BRACKETS = bytes.maketrans(b"()", b"  ")


def _fans(corners: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Faces as quads and triangles, shape (n, 4), and the face that each is of."""
    starts, counts = np.cumsum(sizes) - sizes, np.where(sizes > 4, sizes - 2, 1)
    face = np.repeat(np.arange(len(sizes)), counts)
    piece = np.arange(len(face)) - np.repeat(np.cumsum(counts) - counts, counts)
    last = np.where(sizes[face] == 4, 3, piece + 2)
    places = np.stack([0 * piece, piece + 1, piece + 2, last], axis=1)
    return corners[starts[face][:, None] + places], face


def _patches(text: bytes, what: str, n_faces: int) -> list[tuple[str, int, int]]:
    """Name, first face and number of faces of every patch."""
    _, start = _list(text, what)
    found = []
    for match in _PATCH.finditer(_COMMENTS.sub(b"", text[start:]).decode(errors="replace")):
        sizes = [re.search(rf"\b{key}\s+(\d+)\s*;", match[2]) for key in ("startFace", "nFaces")]
        if None in sizes or sum(int(size[1]) for size in sizes if size) > n_faces:
            raise InputError(f"{what}: patch '{match[1]}' has no faces of the mesh; write it again")
        first, n = (int(size[1]) for size in sizes if size)
        found.append((match[1], first, n))
    return found
