"""The command ``inspect``: topology and walls of a grid, the fit of a model, and the draft of a patches file.

Unstructured meshes are in `meshes`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ...base.numerics.progress import progress_bar
from ...base.text import counted
from ...core.model.fitted_model import FittedModel
from ...errors import InputError
from ...grids.cells.wall_spacing import wall_spacings
from ...grids.io.disk import replaced_file
from ...grids.io.formats import MODEL
from ...grids.io.meshes.files import is_mesh
from ...grids.io.overset_guess import overlap_text
from ...grids.io.patch_certainty import SURENESS, Certainty, how_sure
from ...grids.io.patch_guess import draft_patches, gathered, guess_undeclared
from ...grids.topology.detection import find_topology
from ...grids.topology.grid import Grid, Patch
from ...grids.topology.index_space import Window
from ...grids.topology.periodic import find_periodic
from ...grids.topology.periodic_pair import PeriodicPair
from ...grids.topology.topology import NearMiss, Topology
from ...grids.topology.topology import describe as named
from .fit import fit_numbers, show_report
from .meshes import inspect_mesh
from .output import (
    check_outputs,
    counts_text,
    print_lines,
    print_table,
    print_title,
    print_warnings,
    show_spacings,
    spacing_numbers,
    written_json,
)
from .sources import file_of, load_grid


def inspect_grid(
    grid_name: str,  # grid file, fitted model (``.h5``), or ``@`` and the name of a built-in grid
    patches: Path | None,  # declared patches of a grid
    draft: Path | None,  # draft, json: TOML file of patches to start from, and numbers, to write
    json: Path | None,
    reynolds: float | None = None,  # reynolds number per unit of length, for an estimate of y+
    units: str | None = None,  # unit of lengths, if the file does not say it
) -> None:
    """Find the topology of a grid and show it, for a model with the quality of its fit."""
    if file_of(grid_name) and is_mesh(grid_name):
        inspect_mesh(grid_name, patches, draft, json, reynolds, units)
        return
    check_outputs([draft, json], [file_of(grid_name), patches])
    is_model = Path(grid_name).suffix == MODEL
    if is_model and (patches or units):
        what = f"{patches}" if patches else "--units"
        raise InputError(f"{grid_name}: a model has the patches and the unit that it was fitted with; leave {what} out")
    with progress_bar() as progress:
        progress(0.0, "reading")
        model = FittedModel.load(grid_name) if is_model else None
        grid = model.regenerate() if model else load_grid(grid_name, patches, units=units)
        progress(0.5, "topology")
        topology = model.topology if model else find_topology(grid)
        progress(0.9, "walls")
        faces = guess_undeclared(grid, topology)
        guesses, certainties = gathered(faces), how_sure(faces)
        overlap = overlap_text(grid, topology, faces)
        spacings = wall_spacings(_with_guesses(grid, guesses))
    numbers = {**grid_numbers(grid, topology), "walls": spacing_numbers(spacings, reynolds)}
    numbers["overlap"] = overlap or None
    numbers["guesses"] = [_guess_numbers(*guess) for guess in zip(guesses, certainties)]
    if model:
        numbers["fit"] = fit_numbers(model, None)
    with written_json(json, numbers):
        if draft:
            declared = [replace(patch, windows=_boundary_windows(patch, topology)) for patch in grid.patches]
            write_draft(draft, grid, [patch for patch in declared if patch.windows], guesses, certainties)
    show_grid(grid, topology, guesses)
    show_spacings(spacings, reynolds, grid.length_unit)
    if model:
        show_report(model)
    if overlap:
        print_lines([f"{overlap}: 'fit' moves them by one lattice"])
    if draft:
        show_guesses(grid, guesses, certainties)
        print_lines([f"{draft} written: give the faces their names and kinds, then pass it as --patches {draft}"])
    elif guesses:
        print_lines(["undeclared boundary is guessed; --draft FILE.toml shows the guesses and how sure they are"])


def write_draft(
    path: Path,  # file to create or to replace
    grid: Grid,  # the grid
    declared: Sequence[Patch],  # declared, guesses: its patches, and guessed ones
    guesses: Sequence[Patch],
    certainties: Sequence[Certainty],  # how sure each guess is
) -> None:
    """Write a TOML file with the declared patches, and a guess at the rest of the boundary."""
    remarks = {
        patch.name: f"{certainty.level}: {describe(certainty.window, grid)}, {certainty.reason}"
        for patch, certainty in zip(guesses, certainties)
    }
    with replaced_file(path) as part:
        part.write_text(draft_patches(grid, [*declared, *guesses], remarks), encoding="utf-8")


def show_guesses(grid: Grid, guesses: Sequence[Patch], certainties: Sequence[Certainty]) -> None:
    """Print the guesses, their certainty, and the reason for the least certain face of each patch."""
    rows = [
        (patch.name, patch.kind, *sure.n_windows.values(), f"{describe(sure.window, grid)}: {sure.reason}")
        for patch, sure in zip(guesses, certainties)
    ]
    if rows:
        print_lines(["guesses at undeclared boundary, by the number of faces, and the reason for the least sure one:"])
        print_table(["guess", "kind", *SURENESS, "least sure"], rows)
    if "wall" not in {patch.kind for patch in (*grid.patches, *guesses)}:
        print_warnings(["no face looks like a wall, so nothing would move; give one the kind wall in the draft"])


def _with_guesses(grid: Grid, guesses: Sequence[Patch]) -> Grid:
    """The grid with guessed patches, whose names say so."""
    named = (replace(patch, name=f"{patch.name.removesuffix('_guessed')} (guessed)") for patch in guesses)
    return replace(grid, patches=(*grid.patches, *named))


def _guess_numbers(patch: Patch, certainty: Certainty) -> dict:
    """Collect the numbers of a guess for JSON."""
    worst = _place(certainty.window)
    reason = {"reason": certainty.reason, "least_sure": worst}
    return {"name": patch.name, "kind": patch.kind, "sureness": certainty.level, **certainty.n_windows, **reason}


def _boundary_windows(patch: Patch, topology: Topology) -> tuple[Window, ...]:
    """Windows of a declared patch on the boundary: without windows of kind other on which blocks meet."""
    return tuple(face.window for face in topology.boundary if face.patch == patch.name)


def grid_numbers(grid: Grid, topology: Topology) -> dict:
    """Collect the numbers of a grid for JSON; block, face and node numbers are from 1."""
    return {
        "grid": grid.source,
        "units": grid.unit or None,
        "blocks": grid.shapes,
        "block_names": [block.name for block in grid.blocks],
        "n_nodes": grid.n_nodes,
        "n_interfaces": len(topology.interfaces),
        "n_boundary_faces": len(topology.boundary),
        "n_collapsed_faces": len(_collapsed_faces(topology)),
        "n_collapsed_edges": len(topology.collapsed) - len(_collapsed_faces(topology)),
        "n_segments": len(topology.segments),
        "periodic": [
            {
                "motion": str(pair.motion),
                "declared": pair in grid.periodic,
                "sides": [[_place(window) for window in side] for side in (pair.windows, pair.others)],
            }
            for pair in _periodic(grid, topology)
        ],
        "near_misses": [_miss_numbers(miss) for miss in topology.near_misses],
        "joined_gaps": [_miss_numbers(miss) for miss in topology.joined_gaps],
        "patches": [
            {"name": patch.name, "kind": patch.kind, "windows": [_place(window) for window in patch.windows]}
            for patch in grid.patches
        ],
        "warnings": topology.warnings,
    }


def _miss_numbers(miss: NearMiss) -> dict:
    """Collect the numbers of a near miss for JSON."""
    other = _place(miss.other) if miss.other else None
    return {**_place(miss.window), "other": other, "gap": miss.gap, "spacing": miss.spacing}


def show_grid(grid: Grid, topology: Topology, guesses: Sequence[Patch]) -> None:
    """Print blocks, boundary faces, declared and guessed, interfaces and what looks wrong."""
    said = f", unit of length: {grid.unit}" if grid.unit else ""
    print_title(f"{grid.source}: {counted(len(grid.blocks), 'block')}, {counted(grid.n_nodes, 'node')}{said}")
    columns = ["block", "nodes", "interfaces", "boundary", "collapsed", "name"]
    print_table(columns, _block_rows(grid, topology))
    print_table(["patch", "kind", "faces", "where"], _patch_rows(grid, topology, guesses))
    print_lines(
        [
            f"{counted(len(topology.interfaces), 'interface')}, {counted(len(topology.boundary), 'boundary face')}, "
            f"{counted(len(_collapsed_faces(topology)), 'collapsed face')}, "
            f"{counted(len(topology.near_misses), 'near miss', 'near misses')}"
        ]
    )
    print_lines([_describe_pair(pair, grid) for pair in _periodic(grid, topology)])
    print_lines([_describe_miss(miss, grid) for miss in topology.near_misses], style="yellow")
    print_warnings(topology.warnings)


def describe(window: Window, grid: Grid) -> str:
    """Name a face window: block, face and, if it covers only a part, the node ranges from 1."""
    return named(window, grid.shapes[window.block])


def _periodic(grid: Grid, topology: Topology) -> tuple[PeriodicPair, ...]:
    """Pairs of periodic windows: declared in the file, and found if nobody declared a kind."""
    declared = [window for pair in grid.periodic for window in (*pair.windows, *pair.others)]
    windows = (face.window for face in topology.boundary if face.kind in (None, "other"))
    bare = [window for window in windows if not any(other.contains(window) for other in declared)]
    return (*grid.periodic, *find_periodic(grid, bare))


def _describe_pair(pair: PeriodicPair, grid: Grid) -> str:
    """Say which faces are periodic, and by which motion."""
    one, other = (" with ".join(describe(window, grid) for window in side) for side in (pair.windows, pair.others))
    how = "as the file declares" if pair in grid.periodic else "it seems"
    return f"periodic, {how}: {one} and {other}, by a {pair.motion}"


def _describe_miss(miss: NearMiss, grid: Grid) -> str:
    """Say which faces nearly meet, and how far apart they are."""
    other = f" and {describe(miss.other, grid)}" if miss.other else ""
    return (
        f"near miss: {describe(miss.window, grid)}{other} are {miss.gap:.3g} {grid.length_unit} apart where "
        f"cells are {miss.spacing:.3g} {grid.length_unit}; if they belong together, make their nodes coincide"
    )


def _block_rows(grid: Grid, topology: Topology) -> list[tuple]:
    """One row per block: its nodes, and counts of its interfaces, boundary and collapsed windows."""
    sides = [side.block for interface in topology.interfaces for side in (interface.a, interface.b)]
    boundary = [face.window.block for face in topology.boundary]
    collapsed = [window.block for window in topology.collapsed]
    rows = []
    for b, block in enumerate(grid.blocks):
        counts = (blocks.count(b) for blocks in (sides, boundary, collapsed))
        rows.append((b + 1, counts_text(block.shape), *counts, block.name))
    return rows


def _patch_rows(grid: Grid, topology: Topology, guesses: Sequence[Patch]) -> list[tuple]:
    """One row per declared patch, one for the interfaces it covers, and one per guess at undeclared faces."""
    sides = [side for interface in topology.interfaces for side in (interface.a, interface.b)]
    rows = []
    for patch in grid.patches:
        met = tuple(window for window in patch.windows if any(window.overlaps(side) for side in sides))
        rows += [(patch.name, patch.kind, _boundary_windows(patch, topology)), (patch.name, "interface", met)]
    rows += [(patch.name, f"{patch.kind}, guessed", patch.windows) for patch in guesses]
    return [(name, kind, len(ws), ", ".join(describe(w, grid) for w in ws)) for name, kind, ws in rows if ws]


def _collapsed_faces(topology: Topology) -> list[Window]:
    """Collapsed windows that are flat in one direction of their block, not edges."""
    n_flat = [
        sum(n > 1 and lo == hi for n, lo, hi in zip(topology.shapes[window.block], window.lo, window.hi))
        for window in topology.collapsed
    ]
    return [window for window, n in zip(topology.collapsed, n_flat) if n == 1]


def _place(window: Window) -> dict:
    """Collect block and ranges of a window, from 1, for JSON."""
    return {"block": window.block + 1, "lo": [n + 1 for n in window.lo], "hi": [n + 1 for n in window.hi]}
