"""What Figures 4 and 5 share: the orthogonality of the cells before and after a move, by both movers."""

from __future__ import annotations

import numpy as np
from common import BLUE, GRAY, ORANGE
from morphs import COARSE, ONE_THREAD, Case, report_cells, warm_up
from scipy.signal import find_peaks

from bspline_mdao import Grid, family_member

N_BINS = 50
PROMINENCE = 0.25
"""A peak of a distribution rises this much over the valleys beside it."""

NODE_BASED = {
    "choices": ("full", "coarse", "none"),
    "help": "size of the grid that is moved node by node: the full one (the default but at the paper's size, where "
    "it takes hours), one of half the cells per direction, or none",
}
"""Option of the command line."""


def study(case: Case, paper: bool, node_based: str | None) -> dict:
    """Move a case with both movers and measure the grids.

    Parameters
    ----------
    case : Case
        What to move.
    paper : bool
        At the paper's size.
    node_based : {"full", "coarse", "none"} or None
        Which grid moves node by node; by default the full one if it is small, else the coarse one.

    Returns
    -------
    dict
        ``initial``, ``b_spline``, and, where there is a node-based move, ``node_based`` and ``b_spline_same_size``, the
        B-spline's result on the nodes that moved one by one. Each has the numbers of `measure`, the moves those of
        `Moved.numbers` too.
    """
    warm_up(ONE_THREAD["solver"])
    morph = case.morph(paper)
    moved, control_points = morph.move_control_mesh()
    numbers = {
        "initial": measure(morph.grid, morph.grid),
        "b_spline": {**moved.numbers(), **measure(moved.before, moved.after)},
    }
    node_based = node_based or ("coarse" if paper else "full")
    if node_based != "none":
        factor = COARSE if node_based == "coarse" else 1.0
        nodes = morph.move_nodes(control_points, factor)
        same = family_member(morph.model, factor, control_points)
        numbers["node_based"] = {**nodes.numbers(), **measure(nodes.before, nodes.after)}
        numbers["b_spline_same_size"] = measure(nodes.before, same)
    return numbers


def measure(before: Grid, after: Grid) -> dict:
    """Quality of the cells of a grid that was moved.

    Returns
    -------
    dict
        ``n_cells``, ``n_inverted``, ``min_corner``, ``q_min``, ``q_mean``, the ``distribution`` of Q in uniform bins on
        [0, 1] with integral 1, its first bin ``lowest_bin``, its first peak ``lowest_peak`` and where that is,
        ``lowest_peak_at``.
    """
    report = report_cells(before, after, N_BINS)
    density = report.histogram.density
    peak = lowest_peak(density)
    return {
        "n_cells": report.n_cells,
        "n_inverted": report.n_inverted,
        "min_corner": report.min_corner,
        "q_min": report.q_min,
        "q_mean": report.q_mean,
        "distribution": density,
        "lowest_bin": density[0],
        "lowest_peak": density[peak],
        "lowest_peak_at": centers(N_BINS)[peak],
    }


def lowest_peak(distribution: np.ndarray) -> int:
    """Bin of the first peak, which is not the first bin but may be the last."""
    peaks, _ = find_peaks(np.append(distribution, 0.0), prominence=PROMINENCE)
    return peaks[0]


def centers(n_bins: int) -> np.ndarray:
    """Middles of the bins."""
    return (np.arange(n_bins) + 0.5) / n_bins


def draw(canvas, numbers: dict, log: bool = False) -> None:
    """Draw the distributions over each other into an empty figure, as the paper does."""
    n_cells = {name: grid["n_cells"] for name, grid in numbers.items()}
    is_coarse = n_cells.get("node_based", n_cells["b_spline"]) < n_cells["b_spline"]
    size = f" ({n_cells['node_based']:,} cells)" if is_coarse else ""
    looks = {
        "initial": ("initial", {"color": GRAY, "linestyle": "--", "linewidth": 1.0}),
        "b_spline": ("B-spline", {"color": BLUE}),
        "b_spline_same_size": (f"B-spline{size}", {"color": BLUE, "linestyle": ":"}),
        "node_based": (f"node-based{size}", {"color": ORANGE}),
    }
    names = [name for name in looks if name in numbers and (is_coarse or name != "b_spline_same_size")]
    axes = canvas.subplots()
    for name in names:
        label, look = looks[name]
        distribution = numbers[name]["distribution"]
        axes.plot(centers(N_BINS), np.where(distribution > 0.0, distribution, np.nan), label=label, **look)
    axes.set(xlabel="orthogonality $Q$", ylabel="distribution of cells", xlim=(0, 1))
    axes.set(yscale="log") if log else axes.set(ylim=(0, None))
    axes.legend(loc="upper left")
