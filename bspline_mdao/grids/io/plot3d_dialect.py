"""Dialects of PLOT3D in circulation, and the possible dialects of a file.

Nothing in a PLOT3D grid says how it was written, so every reading is tried: its header must make sense and the file
must have exactly the length given by the header.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import math
from codecs import BOM_UTF8
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from ...base.text import counted
from ...errors import InputError
from .fortran import count_comments, is_text, parse_numbers, scan_text, split_records
from .stored_numbers import BinaryNumbers, Numbers, StoredBytes, TextNumbers

_HEADER_WORDS = {
    "apart": [],
    "joined": ["header in one record"],
    "rows": ["a record of dimensions for each block"],
    "spread": ["dimensions before each block"],
}

HEADERS = (
    (("apart", 4),),
    tuple(pair for pair in product(("apart", "joined", "rows", "spread"), (4, 8)) if pair != ("apart", 4)),
)
"""Headers and lengths of integers, common ones first: the others are tried only if none of these fits."""


@dataclass(frozen=True)
class Plot3dDialect:
    """Dialect of PLOT3D of a grid."""

    encoding: str = "raw"  # ``"ascii"``, ``"fortran"`` (unformatted records) or ``"raw"`` (binary without markers)
    byte_order: str = "<"  # ``"<"`` (little endian) or ``">"``; binary only
    real_bytes: int = 8  # length of a real, 4 or 8; binary only
    marker_bytes: int = 4  # length of a record marker, 4 or 8; Fortran records only
    # contents of a Fortran record: a whole ``"block"``, a ``"plane"`` of constant k, or an ``"array"`` (x, y, z or
    # IBLANK of a block or plane)
    records: str = "block"
    # ``"whole"``: x of all nodes of a block, then y, z and IBLANK; ``"planes"``: the same plane by plane of constant
    # k
    layout: str = "whole"
    # places of the node counts of the blocks: all of them ``"apart"`` from the number of blocks, ``"joined"`` with it
    # in one Fortran record, in ``"rows"`` of a record for each block, or ``"spread"``, each before its block
    header: str = "apart"
    integer_bytes: int = 4  # length of an integer, 4 or 8; binary only
    has_block_count: bool = True  # whether the file begins with the number of blocks; without it there is one block
    n_dimensions: int = 3  # 3, or 2 for files with only x and y
    has_iblank: bool = False  # whether an integer per node follows the coordinates
    compression: str = ""  # compression of the file: ``"gzip"``, ``"bzip2"``, ``"xz"`` or none
    ignored: tuple[str, ...] = field(default=(), compare=False)  # other content of the file, one line each

    @property
    def real_dtype(self) -> np.dtype:
        """Type of a coordinate in the bytes of a `Reading`."""
        return np.dtype(np.float64) if self.encoding == "ascii" else np.dtype(f"{self.byte_order}f{self.real_bytes}")

    @property
    def integer_dtype(self) -> np.dtype:
        """Type of a count or IBLANK in the bytes of a `Reading`; all numbers of a text are reals."""
        return np.dtype(np.float64) if self.encoding == "ascii" else np.dtype(f"{self.byte_order}i{self.integer_bytes}")

    @property
    def node_bytes(self) -> int:
        """Number of bytes per node: its coordinates, and IBLANK if there is one."""
        return self.n_dimensions * self.real_dtype.itemsize + self.has_iblank * self.integer_dtype.itemsize

    @property
    def dimension_bytes(self) -> int:
        """Number of bytes of the node counts of a block."""
        return self.n_dimensions * self.integer_dtype.itemsize

    def block_starts(self, shapes: np.ndarray) -> np.ndarray:
        """Byte at which the coordinates of each block begin, and the end of the last one, shape (n_blocks + 1,)."""
        # In float64: the product of three corrupt counts overflows an integer, and sizes below 2**53 are exact.
        sizes, n_blocks = np.prod(shapes.astype(float), axis=1) * self.node_bytes, len(shapes)
        n_counts = np.minimum(np.arange(1, n_blocks + 2), n_blocks) if self.header == "spread" else n_blocks
        count = self.has_block_count * self.integer_dtype.itemsize
        return count + np.cumsum([0.0, *sizes]) + n_counts * self.dimension_bytes

    def pieces(self, shape: Sequence[int]) -> Iterator[tuple[int, int]]:
        """Ranges of k with consecutive coordinates: the whole block or its planes one by one."""
        ends = range(1, shape[2] + 1) if self.layout == "planes" else (shape[2],)
        start = 0
        for stop in ends:
            yield start, stop
            start = stop

    def __str__(self) -> str:
        """Name the dialect in a few words."""
        names = {"ascii": "ASCII", "fortran": "Fortran records", "raw": "raw binary"}
        words = [names[self.encoding]]
        if self.encoding != "ascii":
            words += ["little endian" if self.byte_order == "<" else "big endian", f"{self.real_bytes}-byte reals"]
        words += [f"{self.n_dimensions}-D"]
        words += [f"{self.integer_bytes}-byte integers"] * (self.integer_bytes != 4) + _HEADER_WORDS[self.header]
        words += ["IBLANK"] * self.has_iblank + ["plane-wise"] * (self.layout == "planes")
        words += ["without block count"] * (not self.has_block_count) + [self.compression] * bool(self.compression)
        return ", ".join(words)


@dataclass(frozen=True)
class Reading:
    """A possible reading of a file."""

    dialect: Plot3dDialect  # its dialect
    content: Numbers  # the numbers without record markers; for ASCII all of them as reals
    shapes: np.ndarray  # (n_blocks, 3) of int, node counts of the blocks


def exact_readings(
    data: bytes | StoredBytes,  # the file, decompressed
    source: str,  # its name, for messages
) -> list[Reading]:  # at least one, layouts ``"whole"`` before ``"planes"``
    """Find every reading whose header accounts for each byte of the file."""
    containers, near = list(_containers(data, source)), []
    for headers in HEADERS:
        exact = []
        for (dialect, content, lengths), (header, size) in product(containers, headers):
            for readings in _readings(replace(dialect, header=header, integer_bytes=size), content):
                exact += [layout for r in readings if _misfit(r) == 0 for layout in _layouts(r, lengths)]
                near += readings
        if exact:
            return exact
    raise _no_reading([r for r in near if (r.dialect.header, r.dialect.integer_bytes) in HEADERS[0]], len(data), source)


def _readings(dialect: Plot3dDialect, content: Numbers) -> Iterator[list[Reading]]:
    """Readings of plain numbers whose header makes sense, with all lengths of reals, with and without IBLANK."""
    if dialect.encoding != "fortran" and dialect.header in ("joined", "rows"):
        return  # there are no records
    if dialect.encoding == "ascii" and dialect.integer_bytes != 4:
        return
    for has_count, n_dimensions in product((True, False), (3, 2)):
        headed = replace(dialect, has_block_count=has_count, n_dimensions=n_dimensions)
        if headed.header == "spread":
            found = [(full, _read_spread_header(full, content)) for full in _node_formats(headed) if has_count]
        else:
            shapes = _read_header(headed, content)
            found = [(full, shapes) for full in _node_formats(headed)]
        known = [Reading(full, content, shapes) for full, shapes in found if shapes is not None]
        if known and (
            dialect.header == "apart" or (has_count and (dialect.header == "joined" or len(known[0].shapes) > 1))
        ):
            yield known  # for one block, and without a number of blocks, the others do not differ


def _containers(data: bytes | StoredBytes, source: str) -> Iterator[tuple[Plot3dDialect, Numbers, list[int] | None]]:
    """Ways to get the plain numbers: dialect so far, content, and lengths of the records if there are any."""
    if is_text(data[:1024].removeprefix(BOM_UTF8)):  # which editors on Windows put first
        content: TextNumbers | BinaryNumbers
        if isinstance(data, StoredBytes):
            content = scanned = scan_text(data, source)
            n_comments = scanned.n_comments
        else:
            text = data.removeprefix(BOM_UTF8)
            content, n_comments = BinaryNumbers.whole(parse_numbers(text, source)), count_comments(text)
        note = f"{source}: {counted(n_comments, 'comment')} in the text, not kept when the grid is written"
        yield Plot3dDialect("ascii", ignored=(note,) * (n_comments > 0)), content, None
        return
    found = False
    for byte_order, marker_bytes in product("<>", (4, 8)):
        records = split_records(data, byte_order, marker_bytes)
        if records is not None:
            found = True
            yield Plot3dDialect("fortran", byte_order, marker_bytes=marker_bytes), *records
    if not found:
        for byte_order in "<>":
            yield Plot3dDialect("raw", byte_order), BinaryNumbers.whole(data), None


def _node_formats(dialect: Plot3dDialect) -> list[Plot3dDialect]:
    """List the dialects of a header with all lengths of reals, with and without IBLANK."""
    sizes = (8,) if dialect.encoding == "ascii" else (4, 8)
    return [replace(dialect, real_bytes=size, has_iblank=blank) for size, blank in product(sizes, (False, True))]


def _read_header(dialect: Plot3dDialect, content: Numbers) -> np.ndarray | None:
    """Node counts of the blocks, or None if they make no sense; it does not read beyond the file."""
    n_blocks = 1
    if dialect.has_block_count:
        counts = _integers(dialect, content, 0, 1)
        if counts is None:
            return None
        n_blocks = int(counts[0])
    start = int(dialect.has_block_count)
    dims = _integers(dialect, content, start, n_blocks * dialect.n_dimensions)
    if dims is None:
        return None
    shapes = np.ones((n_blocks, 3), np.int64)
    shapes[:, : dialect.n_dimensions] = dims.reshape(n_blocks, -1)
    return shapes


def _read_spread_header(dialect: Plot3dDialect, content: Numbers) -> np.ndarray | None:
    """Node counts of blocks, each before its coordinates, or None if they make no sense."""
    counts = _integers(dialect, content, 0, 1)
    least = dialect.dimension_bytes + dialect.node_bytes
    if counts is None or not 1 < int(counts[0]) <= content.nbytes // least:
        return None
    shapes, start = np.ones((int(counts[0]), 3), np.int64), dialect.integer_dtype.itemsize
    for shape in shapes:
        dims = _integers_at(dialect, content, start, dialect.n_dimensions)
        if dims is None:
            return None
        shape[: dialect.n_dimensions] = dims
        start += dialect.dimension_bytes + math.prod(shape.tolist()) * dialect.node_bytes
    return shapes


def _integers(dialect: Plot3dDialect, content: Numbers, start: int, count: int) -> np.ndarray | None:
    """Positive whole numbers from number ``start`` on, or None if they are not."""
    return _integers_at(dialect, content, start * dialect.integer_dtype.itemsize, count)


def _integers_at(dialect: Plot3dDialect, content: Numbers, start: int, count: int) -> np.ndarray | None:
    """Positive whole numbers from byte ``start`` on, or None if they are not."""
    if start + count * dialect.integer_dtype.itemsize > content.nbytes:
        return None
    values = content.take(dialect.integer_dtype, count, start)
    is_count = (values >= 1) & (values < 2**31) & (values == np.floor(values))
    return values.astype(np.int64) if is_count.all() else None


def _misfit(reading: Reading) -> float:
    """Excess bytes of the file; negative if there are too few."""
    return reading.content.nbytes - float(reading.dialect.block_starts(reading.shapes)[-1])


def _layouts(reading: Reading, lengths: list[int] | None) -> Iterator[Reading]:
    """Yield the possible orders of the numbers in an exact reading, as far as its records allow them."""
    deepest = int(reading.shapes[:, 2].max())
    for layout in ("whole", "planes") if deepest > 1 else ("whole",):
        for records in ("block", "plane", "array") if lengths is not None else ("block",):
            dialect = replace(reading.dialect, layout=layout, records=records)
            if layout == "whole" and records == "plane":
                continue
            if lengths is None or lengths == list(record_lengths(dialect, reading.shapes)):
                yield replace(reading, dialect=dialect)
                break


def header_lengths(dialect: Plot3dDialect, n_blocks: int) -> Iterator[int]:
    """Length in bytes of every Fortran record before the first block."""
    count, dims = dialect.has_block_count * dialect.integer_dtype.itemsize, dialect.dimension_bytes
    of_header = {"apart": [count, n_blocks * dims], "joined": [count + n_blocks * dims]}
    of_header |= {"rows": [count, *[dims] * n_blocks], "spread": [count]}
    yield from (length for length in of_header[dialect.header] if length)


def record_lengths(dialect: Plot3dDialect, shapes: np.ndarray) -> Iterator[int]:
    """Length in bytes of every Fortran record of a grid of these shapes."""
    yield from header_lengths(dialect, len(shapes))
    for shape in np.asarray(shapes).tolist():
        if dialect.header == "spread":
            yield dialect.dimension_bytes
        n_plane = shape[0] * shape[1]
        if dialect.records == "block":
            yield n_plane * shape[2] * dialect.node_bytes
            continue
        for start, stop in dialect.pieces(shape):
            n_nodes = n_plane * (stop - start)
            if dialect.records == "plane":
                yield n_nodes * dialect.node_bytes
            else:
                yield from [n_nodes * dialect.real_dtype.itemsize] * dialect.n_dimensions
                yield from [n_nodes * dialect.integer_dtype.itemsize] * dialect.has_iblank


def _no_reading(near: list[Reading], n_bytes: int, source: str) -> InputError:
    """Describe the header that comes closest."""
    if n_bytes == 0:
        return InputError(f"{source}: is empty; give a PLOT3D grid")
    best = min(near, key=_distance, default=None)
    if best is None or _distance(best) > np.log(1000.0):
        return InputError(f"{source}: is not a PLOT3D grid in any known dialect: no header fits its {n_bytes} bytes")
    size = best.dialect.real_dtype.itemsize if best.dialect.encoding == "ascii" else 1
    unit = "numbers" if best.dialect.encoding == "ascii" else "bytes"
    n_present = best.content.nbytes // size
    announced = n_present - int(_misfit(best) / size)
    if announced == n_present:
        return InputError(f"{source}: the Fortran records are cut in no known way; write one record per block")
    listed = "(" + ", ".join(str(n) for n in best.shapes[0].tolist()) + ")"
    what = "truncated" if announced > n_present else "too long"
    return InputError(
        f"{source}: {what}: read as PLOT3D ({best.dialect}), {len(best.shapes)} block(s) beginning with {listed} need "
        f"{announced} {unit}, but it holds {n_present}; transfer or write it again"
    )


def _distance(reading: Reading) -> float:
    """Measure how far a header is from the file's length; unlikely formats count a little more."""
    n_bytes = reading.content.nbytes
    ratio = abs(np.log((n_bytes - _misfit(reading)) / n_bytes))
    return ratio + 0.1 * (not reading.dialect.has_block_count) + 0.05 * reading.dialect.has_iblank
