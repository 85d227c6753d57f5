"""The lattice beside riding, IDWarp and OpenFOAM: the same places of wall nodes on cells of structured grids.

``python benchmarks/core/bench_lattice_peers.py [--grid hh_m6 ...] [--motion bend=30deg@0.5 ...] [--json FILE]``

Grids and motions are those of ``run_scripts/viscous_moves.py``. Each is moved as an unstructured mesh by a lattice,
riding on the fitted grid, and, in rows that were recorded, by IDWarp. A row has newly inverted cells (corners, as grids
are judged), smallest and mean Q, heights of the first cells by those before from 1 % to 99 %, and CPU seconds of a
design. Where ``checkMesh`` of OpenFOAM is on the path, it judges the mesh as the lattice has moved it, beside what
`mesh_quality` finds in the same mesh. Real grids want ``BSPLINE_MDAO_GRIDS``.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np
from bench_ride import timed

from bspline_mdao import Grid, InputError
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.files import write_polymesh
from bspline_mdao.grids import GridQuality, judge_move
from bspline_mdao.grids.cells.grid_mesh import grid_mesh
from bspline_mdao.grids.cells.mesh_quality import mesh_quality
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.meshes import EmbeddedMesh, MixedMesh
from bspline_mdao.movers import Rotations
from bspline_mdao.splines import SurfaceFollower

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "run_scripts"))
from viscous_moves import Body, Row, grid_of, read_rows  # noqa: E402

RECORDED = ROOT / "docs" / "_static" / "idwarp_recorded.csv"
PROGRAM = shutil.which("checkMesh")
MOTIONS = ("twist=20deg", "twist=45deg", "bend=30deg@0.5", "bend=60deg@0.5", "thickness=1.3", "sweep=30deg", "winglet")
SCHEMES = " ".join(f"{part}Schemes {{}}" for part in ("grad", "div", "laplacian", "interpolation", "snGrad"))
SETTINGS = {"controlDict": "deltaT 1; endTime 1; writeInterval 1;", "fvSchemes": SCHEMES, "fvSolution": ""}
"""What has to be in a case for ``checkMesh`` to start."""

PRINTED = {
    "non-orthogonality": r"non-orthogonality Max: (\S+)",
    "average": r"average: (\S+)",
    "severe": r"severely non-orthogonal .*faces: (\d+)",
    "beyond": r"non-orthogonality errors: (\d+)",
    "skewness": r"[Mm]ax skewness = ([^\s,]+)",
    "skewed": r"(\d+) highly skew",
    "wrong": r"(\d+) faces with incorrect orientation",
    "volume": r"[Mm]in(?:imum)?(?: negative)? volume[ =:]+([^\s,]+?)[.,]? ",
}
"""What ``checkMesh`` prints; counts only where they are not zero."""


def mesh_of(grid: Grid) -> tuple[MixedMesh, dict[str, str]]:
    """Cells of a grid as a mesh, and kinds of its markers."""
    topology = find_topology(grid)
    names = {face.window: str(face.patch) for face in topology.boundary}
    return grid_mesh(grid, topology, names), {str(face.patch): str(face.kind) for face in topology.boundary}


def checked(grid: Grid, mesh: MixedMesh, nodes: np.ndarray) -> dict[str, list[str]]:
    """What ``checkMesh`` prints of a grid, beside what we find."""
    found = mesh_quality(mesh, nodes)
    ours = [found.angles.max(), found.mean_angle, found.n_severe, found.n_beyond, found.skewness.max(), found.n_skewed]
    ours += [found.n_wrong_faces, found.volumes.min()]
    if PROGRAM is None:
        return {name: [f"{number:.6g}"] for name, number in zip(PRINTED, ours)}
    with tempfile.TemporaryDirectory() as folder:
        system = Path(folder, "system")
        system.mkdir()
        for name, text in SETTINGS.items():
            head = f"FoamFile {{ version 2.0; format ascii; class dictionary; object {name}; }}\n"
            Path(system, name).write_text(head + text)
        try:
            write_polymesh(Path(folder, "constant", "polyMesh"), grid)
        except InputError as error:  # of negative volume: such a mesh is not written
            return {"not checked": [str(error)]}
        environment = {"WM_PROJECT_DIR": "/usr/share/openfoam", **os.environ}
        command = [PROGRAM, "-case", folder]
        text = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    theirs = [re.search(pattern, text) for pattern in PRINTED.values()]
    return {name: [f"{number:.6g}", match[1] if match else "0"] for name, number, match in zip(PRINTED, ours, theirs)}


def shown(row: Row) -> Row:
    """Print a row."""
    print(*(f"{x:.4g}" if isinstance(x, float) else x for x in asdict(row).values()), sep="  ", flush=True)
    return row


def measure(name: str, motions) -> dict:
    """Make all motions of a grid in each way."""
    grid = grid_of(name, Path(os.environ.get("BSPLINE_MDAO_GRIDS", ".")))
    body, (mesh, kinds) = Body(name, grid), mesh_of(grid)
    quality = GridQuality.of_baseline(grid)
    fit, model = timed(lambda: MeshModel.of(mesh, kinds))
    first, _ = timed(lambda: (model.node_map, model.mover.move(model.control_points, mesh.points[model.wall_rows])))
    search, riding = timed(lambda: EmbeddedMesh.of(body.model, mesh))
    mover, follower = Rotations(body.mesh), SurfaceFollower.of(body.model, body.mesh, body.surface)
    print(f"{name}: {mesh.n_points:,} nodes; CPU s: lattice and factors {fit + first:.1f}, search of ride {search:.1f}")
    rows, checks = [], {}
    for motion in motions:
        places = mesh.points.copy()
        wall = body.target(motion)
        places[mesh.numbers[body.surface.rows]] = wall

        def by_lattice(asked=places[model.wall_rows]):
            return model.node_map.at(model.mover.move(model.control_points, asked).points).nodes

        def by_riding(wall=wall, asked=places[riding.walls.rows]):
            moved = mover.move(body.model.control_points, follower.at(wall).control_points).points
            return riding.at(moved, asked).nodes

        for way, move in (("lattice", by_lattice), ("ride", by_riding)):
            seconds, nodes = timed(move)
            of_grid = mesh.nodes_of_file(nodes)
            heights = np.quantile(quality.first_cells.ratios(of_grid), [0.01, 0.99]).tolist()
            rows.append(shown(Row(name, motion, way, *judge_move(quality, of_grid), *heights, seconds)))
            if way == "lattice":
                checks[motion] = checked(grid.with_vector(of_grid.ravel()), mesh, nodes)
        for row in read_rows(RECORDED):
            if (row.grid, row.motion) == (name, motion):
                rows.append(shown(row))
        for what, values in checks[motion].items():
            print(f"    {what:18} {'  '.join(values)}")
    return {"grid": name, "lattice": fit + first, "search": search, "rows": [asdict(r) for r in rows], "faces": checks}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grid", nargs="*", default=["hh_m6"])
    parser.add_argument("--motion", nargs="*", default=MOTIONS)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found = [measure(name, options.motion) for name in options.grid]
    if options.json:
        options.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
