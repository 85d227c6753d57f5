"""The command ``quality``: the cells of a grid, and their changes in a move."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np
from h5py import is_hdf5

from ...base.numerics.processes import on_first, together, world
from ...base.numerics.progress import progress_bar
from ...base.text import counted
from ...core.model.fitted_model import FittedModel
from ...core.model.local_model import LocalModel
from ...errors import InputError
from ...grids.cells.certificate import Certificate, certify_cells
from ...grids.cells.curved_grid import CurvedGrid
from ...grids.cells.grid_quality import GridQuality
from ...grids.cells.pieces import Pieces
from ...grids.cells.report import InvertedCell, QualityReport, WorstCell, inverted_cells, report_quality
from ...grids.io.cgns_elements import read_cgns_elements
from ...grids.io.formats import MODEL
from ...grids.io.meshes.files import is_mesh
from ...grids.io.patches import merge_patches, read_patches
from ...grids.topology.detection import find_topology
from ...grids.topology.grid import Block, Grid
from ...grids.topology.index_space import Window
from ...grids.topology.partition import Partition
from ...grids.topology.stored_grid import StoredBlock, StoredGrid
from ...grids.topology.topology import Topology
from .curved import measure_curved
from .mesh_periodic import block_numbers, gap_lines
from .meshes import measure_mesh
from .output import (
    certificate_numbers,
    check_outputs,
    counts_text,
    height_numbers,
    height_warnings,
    print_lines,
    print_table,
    print_title,
    print_warnings,
    show_certificate,
    show_height_ratios,
    show_heights,
    written_json,
)
from .sources import file_of, load_grid, stored_grid

MOST_WORST = 5
"""Number of cells with the smallest corners to print."""

MOST_LISTED = 10
"""Largest number of inverted cells to print."""


def measure_quality(
    # grid file, fitted model (``.h5``), or ``@`` and the name of a built-in grid; or a CGNS file of curved hexahedra,
    # whose Jacobians are measured
    grid_name: str,
    bins: int,  # bins of the distribution of Q
    json: Path | None,  # numbers to write
    patches: Path | None = None,  # declared patches
    # the grid before the move, like ``grid_name``: determines which cells are newly inverted, and the reference of the
    # heights at walls
    baseline: str | None = None,
    units: str | None = None,  # unit of lengths, if the file does not say it
) -> None:
    """Measure the cells of a grid and show the results."""
    # Each of several processes reads and measures a part.
    comm = world()
    check_outputs([json], [file_of(grid_name), patches, baseline and file_of(baseline)], comm)
    curved = on_first(comm, lambda: _curved_of(grid_name))
    if curved is not None:
        if patches or baseline:
            raise InputError(
                f"{grid_name}: has curved hexahedra, which are measured on their own; leave out "
                f"{'--patches' if patches else '--baseline'}"
            )
        measure_curved(grid_name, curved, json, comm)
        return
    if on_first(comm, lambda: bool(file_of(grid_name)) and is_mesh(grid_name)):
        _measure_mesh(grid_name, json, patches, baseline, units, comm)
        return
    with progress_bar() as progress:
        progress(0.0, "reading")
        grid = _read(grid_name, patches, comm, units)
        before = grid if baseline is None else _baseline_of(baseline, grid, grid_name, comm)
        progress(0.5, "cells")
        quality = GridQuality.of_pieces(before.pieces, before.nodes)
        report = report_quality(quality, grid.nodes, bins)
        certificate = Certificate(certify_cells(quality, grid.nodes))
        periodic = _periodic(before, None if baseline is None else grid)
        newly = () if baseline is None else inverted_cells(quality, quality.cells(grid.nodes), newly=True)
    with written_json(json, _numbers(grid_name, baseline, report, certificate, newly) | {"periodic": periodic}, comm):
        pass
    _show(grid_name, baseline, report, certificate, newly, grid.header.length_unit)
    print_lines(gap_lines(periodic, grid.header.length_unit))
    print_warnings(grid.warnings)
    if baseline is not None:
        print_warnings(height_warnings(report.heights))


def _measure_mesh(
    name: str, json: Path | None, patches: Path | None, baseline: str | None, units: str | None, comm: Any
) -> None:
    """Measure an unstructured mesh, by the first process."""
    on_first(comm, lambda: measure_mesh(name, json, patches, baseline, units))


def _curved_of(grid_name: str) -> CurvedGrid | None:
    """Curved hexahedra of a CGNS file; None if a grid is something else."""
    file = file_of(grid_name)
    if file is None or Path(file).suffix == MODEL or not Path(file).is_file() or not is_hdf5(file):
        return None
    return read_cgns_elements(file)


class _Read(NamedTuple):
    """Data of a grid read by a process: all but the nodes, the nodes of its pieces, and errors."""

    header: Any
    partition: Partition
    nodes: np.ndarray
    warnings: tuple[str, ...]
    comm: Any
    topology: Topology

    @property
    def pieces(self) -> Pieces:
        header = self.header
        names = tuple(block.name for block in header.blocks)
        return Pieces(self.partition, names, header.patches, header.source, self.comm)


def _read(grid_name: str, patches: Path | None, comm: Any, units: str | None = None) -> _Read:
    """The grid of a file, or the grid that a fitted model regenerates."""
    is_model = Path(grid_name).suffix == MODEL
    if is_model and units:
        raise InputError(f"{grid_name}: a model has the unit that it was fitted with; leave out --units")
    if comm.size > 1:
        if is_model:
            return _model_in_parts(grid_name, patches, comm)
        return _grid_in_parts(grid_name, patches, comm, units)
    if is_model:
        model = FittedModel.load(grid_name)
        grid, topology = model.regenerate(), model.topology
        grid = read_patches(patches, grid) if patches else grid
    else:
        grid = load_grid(grid_name, patches, is_lifted=patches is not None, units=units)
        topology = find_topology(grid)
    nodes = grid.to_vector().reshape(-1, 3)
    return _Read(grid, Pieces.of_grid(grid).partition, nodes, topology.warnings, comm, topology)


def _model_in_parts(file: str, patches: Path | None, comm: Any) -> _Read:
    """Regenerated nodes of a fitted model on the pieces of this process."""
    subdomain = LocalModel.load(file, comm)
    header, shapes = subdomain.header, subdomain.topology.shapes

    def no_nodes(window: Window | None) -> NoReturn:
        raise InputError(f"{patches}: its connections need the nodes of a grid; give patches as TOML, or one process")

    blocks = (StoredBlock(shape, name, no_nodes) for shape, name in zip(shapes, header.names))
    grid = StoredGrid(tuple(blocks), header.patches, header.source, unit=header.unit)
    with together(comm):
        grid, nodes = read_patches(patches, grid) if patches else grid, subdomain.regenerate()
    topology = subdomain.topology
    return _Read(grid, Partition.of(topology, comm.size), nodes, topology.warnings, comm, topology)


def _grid_in_parts(grid_name: str, patches: Path | None, comm: Any, units: str | None) -> _Read:
    """The nodes of the pieces of this process; the first process reads all of them once, to find the interfaces."""
    grid = stored_grid(grid_name, patches, comm, is_lifted=patches is not None, units=units)
    topology = on_first(comm, lambda: find_topology(grid.grid()))
    partition = Partition.of(topology, comm.size)
    with together(comm):
        parts = [grid.read(piece).nodes.reshape(-1, 3) for piece in partition.pieces[comm.rank]]
    return _Read(grid, partition, np.concatenate([np.zeros((0, 3)), *parts]), topology.warnings, comm, topology)


def _baseline_of(name: str, moved: _Read, grid_name: str, comm: Any) -> _Read:
    """The grid before the move, with the patches of both."""
    baseline = _read(name, None, comm)
    grid, header = moved.header, baseline.header
    if header.shapes != grid.shapes:
        raise InputError(
            f"{grid_name}: its blocks have {_shapes_text(grid)} nodes, the baseline {name} has "
            f"{_shapes_text(header)}; give the grid that was moved"
        )
    return baseline._replace(header=merge_patches(header, grid.patches, grid_name))


def _periodic(before: _Read, after: _Read | None) -> list[dict]:
    """Numbers of the periodic sides of a grid, and of the grid before the move, by the first process."""
    baseline, grid = _whole(before), None if after is None else _whole(after)
    return on_first(before.comm, lambda: block_numbers(before.topology, baseline, grid))


def _whole(read: _Read) -> Any:
    """The whole grid, on the first process."""
    if read.comm.size == 1:
        return read.header
    parts = read.comm.gather(read.nodes)
    if parts is None:
        return None
    nodes = np.empty((read.topology.n_nodes, 3))
    for rank, part in enumerate(parts):
        nodes[read.partition.subdomain(rank).rows] = part
    blocks = zip(read.topology.layout.split(nodes), read.header.blocks)
    named = tuple(Block(of_block, block.name) for of_block, block in blocks)
    return Grid(named, read.header.patches, source=read.header.source, unit=read.header.unit)


def _shapes_text(grid: Grid | StoredGrid) -> str:
    """Write the nodes of the first blocks."""
    shapes = [counts_text(shape) for shape in grid.shapes]
    return ", ".join(shapes[:3]) + (", ..." if len(shapes) > 3 else "")


def _numbers(
    grid_name: str,
    baseline_name: str | None,
    report: QualityReport,
    certificate: Certificate,
    newly: Sequence[InvertedCell],
) -> dict:
    """Collect the numbers of the cells for JSON; cell numbers are from 1."""
    is_compared = baseline_name is not None
    return {
        "grid": grid_name,
        "baseline": baseline_name,
        "heights": height_numbers(report.heights, is_compared=is_compared),
        "newly_inverted": [vars(cell) for cell in newly] if is_compared else None,
        "n_cells": report.n_cells,
        "q_min": report.q_min,
        "q_mean": report.q_mean,
        "n_inverted": report.n_inverted,
        "min_corner": report.min_corner,
        "min_jacobian": report.min_jacobian,
        "min_volume": report.min_volume,
        "inverted": [vars(cell) for cell in report.inverted],
        "certificate": certificate_numbers(certificate),
        "worst": [vars(cell) for cell in report.worst],
        "histogram": {
            "edges": report.histogram.edges.tolist(),
            "density": report.histogram.density.tolist(),
            "n_negative": report.histogram.n_negative,
        },
    }


def _worst_text(cell: WorstCell, unit: str) -> str:
    """Describe a cell and its place."""
    place = ", ".join(f"{x:.4g}" for x in cell.place)
    patch = f", at {cell.patch}" if cell.patch else ""
    return f"{cell}: corner {cell.corner:.3g}, Q {cell.q:.3g}, around ({place}) {unit}{patch}"


def _show(
    grid_name: str,
    baseline_name: str | None,
    report: QualityReport,
    certificate: Certificate,
    newly: Sequence[InvertedCell],
    unit: str,
) -> None:
    """Print the measures of the cells, the first cells at walls, and inverted cells."""
    print_title(f"{grid_name}: {counted(report.n_cells, 'cell')}")
    rows = [
        ("smallest Q", f"{report.q_min:.4g}"),
        ("mean Q", f"{report.q_mean:.4g}"),
        ("smallest corner triple product", f"{report.min_corner:.4g}"),
        ("smallest corner Jacobian", f"{report.min_jacobian:.4g}"),
        (f"smallest volume ({unit}^3)", f"{report.min_volume:.4g}"),
        ("inverted cells", f"{report.n_inverted:,}"),
    ]
    print_table(["measure", "value"], rows)
    show_certificate(certificate)
    print_lines(["cells with the smallest corners:"])
    print_lines([f"  {_worst_text(cell, unit)}" for cell in report.worst[:MOST_WORST]])
    show_heights(report.heights, unit)
    if baseline_name is not None:
        show_height_ratios(report.heights)
    print_lines([f"{cell} was valid on the baseline" for cell in newly[:MOST_LISTED]], style="yellow")
    print_lines([f"{cell} has corner triple product {cell.corner:.2g}" for cell in report.inverted[:MOST_LISTED]])
