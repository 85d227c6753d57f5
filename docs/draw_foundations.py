"""Draw the pictures at the heads of the pages of theory on grids, splines, measures and solvers.

``python docs/draw_foundations.py [NAME ...]`` writes ``docs/_static/ideas/NAME.png``, all of them without names.
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib.colors import to_rgb
from page_pictures import IDEAS, bare, chosen
from scipy.interpolate import BSpline

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, GRAY, GREEN, ORANGE, RED, draw_net, figure

PALE = "#eef3f7"
"""Colour of the inside of a body."""


def arrow(axes, start, end, color=GRAY) -> None:
    """Draw an arrow."""
    axes.annotate(
        "", end, start, arrowprops={"arrowstyle": "-|>", "color": color, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
    )


def quality() -> None:
    """Draw a corner that folds, with its sine, and a soft minimum of two numbers."""
    corners = {"orthogonal": 90.0, "sheared": 40.0, "flat": 0.0, "folded": -30.0}
    with figure(IDEAS, "quality", (9.0, 2.2), n_colours=32) as drawing:
        panels = drawing.subplots(1, 5, width_ratios=(1, 1, 1, 1, 1.5))
        for axes, (name, degrees) in zip(panels, corners.items()):
            up = np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))])
            color = RED if degrees < 0.0 else BLUE
            arrow(axes, (0.0, 0.0), (1.0, 0.0), color)
            arrow(axes, (0.0, 0.0), 0.9 * up, color)
            axes.plot(0.0, 0.0, "o", color="black", markersize=4)
            bare(axes, f"{name}\n{up[1]:.2f}", xlim=(-0.25, 1.15), ylim=(-0.65, 1.05))
        x = np.linspace(0.0, 0.6, 200)
        axes = panels[-1]
        axes.plot(x, np.minimum(x, 0.3), color=GRAY, label="minimum")
        for rho, color in ((100.0, BLUE), (20.0, ORANGE)):
            soft = -np.logaddexp(-rho * x, -rho * 0.3) / rho
            axes.plot(x, soft, color=color, label=rf"KS, $\rho$ = {rho:.0f}")
        axes.set(xlabel="one corner; the other is 0.3", xlim=(0.0, 0.6), ylim=(-0.05, 0.35))
        axes.legend(fontsize=8, loc="lower right")
        axes.spines[["top", "right"]].set_visible(False)


def halves(coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the Bernstein coefficients of a quadratic on both halves, by de Casteljau's algorithm."""
    a, b, c = coefficients
    left, right = 0.5 * (a + b), 0.5 * (b + c)
    middle = 0.5 * (left + right)
    return np.array([a, left, middle]), np.array([middle, right, c])


def validity() -> None:
    """Draw quadratics along an edge with their Bernstein coefficients: invalid, undecided, and proved by halving."""
    t = np.linspace(0.0, 1.0, 100)
    cases = {
        "positive at corners, not inside": [np.array([0.5, -1.1, 0.9])],
        "undecided: a coefficient is negative": [np.array([0.5, -0.25, 0.9])],
        "halved: valid": [*halves(np.array([0.5, -0.25, 0.9]))],
    }
    with figure(IDEAS, "validity", (8.5, 2.2), n_colours=16) as drawing:
        for axes, (title, pieces) in zip(drawing.subplots(1, 3, sharey=True), cases.items()):
            axes.axhline(0.0, color=GRAY, linewidth=0.8)
            for n, (a, b, c) in enumerate(pieces):
                s = (n + t) / len(pieces)
                axes.plot(s, a * (1 - t) ** 2 + 2 * b * t * (1 - t) + c * t**2, color=BLUE)
                places = (n + np.array([0.0, 0.5, 1.0])) / len(pieces)
                axes.plot(places, [a, b, c], "o--", color=ORANGE, markersize=4, linewidth=0.9)
            axes.set_title(title, fontsize=10)
            axes.set(xlabel="along an edge", xlim=(-0.03, 1.03))
            axes.spines[["top", "right"]].set_visible(False)
            axes.tick_params(labelsize=8)
        drawing.axes[0].set_ylabel("Jacobian")


