"""PLOT3D grids, in every dialect in circulation.

A PLOT3D grid is a header (the number of blocks, if given, and the node counts of every block) followed by the
coordinates of each block, i running fastest. Nothing in it says how it was written: of the dialects whose header makes
sense and matches exactly the length of the file (``plot3d_dialect.py``) the one that gives a smooth grid is taken.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ...errors import InputError
from ..topology.grid import Block, Grid, find_fault
from ..topology.index_space import Window
from ..topology.stored_grid import StoredBlock, StoredGrid
from .disk import COMPRESSIONS, read_bytes, replaced_file
from .fortran import format_numbers, join_records
from .plot3d_dialect import Plot3dDialect, Reading, exact_readings
from .stored_numbers import StoredBytes

_ASCII_SUFFIXES = (".fmt", ".p3dfmt", ".txt")

_CLEARLY_SMOOTHER = 0.5
"""A reading is taken if its grid is smoother than any other's by this ratio: real rivals differ by far more."""

_NODES_JUDGED = 200_000
"""Nodes of a block from which roughness is judged: enough to distinguish grids from noise, and fast."""

_SMOOTHEST = 1e-3
"""Mean change of an edge relative to its length below which cells are all equally smooth."""

_FLATTEST = 1e-6
"""Mean volume of unit edges below which cells are all equally flat."""


def read_plot3d(
    path: str | os.PathLike,  # the file
) -> Grid:  # its ``dialect`` is the `Plot3dDialect` read
    """Read a PLOT3D grid; the dialect is detected from the file."""
    # ASCII, Fortran records and raw binary, either byte order, 4- or 8-byte reals and integers, one block with or
    # without the block count or many, node counts of all blocks before the first or each before its own, 2-D or 3-D,
    # with or without IBLANK, whole or plane-wise, uncompressed or compressed with gzip, bzip2 or xz. A 2-D block has
    # one node in k and z = 0.
    data, compression, ignored = read_bytes(path)
    reading, blocks = _most_plausible(exact_readings(data, str(path)), str(path), _read_blocks)
    dialect = replace(reading.dialect, compression=compression, ignored=(*reading.dialect.ignored, *ignored))
    return Grid(blocks, source=str(path), dialect=dialect)


def open_plot3d(
    path: str | os.PathLike,  # the file
) -> StoredGrid:
    """Open a PLOT3D grid of any dialect, to read blocks of it, or windows of them, later."""
    # In raw binary and Fortran records, the rest is skipped. Text is scanned once to find its numbers. Compressed files
    # are decompressed as a whole, by every process that reads. The dialect is determined from the first blocks;
    # everything else is as in `read_plot3d`, but a block is checked when it is read.
    source, data = str(path), StoredBytes(path)
    reading, _ = _most_plausible(exact_readings(data, source), source, _leading_blocks)
    starts = reading.dialect.block_starts(reading.shapes)
    blocks = (
        StoredBlock(tuple(shape), f"block {number}", partial(_read_part, reading, source, number, int(start)))
        for number, (shape, start) in enumerate(zip(reading.shapes.tolist(), starts), 1)
    )
    dialect = replace(reading.dialect, compression=data.compression, ignored=(*reading.dialect.ignored, *data.ignored))
    return StoredGrid(tuple(blocks), source=source, dialect=dialect)


def _read_part(reading: Reading, source: str, number: int, start: int, window: Window | None) -> Block:
    """Read a window of block ``number``, from 1, whose numbers begin at byte ``start``."""
    shape = tuple(reading.shapes[number - 1].tolist())
    window = Window.whole(number - 1, shape) if window is None else window
    nodes, iblank = _read_block(reading, shape, start, window)
    block = Block(nodes, f"block {number}", iblank)
    fault = find_fault([block], number, window.lo)
    if fault:
        raise InputError(f"{source}: {fault}; read as PLOT3D ({reading.dialect}); repair it")
    return block


