"""The command ``refine``: a member of the grid family of a model."""

from __future__ import annotations

from pathlib import Path

from ..errors import InputError
from ..evaluation.family import refined_topology
from ..io.files import check_grid_name, write_grid
from ..model.fitted_model import FittedModel, family_member
from ..wording import counted
from .output import (
    check_outputs,
    counts_text,
    print_lines,
    print_table,
    print_title,
    print_warnings,
    progress_bar,
    written_json,
)

MOST_NODES = 100_000_000
"""A member with more nodes is refused: its evaluation takes some 200 bytes a node."""


def refine_model(model: Path, factor: float, output: Path, json: Path | None) -> None:
    """Write a finer or coarser member of the grid family of a model.

    Parameters
    ----------
    model : Path
        Fitted model.
    factor : float
        Cells per direction, divided by those of the grid.
    output, json : Path
        Grid and numbers to write.

    Raises
    ------
    InputError
        If the model cannot be used, the factor leaves no cell, or a file cannot be written.
    """
    check_outputs([output, json], [model])
    numbers = {"model": str(model), "factor": factor, "grid": str(output)}
    with progress_bar() as progress:
        progress(0.0, "reading")
        fitted = FittedModel.load(model)
        check_grid_name(output, fitted.header)
        topology = refined_topology(fitted.topology, factor)
        n_nodes = topology.n_nodes
        if n_nodes > MOST_NODES:
            raise InputError(f"{model}: factor {factor:g} makes {n_nodes:,} nodes, more than {MOST_NODES:,}; lower it")
        progress(0.2, "evaluating")
        grid = family_member(fitted, factor)
        progress(0.8, "writing")
        with written_json(json, {**numbers, "blocks": grid.shapes, "n_nodes": grid.n_nodes}):
            write_grid(output, grid, topology)
    print_title(
        f"{output}: {counted(grid.n_nodes, 'node')}, {grid.n_nodes / fitted.n_nodes:.3g} times those of {model}"
    )
    rows = [
        (number, counts_text(before), counts_text(block.shape), block.name)
        for number, (block, before) in enumerate(zip(grid.blocks, fitted.topology.shapes), start=1)
    ]
    print_table(["block", "nodes before", "nodes", "name"], rows)
    print_warnings(fitted.topology.warnings)
    print_lines([f"{output} written"])
