"""Patches declared in a file of their own, in TOML or a neutral map file, and merged with the grid file's.

A patches file in TOML names pieces of the boundary::

    [[patch]]
    name = "wing"
    kind = "wall"                                                  # wall, symmetry, farfield, overset or other
    faces = [
        { block = 3, face = "kmin" },                              # number from 1, or name, of the block
        { block = "tip", face = "jmax", i = [1, 13], k = [5, 17] },  # part of a face, nodes counted from 1
    ]

    [kinds]                                                        # what patches from elsewhere are, by name
    "symm*" = "symmetry"
    "B*" = "interface"                                             # no patch: left to the topology

``include = "grid.nmf"`` adds the patches of a neutral map file, whose names seldom say what they are. In such a file,
after the number of blocks and a line ``number ni nj nk`` for each, every line describes a rectangle of a face::

    type   B1 F1  S1 E1  S2 E2  [B2 F2  S1 E1  S2 E2]  [swap]

Blocks may all be numbered 1: then the order gives the number. A swap, TRUE or FALSE, has no meaning for one side only.
Faces are numbered kmin, kmax, imin, imax, jmin, jmax = 1 ... 6. S1 E1 and S2 E2 are node ranges (from 1) in the
directions that follow the normal in cyclic order: i, j on a k face, j, k on an i face and k, i on a j face.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from itertools import combinations
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ...base.toml import parse_toml
from ...errors import InputError
from ..topology.grid import PATCH_KINDS, Grid, Patch
from ..topology.index_space import FACE_NAMES, Window
from ..topology.stored_grid import StoredGrid
from .patch_guess import kind_of_name

INTERFACE = "interface"
"""Value in ``[kinds]``: such a patch is dropped, and the topology finds what it meets."""

AnyGrid = TypeVar("AnyGrid", Grid, StoredGrid)

MAX_BYTES = 2**22
"""Largest size of a patches file."""

_DIRECTIONS = "ijk"


def read_patches(path: str | os.PathLike, grid: AnyGrid) -> AnyGrid:
    """Add the patches of a TOML or NMF file to a grid.

    Parameters
    ----------
    path : path-like
        The patches file; its format is found from its content.
    grid : Grid or StoredGrid
        The grid, possibly with its own patches. A patch of the same name is replaced.

    Returns
    -------
    Grid
        The grid with the patches of both.

    Raises
    ------
    InputError
        If the file cannot be read, a key or face is misspelt, an index is outside its block, or two patches claim the
        same part of a face.

    Examples
    --------
    >>> import tempfile
    >>> from dataclasses import replace
    >>> from pathlib import Path
    >>> from bspline_mdao.files import read_patches
    >>> from bspline_mdao.generators import brick_grid
    >>> bare = replace(brick_grid((5, 5, 5, 5)), patches=())
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "patches.toml"
    ...     _ = file.write_text('patch = [{name = "top", kind = "farfield", faces = [{block = 1, face = "kmax"}]}]')
    ...     grid = read_patches(file, bare)
    >>> [patch.name for patch in grid.patches]
    ['top']
    """
    text = read_patches_text(path)
    if is_nmf(text):
        return merge_patches(grid, parse_nmf(text, grid, str(path)), str(path))
    return _add_toml(text, grid, Path(path))


def read_patches_text(path: str | os.PathLike) -> str:
    """Read a patches file, unless it is too long or not text."""
    try:
        if os.path.getsize(path) > MAX_BYTES:
            raise InputError(f"{path}: is longer than {MAX_BYTES} bytes; is this a patches file?")
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); give a patches file") from error
    except ValueError as error:
        raise InputError(f"{path}: is not text; give a patches file (TOML or NMF)") from error


def merge_patches(
    grid: AnyGrid,  # the grid
    patches: Sequence[Patch],  # patches to add
    source: str,  # their origin, for messages
) -> AnyGrid:  # the grid with the patches of both, the grid's first
    """Add patches to a grid; a patch of the same name is replaced."""
    added = {patch.name: patch for patch in patches}
    merged = {patch.name: patch for patch in grid.patches} | added
    claimed = [(patch, window) for patch in merged.values() for window in patch.windows]
    faces: dict[tuple, list[tuple[Patch, Window]]] = {}
    for patch, window in claimed:
        faces.setdefault(_face_key(window), []).append((patch, window))
    for rivals in faces.values():
        for (patch, window), (other, other_window) in combinations(rivals, 2):
            if window.overlaps(other_window):
                raise InputError(
                    f"{source}: patches '{patch.name}' and '{other.name}' both claim part of a face of "
                    f"{grid.blocks[window.block].name}; name each part once"
                )
    return replace(grid, patches=tuple(merged.values()))


def _face_key(window: Window) -> tuple:
    """Key that differs for windows that cannot share any area."""
    return window.block, tuple(lo if lo == hi else None for lo, hi in zip(window.lo, window.hi))


def _add_toml(text: str, grid: AnyGrid, path: Path) -> AnyGrid:
    """Add the patches of a TOML file to a grid: included ones, kinds by names, and declared ones."""
    source = str(path)
    document = parse_toml(text, source)
    check_keys(document, {"patch", "kinds", "include"}, source)
    included = document.get("include")
    if included is not None:
        grid = _include(included, grid, path)
    patches = document.get("patch", [])
    if not isinstance(patches, list):
        raise InputError(f"{source}: 'patch' is not a list of tables; write [[patch]] with double brackets")
    declared = [_parse_patch(table, number, grid, source) for number, table in enumerate(patches, 1)]
    names = [patch.name for patch in declared]
    repeated = next((name for name in names if names.count(name) > 1), None)
    if repeated is not None:
        raise InputError(f"{source}: patch '{repeated}' stands twice; put its faces in one [[patch]]")
    grid = _rename_kinds(document.get("kinds", {}), grid, source)
    return merge_patches(grid, declared, source)


def _include(name: object, grid: AnyGrid, path: Path) -> AnyGrid:
    """Add the patches of the neutral map file that a TOML file includes."""
    if not isinstance(name, str) or "\0" in name:
        raise InputError(f"{path}: 'include' is not the name of a NMF file")
    included = path.parent / name
    text = read_patches_text(included)
    if not is_nmf(text):
        raise InputError(f"{path}: 'include' names {included}, which is not a neutral map file")
    return merge_patches(grid, parse_nmf(text, grid, str(included)), str(included))


def _rename_kinds(kinds: object, grid: AnyGrid, source: str) -> AnyGrid:
    """Apply the table ``[kinds]`` to the patches of the grid; the first pattern that fits counts."""
    if not isinstance(kinds, Mapping):
        raise InputError(f"{source}: 'kinds' is not a table of name = \"kind\"; write [kinds]")
    for pattern, kind in kinds.items():
        if kind not in (*PATCH_KINDS, INTERFACE):
            raise InputError(
                f"{source}: kinds: '{pattern}' = {kind!r} is not one of {listed((*PATCH_KINDS, INTERFACE))}"
            )
        if not any(fnmatchcase(patch.name, pattern) for patch in grid.patches):
            raise InputError(f"{source}: kinds: no patch is named '{pattern}'; take the line out or mend the name")
    patches = []
    for patch in grid.patches:
        kind = next((kind for pattern, kind in kinds.items() if fnmatchcase(patch.name, pattern)), patch.kind)
        if kind != INTERFACE:
            patches.append(replace(patch, kind=kind))
    return replace(grid, patches=tuple(patches))


def _parse_patch(table: object, number: int, grid: Grid | StoredGrid, source: str) -> Patch:
    """Read one table ``[[patch]]``."""
    where = f"{source}: patch {number}"
    if not isinstance(table, Mapping):
        raise InputError(f"{where} is not a table; write [[patch]] and its keys below")
    check_keys(table, {"name", "kind", "faces"}, where)
    name, kind, faces = (table.get(key) for key in ("name", "kind", "faces"))
    if not isinstance(name, str) or not name.strip():
        raise InputError(f'{where} has no name; add name = "..."')
    where = f"{source}: patch '{name}'"
    if kind not in PATCH_KINDS:
        raise InputError(f"{where}: kind {kind!r} is not one of {listed(PATCH_KINDS)}")
    if not isinstance(faces, list) or not faces:
        raise InputError(f'{where} has no faces; add faces = [{{ block = 1, face = "kmin" }}]')
    windows = tuple(_parse_face(face, grid, f"{where}: face {index}") for index, face in enumerate(faces, 1))
    for a, b in combinations(windows, 2):
        if a.overlaps(b):
            raise InputError(f"{where} names part of {grid.blocks[a.block].name} twice; name each part once")
    return Patch(name, kind, windows)


def _parse_face(face: object, grid: Grid | StoredGrid, where: str) -> Window:
    """Read one entry of ``faces``."""
    if not isinstance(face, Mapping):
        raise InputError(f'{where} is not a table like {{ block = 1, face = "kmin" }}')
    check_keys(face, {"block", "face", *_DIRECTIONS}, where)
    block = _find_block(face.get("block"), grid, where)
    if face.get("face") not in FACE_NAMES:
        raise InputError(f"{where}: {face.get('face')!r} is not a face; write one of {listed(FACE_NAMES)}")
    number = FACE_NAMES.index(face["face"])
    window = Window.whole(block, grid.shapes[block]).face(number)
    lo, hi = list(window.lo), list(window.hi)
    for d, direction in enumerate(_DIRECTIONS):
        if direction in face:
            if d == number // 2:
                raise InputError(f"{where}: {face['face']} has no range in {direction}; take it out")
            lo[d], hi[d] = _parse_range(face[direction], grid.shapes[block][d], f"{where}: {direction}")
    return Window(block, tuple(lo), tuple(hi))


def _find_block(key: object, grid: Grid | StoredGrid, where: str) -> int:
    """Return the number, from 0, of a block given by name or by number from 1."""
    names = [block.name for block in grid.blocks]
    if isinstance(key, str) and names.count(key) == 1:
        return names.index(key)
    if isinstance(key, int) and not isinstance(key, bool) and 1 <= key <= len(names):
        return key - 1
    raise InputError(
        f"{where}: block {key!r} is not in the grid; write 1 to {len(names)} or a name such as '{names[0]}'"
    )


def _parse_range(ends: Any, n_nodes: int, where: str) -> tuple[int, int]:
    """Return the first and last index, from 0, of a range of nodes counted from 1."""
    is_pair = isinstance(ends, list) and len(ends) == 2 and all(type(end) is int for end in ends)
    if not is_pair or not 1 <= ends[0] <= ends[1] <= n_nodes or (ends[0] == ends[1] and n_nodes > 1):
        raise InputError(f"{where} = {ends!r} is no range of nodes; write [first, last] within 1 to {n_nodes}")
    return ends[0] - 1, ends[1] - 1


def check_keys(table: Mapping, allowed: set[str], where: str) -> None:
    """Refuse a table with a misspelt key."""
    unknown = next((key for key in table if key not in allowed), None)
    if unknown is not None:
        raise InputError(f"{where}: key '{unknown}' is not known; the keys are {listed(sorted(allowed))}")


def listed(words: Sequence[str]) -> str:
    """Join words for a message."""
    return ", ".join(words)


def is_nmf(text: str) -> bool:
    """Whether a text begins like a neutral map file: a line with one number, the number of blocks."""
    first = next(_lines(text), (0, ""))[1]
    return re.fullmatch(r"\d{1,9}", first) is not None


def parse_nmf(
    text: str,  # content of the file
    grid: Grid | StoredGrid,  # the grid
    source: str,  # name of the file, for messages
) -> tuple[Patch, ...]:  # the patches in order of appearance
    """Read a neutral map file that belongs to a grid."""
    # Lines of the same type make one patch named after it, of the kind with which the word begins (symmetry, wall, far
    # field) or else ``other``. ONE-TO-ONE lines are checked against the nodes and otherwise left to the topology, which
    # finds them again, as it finds connections to which the file gives a name of their own.
    lines = list(_lines(text))
    n_blocks = _check_blocks(lines, grid, source)
    windows: dict[str, list[Window]] = {}
    for number, line in lines[1 + n_blocks :]:
        name, fields = _split_entry(line, f"{source}: line {number}")
        where = f"{source}: line {number} ('{name}')"
        window, first = _parse_rectangle(fields[:6], grid, where)
        if name.lower() in _CONNECTIONS:
            _check_connection(first, fields[6:], grid, where)
        else:
            windows.setdefault(name, []).append(window)
    return tuple(Patch(name, kind_of_name(name), tuple(found)) for name, found in windows.items())


_FACE_DIRECTIONS = {1: (2, 0), 2: (2, 1), 3: (0, 0), 4: (0, 1), 5: (1, 0), 6: (1, 1)}
"""Normal direction and side of NMF faces 1 to 6."""


_CONNECTIONS = ("one-to-one", "one_to_one", "1-to-1")


COINCIDENCE = 1e-2
"""Largest distance between the two sides of a declared connection, relative to the shortest edge on them."""


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield number and content of the non-empty lines, without comments and backslashes at the end."""
    for number, line in enumerate(text.splitlines(), 1):
        content = line.split("#")[0].rstrip().rstrip("\\").strip()
        if content:
            yield number, content


