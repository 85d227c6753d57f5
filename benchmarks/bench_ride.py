"""Meshes that ride along, beside radial basis functions of the walls: CPU seconds and bytes per node, in one process.

``python benchmarks/bench_ride.py [--nodes N] [--json FILE]``

The mesh is a finer member of the H-H grid about the ONERA M6 wing with a boundary layer, as hexahedra; the model that
carries it is fitted to a coarser one. The peer is `scipy.interpolate.RBFInterpolator` (thin-plate splines through the
displacements of the walls' nodes and of the corners of the far field, 50 neighbours), which moves nodes by places
alone; it gets fewer nodes, as it is slow. Inverted cells and heights are those of the ride.
"""

from __future__ import annotations

import argparse
import json
import time
import tracemalloc
from pathlib import Path

import numpy as np
from scipy.interpolate import RBFInterpolator

from bspline_mdao import LinearElasticity, MixedMesh, RidingMesh, Spacing, fit_grid, moving_mesh, onera_m6_grid
from bspline_mdao.design.named_deformations import parse_deformation

SPACING = Spacing(off_wall=1e-4)
SHAPE = (23, 33, 17)
"""Nodes per block of the member that the mesh is made of, at a scale of one."""


def mesh_of(scale: float) -> MixedMesh:
    """Make the mesh, about ``scale`` times as fine as `SHAPE`."""
    grid = onera_m6_grid(tuple(round(scale * n) for n in SHAPE), SPACING)
    points, numbers = np.unique(grid.to_vector().reshape(-1, 3), axis=0, return_inverse=True)
    cells, first = [], 0
    for shape in grid.shapes:
        ids = numbers.ravel()[first : first + np.prod(shape)].reshape(shape)
        first += ids.size
        sides = [ids[:, :, :-1], ids[:, :, 1:]]
        cells.append(np.stack([half for s in sides for half in around(s)], axis=-1).reshape(-1, 8))
    return MixedMesh(points, {"hexahedron": np.concatenate(cells)})


def around(ids: np.ndarray) -> list[np.ndarray]:
    """Corners of the quads of layers of nodes, in turn."""
    return [ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]]


def timed(task) -> tuple[float, object]:
    """CPU seconds of a task, and its result."""
    start = time.process_time()
    result = task()
    return time.process_time() - start, result


def judged(mesh: MixedMesh, riding: RidingMesh, points: np.ndarray) -> dict:
    """Inverted cells, smallest volume and heights of a moved mesh."""
    before, after = mesh.quality(), mesh.quality(points)
    ratios = riding.walls.heights(points) / riding.walls.heights(mesh.points)
    return {
        "newly_inverted": int(np.count_nonzero(after.is_inverted & ~before.is_inverted)),
        "min_volume": [float(before.volumes.min()), float(after.volumes.min())],
        "heights": np.quantile(ratios, [0.01, 0.5, 0.99]).round(4).tolist(),
    }


def measure(n_nodes: int) -> dict:
    """Measure both on a mesh of about some number of nodes."""
    model = fit_grid(onera_m6_grid((15, 21, 13), SPACING))
    control = moving_mesh(model)
    twist = parse_deformation(["twist=5deg"], model, control)
    moved = (
        LinearElasticity(control).move(model.control_points, twist.apply(control.points[control.surface_ids])).points
    )
    riding = RidingMesh.of(model, mesh_of(0.5))
    riding.at(moved).vjp(riding.mesh.points)  # compiles
    mesh = mesh_of((n_nodes / 150_000) ** (1.0 / 3.0))
    tracemalloc.start()
    seconds, riding = timed(lambda: RidingMesh.of(model, mesh))
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    wall = twist.apply_to_nodes(riding.walls.initial)
    at, state = timed(lambda: riding.at(moved, wall))
    forward, _ = timed(lambda: state.jvp(moved, wall))
    reverse, _ = timed(lambda: state.vjp(mesh.points))
    few = np.linspace(0, mesh.n_points - 1, min(mesh.n_points, 20_000)).astype(int)
    box = mesh.points[[np.argmax(mesh.points @ s) for s in np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T]]
    box = np.unique(box, axis=0)
    sites = np.concatenate([riding.walls.initial, box])
    shifts = np.concatenate([wall - riding.walls.initial, np.zeros_like(box)])
    rbf = RBFInterpolator(sites, shifts, neighbors=50)
    peer, _ = timed(lambda: rbf(mesh.points[few]))
    return {
        "n_nodes": mesh.n_points,
        "n_wall_nodes": riding.n_asked,
        "search_us_per_node": 1e6 * seconds / mesh.n_points,
        "move_us_per_node": 1e6 * at / mesh.n_points,
        "forward_us_per_node": 1e6 * forward / mesh.n_points,
        "reverse_us_per_node": 1e6 * reverse / mesh.n_points,
        "bytes_per_node": [kept / mesh.n_points, peak / mesh.n_points],
        "rbf_us_per_node": 1e6 * peer / len(few),
        "rbf_by_move": (peer / len(few)) / (at / mesh.n_points),
        **judged(mesh, riding, state.points),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=int, default=100_000)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    found = measure(arguments.nodes)
    for name, value in found.items():
        print(f"{name:20} {value}")
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
