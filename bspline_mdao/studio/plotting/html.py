"""Notebook views of objects: a small table, and a picture if it can be drawn quickly."""

from __future__ import annotations

import base64
import importlib.util
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from html import escape
from typing import Any

import numpy as np

from ...core.background.mesh_model import MeshModel
from ...core.model.fitted_model import FittedModel
from ...flow.om.snapshots import Snapshot
from ...grids.cells.report import QualityReport
from ...grids.topology.grid import Grid, Patch
from .figures import BLUE, STYLE, require
from .panels import Panel, camera_of
from .plot import draw_panel
from .surfaces import AnySheet, Sheet
from .thinned_surface import thinned
from .view import view_of

__all__ = ["html_of"]

MOST_FACES = 4000
"""Largest number of faces in a picture: grid lines are left out above it, so that it takes a moment."""

LARGEST = 2_000_000
"""Largest number of nodes of a grid that is drawn at all."""

INCHES = (3.4, 2.3)
"""Size of a picture."""


def html_of(what: Any) -> str:
    """HTML table of a model, grid or report of quality, with a picture next to it if it can be drawn quickly."""
    rows, picture = _rows(what), ""
    try:
        if importlib.util.find_spec("matplotlib") is not None:
            picture = _histogram(what) if isinstance(what, QualityReport) else _drawn(what)
    except Exception:  # a table is better than nothing, whatever is wrong with the picture
        picture = ""
    table = "".join(f"<tr><td>{escape(name)}</td><td>{escape(str(value))}</td></tr>" for name, value in rows)
    image = f'<img alt="{escape(repr(what))}" src="data:image/png;base64,{picture}"/>' if picture else ""
    return (
        f'<div style="display:flex;align-items:center;gap:1.5em;flex-wrap:wrap"><div><b>{escape(type(what).__name__)}'
        f"</b><table>{table}</table></div>{image}</div>"
    )


def _rows(what: Any) -> Iterable[tuple[str, Any]]:
    """Names and values of the table."""
    if isinstance(what, FittedModel):
        yield from _grid_rows(what.header.source, what.topology.shapes, what.n_nodes, what.header.patches)
        yield "control points", f"{what.mesh.n_control_points:,}"
        yield "RMS of the fit", f"{what.report.rms:.2e} m, {what.report.relative_rms:.1e} of a cell's edge"
        yield "invalid elements", f"{what.report.n_invalid:,}"
    elif isinstance(what, MeshModel):
        mesh, lattice = what.mesh, what.lattice
        yield "mesh", mesh.source
        yield "nodes", f"{mesh.n_stored:,}"
        yield "cells", ", ".join(f"{n:,} {kind}" for kind, n in mesh.cell_counts.items())
        yield "markers", ", ".join(f"{name} ({what.kinds[name]})" for name in mesh.markers or {})
        yield "lattice", f"{lattice.n_control:,} control points, spans of {lattice.spacing:.3g} m"
    elif isinstance(what, Grid):
        yield from _grid_rows(what.source, what.shapes, what.n_nodes, what.patches)
    else:
        yield "cells", f"{what.n_cells:,}"
        yield "smallest, mean Q", f"{what.q_min:.3g}, {what.q_mean:.3g}"
        yield "smallest corner", f"{what.min_corner:.3g}"
        yield "smallest volume", f"{what.min_volume:.3g} m³"
        yield "inverted cells", f"{what.n_inverted:,}"
        for heights in what.heights:
            yield f"first cells at {heights.patch}", f"{heights.height_min:.2e} to {heights.height_max:.2e} m"


def _grid_rows(
    source: str, shapes: Sequence[tuple[int, ...]], n_nodes: int, patches: Sequence[Patch]
) -> Iterable[tuple[str, Any]]:
    """Rows for any grid."""
    yield "grid", source
    yield "blocks", f"{len(shapes)}"
    yield "nodes", f"{n_nodes:,}"
    yield "patches", ", ".join(dict.fromkeys(patch.name for patch in patches)) or "none declared"


def _drawn(what: FittedModel | MeshModel | Grid) -> str:
    """Picture of the walls and planes of symmetry."""
    if what.n_nodes > LARGEST:
        return ""
    state = Snapshot.of(what)
    view = view_of(state.grid, state)
    if not view.kinds and not view.is_planar:
        return ""  # finding faces without a neighbour may take long
    sheets = [sheet for sheet in view.sheets((), None) if sheet.kind in ("wall", "symmetry")]
    n_faces = sum(len(sheet.quads) for sheet in sheets)
    sheets = [_thinned(sheet, n_faces) for sheet in sheets]
    panel = Panel(sheets, np.zeros((0, 3)), "")
    return _png(lambda axes: draw_panel(axes, panel, camera_of([panel], size=INCHES), None, (0.0, 1.0), INCHES))


def _thinned(sheet: AnySheet, n_faces: int) -> AnySheet:
    """Fewer faces of a sheet, at the same step for all: every n-th line, its edges among them, or larger triangles."""
    if isinstance(sheet, Sheet):
        step = max(1, int(np.ceil(np.sqrt(n_faces / MOST_FACES))))
        rows, columns = (np.unique(np.append(np.arange(0, n, step), n - 1)) for n in sheet.points.shape[:2])
        return Sheet(sheet.name, sheet.kind, sheet.points[np.ix_(rows, columns)], sheet.window)
    if n_faces <= MOST_FACES:
        return sheet
    triangles = np.concatenate([sheet.quads[:, [0, 1, 2]], sheet.quads[:, [0, 2, 3]]])
    triangles = triangles[triangles[:, 1] != triangles[:, 2]]
    most = MOST_FACES * len(sheet.quads) // n_faces
    fewer = thinned(sheet.corners, triangles, np.zeros(len(triangles), dtype=int), most)
    return replace(sheet, quads=fewer[:, [0, 1, 2, 2]])


def _histogram(report: QualityReport) -> str:
    """Picture of the distribution of Q."""

    def draw(axes: Any) -> None:
        edges = report.histogram.edges
        axes.bar(edges[:-1], report.histogram.density, np.diff(edges), align="edge", color=BLUE)
        axes.set(xlabel="Q", ylabel="density of cells", xlim=(0.0, 1.0))

    return _png(draw)


def _png(draw: Callable[[Any], None]) -> str:
    """Bytes, in base 64, of a small picture."""
    with require().rc_context(STYLE):
        canvas = require("matplotlib.figure").Figure(figsize=INCHES, layout="constrained")
        draw(canvas.subplots())
        file = io.BytesIO()
        canvas.savefig(file, format="png", dpi=110)
    return base64.b64encode(file.getvalue()).decode()
