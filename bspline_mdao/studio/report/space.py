"""The drawing in space that can be turned: walls, control points, planes of symmetry, and the worst cells.

Every trace says in its ``meta`` what it belongs to: a ``layer`` that is shown or hidden, the ``shape``, and the
``color`` of the walls. The page chooses among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .shape import Axes, Shape
from .subject import Mark, Subject
from .walls import WallHeights, Walls

__all__ = ["DRAWN", "camera", "space_traces"]


@dataclass(frozen=True)
class _Style:
    """How a layer is drawn: colours show on light and on dark ground."""

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
"""Layers that can be shown or hidden; what they are called is up to the subject."""

DRAWN = ("lines", "symmetry")
"""Layers that are shown at first."""

WALL = "#8fb8dc"
"""Colour of walls."""

FAR = 1e5
"""Distance of the light, in units of plotly's scene."""

LIGHT = {"ambient": 0.6, "diffuse": 0.7, "specular": 0.1, "roughness": 0.7, "fresnel": 0.05}
"""How walls shine."""


def space_traces(
    shapes: Sequence[Shape],  # what is reported
    subject: Subject,  # of what these are shapes
    axes: Axes,  # its axes
    walls: Walls,  # what is drawn of its walls
    marks: Sequence[Sequence[Mark]],  # the worst cells of each shape
) -> tuple[list[dict[str, Any]], dict[str, str]]:  # traces; colors: names of the colours by their keys
    """Traces of plotly for all shapes, and the colours of walls that there are."""
    colors = {"plain": "Plain"}
    corners = subject.pressure_faces if any(shape.pressures for shape in shapes) else None
    values = [_values(shape, walls, corners, subject.heights) for shape in shapes]
    for of_shape in values:
        colors |= {key: name for key, (name, _) in of_shape.items()}
    limits = {key: _limits([v[key][1] for v in values if key in v]) for key in colors if key != "plain"}
    light = np.zeros(3)
    light[[axes.downstream, axes.span, axes.up]] = FAR * np.array([-0.5, 0.4, 1.0])
    traces: list[dict[str, Any]] = []
    for number, (shape, of_shape, worst) in enumerate(zip(shapes, values, marks)):
        points = shape.nodes[walls.rows]
        traces.append(_mesh(points, walls, light, {"layer": "walls", "shape": number, "color": "plain"}))
        for key, (name, numbers) in of_shape.items():
            mesh = _mesh(points, walls, light, {"layer": "walls", "shape": number, "color": key})
            traces.append(mesh | _painted(name, numbers, limits[key]))
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
    """Place from which points (n, 3) on walls are seen: from upstream, above, and the side of the tip."""
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


def _values(
    shape: Shape, walls: Walls, corners: np.ndarray | None, first_cells: WallHeights | None
) -> dict[str, tuple[str, np.ndarray]]:
    """Names and values of what colours the walls of a shape."""
    found = {}
    if corners is not None:
        for name, pressures in shape.pressures.items():
            found[name] = (name, walls.of_faces(corners, pressures))
    if first_cells is not None and walls.are_walls:
        with np.errstate(divide="ignore", invalid="ignore"):  # of cells that are flat or folded
            heights = np.log10(walls.of_nodes(first_cells.wall_rows, first_cells.heights(shape.nodes)))
        if np.isfinite(heights).all():
            found["height"] = ("Height of first cells (log10 of m)", heights)
    return found


def _limits(values: list[np.ndarray]) -> tuple[float, float]:
    """Range of the colours of several shapes, without the outermost hundredths."""
    low, high = np.quantile(np.concatenate(values), [0.005, 0.995]).tolist()
    return (low, high) if high > low else (low - 0.5, low + 0.5)


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


def _painted(name: str, values: np.ndarray, limits: tuple[float, float]) -> dict[str, Any]:
    """Keywords that colour the walls by values at their nodes."""
    title = {"text": name, "side": "top"}
    bar = {"title": title, "orientation": "h", "thickness": 10, "len": 0.8, "y": 0.01, "yanchor": "bottom"}
    return {
        "intensity": values.astype(np.float32),
        "cmin": limits[0],
        "cmax": limits[1],
        "colorscale": "RdYlBu",
        "reversescale": True,
        "showscale": True,
        "colorbar": bar,
        "lighting": LIGHT | {"ambient": 0.8, "diffuse": 0.25, "specular": 0.03},
        "hoverinfo": "x+y+z+text",
        "hovertemplate": name + " %{intensity:.4g}<br>(%{x:.4g}, %{y:.4g}, %{z:.4g})<extra></extra>",
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
