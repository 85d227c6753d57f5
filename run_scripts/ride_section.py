"""A two-dimensional mesh follows a section.

A two-dimensional SU2 mesh about NACA 0012 moves with the control mesh of a coarse section. The mesh has layers of quads
at the airfoil, first cells of 2e-6 chords, and triangles with shifted nodes outside of them; the model is fitted to an
O-grid of square cells, one deep between two planes of symmetry. The airfoil is pitched, thickened and stretched, and
its nodes have to be where the deformation puts them; each mesh is written as the file was, with other coordinates. It
takes five seconds. The output is inverted cells, heights of the first nodes relative to the baseline, how far the nodes
of the airfoil are from where they have to be and the two copies of each node from each other, the lines of the file
that differ other than those of nodes, a check of the derivatives, and a picture.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, GRAY, figure
from bspline_mdao.scripts import run

N_AROUND = {False: (64, 160), True: (48, 96)}
"""Cells around the section of the grid that is fitted and of the mesh, also at the small size (True)."""

FAR = 20.0, 12.0
"""Radius of the outer boundary of both (chords)."""

FIRST, GROWTH = 1e-4, 1.25
"""First cell of the layers, by the square cell that they divide, and the ratio of the following ones."""

SHIFT = 0.2
"""Largest shift of a node outside of the layers, by the shortest of the lines to its neighbours."""

MOVES = {"pitch": "pitch=10deg", "thickness": "thickness=1.5", "chord": "chord=1.2"}
"""Deformations, as the command ``ride`` takes them."""


def main(figures=None, quick: bool = False) -> dict:
    """Move the mesh.

    Parameters
    ----------
    figures : path-like, optional
        Folder for ``ride_section.png``.
    quick : bool
        The small size of `N_AROUND`.

    Returns
    -------
    dict
        ``n_points``, ``n_quads`` and ``n_triangles`` of the file; and by move ``n_inverted`` cells, ``heights``, the
        least, the median and the largest by those before, ``missed``, the largest distance of nodes of the airfoil
        from where they were asked to be (m), ``apart``, that of both copies of a node (m), ``n_lines``, lines of the
        file that have changed and are no nodes, and ``products``, by how much forward and reverse products differ.
    """
    coarse, fine = N_AROUND[quick]
    model = bm.fit_grid(bm.generators.section_o_grid(bm.generators.naca_section(0.12), n_around=coarse, far=FAR[0]))
    nodes, triangles, quads, lines = plane_mesh(fine)
    numbers = {"n_points": len(nodes), "n_quads": len(quads), "n_triangles": len(triangles)}
    with TemporaryDirectory() as folder:
        path = Path(folder, "airfoil.su2")
        path.write_text(su2_text(nodes, triangles, quads, lines))
        file = bm.files.read_mesh(path, bm.meshes.section_span(model))
        riding = bm.meshes.EmbeddedMesh.of(model, file.mesh)
        states = {name: move(model, riding, text) for name, text in MOVES.items()}
        for name, (state, asked) in states.items():
            file.write(Path(folder, f"{name}.su2"), state.nodes)
            texts = [Path(folder, f"{stem}.su2").read_text().splitlines() for stem in ("airfoil", name)]
            numbers[name] = judge(riding, state, asked) | {"n_lines": n_changed(*texts, len(nodes))}
    if figures:
        draw(figures, len(nodes), riding, states, triangles, quads)
    return numbers


def plane_mesh(n_around: int):
    """Make the nodes of the mesh, shape (n, 2), and its triangles, quads and lines of the airfoil."""
    grid = (
        bm.generators.section_o_grid(bm.generators.naca_section(0.12), n_around=n_around, far=FAR[1])
        .blocks[0]
        .nodes[:-1, :, 0, :2]
    )
    layers = [0.0, FIRST]
    while layers[-1] < 1.0:
        layers.append(layers[-1] + GROWTH * (layers[-1] - layers[-2]))
    layers = np.array(layers) / layers[-1]
    within = grid[:, :1] + layers[:, None] * (grid[:, 1:2] - grid[:, :1])
    nodes = np.concatenate([within, grid[:, 2:]], axis=1)
    ids = np.arange(nodes[..., 0].size).reshape(nodes.shape[:2])
    ids = np.vstack([ids, ids[:1]])
    cells = np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1)
    quads, away = (part.reshape(-1, 4) for part in np.split(cells, [len(layers) - 1], axis=1))
    inner = nodes[:, len(layers) : -1]  # those that are free to shift
    around = np.linalg.norm(inner - np.roll(inner, 1, axis=0), axis=2)
    vectors = np.random.default_rng(0).uniform(-1.0, 1.0, inner.shape)
    inner += SHIFT * np.minimum(around, np.roll(around, -1, axis=0))[..., None] * vectors
    triangles = np.concatenate([away[:, [0, 1, 2]], away[:, [0, 2, 3]]])
    return nodes.reshape(-1, 2), triangles, quads, np.stack([ids[:-1, 0], ids[1:, 0]], axis=1)


def su2_text(nodes: np.ndarray, triangles: np.ndarray, quads: np.ndarray, lines: np.ndarray) -> str:
    """Text of a mesh in SU2's format of two dimensions."""
    cells = [(5, *row) for row in triangles.tolist()] + [(9, *row) for row in quads.tolist()]
    text = ["NDIME= 2", f"NELEM= {len(cells)}", *(" ".join(map(str, (*cell, n))) for n, cell in enumerate(cells))]
    text += [f"NPOIN= {len(nodes)}", *(f"{x!r} {y!r} {n}" for n, (x, y) in enumerate(nodes.tolist()))]
    text += ["NMARK= 1", "MARKER_TAG= airfoil", f"MARKER_ELEMS= {len(lines)}", *(f"3 {a} {b}" for a, b in lines)]
    return "\n".join([*text, ""])


