"""The commands that make grids of shapes, and their options."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ...grids.topology.length_unit import LENGTH_UNITS
from .imports import without_collector
from .program import POSITIVE, command, json_option, output_option
from .units import units_option

__all__ = ["airfoil", "extrude", "wing"]

made_option = output_option("MODEL.h5|GRID", "Fitted model, or grid alone.")

allow_invalid_option = click.option(
    "--allow-invalid", is_flag=True, help="Write the grid even if cells of it are inverted."
)

y_plus_option = click.option(
    "--y-plus",
    type=POSITIVE,
    metavar="Y",
    help="Height of the first cells in viscous units, estimated for a flat plate; needs --reynolds.",
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
    help="Cells around the airfoil, an even number.",
)
@click.option(
    "--away",
    type=click.IntRange(4, 10_000),
    metavar="N",
    help="Cells from it to the outer boundary; 48 by default, or with layers the number that grows by 15 % per cell.",
)
@click.option(
    "--far",
    type=POSITIVE,
    default=50.0,
    show_default=True,
    metavar="R",
    help="Radius of the outer boundary in chords; for a C-grid its distance upstream and downstream, and twice above.",
)
@click.option(
    "--chord",
    type=POSITIVE,
    default=1.0,
    show_default=True,
    metavar="C",
    help="Length of the chord in --units, whatever the unit of the file.",
)
@click.option(
    "--first-cell",
    type=POSITIVE,
    metavar="H",
    help="Height of the first cells in --units, for boundary layers.",
)
@y_plus_option
@click.option("--reynolds", type=POSITIVE, metavar="RE", help="Reynolds number of the chord.")
@click.option(
    "--topology",
    type=click.Choice(["O", "C"], case_sensitive=False),
    default="O",
    show_default=True,
    help="O-grid around it, or C-grid around it and along its wake.",
)
@click.option(
    "--wake",
    type=click.IntRange(4, 10_000),
    metavar="N",
    help="Cells along the wake of a C-grid; by default the number that grows by 15 % per cell.",
)
@click.option(
    "--base",
    type=click.Choice(["wall", "closed"], case_sensitive=False),
    help="Blunt trailing edge: 'wall' with a block behind it (default of C-grids), or 'closed' by a wedge (O-grids); "
    "'wall' also gives NACA sections the blunt edge of their definition.",
)
@click.option("--symmetric", is_flag=True, help="The file has one side of a symmetric section.")
@click.option("--units", type=click.Choice(LENGTH_UNITS), help="Unit of length of the grid; metres by default.")
@allow_invalid_option
@json_option
def airfoil(name: str, output: Path, json: Path | None, allow_invalid: bool, **options: Any) -> None:
    """Make an O- or C-grid around an airfoil, and fit it if the output is a model.

    AIRFOIL is four or five NACA digits, such as naca2412 or naca23012; class-shape coefficients from the nose to the
    trailing edge, cst:UPPER/LOWER, separated by commas, with /BASE for the height of a blunt trailing edge; or a file
    of points in Selig or Lednicer order, or two plain columns, in any unit: it is scaled to --chord. Other sections,
    such as the NACA 6-series, need such a file, from a database of airfoil coordinates. The name of GRID sets the
    format: {written}.
    """
    with without_collector():
        from .airfoil import AirfoilOptions, make_airfoil

    make_airfoil(name, output, json, AirfoilOptions(**options), allow_invalid)


@command("wing planform.toml -o wing.h5", "wing planform.toml -o wing.cgns")
@click.argument("planform", metavar="PLANFORM.toml", type=click.Path(path_type=Path))
@made_option
@allow_invalid_option
@json_option
def wing(**options: Any) -> None:
    r"""Make an H-H grid of twelve blocks or more around a wing, and fit it if the output is a model.

    PLANFORM.toml describes half a wing and the grid around it:

    \b
      [planform]
      semi_span = 4.0         # m; also root_chord, taper, sweep (deg), tip_length; or, with kinks,
      # stations = [[0, 0, 1.6], [1.2, 0.9, 1.0], [4, 1.9, 0.5]]  # span, leading edge, chord (m)
      [sections]
      root = "naca2414"       # as in the command airfoil; files are relative to this one
      tip = "naca0010"
      [grid]
      nodes = [23, 33, 17]    # per block along the stream, away from the wing, along the span
      y_plus = 1.0            # or first_cell (m); also leading, trailing, tip, root, far
      reynolds = 6e6          # of the root chord

    For sections between root and tip give stations, instead of [sections] and the numbers of the planform:

    \b
      [[stations]]            # from the root on; a station without a section is interpolated
      span = 0.0              # m, like leading (edge) and chord
      leading = 0.0
      chord = 1.6
      section = "naca2414"

    For twist, dihedral and other named changes use 'move', and fit the moved grid again. The name of GRID sets the
    format: {written}.
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
    help="Length of the Reynolds number; by default the middle side of the surface's box, the chord of most wings.",
)
@click.option("--layers", type=int, metavar="N", help="Layers of cells; 64 by default, unless --growth is given.")
@click.option(
    "--growth",
    type=float,
    metavar="G",
    help="Height of a layer divided by the height of the one below. With --layers, the grid ends with them.",
)
@click.option(
    "--outer",
    type=float,
    metavar="D",
    help="Approximate height of all layers; by default 20 times the longest extent of the surface.",
)
@click.option(
    "--symmetry",
    multiple=True,
    metavar="PLANE",
    help="Normal of a plane of symmetry at the rim: x, y, z, a,b,c or none, more than once; by default planes in which "
    "the surface ends at a right angle, but not planes of straight edges.",
)
@click.option(
    "--constant",
    multiple=True,
    metavar="PLANE",
    help="Normal of a plane in which edges of the rim stay although the surface is oblique to it; as for --symmetry.",
)
@click.option(
    "--periodic",
    multiple=True,
    metavar="PLANE",
    help="Normal of the planes with periodic edges at both ends, which differ by a translation.",
)
@click.option(
    "--splay",
    type=click.FloatRange(0.0, 80.0),
    default=15.0,
    show_default=True,
    metavar="DEG",
    help="Angle by which free edges lean outwards far from the surface.",
)
@click.option(
    "--background",
    type=POSITIVE,
    metavar="D",
    help="Distance of the sides of a box of cells around the grid, for an overset grid.",
)
@click.option("--inward", is_flag=True, help="Extrude to the other side, into a closed surface.")
@allow_invalid_option
@units_option
@json_option
def extrude(**options: Any) -> None:
    """Extrude a surface grid to a volume grid, layer by layer, and show its quality.

    SURFACE is a {read} file whose blocks have one node in one direction. The name of GRID sets the format: {written};
    MODEL.h5 also fits the grid. Formats with patches get wall, farfield and symmetry.
    """
    with without_collector():
        from .extrude import extrude_file

    extrude_file(**options)