def topology() -> None:
    """Draw two blocks that meet in opposite directions, a C-grid folded onto itself, and a declared plate."""
    with figure(IDEAS, "topology", (9.0, 2.3), n_colours=32) as drawing:
        left, middle, right = drawing.subplots(1, 3)
        x, y = np.meshgrid(np.linspace(0.0, 1.0, 6), np.linspace(0.0, 1.0, 5), indexing="ij")
        first, second = np.stack([x, y + 0.1 * x], axis=-1), np.stack([x + 1.0, y + 0.1 - 0.1 * x], axis=-1)
        for net, color in ((first, BLUE), (second, GREEN)):
            draw_net(left, net, color=color, linewidth=0.7)
        left.plot(*first[-1].T, "o-", color=ORANGE, markersize=4)
        for start, i, j in (((0.1, 0.1), (0.35, 0.0), (0.0, 0.35)), ((1.9, 0.92), (0.0, -0.35), (-0.35, 0.0))):
            for step, name in ((i, "i"), (j, "j")):
                end = np.add(start, step)
                arrow(left, start, end, "black")
                left.text(*(end + 0.15 * np.array(step)), name, fontsize=9, ha="center", va="center", style="italic")
        bare(left, "interface, any orientation", xlim=(-0.1, 2.1), ylim=(-0.2, 1.3))
        grid = bm.generators.airfoil_grid("naca0012", 48, 12, topology="C")
        for block in grid.blocks:
            draw_net(middle, block.nodes[:, :, 0, :2], color=BLUE, linewidth=0.5)
        wake = np.concatenate([block.nodes[:, 0, 0, :2] for block in grid.blocks])
        wake = wake[np.abs(wake[:, 1]) < 1e-9]
        wake = wake[(wake[:, 0] >= 1.0) & (wake[:, 0] < 1.9)]
        middle.plot(*wake[np.argsort(wake[:, 0])].T, "o-", color=ORANGE, markersize=3)
        bare(middle, "face folded onto itself", xlim=(-0.3, 1.9), ylim=(-0.75, 0.75))
        x, y = np.meshgrid(np.linspace(0.0, 2.0, 11), np.linspace(0.0, 0.7, 5), indexing="ij")
        for sign, color in ((1.0, BLUE), (-1.0, GREEN)):
            draw_net(right, np.stack([x, sign * (y + 0.02)], axis=-1), color=color, linewidth=0.7)
        right.plot([0.6, 1.4], [0.0, 0.0], color="black", linewidth=5.0, solid_capstyle="butt")
        for part in ((0.0, 0.2, 0.4, 0.6), (1.4, 1.6, 1.8, 2.0)):
            right.plot(part, np.zeros(len(part)), "o-", color=ORANGE, markersize=4)
        bare(right, "declared walls stay apart", xlim=(-0.1, 2.1), ylim=(-0.8, 0.8))


def high_order() -> None:
    """Draw elements of degrees 1 to 3 about a quarter of a circle, and the error of their walls."""
    angles = np.linspace(0.0, 0.5 * np.pi, 400)
    with figure(IDEAS, "high_order", (9.0, 2.3), n_colours=32) as drawing:
        panels = drawing.subplots(1, 4, width_ratios=(1, 1, 1, 1.5))
        for axes, degree, color in zip(panels, (1, 2, 3), (ORANGE, GREEN, BLUE)):
            axes.plot(np.cos(angles), np.sin(angles), color=GRAY, linewidth=0.8)
            for start in (0.0, 0.25 * np.pi):
                at = start + 0.25 * np.pi * np.linspace(0.0, 1.0, degree + 1)
                t = np.linspace(0.0, 1.0, 100)
                wall = np.stack(
                    [np.polyval(np.polyfit(at, f(at), degree), start + 0.25 * np.pi * t) for f in (np.cos, np.sin)]
                )
                for radius in (1.0, 1.5):
                    axes.plot(*(radius * wall), color=color)
                    axes.plot(radius * np.cos(at), radius * np.sin(at), "o", color="black", markersize=3)
                for end in at[[0, -1]]:
                    axes.plot(np.cos(end) * np.array([1.0, 1.5]), np.sin(end) * np.array([1.0, 1.5]), color=color)
                place = (start + 0.25 * np.pi * t) * 2.0 / np.pi
                panels[-1].semilogy(place, np.abs(np.hypot(*wall) - 1.0) + 1e-9, color=color, linewidth=1.0)
            bare(axes, f"degree {degree}", xlim=(-0.1, 1.6), ylim=(-0.1, 1.6))
        panels[-1].set(xlabel="along the wall", ylabel="error / radius", ylim=(1e-7, 0.3), xlim=(0.0, 1.0))
        panels[-1].spines[["top", "right"]].set_visible(False)