def move(model: bm.FittedModel, riding: bm.meshes.EmbeddedMesh, text: str):
    """Move the control mesh by a deformation, and the mesh with it; also where its wall was asked to be."""
    control = bm.movers.moving_mesh(model)
    deformation = bm.design.parse_deformation(text, model, control)
    surface = deformation.apply(model.control_points[control.surface_ids])
    number = bm.movers.increments_for(bm.movers.LinearElasticity(control), [surface])
    moved = bm.movers.LinearElasticity(control, n_increments=number).move(model.control_points, surface).points
    asked = deformation.apply_to_nodes(riding.walls.initial)
    return riding.at(moved, asked), asked


def judge(riding: bm.meshes.EmbeddedMesh, state, asked: np.ndarray) -> dict:
    """Measure a mesh that was moved, see `main`."""
    rng = np.random.default_rng(0)
    seed, bar, d_wall = (rng.normal(size=x.shape) for x in (riding.control_points, state.nodes, asked))
    forward, bars = np.vdot(bar, state.jvp(seed, d_wall)), state.vjp(bar)
    ratios = riding.walls.heights(state.nodes) / riding.walls.heights(riding.mesh.points)
    low, high = np.split(state.nodes[:, :2], 2)
    return {
        "n_inverted": int(np.count_nonzero(riding.mesh.quality(state.nodes).is_inverted)),
        "heights": np.percentile(ratios, [0.0, 50.0, 100.0]).tolist(),
        "missed": float(np.abs(state.nodes[riding.walls.rows] - asked).max()),
        "apart": float(np.abs(high - low).max()),
        "products": abs(np.vdot(bars["control_points"], seed) + np.vdot(bars["wall"], d_wall) - forward) / abs(forward),
    }


def n_changed(before: list[str], after: list[str], n_nodes: int) -> int:
    """Count the lines of a file that have changed and are no nodes."""
    first = next(n for n, line in enumerate(before) if line.startswith("NPOIN")) + 1
    rest = [[*lines[:first], *lines[first + n_nodes :]] for lines in (before, after)]
    return sum(a != b for a, b in zip(*rest)) + abs(len(before) - len(after))


def draw(
    folder, n_nodes: int, riding: bm.meshes.EmbeddedMesh, states: dict, triangles: np.ndarray, quads: np.ndarray
) -> None:
    """Draw the mesh after each move, and the airfoil as it was."""
    sides = [np.stack([cells, np.roll(cells, -1, axis=1)], axis=-1).reshape(-1, 2) for cells in (triangles, quads)]
    sides = np.unique(np.sort(np.concatenate(sides), axis=1), axis=0)
    wall = np.unique(riding.walls.rows % n_nodes)
    with figure(folder, "ride_section", size=(10.0, 2.1), n_colours=32) as canvas:
        panels = canvas.subplots(1, len(states), sharey=True)
        for axes, (name, (state, _)) in zip(panels, states.items()):
            lines = np.insert(state.nodes[sides, :2], 2, np.nan, axis=1).reshape(-1, 2)  # a gap after each
            axes.plot(*lines.T, color=BLUE, linewidth=0.2)
            axes.plot(*riding.mesh.points[np.append(wall, wall[0]), :2].T, color=GRAY, linewidth=1.0)
            axes.set(title=MOVES[name], aspect="equal", xlabel="$x$ (m)", xlim=(-0.15, 1.15), ylim=(-0.25, 0.25))
        panels[0].set_ylabel("$y$ (m)")


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/ride_section.png'
