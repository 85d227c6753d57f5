"""The command ``move`` for unstructured meshes, and cures of a move that inverts cells."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...base.numerics.progress import progress_bar
from ...base.numerics.stopwatch import working_seconds
from ...base.text import counted
from ...core.background.end_planes import INNER
from ...core.background.lattice_settings import LatticeSettings
from ...core.background.mesh_map import MeshState
from ...core.background.mesh_model import MeshModel
from ...core.background.open_mesh_file import open_mesh_file
from ...core.cad.files import SUFFIXES
from ...core.design.deformation_warnings import section_warnings
from ...core.design.named_deformations import parse_deformation
from ...core.movement.mover import Movement
from ...errors import InputError, MovementError
from ...grids.cells.overlap_change import OverlapChange
from ...grids.io.meshes.blocks import BlockMeshFile
from .cures import Trial, try_each, verdict
from .mesh_fit import lattice_numbers, other_lattice, show_lattice
from .mesh_periodic import gap_lines, side_numbers, split_lines
from .move import MoveOptions, write_points
from .moved_cells import MovedCells
from .moved_mesh import MovedMesh
from .movers import MoverOptions
from .output import check_outputs, print_lines, print_title, print_warnings, written_json
from .remarks import show_remarks, still_lines
from .units import unit_warnings

__all__ = ["move_mesh"]

OTHERS = (0.5, 1.5, 2.25)
"""Divisors of the lattice spacing to try if cells are inverted, the cheapest first."""


@dataclass(frozen=True, eq=False)
class _Moved:
    """A mesh that was moved, and what is reported about it."""

    model: MeshModel
    surface: np.ndarray
    movement: Movement
    state: MeshState
    mesh: MovedMesh
    seconds: float
    overlap: OverlapChange | None = None  # of a grid of blocks
    split: tuple[float, str] = (0.0, "")  # largest difference of the deformation between periodic copies, and where
    n_inverted_before: int = 0  # cells that the lattice of the model inverted, if it was refined for the move

    @property
    def size(self) -> float:
        """Diagonal of the box around the mesh (m)."""
        return float(np.linalg.norm(np.ptp(self.model.mesh.points, axis=0)))

    @property
    def periodic(self) -> list[dict]:
        """Its periodic sides before and after."""
        return side_numbers(self.model.periodic, self.model.mesh, self.state.nodes)

    @property
    def sliding_off(self) -> float | None:
        """Largest distance (m) of sliding nodes from their surfaces; None if none slide."""
        nodes = self.model.sliding_nodes
        return None if nodes is None else nodes.off(self.state.nodes)

    @property
    def cells(self) -> MovedCells:
        """Its cells before and after."""
        return self.mesh.cells


def move_mesh(
    model_file: Path,  # model of a mesh
    output: Path,  # output, json: mesh and numbers to write
    json: Path | None,
    options: MoveOptions,  # deformation and how to move
) -> None:
    """Deform the walls of a mesh, move the mesh behind them and write it."""
    _refuse_others(model_file, options)
    with progress_bar() as progress:
        progress(0.0, "reading")
        model = MeshModel.load(model_file)
        files: list[Path | str] = [model_file, Path(model.mesh_file), *filter(os.path.isfile, options.deform)]
        check_outputs([output, json, options.surface], files)
        file = open_mesh_file(model, output)
        progress(0.4, "moving")
        moved = _move(model, options, with_remarks=True)
        if len(moved.cells.newly_inverted) and not options.allow_invalid:
            progress(0.6, "refining the lattice")
            print_lines(["the move inverts cells; trying the lattice refined for it"])
            refined = _refined(moved, options)
            if refined is None:
                progress(0.7, "searching for a cure")
                raise MovementError(_complaint(moved, _trials(model, options)))
            moved = refined
        if isinstance(file, BlockMeshFile):
            moved = replace(moved, overlap=_overlap(model, file, moved.state.nodes))
        progress(0.9, "writing")
        with written_json(json, _numbers(model_file, output, moved, options)):
            if options.surface:
                write_points(options.surface, moved.surface)
            file.write(output, moved.state.nodes)
    _show(output, moved)


def _refuse_others(model_file: Path, options: MoveOptions) -> None:
    """Refuse options that only apply to grids of blocks."""
    given = [f"--{name}" for name in ("slide", "fix", "release") if getattr(options, name)]
    if options.mover != MoverOptions():
        given.append("--mover and its settings")
    if options.surface is not None and options.surface.suffix.lower() in SUFFIXES:
        given.append(f"--surface {options.surface}")
    if given:
        raise InputError(
            f"{model_file}: is moved by the lattice around it, and has no control mesh; leave out "
            f"{', '.join(given)}. Markers are what --patches of 'fit' says they are"
        )


def _move(model: MeshModel, options: MoveOptions, with_remarks: bool = False) -> _Moved:
    """Make the move and measure it."""
    start = working_seconds()
    mesh = model.design_mesh(options.design or None)
    deformation = parse_deformation(options.deform, model, mesh)
    is_section = model.mesh.n_copies > 1
    if with_remarks:
        show_remarks(deformation, model, is_section)
    surface = model.deformed(deformation)
    movement = model.mover_of(mesh).move(model.control_points, surface)
    state = model.node_map.at(movement.points)
    seconds = working_seconds() - start
    judged = MovedMesh.of(model, movement.points, state.nodes, is_proved=not options.no_certify)
    split = model.split_copies(deformation)
    if is_section and section_warnings(deformation):
        split = 0.0, ""  # its planes are of no file
    return _Moved(model, surface, movement, state, judged, seconds, None, split)


def _overlap(model: MeshModel, file: BlockMeshFile, nodes: np.ndarray) -> OverlapChange:
    """Motion of the fringes of component grids in the cells of others."""
    markers = model.mesh.markers or {}
    faces = [faces.ravel() for name, faces in markers.items() if model.kinds.get(name) == INNER]
    return OverlapChange.of(file.grid, model.mesh, np.unique(np.concatenate([np.zeros(0, dtype=int), *faces])), nodes)


def _refined(moved: _Moved, options: MoveOptions) -> _Moved | None:
    """The same move by a lattice refined for it; None if that inverts cells as well, or is the same."""
    model = moved.model
    walls = model.mesh.points[model.wall_rows].copy()
    walls[model.design_mesh(options.design or None).surface_ids] = moved.surface
    try:
        refined = model.refined_for([walls])
        if refined is model:
            return None
        again = _move(refined, options)
    except MovementError:
        return None
    if len(again.cells.newly_inverted):
        return None
    return replace(again, n_inverted_before=len(moved.cells.newly_inverted))


def _trials(model: MeshModel, options: MoveOptions) -> list[Trial]:
    """Try coarser and finer lattices, until one inverts no cell."""

    def n_inverted(settings: LatticeSettings) -> int:
        return len(_move(model.with_settings(settings), options).cells.newly_inverted)

    return try_each((other_lattice(model.settings, part) for part in OTHERS), n_inverted)


def _complaint(moved: _Moved, trials: Sequence[Trial]) -> str:
    """Say which cells are inverted, and what cures it."""
    mesh, cells, worst = moved.model.mesh, moved.cells, moved.cells.worst
    new = counted(len(cells.newly_inverted), "cell")
    faces, cell_of_face = mesh.cell_faces
    place = mesh.points[mesh.stored_ids(faces[cell_of_face == worst])].mean(axis=0)
    split = "".join(f"; {line}" for line in _split_lines(moved))
    return (
        f"the move inverts {new} of the mesh, the worst is number {worst + 1} at "
        f"({', '.join(f'{x:.4g}' for x in place)}), of {cells.size_of_worst}; nothing was written; {verdict(trials)}, "
        f"or --allow-invalid to see it{split}"
    )


def _numbers(model_file: Path, output: Path, moved: _Moved, options: MoveOptions) -> dict:
    """Collect the numbers of a move for JSON."""
    model = moved.model
    return {
        "model": str(model_file),
        "mesh": str(output),
        "deform": options.deform,
        **lattice_numbers(model),
        "n_inverted_before_refining": moved.n_inverted_before,
        "largest_displacement": float(np.linalg.norm(moved.state.nodes - model.mesh.points, axis=1).max()),
        "digits": moved.movement.report.digits,
        **moved.mesh.numbers(),
        "periodic": moved.periodic,
        "sliding_off": moved.sliding_off,
        "overlap": moved.overlap and vars(moved.overlap),
        "seconds": moved.seconds,
    }


def _show(output: Path, moved: _Moved) -> None:
    """Print the report of a move."""
    model = moved.model
    mesh = model.mesh
    print_title(f"{mesh.source}: {counted(mesh.n_stored, 'node')}, {counted(mesh.n_cells, 'cell')}")
    largest = np.linalg.norm(moved.state.nodes - mesh.points, axis=1).max()
    print_lines([f"nodes moved by up to {largest:.3g} {mesh.length_unit}"])
    show_lattice(model)
    if moved.n_inverted_before:
        inverted = counted(moved.n_inverted_before, "cell")
        print_lines([f"refined for this move, since the lattice of the model inverted {inverted}; 'fit --for' does it"])
    moved.mesh.show()
    print_lines(gap_lines(moved.periodic, mesh.length_unit))
    if moved.sliding_off is not None:
        print_lines([f"nodes that slide leave their surfaces by {moved.sliding_off:.2g} {mesh.length_unit} at most"])
    if moved.overlap is not None:
        print_lines(moved.overlap.lines())
    print_lines([f"{output} written, {moved.seconds:.2f} s for the move"])
    print_warnings(
        [*still_lines(largest, moved.size), *unit_warnings(output, mesh), *moved.mesh.warnings(), *_split_lines(moved)]
    )


def _split_lines(moved: _Moved) -> list[str]:
    """Say whether walls that end on both periodic sides were to move differently there."""
    off, where = moved.split
    return split_lines(off, moved.size, moved.model.mesh.length_unit, f"{where}, which moves as its copy does")
