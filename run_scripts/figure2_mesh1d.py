"""Figure 2: a one-dimensional B-spline mesh.

How control points set the spacing of a one-dimensional B-spline mesh. It takes a second. The output is the meshes of
uniform and of adapted control points, and the uniform mesh after a change of parameter, with the ratio of the largest
to the smallest spacing of each, and the pictures of the figure.
"""

from __future__ import annotations

import numpy as np

from bspline_mdao.plotting import BLUE, GRAY, ORANGE, figure
from bspline_mdao.scripts import run
from bspline_mdao.splines import Curve, uniform_parameters

N_CONTROL, N_MESH = 11, 41
CLUSTER, STRENGTH = 0.6, 0.75  # the adapted control points gather about here, this much


def main(figures=None) -> dict:
    """Make the two meshes of the figure, and the uniform mesh that a change of parameter gives.

    Parameters
    ----------
    figures : path-like, optional
        Folder for ``figure2_mesh1d.png`` and ``figure2_parameters.png``.

    Returns
    -------
    dict
        For each of ``uniform`` (a), ``adapted`` (b) and ``uniform_parameters``: the ``control_points``, the
        ``parameters``, the ``mesh``, and ``spacing_ratio``, largest over smallest spacing of the mesh; and
        ``end_slope_ratio``, the slope of the mapping (a) at its end over that in the middle.
    """
    control_points = np.linspace(0.0, 1.0, N_CONTROL)
    uniform = Curve.uniform(control_points[:, None])
    adapted = Curve.uniform(cluster(control_points)[:, None])
    parameters = np.linspace(0.0, 1.0, N_MESH)
    numbers = {
        "uniform": mesh_numbers(uniform, parameters),
        "adapted": mesh_numbers(adapted, parameters),
        "uniform_parameters": mesh_numbers(uniform, uniform_parameters(uniform, N_MESH)),
        "end_slope_ratio": np.divide(*uniform.derivative([0.0, 0.5])[:, 0]),
    }
    if figures:
        draw_meshes(figures, numbers)
        draw_parameters(figures, uniform)
    return numbers


def cluster(x: np.ndarray) -> np.ndarray:
    """Move points of [0, 1] towards `CLUSTER`; the ends stay."""
    scale = np.where(x < CLUSTER, CLUSTER, 1.0 - CLUSTER)
    distance = np.abs(x - CLUSTER) / scale
    return CLUSTER + np.sign(x - CLUSTER) * scale * ((1.0 - STRENGTH) * distance + STRENGTH * distance**2)


def mesh_numbers(curve: Curve, parameters: np.ndarray) -> dict:
    """One mesh and its numbers."""
    mesh = curve(parameters)[:, 0]
    spacing = np.diff(mesh)
    return {
        "control_points": curve.control_points[:, 0],
        "parameters": parameters,
        "mesh": mesh,
        "spacing_ratio": spacing.max() / spacing.min(),
    }


def draw_meshes(folder, numbers: dict) -> None:
    """Draw each mesh below its control points."""
    titles = {
        "uniform": "(a) uniform control points, knots and parameters",
        "adapted": "(b) adapted control points, uniform knots and parameters",
        "uniform_parameters": "(c) uniform control points and knots, changed parameters",
    }
    with figure(folder, "figure2_mesh1d", size=(6.2, 3.6)) as canvas:
        for axes, (name, title) in zip(canvas.subplots(len(titles), sharex=True), titles.items()):
            control_points, mesh = numbers[name]["control_points"], numbers[name]["mesh"]
            axes.plot(control_points, 0 * control_points + 1, "-s", color=ORANGE, linewidth=0.8, clip_on=False)
            axes.plot(mesh, 0 * mesh, "-o", color=BLUE, linewidth=0.8, markersize=3, clip_on=False)
            axes.set_title(title, loc="left", fontsize=10)
            axes.set(xlim=(0, 1), ylim=(-0.5, 1.5), yticks=[0, 1], yticklabels=["mesh", "control points"])
            axes.tick_params(left=False, bottom=False)
            axes.spines[:].set_visible(False)
        axes.set_xlabel(r"$x$")


def draw_parameters(folder, curve: Curve) -> None:
    """Draw the change of parameter that makes the mesh uniform."""
    n = 401
    with figure(folder, "figure2_parameters", size=(3.4, 3.2)) as canvas:
        axes = canvas.subplots()
        axes.plot([0, 1], [0, 1], "--", color=GRAY, linewidth=0.8, label="no change")
        axes.plot(np.linspace(0, 1, n), uniform_parameters(curve, n), color=BLUE, label="uniform mesh")
        axes.set(xlabel=r"$(q - 1) / (L - 1)$", ylabel=r"$\xi_q$", xlim=(0, 1), ylim=(0, 1), aspect="equal")
        axes.legend()


if __name__ == "__main__":
    run(main)
