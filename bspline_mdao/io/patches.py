"""Patches declared beside a grid: the TOML file, and merging it with what the grid file declares.

A patches file names pieces of the boundary::

    [[patch]]
    name = "wing"
    kind = "wall"                                                  # wall, symmetry, farfield or other
    faces = [
        { block = 3, face = "kmin" },                              # number from 1, or name, of the block
        { block = "tip", face = "jmax", i = [1, 13], k = [5, 17] },  # part of a face, nodes counted from 1
    ]

    [kinds]                                                        # what patches from elsewhere are, by name
    "symm*" = "symmetry"
    "B*" = "interface"                                             # no patch: left to the topology

``include = "grid.nmf"`` takes the patches of a neutral map file, whose names seldom tell what they are.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from itertools import combinations
from pathlib import Path

import tomlkit
from tomlkit.exceptions import TOMLKitError

from ..errors import InputError
from ..topology.grid import PATCH_KINDS, Grid, Patch
from ..topology.index_space import FACE_NAMES, Window
from .nmf import is_nmf, parse_nmf

__all__ = ["INTERFACE", "merge_patches", "read_patches"]

INTERFACE = "interface"
"""In ``[kinds]``: such a patch is none, the topology finds what lies against it."""

MAX_BYTES = 2**22
"""Length of a patches file beyond which it is something else."""

_DIRECTIONS = "ijk"


def read_patches(path: str | os.PathLike, grid: Grid) -> Grid:
    """Add the patches of a TOML or NMF file to a grid.

    Parameters
    ----------
    path : path-like
        The patches file; what it is shows in its content.
    grid : Grid
        The grid, perhaps with patches of its own. One of the same name is replaced.

    Returns
    -------
    Grid
        The grid with the patches of both.

    Raises
    ------
    InputError
        When the file cannot be read, a key or face is misspelt, an index is outside its block, or two patches claim the
        same part of a face.
    """
    text = _read_text(path)
    if is_nmf(text):
        return merge_patches(grid, parse_nmf(text, grid, str(path)), str(path))
    return _add_toml(text, grid, Path(path))


def _read_text(path: str | os.PathLike) -> str:
    try:
        if os.path.getsize(path) > MAX_BYTES:
            raise InputError(f"{path}: is longer than {MAX_BYTES} bytes; is this a patches file?")
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); give a patches file") from error
    except ValueError as error:
        raise InputError(f"{path}: is not text; give a patches file (TOML or NMF)") from error


def merge_patches(grid: Grid, patches: Sequence[Patch], source: str) -> Grid:
    """Add patches to a grid; one of the same name takes the place of the grid's.

    Parameters
    ----------
    grid : Grid
        The grid.
    patches : sequence of Patch
        What to add.
    source : str
        Where they come from, for messages.

    Returns
    -------
    Grid
        The grid with the patches of both, the grid's first.

    Raises
    ------
    InputError
        When two patches claim the same part of a face.
    """
    added = {patch.name: patch for patch in patches}
    merged = {patch.name: patch for patch in grid.patches} | added
    claims = [(patch, window) for patch in merged.values() for window in patch.windows]
    faces = {}
    for patch, window in claims:
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
    """Tell apart windows that cannot share any area."""
    return window.block, tuple(lo if lo == hi else None for lo, hi in zip(window.lo, window.hi))


def _add_toml(text: str, grid: Grid, path: Path) -> Grid:
    source = str(path)
    try:
        document = tomlkit.parse(text).unwrap()
    except (TOMLKitError, ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise InputError(f"{source}: is not TOML ({' '.join(str(error).split())[:160]})") from error
    _check_keys(document, {"patch", "kinds", "include"}, source)
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


def _include(name: object, grid: Grid, path: Path) -> Grid:
    if not isinstance(name, str) or "\0" in name:
        raise InputError(f"{path}: 'include' is not the name of a NMF file")
    included = path.parent / name
    text = _read_text(included)
    if not is_nmf(text):
        raise InputError(f"{path}: 'include' names {included}, which is not a neutral map file")
    return merge_patches(grid, parse_nmf(text, grid, str(included)), str(included))


def _rename_kinds(kinds: object, grid: Grid, source: str) -> Grid:
    """Apply the table ``[kinds]`` to the patches that the grid has; the first pattern that fits counts."""
    if not isinstance(kinds, Mapping):
        raise InputError(f"{source}: 'kinds' is not a table of name = \"kind\"; write [kinds]")
    for pattern, kind in kinds.items():
        if kind not in (*PATCH_KINDS, INTERFACE):
            raise InputError(
                f"{source}: kinds: '{pattern}' = {kind!r} is not one of {_listed((*PATCH_KINDS, INTERFACE))}"
            )
        if not any(fnmatchcase(patch.name, pattern) for patch in grid.patches):
            raise InputError(f"{source}: kinds: no patch is named '{pattern}'; take the line out or mend the name")
    patches = []
    for patch in grid.patches:
        kind = next((kind for pattern, kind in kinds.items() if fnmatchcase(patch.name, pattern)), patch.kind)
        if kind != INTERFACE:
            patches.append(replace(patch, kind=kind))
    return replace(grid, patches=tuple(patches))


def _parse_patch(table: object, number: int, grid: Grid, source: str) -> Patch:
    where = f"{source}: patch {number}"
    if not isinstance(table, Mapping):
        raise InputError(f"{where} is not a table; write [[patch]] and its keys below")
    _check_keys(table, {"name", "kind", "faces"}, where)
    name, kind, faces = (table.get(key) for key in ("name", "kind", "faces"))
    if not isinstance(name, str) or not name.strip():
        raise InputError(f'{where} has no name; add name = "..."')
    where = f"{source}: patch '{name}'"
    if kind not in PATCH_KINDS:
        raise InputError(f"{where}: kind {kind!r} is not one of {_listed(PATCH_KINDS)}")
    if not isinstance(faces, list) or not faces:
        raise InputError(f'{where} has no faces; add faces = [{{ block = 1, face = "kmin" }}]')
    windows = tuple(_parse_face(face, grid, f"{where}: face {index}") for index, face in enumerate(faces, 1))
    for a, b in combinations(windows, 2):
        if a.overlaps(b):
            raise InputError(f"{where} names part of {grid.blocks[a.block].name} twice; name each part once")
    return Patch(name, kind, windows)


def _parse_face(face: object, grid: Grid, where: str) -> Window:
    if not isinstance(face, Mapping):
        raise InputError(f'{where} is not a table like {{ block = 1, face = "kmin" }}')
    _check_keys(face, {"block", "face", *_DIRECTIONS}, where)
    block = _find_block(face.get("block"), grid, where)
    if face.get("face") not in FACE_NAMES:
        raise InputError(f"{where}: {face.get('face')!r} is not a face; write one of {_listed(FACE_NAMES)}")
    number = FACE_NAMES.index(face["face"])
    window = Window.whole(block, grid.shapes[block]).face(number)
    lo, hi = list(window.lo), list(window.hi)
    for d, direction in enumerate(_DIRECTIONS):
        if direction in face:
            if d == number // 2:
                raise InputError(f"{where}: {face['face']} has no range in {direction}; take it out")
            lo[d], hi[d] = _parse_range(face[direction], grid.shapes[block][d], f"{where}: {direction}")
    return Window(block, tuple(lo), tuple(hi))


def _find_block(key: object, grid: Grid, where: str) -> int:
    names = [block.name for block in grid.blocks]
    if isinstance(key, str) and names.count(key) == 1:
        return names.index(key)
    if isinstance(key, int) and not isinstance(key, bool) and 1 <= key <= len(names):
        return key - 1
    raise InputError(
        f"{where}: block {key!r} is not in the grid; write 1 to {len(names)} or a name such as '{names[0]}'"
    )


def _parse_range(ends: object, n_nodes: int, where: str) -> tuple[int, int]:
    is_pair = isinstance(ends, list) and len(ends) == 2 and all(type(end) is int for end in ends)
    if not is_pair or not 1 <= ends[0] <= ends[1] <= n_nodes or (ends[0] == ends[1] and n_nodes > 1):
        raise InputError(f"{where} = {ends!r} is no range of nodes; write [first, last] within 1 to {n_nodes}")
    return ends[0] - 1, ends[1] - 1


def _check_keys(table: Mapping, known: set[str], where: str) -> None:
    unknown = next((key for key in table if key not in known), None)
    if unknown is not None:
        raise InputError(f"{where}: key '{unknown}' is not known; the keys are {_listed(sorted(known))}")


def _listed(words: Sequence[str]) -> str:
    return ", ".join(words)
