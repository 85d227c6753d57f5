"""Kinds of the markers of an unstructured mesh: declared in a patches file, and guessed where it says nothing.

The file is the same as for structured grids; for meshes, the table of kinds by names or patterns is used, and the first
pattern that fits counts::

    [kinds]
    "wing*" = "wall"            # wall, symmetry, farfield, periodic, inner, sliding or other
    "x_m" = "symmetry"

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

import tomlkit

from ...base.matching import MARKERS, matching_names
from ...base.toml import parse_toml
from ...errors import InputError
from ..cells.mixed_cells import MixedMesh
from .marker_guess import MARKER_KINDS, NO_WALL, MarkerGuess, contradicting_guesses, guess_kinds
from .patches import check_keys, is_nmf, listed, read_patches_text

__all__ = ["doubtful_kinds", "draft_kinds", "marker_kinds", "read_kinds", "undecided"]

_HEADER = """Markers of {source}: a draft to be checked.
Kinds: {kinds}. A name may be a pattern, such as "wing*"; the first that fits counts.
Walls move, and nodes on planes of symmetry stay in them; markers of kind inner move along, periodic sides that are
copies of each other move alike, nodes of kind sliding stay on their cylinder, cone, sphere or surface of
revolution, and all others stay."""


def read_kinds(path: str | os.PathLike, mesh: MixedMesh) -> dict[str, str]:
    r"""Read the kinds of markers that a patches file declares.

    Parameters
    ----------
    path : path-like
        The TOML file, with a table ``[kinds]``.
    mesh : MixedMesh
        The mesh.

    Returns
    -------
    dict of str to str
        Kinds of the markers that it declares, by their names.

    Raises
    ------
    InputError
        If the file cannot be read, names missing markers, or a kind is unknown.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from bspline_mdao.meshes import MixedMesh, read_kinds
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> mesh = MixedMesh(corners, {"tetra": np.array([[0, 1, 2, 3]])}, {"z_m": np.array([[0, 1, 2, 2]])})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "kinds.toml")
    ...     _ = path.write_text('[kinds]\n"z_*" = "wall"\n')
    ...     read_kinds(path, mesh)
    {'z_m': 'wall'}
    """
    source, text, names = str(path), read_patches_text(path), list(mesh.markers or {})
    if is_nmf(text):
        raise InputError(f"{source}: is a neutral map of a structured grid; give a TOML file with [kinds] of markers")
    document = parse_toml(text, source)
    if "patch" in document or "include" in document:
        raise InputError(
            f"{source}: has faces of blocks, and {mesh.source} has markers; write [kinds] with lines such as "
            f'"{(names or ["wing"])[0]}" = "wall"'
        )
    check_keys(document, {"kinds"}, source)
    kinds = document.get("kinds", {})
    if not isinstance(kinds, Mapping):
        raise InputError(f"{source}: 'kinds' is not a table of name = \"kind\"; write [kinds]")
    for pattern, kind in kinds.items():
        if kind not in MARKER_KINDS:
            raise InputError(f"{source}: kinds: '{pattern}' = {kind!r} is not one of {listed(MARKER_KINDS)}")
    matches = {pattern: matching_names(names, pattern, f"{source}: kinds", MARKERS) for pattern in kinds}
    fits = {name: next((kinds[pattern] for pattern in kinds if name in matches[pattern]), None) for name in names}
    return {name: kind for name, kind in fits.items() if kind is not None}


def marker_kinds(mesh: MixedMesh, patches: str | os.PathLike | None = None) -> dict[str, MarkerGuess]:
    """Find the kinds of the markers of a mesh, as declared in a patches file or guessed.

    Parameters
    ----------
    mesh : MixedMesh
        The mesh.
    patches : path-like, optional
        The patches file, see `read_kinds`.

    Returns
    -------
    dict of str to MarkerGuess
        One for each marker, in the order of the mesh.

    Raises
    ------
    InputError
        As in `read_kinds`.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.meshes import MixedMesh, marker_kinds
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> mesh = MixedMesh(corners, {"tetra": np.array([[0, 1, 2, 3]])}, {"wing": np.array([[0, 1, 2, 2]])})
    >>> marker_kinds(mesh)["wing"]
    MarkerGuess(kind='wall', sure='sure', why='by its name')
    """
    declared = read_kinds(patches, mesh) if patches else {}
    said = {name: MarkerGuess(kind, "sure", f"declared in {patches}") for name, kind in declared.items()}
    return guess_kinds(mesh, said)


def doubtful_kinds(mesh: MixedMesh, patches: str | os.PathLike | None) -> list[str]:
    """Warning of kinds declared in a patches file that contradict sure guesses; none if there are none."""
    declared = read_kinds(patches, mesh) if patches else {}
    said = [
        f"'{name}' is declared {declared[name]} and seems to be {guess.kind} ({guess.why})"
        for name, guess in contradicting_guesses(mesh, declared).items()
    ]
    return [f"{patches}: {', '.join(said)}; mend the file unless that is meant"] if said else []


def undecided(mesh: MixedMesh, kinds: Mapping[str, MarkerGuess]) -> str:
    """Say what must be declared before a mesh can be moved; empty if nothing must."""
    if not kinds:
        return f"{mesh.source}: has no markers, so nothing says what moves; write it with markers of its boundary"
    if not any(guess.kind == "wall" for guess in kinds.values()):
        plates = [name for name, guess in kinds.items() if (guess.kind, guess.sure) == ("inner", "unsure")]
        if plates:
            return (
                f"{mesh.source}: no marker looks like a wall but '{plates[0]}', and it has cells on both sides, which "
                f"share its nodes; write the mesh with its nodes doubled there (by Gmsh's plugin Crack)"
            )
        open_ones = [n for n, guess in kinds.items() if guess.sure == "unsure" and not guess.why.startswith(NO_WALL)]
        name = (open_ones or (list(kinds) if len(kinds) == 1 else ["NAME"]))[0]
        return (
            f'{mesh.source}: no marker looks like a wall; declare one, such as "{name}" = "wall" below [kinds] '
            f"in a file for --patches; markers are {listed(list(kinds))}"
        )
    return ""


def draft_kinds(mesh: MixedMesh, kinds: Mapping[str, MarkerGuess]) -> str:
    """Write kinds of markers as the text of a patches file; reading it back gives the same kinds."""
    document, table = tomlkit.document(), tomlkit.table()
    for line in _HEADER.format(source=mesh.source, kinds=listed(MARKER_KINDS)).splitlines():
        document.add(tomlkit.comment(line))
    for name, guess in kinds.items():
        table.add(tomlkit.comment(f"{guess.sure}: {guess.why}"))
        table[_escaped(name)] = guess.kind
    document["kinds"] = table
    return tomlkit.dumps(document)


def _escaped(name: str) -> str:
    """A pattern that fits only one name."""
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in name)
