"""Output of the commands: JSON, tables, the first cells at walls, and progress."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...base.numerics.processes import ONE, on_first, together
from ...base.text import counted
from ...errors import InputError
from ...grids.cells.certificate import Certificate
from ...grids.cells.first_cells import WallNode
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.cells.wall_heights import KEPT, PatchHeights
from ...grids.cells.wall_spacing import WallSpacing, flat_plate_y_plus
from ...grids.io.disk import replaced_file
from ...grids.io.formats import format_of_name
from .program import kept_output
from .streams import STDOUT, numbers_stream


def check_outputs(
    outputs: Sequence[Path | None],  # files to write
    inputs: Sequence[Path | str | None] = (),  # files that are read
    comm: Any = ONE,  # the processes
) -> None:
    """Refuse files that cannot be written, before any work is done; the first of several processes checks."""
    on_first(comm, lambda: _check_outputs(outputs, inputs))


def _check_outputs(outputs: Sequence[Path | None], inputs: Sequence[Path | str | None]) -> None:
    taken = {os.path.realpath(path): "is read by this command" for path in inputs if path is not None}
    kept = kept_output()
    for path in (path for path in outputs if path not in (None, STDOUT)):
        folder = Path(os.path.realpath(path)).parent
        if path.exists() and not (path.is_file() or _is_folder_of_grid(path)):
            raise InputError(f"{path}: is a {'folder' if path.is_dir() else 'device'}; name a file")
        folder = next(place for place in (folder, *folder.parents) if place.exists())  # missing folders are created
        if not folder.is_dir():
            raise InputError(f"{path}: '{folder}' is no folder; name another one")
        if not os.access(folder, os.W_OK):
            raise InputError(f"{path}: no permission to write to '{folder}'; choose another folder")
        if os.path.realpath(path) in taken:
            raise InputError(f"{path}: {taken[os.path.realpath(path)]}; choose another name or folder")
        if path == kept and path.exists():
            raise InputError(f"{path}: is there already; give --overwrite, or another name")
        taken[os.path.realpath(path)] = "is written twice by this command"


def _is_folder_of_grid(path: Path) -> bool:
    """Whether a path is a folder to which a grid is written."""
    form = format_of_name(path)
    return form is not None and bool(form.folder) and path.is_dir()


@contextmanager
def written_json(
    path: Path | None,  # file to create or to replace
    # numbers, truth values, text, and tuples, lists and dicts of them; non-finite numbers become null
    numbers: dict,
    comm: Any = ONE,  # the processes, of which the first one writes
) -> Iterator[None]:
    """Write numbers as JSON next to the named file, if any, and replace it when the block ends well."""
    if path in (None, STDOUT):
        yield
        if path and comm.rank == 0:
            print(_text(numbers), end="", file=numbers_stream())
        return
    with ExitStack() as stack:
        with together(comm):
            if comm.rank == 0:
                part = stack.enter_context(replaced_file(path))
                part.write_text(_text(numbers), encoding="utf-8")
        yield
        with together(comm):
            stack.close()


def _text(numbers: dict) -> str:
    return json.dumps(_plain(numbers), indent=2, allow_nan=False) + "\n"


def _plain(value: object) -> Any:
    """Convert numbers of NumPy to Python, and non-finite ones to None."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, bool) or getattr(value, "dtype", None) == "bool":
        return bool(value)
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value) if math.isfinite(value) else None
    return value


