"""The commands for grids, models and results, and their options."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import click

from .imports import without_collector
from .movers import MoverOptions, moving_options
from .program import POSITIVE, command, grid_argument, json_option, output_option, patches_option
from .units import units_option

__all__ = ["cad", "live", "quality", "report", "seams"]


@command("quality wing_moved.xyz --baseline wing.h5", "quality moved.su2 --baseline mesh.h5")
@grid_argument
@click.option(
    "--baseline",
    metavar="GRID|MODEL.h5",
    help="Grid or unstructured mesh before the move, or its model, which 'fit' wrote: compare the heights of first "
    "cells at walls, and list cells that have become inverted.",
)
@patches_option
@click.option(
    "--bins",
    type=click.IntRange(min=1),
    default=50,
    show_default=True,
    metavar="N",
    help="Bins of the distribution of Q between 0 and 1.",
)
@units_option
@json_option
def quality(**options: Any) -> None:
    """Measure the cells of a grid: orthogonality Q, corners, volumes, inverted cells, first cells at walls.

    GRID is a {read} file, a fitted model MODEL.h5, or a built-in grid: {built_in}. For a CGNS file of curved
    hexahedra, from refine --degree, it measures Jacobians. For an unstructured mesh, {meshes}, it measures volumes,
    inverted cells, and the non-orthogonality and skewness of faces as OpenFOAM's checkMesh does.

    {definitions}
    """
    with without_collector():
        from .quality import measure_quality

    measure_quality(**options)


@command("cad wing.h5 -o wing.step", "cad wing.h5 -o wing.igs --units mm --tolerance 1e-5")
@click.argument("model", metavar="MODEL.h5", type=click.Path(path_type=Path))
@output_option("FILE", "File to write: .step or .stp, .iges or .igs.")
@click.option(
    "--tolerance",
    type=POSITIVE,
    metavar="T",
    help="Largest distance (m) of refitted walls, those with curved knots; by default 1e-6 of the size of the walls.",
)
@click.option(
    "--units",
    type=click.Choice(("m", "mm", "in", "ft")),
    default="m",
    show_default=True,
    help="Unit of length of the file.",
)
@click.option("--patch", multiple=True, metavar="PATCH", help="Patch to write; may be repeated; all walls by default.")
@json_option
def cad(**options: Any) -> None:
    """Write the walls of a model as B-spline surfaces for CAD, sewn along their edges, and read them back.

    Sides of blocks with straight knots are exact; others are refitted to the tolerance, their edges exactly.
    """
    with without_collector():
        from .cad import write_cad_file

    write_cad_file(**options)


@command("live wing.h5", "live wing.h5 --deform bend=60deg@0.7 --no-browser --port 8080", "live study.toml")
@click.argument("file", metavar="MODEL.h5|STUDY.toml", type=click.Path(path_type=Path))
@click.option(
    "--deform",
    multiple=True,
    metavar="SPEC",
    help="One more slider, up to a deformation by an angle or a factor, such as bend=60deg@0.7 or "
    "rotate=20deg@chord 0.7,blend=0.05; as for move, more than once.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    default=Path("."),
    help="Folder for what the page writes; the working directory by default.",
)
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    metavar="ADDRESS",
    help="Address to listen on. By default this machine alone reaches the page; whoever does deforms and writes files.",
)
@click.option("--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="Port; a free one by default.")
@click.option("--no-browser", is_flag=True, help="Print the address and open no browser.")
@moving_options
def live(file: Path, no_browser: bool, **options: Any) -> None:
    """Open a model in the browser: sliders and control points move, and the grid and its numbers follow.

    Of a study, sliders are its variables between their bounds, and the button of studies writes it with their values.

    The page shows the surface grid by quality, heights or displacement, the worst cells, thickness of sections, and
    the lift of a wing by a vortex lattice. Its buttons undo, and write a report, STEP, PLOT3D, control points or a
    study. It needs trame and VTK: pip install "bspline_mdao[live]".
    """
    with without_collector():
        from .live import LiveOptions, open_live

    mover = MoverOptions(**{field.name: options.pop(field.name) for field in fields(MoverOptions)})
    open_live(file, LiveOptions(has_browser=not no_browser, mover=mover, **options))


@command("seams wing.h5", "seams wing.h5 --deform bend=60deg@0.6 --patch 'wing*'")
@click.argument("model_file", metavar="MODEL.h5", type=click.Path(path_type=Path))
@click.option(
    "--deform",
    multiple=True,
    metavar="DEFORMATION",
    help="Deformation as for move, repeatable: measure after it, at seams that were smooth before.",
)
@click.option(
    "--patch", multiple=True, metavar="PATCH", help="Patch to measure; may be repeated; all walls by default."
)
@click.option(
    "--max-kink",
    type=click.FloatRange(min=0.0, max=180.0),
    default=5.0,
    show_default=True,
    metavar="DEG",
    help="Largest kink at which a seam counts as smooth rather than as an edge.",
)
@click.option("--mirror", is_flag=True, help="Also measure where walls meet their mirror images at planes of symmetry.")
@json_option
def seams(**options: Any) -> None:
    """Measure how smooth the walls of a model are across the seams between its blocks, and at poles.

    Kinks are angles between the tangent planes of both sides, and curvatures are across the seam, at 21 places of each.
    """
    with without_collector():
        from .seams import measure_seams

    measure_seams(**options)


@command("report wing.h5 -o wing.html", "report case.sql --model wing.h5 -o optimum.html")
@click.argument("source", metavar="MODEL.h5|CASE.sql|FOLDER", type=click.Path(path_type=Path))
@output_option("PAGE.html", "Page to write.")
@click.option(
    "--model",
    type=click.Path(path_type=Path),
    metavar="MODEL.h5",
    help="The optimised model, for a case file that does not name it or whose model has moved.",
)
@click.option("--title", metavar="TEXT", help="Heading of the page; the name of the source by default.")
@click.option(
    "--triangles",
    type=click.IntRange(min=100),
    default=40_000,
    show_default=True,
    metavar="N",
    help="Approximate number of wall triangles drawn for each shape.",
)
@json_option
def report(**options: Any) -> None:
    """Write a report on a model or on a recorded optimisation: one HTML file that needs no network.

    It shows the grid and its control mesh, or an unstructured mesh and its lattice, with quality, wall heights and
    sections. For a case file of OpenMDAO's SqliteRecorder it also has histories, first-order optimality, variables
    with their bounds and the N2 diagram.
    """
    with without_collector():
        from .report import report_on

    report_on(**options)