def _most_plausible(
    readings: list[Reading], source: str, blocks_of: Callable[[Reading], tuple[Block, ...]]
) -> tuple[Reading, tuple[Block, ...]]:
    """Choose the one reading that gives a grid, from its blocks."""
    # 1. Drop readings with nodes that are not finite or of implausible size.
    # 2. Take the one that is clearly smoother than any other.
    # 3. Otherwise decide what may be IBLANK or z, and prefer the layout ``"whole"``; refuse what is still ambiguous.
    grids = [(reading, blocks_of(reading)) for reading in readings]
    # step 1
    sane = [(reading, blocks) for reading, blocks in grids if find_fault(blocks) is None]
    if not sane:
        raise InputError(f"{source}: {find_fault(grids[0][1])}; read as PLOT3D ({grids[0][0].dialect}); repair it")
    if len(sane) == 1:
        return sane[0]
    roughness = [_roughness(blocks) for _, blocks in sane]  # step 2
    order = np.argsort(roughness, kind="stable")
    first, second = order[0], order[1]
    if roughness[first] <= _CLEARLY_SMOOTHER * roughness[second]:
        return sane[first]
    # step 3
    rivals = _by_blanking([sane[i] for i in order if roughness[i] * _CLEARLY_SMOOTHER < roughness[first]])
    if len({replace(reading.dialect, layout="whole", records="block") for reading, _ in rivals}) == 1:
        return min(rivals, key=lambda rival: rival[0].dialect.layout != "whole")
    raise InputError(
        f"{source}: can be read as PLOT3D ({rivals[0][0].dialect}) or ({rivals[1][0].dialect}); "
        "write it again with a block count"
    )


def _by_blanking(rivals: list) -> list:
    """Keep the readings in which whole numbers that are not all 0 are IBLANK rather than z; all 0 are rather z."""
    is_blanked = [any(block.iblank is not None and block.iblank.any() for block in blocks) for _, blocks in rivals]
    has_iblank = [reading.dialect.has_iblank for reading, _ in rivals]
    if any(is_blanked) or not all(has_iblank):
        return [rival for rival, b, has in zip(rivals, is_blanked, has_iblank) if b or not (has or any(is_blanked))]
    return rivals


def _read_blocks(reading: Reading) -> tuple[Block, ...]:
    """Read the blocks of one reading of a file."""
    starts = reading.dialect.block_starts(reading.shapes)
    blocks = []
    for number, (shape, start) in enumerate(zip(reading.shapes.tolist(), starts), 1):
        nodes, iblank = _read_block(reading, shape, int(start), Window.whole(number - 1, shape))
        blocks.append(Block(nodes, f"block {number}", iblank))
    return tuple(blocks)


def _leading_blocks(reading: Reading) -> tuple[Block, ...]:
    """Read only what `_roughness` needs."""
    starts, n_judged = reading.dialect.block_starts(reading.shapes), 0
    blocks = []
    for number, (shape, start) in enumerate(zip(reading.shapes.tolist(), starts), 1):
        n_planes = min(_planes_judged(shape), shape[2])
        window = Window(number - 1, (0, 0, 0), (shape[0] - 1, shape[1] - 1, n_planes - 1))
        nodes, iblank = _read_block(reading, shape, int(start), window)
        blocks.append(Block(nodes, f"block {number}", iblank))
        n_judged += nodes.size
        if n_judged > 3 * _NODES_JUDGED:
            break
    return tuple(blocks)


def _read_block(
    reading: Reading, shape: Sequence[int], start: int, window: Window
) -> tuple[np.ndarray, np.ndarray | None]:
    """Nodes and IBLANK of a window of the block whose numbers begin at byte ``start``."""
    dialect = reading.dialect
    n_plane, (low, high) = shape[0] * shape[1], (window.lo[2], window.hi[2] + 1)
    nodes = np.zeros((*window.shape, 3))
    iblank = np.empty(window.shape, np.int32) if dialect.has_iblank else None

    def planes(dtype: np.dtype, first: int, n_planes: int) -> np.ndarray:
        """Some planes of numbers from byte ``first`` on, in the order (i, j, k), within the window."""
        numbers = reading.content.take(dtype, n_plane * n_planes, first).reshape(n_planes, shape[1], shape[0])
        return numbers.transpose(2, 1, 0)[window.slices[:2]]

    for lo, hi in dialect.pieces(shape):
        first, last = max(lo, low), min(hi, high)
        if first < last:
            place, there = slice(first - low, last - low), start
            for axis in range(dialect.n_dimensions):
                values = planes(
                    dialect.real_dtype, there + (first - lo) * n_plane * dialect.real_dtype.itemsize, last - first
                )
                with np.errstate(invalid="ignore"):  # a NaN is reported later
                    nodes[:, :, place, axis] = values
                there += (hi - lo) * n_plane * dialect.real_dtype.itemsize
            if iblank is not None:
                there += (first - lo) * n_plane * dialect.integer_dtype.itemsize
                iblank[:, :, place] = _as_int32(planes(dialect.integer_dtype, there, last - first))
        start += (hi - lo) * n_plane * dialect.node_bytes
    return nodes, iblank


