"""The interactive 3D view: walls, control points, planes of symmetry, and the worst cells.

Every trace gives in its ``meta`` what it belongs to: a ``layer`` that is shown or hidden, the ``shape``, and the
``color`` of the walls. The page selects among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..plotting.color_ranges import colors_about_zero, round_ticks
from .shape import Axes, Shape
from .subject import Mark, Subject
from .walls import Walls

__all__ = ["DRAWN", "camera", "space_traces"]


@dataclass(frozen=True)
class _Style:
    """How a layer is drawn: its colours are visible on light and on dark ground."""

    color: str
    width: float  # of lines
    size: float = 2.5  # of points


STYLES = {
    "lines": _Style("#33485c", 1.2),
    "control": _Style("#d55e00", 2.0),
    "symmetry": _Style("#8a949e", 1.0),
    "worst": _Style("#cc3311", 1.0, 5.0),
    "blocks": _Style("#009e73", 2.0),
}
"""Layers that can be shown or hidden; the subject names them."""

DRAWN = ("lines", "symmetry")
"""Layers that are visible at first."""

WALL = "#8fb8dc"
"""Colour of walls."""

FAR = 1e5
"""Distance of the light, in units of plotly's scene."""

LIGHT = {"ambient": 0.6, "diffuse": 0.7, "specular": 0.1, "roughness": 0.7, "fresnel": 0.05}
"""Lighting of walls."""


def space_traces(
    shapes: Sequence[Shape],  # shapes of the report
    subject: Subject,  # the model of the shapes
    axes: Axes,  # its axes
    walls: Walls,  # drawn part of its walls
    marks: Sequence[Sequence[Mark]],  # the worst cells of each shape
) -> tuple[list[dict[str, Any]], dict[str, str]]:  # traces; colors: names of the colours by their keys
    """Traces of plotly for all shapes, and the available colours of walls."""
    colors = {"plain": "Plain"}
    values = [_values(shape, subject, walls) for shape in shapes]
    if len(shapes) > 1:
        for shape, of_shape in zip(shapes, values):
            ways = np.linalg.norm((shape.nodes - shapes[0].nodes)[walls.rows], axis=1)
            of_shape["displacement"] = _Field(f"Displacement ({axes.unit})", ways)
    for of_shape in values:
        colors |= {key: painted.name for key, painted in of_shape.items()}
    colored = {key: _coloring([v[key] for v in values if key in v]) for key in colors if key != "plain"}
    light = np.zeros(3)
    light[[axes.downstream, axes.span, axes.up]] = FAR * np.array([-0.5, 0.4, 1.0])
    traces: list[dict[str, Any]] = []
    for number, (shape, of_shape, worst) in enumerate(zip(shapes, values, marks)):
        points = shape.nodes[walls.rows]
        traces.append(_mesh(points, walls, light, {"layer": "walls", "shape": number, "color": "plain"}))
        for key, painted in of_shape.items():
            mesh = _mesh(points, walls, light, {"layer": "walls", "shape": number, "color": key})
            traces.append(mesh | _painted(painted) | colored[key])
        traces.append(_wire("lines", number, walls.lines(shape.nodes)))
        for layer in subject.layers_of(shape, walls):
            if len(layer.lines):
                traces.append(_wire(layer.key, number, layer.lines))
            if len(layer.points):
                traces.append(_points(layer.key, number, layer.points))
        if worst:
            points = _points("worst", number, np.array([mark.place for mark in worst]))
            text = [mark.text for mark in worst]
            traces.append(points | {"text": text, "hovertemplate": "%{text}<extra></extra>", "hoverinfo": None})
    for trace in traces:
        meta = trace["meta"]
        is_shape = meta.get("shape") in (None, len(shapes) - 1)
        trace["visible"] = bool(is_shape and meta.get("color", "plain") == "plain" and _is_drawn(meta["layer"]))
    return traces, colors


def camera(axes: Axes, points: np.ndarray, has_symmetry: bool) -> dict[str, Any]:
    """Viewpoint for points (n, 3) on walls: from upstream, from above, and from the side of the tip."""
    eye, up = np.zeros(3), np.zeros(3)
    middle = 0.5 * (points[:, axes.span].min() + points[:, axes.span].max())
    eye[axes.downstream], eye[axes.up] = -1.15, 0.95
    eye[axes.span] = 1.15 if middle >= 0.0 or not has_symmetry else -1.15
    up[axes.up] = 1.0
    center = -0.18 * up  # room below, where two of the axes meet
    return {
        name: dict(zip("xyz", vector.tolist())) for name, vector in {"eye": eye, "up": up, "center": center}.items()
    }