def warped(at: np.ndarray) -> np.ndarray:
    """Map parameters (..., 2) to points of a curved patch."""
    u, v = at[..., 0], at[..., 1]
    return np.stack([2.0 * u + 0.35 * np.sin(3.0 * v), v + 0.5 * u * u * (1.0 - 0.6 * v)], axis=-1)


def inversion() -> None:
    """Draw the descent from the nearest sample to the parameters of a point."""
    lines = np.stack(np.meshgrid(*2 * (np.linspace(0.0, 1.0, 41),), indexing="ij"), axis=-1)
    samples = np.stack(np.meshgrid(*2 * (np.arange(0.125, 1.0, 0.25),), indexing="ij"), axis=-1).reshape(-1, 2)
    target = warped(np.array([0.52, 0.77]))
    at = samples[np.argmin(np.linalg.norm(warped(samples) - target, axis=1))]
    path = [at]
    for _ in range(4):
        jacobian = np.stack([(warped(at + 1e-6 * e) - warped(at - 1e-6 * e)) / 2e-6 for e in np.eye(2)], axis=1)
        at = np.clip(at - np.linalg.solve(jacobian, warped(at) - target), 0.0, 1.0)
        path.append(at)
    with figure(IDEAS, "inversion", (7.5, 2.4), n_colours=64) as drawing:
        for axes, shape, title in zip(drawing.subplots(1, 2), (lambda at: at, warped), ("parameters", "volume")):
            for net in (lines[::5], lines[:, ::5].swapaxes(0, 1)):
                for line in net:
                    axes.plot(*shape(line).T, color=GRAY, linewidth=0.5)
            axes.plot(*shape(samples).T, ".", color=GRAY, markersize=4)
            axes.plot(*shape(np.array(path)).T, "o-", color=ORANGE, markersize=4, linewidth=1.2)
            axes.plot(*shape(np.array(path))[-1], "*", color=BLUE, markersize=12)
            bare(axes, title)


def progressive() -> None:
    """Draw the same curve with few control points and, after knot insertion, with more."""
    knots = np.array([0.0] * 4 + [0.5] + [1.0] * 4)
    points = np.array([[0.0, 0.0], [0.0, 0.55], [0.5, 0.75], [1.0, 0.25], [1.0, 0.0]])
    t = np.linspace(0.0, 1.0, 200)
    with figure(IDEAS, "progressive", (8.5, 1.9), n_colours=16) as drawing:
        panels = drawing.subplots(1, 3)
        for axes, new in zip(panels, ((), (0.25, 0.75), (0.125, 0.375))):
            for knot in new:
                spline = BSpline(knots, points, 3).insert_knot(knot)
                knots, points = spline.t, spline.c[: len(spline.t) - 4]
            curve = BSpline(knots, points, 3)
            axes.plot(*curve(t).T, color=BLUE, linewidth=1.8)
            axes.plot(*points.T, "o--", color=ORANGE, markersize=4, linewidth=0.8)
            axes.plot(*curve(np.unique(knots)).T, "s", color="black", markersize=3)
            bare(axes, f"{len(points)} control points", xlim=(-0.08, 1.08), ylim=(-0.05, 0.82))


