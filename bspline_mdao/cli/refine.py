"""The command ``refine``."""

from __future__ import annotations

from pathlib import Path

from ..grids.files import write_grid
from ..model import FittedModel
from .output import check_outputs, print_lines, print_table, print_title, progress_bar, write_json


def refine_model(model_file: Path, factor: float, output: Path, json: Path | None) -> None:
    """Write a finer or coarser member of the grid family of a model.

    Parameters
    ----------
    model_file : Path
        Fitted model.
    factor : float
        Cells per direction, by those of the grid.
    output, json : Path
        Grid and numbers to write.

    Raises
    ------
    InputError
        If the model cannot be used, the factor leaves no cell, or a file cannot be written.
    """
    check_outputs([output, json], [model_file])
    with progress_bar() as progress:
        progress(0.0, "reading")
        model = FittedModel.load(model_file)
        progress(0.2, "evaluating")
        grid = family_member(model, factor)
        progress(0.8, "writing")
        write_grid(output, grid)
    write_json(
        json,
        {
            "model": str(model_file),
            "factor": factor,
            "grid": str(output),
            "blocks": grid.shapes,
            "n_nodes": grid.n_nodes,
        },
    )
    print_title(f"{output}: {grid.n_nodes:,} nodes, {grid.n_nodes / model.n_nodes:.3g} times those of {model_file}")
    rows = [
        (block.name, " x ".join(map(str, before)), " x ".join(map(str, block.shape)))
        for block, before in zip(grid.blocks, model.topology.shapes)
    ]
    print_table(["block", "nodes before", "nodes"], rows)
    print_lines([f"{output} written"])
