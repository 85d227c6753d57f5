"""Neutral map files (NMF): boundary conditions and block connections of a structured grid.

After the number of blocks and a line ``number ni nj nk`` for each, every line describes a rectangle of a face::

    type   B1 F1  S1 E1  S2 E2  [B2 F2  S1 E1  S2 E2  swap]

Faces are numbered kmin, kmax, imin, imax, jmin, jmax = 1 ... 6. S1 E1 and S2 E2 are node ranges (from 1) in the
directions that follow the normal in cyclic order: i, j on a k face, j, k on an i face and k, i on a j face.
"""

from __future__ import annotations

import re

import numpy as np

from ..errors import InputError
from ..topology.grid import Grid, Patch
from ..topology.index_space import Window
from .patch_guess import kind_of_name

__all__ = ["is_nmf", "parse_nmf"]

_FACE_DIRECTIONS = {1: (2, 0), 2: (2, 1), 3: (0, 0), 4: (0, 1), 5: (1, 0), 6: (1, 1)}
"""Normal direction and side of NMF faces 1 to 6."""

_CONNECTIONS = ("one-to-one", "one_to_one", "1-to-1")

COINCIDENCE = 1e-2
"""Two sides of a declared connection may differ by this part of the shortest edge on them."""


def is_nmf(text: str) -> bool:
    """Whether a text begins as a neutral map file does: a line with one number, the number of blocks."""
    first = next(_lines(text), (0, ""))[1]
    return re.fullmatch(r"\d{1,9}", first) is not None


def _lines(text: str):
    """Yield number and content of the lines that hold something, without comments and backslashes at the end."""
    for number, line in enumerate(text.splitlines(), 1):
        content = line.split("#")[0].rstrip().rstrip("\\").strip()
        if content:
            yield number, content


def parse_nmf(text: str, grid: Grid, source: str) -> tuple[Patch, ...]:
    """Read a neutral map file that belongs to a grid.

    Lines of the same type make one patch named after it, with the kind that the word begins with (symmetry, wall,
    far field) or else ``other``. ONE-TO-ONE lines are checked against the nodes and otherwise left to the topology,
    which finds them again, as it does connections that the file gives a name of their own.

    Parameters
    ----------
    text : str
        Content of the file.
    grid : Grid
        The grid.
    source : str
        Name of the file, for messages.

    Returns
    -------
    tuple of Patch
        The patches in order of appearance.

    Raises
    ------
    InputError
        When the file does not describe this grid, or a connection joins faces that do not coincide.
    """
    lines = list(_lines(text))
    n_blocks = _check_blocks(lines, grid, source)
    windows = {}
    for number, line in lines[1 + n_blocks :]:
        name, fields = _split_entry(line, f"{source}: line {number}")
        where = f"{source}: line {number} ('{name}')"
        window, first = _parse_rectangle(fields[:6], grid, where)
        if name.lower() in _CONNECTIONS:
            _check_connection(first, fields[6:], grid, where)
        else:
            windows.setdefault(name, []).append(window)
    return tuple(Patch(name, kind_of_name(name), tuple(found)) for name, found in windows.items())


def _check_blocks(lines: list[tuple[int, str]], grid: Grid, source: str) -> int:
    n_blocks = int(lines[0][1])
    if n_blocks != len(grid.blocks):
        raise InputError(
            f"{source}: describes {n_blocks} blocks, the grid has {len(grid.blocks)}; give the map of this grid"
        )
    for index, block in enumerate(grid.blocks):
        number, line = lines[1 + index] if 1 + index < len(lines) else (0, "")
        if line.split() != [str(n) for n in (index + 1, *block.shape)]:
            raise InputError(
                f"{source}: line {number}: '{line[:40]}' is not 'block ni nj nk' = {index + 1} {block.shape}"
            )
    return n_blocks


def _split_entry(line: str, where: str) -> tuple[str, list[str]]:
    match = re.match(r"""('[^']*'|"[^"]*"|[^\s'"]+)\s+(.*)""", line)
    name, fields = (match[1].strip("'\" "), match[2].split()) if match else ("", [])
    numbers = fields[:12] if len(fields) > 6 else fields
    if not name or len(fields) not in (6, 12, 13) or not all(re.fullmatch(r"\d{1,9}", field) for field in numbers):
        raise InputError(f"{where}: '{line[:60]}' is not 'type B1 F1 S1 E1 S2 E2' with whole numbers")
    return name, fields


def _parse_rectangle(fields: list[str], grid: Grid, where: str) -> tuple[Window, np.ndarray]:
    """Window of six numbers and its nodes, shape (n1, n2, 3), in the order of the ranges."""
    block, face, *ends = (int(field) for field in fields)
    if not 1 <= block <= len(grid.blocks) or face not in _FACE_DIRECTIONS:
        raise InputError(
            f"{where}: there is no face {face} of block {block}; blocks count to {len(grid.blocks)}, faces to 6"
        )
    shape = grid.shapes[block - 1]
    normal, side = _FACE_DIRECTIONS[face]
    lo, hi = [0, 0, 0], [0, 0, 0]
    lo[normal] = hi[normal] = (shape[normal] - 1) * side
    index = [lo[normal]] * 3
    for first, last, d in zip(ends[::2], ends[1::2], ((normal + 1) % 3, (normal + 2) % 3)):
        if not (1 <= first <= shape[d] and 1 <= last <= shape[d]) or (first == last and shape[d] > 1):
            raise InputError(f"{where}: {first} to {last} is no range of {'ijk'[d]} of block {block}, 1 to {shape[d]}")
        lo[d], hi[d] = min(first, last) - 1, max(first, last) - 1
        step = 1 if last >= first else -1
        index[d] = np.arange(first - 1, last - 1 + step, step)
    window = Window(block - 1, tuple(lo), tuple(hi))
    index[(normal + 1) % 3] = index[(normal + 1) % 3][:, None]
    return window, grid.blocks[block - 1].nodes[tuple(index)]


def _check_connection(nodes: np.ndarray, fields: list[str], grid: Grid, where: str) -> None:
    if len(fields) < 6:
        raise InputError(f"{where}: names one side of a connection; add B2 F2 S1 E1 S2 E2 and swap")
    other = _parse_rectangle(fields[:6], grid, where)[1]
    swap = fields[6].strip("'\".").upper() if len(fields) > 6 else "FALSE"
    if swap not in ("TRUE", "FALSE", "T", "F"):
        raise InputError(f"{where}: swap is '{fields[6][:20]}'; write TRUE or FALSE")
    other = other.swapaxes(0, 1) if swap.startswith("T") else other
    if nodes.shape != other.shape:
        raise InputError(f"{where}: joins {nodes.shape[:2]} nodes to {other.shape[:2]}; mend the ranges or swap")
    gap = np.linalg.norm(nodes - other, axis=-1).max()
    if gap > COINCIDENCE * _shortest_edge(nodes):
        raise InputError(
            f"{where}: the two sides are up to {gap:.3g} apart; take the line out if it is periodic, or mend it"
        )


def _shortest_edge(nodes: np.ndarray) -> float:
    edges = np.concatenate([np.linalg.norm(np.diff(nodes, axis=d), axis=-1).ravel() for d in (0, 1)])
    return float(edges[edges > 0.0].min(initial=np.inf))
