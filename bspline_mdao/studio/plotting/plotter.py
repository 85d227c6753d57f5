"""Panels rendered by PyVista."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .color_ranges import round_ticks
from .field_styles import FieldStyle
from .figures import RED, require
from .panels import camera_of
from .scenes import Camera, polygons
from .surfaces import AnySheet, joined_sheets

__all__ = ["add_sheets", "as_polydata", "make_plotter"]

COLORS = {
    "wall": "#8fbbe0",
    "symmetry": "#eef0f1",
    "farfield": "#e3e8ec",
    "overset": "#d5e3d0",
    "other": "#d9d4c7",
    "slice": "#eef0f1",
}
"""Colours of sheets without a field, by kind."""

LINES, CONTROL = "#2b3238", "#cc3311"
"""Colours of grid lines and of the control mesh."""


def make_plotter(
    panels: Sequence[Any],
    camera: Camera | None = None,
    look: FieldStyle | None = None,
    limits: tuple[float, float] = (0.0, 1.0),
    size: tuple[int, int] = (1200, 800),
    *,
    lines: bool = True,
    off_screen: bool = True,
) -> Any:
    """Put the sheets of panels into a plotter of PyVista, by default seen as in `plot`; an error without PyVista."""
    # limits: range of the colours; size: in pixels; lines: whether grid lines are drawn; off_screen: without a window
    pyvista = require("pyvista")
    pyvista.vtk_verbosity("off")
    camera = camera or camera_of(panels, size=size)
    plotter = pyvista.Plotter(off_screen=off_screen, window_size=list(size), shape=(1, len(panels)), border=False)
    plotter.set_background("white")
    for number, panel in enumerate(panels):
        plotter.subplot(0, number)
        add_sheets(plotter, panel.sheets, look, limits, lines=lines)
        if len(panel.marks):
            plotter.add_points(
                panel.marks, color=RED, render_points_as_spheres=True, point_size=12.0 * size[1] / 800, name="worst"
            )
        if len(panels) > 1:
            plotter.add_text(panel.title, font_size=max(4, round(11 * size[1] / 800)), color="black")
        focus, axes = np.array(camera.focus), camera.axes()
        plotter.camera_position = [focus + 4.0 * camera.height * axes[2], focus, axes[1]]
        plotter.camera.parallel_projection = True
        plotter.camera.parallel_scale = 0.5 * camera.height
        plotter.reset_camera_clipping_range()
    plotter.enable_anti_aliasing("ssaa") if off_screen else None
    return plotter


def add_sheets(
    plotter: Any,
    sheets: Sequence[AnySheet],
    look: FieldStyle | None = None,
    limits: tuple[float, float] = (0.0, 1.0),
    *,
    lines: bool = True,
) -> None:
    """Add sheets to a plotter of PyVista, all of one kind as one mesh."""
    edges = {"show_edges": lines, "edge_color": LINES, "line_width": 0.6, "edge_opacity": 0.55}
    for kind in dict.fromkeys(sheet.kind for sheet in sheets):
        of_kind = [sheet for sheet in sheets if sheet.kind == kind]
        if kind == "control mesh":
            mesh = as_polydata(of_kind)
            plotter.add_mesh(mesh, style="wireframe", color=CONTROL, line_width=2.5, name=kind)
            plotter.add_points(mesh.points, color=CONTROL, render_points_as_spheres=True, point_size=10.0)
            continue
        painted = [sheet for sheet in of_kind if look is not None and look.field in sheet.values]
        plain = [sheet for sheet in of_kind if not any(sheet is other for other in painted)]
        light = {"lighting": kind in ("wall", "lattice"), "ambient": 0.35, "diffuse": 0.7}
        if plain:
            plotter.add_mesh(as_polydata(plain), color=COLORS[kind], name=kind, **light, **edges)
        if painted and look is not None and look.field == "patch":
            _add_patches(plotter, painted, light | edges)
        elif painted and look is not None:
            scale = plotter.window_size[1] / 800
            n_steps = round(limits[1] - limits[0]) if look.field == "block" else 256
            bar = {"title": f"{look.label}\n", "color": "black", "n_labels": 5, "title_font_size": round(24 * scale)}
            bar |= {"fmt": "%.0f" if look.field == "block" else "%.4g", "label_font_size": round(21 * scale)}
            bar |= {"width": 0.5, "position_x": 0.25, "height": 0.09, "position_y": 0.02}
            plotter.add_mesh(
                as_polydata(painted, look.field),
                scalars=look.field,
                cmap=look.color_map(limits),
                n_colors=n_steps,
                clim=limits,
                nan_color="#dddddd",
                scalar_bar_args=bar,
                lighting=False,
                name=f"{kind}, {look.field}",
                **edges,
            )
            if look.field != "block":
                _place_ticks(plotter.scalar_bars[bar["title"]], limits)


def _place_ticks(bar: Any, limits: tuple[float, float]) -> None:
    """Put the labels of a colour bar at round numbers."""
    ticks = round_ticks(*limits)
    bar.SetCustomLabels(require("pyvista").convert_array(ticks[(ticks >= limits[0]) & (ticks <= limits[1])]))
    bar.SetUseCustomLabels(True)


def _add_patches(plotter: Any, sheets: Sequence[AnySheet], style: dict) -> None:
    """Add every patch in a colour of its own, and a legend."""
    colors = require("matplotlib").colormaps["tab20"]
    for name in dict.fromkeys(sheet.name for sheet in sheets):
        of_kind = [sheet for sheet in sheets if sheet.name == name]
        number = max(int(sheet.values["patch"].max()) for sheet in of_kind)
        plotter.add_mesh(as_polydata(of_kind), color=colors((number - 1) % 20)[:3], label=name, name=name, **style)
    plotter.add_legend(bcolor="white", border=True, size=(0.22, 0.2), face="rectangle")


def as_polydata(sheets: Sequence[AnySheet], field: str | None = None) -> Any:
    """Join sheets into one mesh of PyVista, with the values of a field on its faces."""
    points, quads = joined_sheets(sheets)
    mesh = require("pyvista").PolyData(points, polygons(quads))
    if field is not None:
        mesh.cell_data[field] = np.concatenate([np.ravel(sheet.values[field]) for sheet in sheets])
    return mesh
