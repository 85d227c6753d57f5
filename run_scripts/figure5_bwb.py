"""Figure 5: orthogonality of the cells before and after a flat plate becomes a blended-wing body with winglets."""

from __future__ import annotations

from common import figure, run
from morphs import BLENDED_WING_BODY
from quality_distributions import NODE_BASED, draw, study


def main(paper: bool = False, figures=None, node_based: str | None = None) -> dict:
    """Move the grid with the B-spline mover and node by node, five increments of linear elasticity each.

    Parameters
    ----------
    paper : bool
        12 blocks of 45 x 45 x 45 nodes with 9 x 9 x 9 control points.
    figures : path-like, optional
        Folder for ``figure5_bwb.png``.
    node_based : {"full", "coarse", "none"}, optional
        Which grid moves node by node, see `quality_distributions.study`.

    Returns
    -------
    dict
        Those of `quality_distributions.study`.
    """
    numbers = study(BLENDED_WING_BODY, paper, node_based)
    if figures:
        with figure(figures, "figure5_bwb", size=(5.2, 3.6)) as canvas:
            draw(canvas, numbers, log=True)
    return numbers


if __name__ == "__main__":
    run(main, __doc__, node_based=NODE_BASED)
