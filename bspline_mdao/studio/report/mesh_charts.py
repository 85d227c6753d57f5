"""Charts of an unstructured mesh around a section: its cells, cells at the edges of a body, and the lattice."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...core.background.mesh_model import MeshModel
from ..plotting.cuts import cut
from ..plotting.mesh_slices import mesh_slice
from .charts import Chart, downstream_text, place_text, places_of, shape_styles
from .mesh_walls import edge_lines
from .shape import Axes, Shape
from .walls import WallHeights, Walls, net_lines

__all__ = ["section_charts"]

MOST_EDGES = 20_000
"""Largest number of cell edges drawn around a section; above it, the longest."""

NEAR_SPANS = 2.5
"""How far around the section the lattice is drawn, in units of its narrowest spans."""

AROUND = 0.15
"""How far cells are drawn around a section, in units of its longest side."""

REACH, SEGMENTS, LARGEST = 30.0, 3.0, 0.2
"""Half the width of the view at an edge of the body: in median heights of the first nodes, at least in edges of the
wall there, and at most in the longest side of the section."""

RATIO, MARGIN = 0.9, 0.15
"""Height-to-width ratio of a view, and the margin drawn at each side: equal scales show more in one direction."""


def section_charts(
    model: MeshModel, shapes: Sequence[Shape], walls: Walls, axes: Axes, heights: WallHeights | None
) -> list[Chart]:
    """Charts at the middle section."""
    places = places_of(shapes[0].nodes[walls.quads()], axes)
    place = places[(len(places) - 1) // 2]
    bodies = [cut(shape.nodes, walls.quads(), axes.span, place) for shape in shapes]
    whole = np.concatenate(bodies).reshape(-1, 3)[:, [axes.downstream, axes.up]]
    if not len(whole):
        return []
    size = float(np.ptp(whole, axis=0).max())
    middle, half = 0.5 * (whole.min(axis=0) + whole.max(axis=0)), (0.5 + AROUND) * size
    window = np.stack([middle - [half, RATIO * half], middle + [half, RATIO * half]])
    charts = []
    for number, (shape, body) in enumerate(zip(shapes, bodies)):
        cells = mesh_slice(model.mesh, shape.nodes, axes.span, place, _box(window, axes))
        lengths = np.linalg.norm(cells[:, 1] - cells[:, 0], axis=1)
        drawn = cells[np.argsort(-lengths, kind="stable")[:MOST_EDGES]]
        few = f", the longest {len(drawn):,} of {len(cells):,} edges" if len(drawn) < len(cells) else ""
        title = f"Cells at {place_text(axes, place)}{few}" + (f": {shape.label.lower()}" if len(shapes) > 1 else "")
        traces = [_lines("cells", drawn, axes, "#7d8894", 0.7), _lines("wall", body, axes, "#0072b2", 2.2)]
        charts.append(_chart(f"cells{number}", title, traces, window, axes, 420))
    if heights is not None:
        charts += _edge_charts(model, shapes, bodies, axes, place, heights, size)
    lattice = _lattice_chart(model, shapes, bodies, axes, place)
    return charts if lattice is None else [*charts, lattice]


def _edge_charts(
    model: MeshModel,
    shapes: Sequence[Shape],
    bodies: Sequence[np.ndarray],
    axes: Axes,
    place: float,
    heights: WallHeights,
    size: float,
) -> list[Chart]:
    """Cells at both ends of the section, for the last shape, with the wall before."""
    charts = []
    for key, choose in (("leading", np.argmin), ("trailing", np.argmax)):
        points = bodies[-1].reshape(-1, 3)
        at = int(choose(points[:, axes.downstream]))
        end, segment = points[at][[axes.downstream, axes.up]], bodies[-1][at // 2]
        local = SEGMENTS * float(np.linalg.norm(segment[1] - segment[0]))
        reach = min(max(REACH * float(np.median(heights.baseline)), local), LARGEST * size)
        window = np.stack([end - [reach, RATIO * reach], end + [reach, RATIO * reach]])
        cells = mesh_slice(model.mesh, shapes[-1].nodes, axes.span, place, _box(window, axes))
        traces = [_lines("cells", cells, axes, "#7d8894", 0.9)]
        for shape, body, style in zip(shapes, bodies, shape_styles(shapes)):
            traces.append(_lines(f"wall, {shape.label.lower()}", body, axes, style["color"], style["width"]))
        title = f"Cells at the {key} edge, {place_text(axes, place)}"
        charts.append(_chart(f"{key}-edge", title, traces, window, axes, 360))
    return charts


def _lattice_chart(
    model: MeshModel, shapes: Sequence[Shape], bodies: Sequence[np.ndarray], axes: Axes, place: float
) -> Chart | None:
    """The layer of the lattice nearest to the section."""
    lattice, data = model.lattice, []
    if not lattice.frame.is_cartesian:  # its layers are no planes
        return None
    directions = lattice.frame.axes
    across = int(np.argmax(np.abs(directions[:, axes.span])))
    layer = int(np.argmin(np.abs(lattice.lines[across].control_coordinates * directions[across, axes.span] - place)))
    around = np.concatenate(bodies).reshape(-1, 3)
    along = lattice.frame.to_local(around)
    near = []  # control points of each direction within some spans of the body
    for axis, line in enumerate(lattice.lines):
        x, beyond = line.control_coordinates, NEAR_SPANS * lattice.spacing
        is_near = (x >= along[:, axis].min() - beyond) & (x <= along[:, axis].max() + beyond)
        near.append([layer] if axis == across else np.flatnonzero(is_near))
    drawn = [around[:, [axes.downstream, axes.up]]]
    for shape, body, style in zip(shapes, bodies, shape_styles(shapes)):
        if shape.control_points is None:
            continue
        net = model.splines_at(shape.control_points)[1].reshape(*lattice.shape, 3)
        lines = net_lines([np.take(net[np.ix_(*near)], 0, axis=across)])
        x, y = lines[:, axes.downstream], lines[:, axes.up]
        drawn.append(np.stack([x, y], axis=1))
        data.append(
            {"type": "scatter", "mode": "lines+markers", "name": f"lattice, {shape.label.lower()}", "x": x, "y": y,
             "line": style | {"width": 1.0, "dash": "solid"}, "marker": {"size": 4, "color": style["color"]}}
        )  # fmt: skip
        data.append(_lines(f"wall, {shape.label.lower()}", body, axes, style["color"], 2.2))
    if not data:
        return None
    every = np.concatenate(drawn)
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    window = np.stack([low - 0.05 * (high - low), high + 0.05 * (high - low)])
    return _chart("lattice", f"Lattice at {place_text(axes, place)}", data, window, axes, 420)


def _box(window: np.ndarray, axes: Axes) -> np.ndarray:
    """Box in space of a chart's window, shape (2, 3)."""
    box = np.array([[-np.inf] * 3, [np.inf] * 3])
    box[:, [axes.downstream, axes.up]] = window + MARGIN * np.diff(window, axis=0) * [[-1.0], [1.0]]
    return box


def _lines(name: str, segments: np.ndarray, axes: Axes, color: str, width: float) -> dict[str, Any]:
    """Trace of segments, shape (n, 2, 3)."""
    flat = segments[..., [axes.downstream, axes.up]].reshape(-1, 2)
    points, ends = np.unique(flat, axis=0, return_inverse=True)
    flat = edge_lines(points, np.unique(np.sort(ends.reshape(-1, 2), axis=1), axis=0))
    line = {"color": color, "width": width}
    return {
        "type": "scattergl", "mode": "lines", "name": name, "x": flat[:, 0].copy(), "y": flat[:, 1].copy(),
        "line": line, "hoverinfo": "skip",
    }  # fmt: skip


def _chart(key: str, title: str, data: list, window: np.ndarray, axes: Axes, height: int) -> Chart:
    """Chart of a part of a section, with equal scales."""
    (left, low), (right, high) = window.tolist()
    layout = {
        "xaxis": {"title": {"text": downstream_text(axes)}, "range": [left, right]},
        "yaxis": {"title": {"text": f"{'xyz'[axes.up]} ({axes.unit})"}, "range": [low, high], "scaleanchor": "x"},
    }
    return Chart(key, title, f"{title}.", data, layout, height)