def _check_blocks(lines: list[tuple[int, str]], grid: Grid | StoredGrid, source: str) -> int:
    """Return the number of blocks of a map file; refuse one whose blocks differ from the grid's."""
    n_blocks = int(lines[0][1])
    if n_blocks != len(grid.blocks):
        raise InputError(
            f"{source}: describes {n_blocks} blocks, the grid has {len(grid.blocks)}; give the map of this grid"
        )
    rows = [lines[1 + index] if 1 + index < len(lines) else (0, "") for index in range(n_blocks)]
    are_all_1 = all(line.split()[:1] == ["1"] for _, line in rows)
    for index, (shape, (number, line)) in enumerate(zip(grid.shapes, rows)):
        if line.split() != [str(n) for n in (1 if are_all_1 else index + 1, *shape)]:
            raise InputError(f"{source}: line {number}: '{line[:40]}' is not 'block ni nj nk' = {index + 1} {shape}")
    return n_blocks


def _split_entry(line: str, where: str) -> tuple[str, list[str]]:
    """Split a line into its type and the fields that follow."""
    match = re.match(r"""('[^']*'|"[^"]*"|[^\s'"]+)\s+(.*)""", line)
    name, fields = (match[1].strip("'\" "), match[2].split()) if match else ("", [])
    numbers = fields[: len(fields) - len(fields) % 6]  # the rest after one side or two is the swap
    if not name or len(fields) not in (6, 7, 12, 13) or not all(re.fullmatch(r"\d{1,9}", field) for field in numbers):
        raise InputError(f"{where}: '{line[:60]}' is not 'type B1 F1 S1 E1 S2 E2' with whole numbers")
    if len(fields) > len(numbers) and _swap(fields) not in ("TRUE", "FALSE", "T", "F"):
        raise InputError(f"{where}: swap is '{fields[-1][:20]}'; write TRUE or FALSE")
    return name, fields


