"""Points of VTK's unstructured grids: found in the file, and replaced.

Numbers in ASCII are replaced in their places. Others, encoded or appended behind the grid, are written where the array
is declared, encoded and compressed as the file says; appended ones leave their bytes behind unused, so that the places
of all other arrays stay.

Format: the VTK file formats, section "XML file formats".
"""

from __future__ import annotations

import base64
import re
import zlib
from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from .text_numbers import TextPoints

__all__ = ["find_vtu_points"]

ZLIB = "vtkZLibDataCompressor"
BLOCK = 2**15
"""Bytes that are compressed at once, as VTK does by default."""

_ARRAY = re.compile(rb"<Points[^>]*>\s*(<DataArray\b[^>]*?(/?)>)(.*?)(?:</DataArray>\s*)?</Points>", re.S)
_ATTRIBUTE = re.compile(r"([\w:]+)\s*=\s*\"([^\"]*)\"")


@dataclass(frozen=True, eq=False)
class _EncodedPoints:
    """Points that are encoded.

    Parameters
    ----------
    data : bytes
        The whole file.
    values : ndarray, shape (n, 3)
        The points.
    span : tuple of int
        First byte of the array and the one behind it.
    attributes : dict of str
        Those of the array.
    header : str
        Type of the sizes before the numbers.
    is_compressed : bool
        Whether they are compressed.
    """

    data: bytes
    values: np.ndarray
    span: tuple[int, int]
    attributes: dict[str, str]
    header: str
    is_compressed: bool

    def replaced(self, values: np.ndarray) -> bytes:
        """Return the file with other points, shape (n, 3), at their precision in the file."""
        kind = "<f4" if self.attributes["type"] == "Float32" else "<f8"
        if (values.astype(kind) == self.values.astype(kind)).all():
            return self.data
        kept = {name: value for name, value in self.attributes.items() if name not in ("format", "offset")}
        for name, value in kept.items():
            if name in ("RangeMin", "RangeMax"):
                lengths = np.linalg.norm(values, axis=1)
                kept[name] = (
                    repr(float(lengths.min() if name == "RangeMin" else lengths.max())) if len(values) else value
                )
        words = " ".join(f'{name}="{value}"' for name, value in kept.items())
        text = _encoded(values.astype(kind).tobytes(), self.header, self.is_compressed)
        array = f'<DataArray {words} format="binary">'.encode() + text + b"</DataArray>"
        return self.data[: self.span[0]] + array + self.data[self.span[1] :]


def find_vtu_points(data: bytes, values: np.ndarray, source: str) -> TextPoints | _EncodedPoints:
    """Find the points of a file.

    Parameters
    ----------
    data : bytes
        The file.
    values : ndarray, shape (n, 3)
        The points, as a reader gives them.
    source : str
        Its name, for messages.

    Raises
    ------
    InputError
        If the file has several pieces, another byte order or another compression.
    """
    found = _ARRAY.search(data)
    head = dict(_ATTRIBUTE.findall(data[: data.find(b"<UnstructuredGrid")].decode(errors="replace")))
    if not found or len(re.findall(rb"<Piece\b", data)) != 1:
        raise InputError(f"{source}: is no unstructured grid of one piece; merge its pieces")
    attributes = dict(_ATTRIBUTE.findall(found[1].decode(errors="replace")))
    if attributes.get("format") == "ascii":
        return TextPoints.of_words(data, found.start(3), found.end(3), 3, source)
    compressor = head.get("compressor", ZLIB)
    if head.get("byte_order", "LittleEndian") != "LittleEndian" or compressor != ZLIB:
        raise InputError(f"{source}: is in {head.get('byte_order')} and {compressor}; save it with zlib or in ASCII")
    end = data.index(b">", found.start(1)) + 1 if found[2] else data.index(b"</DataArray>", found.start(1)) + 12
    sizes = head.get("header_type", "UInt32")
    return _EncodedPoints(data, values.astype(float), (found.start(1), end), attributes, sizes, "compressor" in head)


def _encoded(raw: bytes, header: str, is_compressed: bool) -> bytes:
    """Sizes and numbers in base 64."""
    kind = "<u8" if header == "UInt64" else "<u4"
    if not is_compressed:
        return base64.b64encode(np.array([len(raw)], kind).tobytes() + raw)
    blocks = [zlib.compress(raw[at : at + BLOCK]) for at in range(0, len(raw), BLOCK)]
    sizes = [len(blocks), BLOCK, len(raw) % BLOCK, *map(len, blocks)]
    return base64.b64encode(np.array(sizes, kind).tobytes()) + base64.b64encode(b"".join(blocks))