class _Console(Console):
    """A console that leaves a closed pipe to the program."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


def print_title(text: str) -> None:
    """Print the title of a table."""
    _Console().print(Text(text, style="bold"))


def print_lines(lines: Sequence[str], style: str = "") -> None:
    """Print lines of plain text, without markup."""
    for line in lines:
        _Console().print(Text(line, style=style), soft_wrap=True)


def print_warnings(warnings: Sequence[str]) -> None:
    """Print warnings on standard error, one line each."""
    if warnings:
        sys.stdout.flush()  # so warnings follow their subject if both streams go to the same place
    for warning in warnings:
        _Console(stderr=True).print(Text(f"warning: {warning}", style="yellow"), soft_wrap=True)


def print_table(
    columns: Sequence[str],  # headings
    rows: Sequence[Sequence[object]],  # cells: text, whole numbers, numbers
    *,
    most: int = 40,  # rows to print; one line gives the number of the others
) -> None:
    """Print a table: text left-aligned, numbers right-aligned."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for heading, cell in zip(columns, rows[0] if rows else columns):
        is_last = heading == columns[-1]  # the column that may wrap on a narrow terminal
        table.add_column(heading, justify="left" if isinstance(cell, str) else "right", no_wrap=not is_last)
    for row in rows[:most]:
        table.add_row(*(Text(_cell(cell)) for cell in row))
    _Console().print(table)
    if len(rows) > most:
        print_lines([f"... and {len(rows) - most} more"])


def counts_text(counts: Sequence[int]) -> str:
    """Write counts per direction, for example ``13 x 13 x 9``."""
    return " x ".join(map(str, counts))


def _cell(value: object) -> str:
    """Format a cell of a table."""
    if isinstance(value, float):
        return f"{value:.3g}" if 0.01 <= abs(value) < 1000.0 else f"{value:.1e}"
    return f"{value:,}" if isinstance(value, int) else str(value)


MEANING_OF_INVALID = (
    "an element is invalid where one of its corners is folded or flat: where its triple product is not positive. The "
    "splines and the cells of the grid may be valid there, and are what counts; they fold there first when it moves"
)
"""Remark of `fit` and `move` if elements of the control mesh are invalid."""


MEANING_OF_Q = (
    "Q is 1 for a box and near 0 for a skewed cell: small values before are the grid's own, and a move is good where "
    "it keeps them and inverts no cell"
)
"""Remark of `move` on the quality of a grid."""


MEANING_OF_UNDECIDED = (
    "an element is undecided where neither is proved: its smallest Jacobian is next to zero, or it lies at a pole; "
    "'quality' of the grid reports on its cells there"
)
"""Remark of commands if spline elements are undecided."""


HEIGHTS = ("height_min", "height_median", "height_max")
"""Numbers of heights without a baseline."""


def certificate_numbers(certificate: Certificate) -> dict:
    """Collect what is proved about the validity of a grid for JSON: block by block, places numbered from 1."""
    parts = {"cells": certificate.cells, "splines": certificate.splines}
    return {
        "status": certificate.status,
        **{
            name: [
                {
                    "block": block.block,
                    "status": block.status,
                    "n": block.n,
                    "n_invalid": block.n_invalid,
                    "n_undecided": block.n_undecided,
                    "places": block.places,
                }
                for block in blocks
            ]
            for name, blocks in parts.items()
        },
    }


def show_certificate(certificate: Certificate) -> None:
    """Print what is proved about the validity of a grid, and which blocks are not valid."""
    print_lines(certificate.lines() or ["nothing is proved: there are no cells"])
    if any(part.n_undecided for part in certificate.splines):
        print_lines([MEANING_OF_UNDECIDED])


def measure_of_cells(mesh: MixedMesh) -> tuple[str, str]:
    """Name of the size of the cells of a mesh, and its unit: areas in two dimensions."""
    what, power = ("area", 2) if mesh.n_copies == 2 else ("volume", 3)
    return what, f"{mesh.length_unit}^{power}"


def unproved_lines(mesh: MixedMesh) -> list[str]:
    """Say for which cells of a mesh nothing can be proved."""
    n = mesh.n_cells - sum(map(len, mesh.cells.values()))
    return [f"{counted(n, 'polyhedron', 'polyhedra')}, which have no map: nothing is proved of them"] if n else []


