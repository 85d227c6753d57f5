"""Charts of the page as figures of plotly: quality, heights at walls, histories, sections and pressures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.om.drivers.case_history import FEASIBLE, CaseHistory, Quantity
from ...grids.cells.report import QualityReport
from ..plotting.figures import BLUE, GRAY, GREEN, ORANGE, PURPLE, RED
from ..plotting.pressures import faces_around
from ..plotting.smooth_lines import curve_through, outlines_at
from .shape import Axes, Shape
from .walls import WallHeights

__all__ = [
    "Chart",
    "distribution_chart",
    "downstream_text",
    "height_chart",
    "history_charts",
    "lattice_charts",
    "place_text",
    "places_of",
    "pressure_chart",
    "quality_chart",
    "section_chart",
    "shape_styles",
]

STATIONS = (0.05, 0.35, 0.65, 0.95)
"""Stations of the sections, as fractions of the span of the walls."""

GAP = np.full((1, 2), np.nan)
"""What ends a line in a trace of many."""

MOST_LINES = 8
"""Largest number of values of a vector with a line each; above it the smallest and the largest are drawn."""

SERIES = (BLUE, ORANGE, GREEN, PURPLE, RED, "#56b4e9", "#b8860b", "#c05a9a")
"""Colours of lines."""


@dataclass(frozen=True)
class Chart:
    """A chart and its description in words."""

    key: str  # its name in the page
    title: str  # heading
    text: str  # what it shows, for those who cannot see it
    data: list[dict[str, Any]]  # traces of plotly
    layout: dict[str, Any]  # layout of plotly
    height: int = 300  # in pixels
    is_wide: bool = False  # whether it needs the whole width


def shape_styles(shapes: Sequence[Shape]) -> list[dict[str, Any]]:
    """Line styles of the shapes: before in grey and dashed, after in blue."""
    styles = [{"color": BLUE, "width": 2}]
    return styles if len(shapes) == 1 else [{"color": GRAY, "width": 1.6, "dash": "dash"}, *styles]


def quality_chart(shapes: Sequence[Shape], reports: Sequence[QualityReport]) -> Chart:
    """Distribution of Q over the cells, in per cent."""
    edges = reports[0].histogram.edges
    percents = [100.0 * report.histogram.density * np.diff(edges) for report in reports]
    last = reports[-1]
    text = f"Distribution of Q: smallest {last.q_min:.3g}, mean {last.q_mean:.3g}, of {last.n_cells:,} cells."
    axis = {"title": {"text": "Q"}, "range": [0, 1]}
    return distribution_chart("quality", "Distribution of Q", text, shapes, edges, percents, axis, "% of the cells")


def distribution_chart(
    key: str,
    title: str,
    text: str,
    shapes: Sequence[Shape],
    edges: np.ndarray,  # (n + 1,), ends of the bins
    percents: Sequence[np.ndarray],  # (n,) for each shape, what is in them
    axis: dict[str, Any],  # axis of the distributed quantity
    of: str,  # what the percentages are of
) -> Chart:
    """Distribution of a quantity, in per cent."""
    data = []
    for shape, percent, style in zip(shapes, percents, shape_styles(shapes)):
        line = {"x": np.repeat(edges, 2)[1:-1], "y": np.repeat(percent, 2), "mode": "lines", "line": style}
        data.append({"type": "scatter", "name": shape.label, "fill": "tozeroy", **line, "opacity": 0.9})
    layout = {"xaxis": axis, "yaxis": {"title": {"text": of}, "rangemode": "tozero"}}
    return Chart(key, title, text, data, layout)


def height_chart(shapes: Sequence[Shape], cells: WallHeights, unit: str) -> Chart:
    """Heights of the first cells of every wall, sorted by size."""
    data, lowest, highest = [], np.inf, -np.inf
    parts = np.linspace(0.0, 1.0, 101)
    for shape, style in zip(shapes, shape_styles(shapes)):
        heights = cells.heights(shape.nodes)
        for number, (patch, ids) in enumerate(cells.by_patch()):
            sizes = np.quantile(heights[ids], parts)
            lowest, highest = min(lowest, sizes[0]), max(highest, sizes[-1])
            name = cells.patches[patch] if len(shapes) == 1 else f"{cells.patches[patch]}, {shape.label.lower()}"
            line = style | {"color": SERIES[number % len(SERIES)]}
            data.append(
                {"type": "scatter", "mode": "lines", "name": name, "x": 100.0 * parts, "y": sizes, "line": line}
            )
    text = f"Heights of the first cells at walls, from {lowest:.3g} to {highest:.3g} {unit}."
    layout = {
        "xaxis": {"title": {"text": "% of the nodes that are lower"}},
        "yaxis": {"title": {"text": f"height ({unit})"}, "type": "log", "exponentformat": "e"},
    }
    return Chart("heights", "Heights of the first cells", text, data, layout)


def history_charts(history: CaseHistory) -> list[Chart]:
    """Objective, constraints, variables and convergence over the evaluations."""
    charts = [_quantity_chart(n, q, history) for n, q in enumerate(history.quantities) if q.kind != "variable"]
    charts += [_quantity_chart(100 + n, q, history) for n, q in enumerate(history.of_kind("variable"))]
    convergence = history.convergence
    if convergence is None:
        return charts
    residuals, violations = convergence.residuals, convergence.violations
    least = FEASIBLE if not residuals.size else min(FEASIBLE, residuals.min(where=residuals > 0.0, initial=np.inf))
    visible = np.where(violations < least, np.nan, violations)  # no empty decades below
    if not (residuals > 0.0).any() and np.isnan(visible).all():
        return charts  # not recorded, and nothing is violated: there is no line to draw
    data = [
        _line("largest violation", np.arange(len(visible)), visible, {"color": ORANGE, "width": 1.6, "dash": "dot"})
    ]
    text = f"Largest violation of a constraint at the best evaluation: {convergence.violations[history.best]:.2g}."
    if residuals.size:
        above, style = np.where(residuals > 0.0, residuals, np.nan), {"color": BLUE, "width": 1.8}
        line = _line("optimality", convergence.differentiated, above, style)
        data.insert(0, line | {"mode": "lines+markers"})
        text += f" First-order optimality from {residuals[0]:.2g} to {residuals[-1]:.2g}."
    layout = {
        "xaxis": _evaluations(),
        "yaxis": {"type": "log", "exponentformat": "e", "title": {"text": "in units of the driver"}},
    }
    charts.insert(1, Chart("convergence", "Optimality and violation", text, data, layout))
    return charts


def _quantity_chart(number: int, quantity: Quantity, history: CaseHistory) -> Chart:
    """History of an objective, a constraint or a variable with its limits."""
    values, n = quantity.values, np.arange(history.n_evaluations)
    if values.shape[1] <= MOST_LINES:
        lines = list(zip(quantity.value_names, values.T))
    else:
        lines = [("smallest", values.min(axis=1)), ("largest", values.max(axis=1))]
    data = [_line(name, n, y, {"color": c, "width": 1.8}) for (name, y), c in zip(lines, SERIES)]
    data += _limit_lines(quantity, n)
    best = [float(y[history.best]) for _, y in lines]
    data.append(
        {
            **{"type": "scatter", "mode": "markers", "name": "best", "x": [history.best] * len(best), "y": best},
            "marker": {"symbol": "circle-open", "size": 9, "line": {"width": 2}, "color": RED},
        }
    )
    ends = ", ".join(f"{name} from {y[0]:.4g} to {y[history.best]:.4g}" for name, y in lines)
    title = f"{quantity.kind.capitalize()} {quantity.name}"
    layout = {
        "xaxis": _evaluations(),
        "yaxis": {"title": {"text": quantity.name + (f" ({quantity.units})" if quantity.units else "")}},
    }
    return Chart(f"history{number}", title, f"{title}: {ends}, at evaluation {history.best}.", data, layout)


def _limit_lines(quantity: Quantity, n: np.ndarray) -> list[dict[str, Any]]:
    """Lines of the limits, drawn once if elements share them."""
    found = []
    for name, limits in (("lower", quantity.lower), ("upper", quantity.upper), ("demanded", quantity.equals)):
        for limit in np.unique(limits[np.isfinite(limits)])[:3]:
            style = {"color": RED, "width": 1.2, "dash": "dash"}
            found.append(_line(f"{name} limit" if name != "demanded" else name, n[[0, -1]], [limit, limit], style))
    return found


def section_chart(shapes: Sequence[Shape], quads: np.ndarray, axes: Axes) -> Chart:
    """Sections of the walls, smooth but for sharp edges, one below the other."""
    places, order = places_of(shapes[0].nodes[quads], axes), (axes.downstream, axes.up, axes.span)
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {"grid": {"rows": len(places), "columns": 1, "pattern": "independent"}, "annotations": []}
    for row, place in enumerate(places, start=1):
        suffix = "" if row == 1 else str(row)
        for shape, style in zip(shapes, shape_styles(shapes)):
            lines = [part for line in outlines_at(place, shape.nodes, quads, order) for part in (line, GAP)]
            x, y = np.concatenate([GAP, *lines]).astype(np.float32).T
            at = {"x": x.copy(), "y": y.copy(), "xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
            data.append(
                {"type": "scatter", "mode": "lines", "name": shape.label, "line": style, "showlegend": row == 1, **at}
            )
        layout[f"yaxis{suffix}"] = {"scaleanchor": f"x{suffix}", "title": {"text": f"{'xyz'[axes.up]} ({axes.unit})"}}
        layout[f"xaxis{suffix}"] = {"title": {"text": downstream_text(axes) if row == len(places) else ""}}
        layout["annotations"].append(_named(row, place_text(axes, place)))
    text = f"Sections of the walls at {', '.join(place_text(axes, place) for place in places)}."
    return Chart("sections", "Sections", text, data, layout, height=60 + 170 * len(places))


def pressure_chart(shapes: Sequence[Shape], name: str, corners: np.ndarray, axes: Axes) -> Chart | None:
    """Pressure coefficients around the sections."""
    shapes = [shape for shape in shapes if name in shape.pressures]
    if not shapes:
        return None
    order = [axes.downstream, axes.up, axes.span]
    first = shapes[0].nodes[corners][..., order]
    strips = {first[faces_around(first, place), :, 2].mean() for place in places_of(shapes[0].nodes[corners], axes)}
    places = sorted(strips)  # each strip of faces once, and named where it is
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {"grid": {"rows": len(places), "columns": 1, "pattern": "independent"}, "annotations": []}
    for row, place in enumerate(places, start=1):
        suffix = "" if row == 1 else str(row)
        for shape, style in zip(shapes, shape_styles(shapes)):
            quads = shape.nodes[corners][..., order]
            around = faces_around(quads, place)
            points = np.stack([quads[around, :, 0].mean(axis=1), shape.pressures[name][around]], axis=1)
            x, y = curve_through(points).astype(np.float32).T
            at = {"x": x.copy(), "y": y.copy(), "xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
            data.append(
                {"type": "scatter", "mode": "lines", "name": shape.label, "line": style, "showlegend": row == 1, **at}
            )
        layout[f"yaxis{suffix}"] = {"autorange": "reversed", "title": {"text": name}}
        layout[f"xaxis{suffix}"] = {"title": {"text": downstream_text(axes) if row == len(places) else ""}}
        layout["annotations"].append(_named(row, place_text(axes, place)))
    peak = float(shapes[-1].pressures[name].min())
    where = ", ".join(place_text(axes, place) for place in places)
    text = f"{name} around sections at {where}; the smallest on the walls is {peak:.3g}."
    return Chart(
        f"pressure-{name.replace('.', '-')}", f"Pressure coefficient {name}", text, data, layout, 60 + 170 * len(places)
    )


def lattice_charts(
    # the optimisation: its outputs ``delta_Cp`` of `LatticeFlow`, whose panels divide chord and span evenly, the strips
    # from the tip to the root
    history: CaseHistory,
) -> list[Chart]:  # one for each lattice whose differences are recorded
    """Pressure differences across the panels of every vortex lattice along the chord of some strips."""
    charts = []
    for name, found in history.outputs.items():
        if name.rpartition(".")[2] != "delta_Cp" or 0 not in found or found[0].ndim != 2:
            continue
        drawn = {
            "Before": found[0],
            **({"After": found[history.best]} if history.best in found and history.best else {}),
        }
        styles = [{"color": GRAY, "width": 1.6, "dash": "dash"}] * (len(drawn) - 1) + [{"color": BLUE, "width": 2}]
        n_chord, n_span = found[0].shape
        places = (np.arange(n_chord) + 0.5) / n_chord
        layout: dict[str, Any] = {
            "grid": {"rows": len(STATIONS), "columns": 1, "pattern": "independent"}, "annotations": []
        }  # fmt: skip
        data: list[dict[str, Any]] = []
        for row, part in enumerate(STATIONS, start=1):
            suffix, strip = "" if row == 1 else str(row), min(int((1.0 - part) * n_span), n_span - 1)
            for (label, values), style in zip(drawn.items(), styles):
                line = _line(label, places, values[:, strip], style)
                data.append(
                    line
                    | {"mode": "lines+markers", "showlegend": row == 1, "xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
                )
            layout[f"yaxis{suffix}"] = {"title": {"text": name}, "rangemode": "tozero"}
            layout[f"xaxis{suffix}"] = {
                "title": {"text": "part of the chord" if row == len(STATIONS) else ""}, "range": [0, 1]
            }  # fmt: skip
            middle = 100.0 * (1.0 - (strip + 0.5) / n_span)
            layout["annotations"].append(_named(row, f"{middle:.0f} % of the span"))
        peak = float(list(drawn.values())[-1].max())
        text = f"{name}, the pressure coefficient below less that above the panels; the largest is {peak:.3g}."
        key = f"lattice-{name.replace('.', '-')}"
        charts.append(Chart(key, f"Pressure difference {name}", text, data, layout, 60 + 170 * len(STATIONS)))
    return charts


def places_of(corners: np.ndarray, axes: Axes) -> list[float]:
    """Coordinates of the sections of walls with these quads, shape (n, 4, 3): one if they are one cell wide."""
    span = corners[..., axes.span]
    low, high = span.min(), span.max()
    is_wide = np.ptp(span, axis=1).max() > 0.9 * (high - low)
    parts: Sequence[float] = (0.5,) if is_wide else STATIONS
    return [float(low + part * (high - low)) for part in parts]


def place_text(axes: Axes, place: float) -> str:
    """Text for the place of a section."""
    return f"{'xyz'[axes.span]} = {place:.3g} {axes.unit}"


def downstream_text(axes: Axes) -> str:
    """Label of the downstream axis."""
    return f"{'xyz'[axes.downstream]} ({axes.unit})"


def _named(row: int, text: str) -> dict[str, Any]:
    """Name of a subplot, in its corner."""
    suffix = "" if row == 1 else str(row)
    at = {
        "xref": f"x{suffix} domain",
        "yref": f"y{suffix} domain",
        "x": 1.0,
        "y": 1.0,
        "xanchor": "right",
        "yanchor": "bottom",
    }
    return {"text": text, "showarrow": False, **at, "font": {"size": 12}}


def _line(name: str, x: np.ndarray, y: ArrayLike, style: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": np.asarray(x),
        "y": np.asarray(y, dtype=float),
        "line": dict(style),
    }


def _evaluations() -> dict[str, Any]:
    return {"title": {"text": "evaluation"}, "rangemode": "tozero", "tickformat": "d"}
