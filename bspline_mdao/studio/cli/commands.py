"""The commands and their options; those that make grids are in `making_commands`, those of studies in `study_commands`.

To add a command, write its function here and its file beside this one. What a command needs is imported when it runs,
and takes the options by their names, so that ``--help`` is quick and nothing is named twice.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import click
from click import shell_completion

from ...core.fit.options import EXPONENTS, METHODS
from .counts import n_control_option
from .imports import without_collector
from .making_commands import airfoil, extrude, wing
from .movers import MoverOptions, moving_options
from .program import POSITIVE, bspline_mdao, command, grid_argument, json_option, output_option, patches_option
from .study_commands import init, optimize, sample
from .units import units_option
from .words import PROGRAM

__all__ = ["airfoil", "bspline_mdao", "extrude", "init", "optimize", "sample", "wing"]

SHELLS = ("bash", "zsh", "fish")
"""Shells that commands can be completed in."""

DEFORM = (
    "Deformation of the design surface, such as twist=10deg, bend=120deg@0.7, stretch=2, chord, thickness, sweep, "
    "dihedral, pitch, rotate=20deg@chord 0.7,blend=0.05, radius=1.1@axis(0,0,0 -> 1,0,0), axial, "
    "translate=0.1/0/0, bumps=0.01,seed=1, ffd=box.xyz,to=moved.xyz, cad=wing.step,to=moved.step; or a file of its new "
    "control points (.csv, .npy). Several are done in turn."
)
"""Help of the option that deforms."""


@command("inspect wing.xyz --draft wing.toml")
@grid_argument
@patches_option
@click.option("--draft", type=click.Path(path_type=Path), metavar="FILE.toml", help="Write patches to start from.")
@click.option(
    "--reynolds",
    type=POSITIVE,
    metavar="RE",
    help="Reynolds number per unit of length, for an estimate of y+ at walls.",
)
@units_option
@json_option
def inspect(**options: Any) -> None:
    """Show blocks, interfaces, boundary faces, first cells at walls and what looks wrong in a grid.

    GRID is a {read} file, a model MODEL.h5, of which the errors of the fit are shown as well, or a built-in grid:
    {built_in}. Of a mesh without structure, {meshes}, cells and markers are shown, what these seem to be, and what has
    to be declared.
    """
    with without_collector():
        from .inspect import inspect_grid

    inspect_grid(**options)


@command(
    "fit wing.xyz -o wing.h5 --n-control 13x13x9 --correct 2",
    "fit wing.xyz -o wing.h5 --n-control 2=17x13x9",
    "fit mesh.su2 -o mesh.h5",
)
@grid_argument
@output_option("MODEL.h5", "Fitted model.")
@n_control_option
@click.option(
    "--order",
    type=click.IntRange(min=2),
    metavar="P",
    help="Order of the B-splines, which is their degree plus one; by default 4, or 3 in short directions.",
)
@click.option(
    "--correct",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="N",
    help="Cycles of parameter correction: a closer fit, more time.",
)
@patches_option
@click.option(
    "--method",
    type=click.Choice(tuple(METHODS)),
    default=next(iter(METHODS)),
    show_default=True,
    help=f"How control points are found. {'; '.join(f'{name}: {what}' for name, what in METHODS.items())}.",
)
@click.option(
    "--parametrization",
    type=click.Choice(tuple(EXPONENTS)),
    default=next(iter(EXPONENTS)),
    show_default=True,
    help="Parameters of the nodes along grid lines.",
)
@click.option("--no-residual", is_flag=True, help="Do not carry what the splines miss of the grid.")
@click.option("--no-wall-layer", is_flag=True, help="Do not let nodes near walls follow them as a rigid body.")
@click.option("--no-certify", is_flag=True, help="Do not prove, element by element, that the splines are valid.")
@click.option(
    "--lattice/--no-lattice",
    default=None,
    help="Move all blocks of the grid by one lattice of B-splines around it, as a mesh without structure, or fit each "
    "of them; by default, component grids that overlap move by a lattice.",
)
@click.option(
    "--spacing",
    type=POSITIVE,
    metavar="H",
    help="Of a lattice: width of its spans around all walls, by default of each body its own, and less in gaps.",
)
@click.option(
    "--spans",
    type=click.FloatRange(min=1.0),
    metavar="N",
    help="Of a lattice: its spans along the longest side of each body, by default 10.",
)
@click.option(
    "--for",
    "moves",
    multiple=True,
    metavar="DEFORM",
    help="Of a mesh without structure: refine the lattice for a move that is to come, as --deform of 'move' takes it, "
    "such as those at the bounds of design variables. May be repeated.",
)
@units_option
@json_option
def fit(**options: Any) -> None:
    """Fit a grid with B-spline volumes, or lay a lattice around a mesh without structure, and write the model.

    GRID is a {read} file, or a built-in grid: {built_in}. A mesh without structure is {meshes}; its walls are guessed
    from names and places of its markers, or declared by --patches.
    """
    with without_collector():
        from .fit import fit_model

    fit_model(**options)


@command("refine wing.h5 --factor 2 -o fine.xyz", "refine wing.h5 --factor 0.5 --degree 3 -o curved.cgns")
@click.argument("model", metavar="MODEL.h5", type=click.Path(path_type=Path))
@click.option(
    "--factor",
    type=click.FloatRange(min=0.0, min_open=True, max=1000.0),
    default=1.0,
    show_default=True,
    metavar="F",
    help="Cells per direction, by those of the grid; below 1 for a coarser member.",
)
@output_option("GRID", "Grid to write.")
@click.option(
    "--degree",
    type=click.IntRange(1, 4),
    metavar="D",
    help="Write curved hexahedra of degree 1 to 4, for solvers of high order; F counts elements then.",
)
@click.option("--allow-invalid", is_flag=True, help="Write curved hexahedra even if some of them are inverted.")
@json_option
def refine(**options: Any) -> None:
    """Write a finer or coarser member of the grid family of a model, or curved elements of high order.

    The name of GRID gives the format: {written}. Curved hexahedra are written as {curved}. Folders that are missing are
    made.
    """
    with without_collector():
        from .refine import refine_model

    refine_model(**options)


@command(
    "move wing.h5 --deform twist=10deg --deform stretch=1.2 -o moved.xyz",
    "move mesh.h5 --deform twist=10deg -o moved.su2",
)
@click.argument("model", metavar="MODEL.h5", type=click.Path(path_type=Path))
@click.option(
    "--deform",
    multiple=True,
    required=True,
    metavar="SPEC",
    help=DEFORM,
)
@output_option("GRID", "Grid to write.")
@moving_options
@click.option(
    "--surface",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write the new surface: its control points (.csv), in the order in which --deform reads them, or CAD (.step, "
    ".igs), see the command cad.",
)
@click.option("--allow-invalid", is_flag=True, help="Write the grid even if cells of it are inverted.")
@click.option("--no-certify", is_flag=True, help="Do not prove, cell by cell, that the grid is valid everywhere.")
@json_option
def move(model: Path, output: Path, json: Path | None, **options: Any) -> None:
    """Deform the design surface of a model, move the control mesh behind it and write the grid.

    The name of GRID gives the format: {written}. Folders that are missing are made. A mesh without structure is written
    as it was read: with other nodes, and all else in its file kept.

    PATCH is a name or a pattern, such as 'wing*'; --deform, --design, --slide, --fix and --release may be given more
    than once.

    {definitions}
    """
    with without_collector():
        from ...core.background.mesh_file import is_mesh_model
        from .mesh_move import move_mesh
        from .move import MoveOptions, move_model

    mover = MoverOptions(**{field.name: options.pop(field.name) for field in fields(MoverOptions)})
    move_it = move_mesh if is_mesh_model(model) else move_model
    move_it(model, output, json, MoveOptions(mover=mover, **options))


@command(
    "ride wing.h5 mesh.su2 --deform twist=10deg -o moved.su2",
    "ride out/model.h5 mesh.su2 --to out/cases.sql -o optimum.su2",
)
@click.argument("model", metavar="MODEL.h5", type=click.Path(path_type=Path))
@click.argument("mesh", metavar="MESH", type=click.Path(path_type=Path))
@click.option("--deform", multiple=True, metavar="SPEC", help=DEFORM)
@click.option(
    "--to",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Follow control points that are known, instead of a deformation: those of the best case of a case file "
    "(.sql), or all of them as .csv or .npy.",
)
@output_option("MESH", "Mesh to write.")
@click.option(
    "--wall",
    multiple=True,
    metavar="MARKER",
    help="Marker of the mesh that is a wall; by default those that lie on the walls of the fitted grid.",
)
@click.option(
    "--tolerance",
    type=click.FloatRange(min=0.0),
    metavar="D",
    help="Distance up to which nodes may be outside the fitted grid; by default the size of its boundary faces there.",
)
@click.option(
    "--hold-outside", is_flag=True, help="Hold nodes that are farther outside, where the boundary of the grid stays."
)
@moving_options
@click.option("--allow-invalid", is_flag=True, help="Write the mesh even if cells of it are inverted.")
@json_option
def ride(model: Path, mesh: Path, output: Path, json: Path | None, **options: Any) -> None:
    """Take an unstructured mesh along with the control mesh of a model.

    MESH is {meshes}. It is written in the format that it is read in; all but its nodes stays as it is. Its walls go
    where the deformation puts them, and nodes near them follow as a rigid body. A mesh of two dimensions (.su2, .cgns,
    .msh, .vtu) goes along with a section: a model of a grid between two planes of symmetry.
    """
    with without_collector():
        from .ride import RideOptions, ride_along

    mover = MoverOptions(**{field.name: options.pop(field.name) for field in fields(MoverOptions)})
    ride_along(model, mesh, output, json, RideOptions(mover=mover, **options))


@command("improve wing.xyz --patches wing.toml -o better.xyz", "improve wing.h5 -o better.xyz")
@grid_argument
@output_option("GRID", "Grid to write.")
@patches_option
@n_control_option
@click.option(
    "--reach",
    type=click.FloatRange(0.0, 0.5, min_open=True, max_open=True),
    default=0.4,
    show_default=True,
    metavar="R",
    help="How far control points may go, by the distance to their nearest neighbours.",
)
@click.option(
    "--height-tolerance",
    type=click.FloatRange(0.0, 1.0, min_open=True, max_open=True),
    default=0.01,
    show_default=True,
    metavar="T",
    help="By how much the heights of first cells at walls may change, relative to what they are.",
)
@click.option(
    "--slide",
    multiple=True,
    metavar="PATCH",
    help="Planar patch whose nodes slide in its plane, as symmetry planes do.",
)
@click.option(
    "--iterations",
    type=click.IntRange(min=1),
    default=60,
    show_default=True,
    metavar="N",
    help="Iterations in each of four rounds, at most.",
)
@units_option
@json_option
def improve(grid_name: str, output: Path, json: Path | None, **options: Any) -> None:
    """Raise the worst cells of a grid by moving interior control points; the surface stays.

    GRID is a {read} file, a fitted model MODEL.h5, or a built-in grid: {built_in}. The name of the output gives the
    format: {written}.
    The worst Q of no block falls and no cell is inverted; where that leaves nothing to gain, nothing is written.
    """
    with without_collector():
        from .improve import ImproveOptions
        from .improve import improve as improve_file

    improve_file(grid_name, output, json, ImproveOptions(**options))


@command("quality wing_moved.xyz --baseline wing.h5")
@grid_argument
@click.option(
    "--baseline",
    metavar="GRID",
    help="Grid or model before the move: compare the heights of the first cells at walls with it, and name cells that "
    "are inverted now and were not.",
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

    GRID is a {read} file, a fitted model MODEL.h5, or a built-in grid: {built_in}. Of a CGNS file of curved
    hexahedra, as refine --degree writes it, Jacobians are measured; of a mesh without structure, {meshes}, volumes,
    inverted cells, and the non-orthogonality and skewness of its faces as OpenFOAM's checkMesh has them.

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
    help="Largest distance (m) from walls with curved knots, which are refitted; 1e-6 of the size of the walls by "
    "default.",
)
@click.option(
    "--units",
    type=click.Choice(("m", "mm", "in", "ft")),
    default="m",
    show_default=True,
    help="Unit of length of the file.",
)
@click.option("--patch", multiple=True, metavar="PATCH", help="Patch to write, more than once; all walls by default.")
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
    help="As for move, more than once: measure after it, at seams that are smooth before.",
)
@click.option("--patch", multiple=True, metavar="PATCH", help="Patch to look at, more than once; all walls by default.")
@click.option(
    "--max-kink",
    type=click.FloatRange(min=0.0, max=180.0),
    default=5.0,
    show_default=True,
    metavar="DEG",
    help="Largest kink at which a seam counts as smooth rather than as an edge.",
)
@click.option("--mirror", is_flag=True, help="Also where walls meet planes of symmetry, and their mirror images there.")
@json_option
def seams(**options: Any) -> None:
    """Measure how smooth the walls of a model are across the seams between its blocks, and at poles.

    Kinks are angles between the tangent planes of both sides, curvatures those across the seam; at 21 places of each.
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
    help="The model that was optimised, for a case file that does not name it, or whose model was moved.",
)
@click.option("--title", metavar="TEXT", help="Heading of the page; the name of the source by default.")
@click.option(
    "--triangles",
    type=click.IntRange(min=100),
    default=40_000,
    show_default=True,
    metavar="N",
    help="Triangles of the walls that are drawn of each shape, about.",
)
@json_option
def report(**options: Any) -> None:
    """Write a report on a model or on a recorded optimisation: one HTML file that needs no network.

    It shows the grid and its control mesh in space, or a mesh without structure and its lattice, quality, wall heights
    and sections; of a case file of OpenMDAO's SqliteRecorder also histories, first-order optimality, variables with
    their bounds and the N2 diagram.
    """
    with without_collector():
        from .report import report_on

    report_on(**options)


@command("completion bash >> ~/.bashrc", "completion fish > ~/.config/fish/completions/bspline-mdao.fish")
@click.argument("shell", type=click.Choice(SHELLS))
def completion(shell: str) -> None:
    """Print what lets a shell complete commands, options and files at the tab key.

    It goes into a file that SHELL reads when it starts: ~/.bashrc, ~/.zshrc or the completions of fish.
    """
    found = shell_completion.get_completion_class(shell)
    assert found is not None  # SHELLS are those that there are
    click.echo(found(bspline_mdao, {}, PROGRAM, f"_{PROGRAM.replace('-', '_').upper()}_COMPLETE").source())


@command("warm-up", "warm-up --processes 2")
@click.option(
    "--processes", type=click.IntRange(min=1), metavar="P", help="Processes that compile; by default one for each core."
)
@json_option
def warm_up(**options: Any) -> None:
    """Compile the kernels of usual commands, once, so that none of these has to wait for it.

    Runs fit, move, quality, airfoil, refine and optimize on tiny grids, in processes that share what they compile. Does
    nothing where all kernels are there.
    """
    with without_collector():
        from .warm_up import warm_up as compile_all

    compile_all(**options)
