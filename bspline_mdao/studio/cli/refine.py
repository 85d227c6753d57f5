"""The command ``refine``: a member of the grid family of a model, structured or of curved elements."""

from __future__ import annotations

from pathlib import Path

from ...base.numerics.progress import progress_bar
from ...base.text import counted
from ...core.evaluation.family import refined_topology
from ...core.model.curved import curved_grid
from ...core.model.fitted_model import FittedModel, family_member
from ...errors import InputError
from ...grids.io.curved import curved_format, write_curved_grid
from ...grids.io.files import check_grid_name, write_grid
from ...grids.topology.topology import Topology
from .curved import CurvedMeasures
from .output import (
    check_outputs,
    counts_text,
    print_lines,
    print_table,
    print_title,
    print_warnings,
    written_json,
)
from .units import unit_warnings

MOST_NODES = 100_000_000
"""Members with more nodes are refused: their evaluation takes about 200 bytes per node."""


def refine_model(
    model: Path,  # fitted model
    factor: float,  # on the cells of the grid per direction
    output: Path,  # output, json: grid and numbers to write
    json: Path | None,
    # degree of curved elements, as many per direction as the member has cells; by default the member is structured
    degree: int | None = None,
    allow_invalid: bool = False,  # write curved elements even if some are inverted
) -> None:
    """Write a finer or coarser member of the grid family of a model, or curved elements."""
    check_outputs([output, json], [model])
    if degree is not None:
        _write_curved(model, factor, output, json, degree, allow_invalid)
        return
    if allow_invalid:
        raise InputError("--allow-invalid is for curved elements; give --degree as well, or leave it out")
    numbers = {"model": str(model), "factor": factor, "grid": str(output)}
    with progress_bar() as progress:
        progress(0.0, "reading")
        fitted = FittedModel.load(model)
        check_grid_name(output, fitted.header)
        topology = _checked_topology(model, fitted, factor)
        progress(0.2, "evaluating")
        grid = family_member(fitted, factor)
        progress(0.8, "writing")
        with written_json(json, {**numbers, "blocks": grid.shapes, "n_nodes": grid.n_nodes}):
            write_grid(output, grid, topology)
    print_title(
        f"{output}: {counted(grid.n_nodes, 'node')}, {grid.n_nodes / fitted.n_nodes:.3g} times as many as {model}"
    )
    rows = [
        (number, counts_text(before), counts_text(block.shape), block.name)
        for number, (block, before) in enumerate(zip(grid.blocks, fitted.topology.shapes), start=1)
    ]
    print_table(["block", "nodes before", "nodes", "name"], rows)
    print_warnings(fitted.topology.warnings)
    print_warnings(unit_warnings(output, grid))
    print_lines([f"{output} written"])


def _checked_topology(model: Path, fitted: FittedModel, factor: float, degree: int = 1) -> Topology:
    """Topology of a member; refuse one that does not fit in memory."""
    topology = refined_topology(fitted.topology, factor)
    n_nodes = topology.n_nodes * degree**3
    if n_nodes > MOST_NODES:
        raise InputError(f"{model}: factor {factor:g} makes {n_nodes:,} nodes, more than {MOST_NODES:,}; lower it")
    return topology


def _write_curved(
    model: Path, factor: float, output: Path, json: Path | None, degree: int, allow_invalid: bool
) -> None:
    """Write curved elements and describe them."""
    curved_format(output)
    with progress_bar() as progress:
        progress(0.0, "reading")
        fitted = FittedModel.load(model)
        _checked_topology(model, fitted, factor, degree)
        progress(0.1, "evaluating")
        grid = curved_grid(fitted, degree, factor)
        progress(0.5, "measuring")
        found = CurvedMeasures.of(grid)
        block, *cell = (int(number) + 1 for number in grid.places[found.at])
        where = f"block {block}, element ({', '.join(map(str, cell))})"
        if found.n_inverted and not allow_invalid:
            raise InputError(
                f"{model}: {found.n_inverted:,} of {counted(len(grid.elements), 'element')} of degree {degree} are "
                f"inverted, the worst in {where}; raise --factor, lower --degree, or give --allow-invalid"
            )
        numbers = {"model": str(model), "factor": factor, "degree": degree, "grid": str(output), **found.numbers()}
        progress(0.8, "writing")
        with written_json(json, {**numbers, "patches": {patch.name: len(patch.faces) for patch in grid.patches}}):
            write_curved_grid(output, grid)
    found.show(str(output), where, fitted.topology.warnings)
    print_lines([f"{output} written"])
