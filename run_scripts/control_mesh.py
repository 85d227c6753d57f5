"""Control mesh of the ONERA M6.

The ONERA M6 wing: the grid on it and on the symmetry plane, and the control mesh of both. It takes some seconds. The
output is the numbers of nodes and control points, the error of the fit, and a picture of what a user works with.
"""

from __future__ import annotations

import numpy as np

from bspline_mdao import FittedModel, fit_grid
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.plotting import BLUE, GRAY, ORANGE, draw_net, figure, patch_faces
from bspline_mdao.scripts import run


def main(paper: bool = False, figures=None) -> dict:
    """Fit the grid and draw what a user works with.

    Parameters
    ----------
    paper : bool
        12 blocks of 45 x 65 x 33 nodes with 13 x 13 x 9 control points; half as many cells per direction by default.
    figures : path-like, optional
        Folder for ``control_mesh.png``.

    Returns
    -------
    dict
        ``n_nodes``, ``n_control_points``, their ratio ``nodes_per_control_point``, ``rms`` (m), and
        ``n_wall_control_points``, those on the wing.
    """
    grid = onera_m6_grid() if paper else onera_m6_grid((23, 33, 17))
    model = fit_grid(grid, n_control=(13, 13, 9) if paper else (9, 10, 7))
    if figures:
        draw(figures, model)
    wall = np.unique(np.concatenate([ids.ravel() for ids in patch_faces(model, "wing", model.mesh.control_ids)]))
    return {
        "n_nodes": model.n_nodes,
        "n_control_points": len(model.control_points),
        "nodes_per_control_point": model.n_nodes / len(model.control_points),
        "rms": model.report.rms,
        "n_wall_control_points": len(wall),
    }


def draw(folder, model: FittedModel) -> None:
    """Draw the symmetry plane near the wing, and the wing."""
    nodes = [block.nodes for block in model.regenerate().blocks]
    nets = model.mesh.nets(model.control_points)
    with figure(folder, "control_mesh", size=(9.0, 4.3), n_colours=128) as canvas:
        grid = canvas.add_gridspec(1, 2, width_ratios=(1.45, 1.0))
        plane, wing = canvas.add_subplot(grid[0]), canvas.add_subplot(grid[1])
        for face in patch_faces(model, "symmetry", nodes):
            draw_net(plane, face[..., :2], color=GRAY, linewidth=0.25)
        for face in patch_faces(model, "symmetry", nets):
            draw_net(plane, face[..., :2], color=BLUE, linewidth=0.7, marker="o", markersize=2.2)
        plane.set(xlim=(-0.55, 1.55), ylim=(-0.75, 0.75), xlabel="$x$ (m)", ylabel="$y$ (m)", title="symmetry plane")
        for face in patch_faces(model, "wing_upper", nodes):
            draw_net(wing, face[..., [0, 2]], color=GRAY, linewidth=0.25)
        for face in patch_faces(model, "wing_upper", nets):
            draw_net(wing, face[..., [0, 2]], color=ORANGE, linewidth=0.7, marker="o", markersize=2.2)
        wing.set(xlabel="$x$ (m)", ylabel="$z$ (m)", title="upper side of the wing")
        for axes, color in ((plane, BLUE), (wing, ORANGE)):
            axes.set_aspect("equal")
            axes.plot([], [], color=GRAY, linewidth=0.5, label="grid")
            axes.plot([], [], color=color, linewidth=0.7, marker="o", markersize=2.2, label="control mesh")
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/control_mesh.png'