def _is_drawn(layer: str) -> bool:
    return layer == "walls" or layer in DRAWN


@dataclass(frozen=True, eq=False)
class _Field:
    """A field that colours the walls of a shape."""

    name: str
    values: np.ndarray  # (n,), at the nodes that are drawn
    is_about_zero: bool = False


def _values(shape: Shape, subject: Subject, walls: Walls) -> dict[str, _Field]:
    """The fields that colour the walls of a shape, by their keys in the page."""
    found = {}
    for name, pressures in shape.pressures.items():
        assert subject.pressure_faces is not None  # or there would be no pressures
        found[name] = _Field(name, walls.of_faces(subject.pressure_faces, pressures), is_about_zero=True)
    quality = subject.wall_quality(shape.nodes)
    if quality is not None:
        found["quality"] = _Field(quality.name, walls.of_faces(quality.corners, quality.values))
    heights = subject.heights
    if heights is not None and walls.are_walls:
        with np.errstate(divide="ignore", invalid="ignore"):  # of flat or folded cells
            logarithms = np.log10(walls.of_nodes(heights.wall_rows, heights.heights(shape.nodes)))
        if np.isfinite(logarithms).all():
            found["height"] = _Field("Height of first cells (log10 of m)", logarithms)
    return found


def _coloring(fields: Sequence[_Field]) -> dict[str, Any]:
    """Colours of a field of several shapes, without the outermost hundredths, with round ends."""
    low, high = np.quantile(np.concatenate([each.values for each in fields]), [0.005, 0.995]).tolist()
    is_about_zero = fields[0].is_about_zero
    if is_about_zero:
        low, high = min(low, 0.0), max(high, 0.0)
    if not high > low:
        low, high = low - 0.5, low + 0.5
    ticks = round_ticks(low, high)
    low, high = float(ticks[0]), float(ticks[-1])
    scale = colors_about_zero(low, high) if is_about_zero else "Viridis"
    return {"cmin": low, "cmax": high, "colorscale": scale}


def _mesh(points: np.ndarray, walls: Walls, light: np.ndarray, meta: dict) -> dict[str, Any]:
    """Trace of the walls in one colour."""
    corners = walls.triangles().astype(np.uint16 if len(points) < 65536 else np.uint32)
    return {
        "type": "mesh3d",
        "meta": meta,
        "name": "walls",
        **_coordinates(points),
        **dict(zip("ijk", corners.T.copy())),
        "color": WALL,
        "flatshading": False,
        "lighting": LIGHT,
        "lightposition": dict(zip("xyz", light.tolist())),
        "hoverinfo": "skip",
        "showscale": False,
    }


def _painted(painted: _Field) -> dict[str, Any]:
    """Keywords that colour the walls by values at their nodes."""
    title = {"text": painted.name, "side": "top"}
    bar = {"title": title, "orientation": "h", "thickness": 10, "len": 0.8, "y": 1.0, "yanchor": "top"}
    return {
        "intensity": painted.values.astype(np.float32),
        "showscale": True,
        "colorbar": bar,
        "lighting": LIGHT | {"ambient": 0.8, "diffuse": 0.25, "specular": 0.03},
        "hoverinfo": "x+y+z+text",
        "hovertemplate": painted.name + " %{intensity:.4g}<br>(%{x:.4g}, %{y:.4g}, %{z:.4g})<extra></extra>",
    }


def _wire(layer: str, shape: int, points: np.ndarray) -> dict[str, Any]:
    """Trace of lines."""
    style = STYLES[layer]
    return {
        "type": "scatter3d",
        "mode": "lines",
        "meta": {"layer": layer, "shape": shape},
        "name": layer,
        **_coordinates(points),
        "line": {"color": style.color, "width": style.width},
        "hoverinfo": "skip",
    }


def _points(layer: str, shape: int, points: np.ndarray) -> dict[str, Any]:
    """Trace of points."""
    style = STYLES[layer]
    return {
        "type": "scatter3d",
        "mode": "markers",
        "meta": {"layer": layer, "shape": shape},
        "name": layer,
        **_coordinates(points),
        "marker": {"color": style.color, "size": style.size},
        "hoverinfo": "skip",
    }


def _coordinates(points: np.ndarray) -> dict[str, np.ndarray]:
    return {name: np.ascontiguousarray(column, dtype=np.float32) for name, column in zip("xyz", points.T)}
