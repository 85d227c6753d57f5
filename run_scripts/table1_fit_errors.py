"""Table 1: errors between the initial grids and their B-spline fits, for the ONERA M6 wing and the blended-wing body.

The paper's grids were never published. These are grids of the same topology, counts and spacings; the grid of the
blended-wing body is the one about the flat plate that the optimisation starts from.
"""

from __future__ import annotations

import numpy as np
from common import BLUE, GRAY, ORANGE, figure, run

from bspline_mdao import flat_plate_grid, onera_m6_grid
from bspline_mdao.cells.hexahedron import cell_quality
from bspline_mdao.fit.fitting import fit_grid
from bspline_mdao.model.fitted_model import FittedModel
from bspline_mdao.topology.grid import Grid

CORRECTIONS = 3
"""Rounds of parameter correction (Hoschek) of the corrected fits."""

CASES = {"onera_m6": (onera_m6_grid, "ONERA M6"), "blended_wing_body": (flat_plate_grid, "blended-wing body")}

SIZES = {
    "onera_m6": {True: ((45, 65, 33), (13, 13, 9)), False: ((17, 25, 17), (7, 8, 7))},
    "blended_wing_body": {True: ((45, 45, 45), (9, 9, 9)), False: ((17, 17, 17), (7, 7, 7))},
}
"""Nodes and control points per block, at the paper's size and small."""

PAPER = {
    "onera_m6": {"rms": 4.04e-4, "max_error": [2.01e-3, 1.52e-3, 1.54e-3]},
    "blended_wing_body": {"rms": 7.11e-5, "max_error": [1.35e-4, 5.21e-4, 2.41e-4]},
}
"""Table 1 as printed."""


def main(paper: bool = False, figures=None) -> dict:
    """Fit both grids, without and with parameter correction, and print Table 1 beside the paper's numbers.

    Parameters
    ----------
    paper : bool
        The paper's sizes: 12 blocks of 45 x 65 x 33 nodes with 13 x 13 x 9 control points, and of 45^3 with 9^3.
    figures : path-like, optional
        Folder for ``table1_grids.png`` and ``table1_errors.png``.

    Returns
    -------
    dict
        ``onera_m6`` and ``blended_wing_body``, each with ``shape``, ``n_control``, ``n_nodes``, ``n_control_points``,
        ``smallest_q`` of the grid, ``rms``, ``max_error`` (x, y, z), ``n_invalid`` control elements, ``seconds``, the
        same four under ``corrected``, and the paper's numbers under ``paper``.
    """
    grids = {name: make(SIZES[name][paper][0]) for name, (make, _) in CASES.items()}
    models = {name: fit_both(grid, SIZES[name][paper][1]) for name, grid in grids.items()}
    numbers = {name: measure(name, grids[name], *models[name], paper) for name in CASES}
    print(table(numbers))
    if figures:
        draw_grids(figures, grids)
        draw_errors(figures, models, paper)
    return numbers


def fit_both(grid: Grid, n_control) -> tuple[FittedModel, FittedModel]:
    """Fit a grid without and with parameter correction."""
    options = {"n_control": n_control, "method": "least_squares"}  # as the paper, folded or not
    return tuple(fit_grid(grid, corrections=rounds, **options) for rounds in (0, CORRECTIONS))


def measure(name: str, grid: Grid, plain: FittedModel, corrected: FittedModel, paper: bool) -> dict:
    """Gather the numbers of one case."""
    shape, n_control = SIZES[name][paper]
    return {
        "shape": shape,
        "n_control": n_control,
        "n_nodes": grid.n_nodes,
        "n_control_points": plain.report.n_control_points,
        "smallest_q": min(cell_quality(block.nodes).q.min() for block in grid.blocks),
        **errors(plain),
        "corrected": errors(corrected),
        "paper": PAPER[name],
    }


def errors(model: FittedModel) -> dict:
    """Errors of one fit."""
    report = model.report
    return {
        "rms": report.rms,
        "max_error": list(report.max_error),
        "n_invalid": report.n_invalid,
        "seconds": report.seconds,
    }


def table(numbers: dict) -> str:
    """Table 1, ours beside the paper's."""
    lines = [f"{'case':<28}{'RMS error':>12}{'max |dx|':>12}{'max |dy|':>12}{'max |dz|':>12}"]
    for name, case in numbers.items():
        rows = {CASES[name][1]: case, "  parameters corrected": case["corrected"], "  paper": case["paper"]}
        for label, row in rows.items():
            lines.append(f"{label:<28}" + "".join(f"{value:>12.2e}" for value in (row["rms"], *row["max_error"])))
    return "\n".join(lines)


def draw_grids(folder, grids: dict) -> None:
    """Draw the symmetry plane and the plane of the wing of both grids."""
    with figure(folder, "table1_grids", size=(8.2, 8.4)) as canvas:
        for row, (name, grid) in zip(canvas.subplots(2, 2), grids.items()):
            for block in grid.blocks[3:6]:
                draw_plane(row[0], block.nodes[:, :, 0, :2], BLUE)
            for n in (3, 4, 5, 9, 10, 11):
                draw_plane(row[1], grid.blocks[n].nodes[:, 0][..., ::2], ORANGE if n == 4 else BLUE)
            row[0].set(title=f"{CASES[name][1]}: symmetry plane", ylabel="$y$")
            row[1].set(title=f"{CASES[name][1]}: wing and its plane", ylabel="$z$")
            for axes in row:
                axes.set(xlim=(-0.6, 2.2), ylim=(0, 2.6), xlabel="$x$", aspect="equal")


def draw_plane(axes, points: np.ndarray, color: str) -> None:
    """Draw both families of grid lines of a plane of points (n, m, 2)."""
    for lines in (points, points.swapaxes(0, 1)):
        axes.plot(lines[..., 0].T, lines[..., 1].T, color=color, linewidth=0.3)


def draw_errors(folder, models: dict, paper: bool) -> None:
    """Draw how many nodes have errors larger than a given one; beside the paper's errors at the paper's size."""
    with figure(folder, "table1_errors", size=(7.5, 3.4)) as canvas:
        for axes, (name, pair) in zip(canvas.subplots(1, 2, sharey=True), models.items()):
            for model, label, color in zip(pair, ("chord length", "corrected"), (BLUE, ORANGE)):
                distance = np.sort(np.linalg.norm(model.residual, axis=1))[::-1]
                axes.loglog(
                    np.maximum(distance, 1e-17), np.arange(1, distance.size + 1) / distance.size, color, label=label
                )
            if paper:
                axes.axvline(PAPER[name]["rms"], color=GRAY, linestyle=":", label="RMS in the paper")
            axes.set(title=CASES[name][1], xlabel="error of a node (chords)", xlim=(1e-8, 1e-2), ylim=(1e-6, 2))
        axes.legend()
        canvas.axes[0].set_ylabel("fraction of nodes with a larger error")


if __name__ == "__main__":
    run(main, __doc__)
