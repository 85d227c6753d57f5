"""An unstructured mesh follows a control mesh.

An unstructured mesh about the ONERA M6 wing moves with the control mesh of a coarser structured grid. The mesh has
twice the cells of the grid in each direction, other nodes, and layers at the wall a tenth as high; all its cells are
wedges, also in the thin layers ahead of and behind the wing, where there is no wall to follow. It is twisted, bent and
swept, and the nodes of its wall have to be where the deformation puts them. It takes twenty seconds, and two minutes
with ``--paper``. The output is inverted cells, heights of the first nodes at the wall relative to the baseline, how far
the wall's nodes are from where they have to be, a check of the derivatives, and a picture of the mesh at a station
before and after.
"""

from __future__ import annotations

import time

import numpy as np

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, GRAY, GREEN, ORANGE, figure
from bspline_mdao.scripts import pick_size, run

SIZES = {
    "quick": ((8, 9, 7), (9, 11, 8)),
    "default": ((11, 15, 11), (21, 29, 21)),
    "paper": ((15, 21, 13), (41, 57, 41)),
}
"""Nodes of the blocks of the grid that is fitted, and of those whose nodes the mesh has, in each direction."""

OFF_WALL = 1e-3, 1e-4
"""Heights of their first cells (m)."""

MOVES = {"twist": "twist=10deg", "bend": "bend=15deg", "sweep": "sweep=10deg"}
"""Deformations, as the command ``ride`` takes them."""

STATION = 0.8
"""Part of the nodes along the span at which the mesh is drawn."""

WEDGES = np.array([[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]])
"""Corners of the two wedges of a hexahedron."""

LOW, HIGH = slice(None, -1), slice(1, None)
AROUND = (LOW, LOW), (HIGH, LOW), (HIGH, HIGH), (LOW, HIGH)
"""Corners of a cell around its third direction."""


def main(paper: bool = False, figures=None, quick: bool = False) -> dict:
    """Move the mesh.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`.
    figures : path-like, optional
        Folder for ``ride_along.png``.

    Returns
    -------
    dict
        ``n_nodes`` of the grid; ``n_points``, ``n_cells``, ``n_wall``, ``n_inverted`` and ``outside``, the largest
        distance of nodes from the volumes (m), of the mesh; ``seconds`` to look for its nodes; and by move
        ``n_inverted`` cells, ``heights``, the 1st, 50th and 99th percentile by those before, ``missed``, the largest
        distance of the wall's nodes from where they were asked to be (m), ``off_plane``, that of nodes of the plane of
        symmetry from it (m), and ``products``, by how much forward and reverse products differ.
    """
    coarse, fine = pick_size(SIZES, paper, quick)
    model = bm.fit_grid(bm.generators.onera_m6_grid(coarse, bm.generators.Spacing(off_wall=OFF_WALL[0])))
    mesh, triangles = wedges(bm.generators.onera_m6_grid(fine, bm.generators.Spacing(off_wall=OFF_WALL[1])))
    start = time.process_time()
    riding = bm.meshes.EmbeddedMesh.of(model, mesh)
    numbers = {
        "n_nodes": model.n_nodes,
        "n_points": mesh.n_points,
        "n_cells": mesh.n_cells,
        "n_wall": riding.n_asked,
        "n_inverted": int(np.count_nonzero(mesh.quality().is_inverted)),
        "outside": float(riding.distances.max()),
        "seconds": time.process_time() - start,
    }
    states = {name: move(model, riding, text) for name, text in MOVES.items()}
    if figures:
        draw(figures, riding, states, triangles)
    return numbers | {name: judge(riding, state, asked) for name, (state, asked) in states.items()}


