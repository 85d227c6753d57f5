"""The commands that make grids of shapes, and their options."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .imports import without_collector
from .program import POSITIVE, command, json_option, output_option
from .units import units_option

__all__ = ["airfoil", "extrude", "wing"]

made_option = output_option("MODEL.h5|GRID", "Fitted model, or grid alone.")

y_plus_option = click.option(
    "--y-plus",
    type=POSITIVE,
    metavar="Y",
    help="Height of the first cells in viscous units, by a flat plate; give --reynolds as well.",
)


@command(
    "airfoil naca2412 -o foil.h5",
    "airfoil rae2822.dat -o foil.cgns --around 256 --y-plus 1 --reynolds 6.5e6",
    "airfoil cst:0.17,0.16,0.15/-0.17,-0.1,-0.15 -o foil.h5 --topology C",
)
@click.argument("name", metavar="AIRFOIL")
@made_option
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
    type=POSITIVE,
    default=50.0,
    show_default=True,
    metavar="R",
    help="Radius of the outer boundary in chords; of a C-grid its distance upstream and behind; above it is twice.",
)
@click.option(
    "--chord",
    type=POSITIVE,
    default=1.0,
    show_default=True,
    metavar="C",
    help="Length of the chord (m), whatever the unit of a file is.",
)
@click.option(
    "--first-cell",
    type=POSITIVE,
    metavar="H",
    help="Height of the first cells (m), for boundary layers.",
)
@y_plus_option
@click.option("--reynolds", type=POSITIVE, metavar="RE", help="Reynolds number of the chord.")
@click.option(
    "--topology",
    type=click.Choice(["O", "C"], case_sensitive=False),
    default="O",
    show_default=True,
    help="Around it, or around it and along its wake.",
)
@click.option(
    "--wake",
    type=click.IntRange(4, 10_000),
    metavar="N",
    help="Cells along the wake of a C-grid; by default as many as grow by 15 % from the trailing edge.",
)
@click.option(
    "--base",
    type=click.Choice(["wall", "closed"], case_sensitive=False),
    help="What a blunt trailing edge becomes: a wall with a block behind it, as in C-grids by default, or closed by a "
    "wedge, as in O-grids; 'wall' makes NACA sections blunt, as their definition is.",
)
@click.option("--symmetric", is_flag=True, help="The file has one side of a symmetric section.")
@json_option
def airfoil(name: str, output: Path, json: Path | None, **options: Any) -> None:
    """Make an O- or C-grid about an airfoil, and fit it where the output is a model.

    AIRFOIL is NACA digits, such as naca2412 or naca23012; coefficients of class and shape functions from the nose to
    the trailing edge, cst:UPPER/LOWER, with commas between them, and /BASE behind them for the height of a blunt
    trailing edge; or a file of points in the order of Selig or Lednicer, or of two plain columns, in any unit. The
    name of GRID gives the format: {written}.
    """
    with without_collector():
        from .airfoil import AirfoilOptions, make_airfoil

    make_airfoil(name, output, json, AirfoilOptions(**options))


@command("wing planform.toml -o wing.h5", "wing planform.toml -o wing.cgns")
@click.argument("planform", metavar="PLANFORM.toml", type=click.Path(path_type=Path))
@made_option
@json_option
def wing(**options: Any) -> None:
    r"""Make an H-H grid of twelve blocks or more about a wing, and fit it where the output is a model.

    PLANFORM.toml describes one half of a wing, and the grid about it:

    \b
      [planform]
      semi_span = 4.0         # m; also root_chord, taper, sweep (deg), tip_length; or, with kinks,
      # stations = [[0, 0, 1.6], [1.2, 0.9, 1.0], [4, 1.9, 0.5]]  # span, leading edge, chord (m)
      [sections]
      root = "naca2414"       # whatever the command airfoil takes; files lie beside this one
      tip = "naca0010"
      [grid]
      nodes = [23, 33, 17]    # per block along the stream, away from the wing, along the span
      y_plus = 1.0            # or first_cell (m); also leading, trailing, tip, root, far
      reynolds = 6e6          # of the root chord

    Sections between root and tip are those of stations, in the place of [sections] and of numbers of the planform:

    \b
      [[stations]]            # from the root on; without a section it is blended between those beside it
      span = 0.0              # m, as leading (edge) and chord
      leading = 0.0
      chord = 1.6
      section = "naca2414"

    Twist, dihedral and what else has a name come by 'move', and the moved grid is fitted again. The name of GRID gives
    the format: {written}.
    """
    with without_collector():
        from .wing import make_wing

    make_wing(**options)


@command(
    "extrude surface.xyz -o wing.cgns --first-cell 1e-5 --layers 64",
    "extrude surface.xyz -o wing.cgns --y-plus 1 --reynolds 6e6 --length 0.8",
    "extrude surface.xyz -o wing.h5 --first-cell 1e-3 --growth 1.2 --outer 50 --symmetry z",
)
@click.argument("surface", metavar="SURFACE", type=click.Path(path_type=Path))
@made_option
@click.option("--first-cell", type=POSITIVE, metavar="H", help="Height of the first cells at the surface.")
@y_plus_option
@click.option("--reynolds", type=POSITIVE, metavar="RE", help="Reynolds number of the length.")
@click.option(
    "--length",
    type=POSITIVE,
    metavar="L",
    help="What the Reynolds number is of; the middle side of the surface's box by default, the chord of most wings.",
)
@click.option("--layers", type=int, metavar="N", help="Layers of cells; 64 by default, unless --growth is given.")
@click.option(
    "--growth",
    type=float,
    metavar="G",
    help="Height of a layer by that of the one below. With --layers, the grid ends where they do.",
)
@click.option(
    "--outer",
    type=float,
    metavar="D",
    help="Height of all layers, about; 20 times the longest extent of the surface by default.",
)
@click.option(
    "--symmetry",
    multiple=True,
    metavar="PLANE",
    help="Normal of a plane of symmetry at the rim: x, y, z, a,b,c or none, more than once; by default planes in which "
    "the surface ends normally, but not those of straight edges.",
)
@click.option(
    "--constant",
    multiple=True,
    metavar="PLANE",
    help="Normal of a plane that edges of the rim stay in, though the surface is oblique to it; as for --symmetry.",
)
@click.option(
    "--periodic",
    multiple=True,
    metavar="PLANE",
    help="Normal of the planes that periodic edges lie in at both ends: the same but for a translation.",
)
@click.option(
    "--splay",
    type=click.FloatRange(0.0, 80.0),
    default=15.0,
    show_default=True,
    metavar="DEG",
    help="Angle by which free edges lean outwards, far from the surface.",
)
@click.option(
    "--background",
    type=POSITIVE,
    metavar="D",
    help="Distance of the sides of a box of cells around the grid, which ends in it: an overset grid.",
)
@click.option("--inward", is_flag=True, help="Extrude to the other side: inside a closed surface.")
@click.option("--allow-invalid", is_flag=True, help="Write the grid even if cells of it are inverted.")
@units_option
@json_option
def extrude(**options: Any) -> None:
    """Extrude a surface grid to a volume grid, layer by layer, and show its quality.

    SURFACE is a {read} file whose blocks have one node in one direction. The name of GRID gives the format: {written};
    MODEL.h5 fits the grid as well. Patches wall, farfield and symmetry are in it where the format has them.
    """
    with without_collector():
        from .extrude import extrude_file

    extrude_file(**options)
