"""The command line of a script whose ``main`` states a problem: arguments in, numbers out.

A function with a numpydoc docstring says all that a command line needs to know, so a script ends with two lines::

    if __name__ == "__main__":
        run(main)
"""

from __future__ import annotations

import argparse
import inspect
import json
import os
import re
import sys
import typing
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..base.numerics.processes import world
from ..errors import InputError

__all__ = ["pick_size", "run", "write_numbers"]


def run(main: Callable[..., dict], arguments: list[str] | None = None) -> dict:
    """Run a script from the command line, print the numbers it returns, and with ``--json`` write them to a file.

    Every parameter of ``main`` that has a default is an option: a flag, a number, a text, one of several texts
    (``Literal``) or, if the default is a tuple, any number of them. Underscores become dashes, and the help is taken
    from the docstrings. Parameters whose default is a mapping are not options. Every script knows ``--paper``,
    ``--figures`` and ``--json``; the first two have no effect on a ``main`` that does not take them. If there are
    several processes, all run the script, and the first one prints and writes.

    Parameters
    ----------
    main : callable
        ``main(paper=..., figures=..., **options)``, which returns the numbers.
    arguments : list of str, optional
        The arguments after the name of the script; by default the arguments of the process.

    Returns
    -------
    dict
        The numbers.

    Raises
    ------
    SystemExit
        With status 2 after one line on standard error, if ``main`` raises `bspline_mdao.InputError`.

    Examples
    --------
    >>> from bspline_mdao.scripts import run
    >>> def main(n: int = 3, quick: bool = False):
    ...     return {"n": n, "quick": quick}
    >>> _ = run(main, ["--n", "5", "--quick"])
    {
      "n": 5,
      "quick": true
    }
    """
    parser = argparse.ArgumentParser(
        description=inspect.cleandoc(sys.modules[main.__module__].__doc__ or ""),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    helps, hints = _helps(main), typing.get_type_hints(main)
    options = {name: p.default for name, p in inspect.signature(main).parameters.items()}
    for name, default in {"paper": False, "figures": None, **options}.items():
        if not isinstance(default, Mapping):
            help_text = helps.get(name, "no effect").replace("%", "%%")
            parser.add_argument(f"--{name.replace('_', '-')}", help=help_text, **_keywords(default, hints.get(name)))
    values = vars(parser.parse_args(arguments))
    file = values.pop("json")
    with (
        warnings.catch_warnings()
    ):  # OpenMDAO counts variables and responses, but scripts count linear solves of a flow
        warnings.filterwarnings("ignore", "Inefficient choice of derivative mode")
        try:
            numbers = main(**{name: value for name, value in values.items() if name in options})
        except InputError as error:
            parser.exit(2, f"{parser.prog}: {error}\n")
    if world().rank == 0:
        print(json.dumps(numbers, indent=2, default=_plain))
        if file:
            write_numbers(file, numbers)
    return numbers


def pick_size(sizes: Mapping, paper: bool = False, quick: bool = False) -> Any:
    """Pick one of the sizes of a problem.

    Parameters
    ----------
    sizes : mapping
        The entries for ``"default"``, ``"paper"`` and, if there is such a variant, ``"quick"``.
    paper, quick : bool
        Which of them to pick instead of the default.

    Returns
    -------
    object
        The entry.

    Raises
    ------
    InputError
        If both are given, or there is no such size.

    Examples
    --------
    >>> pick_size({"quick": 5, "default": 10, "paper": 20}, paper=True)
    20
    """
    name = "paper" if paper else "quick" if quick else "default"
    if (paper and quick) or name not in sizes:
        raise InputError(f"choose one of the sizes {', '.join(sizes)}")
    return sizes[name]


def write_numbers(
    path: str | os.PathLike,  # file to write
    numbers: dict,  # numbers, text, arrays, and lists and dicts of them
) -> None:
    """Write the numbers of a run script as JSON."""
    Path(path).write_text(json.dumps(numbers, indent=2, default=_plain) + "\n")


def _keywords(default: Any, hint: Any) -> dict:
    """Keywords of ``add_argument`` for a parameter with a default and a type hint."""
    if isinstance(default, bool):
        return {"action": "store_true"}
    kinds = [hint, *typing.get_args(hint)]
    choices = next((typing.get_args(kind) for kind in kinds if typing.get_origin(kind) is typing.Literal), None)
    kind = next((kind for kind in (int, float) if kind in kinds), str)
    return {"default": default, "type": kind, "choices": choices} | ({"nargs": "+"} if type(default) is tuple else {})


def _helps(main: Callable) -> dict[str, str]:
    """Texts of the parameters of a function, by name, from its numpydoc docstring."""
    section = re.search(r"^Parameters\n-+\n(.*?)(?=^\w+\n---|\Z)", inspect.getdoc(main) or "", re.S | re.M)
    entries = re.findall(r"^(\w[\w, ]*?) *:.*\n((?:(?: .*)?\n?)*)", section[1] if section else "", re.M)
    return {name: " ".join(text.split()) for names, text in entries for name in names.split(", ")}


def _plain(value: Any) -> Any:
    """Convert what JSON does not know into what it does."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)
