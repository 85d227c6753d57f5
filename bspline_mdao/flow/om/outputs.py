"""Outputs of flows as components declare and document them, from the table of functionals."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

import openmdao.api as om

from ..functionals import FUNCTIONALS, FlowKind, of_flow

__all__ = ["declaration", "declare_outputs", "documents_outputs", "units_of"]

Kind = TypeVar("Kind", bound=type)

EXTENTS = {"number": "(1,)", "axes": "(3,)", "strips": "(n_strips)", "faces": "(n_wall)", "panels": "(panels)"}
"""Shapes as the documentation writes them."""


Shapes = Mapping[str, int | tuple[int, ...]]
"""Dimensions of strips, faces or panels."""


def declare_outputs(component: om.Component, flow: FlowKind, shapes: Shapes) -> None:
    """Add the functionals of a flow as outputs."""
    for name in of_flow(flow):
        component.add_output(name, **declaration(name, shapes))


def declaration(name: str, shapes: Shapes) -> dict[str, Any]:
    """Shape, units and description of the output for a functional."""
    functional = FUNCTIONALS[name]
    shape = {"number": 1, "axes": 3, **shapes}[functional.extent]
    return {"shape": shape, "units": functional.units, "desc": functional.meaning}


def units_of(names: Iterable[str]) -> dict[str, str | None]:
    """Units of functionals, by name."""
    return {name: FUNCTIONALS[name].units for name in names}


def documents_outputs(flow: FlowKind) -> Callable[[Kind], Kind]:
    """Decorate a component: the flow's functionals replace the line ``{outputs}`` of the table in its docstring."""

    def documented(kind: Kind) -> Kind:
        if kind.__doc__:  # there is none if Python drops docstrings
            rule = next(line for line in kind.__doc__.splitlines() if line.strip().startswith("===="))
            rows = "\n".join(_rows(flow, rule))
            kind.__doc__ = re.sub(r"^ *\{outputs\}$", lambda _: rows, kind.__doc__, flags=re.M)
        return kind

    return documented


def _rows(flow: FlowKind, rule: str) -> list[str]:
    """Rows of a table in reStructuredText, with columns as in the rule above it."""
    spans = [match.span() for match in re.finditer("=+", rule)]
    rows = []
    for name, functional in of_flow(flow).items():
        meaning = textwrap.wrap(functional.meaning, spans[-1][1] - spans[-1][0])
        cells = [f"``{name}``", "output", EXTENTS[functional.extent], functional.units or "", meaning[0]]
        line = ""
        for (start, _), cell in zip(spans, cells):
            line = f"{line:{start}}{cell}"
        rows += [line, *(" " * spans[-1][0] + rest for rest in meaning[1:])]
    return rows
