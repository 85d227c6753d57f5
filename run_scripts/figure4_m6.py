"""Figure 4: orthogonality of the cells before and after the ONERA M6 wing becomes a rectangular NACA 0012 wing."""

from __future__ import annotations

from common import figure, run
from morphs import ONERA_M6
from quality_distributions import NODE_BASED, draw, study


def main(paper: bool = False, figures=None, node_based: str | None = None) -> dict:
    """Move the grid with the B-spline mover and node by node, five increments of linear elasticity each.

    Parameters
    ----------
    paper : bool
        12 blocks of 45 x 65 x 33 nodes with 13 x 13 x 9 control points.
    figures : path-like, optional
        Folder for ``figure4_m6.png``.
    node_based : {"full", "coarse", "none"}, optional
        Which grid moves node by node, see `quality_distributions.study`.

    Returns
    -------
    dict
        Those of `quality_distributions.study`.
    """
    numbers = study(ONERA_M6, paper, node_based)
    if figures:
        with figure(figures, "figure4_m6", size=(5.2, 3.6)) as canvas:
            draw(canvas, numbers)
    return numbers


if __name__ == "__main__":
    run(main, __doc__, node_based=NODE_BASED)
