"""From a surface grid to a volume grid.

From a surface to a volume: a swept wing with a plane tip and a blunt edge, extruded layer by layer. It takes some
seconds. The surface is three blocks of nodes: skin, tip, and base of the trailing edge. The output is the numbers of
nodes, inverted cells, corners and first heights of the volume, and a picture of both.
"""

from __future__ import annotations

import numpy as np

from bspline_mdao import Grid
from bspline_mdao.generators import extrude_surface
from bspline_mdao.grids import Block, GridQuality
from bspline_mdao.plotting import BLUE, GRAY, ORANGE, draw_net, figure
from bspline_mdao.scripts import run

SPAN, SWEEP, TAPER, BASE = 2.4, 0.35, 0.5, 0.01
"""Half of the span, by how much the leading edge goes back along it, both in root chords, tip chord over root chord,
and thickness of the trailing edge in chords."""

FIRST, OUTER = 2e-5, 20.0
"""Height of the first cells and of all layers, in root chords."""


def main(paper: bool = False, figures=None) -> dict:
    """Extrude the wing.

    Parameters
    ----------
    paper : bool
        Twice as many cells along the surface, and 64 layers; 48 by default.
    figures : path-like, optional
        Folder for ``surface_to_volume.png``.

    Returns
    -------
    dict
        ``n_surface`` and ``n_nodes``, nodes of both, ``n_inverted``, the smallest corner ``min_corner``,
        ``corner_1_percent``, below which 1 % of them are, and ``heights``, the part of first heights within 1 % of what
        was asked.
    """
    surface = wing(2 if paper else 1)
    grid = extrude_surface(surface, FIRST, layers=64 if paper else 48, outer=OUTER, symmetry=("z",))
    if figures:
        draw(figures, surface, grid)
    quality = GridQuality.of_baseline(grid)
    cells = quality.cells(grid.to_vector().reshape(-1, 3))
    corners = np.concatenate([block.min_corner.ravel() for block in cells])
    return {
        "n_surface": surface.n_nodes,
        "n_nodes": grid.n_nodes,
        "n_inverted": int((corners <= 0.0).sum()),
        "min_corner": float(corners.min()),
        "corner_1_percent": float(np.quantile(corners, 0.01)),
        "heights": float(np.mean(np.abs(quality.first_cells.baseline / FIRST - 1.0) < 0.01)),
    }


def wing(fine: int) -> Grid:
    """Make the surface: NACA 0012, open at the trailing edge, at all stations."""
    x = 0.5 * (1.0 + np.cos(np.linspace(0.0, np.pi, 32 * fine + 1)))
    side = 0.6 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4) + 0.5 * BASE * x
    low, high = np.stack([x, -side], axis=1), np.stack([x, side], axis=1)
    across, span = np.linspace(0.0, 1.0, 6 * fine + 1)[:, None], np.sin(np.linspace(0.0, 0.5 * np.pi, 16 * fine + 1))
    faces = {
        "skin": placed(np.concatenate([low, high[-2::-1]])[:, None], span),
        "tip": placed(low[:, None] * (1.0 - across) + high[:, None] * across, np.ones(len(across))),
        "base": placed((low[0] * (1.0 - across) + high[0] * across)[:, None], span),
    }
    return Grid(tuple(Block(nodes[:, :, None], name) for name, nodes in faces.items()))


def placed(sections: np.ndarray, span: np.ndarray) -> np.ndarray:
    """Put points of sections, (n, m or 1, 2), at stations of the span, (m,)."""
    chord = 1.0 - (1.0 - TAPER) * span
    x, y = SWEEP * SPAN * span + chord * sections[..., 0], chord * sections[..., 1]
    return np.stack([x, y, np.broadcast_to(SPAN * span, x.shape)], axis=-1)


def draw(folder, surface: Grid, grid: Grid) -> None:
    """Draw the surface, the volume in the plane of symmetry, and its trailing edge there."""
    with figure(folder, "surface_to_volume", size=(11.0, 3.9), n_colours=128) as canvas:
        parts = canvas.add_gridspec(1, 3, width_ratios=(1.15, 1.0, 1.0))
        view = canvas.add_subplot(parts[0], projection="3d", computed_zorder=True)
        for block, color in zip(surface.blocks, (BLUE, ORANGE, GRAY)):
            x, y, z = np.moveaxis(block.nodes[:, :, 0], -1, 0)
            view.plot_surface(z, x, y, rstride=1, cstride=1, color=color, edgecolor="k", linewidth=0.15, shade=False)
        view.set_box_aspect([np.ptp([*view.get_xlim()]), np.ptp([*view.get_ylim()]), 0.5], zoom=1.5)
        view.set(zlim=(-0.25, 0.25))
        view.set_title("surface", y=0.92)
        view.view_init(elev=28.0, azim=40.0)
        view.set_axis_off()
        for part, title, middle, reach in ((1, "volume", (0.5, 0.0), 1.6), (2, "its trailing edge", (1.0, 0.0), 0.06)):
            axes = canvas.add_subplot(parts[part])
            for block in grid.blocks:
                for side in (block.nodes[0], block.nodes[-1], block.nodes[:, 0], block.nodes[:, -1]):
                    if np.ptp(side[..., 2]) < 1e-9 and abs(side[0, 0, 2]) < 1e-9:
                        draw_net(axes, side[..., :2], color=GRAY, linewidth=0.3)
                        axes.plot(*side[:, 0, :2].T, color=BLUE, linewidth=1.2)
            limits = [(center - reach, center + reach) for center in middle]
            axes.set(
                xlim=limits[0], ylim=limits[1], xlabel="$x$ (m)", ylabel="$y$ (m)", title=f"{title}, plane of symmetry"
            )
            axes.set_aspect("equal")


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/surface_to_volume.png'