def geometry() -> None:
    """Draw a section with what is measured of it."""
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 120)))
    half = 5.0 * 0.15 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    camber = 0.04 * np.where(x < 0.4, (0.8 * x - x * x) / 0.16, (0.2 + 0.8 * x - x * x) / 0.36)
    upper, lower = camber + half, camber - half
    with figure(IDEAS, "geometry", (8.0, 2.3), n_colours=32) as drawing:
        axes = drawing.subplots()
        axes.fill_between(x, lower, upper, color=PALE)
        axes.plot(x, upper, color=BLUE)
        axes.plot(x, lower, color=BLUE)
        for place in np.arange(0.1, 0.95, 0.1):
            ends = [np.interp(place, x, side) for side in (lower, upper)]
            axes.plot([place, place], ends, "o-", color=ORANGE, linewidth=0.9, markersize=3)
        radius, turn = 1.1019 * 0.15**2, np.linspace(0.0, 2.0 * np.pi, 80)
        axes.plot(radius * (1.0 + np.cos(turn)), radius * np.sin(turn) + 0.006, color=GREEN, linewidth=1.2)
        for side in (upper, lower):
            slope = (side[-1] - side[-12]) / (x[-1] - x[-12])
            axes.plot([0.8, 1.0], [side[-1] - 0.2 * slope, side[-1]], color=RED, linewidth=1.0)
        labels = (
            (-0.02, 0.105, "leading edge radius", GREEN, "left"),
            (0.45, -0.085, "thickness", ORANGE, "center"),
            (0.97, 0.075, "trailing edge angle", RED, "right"),
            (0.45, 0.05, "area, volume", "black", "center"),
        )
        for along, across, text, color, side in labels:
            box = {"facecolor": PALE, "edgecolor": "none", "pad": 1.5} if color == "black" else None
            axes.text(along, across, text, color=color, ha=side, fontsize=10, bbox=box)
        bare(axes, "", xlim=(-0.05, 1.05), ylim=(-0.1, 0.135))


def grid_files() -> None:
    """Draw how a file of two blocks may be laid out: whole, plane-wise, and in records."""
    colors = {"n": "#bbbbbb", "x": BLUE, "y": ORANGE, "z": GREEN, "m": "black"}
    boxes = {"height": 0.9, "edgecolor": "white", "linewidth": 0.6}
    layouts = {
        "whole": "nn" + 4 * "x" + 4 * "y" + 4 * "z" + 6 * "x" + 6 * "y" + 6 * "z",
        "plane-wise": "nn" + 2 * "xxyyzz" + 3 * "xxyyzz",
        "in records": "mnnm" + "m" + 4 * "x" + 4 * "y" + 4 * "z" + "mm" + 6 * "x" + 6 * "y" + 6 * "z" + "m",
    }
    with figure(IDEAS, "grid_files", (8.5, 1.7), n_colours=16) as drawing:
        axes = drawing.subplots()
        for row, (name, cells) in enumerate(layouts.items()):
            start = 0.0
            for cell in cells:
                width = 0.35 if cell == "m" else 1.0
                axes.barh(-1.3 * row, width, left=start, color=colors[cell], align="edge", **boxes)
                start += width
            axes.text(-0.5, 0.45 - 1.3 * row, name, ha="right", va="center")
        legend = {
            "n": (0.0, "node counts"),
            "x": (7.0, "x"),
            "y": (10.0, "y"),
            "z": (13.0, "z"),
            "m": (16.0, "record marker"),
        }
        for cell, (along, text) in legend.items():
            axes.barh(-4.1, 0.35 if cell == "m" else 1.0, left=along, color=colors[cell], align="edge", **boxes)
            axes.text(along + 1.3, -3.65, text, va="center", fontsize=9)
        bare(axes, "", aspect="auto", xlim=(-4.5, 37.5), ylim=(-4.3, 1.2))


def mesh_graph(n: int) -> np.ndarray:
    """Make the matrix of five points on a square of n by n points, positive definite."""
    line = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    return np.kron(line, np.eye(n)) + np.kron(np.eye(n), line) + 0.01 * np.eye(n * n)


def dissected(rows: np.ndarray, levels: np.ndarray, level: int = 0) -> list[int]:
    """Order points of a rectangle by nested dissection, and note the level of each separator."""
    if min(rows.shape) < 3:
        return rows.ravel().tolist()
    if rows.shape[0] < rows.shape[1]:
        rows = rows.T
    middle = rows.shape[0] // 2
    levels[rows[middle]] = level
    parts = [dissected(part, levels, level + 1) for part in (rows[:middle], rows[middle + 1 :])]
    return [*parts[0], *parts[1], *rows[middle].tolist()]


