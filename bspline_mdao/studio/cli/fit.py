"""The command ``fit``: a fit, its report and its numbers."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ...base.numerics.processes import on_first, world
from ...base.numerics.progress import progress_bar
from ...base.text import counted
from ...core.background.fit_mesh import mesh_of_blocks, read_marked_mesh
from ...core.evaluation.spline_validity import certify_splines
from ...core.fit.fitting import fit_blocks, fit_grid
from ...core.mesh.boundary import symmetry_planes
from ...core.model.fitted_blocks import FittedBlocks
from ...core.model.fitted_model import FittedModel
from ...core.model.records import CANDIDATES, Fallback, FitReport
from ...errors import FitWarning, InputError
from ...grids.cells.certificate import Certificate
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.io.formats import MODEL
from ...grids.io.marker_guess import MarkerGuess
from ...grids.io.marker_kinds import doubtful_kinds
from ...grids.io.meshes.blocks import marked_grid
from ...grids.io.meshes.files import is_mesh
from ...grids.io.patch_guess import may_overlap, overlap_of
from ...grids.topology.detection import find_topology
from ...grids.topology.grid import Grid
from ...grids.topology.periodic_ties import sides_of
from ...grids.topology.stored_grid import StoredGrid
from ...grids.topology.topology import Topology
from .mesh_fit import asked_settings, fit_mesh
from .output import (
    MEANING_OF_INVALID,
    certificate_numbers,
    check_outputs,
    counts_text,
    print_lines,
    print_table,
    print_title,
    print_warnings,
    show_certificate,
    written_json,
)
from .sources import file_of, load_grid, stored_grid
from .words import PROGRAM

KEPT = "the model keeps what its splines miss: unmoved, it gives the grid that was read"
"""Remark on the errors of a fit, which are not errors of the grid."""


def fit_model(
    grid_name: str,  # file, or ``@`` and the name of a built-in grid
    output: Path,  # output, json: model and numbers to write
    json: Path | None = None,
    *,
    patches: Path | None = None,  # patches of the grid
    # control points per direction by number or name of a block; key None: of all others
    n_control: dict[str | None, tuple[int, int, int]] | None = None,
    order: int | None = None,  # order of the B-splines
    correct: int = 0,  # cycles of parameter correction
    # method, parametrization: how control points and parameters are found, see `bspline_mdao.fit_grid`
    method: str = "valid",
    parametrization: str = "chord_length",
    # no_residual, no_wall_layer: do not keep the residual; do not let nodes near walls follow them
    no_residual: bool = False,
    no_wall_layer: bool = False,
    no_certify: bool = False,  # do not prove which elements of the splines are valid everywhere
    units: str | None = None,  # unit of lengths, if the file does not say it
    lattice: bool | None = None,  # move all blocks by one background lattice; by default if they overlap
    # for such a lattice: width of the spans around walls (m), and how many each body has
    spacing: float | None = None,
    spans: float | None = None,
    moves: Sequence[str] = (),  # deformations for which such a lattice is refined
) -> None:
    """Fit a grid, write the model and show the quality of the fit."""
    # Each of several processes reads, fits and writes whole blocks.
    comm = world()
    check_outputs([output, json], [file_of(grid_name), patches], comm)
    if output.suffix != MODEL:
        raise InputError(f"{output}: a fitted model is an HDF5 file; name it .h5")
    if lattice and not file_of(grid_name):
        raise InputError(f"{grid_name}: is not in a file, but --lattice writes moved nodes into one; leave it out")
    is_bare = bool(file_of(grid_name)) and is_mesh(grid_name)
    if is_bare and lattice is False:
        raise InputError(f"{grid_name}: is an unstructured mesh, which a lattice moves; leave out --no-lattice")

    def lay(read: Callable[[], tuple[MixedMesh, dict[str, MarkerGuess]]]) -> None:
        """Build a lattice around the mesh that is read."""
        fit_mesh(grid_name, output, json, read, asked_settings(spacing, spans), moves)

    def read_marked() -> tuple[MixedMesh, dict[str, MarkerGuess]]:
        """Read the mesh, and warn of kinds that may be why its lattice is refused."""
        mesh, kinds = read_marked_mesh(grid_name, patches, units)
        if is_bare:
            print_warnings(doubtful_kinds(mesh, patches))
        return mesh, kinds

    if lattice or is_bare:
        on_first(comm, lambda: lay(read_marked))
        return
    with progress_bar() as progress:
        progress(0.0, "reading")
        grid: Grid | StoredGrid
        grid = (
            load_grid(grid_name, patches, units=units)
            if comm.size == 1
            else stored_grid(grid_name, patches, comm, units=units)
        )
        topology = find_topology(grid, comm)
    is_asked = lattice is None and bool(file_of(grid_name)) and may_overlap(grid, topology)
    if is_asked and on_first(comm, lambda: _fit_overlapping(grid, topology, grid_name, patches is not None, lay)):
        return
    for name, value in (("spacing", spacing), ("spans", spans), ("for", moves or None)):
        if value is not None:
            raise InputError(f"{grid_name}: is a grid of blocks; --{name} needs --lattice")
    options: dict[str, Any] = {
        "n_control": n_control,
        "order": order,
        "corrections": correct,
        "keep_residual": not no_residual,
        "wall_layer": not no_wall_layer,
        "method": method,
        "parametrization": parametrization,
    }
    with progress_bar() as progress, warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)  # it is in the report
        _warn_of_patches(grid, grid_name)
        model: FittedModel | FittedBlocks
        if isinstance(grid, Grid):
            model = fit_grid(grid, topology=topology, progress=progress, **options)
        else:
            model = fit_blocks(grid, comm, topology=topology, progress=progress, **options)
    show_report(model)
    sys.stdout.flush()  # the kernels of the proof take longest to compile
    certificate = None
    if not no_certify:
        with progress_bar() as progress:
            progress(-1.0, "validity")
            certificate = on_first(comm, lambda: splines_certificate(model))
    with written_json(json, fit_numbers(model, certificate), comm):
        model.save(output)
    show_written(model, output, certificate)
    if isinstance(model, FittedModel):
        _warn_of_planes(model)


def _fit_overlapping(
    grid: Grid | StoredGrid,
    topology: Topology,
    grid_name: str,
    are_declared: bool,  # whether a file declares its patches
    lay: Callable[[Callable[[], tuple[MixedMesh, dict[str, MarkerGuess]]]], None],  # builds a lattice
) -> bool:
    """Fit blocks by one lattice if they are overlapping component grids; return whether they are."""
    grid = grid.grid() if isinstance(grid, StoredGrid) else grid
    overlap = overlap_of(grid, topology)
    if overlap:
        print_lines([f"{grid_name}: {overlap}: one lattice moves them; --no-lattice fits each block instead"])
        lay(lambda: mesh_of_blocks(grid_name, marked_grid(grid, topology, are_declared)))
    return bool(overlap)


def splines_certificate(model: FittedModel | FittedBlocks) -> Certificate:
    """What is proved about the splines of a model."""
    return Certificate((), certify_splines(model.mesh, model.control_points, model.topology.segment_names))


def _warn_of_patches(grid: Grid | StoredGrid, grid_name: str) -> None:
    """Warn before the fit of what its model will not allow, if no patch is a wall."""
    if not grid.patches:
        print_warnings(
            [
                f"{grid_name} has no patches: the model can be refined, but there is no design surface to move and no "
                f"wall for flows, heights of first cells and measures of the surface. Write patches by '{PROGRAM} "
                f"inspect {grid_name} --draft patches.toml', and fit with --patches patches.toml"
            ]
        )
    elif all(patch.kind != "wall" for patch in grid.patches):
        names = ", ".join(patch.name for patch in grid.patches)
        print_warnings(
            [
                f"no patch of {grid_name} is a wall ({names}): 'move' will need --design PATCH, and flows and heights "
                f"of first cells will find nothing; give the body the kind wall in a file for --patches"
            ]
        )


def _warn_of_planes(model: FittedModel) -> None:
    """Warn of patches of symmetry that are not plane, such as a far field that was declared so; moves refuse them."""
    try:
        symmetry_planes(model)
    except InputError as error:
        print_warnings([str(error)])


def fit_numbers(model: FittedModel | FittedBlocks, certificate: Certificate | None) -> dict:
    """Collect the numbers of a fit for JSON."""
    report, fallback = model.report, model.report.fallback
    return {
        "grid": model.header.source,
        "n_nodes": report.n_nodes,
        "n_control_points": report.n_control_points,
        "rms": report.rms,
        "relative_rms": report.relative_rms,
        "max_error": report.max_error,
        "blocks": [
            {"name": block.name, "nodes": shape, "n_control": counts, "rms": block.rms, "max_error": block.max_error}
            for block, shape, counts in zip(report.blocks, model.topology.shapes, _counts(model))
        ],
        "worst_node": vars(report.worst),
        "worst_local": report.worst_local and vars(report.worst_local),
        "worst_on_walls": report.worst_on_walls and vars(report.worst_on_walls),
        "n_invalid_control_elements": report.n_invalid,
        "invalid_control_elements": [vars(element) for element in report.invalid],
        "certificate": certificate and certificate_numbers(certificate),
        "method": model.settings.method,
        "raised": report.raised and vars(report.raised),
        "fallback": fallback and {**vars(fallback), "n_points": dict(zip(CANDIDATES, fallback.n_points))},
        "factor_bytes": report.factor_bytes,
        "periodic": [
            {"markers": list(sides_of(model.topology, tied)), "motion": str(tied.motion)}
            for tied in model.topology.periodic
        ],
        "seconds": report.seconds,
        "warnings": report.warnings,
    }


def show_fit(model: FittedModel | FittedBlocks, output: Path, certificate: Certificate | None) -> None:
    """Print the report of a fit, what is proved and what was written."""
    show_report(model)
    show_written(model, output, certificate)


def show_written(model: FittedModel | FittedBlocks, output: Path, certificate: Certificate | None) -> None:
    """Print what is proved about a fit and what was written."""
    report = model.report
    if certificate is not None:
        show_certificate(certificate)
    print_lines([f"{output} written, {report.seconds:.2f} s"])
    print_warnings(report.warnings)
    if report.n_invalid:
        print_lines([MEANING_OF_INVALID])


def show_report(model: FittedModel | FittedBlocks) -> None:
    """Print the errors and sizes of a fit."""
    report, worst, unit = model.report, model.report.worst, model.header.length_unit
    sizes = f"{counted(report.n_nodes, 'node')}, {counted(report.n_control_points, 'control point')}"
    print_title(f"{model.header.source}: {sizes}")
    rows = [
        (number, counts_text(shape), " + ".join(map(counts_text, counts)), math.hypot(*block.rms), *block.max_error)
        for number, (block, shape, counts) in enumerate(zip(report.blocks, model.topology.shapes, _counts(model)), 1)
    ]
    print_table(["block", "nodes", "control points", f"RMS ({unit})", "max x", "max y", "max z"], rows)
    print_lines(
        [
            f"RMS error {report.rms:.3e} {unit}, which is {report.relative_rms:.2e} of the mean cell edge; "
            f"largest in x, y, z: {', '.join(f'{error:.3e}' for error in report.max_error)} {unit}",
            f"worst node: block {worst.block}, ({worst.i}, {worst.j}, {worst.k}), {worst.error:.3e} {unit}",
            *_local_lines(report),
            *([] if model.residual is None else [KEPT]),
            *(
                f"control points of {' and '.join(sides_of(model.topology, tied))} move alike: a {tied.motion} maps "
                f"one onto the other"
                for tied in model.topology.periodic
            ),
        ]
    )
    if report.raised is not None:
        print_lines(
            [
                f"control points were added along poorly fitted grid lines: {report.raised.n_control_points:,} of "
                f"them would miss up to {report.raised.in_widths:.3g} widths of cells"
            ]
        )
    if report.fallback is not None:
        print_lines(_fallback_lines(report, report.fallback, unit))
    if report.factor_bytes:
        size = f"{report.factor_bytes / 1e9:.2g} GB"
        print_lines([f"moving it by elasticity takes factors of {size} each; derivatives keep one for every increment"])


def _local_lines(report: FitReport) -> list[str]:
    """Say where the error is largest relative to the width of the cells."""
    places = {"anywhere": report.worst_local, "on walls": report.worst_on_walls}
    found = [f"{where} {error}" for where, error in places.items() if error]
    return [f"largest by the width of the cells there: {'; '.join(found)}"] if found else []


def _fallback_lines(report: FitReport, fallback: Fallback, unit: str) -> list[str]:
    """Say what the control points are, and the errors of least squares."""
    counts = ", ".join(f"{n:,} {name.replace('_', ' ')}" for name, n in zip(CANDIDATES, fallback.n_points) if n)
    lines = [f"control points, by what most of each is: {counts}"]
    if fallback.least_squares_rms is not None and fallback.least_squares_invalid is not None:
        lines.append(
            f"least squares alone leave {counted(fallback.least_squares_invalid, 'invalid element')}, RMS error "
            f"{fallback.least_squares_rms:.3e} {unit}, largest {fallback.least_squares_max:.3e} {unit}; "
            f"{fallback.n_moved:,} of {report.n_control_points:,} control points are placed otherwise to avoid these"
        )
    return lines


def _counts(model: FittedModel | FittedBlocks) -> list[list[tuple[int, int, int]]]:
    """Control points per direction of the segments of each block."""
    counts: list[list] = [[] for _ in model.topology.shapes]
    for segment, volume in zip(model.topology.segments, model.mesh.volumes):
        counts[segment.block].append(volume.n_control)
    return counts
