"""One call to plot a grid, a fitted grid or a problem that has been run: as PNG, in a window, in a notebook.

PyVista renders if it can. Matplotlib draws the same sheets without OpenGL, and the small pictures that notebooks show
next to a table.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...flow.om.snapshots import Snapshot
from .color_ranges import round_ticks
from .field_styles import SURFACES, FieldStyle
from .figures import figure, require
from .panels import Panel, camera_of
from .plotter import make_plotter
from .scenes import Camera, Faces, Paint, Scene, draw_scene, has_renderer
from .surfaces import AnySheet, joined_sheets
from .view import view_of

__all__ = ["draw_panel", "plot"]

MOST_MARKED = 10
"""Number of worst cells that are marked in pictures of the quality."""


def plot(
    what: Any,
    show: str | Sequence[str] | None = None,
    file: str | os.PathLike | None = None,
    *,
    before: Any = None,
    direction: Sequence[float] | None = None,
    up: Sequence[float] | None = None,
    zoom: float = 1.0,
    focus: Sequence[float] | None = None,
    size: tuple[int, int] = (1200, 800),
    lines: bool = True,
    worst: int = MOST_MARKED,
) -> Any:
    """Plot a grid, a fitted grid, or a problem that has been run.

    Parameters
    ----------
    what : Grid, MixedMesh, FittedModel, MeshModel, openmdao.api.Problem or Snapshot
        What to look at. For a problem, the current grid and flow.
    show : str or sequence of str, optional
        Surfaces: ``"walls"``, ``"symmetry"``, ``"farfield"``, ``"boundary"`` (all of these), ``"control mesh"``, and
        names of patches; and one field that colours them: ``"quality"``, ``"corner"``, ``"wall height"``, ``"block"``,
        ``"patch"``, and for a flow ``"Cp"``, ``"Mach"``, ``"entropy"``, ``"total pressure loss"``, or
        for a `LatticeFlow` ``"delta_Cp"`` on its ``"lattice"``. Unstructured meshes also have slices, such as
        ``"slice z=0.4"``, and the fields ``"quality"`` (the non-orthogonality), ``"pyramid"`` (the smallest pyramid of
        each cell relative to the baseline), ``"displacement"``, ``"wall height"`` and ``"patch"``. By default ``Cp``
        if there is a flow; walls, symmetry plane and control mesh for a fitted grid; and otherwise walls and symmetry
        plane, or the whole boundary if no patches are declared.
    file : path-like, optional
        PNG file to write, instead of a window.
    before : as ``what``, optional
        The state before, shown on the left in the same colours. ``True`` stands for the fitted grid that a problem
        started from.
    direction, up : sequence of three float, optional
        Direction from the middle to the viewer, and the upward direction. By default the view is from the front, above
        and outside, with the shortest side of the walls' box up.
    zoom : float
        Larger than 1 to show less, enlarged.
    focus : sequence of three float, optional
        Centre of the picture (m); by default the middle of the walls.
    size : tuple of int
        Width and height of the picture, in pixels; twice as wide with ``before``.
    lines : bool
        Whether grid lines are drawn.
    worst : int
        Number of cells with the smallest corners to mark in pictures of ``"quality"`` and ``"corner"``.

    Returns
    -------
    pathlib.Path or pyvista.Plotter or None
        The file, if one is given; else the plotter of the window, or what a notebook shows.

    Raises
    ------
    InputError
        If there is no such surface or field, the file is not a PNG file, or the plotting libraries are missing.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> path = pathlib.Path(tempfile.mkdtemp(), "wing.png")
    >>> onera_m6_grid((9, 9, 7)).plot("quality", file=path, size=(300, 200)).name  # doctest: +SKIP
    'wing.png'
    """
    if file is not None and Path(file).suffix.lower() != ".png":
        raise InputError(f"{file}: pictures are PNG files; name it {Path(file).with_suffix('.png').name}")
    if file is not None and not Path(file).absolute().parent.is_dir():
        raise InputError(f"{file}: there is no folder '{Path(file).parent}'; make it first")
    what, before = Snapshot.of(what), _before(what, before)
    surfaces, look = _wanted(what, show)
    panels = [Panel.of(state, surfaces, look, worst) for state in (before, what) if state is not None]
    limits = _limits(panels, look)
    camera = camera_of(panels, direction, up, zoom, size, focus)
    size = (size[0] * len(panels), size[1])
    if file is None:
        return _show(make_plotter(panels, camera, look, limits, size, lines=lines, off_screen=_in_notebook()))
    if has_renderer():
        plotter = make_plotter(panels, camera, look, limits, size, lines=lines, off_screen=True)
        plotter.screenshot(str(file))
        plotter.close()
    else:
        _draw(Path(file), panels, camera, look, limits, size)
    return Path(file)


def _before(what: Any, before: Any) -> Snapshot | None:
    """The state before, if requested."""
    if before is None or before is False:
        return None
    if before is True:
        model = Snapshot.of(what).model
        if model is None:
            raise InputError("before=True: a grid does not know what it was before; give that grid")
        return replace(Snapshot.of(model), title="before")
    state = Snapshot.of(before)
    return replace(state, title="before") if state.pressures is None else state


def _wanted(state: Snapshot, show: str | Sequence[str] | None) -> tuple[tuple[str, ...], FieldStyle | None]:
    """The requested surfaces and field."""
    view = view_of(state.grid, state)
    names = [show] if isinstance(show, str) else list(show or ())
    styles, known = view.styles, {*view.kinds}
    unknown = [n for n in names if not (n in SURFACES or n in styles or n in known or view.knows(n))]
    if unknown:
        raise InputError(
            f"show: no '{unknown[0]}'; choose from {', '.join([*SURFACES, *styles])}"
            + (f", and the patches {', '.join(sorted(known))}" if known else "")
        )
    fields = [name for name in names if name in styles]
    if len(fields) > 1:
        raise InputError(f"show: one field at a time, not {' and '.join(fields)}")
    if not names and state.pressures is not None:
        fields = ["Cp"]
    look = styles[fields[0]] if fields else None
    surfaces = tuple(name for name in names if name not in styles)
    if not surfaces:
        surfaces = look.surfaces if look else view.defaults
        if not {*view.kinds.values()} & {"wall", "symmetry"} and not view.is_planar:
            surfaces = ("boundary",)
    return surfaces, look


def _limits(panels: Sequence[Panel], look: FieldStyle | None) -> tuple[float, float]:
    """Range of the colours, over all panels."""
    if look is None:
        return 0.0, 1.0
    arrays = [
        sheet.values[look.field].ravel() for panel in panels for sheet in panel.sheets if look.field in sheet.values
    ]
    values = np.concatenate([np.zeros(0), *arrays])
    values = values[np.isfinite(values)]
    if not values.size:
        raise InputError(f"{panels[-1].title}: no {look.label} on what is shown; add the walls")
    if look.is_of_flow:  # a single cell at a sharp edge must not take up the whole range
        low, high = np.quantile(values, [0.002, 0.998])
    else:
        low, high = values.min(), values.max()
    if look.field in ("Q", "smallest_corner"):
        low, high = min(0.0, low), 1.0
    if look.field == "block":
        return float(low) - 0.5, float(high) + 0.5
    if look.is_about_zero:
        low, high = min(0.0, low), max(0.0, high)
    if not high > low:
        return float(low) - 0.5, float(low) + 0.5
    ticks = round_ticks(low, high)
    return float(ticks[0]), float(ticks[-1])


def _show(plotter: Any) -> Any:
    """Show a plotter in a notebook or in a window; an error if there is neither."""
    if _in_notebook():
        try:
            return plotter.show(jupyter_backend="trame" if _has_trame() else "static", return_viewer=True)
        except Exception:
            return plotter.show(jupyter_backend="static", return_viewer=True)
    if not has_screen():
        raise InputError("there is no screen here; write a picture: plot(..., file='picture.png')")
    plotter.show()
    return plotter


def has_screen() -> bool:
    """Return whether windows can be opened."""
    import os

    return sys.platform in ("win32", "darwin") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _has_trame() -> bool:
    """Whether PyVista has its interactive backend: a separate package, trame-pyvista, from PyVista 0.48 on."""
    import importlib.util

    registered = getattr(require("pyvista"), "registered_jupyter_backends", None)
    if registered is not None:
        return "trame" in {backend.name for backend in registered()}
    return all(importlib.util.find_spec(name) for name in ("trame", "trame_vtk", "trame_vuetify", "ipywidgets"))


def _in_notebook() -> bool:
    """Whether a notebook shows what is returned."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return type(shell).__name__ == "ZMQInteractiveShell"


