"""Draw an O-grid beside a C-grid about the same airfoil, for the page on airfoils.

``python docs/draw_airfoil_grids.py`` writes ``docs/_static/airfoil_grids.png``: both as the command ``airfoil`` makes
them, but of half as many cells per direction, and what is behind their trailing edges. Blocks have their own colours.
"""

from __future__ import annotations

from pathlib import Path

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, GRAY, ORANGE, draw_net, figure

STATIC = Path(__file__).parent / "_static"

VIEWS = ((-0.6, 2.0), (-0.75, 0.75)), ((0.88, 1.14), (-0.075, 0.075))
"""What a row shows, along the chord and across: the airfoil, and its trailing edge."""


def main() -> None:
    """Draw both grids, at two scales."""
    grids = {"O-grid": "O", "C-grid": "C"}
    with figure(STATIC, "airfoil_grids", (9.0, 5.6), n_colours=32) as drawing:
        rows = drawing.subplots(2, 2)
        for column, (name, topology) in enumerate(grids.items()):
            grid = bm.generators.airfoil_grid("naca0012", 64, 24, topology=topology)
            for axes, (along, across) in zip(rows[:, column], VIEWS):
                for block, color in zip(grid.blocks, (BLUE, GRAY, ORANGE) if len(grid.blocks) > 1 else (BLUE,)):
                    draw_net(axes, block.nodes[:, :, 0, :2], color=color, linewidth=0.5)
                labels = {"xlabel": "$x / c$", "ylabel": "" if column else "$y / c$"}
                axes.set(aspect="equal", xlim=along, ylim=across, **labels)
            rows[0, column].set_title(name, fontsize=11)


if __name__ == "__main__":
    main()
