"""Meshes of others moved from their files alone: what is read, fitted, and what a move by 5 % of the walls' size does.

``python benchmarks/core/bench_any_mesh.py MESH ... [--json FILE]``

A row is a file (``.gz`` as well), or a polyMesh folder: its kinds of cells, and for a shift of all walls along x and
for random bumps, both by 5 % of the size of the walls, newly inverted cells and heights of the first nodes by those
before from 1 % to 99 %, without options. What is refused is shown with the line that says why.
"""

from __future__ import annotations

import argparse
import gzip
import json
import shutil
import tempfile
from pathlib import Path

import numpy as np
from bench_ride import timed

from bspline_mdao import InputError, MovementError
from bspline_mdao.core.background.fit_mesh import fit_mesh
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.core.design.named_deformations import parse_deformation

PART = 0.05


def fitted(path: Path) -> MeshModel:
    """Fit a mesh, unpacked first if it is packed."""
    if path.suffix != ".gz":
        return fit_mesh(path)
    with tempfile.TemporaryDirectory() as folder:
        unpacked = Path(folder, path.stem)
        with gzip.open(path) as source, unpacked.open("wb") as target:
            shutil.copyfileobj(source, target)
        return fit_mesh(unpacked)


def moved(model: MeshModel, text: str) -> str:
    """Move its walls, and say what became of the cells."""
    mesh = model.mesh
    try:
        asked = model.deformed(parse_deformation(text, model, model.design_mesh(None)))
        seconds, nodes = timed(lambda: model.node_map.at(model.mover.move(model.control_points, asked).points).nodes)
    except (InputError, MovementError) as error:
        return f"refused: {error}"
    n_new = np.count_nonzero(mesh.quality(nodes).is_inverted & ~mesh.quality().is_inverted)
    walls = model.node_map.embedded.walls
    low, high = np.quantile(walls.heights(nodes) / walls.heights(mesh.points), [0.01, 0.99])
    return f"{n_new}; {low:.3f} to {high:.3f}; {seconds:.2f} s"


def judged(path: Path) -> dict:
    """Fit and move a mesh, and print its row."""
    row = {"mesh": path.name}
    try:
        seconds, model = timed(lambda: fitted(path))
        mesh = model.mesh
        span = np.ptp(mesh.points[model.wall_rows], axis=0)[: 2 if mesh.n_copies == 2 else 3]
        size = PART * float(np.linalg.norm(span))
        row |= {"nodes": mesh.n_stored, "cells": {kind: len(cells) for kind, cells in mesh.cells.items()}}
        row |= {"dimensions": len(span), "fit": seconds, "walls": list(model.walls.names)}
        row |= {"shift": moved(model, f"translate={size}/0/0"), "bumps": moved(model, f"bumps={size}")}
    except InputError as error:
        row["refused"] = str(error)
    print("  ".join(f"{key}: {value}" for key, value in row.items()), flush=True)
    return row


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+", type=Path, metavar="MESH")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = [judged(path) for path in arguments.meshes]
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
