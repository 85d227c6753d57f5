"""The commands and their options.

Commands that make grids are in `making_commands`, commands of studies in `study_commands`, commands for results in
`result_commands`.

To add a command, write its function here and its file next to this one. A command imports what it needs when it runs,
and takes its options by name, so ``--help`` is fast and nothing is named twice.
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
from .result_commands import cad, live, quality, report, seams
from .study_commands import init, optimize, sample
from .units import units_option
from .words import PROGRAM

__all__ = [
    "airfoil",
    "bspline_mdao",
    "cad",
    "extrude",
    "init",
    "live",
    "optimize",
    "quality",
    "report",
    "sample",
    "seams",
    "wing",
]

SHELLS = ("bash", "zsh", "fish")
"""Shells with completion of commands."""

DEFORM = (
    "Deformation of the design surface, such as twist=10deg, bend=120deg@0.7, stretch=2, chord, thickness, sweep, "
    "dihedral, pitch, rotate=20deg@chord 0.7,blend=0.05, radius=1.1@axis(0,0,0 -> 1,0,0), axial, "
    "translate=0.1/0/0, bumps=0.01,seed=1, ffd=box.xyz,to=moved.xyz, cad=wing.step,to=moved.step; or a file of its new "
    "control points (.csv, .npy). May be repeated; deformations are applied in order: give chord and thickness first, "
    "since their axes do not turn."
)
"""Help of the option for deformations."""


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
    """Show blocks, interfaces, boundary faces, first cells at walls and faults of a grid.

    GRID is a {read} file, a model MODEL.h5 (with the errors of its fit), or a built-in grid: {built_in}. For an
    unstructured mesh, {meshes}, it shows cells and markers, what the markers seem to be, and what has to be declared.
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
    help="Order of the B-splines, their degree plus one; by default 4, or 3 in short directions.",
)
@click.option(
    "--correct",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="N",
    help="Cycles of parameter correction, for a closer fit in more time.",
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
@click.option("--no-residual", is_flag=True, help="Do not keep the residual, the difference between grid and splines.")
@click.option("--no-wall-layer", is_flag=True, help="Do not let nodes near walls follow them as a rigid body.")
@click.option("--no-certify", is_flag=True, help="Do not prove, element by element, that the splines are valid.")
@click.option(
    "--lattice/--no-lattice",
    default=None,
    help="Move all blocks with one lattice of B-splines around the grid, like an unstructured mesh, or fit each block. "
    "By default a lattice is used for overlapping component grids only.",
)
@click.option(
    "--spacing",
    type=POSITIVE,
    metavar="H",
    help="Lattice: width of its spans around all walls; by default chosen for each body, and smaller in gaps.",
)
@click.option(
    "--spans",
    type=click.FloatRange(min=1.0),
    metavar="N",
    help="Lattice: spans along the longest side of each body; 10 by default.",
)
@click.option(
    "--for",
    "moves",
    multiple=True,
    metavar="DEFORM",
    help="Unstructured mesh: refine the lattice for a later move, given as --deform of 'move', such as bounds of "
    "design variables. May be repeated.",
)
@units_option
@json_option
def fit(**options: Any) -> None:
    """Fit a grid with B-spline volumes, or put a lattice around an unstructured mesh, and write the model.

    GRID is a {read} file, or a built-in grid: {built_in}. An unstructured mesh is {meshes}; its walls are guessed from
    names and places of its markers, or declared by --patches.
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
    help="Factor on the cells per direction; below 1 for a coarser member.",
)
@output_option("GRID", "Grid to write.")
@click.option(
    "--degree",
    type=click.IntRange(1, 4),
    metavar="D",
    help="Write curved hexahedra of degree 1 to 4, for high-order solvers; F then counts elements.",
)
@click.option("--allow-invalid", is_flag=True, help="Write curved hexahedra even if some of them are inverted.")
@json_option
def refine(**options: Any) -> None:
    """Write a finer or coarser member of the grid family of a model, or curved elements of high order.

    The name of GRID sets the format: {written}. Curved hexahedra are written as {curved}. Missing folders are made.
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
    """Deform the design surface of a model, move the control mesh with it and write the grid.

    The name of GRID sets the format: {written}. Missing folders are made. An unstructured mesh keeps its format and all
    of its file but the nodes.

    PATCH is a name or a pattern, such as 'wing*'; --deform, --design, --slide, --fix and --release may be repeated.

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
    help="Use known control points instead of a deformation: the best case of a case file (.sql), or all control "
    "points as .csv or .npy.",
)
@output_option("MESH", "Mesh to write.")
@click.option(
    "--wall",
    multiple=True,
    metavar="MARKER",
    help="Marker of the mesh that is a wall; by default the markers on walls of the fitted grid.",
)
@click.option(
    "--tolerance",
    type=click.FloatRange(min=0.0),
    metavar="D",
    help="Distance by which nodes may be outside the fitted grid; by default the size of its boundary faces there.",
)
@click.option(
    "--hold-outside", is_flag=True, help="Fix nodes that are farther outside, if the grid's boundary is fixed there."
)
@moving_options
@click.option("--allow-invalid", is_flag=True, help="Write the mesh even if cells of it are inverted.")
@json_option
def ride(model: Path, mesh: Path, output: Path, json: Path | None, **options: Any) -> None:
    """Move an unstructured mesh with the control mesh of a model.

    MESH is {meshes}. The output has the same format, and only its nodes differ. Walls go where the deformation puts
    them, and nodes near them follow as a rigid body. A two-dimensional mesh (.su2, .cgns, .msh, .vtu) moves with a
    section: a model of a grid between two planes of symmetry.
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
    help="How far control points may move, as a fraction of the distance to their nearest neighbours.",
)
@click.option(
    "--height-tolerance",
    type=click.FloatRange(0.0, 1.0, min_open=True, max_open=True),
    default=0.01,
    show_default=True,
    metavar="T",
    help="Relative change allowed for the heights of first cells at walls.",
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
    help="Largest number of iterations in each of four rounds.",
)
@units_option
@json_option
def improve(grid_name: str, output: Path, json: Path | None, **options: Any) -> None:
    """Improve the worst cells of a grid by moving interior control points; the surface stays.

    GRID is a {read} file, a fitted model MODEL.h5, or a built-in grid: {built_in}. The name of the output sets the
    format: {written}.
    The worst Q does not fall in any block and no cell is inverted. If nothing can be gained, nothing is written.
    """
    with without_collector():
        from .improve import ImproveOptions
        from .improve import improve as improve_file

    improve_file(grid_name, output, json, ImproveOptions(**options))


@command("completion bash >> ~/.bashrc", "completion fish > ~/.config/fish/completions/bspline-mdao.fish")
@click.argument("shell", type=click.Choice(SHELLS))
def completion(shell: str) -> None:
    """Print the code that completes commands, options and files at the tab key.

    Append it to a file that SHELL reads when it starts: ~/.bashrc, ~/.zshrc or the completions of fish.
    """
    found = shell_completion.get_completion_class(shell)
    assert found is not None  # SHELLS are the available ones
    click.echo(found(bspline_mdao, {}, PROGRAM, f"_{PROGRAM.replace('-', '_').upper()}_COMPLETE").source())


@command("warm-up", "warm-up --processes 2")
@click.option(
    "--processes", type=click.IntRange(min=1), metavar="P", help="Processes that compile; by default one for each core."
)
@json_option
def warm_up(**options: Any) -> None:
    """Compile the kernels of the usual commands once, so that none of them has to wait.

    Runs the commands on tiny grids and an unstructured mesh, in processes that share their kernels. Does nothing if all
    kernels are there.
    """
    with without_collector():
        from .warm_up import warm_up as compile_all

    compile_all(**options)
