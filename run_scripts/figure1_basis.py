"""Figure 1: the cubic B-spline basis.

The cubic B-spline basis on the knots {0, 0, 0, 0, 0.1, 0.2, 0.5, 1, 1, 1, 1}. It takes a second. The output is the
values of the functions at the inner knots, their maxima, how far their sum is from one, and the picture of the figure.
"""

from __future__ import annotations

import numpy as np

from bspline_mdao.plotting import figure
from bspline_mdao.scripts import run
from bspline_mdao.splines import ConstantKnots, basis

KNOTS = ConstantKnots([0, 0, 0, 0, 0.1, 0.2, 0.5, 1, 1, 1, 1], order=4)


def main(figures=None) -> dict:
    """Evaluate the seven basis functions.

    Parameters
    ----------
    figures : path-like, optional
        Folder for ``figure1_basis.png``.

    Returns
    -------
    dict
        ``n_functions``; ``values_at_inner_knots``, one row of all functions per knot; ``maxima`` and ``maxima_at`` of
        each function; ``partition_of_unity_error``.
    """
    xi = np.linspace(0.0, 1.0, 1001)
    functions = all_functions(xi)
    if figures:
        draw(figures, xi, functions)
    return {
        "n_functions": KNOTS.n_control,
        "values_at_inner_knots": all_functions(KNOTS.knots[4:7]),
        "maxima": functions.max(axis=0),
        "maxima_at": xi[functions.argmax(axis=0)],
        "partition_of_unity_error": np.abs(functions.sum(axis=1) - 1.0).max(),
    }


def all_functions(xi: np.ndarray) -> np.ndarray:
    """All basis functions at the parameters ``xi``, those that vanish too, shape (n, N)."""
    spans, values = basis(KNOTS, xi)
    functions = np.zeros((xi.size, KNOTS.n_control))
    columns = spans[:, None] + np.arange(1 - KNOTS.order, 1)
    np.put_along_axis(functions, columns, values, axis=1)
    return functions


def draw(folder, xi: np.ndarray, functions: np.ndarray) -> None:
    """Draw the basis functions, and the knots as squares."""
    with figure(folder, "figure1_basis", size=(5.2, 3.2)) as canvas:
        axes = canvas.subplots()
        for i, function in enumerate(functions.T):
            is_support = (xi >= KNOTS.knots[i]) & (xi <= KNOTS.knots[i + KNOTS.order])
            axes.plot(xi[is_support], function[is_support], color=f"C{i}", clip_on=False)
            label(axes, i, xi[function.argmax()], function.max())
        axes.plot(KNOTS.knots, 0 * KNOTS.knots, "s", color="black", markersize=6, clip_on=False, zorder=3)
        axes.set(xlabel=r"$\xi$", ylabel=r"$\mathcal{N}_i(\xi)$", xlim=(0, 1), ylim=(0, 1.05))
        axes.spines[["top", "right"]].set_visible(False)


def label(axes, i: int, xi: float, value: float) -> None:
    """Write the name of function ``i`` over its maximum; beside it for the first and the last."""
    offset, align = {0: ((6, -6), "left"), KNOTS.n_control - 1: ((-6, -6), "right")}.get(i, ((0, 4), "center"))
    name = rf"$\mathcal{{N}}_{i + 1}$"
    axes.annotate(name, (xi, value), offset, textcoords="offset points", color=f"C{i}", ha=align)


if __name__ == "__main__":
    run(main)
