"""The command ``quality``: the cells of a grid, and what a move made of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..cells.grid_quality import GridQuality
from ..cells.report import InvertedCell, QualityReport, inverted_cells, report_quality
from ..errors import InputError
from ..io.patches import merge_patches, read_patches
from ..model.fitted_model import FittedModel
from ..topology.detection import find_topology
from ..topology.grid import Grid
from .output import (
    check_outputs,
    counts_text,
    height_numbers,
    height_warnings,
    print_lines,
    print_table,
    print_title,
    print_warnings,
    progress_bar,
    show_height_ratios,
    show_heights,
    written_json,
)
from .sources import file_of, load_grid

MOST_SHOWN = 10
"""Inverted cells that are printed."""


def measure_quality(
    grid_name: str, bins: int, json: Path | None, patches: Path | None = None, baseline: str | None = None
) -> None:
    """Measure the cells of a grid and show what they are like.

    Parameters
    ----------
    grid_name : str
        Grid file, fitted model (``.h5``), or ``@`` and the name of a built-in grid.
    bins : int
        Bins of the distribution of Q.
    json : Path, optional
        Numbers to write.
    patches : Path, optional
        Declared patches.
    baseline : str, optional
        The grid before it was moved, as ``grid_name``: decides which cells are inverted now and were not, and what the
        heights at walls are compared with.

    Raises
    ------
    InputError
        If a grid cannot be used, the two have other blocks, or a file cannot be written.
    """
    check_outputs([json], [file_of(grid_name), patches, baseline and file_of(baseline)])
    with progress_bar() as progress:
        progress(0.0, "reading")
        grid, warnings = _grid_of(grid_name, patches)
        before = grid if baseline is None else _baseline_of(baseline, grid, grid_name)
        progress(0.5, "cells")
        quality, nodes = GridQuality.of_baseline(before), grid.to_vector().reshape(-1, 3)
        report = report_quality(quality, nodes, bins)
        newly = () if baseline is None else inverted_cells(quality, quality.cells(nodes), newly=True)
    with written_json(json, _numbers(grid_name, baseline, report, newly)):
        pass
    _show(grid_name, baseline, report, newly)
    print_warnings(warnings)
    if baseline is not None:
        print_warnings(height_warnings(report.heights))


def _grid_of(grid_name: str, patches: Path | None) -> tuple[Grid, tuple[str, ...]]:
    """The grid of a file, or the one that a fitted model regenerates, and what is wrong with its topology."""
    if Path(grid_name).suffix == ".h5":
        model = FittedModel.load(grid_name)
        grid = model.regenerate()
        return (read_patches(patches, grid) if patches else grid), model.topology.warnings
    grid = load_grid(grid_name, patches)
    return grid, find_topology(grid).warnings


def _baseline_of(name: str, grid: Grid, grid_name: str) -> Grid:
    """The grid before it was moved, with the patches of both."""
    baseline, _ = _grid_of(name, None)
    if baseline.shapes != grid.shapes:
        raise InputError(
            f"{grid_name}: its blocks have {_shapes_text(grid)} nodes, those of the baseline {name} "
            f"{_shapes_text(baseline)}; give the grid that was moved"
        )
    return merge_patches(baseline, grid.patches, grid_name)


def _shapes_text(grid: Grid) -> str:
    """Write the nodes of the first blocks."""
    shapes = [counts_text(shape) for shape in grid.shapes]
    return ", ".join(shapes[:3]) + (", ..." if len(shapes) > 3 else "")


def _numbers(grid_name: str, baseline_name: str | None, report: QualityReport, newly: Sequence[InvertedCell]) -> dict:
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
        "histogram": {
            "edges": report.histogram.edges.tolist(),
            "density": report.histogram.density.tolist(),
            "n_negative": report.histogram.n_negative,
        },
    }


def _show(grid_name: str, baseline_name: str | None, report: QualityReport, newly: Sequence[InvertedCell]) -> None:
    """Print the measures of the cells, the first cells at walls, and inverted cells."""
    print_title(f"{grid_name}: {report.n_cells:,} cells")
    rows = [
        ("smallest Q", f"{report.q_min:.4g}"),
        ("mean Q", f"{report.q_mean:.4g}"),
        ("smallest corner triple product", f"{report.min_corner:.4g}"),
        ("smallest corner Jacobian", f"{report.min_jacobian:.4g}"),
        ("smallest volume", f"{report.min_volume:.4g}"),
        ("inverted cells", f"{report.n_inverted:,}"),
    ]
    print_table(["measure", "value"], rows)
    show_heights(report.heights)
    if baseline_name is not None:
        show_height_ratios(report.heights)
    print_lines([f"{cell} was valid on the baseline" for cell in newly[:MOST_SHOWN]], style="yellow")
    print_lines([f"{cell} has corner triple product {cell.corner:.2g}" for cell in report.inverted[:MOST_SHOWN]])