def wedges(grid: bm.Grid) -> tuple[bm.meshes.MixedMesh, np.ndarray]:
    """Make a mesh of the nodes of a grid, each once, and name the triangles at the station, shape (n, 3)."""
    points, numbers = np.unique(grid.to_vector().reshape(-1, 3), axis=0, return_inverse=True)
    cells, triangles, first = [], [], 0
    for shape in grid.shapes:
        ids = numbers.ravel()[first : first + np.prod(shape)].reshape(shape)
        first += ids.size
        corners = np.stack([half[part] for half in (ids[:, :, :-1], ids[:, :, 1:]) for part in AROUND], axis=-1)
        cells.append(corners.reshape(-1, 8)[:, WEDGES].reshape(-1, 6))
        if (points[ids[:, :, 0], 2] == 0.0).all():  # beside the wing, not beyond its tip
            layer = corners[:, :, round(STATION * (shape[2] - 2))].reshape(-1, 8)
            triangles.append(layer[:, WEDGES[:, :3]].reshape(-1, 3))
    return bm.meshes.MixedMesh(points, {"wedge": np.concatenate(cells)}), np.concatenate(triangles)


def move(model: bm.FittedModel, riding: bm.meshes.EmbeddedMesh, text: str):
    """Move the control mesh by a deformation, and the mesh with it; also where its wall was asked to be."""
    control = bm.movers.moving_mesh(model)
    deformation = bm.design.parse_deformation(text, model, control)
    surface = deformation.apply(model.control_points[control.surface_ids])
    number = bm.movers.increments_for(bm.movers.LinearElasticity(control), [surface])
    moved = bm.movers.LinearElasticity(control, n_increments=number).move(model.control_points, surface).points
    wall = riding.walls.initial
    asked = deformation.apply_to_nodes(wall, [(np.flatnonzero(wall[:, 2] == 0.0), np.eye(3)[2])])
    return riding.at(moved, asked), asked


def ratios(riding: bm.meshes.EmbeddedMesh, state) -> np.ndarray:
    """Heights of the first nodes at the wall by those before."""
    return riding.walls.heights(state.nodes) / riding.walls.heights(riding.mesh.points)


def judge(riding: bm.meshes.EmbeddedMesh, state, asked: np.ndarray) -> dict:
    """Measure a mesh that was moved, see `main`."""
    rng = np.random.default_rng(0)
    seed, bar, d_wall = (rng.normal(size=x.shape) for x in (riding.control_points, state.nodes, asked))
    forward, bars = np.vdot(bar, state.jvp(seed, d_wall)), state.vjp(bar)
    reverse = np.vdot(bars["control_points"], seed) + np.vdot(bars["wall"], d_wall)
    return {
        "n_inverted": int(np.count_nonzero(riding.mesh.quality(state.nodes).is_inverted)),
        "heights": np.percentile(ratios(riding, state), [1.0, 50.0, 99.0]).tolist(),
        "missed": float(np.abs(state.nodes[riding.walls.rows] - asked).max()),
        "off_plane": float(np.abs(state.nodes[riding.mesh.points[:, 2] == 0.0, 2]).max()),
        "products": abs(forward - reverse) / abs(forward),
    }


def draw(folder, riding: bm.meshes.EmbeddedMesh, states: dict, triangles: np.ndarray) -> None:
    """Draw the mesh near the wing, the wing as it was and as it is, and the heights of the first nodes."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    edges = edges[np.isin(edges, riding.walls.rows).all(axis=1)].T
    with figure(folder, "ride_along", size=(12.0, 3.6), n_colours=64) as canvas:
        *sections, last = canvas.subplots(1, len(states) + 1)
        for axes, (name, (state, _)) in zip(sections, states.items()):
            axes.triplot(state.nodes[:, 0], state.nodes[:, 1], triangles, color=BLUE, linewidth=0.2)
            for x, color in ((riding.mesh.points, GRAY), (state.nodes, BLUE)):
                axes.plot(x[edges, 0], x[edges, 1], color=color, linewidth=1.2)
            axes.set(title=MOVES[name], aspect="equal", xlabel="$x$ (m)", ylabel="$y$ (m)")
            axes.set(xlim=(0.6, 1.75), ylim=(-0.5, 0.65))
        for (name, (state, _)), color in zip(states.items(), (BLUE, ORANGE, GREEN)):
            heights = np.sort(ratios(riding, state))
            last.plot(np.linspace(0.0, 1.0, len(heights)), heights, color=color, label=name)
        last.set(xlabel="fraction of the wall nodes, sorted", ylabel="first height relative to the baseline")
        last.legend()


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/ride_along.png'