def _as_int32(values: np.ndarray) -> np.ndarray:
    """Whole numbers; other values become the lowest integer, which `find_fault` reports."""
    if values.dtype.kind == "i" and values.dtype.itemsize == 4:
        return values
    lowest = np.iinfo(np.int32).min
    is_integer = (np.floor(values) == values) & (np.abs(values) < -float(lowest))
    return np.where(is_integer, values, lowest).astype(np.int32)


def _roughness(blocks: Iterable[Block]) -> float:
    """Mean change of a cell edge from cell to cell, relative to the edge and to how far cells are from being flat.

    Near 0 for a grid and above 1.5 for noise; also large if x, y and z are planes of the same coordinate.
    """
    total, n_judged = 0.0, 0
    for block in blocks:
        nodes = block.nodes[:, :, : _planes_judged(block.shape)]
        n_judged += nodes.size
        bend = float(np.mean([_bend(nodes, d, e) for d in range(3) for e in range(3)]))
        total += nodes.size * (bend + _SMOOTHEST) / max(_fullness(nodes), _FLATTEST)
        if n_judged > 3 * _NODES_JUDGED:
            break
    return total / n_judged


def _planes_judged(shape: Sequence[int]) -> int:
    """Planes of constant k of a block from which roughness is judged."""
    return max(3, _NODES_JUDGED // (shape[0] * shape[1]))


def _bend(nodes: np.ndarray, d: int, e: int) -> float:
    """Mean change along direction ``e`` of the edges in direction ``d``; 0 if there are too few nodes for it."""
    edges = np.diff(nodes, axis=d)
    changes = np.diff(edges, axis=e)
    length = np.linalg.norm(edges, axis=-1).sum()
    if changes.size == 0 or length == 0.0:
        return 0.0
    return float(np.linalg.norm(changes, axis=-1).mean() * edges.size / (3.0 * length))


def _fullness(nodes: np.ndarray) -> float:
    """Mean volume of the unit edges of a cell, or their area if there is one node in a direction; 1 for lines."""
    corner = nodes[tuple(slice(0, max(n - 1, 1)) for n in nodes.shape[:3])]
    edges = [np.diff(nodes, axis=d)[tuple(map(slice, corner.shape[:3]))] for d in range(3) if nodes.shape[d] > 1]
    if len(edges) < 2:
        return 1.0
    normals = np.cross(edges[0], edges[1])
    contents = np.einsum("...c,...c", normals, edges[2]) if len(edges) == 3 else np.linalg.norm(normals, axis=-1)
    lengths = np.prod([np.linalg.norm(edge, axis=-1) for edge in edges], axis=0)
    return float(np.mean(np.abs(contents[lengths > 0.0]) / lengths[lengths > 0.0])) if lengths.any() else 0.0


def write_plot3d(
    path: str | os.PathLike,  # the file to create or replace
    grid: Grid,  # the grid. Nodes without IBLANK are written as 1 where the dialect has IBLANK.
    # format; by default that of its file (binary is then reproduced byte for byte, ASCII number for number), and raw
    # binary of 8-byte reals for a grid that was not read from PLOT3D
    dialect: Plot3dDialect | None = None,
) -> None:
    """Write a PLOT3D grid, whole or not at all."""
    if dialect is None:
        dialect = grid.dialect if isinstance(grid.dialect, Plot3dDialect) else Plot3dDialect()
    _check_fits(grid, dialect)
    with replaced_file(path) as temporary, open(temporary, "wb") as file:
        sinks = {item.name: item.sink for item in COMPRESSIONS}
        with sinks[dialect.compression](file) if dialect.compression else nullcontext(file) as sink:
            for piece in _encode(grid, dialect):
                sink.write(piece)


def _check_fits(grid: Grid, dialect: Plot3dDialect) -> None:
    """Refuse a grid that a dialect cannot store, or that has a damaged node."""
    if len(grid.blocks) != 1 and not dialect.has_block_count:
        raise InputError(
            f"{grid.source}: {len(grid.blocks)} blocks do not fit a PLOT3D file without a block count; "
            "choose another dialect"
        )
    for number, block in enumerate(grid.blocks, 1):
        if dialect.n_dimensions == 2 and (block.shape[2] != 1 or block.nodes[..., 2].any()):
            raise InputError(f"{grid.source}: block {number} has a third dimension; write it as 3-D PLOT3D")
    fault = find_fault(grid.blocks)
    if fault:
        raise InputError(f"{grid.source}: {fault}; nothing was written")


def _encode(grid: Grid, dialect: Plot3dDialect) -> Iterator[bytes]:
    """Yield the bytes of the file, piece by piece."""
    records = _records(grid, dialect)
    if dialect.encoding == "ascii":
        for record in records:
            for array in record:
                yield from format_numbers(array)
        return
    payloads: Iterator[bytes] = (b"".join(array.tobytes() for array in record) for record in records)
    if dialect.encoding == "fortran":
        payloads = join_records(payloads, dialect.byte_order, dialect.marker_bytes)
    yield from payloads


def _records(grid: Grid, dialect: Plot3dDialect) -> Iterator[list[np.ndarray]]:
    """Arrays of the file in order, the arrays of a record in one list."""
    integer = np.dtype(np.int64) if dialect.encoding == "ascii" else dialect.integer_dtype
    count = [np.array([len(grid.blocks)], integer)] * dialect.has_block_count
    rows = [np.array(shape[: dialect.n_dimensions], integer) for shape in grid.shapes]
    if dialect.header == "joined":
        yield [*count, *rows]
    else:
        yield from [count] * bool(count)
        yield from {"apart": [rows], "rows": [[row] for row in rows], "spread": []}[dialect.header]
    for block, row in zip(grid.blocks, rows):
        yield from [[row]] * (dialect.header == "spread")
        pieces = [_piece_arrays(block, lo, hi, dialect, integer) for lo, hi in dialect.pieces(block.shape)]
        if dialect.records == "array":
            yield from ([array] for piece in pieces for array in piece)
        elif dialect.records == "plane":
            yield from pieces
        else:
            yield [array for piece in pieces for array in piece]


def _piece_arrays(block: Block, lo: int, hi: int, dialect: Plot3dDialect, integer: np.dtype) -> list[np.ndarray]:
    """Coordinates and IBLANK of planes ``lo`` to ``hi``, i fastest."""
    nodes = block.nodes[:, :, lo:hi]
    arrays = [nodes[..., axis].ravel(order="F").astype(dialect.real_dtype) for axis in range(dialect.n_dimensions)]
    if dialect.has_iblank:
        iblank = np.ones(block.shape, np.int32) if block.iblank is None else block.iblank
        arrays.append(iblank[:, :, lo:hi].ravel(order="F").astype(integer))
    return arrays


def write_plot3d_as_named(
    path: str | os.PathLike,  # the file to create or replace
    grid: Grid,  # the grid
) -> None:
    """Write a PLOT3D grid in its own dialect, or else as the name says: ASCII or raw binary, compressed or not."""
    if isinstance(grid.dialect, Plot3dDialect):
        return write_plot3d(path, grid)
    name = Path(path)
    compression = next((item.name for item in COMPRESSIONS if item.suffix == name.suffix.lower()), "")
    suffix = (name.with_suffix("") if compression else name).suffix.lower()
    write_plot3d(path, grid, Plot3dDialect("ascii" if suffix in _ASCII_SUFFIXES else "raw", compression=compression))