def height_numbers(heights: Sequence[PatchHeights], *, is_compared: bool) -> list[dict]:
    """Collect the heights at walls for JSON, with ratios if they are compared with a baseline."""
    return [
        {**vars(patch), "lowest": vars(patch.lowest), "highest": vars(patch.highest)}
        if is_compared
        else {name: getattr(patch, name) for name in ("patch", "n_nodes", "n_left_out", *HEIGHTS)}
        for patch in heights
    ]


def show_heights(heights: Sequence[PatchHeights], unit: str) -> None:
    """Print the heights at walls, if there are any."""
    if heights:
        columns = ["first heights at", "nodes", f"min ({unit})", "median", "max"]
        print_table(columns, [(h.patch, h.n_nodes, *_heights(h)) for h in heights])
    print_lines(
        [f"'{h.patch}': {counted(h.n_left_out, 'node')} without height left out" for h in heights if h.n_left_out]
    )


def show_height_ratios(heights: Sequence[PatchHeights]) -> None:
    """Print the heights at walls relative to the baseline, if there are any."""
    if heights:
        print_lines(["heights of the first cells at walls, relative to the baseline:"])
        columns = ["wall", "min", "1 %", "median", "99 %", "max", "worst at"]
        print_table(columns, [(h.patch, *_ratios(h), _place(h.worst[1])) for h in heights])


def _heights(wall: PatchHeights | WallSpacing) -> list[str]:
    """Write the heights of the first cells at a wall."""
    return [f"{getattr(wall, name):.2e}" for name in HEIGHTS]


def _ratios(h: PatchHeights) -> list[str]:
    """Write the heights at a wall relative to the baseline."""
    return [f"{x:.3f}" for x in (h.ratio_min, h.ratio_p01, h.ratio_median, h.ratio_p99, h.ratio_max)]


def _place(node: WallNode) -> str:
    """Name a node of a wall."""
    return f"({node.i}, {node.j}, {node.k}) of {node.block}"


def height_warnings(heights: Sequence[PatchHeights]) -> list[str]:
    """Say which walls do not keep the heights of their first cells."""
    return [
        f"the first cells at '{h.patch}' are {h.ratio_p01:.3g} to {h.ratio_p99:.3g} times as high as before (1 % to "
        f"99 %), and so is y+; {h.n_off:,} of {h.n_nodes:,} nodes leave {KEPT[0]} to {KEPT[1]}, the worst with "
        f"{h.worst[0]:.3g} at {h.worst[1]}"
        for h in heights
        if not h.is_kept
    ]


def spacing_numbers(spacings: Sequence[WallSpacing], reynolds: float | None) -> list[dict]:
    """Collect the spacings at walls for JSON, with an estimate of y+ if a Reynolds number per length is given."""
    return [{**vars(s), **({"y_plus": y_plus(s, reynolds)} if reynolds else {})} for s in spacings]


def show_spacings(spacings: Sequence[WallSpacing], reynolds: float | None, unit: str) -> None:
    """Print the spacings at walls, if there are any."""
    if not spacings:
        return
    columns = ["first heights at", f"min ({unit})", "median", "max", "growth", "aspect"]
    rows = [(s.patch, *_heights(s), s.growth_median, s.aspect_median) for s in spacings]
    if reynolds:
        columns.append("y+")
        rows = [(*row, y_plus(s, reynolds)) for row, s in zip(rows, spacings)]
    print_table(columns, rows)
    if reynolds:
        print_lines([f"y+ at the median height, of a turbulent plate at {reynolds:.3g} per {unit}, is an estimate"])


def y_plus(spacing: WallSpacing, reynolds: float) -> float:
    """Estimate y+ at the median height of a wall, at a Reynolds number per unit of length."""
    # The plate is as long as the middle side of the wall's box, the chord of most wings: y+ varies with the
    # fourteenth root of the length.
    return flat_plate_y_plus(spacing.height_median, reynolds, spacing.extents[1])
