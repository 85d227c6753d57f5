"""A guess at the patches of a grid, from names and places of its faces, and the draft of a patches file.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import tomlkit

from ..topology.detection import find_topology
from ..topology.grid import Grid, Patch
from ..topology.index_space import FACE_NAMES, Window
from ..topology.periodic import find_periodic
from ..topology.topology import Topology

__all__ = ["GridFrame", "draft_patches", "guess_patches", "guess_undeclared", "kind_of_name", "with_guessed_patches"]

_KIND_OF_PREFIX = {
    "sym": "symmetry",
    "reflect": "symmetry",
    "wall": "wall",
    "viscous": "wall",
    "inviscid": "wall",
    "tangency": "wall",
    "slip": "wall",
    "noslip": "wall",
    "no-slip": "wall",
    "far": "farfield",
    "freestream": "farfield",
    "inflow": "farfield",
    "inlet": "farfield",
    "out": "farfield",
    "back": "farfield",
}

PLANAR = 1e-6
"""A face is planar when its nodes leave the plane by less than this part of the grid's size."""

FAR = 0.3
"""A face is far field when all of it is further from the middle of the grid than this part of the farthest node."""

_KINDS = {"symmetry": "symmetry", "wall": "wall", "periodic": "other", "farfield": "farfield"}
"""Kinds of what is guessed, by the word that its name begins with."""

_NODES_SAMPLED = 100_000  # enough for the median, which need not be exact
_HEADER = """Patches of {source}: a draft to be checked.
Kinds: wall, symmetry, farfield, other. Faces that are not named are free boundaries or found interfaces.
A face may be cut: {{ block = 1, face = "kmin", i = [1, 13] }} (nodes counted from 1).
Symmetry was guessed for planes at the rim of the grid, periodic for pairs of faces that a rotation about an axis or a
translation lays onto each other, far field for distant faces, wall for the rest."""


@dataclass(frozen=True)
class GridFrame:
    """Extent of a grid and where most of its nodes are.

    Parameters
    ----------
    low, high : ndarray, shape (3,)
        Corners of the box of the grid (m).
    middle : ndarray, shape (3,)
        Where most nodes are (m).
    radius : float
        Distance of the farthest node from there (m).
    """

    low: np.ndarray
    high: np.ndarray
    middle: np.ndarray
    radius: float

    @classmethod
    def of(cls, grid: Grid) -> GridFrame:
        """Measure a grid; its middle is judged from nodes spread over it."""
        low = np.min([block.nodes.min(axis=(0, 1, 2)) for block in grid.blocks], axis=0)
        high = np.max([block.nodes.max(axis=(0, 1, 2)) for block in grid.blocks], axis=0)
        step = 1 + grid.n_nodes // _NODES_SAMPLED
        sample = np.concatenate([block.nodes.reshape(-1, 3)[::step] for block in grid.blocks])
        middle = np.median(sample, axis=0)
        return cls(low, high, middle, float(np.linalg.norm(sample - middle, axis=1).max()))

    @property
    def size(self) -> float:
        """Longest side of the box (m)."""
        return float((self.high - self.low).max())

    def distance(self, nodes: np.ndarray) -> float:
        """Smallest distance of nodes (..., 3) from the middle, as a part of the radius."""
        return float(np.linalg.norm(nodes - self.middle, axis=-1).min() / self.radius)


def kind_of_name(name: str) -> str:
    """Kind of the patch that a name in a neutral map file or of a CGNS family stands for.

    Parameters
    ----------
    name : str
        The name. ``BC`` before it, as in ``BC_WALL``, counts for nothing.

    Returns
    -------
    str
        The kind that the word begins with, ``"other"`` where it says nothing.

    Examples
    --------
    >>> kind_of_name("BC_WALL"), kind_of_name("SYMMETRY-Y"), kind_of_name("DEFAULT_SUBFACE")
    ('wall', 'symmetry', 'other')
    """
    word = re.sub(r"^bc[-_. ]*", "", name.strip().lower())
    return next((kind for prefix, kind in _KIND_OF_PREFIX.items() if word.startswith(prefix)), "other")


def with_guessed_patches(grid: Grid) -> Grid:
    """Guess what the boundary of a grid is where nobody declared it.

    Parameters
    ----------
    grid : Grid
        The grid, with patches or without.

    Returns
    -------
    Grid
        The grid with its patches, and with guessed ones on the rest of its boundary.
    """
    guessed = guess_undeclared(grid, find_topology(grid))
    return replace(grid, patches=(*grid.patches, *guessed)) if guessed else grid


def guess_undeclared(grid: Grid, topology: Topology) -> tuple[Patch, ...]:
    """Guess what the boundary of a grid is where nobody declared it, under names that are free.

    Parameters
    ----------
    grid : Grid
        The grid, with patches or without.
    topology : Topology
        Its topology.

    Returns
    -------
    tuple of Patch
        See `guess_patches`; a name that a declared patch has gets ``_guessed`` behind it.
    """
    guessed = guess_patches(grid, [face.window for face in topology.boundary if face.patch is None])
    taken = {patch.name for patch in grid.patches}
    return tuple(replace(p, name=f"{p.name}_guessed") if p.name in taken else p for p in guessed)


