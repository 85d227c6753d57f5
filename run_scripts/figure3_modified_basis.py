"""Figure 3: a basis function with curved knots.

A two-dimensional modified basis function, which moves with its curved knots. It takes a few seconds. The output is the
place of the function's maximum, which moves, the jumps of its derivatives across knots, which are only errors of the
finite differences, and the picture of the figure.
"""

from __future__ import annotations

import numpy as np

from bspline_mdao.plotting import figure
from bspline_mdao.scripts import run
from bspline_mdao.splines import BilinearKnots, basis, basis_jets

ORDER, FUNCTION = 4, 3  # cubic; the fourth of seven functions, numbered from 0
EDGE_KNOTS = ([0.15, 0.3, 0.45], [0.5, 0.7, 0.85])  # inner knots in eta at zeta = 0 and 1


def main(figures=None) -> dict:
    """Evaluate ``N_4(eta; zeta)`` with knots that are linear in zeta.

    Parameters
    ----------
    figures : path-like, optional
        Folder for ``figure3_modified_basis.png``.

    Returns
    -------
    dict
        ``peak_at``, the eta of the maximum at zeta = 0, 1/2 and 1; ``partition_of_unity_error``; and ``jumps``, the
        largest jump of the function and of its first and second derivatives in (eta, zeta) across the inner knots.
    """
    eta, zeta = np.linspace(0.0, 1.0, 201), np.linspace(0.0, 1.0, 101)
    function, total = modified_basis(*np.meshgrid(eta, zeta, indexing="ij"))
    if figures:
        draw(figures, eta, zeta, function)
    return {
        "peak_at": eta[function[:, [0, 50, 100]].argmax(axis=0)],
        "partition_of_unity_error": np.abs(total - 1.0).max(),
        "jumps": jumps_across_knots(zeta),
    }


def knots() -> BilinearKnots:
    """Knots in eta; of the other two parameters (zeta, xi) they depend on zeta."""
    edges = [np.concatenate([np.zeros(ORDER), inner, np.ones(ORDER)]) for inner in EDGE_KNOTS]
    return BilinearKnots([[edge, edge] for edge in edges], ORDER)


def modified_basis(eta: np.ndarray, zeta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Evaluate the function that is drawn, and the sum of all functions, in the shape of ``eta``."""
    spans, values = basis(knots(), eta.ravel(), zeta.ravel())
    return pick(spans, values).reshape(eta.shape), values.sum(axis=1).reshape(eta.shape)


def pick(spans: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (or jets) of the function that is drawn, zero outside its support."""
    column = FUNCTION - (spans - ORDER + 1)
    is_support = (column >= 0) & (column < ORDER)
    picked = values[np.arange(spans.size), np.clip(column, 0, ORDER - 1)]
    return np.where(is_support.reshape(-1, *[1] * (picked.ndim - 1)), picked, 0.0)


def jumps_across_knots(zeta: np.ndarray, step: float = 1e-9) -> list[float]:
    """Largest jump across the inner knots of the derivatives of order 0, 1 and 2."""
    lines = knots().values(zeta, 0 * zeta)[:, ORDER:-ORDER].ravel()
    across = np.repeat(zeta, len(EDGE_KNOTS[0]))
    left, right = (pick(*basis_jets(knots(), lines + side * step, across)) for side in (-1, 1))
    jump = np.abs(right - left).max(axis=0)
    return [jump[:1].max(), jump[1:4].max(), jump[4:].max()]


def draw(folder, eta: np.ndarray, zeta: np.ndarray, function: np.ndarray) -> None:
    """Draw the function as a surface, and from above with its inner knots (dashed)."""
    lines = knots().values(zeta, 0 * zeta)[:, ORDER:-ORDER]
    eta_2d, zeta_2d = np.meshgrid(eta, zeta, indexing="ij")
    with figure(folder, "figure3_modified_basis", size=(7.2, 3.4)) as canvas:
        surface = canvas.add_subplot(1, 2, 1, projection="3d", computed_zorder=False)
        mesh_lines = {"rcount": 41, "ccount": 41, "edgecolor": "white", "linewidth": 0.15}
        surface.plot_surface(eta_2d, zeta_2d, function, cmap="viridis", vmin=0, vmax=0.8, **mesh_lines)
        surface.set(xlabel=r"$\eta$", ylabel=r"$\zeta$", xlim=(0, 1), ylim=(0, 1), zlim=(0, 0.8))
        surface.view_init(elev=30, azim=-110)
        surface.set_box_aspect((1, 1, 0.55))
        plane = canvas.add_subplot(1, 2, 2)
        shades = plane.contourf(eta_2d, zeta_2d, function, levels=np.linspace(0, 0.8, 17), cmap="viridis")
        plane.plot(lines, zeta, "--", color="white", linewidth=1)
        plane.set(xlabel=r"$\eta$", ylabel=r"$\zeta$", xlim=(0, 1), ylim=(0, 1), aspect="equal")
        canvas.colorbar(shades, ax=plane, shrink=0.8, label=r"$\mathcal{N}_4(\eta; \zeta)$")


if __name__ == "__main__":
    run(main)
