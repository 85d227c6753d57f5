"""The program: its group of commands, how one is declared, and options that several have.

Names that help shows come from the tables of what there is.
"""

from __future__ import annotations

from collections.abc import Callable
from inspect import cleandoc
from pathlib import Path

import click

from ... import __version__
from ...core.generators.built_in import BUILT_IN
from ...grids.io.formats import curved_names, read_names, written_names
from ...grids.io.meshes.files import mesh_names
from .words import DEFINITIONS, PROGRAM

__all__ = ["NAMES", "POSITIVE", "bspline_mdao", "command", "example", "grid_argument", "json_option", "patches_option"]

POSITIVE = click.FloatRange(min=0.0, min_open=True)
"""Type of options that are positive numbers."""

CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


NAMES = {
    "read": read_names(),
    "written": written_names(),
    "curved": curved_names(),
    "built_in": f"{' or '.join(f'@{name}' for name in BUILT_IN)}, at another size as @{next(iter(BUILT_IN))}:45x65x33",
    "definitions": DEFINITIONS,
    "meshes": mesh_names(),
}
"""What stands in braces in the texts of commands."""


def example(*lines: str) -> str:
    """Return the text that ends a help page: lines of commands, without the name of the program."""
    return "\b\nExample:\n" + "\n".join(f"  {PROGRAM} {line}" for line in lines)


def command(*examples: str) -> Callable[[Callable], click.Command]:
    """Return what makes a command of a function: its docstring is the help, with `NAMES` put in."""

    def declare(function: Callable) -> click.Command:
        return bspline_mdao.command(help=cleandoc(function.__doc__ or "").format(**NAMES), epilog=example(*examples))(
            function
        )

    return declare


grid_argument = click.argument("grid_name", metavar="GRID")
patches_option = click.option(
    "--patches", type=click.Path(path_type=Path), metavar="FILE", help="Patches of the grid: a TOML or NMF file."
)
json_option = click.option("--json", type=click.Path(path_type=Path), metavar="FILE", help="Write the numbers to FILE.")


@click.group(
    context_settings=CONTEXT,
    invoke_without_command=True,
    epilog=example(
        "inspect wing.xyz --draft wing.toml",
        "fit wing.xyz --patches wing.toml -o wing.h5",
        "refine wing.h5 --factor 2 -o fine.xyz",
        "move wing.h5 --deform twist=10deg -o moved.xyz",
        "quality moved.xyz",
    ),
)
@click.version_option(__version__, prog_name=PROGRAM)
@click.pass_context
def bspline_mdao(context: click.Context) -> None:
    """Fit multi-block structured grids with B-spline volumes and regenerate them from their control points."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())
