"""A guess at the patches of a grid, from names and places of its faces, and the draft of a patches file.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import tomlkit
from tomlkit.items import InlineTable

from ..topology.detection import find_topology
from ..topology.grid import Grid, Patch
from ..topology.index_space import FACE_NAMES, Window
from ..topology.overset import component_numbers
from ..topology.periodic import find_periodic
from ..topology.stored_grid import StoredGrid
from ..topology.topology import Topology
from .boundary_planes import BoundaryPlane, find_planes
from .grid_frame import GridFrame, first_cells
from .overset_guess import OVERSET, overlap_text, with_overset
from .patch_certainty import FaceGuess, judge_periodic, judge_place, judge_symmetry
from .symmetry_guess import Places, doubtful_faces, find_symmetry

__all__ = [
    "draft_patches",
    "gathered",
    "guess_faces",
    "guess_patches",
    "guess_undeclared",
    "kind_of_name",
    "overlap_of",
    "with_guessed_patches",
]

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
    "overset": "overset",
    "overlap": "overset",
    "chimera": "overset",
}

ALIGNED = 1e-6
"""Normals whose product differs from 1 by less than this are parallel: about 0.08 deg."""

_KINDS = ("symmetry", "wall", "periodic", "farfield")
"""Beginnings of the names of guessed patches, in the order of the patches."""

_HEADER = """Patches of {source}: a draft to be checked.
Kinds: wall, symmetry, farfield, overset, other. Faces that are not named are free boundaries or found interfaces.
A face may be cut: {{ block = 1, face = "kmin", i = [1, 13] }} (nodes counted from 1).
Symmetry was guessed for planes at the rim of the grid in which other faces end at a right angle, periodic for pairs of
faces that a rotation or a translation maps onto each other, far field for distant faces, wall for the rest."""


def kind_of_name(name: str) -> str:
    """Kind for the name of a patch in a neutral map file or of a CGNS family; ``BC`` before it is ignored.

    Examples
    --------
    >>> kind_of_name("BC_WALL"), kind_of_name("SYMMETRY-Y"), kind_of_name("DEFAULT_SUBFACE")
    ('wall', 'symmetry', 'other')
    """
    word = re.sub(r"^bc[-_. ]*", "", name.strip().lower())
    return next((kind for prefix, kind in _KIND_OF_PREFIX.items() if word.startswith(prefix)), "other")


def with_guessed_patches(grid: Grid) -> Grid:
    """Guess the undeclared boundary of a grid.

    Parameters
    ----------
    grid : Grid
        The grid, with or without patches.

    Returns
    -------
    Grid
        The grid with its patches, and with guessed patches on the rest of its boundary.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.grids import with_guessed_patches
    >>> bare = replace(onera_m6_grid((9, 8, 7)), patches=())
    >>> sorted({patch.kind for patch in with_guessed_patches(bare).patches})
    ['farfield', 'symmetry', 'wall']
    """
    guessed = gathered(guess_undeclared(grid, find_topology(grid)))
    return replace(grid, patches=(*grid.patches, *guessed)) if guessed else grid


def guess_undeclared(
    grid: Grid,  # the grid, with or without patches
    topology: Topology,  # its topology
) -> tuple[FaceGuess, ...]:  # see `guess_faces`; names that are taken by declared patches get ``_guessed`` appended
    """Guess the undeclared boundary of a grid, under unused names."""
    guesses = guess_faces(grid, [face.window for face in topology.boundary if face.patch is None])
    guesses = with_overset(grid, topology, guesses)
    taken = {patch.name for patch in grid.patches}
    return tuple(replace(g, name=f"{g.name}_guessed") if g.name in taken else g for g in guesses)


def may_overlap(grid: Grid | StoredGrid, topology: Topology) -> bool:
    """Whether a grid may consist of overlapping component grids: it has several parts, or overset patches."""
    return any(patch.kind == OVERSET for patch in grid.patches) or bool(component_numbers(topology).max() > 0)


def overlap_of(grid: Grid, topology: Topology) -> str:
    """Say that component grids overlap, declared or found, and how this is known; empty if they do not."""
    return overlap_text(grid, topology, guess_undeclared(grid, topology)) if may_overlap(grid, topology) else ""


def guess_patches(grid: Grid, windows: Sequence[Window]) -> tuple[Patch, ...]:
    """Guess what boundary windows are, and group them into patches.

    Parameters
    ----------
    grid : Grid
        The grid.
    windows : sequence of Window
        Its boundary.

    Returns
    -------
    tuple of Patch
        Patches ``symmetry_x`` (or y, z; ``symmetry_1`` and so on for oblique planes), ``wall``, ``periodic_1a`` and
        ``periodic_1b`` (and so on) and ``farfield``, as far as they were found.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from bspline_mdao import find_topology
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.grids import guess_patches
    >>> bare = replace(onera_m6_grid((9, 8, 7)), patches=())
    >>> windows = [face.window for face in find_topology(bare).boundary]
    >>> sorted(patch.name for patch in guess_patches(bare, windows))
    ['farfield', 'symmetry_z', 'wall']
    """
    return gathered(guess_faces(grid, windows))


def gathered(guesses: Sequence[FaceGuess]) -> tuple[Patch, ...]:
    """Group guesses at faces by name."""
    names = {guess.name: guess.kind for guess in guesses}
    return tuple(
        Patch(name, kind, tuple(guess.window for guess in guesses if guess.name == name))
        for name, kind in names.items()
    )


def guess_faces(
    grid: Grid,  # the grid; patches of it that are walls or far fields are evidence
    windows: Sequence[Window],  # the windows
) -> tuple[FaceGuess, ...]:  # one for each window, sorted by the names of patches
    """Guess what boundary windows are, with the certainty."""
    # A window is *periodic*, of the kind ``other``, if it is on one side of a pair that `find_periodic` finds;
    # *symmetry* if it lies in a plane that bounds the grid, and its block is one cell deep there or other surfaces end
    # in the plane at a right angle; *far field* if it is far from most nodes; else *wall*. None of this depends on the
    # position, orientation, handedness or unit of the grid.
    if not windows:
        return ()
    found: dict[Window, FaceGuess] = {}
    for number, pair in enumerate(find_periodic(grid, windows), start=1):
        for letter, side in zip("ab", (pair.windows, pair.others)):
            found |= {window: judge_periodic(window, f"periodic_{number}{letter}", pair.motion) for window in side}
    found |= _guess_places(grid, [window for window in windows if window not in found])
    order = sorted(windows, key=lambda w: (_KINDS.index(found[w].name.split("_")[0]), found[w].name))
    return tuple(found[window] for window in order)


def _guess_places(grid: Grid, windows: Sequence[Window]) -> dict[Window, FaceGuess]:
    """Guess at windows that are not periodic."""
    frame = GridFrame.of(grid)
    cells = {window: first_cells(grid, window) for window in windows}
    distances = {window: frame.distance(grid.blocks[window.block].nodes[window.slices]) for window in windows}
    found = {window: judge_place(window, distances[window], cells[window]) for window in windows}
    planes = find_planes(grid, windows, frame.radius)
    places = Places.of(grid, planes, distances, cells, found)
    names = _names(planes)
    for window in doubtful_faces(places):
        found[window] = replace(found[window], level="unsure", reason=f"a plane, {found[window].reason}")
    for n in find_symmetry(places):
        for window in planes[n].windows:
            found[window] = judge_symmetry(window, names[n], cells[window])
    return found


def _names(planes: Sequence[BoundaryPlane]) -> list[str]:
    """Name planes by the axis normal to them, and number the other directions; parallel ones get the same name."""
    names: list[str] = []
    directions: list[np.ndarray] = []
    for plane in planes:
        axis = int(np.argmax(np.abs(plane.normal)))
        if abs(plane.normal[axis]) > 1.0 - ALIGNED:
            names.append(f"symmetry_{'xyz'[axis]}")
            continue
        alike = [n for n, normal in enumerate(directions) if abs(normal @ plane.normal) > 1.0 - ALIGNED]
        directions += [] if alike else [plane.normal]
        names.append(f"symmetry_{alike[0] + 1 if alike else len(directions)}")
    return names


def draft_patches(
    grid: Grid,  # the grid
    patches: Sequence[Patch],  # declared or guessed patches of it
    remarks: Mapping[str, str] | None = None,  # remarks on patches, by name; a comment above each
) -> str:  # the text; reading it back gives the same patches
    """Write patches as the text of a TOML patches file."""
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


def _draft_face(grid: Grid, window: Window) -> InlineTable:
    """Write a window as an inline table: block, face, and ranges if it covers a part of the face."""
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
    """Face of a window; a truly flat direction takes precedence over one with a single node."""
    flat = [d for d in range(3) if window.lo[d] == window.hi[d] and window.lo[d] in (0, shape[d] - 1)]
    d = max(flat, key=lambda d: shape[d])
    return 2 * d + int(window.lo[d] > 0)
