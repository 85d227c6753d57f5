"""Draw the ideas that pages of the theory begin with, one small picture for each.

``python docs/draw_ideas.py`` writes ``docs/_static/ideas/*.png``; names behind it choose some. It takes 15 seconds.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from page_pictures import IDEAS, bare_panels, draw_pictures, in_plane, turned

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, GRAY, ORANGE, draw_net

PALE = "#c4c4c4"
"""Lines behind what is shown."""

VIEW = np.array([[0.80, 0.0, 0.42], [-0.28, 0.92, 0.50]])
"""Directions on paper, to the right and up, of stream, normal and span: from above, behind and outboard."""


def section_model(n_around: int, n_off: int, n_control: tuple[int, int, int], **options) -> bm.FittedModel:
    """Fit an O-grid about a section."""
    return bm.fit_grid(bm.generators.airfoil_grid("naca0012", n_around, n_off, **options), n_control=n_control)


def asked_walls(drawing) -> None:
    """A wall that no control point can follow, and the grid that meets it."""
    before, after = bare_panels(
        drawing,
        ("control points miss the given wall", "the grid with the mismatch added"),
        xlim=(0.25, 0.75),
        ylim=(0.0, 0.19),
    )
    model = section_model(160, 32, (13, 9, 2))
    surface = bm.measures.SurfaceGrid.of(model)
    grid = model.regenerate()
    nodes = grid.to_vector().reshape(-1, 3)
    wall = nodes[surface.rows]
    x = wall[:, 0]
    bump = 0.012 * np.sin(16.0 * np.pi * x) * np.exp(-(((x - 0.5) / 0.12) ** 2))
    wall = wall + np.outer(np.where(wall[:, 1] > 0.0, bump, 0.0), [0.0, 1.0, 0.0])
    met = nodes.copy()
    bm.movers.WallCorrection.of(model.topology, nodes, surface.rows).meet(met, wall)
    shape = grid.blocks[0].nodes.shape
    for axes, points, color in ((before, nodes, GRAY), (after, met, BLUE)):
        draw_net(axes, points.reshape(shape)[:, :, 0, :2], color=color, linewidth=0.5)
    order = np.argsort(x + 10.0 * (wall[:, 1] < 0.0) + 20.0 * (wall[:, 2] > wall[:, 2].min() + 1e-9))
    for axes in (before, after):
        axes.plot(*wall[order][: len(order) // 4, :2].T, color=ORANGE, linewidth=1.5)


def deformations(drawing) -> None:
    """A wing, deformed by texts."""
    texts = "twist=30deg", "bend=120deg@0.7", "sweep=20deg", "chord=0.5", "bumps=0.08,wavelength=0.8", "dihedral=15deg"
    model = bm.fit_grid(bm.generators.onera_m6_grid((21, 17, 9)), n_control=(9, 9, 5))
    mesh = bm.movers.moving_mesh(model)
    baseline = mesh.points[mesh.surface_ids]
    faces = [mesh.surface_rows[ids.take(end, axis=d)] for ids in mesh.blocks for d in range(3) for end in (0, -1)]
    for axes, text in zip(bare_panels(drawing, texts, n_rows=2, xlim=(-0.05, 2.3), ylim=(-0.35, 0.95)), texts):
        moved = bm.design.parse_deformation(text, model, mesh).apply(baseline)
        for points, color, width in ((baseline, PALE, 0.5), (moved, BLUE, 0.6)):
            for face in faces:
                if (face >= 0).all():
                    draw_net(axes, points[face] @ VIEW.T, color=color, linewidth=width)


def elasticity(drawing) -> None:
    """A section that turns, in one increment and in several."""
    numbers = 1, 2, 5
    titles = ("before", *(f"75 degrees, {n} increment{'s' if n > 1 else ''}" for n in numbers))
    row = bare_panels(drawing, titles, xlim=(-0.1, 1.1), ylim=(-0.72, 0.72))
    model = section_model(48, 24, (17, 9, 2))
    mesh = bm.movers.moving_mesh(model)
    surface = turned(mesh.points[mesh.surface_ids], np.radians(75.0))
    moved = (bm.movers.LinearElasticity(mesh, n_increments=n).move(mesh.points, surface).points for n in numbers)
    for axes, points, color in zip(row, (model.control_points, *moved), (GRAY, BLUE, BLUE, BLUE)):
        draw_net(axes, in_plane(model.regenerate(points).blocks[0]), color=color, linewidth=0.5)


def evaluation(drawing) -> None:
    """The control points that neighbouring nodes share, and the matrix."""
    net, entries = drawing.subplots(1, 2, width_ratios=(2.2, 1.0))
    model = section_model(96, 20, (21, 9, 2), far=2.0)
    grid, control = model.regenerate().blocks[0], model.mesh.nets(model.control_points)[0]
    rows = np.arange(grid.nodes[..., 0].size).reshape(grid.nodes.shape[:3])[:, :, 0]
    matrix = model.evaluator().matrix()[rows.ravel()]
    matrix.eliminate_zeros()
    columns = [frozenset(ids.tolist()) for ids in np.split(matrix.indices, matrix.indptr[1:-1])]
    shared = columns[rows.shape[1] * 66 + 9]
    alike = [n for n, ids in enumerate(columns) if ids == shared]
    draw_net(net, in_plane(grid), color=PALE, linewidth=0.4)
    draw_net(net, control[:, :, 0, :2], color=GRAY, linewidth=0.6)
    nodes, points = in_plane(grid).reshape(-1, 2)[alike], model.control_points[sorted(shared), :2]
    net.plot(*nodes.T, "o", color=BLUE, markersize=2.5, label=f"{len(alike)} nodes of one span triple")
    net.plot(*points.T, "s", color=ORANGE, markersize=4.5, label=f"the {len(shared)} control points they share")
    net.set(aspect="equal", xlim=(-0.8, 1.3), ylim=(-0.2, 1.2), xticks=(), yticks=())
    net.legend(fontsize=8, loc="upper right")
    places = matrix.tocoo()
    numbers = np.unique(places.col, return_inverse=True)[1]
    entries.plot(numbers, places.row, "s", color=GRAY, markersize=0.25, markeredgewidth=0.0)
    is_shown = np.isin(places.row, alike)
    entries.plot(numbers[is_shown], places.row[is_shown], "s", color=BLUE, markersize=1.0, markeredgewidth=0.0)
    entries.set(xlabel="control points", ylabel="nodes", xticks=(), yticks=(), ylim=(len(columns), 0))


def far_field(drawing) -> None:
    """Strips, the vortices that leave them, and the load as a sum of sines."""
    wing, load = drawing.subplots(1, 2, width_ratios=(1.2, 1.0))
    stations = np.sin(np.linspace(0.0, 0.5 * np.pi, 11))
    nose, tail = 0.25 * stations, 0.4 + 0.05 * stations
    strips = [
        [(a, nose[n]), (b, nose[n + 1]), (b, tail[n + 1]), (a, tail[n])]
        for n, (a, b) in enumerate(zip(stations[:-1], stations[1:]))
    ]
    wing.add_collection(PolyCollection(strips, facecolor=["#e5eef6", "#c5daea"] * 5, edgecolor=BLUE, linewidth=0.6))

    def circulation(s, sines=(1.0, -0.06, 0.02)):
        angle = np.arccos(np.clip(s, 0.0, 1.0))
        return sum(a * np.sin((2 * k + 1) * angle) for k, a in enumerate(sines))

    middles = 0.5 * (stations[1:] + stations[:-1])
    strengths = -np.diff(np.append(circulation(middles), 0.0))
    for s, x, strength in zip(stations[1:], tail[1:], strengths):
        wing.annotate(
            "", (s, 0.85), (s, x), arrowprops={"arrowstyle": "->", "color": ORANGE, "lw": 0.5 + 8.0 * strength}
        )
    wing.text(0.0, 0.86, "its wake: vortices as strong as the steps of the load", color=ORANGE, fontsize=8, va="top")
    wing.text(0.0, -0.02, "the wing, in strips", color=BLUE, fontsize=8)
    wing.set(aspect="equal", xlim=(-0.02, 1.04), ylim=(0.92, -0.08))
    wing.set_axis_off()
    load.stairs(circulation(middles), stations, color=BLUE, label="load of each strip")
    fine = np.cos(np.linspace(0.0, 0.5 * np.pi, 200))
    load.plot(fine, circulation(fine), color=ORANGE, linewidth=1.4, label="sum of sines")
    load.plot(fine, np.sin(np.arccos(fine)), ":", color=GRAY, linewidth=1.0, label="first sine: the lift")
    load.set(xlabel="place along the span, $s / S$", xlim=(0.0, 1.03), ylim=(0.0, 1.15), yticks=())
    load.legend(fontsize=8, loc="lower left")


def fit(drawing) -> None:
    """Parameters, nodes and control points of one block."""
    square, nodes, control = bare_panels(
        drawing, ("parameters of the nodes", "nodes of the block", "control points of the spline")
    )
    model = section_model(56, 16, (15, 6, 2), far=3.0)
    block, parameters = in_plane(model.regenerate().blocks[0]), model.parameters[0][:, :, 0, :2]
    net = model.mesh.nets(model.control_points)[0][:, :, 0, :2]
    draw_net(square, parameters, color=GRAY, linewidth=0.5)
    draw_net(nodes, block, color=GRAY, linewidth=0.5)
    draw_net(control, block, color=PALE, linewidth=0.4)
    draw_net(control, net, color=BLUE, linewidth=0.7)
    control.plot(*net.reshape(-1, 2).T, "o", color=BLUE, markersize=2.0)
    line, column = 30, 6
    for axes, points in ((square, parameters), (nodes, block)):
        axes.plot(*points[line].T, color=ORANGE, linewidth=1.3)
        axes.plot(*points[:, column].T, color=BLUE, linewidth=1.3)
    for axes in (nodes, control):
        axes.set(xlim=(-0.9, 1.9), ylim=(-1.1, 1.1))


def free_form(drawing) -> None:
    """A box around a section, and what moves with its points."""
    row = bare_panels(
        drawing,
        ("a box of control points", "its points move, and the section with them", "a box over the aft part alone"),
        xlim=(-0.13, 1.17),
        ylim=(-0.26, 0.26),
    )
    section = bm.DesignSurface.of(section_model(96, 16, (33, 9, 2)))
    mesh = section.mesh
    baseline = mesh.points[mesh.surface_ids]

    def moved_by(lattice, motion):
        shape = bm.design.FreeForm("shape", lattice, direction="y")
        parametrization = section.parametrization([shape])
        ids, _ = shape.places(parametrization.layout)
        values = motion(lattice.points[ids])
        net = lattice.control_points.copy()
        i, j, _ = np.unravel_index(ids, net.shape[:3])
        net[i, j, :, 1] += values[:, None]
        points = mesh.points.copy()
        points[mesh.surface_ids] = parametrization.apply(baseline, {"shape": values})
        return net[:, :, 0, :2], in_plane(section.model.regenerate(points).blocks[0])[:, 0]

    around = bm.design.Lattice.box(mesh, n=(6, 3, 2), margin=0.1)
    aft = bm.design.Lattice.box([[0.45, -0.08, -1.0], [1.1, 0.08, 2.0]], n=(6, 3, 2), margin=0.0)
    cases = (
        (around, lambda p: 0.0 * p[:, 0]),
        (around, lambda p: 0.12 * np.sin(3.0 * p[:, 0]) * (1.0 + 3.0 * p[:, 1])),
        (aft, lambda p: -0.12 * np.maximum(p[:, 0] - 0.6, 0.0) / 0.5),
    )
    still = in_plane(section.model.regenerate().blocks[0])[:, 0]
    for axes, (lattice, motion) in zip(row, cases):
        net, curve = moved_by(lattice, motion)
        axes.plot(*still.T, color=PALE, linewidth=1.0)
        draw_net(axes, net, color=ORANGE, linewidth=0.7)
        axes.plot(*net.reshape(-1, 2).T, "s", color=ORANGE, markersize=3.0)
        axes.plot(*curve.T, color=BLUE, linewidth=1.4)


def linear_constraints(drawing) -> None:
    """A ball whose sides move, with and without one tangent plane across the seams."""
    row = bare_panels(drawing, ("a ball of six sides", "sides move, seams stay", "seams follow: TangentContinuity"))
    model = bm.fit_grid(bm.generators.ball_grid((33, 33, 33, 5)), n_control=(7, 7, 4))
    mesh = bm.movers.moving_mesh(model)
    points = model.control_points.copy()
    points[mesh.surface_ids] = bm.constraints.TangentContinuity().snapped(mesh, points[mesh.surface_ids])
    model = replace(model, control_points=points, residual=None)
    mesh = bm.movers.moving_mesh(model)
    baseline = mesh.points[mesh.surface_ids]
    sizes = np.sort(np.abs(baseline), axis=1)
    inside = np.flatnonzero(sizes[:, 2] > 1.000001 * sizes[:, 1])
    rays = baseline[inside] / np.linalg.norm(baseline[inside], axis=1)[:, None]
    heights = 0.22 * np.sin(7.0 * rays @ [0.5, 0.7, 0.6]) * np.cos(5.0 * rays @ [0.8, -0.4, 0.3])
    away = np.array([-0.75, -0.45, 0.5])
    right = np.cross([0.0, 0.0, 1.0], away)
    view = np.array([right / np.linalg.norm(right), np.cross(away, right) / np.linalg.norm(np.cross(away, right))])
    light = np.array([-0.35, -0.75, 0.55])
    for axes, ways in zip(row, (None, [], [bm.constraints.TangentContinuity()])):
        moved = points.copy()
        if ways is not None:
            swelling = bm.design.Local("swelling", inside, direction=rays)
            parametrization = bm.design.Parametrization(mesh, [swelling], constraints=ways)
            moved[mesh.surface_ids] = parametrization.apply(baseline, {"swelling": heights})
        grid = model.regenerate(moved)
        for patch in grid.patches:
            for window in patch.windows if patch.kind == "wall" else ():
                nodes = np.squeeze(grid.blocks[window.block].nodes[window.slices])
                corners = nodes[:-1, :-1], nodes[1:, :-1], nodes[1:, 1:], nodes[:-1, 1:]
                quads = np.stack(corners, axis=2).reshape(-1, 4, 3)
                normals = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
                normals *= np.sign(np.sum(normals * quads.mean(axis=1), axis=1))[:, None]
                normals /= np.linalg.norm(normals, axis=1)[:, None]
                seen = normals @ away > 0.0
                shade = 0.3 + 0.7 * np.clip(normals @ light / np.linalg.norm(light), 0.0, 1.0)
                colors = np.clip(shade[:, None] * np.array([[0.62, 0.80, 0.95]]), 0.0, 1.0)
                faces = PolyCollection(quads[seen] @ view.T, color=colors[seen], linewidth=0.3)
                axes.add_collection(faces)
        axes.autoscale_view()


def ride(drawing) -> None:
    """Triangles that move with the volumes of a coarse grid."""
    before, after = bare_panels(
        drawing,
        ("a control mesh, and a mesh of triangles", "the control mesh moves, and the triangles with it"),
        xlim=(-0.3, 1.3),
        ylim=(-0.45, 0.45),
    )
    model = section_model(48, 24, (13, 8, 2))
    nodes = in_plane(bm.generators.airfoil_grid("naca0012", 64, 32, far=12.0).blocks[0])[:-1].copy()
    ids = np.vstack([np.arange(nodes[..., 0].size).reshape(nodes.shape[:2]), np.arange(nodes.shape[1])])
    a, b, c, d = ids[:-1, :-1].ravel(), ids[1:, :-1].ravel(), ids[1:, 1:].ravel(), ids[:-1, 1:].ravel()
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    lines = np.stack([ids[:-1, 0], ids[1:, 0]], axis=1)
    shift = np.random.default_rng(1).uniform(-0.22, 0.22, nodes.shape)
    steps = np.linalg.norm(np.diff(nodes[:, :-1], axis=0, append=nodes[:1, :-1]), axis=2)
    steps = np.minimum(steps, np.linalg.norm(np.diff(nodes, axis=1), axis=2))
    nodes[:, 1:-1] += (steps[..., None] * shift[:, :-1])[:, 1:]
    cells = [f"5 {p} {q} {r}" for p, q, r in triangles.tolist()]
    text = ["NDIME= 2", f"NELEM= {len(cells)}", *cells, f"NPOIN= {nodes[..., 0].size}"]
    text += [f"{x!r} {y!r}" for x, y in nodes.reshape(-1, 2).tolist()]
    text += ["NMARK= 1", "MARKER_TAG= airfoil", f"MARKER_ELEMS= {len(lines)}", *(f"3 {p} {q}" for p, q in lines)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "airfoil.su2")
        path.write_text("\n".join([*text, ""]))
        mesh = bm.meshes.EmbeddedMesh.of(model, bm.files.read_mesh(path, bm.meshes.section_span(model)).mesh)
    control = bm.movers.moving_mesh(model)
    surface = turned(control.points[control.surface_ids], np.radians(20.0))
    moved = bm.movers.LinearElasticity(control).move(control.points, surface).points
    wall = turned(mesh.walls.initial, np.radians(20.0))
    states = (model.control_points, mesh.mesh.points), (moved, mesh.at(moved, wall).nodes)
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    for axes, (points, places) in zip((before, after), states):
        axes.add_collection(LineCollection(places[edges, :2], color=GRAY, linewidth=0.3))
        net = model.mesh.nets(points)[0][:, :, 0, :2]
        draw_net(axes, net, color=ORANGE, linewidth=0.9)
        axes.plot(*net.reshape(-1, 2).T, "s", color=ORANGE, markersize=2.5)


PICTURES = {
    asked_walls: (8.0, 1.9), deformations: (8.0, 3.5), elasticity: (8.0, 2.4), evaluation: (7.5, 2.9),
    far_field: (7.5, 2.7), fit: (8.0, 2.3), free_form: (8.5, 1.6), linear_constraints: (7.5, 2.6), ride: (8.0, 2.6),
}  # fmt: skip
"""What draws, and sizes in inches."""


if __name__ == "__main__":
    draw_pictures(IDEAS, PICTURES, sys.argv[1:])
