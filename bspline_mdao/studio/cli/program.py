"""The program: its group of commands, the declaration of commands, and shared options.

Names in help texts come from the tables of what is available.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable
from functools import wraps
from inspect import cleandoc
from pathlib import Path
from typing import Any

import click

from ... import __version__
from ...core.generators.built_in import BUILT_IN
from ...grids.io.formats import curved_names, read_names, written_names
from ...grids.io.meshes.files import mesh_names
from .streams import STDOUT, streams
from .words import DEFINITIONS, PROGRAM, TRACEBACK

__all__ = [
    "NAMES",
    "POSITIVE",
    "bspline_mdao",
    "command",
    "example",
    "grid_argument",
    "json_option",
    "kept_output",
    "output_option",
    "patches_option",
]

POSITIVE = click.FloatRange(min=0.0, min_open=True)
"""Type of options with positive numbers."""

CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


_OVERWRITE = f"{__name__}.overwrite"
"""Key of the option in the context of a command."""

NAMES = {
    "read": read_names(),
    "written": written_names(),
    "curved": curved_names(),
    "built_in": f"{' or '.join(f'@{name}' for name in BUILT_IN)}, at another size as @{next(iter(BUILT_IN))}:45x65x33",
    "definitions": DEFINITIONS,
    "meshes": mesh_names(),
}
"""Texts for braces in the docstrings of commands."""


SECTIONS = {
    "Begin": ("init", "inspect", "airfoil", "wing", "extrude"),
    "Fit and move": ("fit", "move", "ride", "refine", "improve"),
    "Optimize": ("optimize", "sample"),
    "Look at results": ("quality", "live", "seams", "report", "cad"),
    "This program": ("warm-up", "completion"),
}
"""Commands in the order of the program's help."""


def example(*lines: str) -> str:
    """Return the text that ends a help page: lines of commands, without the name of the program."""
    return "\b\nExample:\n" + "\n".join(f"  {PROGRAM} {line}" for line in lines)


def command(*examples: str) -> Callable[[Callable], click.Command]:
    """Return a decorator that makes a command of a function: its docstring is the help, with `NAMES` inserted."""

    def declare(function: Callable) -> click.Command:
        text = cleandoc(function.__doc__ or "").format(**NAMES)
        made = bspline_mdao.command(help=text, epilog=example(*examples))(_run(function))
        made.params += [
            click.Option(["-q", "--quiet"], is_flag=True, help="Print only warnings and errors."),
            click.Option(
                ["-v", "--verbose"], is_flag=True, envvar=TRACEBACK, help="Print where in the code an error was raised."
            ),
        ]
        return made

    return declare


def _run(function: Callable) -> Callable:
    """Return a function that runs a command with the options that all commands have."""

    @wraps(function)
    @click.pass_context
    def run(context: click.Context, quiet: bool, verbose: bool, **options: Any) -> None:
        with streams(context, quiet=quiet, has_numbers=options.get("json") == STDOUT):
            try:
                function(**options)
            except Exception:
                if verbose:
                    traceback.print_exc()
                raise

    return run


def output_option(
    metavar: str,
    what: str,  # its content, for the help
) -> Callable[[Callable], Callable]:
    """Return a decorator that declares the output file of a command: an existing one is replaced only on request."""

    def declare(function: Callable) -> Callable:
        overwrite = click.option(
            "--overwrite",
            is_flag=True,
            expose_value=False,
            callback=_note_overwrite,
            help=f"Replace {metavar} if it exists.",
        )
        output = click.option(
            "-o", "--output", type=click.Path(path_type=Path), metavar=metavar, required=True, help=what
        )
        return output(overwrite(function))

    return declare


def kept_output() -> Path | None:
    """The output of the current command, unless an existing one is to be replaced."""
    context = click.get_current_context(silent=True)
    return None if context is None or context.meta.get(_OVERWRITE, True) else context.params["output"]


def _note_overwrite(context: click.Context, option: click.Parameter, overwrite: bool) -> None:
    context.meta[_OVERWRITE] = overwrite


grid_argument = click.argument("grid_name", metavar="GRID")
patches_option = click.option(
    "--patches", type=click.Path(path_type=Path), metavar="FILE", help="Patches of the grid: a TOML or NMF file."
)
json_option = click.option(
    "--json",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write the numbers to FILE, or for - to standard output, with everything else on standard error.",
)


COMMON = ("--json", "--quiet", "--verbose", "--help")
"""Options of many commands; the help lists them last."""


class _Colours(click.HelpFormatter):
    """Help with headings in bold type and names in colour, which click leaves out if no terminal shows them."""

    def write_usage(self, prog: str, args: str = "", prefix: str | None = None) -> None:
        """Write the usage line."""
        super().write_usage(prog, args, click.style(prefix or "Usage: ", bold=True))

    def write_heading(self, heading: str) -> None:
        """Write the title of a section."""
        super().write_heading(click.style(heading, bold=True))

    def write_dl(self, rows: Iterable[tuple[str, str]], col_max: int = 30, col_spacing: int = 2) -> None:
        """Write a list of names and what they mean."""
        super().write_dl([(click.style(name, fg="cyan"), text) for name, text in rows], col_max, col_spacing)


class _Context(click.Context):
    formatter_class = _Colours


class _Command(click.Command):
    """A command whose help lists shared options after its own."""

    context_class = _Context

    def format_options(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options in two sections."""
        sections: dict[str, list[tuple[str, str]]] = {"Options": [], "Common options": []}
        for option in self.get_params(context):
            record = option.get_help_record(context) if isinstance(option, click.Option) else None
            if record is not None:
                sections["Common options" if set(COMMON) & set(option.opts) else "Options"].append(record)
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


class _Group(click.Group):
    """Commands in sections."""

    command_class = _Command
    context_class = _Context

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the names of commands and what they do."""
        width = max(map(len, self.commands))
        for title, names in SECTIONS.items():
            with formatter.section(title):
                room = formatter.width - formatter.current_indent - width - 2
                formatter.write_dl(
                    [(f"{name:{width}s}", self.commands[name].get_short_help_str(room)) for name in names]
                )


@click.group(
    cls=_Group,
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