def spy(axes, matrix: np.ndarray, title: str) -> None:
    """Draw which entries of a lower triangle are not zero."""
    is_there = np.abs(np.tril(matrix)) > 1e-14
    axes.imshow(np.where(is_there[..., None], to_rgb(BLUE), 1.0), interpolation="nearest")
    bare(axes, f"{title}\n{is_there.sum():,} entries")


def sparse() -> None:
    """Draw separators of a mesh, and factors of its matrix in two orders."""
    n = 15
    matrix, levels = mesh_graph(n), np.full(n * n, 9)
    order = dissected(np.arange(n * n).reshape(n, n), levels)
    colors = np.array([RED, ORANGE, GREEN, BLUE, *6 * ("#bbbbbb",)])[levels]
    with figure(IDEAS, "sparse", (8.5, 2.8), n_colours=32) as drawing:
        left, middle, right = drawing.subplots(1, 3)
        left.scatter(np.arange(n * n) % n, np.arange(n * n) // n, c=colors, s=26)
        bare(left, "separators,\nred eliminated last")
        spy(middle, np.linalg.cholesky(matrix), "factor, row by row")
        spy(right, np.linalg.cholesky(matrix[np.ix_(order, order)]), "factor, dissected")


def levels_of_fill(matrix: np.ndarray) -> np.ndarray:
    """Find the level of fill of each entry: 0 in the matrix, the sum of two more one in what elimination adds."""
    level = np.where(matrix != 0.0, 0.0, np.inf)
    for k in range(len(level)):
        later = slice(k + 1, None)
        level[later, later] = np.minimum(level[later, later], level[later, k, None] + level[k, later] + 1.0)
    return level


def sparse_iterative() -> None:
    """Draw the patterns of incomplete factors of a matrix, and of its factor."""
    level = levels_of_fill(mesh_graph(8))
    cases = {"ILU(0)": 0, "ILU(1)": 1, "ILU(2)": 2, "complete": np.inf}
    with figure(IDEAS, "sparse_iterative", (8.5, 2.5), n_colours=16) as drawing:
        for axes, (name, most) in zip(drawing.subplots(1, 4), cases.items()):
            spy(axes, (level <= most) & np.isfinite(level), name)


def sparse_parallel() -> None:
    """Draw how sweeps smooth an error, so that a coarser level can represent it."""
    n = 33
    x = np.linspace(0.0, 1.0, n)
    rough = np.random.default_rng(2).normal(size=n)
    error = np.sin(np.pi * x) + 0.6 * rough * np.sin(np.pi * x)
    matrix = 2.0 * np.eye(n - 2) - np.eye(n - 2, k=1) - np.eye(n - 2, k=-1)
    swept = error.copy()
    for _ in range(3):
        swept[1:-1] -= np.linalg.solve(np.tril(matrix), matrix @ swept[1:-1])
    interpolation = np.array([np.interp(x, x[::2], row) for row in np.eye(n)[::2, ::2]]).T[1:-1, 1:-1]
    coarse = np.linalg.solve(interpolation.T @ matrix @ interpolation, interpolation.T @ matrix @ swept[1:-1])
    corrected = swept.copy()
    corrected[1:-1] -= interpolation @ coarse
    panels = {"error": (x, error), "after three sweeps": (x, swept), "after a coarse correction": (x, corrected)}
    with figure(IDEAS, "sparse_parallel", (8.5, 2.0), n_colours=16) as drawing:
        for axes, (title, (places, values)) in zip(drawing.subplots(1, 3, sharey=True), panels.items()):
            axes.axhline(0.0, color=GRAY, linewidth=0.8)
            axes.plot(places, values, "o-", color=BLUE, markersize=3, linewidth=1.0)
            if "sweeps" in title:
                axes.plot(x[::2], [0.0, *coarse, 0.0], "o", color=ORANGE, markersize=5, zorder=0)
            axes.set_title(title, fontsize=10)
            axes.set(xticks=[], yticks=[])
            axes.spines[["top", "right", "bottom"]].set_visible(False)


DRAWN = (
    *(quality, validity, topology, high_order, inversion, progressive, geometry, grid_files),
    *(sparse, sparse_iterative, sparse_parallel),
)


if __name__ == "__main__":
    for draw in chosen(DRAWN, sys.argv[1:]):
        draw()
