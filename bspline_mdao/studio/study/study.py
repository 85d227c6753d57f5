"""A study, as `reader` makes it from its file: its settings, and its input and output files."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ...base.extras import INSTALL
from ...errors import InputError
from .grid_kinds import GridKind, kind_of
from .tables import Table
from .variable_kinds import VARIABLES

__all__ = ["CAD_KINDS", "CASES", "PICTURE", "Study", "count_values"]

CAD_KINDS = frozenset({"cad_points", "cad_shapes"})
"""Kinds of variables that move faces of CAD files."""

_STATES = "before", "after"

CASES, PICTURE = "cases.sql", "section.png"
"""Files of the recorded cases and of the picture of a section among the results."""


@dataclass(frozen=True, eq=False)
class Study:
    """The settings of a study file."""

    source: Path  # the file
    # grid, objective, movement, driver, output: tables of these names
    grid: Table
    # variables, measures, constraints: tables by name, in the order of the file. Measures are all that are used, also
    # those without a table. Constraints of one condition are named as in ``cruise.CL``.
    variables: dict[str, Table]
    measures: dict[str, Table]
    flow: Table | None  # the flow, if there is one
    # flight conditions by name, see `resolved_conditions`; empty if the flow itself is the only condition
    conditions: dict[str, Table]
    objective: Table
    constraints: dict[str, Table]
    junction: Table | None  # junction of a wing that slides on a body, if any
    movement: Table
    driver: Table
    output: Table

    @cached_property
    def kind(self) -> GridKind:
        """Kind of the grid."""
        return kind_of(self.grid["file"], self.source.parent)

    @property
    def inputs(self) -> dict[tuple[Any, ...], Path]:
        """Its input files, by the paths of their keys."""
        names: dict[tuple[Any, ...], Any] = {("grid", key): self.grid[key] for key in ("file", "patches")}
        names |= {("variables", name, "file"): table.get("file") for name, table in self.variables.items()}
        for variable, table in self.variables.items():
            names |= {("variables", variable, "to", number): name for number, name in enumerate(table.get("to") or ())}
        return {path: self.source.parent / name for path, name in names.items() if name and not name.startswith("@")}

    @property
    def results(self) -> list[str]:
        """Files that its script may write, including page and picture unless they are left out."""
        page = ["report.html"] if self.output["report"] is not False else []
        picture = [PICTURE] if self.has_pressures and self.output["picture"] is not False else []
        written = [*map(self.written, _STATES), *self.cad_results.values()]
        return ["model.h5", *written, CASES, "summary.csv", *page, *picture]

    @property
    def has_pressures(self) -> bool:
        """Whether the flow has pressures on the walls, which are drawn if these are a section."""
        return self.flow is not None and self.flow["kind"] == "euler"

    def require_solver(self) -> None:
        """Refuse a flow whose package is not installed, before anything is fitted."""
        if self.flow is not None and self.flow["kind"] == "lattice" and not find_spec("openaerostruct"):
            raise InputError(
                f"{self.source}: the flow, the vortex lattice, needs OpenAeroStruct: {INSTALL.format(extra='vlm')}"
            )

    @property
    def cad_results(self) -> dict[str, str]:
        """CAD files written with the optimum, by the files to which walls are tied.

        Empty if other variables move the walls as well, or interpolate to files, whose knots may differ.
        """
        moving = [table for table in self.variables.values() if VARIABLES[table["kind"]].made_by]
        if any(table["kind"] != "cad_points" for table in moving):
            return {}
        files = dict.fromkeys(table["file"] for table in moving)
        return {file: f"{Path(file).stem}_after{Path(file).suffix}" for file in files}

    @property
    def folders(self) -> list[str]:
        """Folders into which its script writes files."""
        return [name.removesuffix(".vtm") for name in map(self.written, _STATES) if name.endswith(".vtm")]

    def written(self, when: str) -> str:
        """Name of the grid that is written ``"before"`` or ``"after"``."""
        return self.kind.written(when, self.source.parent / self.grid["file"], self.output)

    @property
    def evened(self) -> list[str]:
        """Variables that the driver sees as combinations along which pressures change evenly."""
        names = self.driver["even_pressures"] or []
        return [names] if isinstance(names, str) else names

    @property
    def n_values(self) -> float:
        """Number of the values of all variables; infinite if only the grid determines it."""
        return sum(count_values(table) for table in self.variables.values())

    @property
    def responses(self) -> list[str]:
        """Responses of objective and constraints, each once."""
        asked = [self.objective["of"], *(table["of"] for table in self.constraints.values())]
        return list(dict.fromkeys(asked))


def count_values(table: Table, n_alpha: int = 1) -> float:
    """Number of the values of a variable; infinite if only the grid determines it."""
    n_axes = len(table.get("direction") or "")
    known = {"taper": 1, "rotation": 1, "alpha": n_alpha, "translation": n_axes, "hinge": 2 * n_axes}
    if table["kind"] == "cad_shapes":
        return len(table["to"])
    if table["kind"] in known:
        return known[table["kind"]]
    stations = table.get("values") or table.get("stations", math.inf)
    n = len(stations) if isinstance(stations, list) else stations
    modes = VARIABLES[table["kind"]].modes
    return n if modes is None else n * modes(table)
