"""Figures 7 and 8: control mesh and grid on the body and the symmetry plane, before and after both changes of shape.

Surface control points are red spheres. The pictures are rendered off screen by PyVista where that is possible, and
drawn by matplotlib elsewhere.
"""

from __future__ import annotations

import numpy as np
from common import figure, run
from morphs import BLENDED_WING_BODY, ONERA_M6, Morph, Moved, report_cells
from scenes import Camera, Scene, draw_scene, faces_of

CASES = {
    "figure7_m6": (ONERA_M6, Camera(focus=(0.6, 0.0, 0.72), direction=(-0.75, 0.62, 1.0), height=1.65)),
    "figure8_bwb": (BLENDED_WING_BODY, Camera(focus=(0.47, 0.05, 0.92), direction=(-0.75, 0.75, 1.0), height=2.15)),
}
PANEL = (4.6, 3.4)
"""Width and height of one of the four pictures in inches."""


def main(paper: bool = False, figures=None) -> dict:
    """Move both control meshes and draw them and their grids.

    Parameters
    ----------
    paper : bool
        The paper's sizes.
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
    for name, (case, camera) in CASES.items():
        morph = case.morph(paper)
        moved, control_points = morph.move_control_mesh()
        numbers[name] = describe(morph, moved)
        if figures:
            numbers["drawn_by"] = draw(figures, name, morph, control_points, camera)
    return numbers


def describe(morph: Morph, moved: Moved) -> dict:
    """Numbers of one case."""
    displacement = morph.surface - morph.mesh.points[morph.mesh.surface_ids]
    return {
        "n_nodes": morph.model.n_nodes,
        "n_control_points": morph.mesh.n_points,
        "n_surface_control_points": len(morph.surface),
        "largest_displacement": np.linalg.norm(displacement, axis=1).max(),
        "n_inverted": report_cells(moved.before, moved.after).n_inverted,
    }


def draw(folder, name: str, morph: Morph, moved: np.ndarray, camera: Camera) -> str:
    """Draw the four pictures of one figure; returns what drew them."""
    titles = iter(("(a) initial control mesh", "(b) initial grid", "(c) final control mesh", "(d) final grid"))
    with figure(folder, name, size=(2.0 * PANEL[0], 2.0 * PANEL[1] + 0.5)) as canvas:
        for row, control_points in zip(canvas.subplots(2, 2), (morph.mesh.points, moved)):
            for axes, scene in zip(row, (control_mesh(morph, control_points), grid(morph, control_points))):
                drawn_by = draw_scene(axes, scene, camera, PANEL)
                axes.set_xlabel(next(titles))
    return drawn_by


def control_mesh(morph: Morph, control_points: np.ndarray) -> Scene:
    """The control mesh with its surface control points."""
    nets = morph.model.mesh.nets(control_points)
    marks = control_points[morph.mesh.surface_ids]
    return Scene(faces_of(morph.model, "wing", nets), faces_of(morph.model, "symmetry", nets), marks, line_width=0.6)


def grid(morph: Morph, control_points: np.ndarray) -> Scene:
    """The grid of the control points."""
    nodes = [block.nodes for block in morph.model.regenerate(control_points).blocks]
    return Scene(faces_of(morph.model, "wing", nodes), faces_of(morph.model, "symmetry", nodes), line_width=0.25)


if __name__ == "__main__":
    run(main, __doc__)
