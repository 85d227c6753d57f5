"""The commands of studies, and their options."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .imports import without_collector
from .program import command, grid_argument, json_option, output_option, patches_option

__all__ = ["init", "optimize", "sample"]

folder_option = click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    required=True,
    help="Folder for the results; it is made.",
)


@command(
    "init wing.xyz --patches wing.toml -o study.toml",
    "init foil.h5 --mach 0.73 --mach 0.75 --lift 0.5 -o study.toml",
    "optimize study.toml -o out",
)
@grid_argument
@output_option("STUDY.toml", "Study to write.")
@patches_option
@click.option(
    "--cad",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="STEP or IGES file of the walls, whose control points become variables.",
)
@click.option(
    "--mach",
    type=click.FloatRange(1e-3, 0.99),
    multiple=True,
    metavar="M",
    help="Airfoil: Mach number, repeatable for the mean of the drags; by default chosen from the thickness.",
)
@click.option(
    "--lift",
    type=click.FloatRange(-5.0, 5.0),
    multiple=True,
    metavar="CL",
    help="Airfoil: lift coefficient, one or as many as Mach numbers; 0.5 by default.",
)
@click.option("--lift-to-drag", is_flag=True, help="Airfoil: maximise the lift-to-drag ratio, at any lift.")
def init(mach: tuple[float, ...], lift: tuple[float, ...], lift_to_drag: bool, **options: Any) -> None:
    """Draft a study of a grid for the command optimize, and show the lines to check.

    GRID is a {read} file, an unstructured mesh, {meshes}, a model MODEL.h5 of either, or a built-in grid: {built_in}.
    """
    with without_collector():
        from ..study.draft import Aim
        from .init import draft_study

    draft_study(**options, aim=Aim(mach, lift, lift_to_drag) if mach or lift or lift_to_drag else None)


@command("optimize study.toml -o out", "optimize study.toml -o out --restart")
@click.argument("study", metavar="STUDY.toml", type=click.Path(path_type=Path))
@folder_option
@click.option(
    "--overwrite", is_flag=True, help="Use a folder that is not empty, and replace the files of the last run."
)
@click.option(
    "--restart", is_flag=True, help="Continue from the best design recorded in FOLDER, also after a killed run."
)
@click.option(
    "--max-iterations", type=click.IntRange(min=1), metavar="N", help="Stop earlier than the study says, for a test."
)
@json_option
def optimize(**options: Any) -> None:
    """Optimize a shape by a study: grid, variables, flow, objective, constraints and driver.

    FOLDER gets the fitted model, the grids before and after, all cases (SQLite), the table of variables and responses,
    and the Python script optimize.py, which gives the same optimum without this command. An unstructured mesh keeps its
    format and all of its file but the nodes.
    """
    with without_collector():
        from .optimize import optimize_study

    optimize_study(**options)


@command(
    "sample study.toml -n 1000 -o designs",
    "sample study.toml --plan designs.csv -o designs --store control_points",
)
@click.argument("study", metavar="STUDY.toml", type=click.Path(path_type=Path))
@click.option("-n", "n", type=click.IntRange(min=1), metavar="N", help="Number of designs; not with a table.")
@click.option(
    "--plan",
    default="sobol",
    show_default=True,
    metavar="PLAN",
    help="sobol or latin-hypercube between the bounds of all variables, or a table (.csv) whose head names values: "
    "twist[0],twist[1],...",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="S",
    help="Seed of the plan: other designs.",
)
@folder_option
@click.option("--flow", "has_flow", is_flag=True, help="Also solve the flow of the study for every design.")
@click.option(
    "--store",
    type=click.Choice(("nodes", "control_points", "nothing")),
    default="nodes",
    show_default=True,
    help="What to store for each grid: its nodes, its control points, or only scalars.",
)
@click.option("--single", is_flag=True, help="Store single precision.")
@click.option("--grids", is_flag=True, help="Also write every grid to a file, in the format of the study.")
@click.option(
    "--processes",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    metavar="P",
    help="Processes that share the designs.",
)
@click.option("--restart", is_flag=True, help="Continue a stopped run with the missing designs.")
@json_option
def sample(**options: Any) -> None:
    """Make the grids of many designs of a study in one file, each checked, or refused with a reason.

    FOLDER gets designs.h5, the model, the script sample.py that is run, and card.md, which says what varies, in which
    ranges, and what was refused. Plans fill the bounds of the study's variables. Its constraints do not count.
    """
    with without_collector():
        from .sample import sample_study

    sample_study(**options)