def guess_patches(grid: Grid, windows: Sequence[Window]) -> tuple[Patch, ...]:
    """Guess what boundary windows are.

    A window is *symmetry* when it lies in a coordinate plane that bounds the grid, and that plane passes through the
    origin or its block is one cell deep there; *periodic*, of the kind ``other``, when it is on one side of a pair that
    `find_periodic` finds; *far field* when it keeps away from where most nodes are; else *wall*.

    Parameters
    ----------
    grid : Grid
        The grid.
    windows : sequence of Window
        Its boundary.

    Returns
    -------
    tuple of Patch
        Patches ``symmetry_x`` (or y, z), ``wall``, ``periodic_1a`` and ``periodic_1b`` (and so on) and ``farfield``,
        those that were found.
    """
    if not windows:
        return ()
    frame = GridFrame.of(grid)
    found: dict[str, list[Window]] = {}
    for window in windows:
        found.setdefault(_guess(grid, window, frame), []).append(window)
    pairs = find_periodic(grid, [window for name in ("wall", "farfield") for window in found.get(name, ())])
    for number, pair in enumerate(pairs, start=1):
        for letter, side in zip("ab", (pair.windows, pair.others)):
            found[f"periodic_{number}{letter}"] = list(side)
            for name in ("wall", "farfield"):
                found[name] = [window for window in found.get(name, ()) if window not in side]
    order = sorted(filter(found.get, found), key=lambda name: (list(_KINDS).index(name.split("_")[0]), name))
    return tuple(Patch(name, _KINDS[name.split("_")[0]], tuple(found[name])) for name in order)


def _guess(grid: Grid, window: Window, frame: GridFrame) -> str:
    """Name what a window probably is, periodic planes apart."""
    nodes = grid.blocks[window.block].nodes[window.slices].reshape(-1, 3)
    for axis, letter in enumerate("xyz"):
        if _is_symmetry(grid, window, nodes[:, axis], frame, axis):
            return f"symmetry_{letter}"
    return "farfield" if frame.distance(nodes) > FAR else "wall"


def _is_symmetry(grid: Grid, window: Window, values: np.ndarray, frame: GridFrame, axis: int) -> bool:
    """Whether a window is a plane of symmetry normal to an axis, from its nodes' values along it."""
    tolerance = PLANAR * frame.size
    level = float(values.mean())
    is_outermost = min(abs(level - frame.low[axis]), abs(level - frame.high[axis])) <= tolerance
    if np.ptp(values) > tolerance or not is_outermost:
        return False
    shape = grid.shapes[window.block]
    is_one_deep = any(n <= 2 and lo == hi for n, lo, hi in zip(shape, window.lo, window.hi))
    return is_one_deep or abs(level) <= tolerance


def draft_patches(grid: Grid, patches: Sequence[Patch], remarks: Mapping[str, str] | None = None) -> str:
    """Write patches as the text of a TOML patches file.

    Parameters
    ----------
    grid : Grid
        The grid.
    patches : sequence of Patch
        Declared or guessed patches of it.
    remarks : mapping of str to str
        What to say of patches, by their names; a comment above each.

    Returns
    -------
    str
        The text; reading it back gives the same patches.
    """
    document = tomlkit.document()
    for line in _HEADER.format(source=grid.source).splitlines():
        document.add(tomlkit.comment(line))
    tables = tomlkit.aot()
    for patch in patches:
        table = tomlkit.table()
        if remarks and patch.name in remarks:
            table.add(tomlkit.comment(remarks[patch.name]))
        table["name"] = patch.name
        table["kind"] = patch.kind
        faces = tomlkit.array()
        for window in patch.windows:
            faces.append(_draft_face(grid, window))
        table["faces"] = faces.multiline(True)
        tables.append(table)
    if patches:
        document["patch"] = tables
    return tomlkit.dumps(document)


def _draft_face(grid: Grid, window: Window):
    """Write a window as an inline table: block, face, and ranges where it covers a part of the face."""
    block = grid.blocks[window.block]
    face = _face_of(window, block.shape)
    entry = tomlkit.inline_table()
    entry["block"] = window.block + 1 if block.name == f"block {window.block + 1}" else block.name
    entry["face"] = FACE_NAMES[face]
    for d, (lo, hi, n) in enumerate(zip(window.lo, window.hi, block.shape)):
        if d != face // 2 and (lo, hi) != (0, n - 1):
            entry["ijk"[d]] = [lo + 1, hi + 1]
    return entry


def _face_of(window: Window, shape: tuple[int, ...]) -> int:
    """Face that a window lies on; the truly flat direction counts before one that has a single node."""
    flat = [d for d in range(3) if window.lo[d] == window.hi[d] and window.lo[d] in (0, shape[d] - 1)]
    d = max(flat, key=lambda d: shape[d])
    return 2 * d + int(window.lo[d] > 0)
