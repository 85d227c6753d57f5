"""Draw the pictures at the beginning of four pages of theory.

``python docs/draw_flow_ideas.py`` writes, below ``docs/_static/ideas``, ``flux_stencil.png`` (the state at a face of a
cell), ``failed_step.png`` (what an optimizer receives for a failed analysis), ``transfer_means.png`` (a field on two
members of a family) and ``body_points.png`` (a rib that follows a twisted wing). It takes ten seconds.
"""

from __future__ import annotations

import numpy as np
from page_pictures import IDEAS

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, GRAY, ORANGE, figure

STATES = np.array([1.0, 1.05, 1.5, 2.3])
"""Means of the cells a to d."""

CELLS = np.array([0.8, 1.6, 1.9, 1.2, 0.9])
"""Means of the cells of a coarse member."""

N_FINE = 8
"""Cells of the other member, along the same line."""

TWIST, STATION = "twist=25deg", 0.585
"""Deformation of the wing, and the place of the section as part of the half span."""

TURN, SLOPE, FAILS_FROM = 0.02, -1.0, 0.6
"""Where the parabola turns, slope of the objective at the best point, and where analyses begin to fail."""


def place(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Points of the curved grid of the first picture, shape (..., 2)."""
    return np.stack([s + 0.06 * t * t, t + 0.25 * np.sin(0.7 * s)], axis=-1)


def draw_stencil() -> None:
    """Draw cells along a grid line with a face, and the mean at the face from four cells and from two."""
    with figure(IDEAS, "flux_stencil", (8.0, 2.9)) as drawing:
        cells, means = drawing.subplots(1, 2, width_ratios=(1.15, 1.0))
        u, v = np.linspace(0.0, 4.0, 81), np.linspace(0.0, 3.0, 61)
        for k in range(5):
            cells.plot(*place(np.full_like(v, k), v).T, color=GRAY, lw=0.8)
        for k in range(4):
            cells.plot(*place(u, np.full_like(u, k)).T, color=GRAY, lw=0.8)
        for k, name in enumerate("abcd"):
            cells.text(*place(k + 0.55, 1.3), name, ha="center", va="center", fontsize=13, color=BLUE)
        middle = place(2.0, 1.6)
        cells.plot(*place(np.full(2, 2.0), np.array([1.0, 2.0])).T, color=ORANGE, lw=2.5)
        arrow = {"arrowstyle": "->", "color": ORANGE, "lw": 1.6}
        cells.annotate("", middle + [0.75, -0.14], middle, arrowprops=arrow)
        cells.text(*(middle + [0.5, 0.03]), r"$\mathbf{S}$", color=ORANGE, fontsize=12)
        cells.set_aspect("equal")
        cells.axis("off")
        edges, x = np.arange(-2.0, 3.0), np.linspace(-2.0, 2.0, 101)
        cubic = np.polynomial.Polynomial.fit(edges, np.concatenate([[0.0], STATES.cumsum()]), 4).deriv()
        means.stairs(STATES, edges, baseline=None, color=BLUE, lw=1.6, label="means of cells")
        means.plot(x, cubic(x), color=GRAY, lw=1.0, label="cubic with these means")
        means.plot(0.0, STATES @ [-1.0, 7.0, 7.0, -1.0] / 12.0, "o", color=ORANGE, label="mean state of the face")
        means.plot(0.0, STATES[1:3].mean(), "s", color=GRAY, mfc="none", label="mean of two cells, at shocks")
        means.set(xticks=[-1.5, -0.5, 0.5, 1.5], xticklabels=list("abcd"), ylabel="$w$")
        means.legend(fontsize=8, loc="upper left")


def draw_failure() -> None:
    """Draw the objective along a step that fails, and what stands for it."""
    with figure(IDEAS, "failed_step", (5.5, 3.0)) as drawing:
        axes = drawing.subplots()
        axes.axvspan(FAILS_FROM, 1.08, color=GRAY, alpha=0.2, lw=0.0)
        axes.text(0.84, -0.35, "analyses fail", ha="center", color=GRAY)
        t = np.linspace(0.0, FAILS_FROM, 101)
        axes.plot(t, SLOPE * t + 1.4 * t * t, color=BLUE)
        axes.text(0.3, -0.3, "objective", color=BLUE, ha="center")
        t = np.linspace(0.0, 0.24, 101)
        axes.plot(t, SLOPE * t - 0.5 * SLOPE / TURN * t * t, color=ORANGE)
        axes.text(0.21, 0.6, "uphill: the parabola $q(t)$,\nof the true slope at $t = 0$", color=ORANGE, fontsize=9)
        axes.plot(1.0, 0.55, "s", color=GRAY)
        axes.text(0.97, 0.55, "worst: a value\nthat is rejected", color=GRAY, ha="right", va="center")
        axes.plot(0.0, 0.0, "o", color=BLUE)
        axes.text(-0.02, 0.08, "best\npoint", color=BLUE, ha="right")
        axes.set(xlim=(-0.14, 1.08), ylim=(-0.45, 1.05), xlabel="$t$, part of the step", ylabel="$f - f_0$")


def parabolas(x: np.ndarray, cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and integrals, from the centre of their cells, of the parabolas in inner cells."""
    inner, slopes = CELLS[1:-1][cell], 0.5 * (CELLS[2:] - CELLS[:-2])[cell]
    bends = np.diff(CELLS, 2)[cell]
    values = inner + slopes * x + 0.5 * bends * (x * x - 1.0 / 12.0)
    return values, (inner - bends / 24.0) * x + slopes * x**2 / 2.0 + bends * x**3 / 6.0


def fine_means(n: int) -> np.ndarray:
    """Means of the parabolas over n even cells, by exact integrals over their parts of coarse cells."""
    n_coarse = len(CELLS) - 2
    edges = np.unique(np.concatenate([np.linspace(0.0, n_coarse, n + 1), np.arange(n_coarse + 1.0)]))
    middles = 0.5 * (edges[1:] + edges[:-1])
    cell = middles.astype(int)
    low, high = (parabolas(ends - cell - 0.5, cell)[1] for ends in (edges[:-1], edges[1:]))
    return np.bincount((middles * n / n_coarse).astype(int), high - low) * n / n_coarse


def draw_transfer() -> None:
    """Draw means of coarse cells, the parabolas in them, and means of finer cells that are not nested."""
    with figure(IDEAS, "transfer_means", (6.0, 2.8)) as drawing:
        axes = drawing.subplots()
        axes.stairs(CELLS, np.arange(-1.0, 5.0), baseline=None, color=BLUE, lw=1.8, label="means of coarse cells")
        for k in range(len(CELLS) - 2):
            x = np.linspace(-0.5, 0.5, 41)
            label = None if k else "parabolas in them"
            axes.plot(x + k + 0.5, parabolas(x, np.full(41, k))[0], color=GRAY, lw=1.0, label=label)
        edges = np.linspace(0.0, len(CELLS) - 2.0, N_FINE + 1)
        axes.stairs(fine_means(N_FINE), edges, baseline=None, color=ORANGE, lw=1.6, label="means of fine cells")
        axes.set(xlabel="index of the coarse member", ylabel="$w$", xticks=range(-1, 5), ylim=(0.7, 2.1))
        axes.legend(fontsize=8)


def draw_body() -> None:
    """Draw a section of a wing with a rib, and both after the wing's twist."""
    model = bm.fit_grid(bm.generators.hh_wing_grid(bm.generators.rectangular_wing(), (17, 13, 9)))
    mesh, initial = bm.movers.moving_mesh(model), model.control_points
    surface = bm.design.parse_deformation([TWIST], model, mesh).apply(initial[mesh.surface_ids])
    moved = bm.movers.LinearElasticity(mesh).move(initial, surface).points
    grid = model.grid_map().at(moved)
    walls = np.unique(bm.plotting.wall_quads(model))
    heights = grid.of.nodes[walls, 2]
    walls = walls[np.abs(heights / heights.max() - STATION) < 0.01]  # nodes of one row around the wing
    nodes = grid.of.nodes[walls]
    middle = nodes.mean(axis=0)
    walls = walls[np.argsort(np.arctan2(*((nodes - middle)[:, 1::-1] * [8.0, 1.0]).T))]
    outline = grid.of.nodes[np.append(walls, walls[0])]
    rib = middle + 0.7 * (outline - middle)
    after = model.embed_points(rib).at(moved, grid.nodes).nodes
    with figure(IDEAS, "body_points", (6.5, 2.2)) as drawing:
        axes = drawing.subplots()
        axes.plot(*outline[:, :2].T, color=GRAY, lw=1.0, label="wall, before")
        axes.plot(*rib[:, :2].T, ".--", color=GRAY, lw=0.6, label="rib, before")
        axes.plot(*grid.nodes[np.append(walls, walls[0]), :2].T, color=BLUE, label="wall, twisted")
        axes.plot(*after[:, :2].T, ".--", color=ORANGE, lw=0.8, label="rib, twisted")
        axes.set(xlabel="$x$ (m)", ylabel="$y$ (m)")
        axes.set_aspect("equal")
        axes.legend(fontsize=8)


def main() -> None:
    """Draw all pictures."""
    draw_stencil()
    draw_failure()
    draw_transfer()
    draw_body()


if __name__ == "__main__":
    main()