def _swap(fields: list[str]) -> str:
    """Last field of a line, without surrounding quotes or points."""
    return fields[-1].strip("'\".").upper()


def _parse_rectangle(fields: list[str], grid: Grid | StoredGrid, where: str) -> tuple[Window, np.ndarray]:
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
    index: list[Any] = [lo[normal]] * 3
    for first, last, d in zip(ends[::2], ends[1::2], ((normal + 1) % 3, (normal + 2) % 3)):
        if not (1 <= first <= shape[d] and 1 <= last <= shape[d]) or (first == last and shape[d] > 1):
            raise InputError(f"{where}: {first} to {last} is no range of {'ijk'[d]} of block {block}, 1 to {shape[d]}")
        lo[d], hi[d] = min(first, last) - 1, max(first, last) - 1
        step = 1 if last >= first else -1
        index[d] = np.arange(first - 1, last - 1 + step, step)
    window = Window(block - 1, tuple(lo), tuple(hi))
    index[(normal + 1) % 3] = index[(normal + 1) % 3][:, None]
    return window, grid.blocks[block - 1].nodes[tuple(index)]


def _check_connection(nodes: np.ndarray, fields: list[str], grid: Grid | StoredGrid, where: str) -> None:
    """Refuse a connection whose two sides do not coincide."""
    if len(fields) < 6:  # none, or only the swap
        raise InputError(f"{where}: names one side of a connection; add B2 F2 S1 E1 S2 E2 and swap")
    other = _parse_rectangle(fields[:6], grid, where)[1]
    other = other.swapaxes(0, 1) if len(fields) > 6 and _swap(fields).startswith("T") else other
    if nodes.shape != other.shape:
        raise InputError(f"{where}: joins {nodes.shape[:2]} nodes to {other.shape[:2]}; mend the ranges or swap")
    gap = np.linalg.norm(nodes - other, axis=-1).max()
    if gap > COINCIDENCE * _shortest_edge(nodes):
        raise InputError(
            f"{where}: the two sides are up to {gap:.3g} apart; take the line out if it is periodic, or mend it"
        )


def _shortest_edge(nodes: np.ndarray) -> float:
    """Length of the shortest edge of a face that is not collapsed."""
    edges = np.concatenate([np.linalg.norm(np.diff(nodes, axis=d), axis=-1).ravel() for d in (0, 1)])
    return float(edges[edges > 0.0].min(initial=np.inf))
