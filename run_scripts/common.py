"""What every run script shares: its arguments, its numbers and the look of its figures."""

from __future__ import annotations

import argparse
import contextlib
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

BLUE, ORANGE, GREEN, RED, PURPLE, GRAY = "#0072b2", "#d55e00", "#009e73", "#cc3311", "#7b4f9d", "#666666"
"""Colours that the colour-blind tell apart as well."""

_STYLE = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 10,
    "axes.labelsize": 11,
    "axes.linewidth": 0.8,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "savefig.dpi": 200,
}


def parse_arguments(description: str, **options: dict) -> argparse.Namespace:
    """Read the arguments of a run script from the command line.

    Parameters
    ----------
    description : str
        What the script does.
    **options
        Further options by name, each with the keywords of ``argparse``'s ``add_argument``.

    Returns
    -------
    argparse.Namespace
        ``paper`` (bool: the paper's size), ``json`` (file or None), ``figures`` (folder or None) and the options.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--paper", action="store_true", help="run at the paper's size")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    parser.add_argument("--figures", type=Path, metavar="DIR", help="write the figures to DIR")
    for name, keywords in options.items():
        parser.add_argument(f"--{name.replace('_', '-')}", **keywords)
    return parser.parse_args()


def write_numbers(path: Path, numbers: dict) -> None:
    """Write the numbers of a run script as JSON.

    Parameters
    ----------
    path : path-like
        File to write.
    numbers : dict
        Numbers, text, arrays, and lists and dicts of them.
    """
    Path(path).write_text(json.dumps(numbers, indent=2, default=_plain) + "\n")


def run(main: Callable[..., dict], description: str, **options: dict) -> None:
    """Run a script from the command line: arguments in, numbers out.

    Parameters
    ----------
    main : callable
        ``main(paper=..., figures=..., **options)`` returns the numbers; it writes figures only if ``figures`` is a
        folder.
    description : str
        What the script does.
    **options
        Further options of the script, as for `parse_arguments`.
    """
    arguments = vars(parse_arguments(description, **options))
    file = arguments.pop("json")
    numbers = main(**arguments)
    print(json.dumps(numbers, indent=2, default=_plain))
    if file:
        write_numbers(file, numbers)


@contextlib.contextmanager
def figure(folder: Path, name: str, size: tuple[float, float]):
    """Yield an empty figure in the common style, and save it as a PNG file.

    Parameters
    ----------
    folder : path-like
        Folder to write to, made if need be.
    name : str
        File name without extension.
    size : tuple of float
        Width and height in inches.
    """
    import matplotlib
    from matplotlib.figure import Figure  # without pyplot: needs no display and keeps no state

    with matplotlib.rc_context(_STYLE):
        canvas = Figure(figsize=size, layout="constrained")
        yield canvas
        Path(folder).mkdir(parents=True, exist_ok=True)
        canvas.savefig(Path(folder) / f"{name}.png")


def _plain(value):
    """Turn what JSON does not know into what it does."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)
