"""Draw the pictures at the heads of the pages of theory on the movement of grids.

``python docs/draw_motion.py [NAME ...]`` writes ``docs/_static/ideas/NAME.png``, all of them without names. Those of
rotations, movers and lattices are what the movers make; the others are sketches with the formulas of their pages.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from page_pictures import IDEAS, bare, chosen, turned
from scipy.spatial import Delaunay

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, GRAY, GREEN, ORANGE, draw_net, figure

PITCH = np.deg2rad(90.0)
"""Angle by which the section turns, nose up: large enough for a linear solid to distort."""


def pitching(movers: dict, angle: float, **spacing):
    """Yield names, and nets of control points about a section that turns by an angle, as each mover moves them."""
    grid = bm.generators.section_o_grid(bm.generators.naca_section(0.12), 64, far=6.0, **spacing)
    mesh = bm.movers.moving_mesh(bm.fit_grid(grid, n_control=[(33, 13, 2)]))
    for name, make in movers.items():
        points = mesh.points
        if make is not None:
            points = make(mesh).move(mesh.points, turned(mesh.points[mesh.surface_ids], angle)).points
        yield name, points[mesh.blocks[0]][:, :, 0, :2]


def smallest_sine(net: np.ndarray) -> float:
    """Find the smallest sine of an angle between edges at the corners of the quads of a net."""
    corners = np.stack([net[:-1, :-1], net[1:, :-1], net[1:, 1:], net[:-1, 1:]])
    edges = np.roll(corners, -1, axis=0) - corners
    edges /= np.linalg.norm(edges, axis=-1, keepdims=True)
    before = np.roll(edges, 1, axis=0)
    sines = before[..., 0] * edges[..., 1] - before[..., 1] * edges[..., 0]
    return float((sines * np.sign(np.median(sines))).min())


def rotations() -> None:
    """Draw a section that turns, by one increment of elasticity and by rotations."""
    movers = {
        "baseline": None,
        "linear elasticity, one increment": lambda mesh: bm.movers.LinearElasticity(mesh, n_increments=1),
        "rotations": bm.movers.Rotations,
    }
    with figure(IDEAS, "rotations", (8.5, 2.9), n_colours=16) as drawing:
        for axes, (name, net) in zip(drawing.subplots(1, 3), pitching(movers, PITCH, off_wall=2e-3)):
            draw_net(axes, net, color=GRAY, linewidth=0.5)
            axes.plot(*net[:, 0].T, color=BLUE, linewidth=1.6)
            bare(axes, f"{name}\nsmallest corner {smallest_sine(net):.2f}", xlim=(-0.4, 1.4), ylim=(-0.8, 0.8))


def movers() -> None:
    """Draw a section that turns less, by each mover that interpolates."""
    kinds = {
        "fixed interior": bm.movers.FixedInterior,
        "transfinite": bm.movers.Transfinite,
        "inverse distance": bm.movers.InverseDistance,
        "radial basis": bm.movers.RadialBasis,
        "Delaunay graph": lambda mesh: bm.movers.DelaunayGraph(mesh, n_increments=2),
    }
    with figure(IDEAS, "movers", (9.0, 2.1), n_colours=16) as drawing:
        for axes, (name, net) in zip(drawing.subplots(1, 5), pitching(kinds, np.deg2rad(20.0))):
            draw_net(axes, net, color=GRAY, linewidth=0.5)
            axes.plot(*net[:, 0].T, color=BLUE, linewidth=1.6)
            bare(axes, name, xlim=(-0.5, 1.5), ylim=(-0.9, 0.9))


def springs() -> None:
    """Draw an element of four edges with the springs that resist changes of lengths and of angles."""
    corners = np.array([[0.0, 0.0], [2.2, 0.0], [2.5, 1.2], [0.3, 1.4]])
    ways = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3)]
    with figure(IDEAS, "springs", (7.0, 2.2), n_colours=16) as drawing:
        left, right = drawing.subplots(1, 2)
        for axes in (left, right):
            axes.fill(*corners.T, facecolor="#eef3f7", edgecolor=GRAY, linewidth=0.8)
        for first, last in ways:
            a, b = corners[first], corners[last]
            along, t = b - a, np.linspace(0.0, 1.0, 81)
            normal = np.array([-along[1], along[0]]) / np.hypot(*along)
            teeth = np.where((t > 0.15) & (t < 0.85), 0.07 * np.sin(2 * np.pi * 9 * (t - 0.15) / 0.7), 0.0)
            line = a + np.outer(t, along) + np.outer(teeth, normal)
            left.plot(*line.T, color=BLUE, linewidth=0.9)
        for n, corner in enumerate(corners):
            before, after = corners[n - 1] - corner, corners[(n + 1) % 4] - corner
            start, end = (np.arctan2(d[1], d[0]) for d in (after, before))
            angle = start + np.linspace(0.0, 1.0, 60) * ((end - start) % (2 * np.pi))
            for radius in (0.2, 0.26, 0.32):
                arc = corner + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
                right.plot(*arc.T, color=ORANGE, linewidth=1.0)
        for axes, title in ((left, "lineal: edges and diagonals"), (right, "torsional: corners")):
            axes.plot(*corners.T, "o", color="black", markersize=4)
            bare(axes, title, xlim=(-0.3, 2.8), ylim=(-0.25, 1.6))


def grid_map() -> None:
    """Draw a node off the spline by its residual, which stays as it is or rotates with the grid."""
    t = np.linspace(0.0, 1.0, 100)
    curve = np.stack([t, 0.25 * t * (1.0 - t)], axis=1)
    foot, residual = curve[50], np.array([0.0, 0.22])
    angle = np.deg2rad(-50.0)
    panels = {
        "baseline": (0.0, 0.0),
        "the residual stays": (angle, 0.0),
        "the residual rotates": (angle, angle),
    }
    with figure(IDEAS, "grid_map", (8.0, 2.1), n_colours=16) as drawing:
        for axes, (title, (of_grid, of_residual)) in zip(drawing.subplots(1, 3), panels.items()):
            axes.plot(*turned(curve, of_grid).T, color=BLUE, linewidth=1.6)
            place = turned(foot, of_grid)
            for shift in (-0.25, 0.25):
                ends = np.array([foot + (shift, 0.0), foot + (shift, 0.35)])
                axes.plot(*turned(ends, of_grid).T, color=GRAY, linewidth=0.8)
            end = place + turned(residual, of_residual, (0.0, 0.0))
            axes.annotate("", end, place, arrowprops={"arrowstyle": "-|>", "color": ORANGE, "lw": 1.6})
            axes.plot(*end, "o", color="black", markersize=5)
            bare(axes, title, xlim=(-0.1, 1.1), ylim=(-0.5, 0.65))


def wall_layer() -> None:
    """Draw nodes above a wall that turns, and the weight with which they follow it."""
    s = np.linspace(0.0, 1.2, 200)
    weight = np.where(s < 1.0, (1.0 - s) ** 3 * (1.0 + 3.0 * s + 6.0 * s**2), 0.0)
    heights = np.array([0.0, 0.05, 0.11, 0.19, 0.29, 0.42, 0.58, 0.78, 1.0])
    follow = np.where(heights < 1.0, (1.0 - heights) ** 3 * (1.0 + 3.0 * heights + 6.0 * heights**2), 0.0)
    x = np.linspace(-0.6, 0.6, 9)
    rest = np.stack(np.meshgrid(x, heights, indexing="ij"), axis=-1)
    rigid = turned(rest, np.deg2rad(25.0), (0.0, 0.0))
    others = rest + 0.4 * (turned(rest * (1.0, 0.0), np.deg2rad(25.0), (0.0, 0.0)) - rest * (1.0, 0.0))
    moved = others + follow[None, :, None] * (rigid - others)
    with figure(IDEAS, "wall_layer", (8.0, 2.4), n_colours=16) as drawing:
        left, middle, right = drawing.subplots(1, 3, width_ratios=(1.0, 1.0, 1.2))
        for axes, net, title in ((left, rest, "baseline"), (middle, moved, "wall turned by 25 degrees")):
            draw_net(axes, net, color=GRAY, linewidth=0.7)
            axes.plot(*net[:, 0].T, color=BLUE, linewidth=2.2)
            bare(axes, title, xlim=(-0.75, 0.95), ylim=(-0.35, 1.1))
        right.plot(s, weight, color=ORANGE)
        right.axvline(0.05, color=GRAY, linewidth=0.8, linestyle=":")
        right.text(0.08, 0.08, "first node", color=GRAY, fontsize=9)
        right.set(xlabel="distance from the wall / reach", ylabel=r"weight $\beta$", xlim=(0.0, 1.2), ylim=(0.0, 1.05))
        right.spines[["top", "right"]].set_visible(False)


def sliding() -> None:
    """Draw nodes on a casing that control points move off it, and their closest points."""
    angles, casing = np.deg2rad(np.linspace(68.0, 112.0, 9)), np.deg2rad(np.linspace(62.0, 118.0, 100))
    rest = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = rest + np.exp(-(((np.arange(9) - 4.0) / 2.2) ** 2))[:, None] * (0.15, 0.035)
    closest = points / np.linalg.norm(points, axis=1, keepdims=True)
    steps = {"at rest": (rest, BLUE), "moved by control points": (points, ORANGE), "closest points": (closest, BLUE)}
    with figure(IDEAS, "sliding", (8.0, 1.8), n_colours=16) as drawing:
        for axes, (title, (nodes, color)) in zip(drawing.subplots(1, 3), steps.items()):
            axes.plot(np.cos(casing), np.sin(casing), color=GRAY, linewidth=1.4)
            for line, (root, node) in enumerate(zip(0.78 * rest, nodes)):
                axes.plot(*np.stack([root, node]).T, color=BLUE if line == 4 else GRAY, lw=2.4 if line == 4 else 0.6)
            if nodes is closest:
                axes.plot(*points.T, "o", color="white", markeredgecolor=ORANGE, markersize=4)
            axes.plot(*nodes.T, "o", color=color, markersize=4)
            bare(axes, title, xlim=(-0.5, 0.5), ylim=(0.7, 1.09))


def processes() -> None:
    """Draw a grid that three processes share, and its control mesh, which all of them have."""
    grid = bm.generators.section_o_grid(bm.generators.naca_section(0.12), 72, far=4.0)
    model = bm.fit_grid(grid, n_control=[(19, 9, 2)])
    nodes = grid.blocks[0].nodes[:, :, 0, :2]
    net = model.control_points[bm.movers.moving_mesh(model).blocks[0]][:, :, 0, :2]
    window = {"xlim": (-1.2, 2.2), "ylim": (-1.1, 1.1)}
    with figure(IDEAS, "processes", (7.5, 2.6), n_colours=32) as drawing:
        left, right = drawing.subplots(1, 2)
        for n, color in enumerate((BLUE, ORANGE, GREEN)):
            draw_net(left, nodes[24 * n : 24 * n + 25], color=color, linewidth=0.5)
        draw_net(right, net, color=GRAY, linewidth=0.6)
        right.plot(*net.reshape(-1, 2).T, "o", color="black", markersize=2)
        bare(left, "nodes: each process has its part", **window)
        bare(right, "control points: every process has all", **window)


def triangles_about_section(path: Path) -> np.ndarray:
    """Write a mesh of triangles about the NACA 0012 as SU2 does, and return its triangles."""
    rings = bm.generators.section_o_grid(bm.generators.naca_section(0.12), 48, far=4.0).blocks[0].nodes[:-1, :, 0, :2]
    sizes = np.linalg.norm(rings[:, 2:] - rings[:, 1:-1], axis=-1, keepdims=True)
    rings[:, 1:-1] += 0.25 * sizes * np.random.default_rng(0).uniform(-1.0, 1.0, (*sizes.shape[:2], 2))
    points, ring = rings.swapaxes(0, 1).reshape(-1, 2), np.arange(len(rings))
    triangles = Delaunay(points).simplices
    triangles = triangles[(triangles >= len(ring)).any(axis=1)]
    rows = [f"NDIME= 2\nNELEM= {len(triangles)}", *("5 {} {} {}".format(*corners) for corners in triangles)]
    rows += [f"NPOIN= {len(points)}", *("{} {}".format(*point) for point in points.tolist()), "NMARK= 2"]
    for name, start in (("airfoil", 0), ("farfield", len(points) - len(ring))):
        rows += [f"MARKER_TAG= {name}\nMARKER_ELEMS= {len(ring)}"]
        rows += [f"3 {start + n} {start + (n + 1) % len(ring)}" for n in ring]
    path.write_text("\n".join([*rows, ""]))
    return triangles


def background_lattice() -> None:
    """Draw a mesh of triangles in its lattice, and both moved."""
    with tempfile.TemporaryDirectory() as folder:
        triangles = triangles_about_section(Path(folder) / "mesh.su2")
        model = bm.meshes.fit_mesh(Path(folder) / "mesh.su2")
    mesh = model.moving_mesh
    rest = mesh.points
    moved = model.mover.move(rest, turned(rest[mesh.surface_ids], np.deg2rad(40.0))).points
    window = {"xlim": (-0.9, 1.9), "ylim": (-0.9, 0.9)}
    with figure(IDEAS, "background_lattice", (8.5, 2.2), n_colours=64) as drawing:
        states = {
            "mesh in its lattice": rest,
            "walls move, the lattice follows": moved,
            "nodes follow the lattice": moved,
        }
        for n, (axes, (title, points)) in enumerate(zip(drawing.subplots(1, 3), states.items())):
            nodes = model.node_map.at(points).nodes
            if n != 1:
                axes.triplot(*nodes[: triangles.max() + 1, :2].T, triangles, color=GRAY, linewidth=0.4)
            if n != 2:
                draw_net(axes, points[model.control_ids[0]][:, :, 0, :2], color=ORANGE, linewidth=0.7)
            wall = nodes[np.r_[:48, 0], :2]
            axes.fill(*wall.T, facecolor="white", edgecolor=BLUE, linewidth=1.4, zorder=3)
            bare(axes, title, **window)


DRAWN = (rotations, movers, springs, grid_map, wall_layer, sliding, background_lattice, processes)


if __name__ == "__main__":
    for draw in chosen(DRAWN, sys.argv[1:]):
        draw()
