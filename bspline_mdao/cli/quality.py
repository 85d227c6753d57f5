"""The command ``quality``."""

from __future__ import annotations

from pathlib import Path

from ..grids.multiblock import Grid
from ..grids.topology import find_topology
from ..model import FittedModel
from ..quality.grid_quality import GridQuality
from ..quality.report import QualityReport, report_quality
from .output import check_outputs, print_lines, print_table, print_title, print_warnings, progress_bar, written_json
from .sources import file_of, load_grid

MOST_SHOWN = 10
"""Inverted cells that are printed."""


def measure_quality(grid_name: str, n_bins: int, json: Path | None) -> None:
    """Measure the cells of a grid and show what they are like.

    Parameters
    ----------
    grid_name : str
        Grid file, fitted model (``.h5``), or ``@`` and the name of a built-in grid.
    n_bins : int
        Bins of the distribution of Q.
    json : Path, optional
        Numbers to write.

    Raises
    ------
    InputError
        If the grid cannot be used or a file cannot be written.
    """
    check_outputs([json], [file_of(grid_name)])
    with progress_bar() as progress:
        progress(0.0, "reading")
        grid, warnings = _grid_of(grid_name)
        progress(0.5, "cells")
        report = report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3), n_bins)
    with written_json(json, _numbers(grid_name, report)):
        pass
    _show(grid_name, report)
    print_warnings(warnings)


def _grid_of(grid_name: str) -> tuple[Grid, tuple[str, ...]]:
    """The grid of a file, or the one that a fitted model regenerates, and what is wrong with its topology."""
    if Path(grid_name).suffix == ".h5":
        model = FittedModel.load(grid_name)
        return model.regenerate(), model.topology.warnings
    grid = load_grid(grid_name)
    return grid, find_topology(grid).warnings


def _numbers(grid_name: str, report: QualityReport) -> dict:
    """Collect what is known about the cells for JSON; cell numbers are from 1."""
    return {
        "grid": grid_name,
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


def _show(grid_name: str, report: QualityReport) -> None:
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
    print_lines([f"{cell} has corner triple product {cell.corner:.2g}" for cell in report.inverted[:MOST_SHOWN]])
