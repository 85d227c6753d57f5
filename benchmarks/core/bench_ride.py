"""Meshes that ride along, beside radial basis functions of the walls: CPU seconds and bytes per node, in one process.

``python benchmarks/core/bench_ride.py [--nodes N] [--cells wedge|tetra|hexahedron] [--json FILE]``

The mesh is a finer member of the H-H grid about the ONERA M6 wing with a boundary layer: its cells are cut into two
wedges or six tetrahedra, or left as they are, and nodes that are not on its boundary are moved by random vectors of up
to a tenth of the shortest edge at each. The model that carries it is fitted to a coarser grid. The peer is
`scipy.interpolate.RBFInterpolator` (thin-plate splines through the displacements of the walls' nodes and of the corners
of the far field, 50 neighbours), which moves nodes by places alone; it gets fewer nodes, as it is slow. Inverted cells
and heights are those of the ride; ``products`` is by how much those of forward and reverse differ.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
import tracemalloc
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.interpolate import RBFInterpolator

from bspline_mdao import fit_grid
from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.generators import Spacing, onera_m6_grid
from bspline_mdao.grids.topology.boundary_surface import BoundarySurface
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.grid import Grid
from bspline_mdao.grids.topology.topology import Topology
from bspline_mdao.meshes import EmbeddedMesh, MixedMesh
from bspline_mdao.movers import LinearElasticity, moving_mesh

SPACING = Spacing(off_wall=1e-4)
SHAPE = (23, 33, 17)
"""Nodes per block of the member that the mesh is made of, at a scale of one."""


SPLITS = {
    "hexahedron": np.arange(8)[None],
    "wedge": np.array([[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]]),
    "tetra": np.array([[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]]),
}
"""Cells that a hexahedron is cut into."""

SHIFT = 0.1
"""Largest shift of an inner node, by the shortest edge at it."""


def mesh_of(scale: float, kind: str) -> MixedMesh:
    """Make the mesh, about ``scale`` times as fine as `SHAPE`."""
    grid = onera_m6_grid(tuple(round(scale * n) for n in SHAPE), SPACING)
    topology, (points, numbers, hexahedra) = find_topology(grid), joined(grid)
    corners = hexahedra[:, SPLITS[kind]].reshape(-1, SPLITS[kind].shape[1])
    boundary = [face for face in topology.boundary if face.kind == "wall"], topology.boundary
    wall, skin = (quads_of(grid, topology, numbers, faces) for faces in boundary)
    return MixedMesh(shifted(points, corners, skin), {kind: corners}, {"wing": with_halves(wall)})


def joined(grid: Grid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes of a grid, each once, the number of each of its blocks' nodes among them, and corners of its cells."""
    points, numbers = np.unique(grid.to_vector().reshape(-1, 3), axis=0, return_inverse=True)
    numbers, cells, first = numbers.ravel(), [], 0
    for shape in grid.shapes:
        ids = numbers[first : first + np.prod(shape)].reshape(shape)
        first += ids.size
        sides = [ids[:, :, :-1], ids[:, :, 1:]]
        cells.append(np.stack([half for side in sides for half in around(side)], axis=-1).reshape(-1, 8))
    return points, numbers, np.concatenate(cells)


def quads_of(grid: Grid, topology: Topology, numbers: np.ndarray, faces) -> np.ndarray:
    """Quads of some faces of the boundary of a grid, by the numbers of `joined`."""
    surface = BoundarySurface.of(topology, grid.to_vector().reshape(-1, 3), faces)
    return numbers[surface.rows][surface.quads]


def with_halves(quads: np.ndarray) -> np.ndarray:
    """Quads, and the triangles of either cut of each: of these, those count that are faces of cells."""
    halves = quads[:, [[0, 1, 2, 2], [0, 2, 3, 3], [0, 1, 3, 3], [1, 2, 3, 3]]].reshape(-1, 4)
    return np.concatenate([quads, halves])


def shifted(points: np.ndarray, corners: np.ndarray, skin: np.ndarray) -> np.ndarray:
    """Shift nodes that are not on the boundary by random vectors."""
    shortest = np.full(len(points), np.inf)
    for a, b in combinations(range(corners.shape[1]), 2):
        ends = corners[:, [a, b]]
        lengths = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
        for end in ends.T:
            np.minimum.at(shortest, end, lengths)
    shortest[skin] = 0.0
    vectors = np.random.default_rng(0).uniform(-1.0, 1.0, points.shape)
    return points + SHIFT * shortest[:, None] * vectors / np.linalg.norm(vectors, axis=1)[:, None]