def _draw(
    path: Path,
    panels: Sequence[Panel],
    camera: Camera,
    look: FieldStyle | None,
    limits: tuple[float, float],
    size: tuple[int, int],
) -> None:
    """Draw panels with matplotlib, if PyVista cannot render."""
    inches = (size[0] / 200, size[1] / 200)
    with figure(path.parent, path.stem, inches) as canvas:
        columns = canvas.subplots(1, len(panels), squeeze=False)[0]
        for axes, panel in zip(columns, panels):
            draw_panel(axes, panel, camera, look, limits, (inches[0] / len(panels), inches[1]))
            if len(panels) > 1:
                axes.set_title(panel.title)


def draw_panel(
    axes: Any,
    panel: Panel,
    camera: Camera,
    look: FieldStyle | None,
    limits: tuple[float, float],
    inches: tuple[float, float],
) -> None:
    """Draw the sheets of a panel into empty axes as polygons of matplotlib."""
    painted = [sheet for sheet in panel.sheets if look is not None and look.field in sheet.values]
    rest = [sheet for sheet in panel.sheets if not any(sheet is other for other in painted)]
    walls = [Faces(sheet.corners, sheet.quads) for sheet in rest if sheet.kind == "wall"]
    planes = [Faces(sheet.corners, sheet.quads) for sheet in rest if sheet.kind not in ("wall", "control mesh")]
    points = [sheet.corners for sheet in rest if sheet.kind == "control mesh"]
    marks = np.concatenate([panel.marks, *points])
    paint = _paint(painted, look, limits) if painted and look is not None else None
    scene = Scene(walls, planes, marks, line_width=0.2, paint=paint)
    draw_scene(axes, scene, camera, inches, by_matplotlib=True)
    if paint is not None and look is not None:
        axes.figure.colorbar(paint.mappable(), ax=axes, label=look.label, shrink=0.7)


def _paint(sheets: Sequence[AnySheet], look: FieldStyle, limits: tuple[float, float]) -> Paint:
    """Faces of sheets in the colours of a field."""
    values = np.concatenate([np.ravel(sheet.values[look.field]) for sheet in sheets]).astype(float)
    return Paint(*joined_sheets(sheets), values, limits, look.color_map(limits))
