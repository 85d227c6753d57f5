"""The drawing in space that can be turned: walls, control mesh, planes of symmetry, blocks, and the worst cells.

Every trace says in its ``meta`` what it belongs to: a ``layer`` that is shown or hidden, the ``shape``, and the
``color`` of the walls. The page chooses among them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ...core.model.fitted_model import FittedModel
from ...grids.cells.first_cells import FirstCells
from ...grids.cells.report import WorstCell
from ...grids.topology.sharing import boundary_sections
from .contents import Axes, Contents, Shape
from .walls import DrawnWalls, boundary_faces, every_line

__all__ = ["LAYERS", "camera", "space_traces"]

LAYERS = {
    "lines": "Grid lines",
    "control": "Control mesh",
    "symmetry": "Symmetry plane",
    "worst": "Worst cells",
    "blocks": "Blocks",
}
"""What can be shown or hidden."""

DRAWN = ("lines", "symmetry")
"""Layers that are shown at first."""

MOST_POINTS = 20_000
"""Of the lines of symmetry planes, and of those of control meshes, each."""

NEAR = 0.5
"""How far symmetry planes are drawn around the walls, in the longest side of their box."""

WALL, LINE, CONTROL, PLANE, WORST, BLOCK = "#8fb8dc", "#33485c", "#d55e00", "#8a949e", "#cc3311", "#009e73"
"""Colours that show on light and on dark ground."""

FAR = 1e5
"""Distance of the light, in units of plotly's scene."""

LIGHT = {"ambient": 0.6, "diffuse": 0.7, "specular": 0.1, "roughness": 0.7, "fresnel": 0.05}
"""How walls shine."""


def space_traces(
    contents: Contents,  # what is reported
    model: FittedModel,  # the fitted grid
    axes: Axes,  # its axes
    walls: DrawnWalls,  # what is drawn of its walls
    corners: np.ndarray | None,  # (n_faces, 4) of int, corners of the wall faces that pressures are of
    first_cells: FirstCells | None,  # the first cells at walls, where there are any
    worst: Sequence[Sequence[WorstCell]],  # the worst cells of each shape
) -> tuple[list[dict[str, Any]], dict[str, str]]:  # traces; colors: names of the colours by their keys
    """Traces of plotly for all shapes, and the colours of walls that there are."""
    colors = {"plain": "Plain"}
    values = [_values(shape, walls, corners, first_cells) for shape in contents.shapes]
    for of_shape in values:
        colors |= {key: name for key, (name, _) in of_shape.items()}
    limits = {key: _limits([v[key][1] for v in values if key in v]) for key in colors if key != "plain"}
    light = np.zeros(3)
    light[[axes.downstream, axes.span, axes.up]] = FAR * np.array([-0.5, 0.4, 1.0])
    traces: list[dict[str, Any]] = []
    for number, (shape, of_shape, cells) in enumerate(zip(contents.shapes, values, worst)):
        points = shape.nodes[walls.rows]
        traces.append(_mesh(points, walls, light, {"layer": "walls", "shape": number, "color": "plain"}))
        for key, (name, numbers) in of_shape.items():
            mesh = _mesh(points, walls, light, {"layer": "walls", "shape": number, "color": key})
            traces.append(mesh | _painted(name, numbers, limits[key]))
        lines = _lines([shape.nodes[face] for face in walls.drawn])
        traces.append(_wire("lines", number, lines, LINE, 1.2))
        traces += _others(model, shape, number, walls, cells)
    for trace in traces:
        meta = trace["meta"]
        is_shape = meta.get("shape") in (None, len(contents.shapes) - 1)
        trace["visible"] = bool(is_shape and meta.get("color", "plain") == "plain" and _is_drawn(meta["layer"]))
    return traces, colors


def camera(axes: Axes, points: np.ndarray, has_symmetry: bool) -> dict[str, Any]:
    """Place from which points (n, 3) on walls are seen: from upstream, above, and the side of the tip."""
    eye, up = np.zeros(3), np.zeros(3)
    middle = 0.5 * (points[:, axes.span].min() + points[:, axes.span].max())
    eye[axes.downstream], eye[axes.up] = -1.15, 0.95
    eye[axes.span] = 1.15 if middle >= 0.0 or not has_symmetry else -1.15
    up[axes.up] = 1.0
    return {
        "eye": dict(zip("xyz", eye.tolist())),
        "up": dict(zip("xyz", up.tolist())),
    }


def _is_drawn(layer: str) -> bool:
    return layer == "walls" or layer in DRAWN


def _values(
    shape: Shape, walls: DrawnWalls, corners: np.ndarray | None, first_cells: FirstCells | None
) -> dict[str, tuple[str, np.ndarray]]:
    """Names and values of what colours the walls of a shape."""
    found = {}
    if corners is not None:
        for name, pressures in shape.pressures.items():
            found[name] = (name, walls.of_faces(corners, pressures))
    if first_cells is not None and walls.are_walls:
        with np.errstate(divide="ignore", invalid="ignore"):  # of cells that are flat or folded
            heights = np.log10(walls.heights(first_cells, shape.nodes))
        if np.isfinite(heights).all():
            found["height"] = ("Height of first cells (log10 of m)", heights)
    return found