def around(ids: np.ndarray) -> list[np.ndarray]:
    """Corners of the quads of layers of nodes, in turn."""
    return [ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]]


def timed(task) -> tuple[float, object]:
    """CPU seconds of a task, and its result."""
    start = time.process_time()
    result = task()
    return time.process_time() - start, result


def judged(mesh: MixedMesh, riding: EmbeddedMesh, points: np.ndarray) -> dict:
    """Inverted cells, smallest volume and heights of a moved mesh."""
    before, after = mesh.quality(), mesh.quality(points)
    ratios = riding.walls.heights(points) / riding.walls.heights(mesh.points)
    return {
        "newly_inverted": int(np.count_nonzero(after.is_inverted & ~before.is_inverted)),
        "min_volume": [float(before.volumes.min()), float(after.volumes.min())],
        "heights": np.quantile(ratios, [0.01, 0.5, 0.99]).round(4).tolist(),
    }


def measure(n_nodes: int, kind: str) -> dict:
    """Measure both on a mesh of about some number of nodes."""
    model = fit_grid(onera_m6_grid((15, 21, 13), SPACING))
    control = moving_mesh(model)
    twist = parse_deformation(["twist=5deg"], model, control)
    mover = LinearElasticity(control, n_increments=1)
    moved = mover.move(model.control_points, twist.apply(control.points[control.surface_ids])).points
    riding = EmbeddedMesh.of(model, mesh_of(0.5, kind))
    riding.at(moved).vjp(riding.mesh.points)  # compiles
    mesh = mesh_of((n_nodes / 142_000) ** (1.0 / 3.0), kind)
    tracemalloc.start()
    seconds, riding = timed(lambda: EmbeddedMesh.of(model, mesh))
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    wall = twist.apply_to_nodes(riding.walls.initial)
    at, state = timed(lambda: riding.at(moved, wall))
    forward, _ = timed(lambda: state.jvp(moved, wall))
    reverse, _ = timed(lambda: state.vjp(mesh.points))
    rng = np.random.default_rng(1)
    seed, d_wall, bar = (rng.standard_normal(x.shape) for x in (moved, wall, mesh.points))
    there, bars = np.vdot(bar, state.jvp(seed, d_wall)), state.vjp(bar)
    judge, found = timed(lambda: judged(mesh, riding, state.nodes))
    few = np.linspace(0, mesh.n_points - 1, min(mesh.n_points, 20_000)).astype(int)
    box = mesh.points[[np.argmax(mesh.points @ s) for s in np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T]]
    box = np.unique(box, axis=0)
    sites = np.concatenate([riding.walls.initial, box])
    shifts = np.concatenate([wall - riding.walls.initial, np.zeros_like(box)])
    rbf = RBFInterpolator(sites, shifts, neighbors=50)
    peer, _ = timed(lambda: rbf(mesh.points[few]))
    return {
        "n_nodes": mesh.n_points,
        "n_cells": mesh.n_cells,
        "n_wall_nodes": riding.n_asked,
        "search_us_per_node": 1e6 * seconds / mesh.n_points,
        "move_us_per_node": 1e6 * at / mesh.n_points,
        "forward_us_per_node": 1e6 * forward / mesh.n_points,
        "reverse_us_per_node": 1e6 * reverse / mesh.n_points,
        "bytes_per_node": [kept / mesh.n_points, peak / mesh.n_points],
        "rbf_us_per_node": 1e6 * peer / len(few),
        "rbf_by_move": (peer / len(few)) / (at / mesh.n_points),
        "judge_us_per_node": 1e6 * judge / mesh.n_points,
        "peak_memory_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
        "products": abs(np.vdot(bars["control_points"], seed) + np.vdot(bars["wall"], d_wall) - there) / abs(there),
        **found,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=int, default=100_000)
    parser.add_argument("--cells", choices=list(SPLITS), default="wedge")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    found = measure(arguments.nodes, arguments.cells)
    for name, value in found.items():
        print(f"{name:20} {value}")
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
