"""Figures 7 and 8: meshes of both cases.

Control mesh and grid on the body and the symmetry plane, before and after both changes of shape. Surface control points
are red spheres. The pictures are rendered off screen by PyVista if possible, and otherwise drawn by matplotlib. It
takes some seconds, and some minutes at the paper's size. The output is the sizes of both meshes, how far the surface
moved, inverted cells, and the pictures of the figures.
"""

from __future__ import annotations

import numpy as np

import bspline_mdao as bm
from bspline_mdao.grids import GridQuality, report_quality
from bspline_mdao.plotting import Camera, Scene, draw_scene, figure, patch_faces
from bspline_mdao.scripts import run

CASES = {
    "figure7_m6": (bm.generators.onera_m6_grid, bm.generators.rectangular_wing),
    "figure8_bwb": (bm.generators.flat_plate_grid, bm.generators.generic_blended_wing_body),
}

SIZES = {
    "figure7_m6": {True: ((45, 65, 33), (13, 13, 9)), False: ((11, 13, 9), (7, 8, 5))},
    "figure8_bwb": {True: ((45, 45, 45), (9, 9, 9)), False: ((11, 11, 11), (7, 7, 7))},
}
"""Nodes and control points of each of the twelve blocks, at the paper's size (True) and small."""

CAMERAS = {
    "figure7_m6": Camera(focus=(0.6, 0.0, 0.72), direction=(-0.75, 0.62, 1.0), height=1.65),
    "figure8_bwb": Camera(focus=(0.47, 0.05, 0.92), direction=(-0.75, 0.75, 1.0), height=2.15),
}

PANEL = (4.6, 3.4)
"""Width and height of one of the four pictures in inches."""


def main(paper: bool = False, figures=None) -> dict:
    """Move both control meshes and draw them and their grids.

    Parameters
    ----------
    paper : bool
        12 blocks of 45 x 65 x 33 nodes with 13 x 13 x 9 control points, and of 45^3 nodes with 9^3.
    figures : path-like, optional
        Folder for ``figure7_m6.png`` and ``figure8_bwb.png``.

    Returns
    -------
    dict
        ``figure7_m6`` and ``figure8_bwb``, each with ``n_nodes``, ``n_control_points``, ``n_surface_control_points``,
        ``largest_displacement`` of one of these (m) and ``n_inverted`` cells of the final grid; and ``drawn_by``, what
        drew them, if anything did.
    """
    numbers = {}
    for name, (make_grid, make_shape) in CASES.items():
        shape, n_control = SIZES[name][paper]
        model = bm.fit_grid(make_grid(shape), n_control=n_control, keep_residual=False)
        mesh = bm.movers.moving_mesh(model)
        surface = bm.generators.fit_shape(model, mesh.surface_ids, make_shape())
        moved = bm.movers.LinearElasticity(mesh, n_increments=5).move(mesh.points, surface).points
        cells = GridQuality.of_baseline(model.regenerate())
        numbers[name] = {
            "n_nodes": model.n_nodes,
            "n_control_points": mesh.n_points,
            "n_surface_control_points": len(surface),
            "largest_displacement": np.linalg.norm(surface - mesh.points[mesh.surface_ids], axis=1).max(),
            "n_inverted": report_quality(cells, model.regenerate(moved).to_vector().reshape(-1, 3)).n_inverted,
        }
        if figures:
            with figure(figures, name, size=(2.0 * PANEL[0], 2.0 * PANEL[1] + 0.5)) as canvas:
                panels = dict(zip(("initial", "final"), zip(canvas.subplots(2, 2), (mesh.points, moved))))
                numbers["drawn_by"] = draw(panels, model, mesh.surface_ids, CAMERAS[name])
    return numbers


def draw(panels: dict, model: bm.FittedModel, surface_ids: np.ndarray, camera: Camera) -> str:
    """Draw control meshes with their surface control points, and the grids beside them; returns what drew them."""
    letters = iter("abcd")
    for state, (row, points) in panels.items():
        nets, nodes = model.mesh.nets(points), [block.nodes for block in model.regenerate(points).blocks]
        meshes = [[patch_faces(model, patch, of) for patch in ("wing", "symmetry")] for of in (nets, nodes)]
        scenes = {
            "control mesh": Scene(*meshes[0], marks=points[surface_ids], line_width=0.6),
            "grid": Scene(*meshes[1], line_width=0.25),
        }
        for axes, (title, scene) in zip(row, scenes.items()):
            drawn_by = draw_scene(axes, scene, camera, PANEL)
            axes.set_xlabel(f"({next(letters)}) {state} {title}")
    return drawn_by


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/figure7_m6.png'