def _limits(values: list[np.ndarray]) -> tuple[float, float]:
    """Range of the colours of several shapes, without the outermost hundredths."""
    low, high = np.quantile(np.concatenate(values), [0.005, 0.995]).tolist()
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def _mesh(points: np.ndarray, walls: DrawnWalls, light: np.ndarray, meta: dict) -> dict[str, Any]:
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


def _others(
    model: FittedModel, shape: Shape, number: int, walls: DrawnWalls, cells: Sequence[WorstCell]
) -> Iterator[dict[str, Any]]:
    """Traces of one shape besides its walls."""
    if shape.control_points is not None:
        nets = _wall_nets(model, walls.are_walls)
        yield _wire("control", number, _lines([shape.control_points[net] for net in nets]), CONTROL, 2.0)
        points = shape.control_points[np.unique(np.concatenate([net.ravel() for net in nets]))]
        yield _marks("control", number, points, CONTROL, 2.5)
    planes = boundary_faces(model.topology, shape.nodes, "symmetry") if walls.are_walls else ()
    if planes:
        near = _near([shape.nodes[face] for face in every_line(planes, MOST_POINTS)], shape.nodes[walls.rows])
        yield _wire("symmetry", number, near, PLANE, 1.0)
    if cells:
        marks = _marks("worst", number, np.array([cell.place for cell in cells]), WORST, 5.0)
        text = [f"{cell}<br>Q {cell.q:.3g}, corner {cell.corner:.3g}" for cell in cells]
        yield marks | {"text": text, "hovertemplate": "%{text}<extra></extra>", "hoverinfo": None}
    yield _wire("blocks", number, _edges(model, shape.nodes), BLOCK, 2.0)


def _wall_nets(model: FittedModel, are_walls: bool) -> list[np.ndarray]:
    """Numbers of the control points on walls, each array of shape (N, M)."""
    sections = boundary_sections(model.topology, model.mesh.control_ids)
    return [
        np.squeeze(ids)
        for face, ids in sections
        if (face.kind == "wall" or not are_walls) and np.squeeze(ids).ndim == 2
    ]


def _lines(nets: Sequence[np.ndarray]) -> np.ndarray:
    """Both families of lines of nets, each of shape (n, m, 3), in one, with a gap behind each."""
    parts = [np.zeros((0, 3))]
    for net in nets:
        for lines in (net, np.swapaxes(net, 0, 1)):
            gap = np.full((len(lines), 1, 3), np.nan)
            parts.append(np.concatenate([lines, gap], axis=1).reshape(-1, 3))
    return np.concatenate(parts)


def _near(nets: Sequence[np.ndarray], points: np.ndarray) -> np.ndarray:
    """Lines of nets around points, as `_lines`; what is farther away is a gap."""
    low, high = points.min(axis=0), points.max(axis=0)
    reach = NEAR * (high - low).max()
    lines = _lines(nets)
    outside = ~np.all((lines >= low - reach) & (lines <= high + reach), axis=1)
    lines[outside] = np.nan
    is_gap = np.isnan(lines[:, 0])
    return lines[~(is_gap & np.append(False, is_gap[:-1]))]  # one gap in the place of many


def _edges(model: FittedModel, nodes: np.ndarray) -> np.ndarray:
    """Edges of all blocks, as `_lines`."""
    parts = []
    for block in model.topology.layout.split(nodes):
        for direction in range(3):
            corners = np.moveaxis(block, direction, 2)[[0, 0, -1, -1], [0, -1, 0, -1]]
            step = _thinned(corners.shape[1])
            gap = np.full((4, 1, 3), np.nan)
            parts.append(np.concatenate([corners[:, step], gap], axis=1).reshape(-1, 3))
    return np.concatenate(parts)


def _thinned(n: int, most: int = 40) -> np.ndarray:
    """At most about so many of n places, with both ends."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int))


def _wire(layer: str, shape: int, points: np.ndarray, color: str, width: float) -> dict[str, Any]:
    """Trace of lines."""
    return {
        "type": "scatter3d",
        "mode": "lines",
        "meta": {"layer": layer, "shape": shape},
        "name": layer,
        **_coordinates(points),
        "line": {"color": color, "width": width},
        "hoverinfo": "skip",
    }


def _marks(layer: str, shape: int, points: np.ndarray, color: str, size: float) -> dict[str, Any]:
    """Trace of marks."""
    return {
        "type": "scatter3d",
        "mode": "markers",
        "meta": {"layer": layer, "shape": shape},
        "name": layer,
        **_coordinates(points),
        "marker": {"color": color, "size": size},
        "hoverinfo": "skip",
    }


def _coordinates(points: np.ndarray) -> dict[str, np.ndarray]:
    return {name: np.ascontiguousarray(column, dtype=np.float32) for name, column in zip("xyz", points.T)}
