"""Tables of the page, with cells ready to be printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.model.fitted_model import FittedModel
from ...core.model.records import FitReport
from ...core.om.drivers.case_history import CaseHistory
from ...flow.euler.error_estimate import ErrorEstimate
from ...flow.functionals import OF_SECTION, numbers
from ...grids.cells.report import QualityReport, WorstCell
from .shape import Shape
from .walls import WallHeights

__all__ = [
    "Table",
    "estimate_table",
    "fit_table",
    "flow_table",
    "height_table",
    "history_table",
    "interface_table",
    "number",
    "quality_table",
    "variable_table",
    "worst_table",
]

MOST_ROWS = 200
"""Largest number of rows of a table; above it, the first ones are shown, with the total number."""

OF_FLOWS = ("Mach_number", "alpha", *numbers("euler"))
"""Scalar inputs and outputs of flows, in the order in which they are shown."""

AT_LIMIT = 1e-6
"""Distance from a limit, relative to the distance of the limits, within which a variable counts as at it."""


@dataclass(frozen=True)
class Table:
    """A table with headings."""

    caption: str  # what it is about
    columns: Sequence[str]  # headings
    rows: Sequence[Sequence[str]]  # cells; the first of each row names it
    note: str = ""  # A line below


def number(value: float, digits: int = 4) -> str:
    """Format a number, or a dash if there is none."""
    if value is None or not np.isfinite(value):
        return "–"
    return f"{value:.{digits}g}"


def quality_table(shapes: Sequence[Shape], reports: Sequence[QualityReport], unit: str) -> Table:
    """Extremes of the cells."""
    rows = [
        ("smallest Q", [number(r.q_min) for r in reports]),
        ("mean Q", [number(r.q_mean) for r in reports]),
        ("smallest corner triple product", [number(r.min_corner) for r in reports]),
        ("smallest corner Jacobian", [number(r.min_jacobian) for r in reports]),
        (f"smallest volume ({unit}³)", [number(r.min_volume) for r in reports]),
        ("inverted cells", [f"{r.n_inverted:,} of {r.n_cells:,}" for r in reports]),
    ]
    note = (
        "Q is the orthogonality of Eq. (9), 1 where all edges are at right angles; "
        "a cell is inverted where a corner is folded or flat."
    )
    return Table("Quality of the cells", ("measure", *(s.label for s in shapes)), [(n, *v) for n, v in rows], note)


def worst_table(shape: Shape, cells: Sequence[WorstCell], unit: str) -> Table:
    """The worst cells, and where they are."""
    rows = []
    for c in cells:
        place = ", ".join(number(x, 4) for x in c.place)
        rows.append((c.block, f"{c.i}, {c.j}, {c.k}", number(c.corner, 3), number(c.q, 3), place, c.patch or "–"))
    columns = ("block", "cell i, j, k", "corner", "Q", f"place x, y, z ({unit})", "at")
    return Table(
        f"Worst cells: {shape.label.lower()}",
        columns,
        rows,
        "The smallest corner triple products, as the command quality names them; numbers are from 1.",
    )


def height_table(shapes: Sequence[Shape], cells: WallHeights, unit: str) -> Table:
    """Heights of the first cells at every wall."""
    rows = []
    for shape in shapes:
        heights = cells.heights(shape.nodes)
        for patch, ids in cells.by_patch():
            chosen, ratios = heights[ids], heights[ids] / cells.baseline[ids]
            values = number(chosen.min()), number(float(np.median(chosen))), number(chosen.max())
            label = (cells.patches[patch], *([shape.label] if len(shapes) > 1 else []))
            rows.append((*label, f"{ids.size:,}", *values, f"{ratios.min():.3f} to {ratios.max():.3f}"))
    shape_column = ["grid"] if len(shapes) > 1 else []
    sizes = (f"{what} ({unit})" for what in ("lowest", "median", "highest"))
    columns = ("wall", *shape_column, "nodes", *sizes, "relative to the model's grid")
    return Table("Heights of the first cells at walls", columns, rows)


def interface_table(
    shapes: Sequence[Shape],
    # what meets what, how, and the gap with each shape (m)
    misses: Sequence[tuple[str, str, Sequence[float]]],
    unit: str,
) -> Table | None:  # None if there are no such sides or nodes
    """Largest gaps of periodic sides, and distances of nodes from surfaces on which they slide."""
    if not misses:
        return None
    rows = [(what, how, *(number(miss, 3) for miss in of)) for what, how, of in misses]
    columns = ("sides or nodes", "meet by", *(f"{shape.label.lower()}, off by ({unit})" for shape in shapes))
    note = "The largest distance of a node from its partner, or from its place over the surface."
    return Table("Periodic sides and fixed surfaces", columns, rows, note)


def history_table(history: CaseHistory) -> Table:
    """Objective and constraints at the first, the best and the last evaluation, with their limits."""
    rows = []
    for quantity in (*history.of_kind("objective"), *history.of_kind("constraint")):
        for k, name in enumerate(quantity.value_names[:MOST_ROWS]):
            values = [number(quantity.values[n, k], 6) for n in (0, history.best, -1)]
            limits = [number(side[k]) for side in (quantity.lower, quantity.upper, quantity.equals)]
            rows.append((name, quantity.kind, *values, *limits, quantity.units or "–"))
    columns = (
        "name",
        "kind",
        "first",
        f"best (evaluation {history.best})",
        "last",
        "lower",
        "upper",
        "demanded",
        "units",
    )
    return Table("Objective and constraints", columns, rows[:MOST_ROWS], _cut(len(rows)))


def flow_table(
    history: CaseHistory,  # the optimisation
    is_section: bool = False,  # whether the flows are about a section
) -> Table | None:  # a row for each flow, named as its subsystem; None if no coefficient is recorded
    """Coefficients of every flow at the first and the best evaluation, as far as they are recorded."""
    found: dict[str, tuple[float, float]] = {}
    for quantity in history.quantities:
        if quantity.values.shape[1] == 1:
            found[quantity.name] = quantity.values[0, 0], quantity.values[history.best, 0]
    for name, values in history.outputs.items():
        first, best = values.get(0), values.get(history.best)
        if first is not None and best is not None and first.size == 1:
            found[name] = first.item(), best.item()
    asked = [*OF_FLOWS[:2], *numbers("euler", is_section=is_section)]
    flows = list(dict.fromkeys(name.rpartition(".")[0] for name in found if name.rpartition(".")[2] in asked[2:]))
    of_flow = {flow: {name: found.get(f"{flow}.{name}" if flow else name) for name in asked} for flow in flows}
    listed = [name for name in asked if any(values[name] for values in of_flow.values())]
    rows = [(flow or "flow", *(_change(values[name]) for name in listed)) for flow, values in of_flow.items()]
    columns = ("condition", *(f"{name} (°)" if name == "alpha" else name for name in listed))
    note = "At the first and the best evaluation." + (f" {OF_SECTION}." if is_section else "")
    return Table("Coefficients", columns, rows, note) if rows else None


def estimate_table(estimates: Mapping[str, ErrorEstimate]) -> Table | None:
    """Coefficients at the end, and on a finer grid; None if none is estimated."""
    rows = [
        (name, number(each.value), number(each.finer), number(each.remaining, 2)) for name, each in estimates.items()
    ]
    if not rows:
        return None
    factor = next(iter(estimates.values())).factor
    columns = ("coefficient", "at the end", "on the finer grid", "which may be wrong by")
    note = f"Estimated by the adjoint for a grid of {number(factor)} times the cells per direction, at the last design."
    return Table("Errors of the grid", columns, rows, note)


def _change(values: tuple[float, float] | None) -> str:
    """Format a number before and after, once if it is unchanged."""
    if values is None:
        return "–"
    before, after = (number(value, 4) for value in values)
    return before if before == after else f"{before} → {after}"


def variable_table(history: CaseHistory) -> Table:
    """Design variables with their bounds."""
    rows = []
    for quantity in history.of_kind("variable"):
        for k, name in enumerate(quantity.value_names):
            first, best = quantity.values[0, k], quantity.values[history.best, k]
            lower, upper = quantity.lower[k], quantity.upper[k]
            rows.append(
                (
                    name,
                    number(lower),
                    number(first),
                    number(best),
                    number(upper),
                    _bound(best, lower, upper),
                    quantity.units or "–",
                )
            )
    columns = ("variable", "lower", "first", "best", "upper", "at a bound", "units")
    return Table("Design variables", columns, rows[:MOST_ROWS], _cut(len(rows)))


def fit_table(model: FittedModel) -> Table:
    """Quality of the fit."""
    report, worst, unit = model.report, model.report.worst, model.header.length_unit
    place = f"node ({worst.i}, {worst.j}, {worst.k}) of block {worst.block}"
    rows = [
        ("blocks", f"{len(model.topology.shapes):,}"),
        ("nodes", f"{model.n_nodes:,}"),
        ("control points", f"{model.mesh.n_control_points:,}"),
        (f"RMS distance of nodes from the splines ({unit})", number(report.rms)),
        ("the same relative to the mean cell edge", number(report.relative_rms)),
        (f"largest distance ({unit})", f"{number(worst.error)}, at {place}"),
        ("the same relative to the width of the cells", _in_widths(report)),
        ("invalid control elements", f"{report.n_invalid:,}"),
        ("residual carried", "yes: the grid that was read comes back" if model.residual is not None else "no"),
        ("patches", ", ".join(f"{p.name} ({p.kind})" for p in model.header.patches) or "none declared"),
    ]
    return Table("The fitted model", ("what", "value"), rows)


def _in_widths(report: FitReport) -> str:
    """Places of the largest errors relative to the width of the cells."""
    places = f"{report.worst_local}" if report.worst_local else "–"
    return f"{places}; on walls {report.worst_on_walls}" if report.worst_on_walls else places


def _bound(value: float, lower: float, upper: float) -> str:
    """The bound at which a value is."""
    near = AT_LIMIT * (upper - lower if np.isfinite(upper - lower) else max(1.0, abs(value)))
    return "lower" if value <= lower + near else "upper" if value >= upper - near else "no"


def _cut(n_rows: int) -> str:
    return f"The first {MOST_ROWS} of {n_rows:,} are shown." if n_rows > MOST_ROWS else ""
