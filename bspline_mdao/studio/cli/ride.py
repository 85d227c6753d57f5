"""The command ``ride``: a mesh that was not fitted moves with the control mesh of a model."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...base.numerics.progress import progress_bar
from ...base.numerics.stopwatch import working_seconds
from ...base.text import counted
from ...core.design.deformation import Deformation
from ...core.design.named_deformations import PrescribedPoints, read_points
from ...core.mesh.boundary import boundary_points, moving_mesh, wall_patches
from ...core.mesh.surface import SurfaceGrid
from ...core.model.fitted_model import FittedModel
from ...core.riding.riding_mesh import EmbeddedMesh, EmbeddedMeshState
from ...core.riding.section_span import section_span
from ...core.riding.wall_faces import GridBoundary
from ...core.sliding.sliding_nodes import Slide
from ...errors import InputError, MovementError
from ...grids.io.meshes.files import check_same_format, read_mesh
from ...grids.topology.grid import MAX_COORDINATE
from ...grids.topology.periodic_gap import PeriodicGap, periodic_gaps
from ...names import CONTROL_POINTS
from .cures import Trial, try_cures, verdict
from .move import MoveOptions, gap_numbers, moved_control_mesh
from .moved_cells import MovedCells
from .movers import MoverOptions
from .output import check_outputs, print_lines, print_title, print_warnings, written_json

CASES = ".sql"
"""Suffix of case files of OpenMDAO."""


@dataclass(frozen=True)
class RideOptions:
    """Options of the command ``ride``."""

    deform: tuple[str, ...] = ()  # deformations of the design surface, in order
    to: Path | None = None  # control points to follow instead
    wall: tuple[str, ...] = ()  # wall markers of the mesh; by default those on walls of the grid
    tolerance: float | None = None  # distance up to which nodes may be outside the grid (m)
    hold_outside: bool = False  # fix nodes that are farther outside
    # design, slide, fix, release: as in ``move``
    design: tuple[str, ...] = ()
    slide: tuple[str, ...] = ()
    fix: tuple[str, ...] = ()
    release: tuple[str, ...] = ()
    allow_invalid: bool = False  # write a mesh with inverted cells anyway
    mover: MoverOptions = field(default_factory=MoverOptions)  # mover and its settings


@dataclass(frozen=True, eq=False)
class _MovedMesh:
    """A mesh that was moved along, and what is reported about it."""

    mesh: EmbeddedMeshState
    cells: MovedCells
    gaps: tuple[PeriodicGap, ...]
    seconds: float


def ride_along(
    model_file: Path,  # model_file, mesh_file: fitted model, and the mesh
    mesh_file: Path,
    output: Path,  # output, json: mesh and numbers to write
    json: Path | None,
    options: RideOptions,  # deformation and how to move
) -> None:
    """Move the control mesh of a model, move a mesh along and write it."""
    check_outputs([output, json], [model_file, mesh_file, options.to, *filter(os.path.isfile, options.deform)])
    check_same_format(mesh_file, output)
    if bool(options.deform) == (options.to is not None):
        raise InputError("ride: no target is given; give either --deform or --to")
    with progress_bar() as progress:
        progress(0.0, "reading")
        model = FittedModel.load(model_file)
        file = read_mesh(mesh_file, section_span(model))
        start = working_seconds()
        progress(0.1, "looking for the nodes in the volumes")
        mesh = replace(file.mesh, unit=model.header.length_unit)
        riding = EmbeddedMesh.of(model, mesh, options.wall, options.tolerance, options.hold_outside)
        progress(0.6, "moving")
        found = _measured(model, *_state(model, model_file, riding, options, with_remarks=True), start)
        if len(found.cells.newly_inverted) and not options.allow_invalid:
            trials = _trials(model, model_file, riding, options) if options.to is None else []
            raise MovementError(_complaint(found, trials))
        progress(0.9, "writing")
        with written_json(json, ride_numbers(model_file, mesh_file, output, found, options)):
            file.write(output, found.mesh.nodes)
    show_ride(output, found, model.header.length_unit)
    print_warnings(_warnings(found))


def _state(
    model: FittedModel, model_file: Path, riding: EmbeddedMesh, options: RideOptions, with_remarks: bool = False
) -> tuple[EmbeddedMeshState, np.ndarray]:
    """Move the mesh; return the control points as well."""
    if options.to is not None:
        points = _known_points(options.to, model)
        if options.slide:
            mesh = moving_mesh(model, options.design or None, options.fix, options.release, options.slide)
            riding = riding.with_slides(model, mesh.slides)
        return riding.at(points), points
    chosen = {name: getattr(options, name) for name in ("deform", "design", "slide", "fix", "release", "mover")}
    control_mesh, deformation, _, movement = moved_control_mesh(model, model_file, MoveOptions(**chosen), with_remarks)
    riding = riding.with_slides(model, control_mesh.slides)
    state = riding.at(movement.points)
    if not riding.n_asked or any(isinstance(part, PrescribedPoints) for part in deformation.maps):
        return state, movement.points
    asked = _asked(model, riding, state.nodes, deformation, options.design)
    return riding.at(movement.points, asked), movement.points


def _known_points(path: Path, model: FittedModel) -> np.ndarray:
    """Control points from a file."""
    if path.suffix.lower() != CASES:
        return read_points(path, model.mesh.n_control_points)
    from ...core.om.drivers.case_history import read_history

    history = read_history(path)
    names = sorted((name for name in history.outputs if name.rpartition(".")[2] == CONTROL_POINTS), key=len)
    if not names:
        raise InputError(
            f"{path}: no control points are recorded; add '*{CONTROL_POINTS}' to what the driver records "
            f"(recording_options['includes']) and run again"
        )
    cases = history.outputs[names[0]]
    points = cases[history.best if history.best in cases else max(cases)]
    if points.size != model.control_points.size:
        raise InputError(
            f"{path}: has {points.size // 3:,} control points and the model {model.mesh.n_control_points:,}; give the "
            f"model that was optimised"
        )
    if not (np.abs(points) <= MAX_COORDINATE).all():
        raise InputError(f"{path}: {names[0]} of its best case are no coordinates; the file may be damaged")
    return points.reshape(-1, 3)


def _asked(
    model: FittedModel, riding: EmbeddedMesh, points: np.ndarray, deformation: Deformation, design: tuple[str, ...]
) -> np.ndarray:
    """Targets of wall nodes, those on the design surface moved by the deformation."""
    walls, rows = riding.walls, riding.asked_rows
    assert walls is not None
    at_rest, wall, surface = riding.mesh.points[rows], points[rows], SurfaceGrid.of(model, design or None)
    is_design = np.ones(len(wall), dtype=bool)
    if set(surface.patches) != set(wall_patches(model.topology)):
        is_design = GridBoundary.of(model).on_patches(at_rest, set(surface.patches))
    numbers = np.cumsum(is_design) - 1
    planes = []
    for ids, normal in walls.planes:
        on_wall = np.flatnonzero(np.isin(rows, ids))
        planes.append((numbers[on_wall[is_design[on_wall]]], normal))
    wall[is_design] = deformation.apply_to_nodes(at_rest[is_design], planes)
    return wall


def _measured(model: FittedModel, state: EmbeddedMeshState, points: np.ndarray, start: float) -> _MovedMesh:
    """Measure the cells, the heights at walls, and gaps between periodic faces of the grid."""
    mesh, walls = state.of.mesh, state.of.walls
    ratios = np.zeros(0) if walls is None else walls.heights(state.nodes) / walls.heights(mesh.points)
    seconds = working_seconds() - start
    gaps = periodic_gaps(model.topology, model.regenerate(), model.regenerate(points))
    return _MovedMesh(state, MovedCells.of(mesh, state.nodes, ratios), gaps, seconds)


def ride_numbers(model_file: Path, mesh_file: Path, output: Path, found: _MovedMesh, options: RideOptions) -> dict:
    """Collect the numbers of a ride for JSON."""
    of, n_nodes = found.mesh.of, _stored_counts(found.mesh.of)
    return {
        "model": str(model_file),
        "from": str(mesh_file),
        "mesh": str(output),
        "deform": options.deform,
        "to": None if options.to is None else str(options.to),
        "n_nodes": of.mesh.n_stored,
        "n_cells": of.mesh.n_cells,
        "n_held": n_nodes.left,
        "farthest_outside": float(np.delete(of.distances, of.left).max(initial=0.0)),
        "walls": of.wall_names,
        "n_wall_nodes": n_nodes.walls,
        "sliding": [{"patch": slide.what, "surface": str(slide.surface)} for slide in _slides(of)],
        "sliding_off": None if of.sliding is None else of.sliding.nodes.off(found.mesh.nodes),
        "largest_displacement": float(np.linalg.norm(found.mesh.nodes - of.mesh.points, axis=1).max(initial=0.0)),
        **found.cells.numbers(),
        "periodic_gaps": [gap_numbers(gap) for gap in found.gaps],
        "seconds": found.seconds,
    }


def _slides(of: EmbeddedMesh) -> tuple[Slide, ...]:
    """Patches of the grid on which nodes of a mesh slide."""
    return () if of.sliding is None else of.sliding.slides


class _StoredCounts(NamedTuple):
    """Numbers of nodes of the file, each counted once if the mesh has copies of it."""

    left: int
    walls: int
    followers: int


def _stored_counts(of: EmbeddedMesh) -> _StoredCounts:
    """Count nodes of the file that are fixed, on walls, or follow walls."""
    none = np.zeros(0, dtype=np.int64)
    walls = of.asked_rows
    followers = (
        none if of.walls is None else np.concatenate([none, *(piece.rows for piece in of.walls.following.layer.pieces)])
    )
    return _StoredCounts(*(len(of.mesh.stored_ids(ids)) for ids in (of.left, walls, followers)))


def show_ride(output: Path, found: _MovedMesh, unit: str) -> None:
    """Print the report of a ride."""
    of, n_nodes = found.mesh.of, _stored_counts(found.mesh.of)
    in_plane = " in two dimensions" if of.mesh.n_copies > 1 else ""
    print_title(f"{of.mesh.source}: {counted(of.mesh.n_stored, 'node')}, {counted(of.mesh.n_cells, 'cell')}{in_plane}")
    moved = np.linalg.norm(found.mesh.nodes - of.mesh.points, axis=1).max(initial=0.0)
    lines = [f"nodes moved by up to {moved:.3g} {unit}"]
    if of.walls is not None:
        names = ", ".join(of.wall_names) or "none"
        lines.append(f"walls: {names}, {counted(n_nodes.walls, 'node')}, {n_nodes.followers:,} follow them")
    if of.sliding is not None:
        lines += [f"nodes on {slide.what} slide on {slide.surface}" for slide in of.sliding.slides]
        off = of.sliding.nodes.off(found.mesh.nodes)
        lines.append(f"they leave their places over these surfaces by {off:.2g} {unit} at most")
    farthest = float(np.delete(of.distances, of.left).max(initial=0.0))
    left = f"; {counted(n_nodes.left, 'node')} held" if n_nodes.left else ""
    lines.append(f"farthest outside the fitted grid: {farthest:.2g} {unit}{left}")
    print_lines(lines)
    found.cells.show()
    found.cells.show_heights()
    print_lines([f"{output} written, {found.seconds:.2f} s"])


def _trials(model: FittedModel, model_file: Path, riding: EmbeddedMesh, options: RideOptions) -> list[Trial]:
    """Try what may cure a move, releasing first the patches on which the design surface ends."""

    def n_inverted(other: RideOptions) -> int:
        state = _state(model, model_file, riding, other)[0]
        return int((riding.mesh.quality(state.nodes).is_inverted & ~before).sum())

    before = riding.mesh.quality().is_inverted
    mesh = moving_mesh(model, options.design or None, options.fix, options.release, options.slide)
    parts = boundary_points(model.topology, mesh.blocks)
    adjacent = {face.patch: None for face, ids in parts if face.patch and (mesh.surface_rows[ids] >= 0).any()}
    return try_cures(options, model.topology, mesh, list(adjacent), n_inverted)


def _complaint(found: _MovedMesh, trials: Sequence[Trial]) -> str:
    """Say which cells are inverted, and what cures it."""
    cells = found.cells
    new = counted(len(cells.newly_inverted), "cell")
    return (
        f"the move inverts {new} of the mesh, the worst is number {cells.worst + 1}, of {cells.size_of_worst}; nothing "
        f"was written; {verdict(trials)}, or --allow-invalid to see it"
    )


def _warnings(found: _MovedMesh) -> list[str]:
    """List problems of a mesh that was written."""
    of = found.mesh.of
    warnings: list[str] = []
    if of.walls is None:
        warnings.append(
            "no boundary of the mesh lies on a wall of the fitted grid, so no node follows a wall; name its walls "
            "by --wall if it has any"
        )
    return warnings + found.cells.warnings() + [str(gap) for gap in found.gaps]
