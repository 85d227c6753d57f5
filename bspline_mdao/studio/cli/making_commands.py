"""The commands that make grids of shapes, and their options."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .program import command, json_option

__all__ = ["airfoil", "wing"]

output_option = click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="MODEL.h5|GRID",
    required=True,
    help="Fitted model, or grid alone.",
)


@command(
    "airfoil naca2412 -o foil.h5",
    "airfoil rae2822.dat -o foil.cgns --around 256 --y-plus 1 --reynolds 6.5e6",
    "airfoil cst:0.17,0.16,0.15/-0.17,-0.1,-0.15 -o foil.h5",
)
@click.argument("name", metavar="AIRFOIL")
@output_option
@click.option(
    "--around",
    type=click.IntRange(8, 10_000),
    default=128,
    show_default=True,
    metavar="N",
    help="Cells around it, an even number.",
)
@click.option(
    "--away",
    type=click.IntRange(4, 10_000),
    metavar="N",
    help="Cells from it to the outer boundary; 48 by default, and with layers as many as grow by 15 % from the wall.",
)
@click.option(
    "--far",
    type=click.FloatRange(min=0.0, min_open=True),
    default=50.0,
    show_default=True,
    metavar="R",
    help="Radius of the outer boundary in chords.",
)
@click.option(
    "--chord",
    type=click.FloatRange(min=0.0, min_open=True),
    default=1.0,
    show_default=True,
    metavar="C",
    help="Length of the chord (m), whatever the unit of a file is.",
)
@click.option(
    "--first-cell",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="H",
    help="Height of the first cells (m), for boundary layers.",
)
@click.option(
    "--y-plus",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="Y",
    help="Height of the first cells in viscous units, by a flat plate; give --reynolds as well.",
)
@click.option(
    "--reynolds", type=click.FloatRange(min=0.0, min_open=True), metavar="RE", help="Reynolds number of the chord."
)
@click.option("--symmetric", is_flag=True, help="The file has one side of a symmetric section.")
@json_option
def airfoil(name: str, output: Path, json: Path | None, **options: Any) -> None:
    """Make an O-grid about an airfoil, and fit it where the output is a model.

    AIRFOIL is NACA digits, such as naca2412 or naca23012; coefficients of class and shape functions from the nose to
    the trailing edge, cst:UPPER/LOWER, with commas between them, and /BASE behind them for the height of a blunt
    trailing edge; or a file of points in the order of Selig or Lednicer, or of two plain columns, in any unit. A blunt
    trailing edge is closed by a wedge. The name of GRID gives the format: {written}.
    """
    from .airfoil import AirfoilOptions, make_airfoil

    make_airfoil(name, output, json, AirfoilOptions(**options))


@command("wing planform.toml -o wing.h5", "wing planform.toml -o wing.cgns")
@click.argument("planform", metavar="PLANFORM.toml", type=click.Path(path_type=Path))
@output_option
@json_option
def wing(**options: Any) -> None:
    r"""Make an H-H grid of twelve blocks about a wing, and fit it where the output is a model.

    PLANFORM.toml describes one half of a trapezoidal wing, and the grid about it:

    \b
      [planform]
      semi_span = 4.0         # m; also root_chord, taper, sweep (deg), tip_length
      [sections]
      root = "naca2414"       # whatever the command airfoil takes; files lie beside this one
      tip = "naca0010"
      [grid]
      nodes = [23, 33, 17]    # per block along the stream, away from the wing, along the span
      y_plus = 1.0            # or first_cell (m); also leading, trailing, tip, root, far
      reynolds = 6e6          # of the root chord

    Twist, dihedral and what else has a name come by 'move', and the moved grid is fitted again. The name of GRID gives
    the format: {written}.
    """
    from .wing import make_wing

    make_wing(**options)
