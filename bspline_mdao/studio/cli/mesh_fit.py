"""The command ``fit`` for unstructured meshes: the kinds of their markers, and the lattice around them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...base.numerics.progress import progress_bar
from ...base.numerics.stopwatch import working_seconds
from ...base.text import counted
from ...core.background.end_planes import PERIODIC
from ...core.background.lattice_settings import LatticeSettings
from ...core.background.mesh_model import MeshModel
from ...core.background.periodic_sides import find_periodic_sides
from ...core.background.thin_gaps import thin_gaps
from ...core.design.named_deformations import parse_deformation
from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.io.marker_guess import MarkerGuess
from .cures import Trial
from .mesh_periodic import side_numbers
from .meshes import n_unmarked_faces, n_unused_nodes, unmarked_lines, unused_lines
from .output import counts_text, print_lines, print_table, print_title, print_warnings, written_json

__all__ = ["asked_settings", "fit_mesh", "lattice_numbers", "other_lattice", "show_lattice"]

COARSER = 0.5
"""Number of spans, relative to a lattice whose moves invert cells, of another that is tried."""


def fit_mesh(
    mesh_name: str,  # file of the mesh, or OpenFOAM's folder
    output: Path,  # output, json: model and numbers to write
    json: Path | None,
    read: Callable[[], tuple[MixedMesh, dict[str, MarkerGuess]]],  # gives the mesh and its guessed markers
    settings: LatticeSettings,  # of the lattice
    moves: Sequence[str] = (),  # deformations for which it is refined
) -> None:
    """Build a lattice around a mesh, write the model and describe it."""
    with progress_bar() as progress:
        progress(0.0, "reading")
        mesh, kinds = read()
        start = working_seconds()
        progress(0.5, "lattice")
        chosen = {name: guess.kind for name, guess in kinds.items()}
        model = MeshModel.of(mesh, chosen, settings, Path(mesh_name).absolute())
        walls = {text: model.deformed(parse_deformation(text, model, model.moving_mesh)) for text in moves}
        if moves:
            progress(0.55, "refining")
            model = model.refined_for([*walls.values()])
        progress(0.6, "walls")
        model.node_map  # noqa: B018 - refuses what cannot be moved
        inverted = {text: model.n_inverted(each) for text, each in walls.items()}
        cures = coarser_cures(model, {text: walls[text] for text, n in inverted.items() if n})
        seconds = working_seconds() - start
    numbers = {**fit_mesh_numbers(model, kinds, seconds), "n_inverted_by_moves": inverted}
    with written_json(json, numbers):
        model.save(output)
    show_mesh_fit(model, kinds, output, numbers, cures)


def asked_settings(spacing: float | None, spans: float | None) -> LatticeSettings:
    """Settings of a lattice by the options of the command."""
    if spacing is not None and spans is not None:
        raise InputError("--spacing is of all walls, and --spans are of each body; give one of them")
    return LatticeSettings(spacing=spacing, spans=LatticeSettings.spans if spans is None else spans)


def fit_mesh_numbers(model: MeshModel, kinds: Mapping[str, MarkerGuess], seconds: float) -> dict:
    """Collect the numbers of a fit for JSON."""
    markers = [{"name": name, **vars(guess)} for name, guess in kinds.items()]
    counts = {"n_unmarked_faces": n_unmarked_faces(model.mesh), "n_unused_nodes": n_unused_nodes(model.mesh)}
    mesh = {"mesh": model.mesh.source, "markers": markers, **counts}
    periodic = {"periodic": side_numbers(model.periodic, model.mesh)}
    return {**mesh, **lattice_numbers(model), **periodic, "seconds": seconds}


def lattice_numbers(model: MeshModel) -> dict:
    """Collect the numbers of a mesh and its lattice for JSON."""
    mesh = model.mesh
    return {
        "n_nodes": mesh.n_stored,
        "n_cells": mesh.n_cells,
        "dimensions": 2 if mesh.n_copies > 1 else 3,
        "n_wall_nodes": len(mesh.stored_ids(model.wall_rows)),
        "n_nodes_at_rest": len(mesh.stored_ids(model.rows_at_rest)),
        "lattice": list(model.lattice.shape),
        "spacing": model.lattice.spacing,
        "axes": model.lattice.frame.axes.tolist(),
        "is_cylindrical": not model.lattice.frame.is_cartesian,
        "units": mesh.unit or None,
    }


def other_lattice(settings: LatticeSettings, part: float) -> tuple[str, LatticeSettings]:
    """Text to type for a lattice with a multiple of the spans, not refined for moves, and its settings."""
    if settings.spacing:
        spacing = float(f"{settings.spacing / part:.2g}")
        return f"a model by 'fit --spacing {spacing:g}'", replace(settings, spacing=spacing, refined=())
    spans = float(f"{settings.spans * part:.2g}")
    return f"a model by 'fit --spans {spans:g}'", replace(settings, spans=spans, refined=())


def coarser_cures(model: MeshModel, walls: Mapping[str, np.ndarray]) -> dict[str, Trial]:
    """Try a coarser lattice for moves, each with the nodes of walls after it, shape (n_walls, 3)."""
    text, settings = other_lattice(model.settings, COARSER)
    coarser = model.with_settings(settings) if walls else model
    return {move: Trial(text, coarser.n_inverted(each)) for move, each in walls.items()}


def show_mesh_fit(
    model: MeshModel,  # what was fitted
    kinds: Mapping[str, MarkerGuess],  # what was taken for the kinds of markers
    output: Path,  # file of the model
    numbers: dict,  # of the fit, for JSON
    cures: Mapping[str, Trial],  # other lattices, by moves that invert cells
) -> None:
    """Print what was fitted and what was written."""
    mesh, faces = model.mesh, model.mesh.markers or {}
    in_plane = " in two dimensions" if mesh.n_copies > 1 else ""
    said = f", unit of length: {mesh.unit}" if mesh.unit else ""
    print_title(f"{mesh.source}: {counted(mesh.n_stored, 'node')}, {counted(mesh.n_cells, 'cell')}{in_plane}{said}")
    rows = [(name, f"{len(faces[name]):,}", guess.kind, guess.sure, guess.why) for name, guess in kinds.items()]
    print_table(["marker", "faces", "kind", "how sure", "why"], rows)
    print_lines([*unmarked_lines(numbers["n_unmarked_faces"]), *unused_lines(numbers["n_unused_nodes"])])
    unsure = [name for name, guess in kinds.items() if guess.sure == "unsure"]
    show_lattice(model)
    print_lines([f"{output} written, {numbers['seconds']:.2f} s"])
    valid = [text for text, n in numbers["n_inverted_by_moves"].items() if not n]
    if valid:
        print_lines([f"tried {' and '.join(valid)}: no cell of the mesh is inverted"])
    warnings = gap_warnings(model)
    if unsure:
        warnings.append(f"not sure about {', '.join(unsure)}: declare them by --patches FILE.toml if they are not that")
    warnings += inverted_lines(numbers["n_inverted_by_moves"], cures)
    if warnings:
        print_warnings(warnings)


def inverted_lines(inverted: Mapping[str, int], cures: Mapping[str, Trial]) -> list[str]:
    """Say how many cells moves invert with the best of the refined lattices, and what to do."""
    found = []
    for move, cure in cures.items():
        new = counted(inverted[move], "cell")
        is_better = cure.n_inverted is not None and cure.n_inverted < inverted[move]
        better = f"take {cure.text}, which inverts {cure.n_inverted or 'none'}, or " if is_better else ""
        found.append(
            f"{move} inverts {new} of the mesh with this lattice, the best found by refining; {better}deform it less"
        )
    return found


def gap_warnings(model: MeshModel) -> list[str]:
    """Name walls with a gap narrower than the spans of the lattice there."""
    names, unit, found = np.array(model.walls.names), model.mesh.length_unit, []
    local, marker = np.searchsorted(model.wall_rows, model.walls.faces), model.walls.marker
    for gap in thin_gaps(model.lattice, model.mesh.points[model.wall_rows], local):
        first, second = (names[marker[(local == row).any(axis=1)][0]] for row in gap.rows)
        place = ", ".join(f"{x:.4g}" for x in model.mesh.points[model.wall_rows[gap.rows[0]]])
        found.append(
            f"{first} is {gap.width:.3g} {unit} from {second} at ({place}), less than a span of the lattice, "
            f"{gap.span:.3g} {unit}: cells between may be inverted where one moves against the other"
        )
    return found


def show_lattice(model: MeshModel) -> None:
    """Describe the lattice around a mesh."""
    lattice, mesh, unit = model.lattice, model.mesh, model.mesh.length_unit
    resting = len(mesh.stored_ids(model.rows_at_rest))
    about = "" if lattice.frame.is_cartesian else " along the axis, the radius and the angle"
    lines = [
        f"{counted(len(mesh.stored_ids(model.wall_rows)), 'node')} on walls, which move as prescribed; "
        f"{counted(resting, 'node')} at rest on other markers",
        f"lattice of {counts_text(lattice.shape)} control points{about}, the narrowest spans "
        f"{lattice.spacing:.3g} {unit} wide",
    ]
    if model.settings.refined:
        lines.append("refined for moves")
    in_planes = dict.fromkeys(name for plane in model.planes for name in plane.markers)
    lines += [f"nodes of {name} stay in their plane" for name in in_planes]
    lines += [
        f"nodes of {' and '.join(sides.markers)} move alike: a {sides.motion} maps one onto the other"
        for sides in model.periodic
    ]
    lines += [f"nodes of {name} slide on {slide.surface}" for name, slide in model.slides.items()]
    print_lines([*lines, *untied_lines(model, set(in_planes))])


def untied_lines(model: MeshModel, in_planes: set[str]) -> list[str]:
    """Say why periodic sides that stay cannot be tied; sides that stay in planes need not be."""
    tied = {name for sides in model.periodic for name in sides.markers} | in_planes
    untied = [name for name, kind in model.kinds.items() if kind == PERIODIC and name not in tied]
    lines = []
    for sides in find_periodic_sides(model.mesh, model.kinds) if untied else ():
        if not tied & {*sides.markers}:
            lines.append(
                f"nodes of {' and '.join(sides.markers)} stay: they are copies by a {sides.motion}, which is along no "
                f"direction of the lattice, or differs from that of others"
            )
            untied = [name for name in untied if name not in sides.markers]
    if untied:
        lines.append(f"nodes of {', '.join(untied)} stay: no shift and no rotation maps these sides onto each other")
    return lines
