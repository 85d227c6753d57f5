"""One call to look at a grid, a fitted grid or a problem that has run: as PNG, in a window, in a notebook.

PyVista renders where it can; matplotlib draws the same sheets where there is no OpenGL, and for the small pictures that
notebooks show beside a table.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..om.snapshots import Snapshot
from .figures import RED, figure, require
from .scenes import Camera, Paint, Scene, draw_scene, has_renderer
from .sheets import Sheet, control_sheets, flow_sheets, grid_sheets, worst_cells

__all__ = [
    "FIELD_LOOKS",
    "SURFACES",
    "FieldLook",
    "Panel",
    "add_sheets",
    "as_polydata",
    "camera_of",
    "draw_panel",
    "make_plotter",
    "plot",
    "sheets_of",
]

SURFACES = {
    "walls": ("wall",),
    "symmetry": ("symmetry",),
    "farfield": ("farfield",),
    "boundary": ("wall", "symmetry", "farfield", "other"),
    "control mesh": ("control mesh",),
}
"""Names of surfaces, and the kinds of sheets that they are."""


@dataclass(frozen=True)
class FieldLook:
    """How a field is shown.

    Parameters
    ----------
    field : str
        Its name on sheets.
    label : str
        What the colour bar says.
    colors : str
        Colour map of matplotlib.
    is_of_flow : bool
        Whether it needs a problem that has run.
    surfaces : tuple of str
        What is coloured where no surface is named.
    """

    field: str
    label: str
    colors: str
    is_of_flow: bool = False
    surfaces: tuple[str, ...] = ("walls", "symmetry")


FIELD_LOOKS = {
    "quality": FieldLook("Q", "orthogonality Q", "viridis"),
    "corner": FieldLook("smallest_corner", "smallest corner", "viridis"),
    "wall height": FieldLook("wall_height", "height of the first cell (m)", "viridis", surfaces=("walls",)),
    "block": FieldLook("block", "block", "tab20"),
    "patch": FieldLook("patch", "patch", "tab20", surfaces=("boundary",)),
    "Cp": FieldLook("Cp", "pressure coefficient", "RdYlBu_r", True),
    "Mach": FieldLook("Mach", "Mach number", "turbo", True),
    "entropy": FieldLook("entropy", "entropy", "magma", True),
    "total pressure loss": FieldLook("total_pressure_loss", "loss of total pressure", "magma", True),
}
"""Fields that colour the surfaces."""

COLORS = {"wall": "#8fbbe0", "symmetry": "#eef0f1", "farfield": "#e3e8ec", "other": "#d9d4c7"}
"""Colours of sheets without a field, by their kind."""

LINES, CONTROL = "#2b3238", "#cc3311"
"""Colours of grid lines and of the control mesh."""

MOST_MARKED = 10
"""Worst cells that are marked in pictures of the quality."""


def plot(
    what: Any,
    show: str | Sequence[str] | None = None,
    file=None,
    *,
    before: Any = None,
    direction: Sequence[float] | None = None,
    up: Sequence[float] | None = None,
    zoom: float = 1.0,
    size: tuple[int, int] = (1200, 800),
    lines: bool = True,
    worst: int = MOST_MARKED,
):
    """Look at a grid, a fitted grid, or a problem that has run.

    Parameters
    ----------
    what : Grid, FittedModel, openmdao.api.Problem or Snapshot
        What to look at. Of a problem, the grid and the flow that it has now.
    show : str or sequence of str, optional
        Surfaces: ``"walls"``, ``"symmetry"``, ``"farfield"``, ``"boundary"`` (all of these), ``"control mesh"``, and
        names of patches; and one field that colours them: ``"quality"``, ``"corner"``, ``"wall height"``, ``"block"``,
        ``"patch"``, and of a flow ``"Cp"``, ``"Mach"``, ``"entropy"``, ``"total pressure loss"``. By default ``Cp``
        where there is a flow, walls, symmetry plane and control mesh of a fitted grid, and otherwise walls and
        symmetry plane, or the whole boundary where nothing is declared.
    file : path-like, optional
        PNG file to write, instead of a window.
    before : as ``what``, optional
        What it was before: shown beside it, at the left, in the same colours. ``True`` stands for the fitted grid that
        a problem began with.
    direction, up : sequence of three float, optional
        From where, seen from the middle, and which way is up; by default from the front, above and outside, with the
        shortest side of the walls' box up.
    zoom : float
        Larger than 1 to see less, in larger.
    size : tuple of int
        Width and height of the picture, in pixels; twice as wide with ``before``.
    lines : bool
        Whether lines of the grid are drawn.
    worst : int
        Cells with the smallest corners that are marked in pictures of ``"quality"`` and ``"corner"``.

    Returns
    -------
    pathlib.Path or pyvista.Plotter or None
        The file, if there is one; else the plotter of the window, or what a notebook shows.

    Raises
    ------
    InputError
        If there is nothing of the kind to see, the file is no PNG, or the libraries that draw are missing.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from bspline_mdao import onera_m6_grid
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
    camera = camera_of(panels, direction, up, zoom, size)
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


@dataclass(frozen=True, eq=False)
class Panel:
    """One of the pictures side by side.

    Parameters
    ----------
    sheets : list of Sheet
        What is in it.
    marks : ndarray, shape (n, 3)
        Points that are marked (m).
    title : str
        What stands above it.
    """

    sheets: list[Sheet]
    marks: np.ndarray
    title: str

    @classmethod
    def of(cls, state: Snapshot, surfaces: Sequence[str], look: FieldLook | None, worst: int) -> Panel:
        """Cut what is wanted out of a state."""
        marks = np.zeros((0, 3))
        if look is not None and look.field in ("Q", "smallest_corner") and worst:
            marks = worst_cells(state.grid, worst)
        return cls(sheets_of(state, surfaces, look), marks, state.title)


def sheets_of(what: Any, surfaces: Sequence[str], look: FieldLook | str | None = None) -> list[Sheet]:
    """Cut surfaces out of what is looked at, with the field that colours them.

    Parameters
    ----------
    what : Grid, FittedModel, openmdao.api.Problem or Snapshot
        What is looked at.
    surfaces : sequence of str
        Keys of `SURFACES` and names of patches.
    look : FieldLook or str, optional
        One of `FIELD_LOOKS`, or its key.

    Returns
    -------
    list of Sheet

    Raises
    ------
    InputError
        If there is nothing of the kind.
    """
    state = Snapshot.of(what)
    look = FIELD_LOOKS[look] if isinstance(look, str) else look
    topology = None if state.model is None else state.model.topology
    if look is not None and look.is_of_flow:
        if state.model is None or state.pressures is None:
            raise InputError(
                f"{state.title}: there is no flow to show; give a problem with an EulerFlow that has run, such as "
                f"plot(problem, 'Cp')"
            )
        every = flow_sheets(state.model, state.grid, state.pressures, state.states, state.mach)
    else:
        every = grid_sheets(state.grid, look is not None, topology)
    if "control mesh" in surfaces:
        if state.model is None:
            raise InputError(
                f"{state.title}: a grid has no control mesh; fit it first: fit_grid(grid).plot('control mesh')"
            )
        every = every + control_sheets(state.model, state.control_points)
    kinds = {kind for name in surfaces for kind in SURFACES.get(name, ())}
    found = [sheet for sheet in every if sheet.kind in kinds or sheet.name in surfaces]
    if not found:
        there = sorted({sheet.kind for sheet in every} | {sheet.name for sheet in every})
        raise InputError(f"{state.title}: nothing to see of {', '.join(surfaces)}; there is {', '.join(there)}")
    return found


def _before(what: Any, before: Any) -> Snapshot | None:
    """What was before, if that is asked for."""
    if before is None or before is False:
        return None
    if before is True:
        model = Snapshot.of(what).model
        if model is None:
            raise InputError("before=True: a grid does not know what it was before; give that grid")
        return replace(Snapshot.of(model), title="before")
    state = Snapshot.of(before)
    return replace(state, title="before") if state.pressures is None else state


def _wanted(state: Snapshot, show: str | Sequence[str] | None) -> tuple[tuple[str, ...], FieldLook | None]:
    """Surfaces and field that are asked for."""
    names = [show] if isinstance(show, str) else list(show or ())
    known = {patch.name for patch in state.grid.patches}
    unknown = [name for name in names if name not in SURFACES and name not in FIELD_LOOKS and name not in known]
    if unknown:
        raise InputError(
            f"show: no '{unknown[0]}'; choose from {', '.join([*SURFACES, *FIELD_LOOKS])}"
            + (f", and the patches {', '.join(sorted(known))}" if known else "")
        )
    fields = [name for name in names if name in FIELD_LOOKS]
    if len(fields) > 1:
        raise InputError(f"show: one field at a time, not {' and '.join(fields)}")
    kinds = {patch.kind for patch in state.grid.patches}
    if not names and state.pressures is not None:
        fields = ["Cp"]
    look = FIELD_LOOKS[fields[0]] if fields else None
    surfaces = tuple(name for name in names if name not in FIELD_LOOKS)
    if not surfaces:
        surfaces = look.surfaces if look else ("walls", "symmetry")
        if look is None and state.model is not None:
            surfaces = (*surfaces, "control mesh")
        if not kinds & {"wall", "symmetry"} and 1 not in {n for shape in state.grid.shapes for n in shape}:
            surfaces = ("boundary",)
    return surfaces, look


def _limits(panels: Sequence[Panel], look: FieldLook | None) -> tuple[float, float]:
    """Range of the colours: that of all panels."""
    if look is None:
        return 0.0, 1.0
    arrays = [
        sheet.values[look.field].ravel() for panel in panels for sheet in panel.sheets if look.field in sheet.values
    ]
    values = np.concatenate([np.zeros(0), *arrays])
    values = values[np.isfinite(values)]
    if not values.size:
        raise InputError(f"{panels[-1].title}: no {look.label} on what is shown; add the walls")
    if look.is_of_flow:  # one cell at a sharp edge does not take all colours
        low, high = np.quantile(values, [0.002, 0.998])
    else:
        low, high = values.min(), values.max()
    if look.field in ("Q", "smallest_corner"):
        low, high = min(0.0, low), 1.0
    if look.field == "block":
        low, high = low - 0.5, high + 0.5
    return (float(low), float(high)) if high > low else (float(low) - 0.5, float(low) + 0.5)


def camera_of(
    panels: Sequence[Panel],
    direction: Sequence[float] | None = None,
    up: Sequence[float] | None = None,
    zoom: float = 1.0,
    size: tuple[float, float] = (1200, 800),
) -> Camera:
    """Find a place from which all panels are seen: in front of the middle of the walls, from outside.

    Parameters
    ----------
    panels : sequence of Panel
        What is seen.
    direction, up : sequence of three float, optional
        See `plot`.
    zoom : float
        See `plot`.
    size : tuple of float
        Width and height, of which the ratio counts.

    Returns
    -------
    Camera
    """
    sheets = [sheet for panel in panels for sheet in panel.sheets]
    inner = [s for s in sheets if s.kind in ("wall", "control mesh")] or sheets
    points = np.concatenate([sheet.points.reshape(-1, 3) for sheet in inner])
    low, high = points.min(axis=0), points.max(axis=0)
    box = high - low
    rise = np.eye(3)[int(np.argmin(box))] if up is None else np.asarray(up, dtype=float)
    planes, middle = [s for s in sheets if s.kind == "symmetry"], (low + high) / 2
    towards = _from_outside(box, rise, planes, middle) if direction is None else np.asarray(direction, dtype=float)
    camera = Camera(_three(middle), _three(towards), 1.0, _three(rise))
    seen = np.ptp(camera.project(points), axis=0)
    height = 1.25 * max(seen[1], seen[0] * size[1] / size[0], 1e-12) / zoom
    return replace(camera, height=height)


def _three(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _from_outside(box: np.ndarray, up: np.ndarray, planes: Sequence[Sheet], middle: np.ndarray) -> np.ndarray:
    """Direction from the nose, above and, beside a plane of symmetry, the side where the body is."""
    rise = int(np.argmax(np.abs(up)))
    along, across = [d for d in range(3) if d != rise]
    if planes:
        points = np.concatenate([sheet.points.reshape(-1, 3) for sheet in planes])
        thin = int(np.argmin(np.ptp(points, axis=0)))
        if np.ptp(points, axis=0)[thin] < 1e-6 * np.ptp(points, axis=0).max() and thin != rise:
            across, along = thin, 3 - rise - thin
            side = np.sign(middle[thin] - points[:, thin].mean()) or 1.0
            if box[thin] < 0.3 * box[along]:  # a section: seen along its span
                return np.eye(3)[across] * side + 0.15 * np.sign(up.sum()) * np.abs(up) - 0.1 * np.eye(3)[along]
            return side * np.eye(3)[across] - 0.75 * np.eye(3)[along] + 0.65 * up / np.linalg.norm(up)
    return np.eye(3)[across] - 0.75 * np.eye(3)[along] + 0.65 * up / np.linalg.norm(up)


def make_plotter(
    panels: Sequence[Any],
    camera: Camera | None = None,
    look: FieldLook | None = None,
    limits: tuple[float, float] = (0.0, 1.0),
    size: tuple[int, int] = (1200, 800),
    *,
    lines: bool = True,
    off_screen: bool = True,
):
    """Put sheets into a plotter of PyVista.

    Parameters
    ----------
    panels : sequence
        Pictures side by side, each with ``sheets``, ``marks``, and ``title``.
    camera : Camera, optional
        Where they are seen from; by default as `plot` does.
    look : FieldLook, optional
        The field that colours them.
    limits : tuple of float
        Range of the colours.
    size : tuple of int
        Pixels.
    lines : bool
        Whether lines of the grid are drawn.
    off_screen : bool
        Whether there is no window.

    Returns
    -------
    pyvista.Plotter

    Raises
    ------
    InputError
        If PyVista is not installed.
    """
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
    plotter, sheets: Sequence[Sheet], look: FieldLook | None = None, limits=(0.0, 1.0), *, lines: bool = True
) -> None:
    """Add sheets to a plotter of PyVista, those of a kind as one mesh.

    Parameters
    ----------
    plotter : pyvista.Plotter
        Where they go.
    sheets : sequence of Sheet
        What is shown.
    look : FieldLook, optional
        The field that colours them.
    limits : tuple of float
        Range of the colours.
    lines : bool
        Whether lines of the grid are drawn.
    """
    edges = {"show_edges": lines, "edge_color": LINES, "line_width": 0.6, "edge_opacity": 0.55}
    for kind in dict.fromkeys(sheet.kind for sheet in sheets):
        own = [sheet for sheet in sheets if sheet.kind == kind]
        if kind == "control mesh":
            mesh = as_polydata(own)
            plotter.add_mesh(mesh, style="wireframe", color=CONTROL, line_width=2.5, name=kind)
            plotter.add_points(mesh.points, color=CONTROL, render_points_as_spheres=True, point_size=10.0)
            continue
        painted = [sheet for sheet in own if look is not None and look.field in sheet.values]
        plain = [sheet for sheet in own if not any(sheet is other for other in painted)]
        light = {"lighting": kind == "wall", "ambient": 0.35, "diffuse": 0.7}
        if plain:
            plotter.add_mesh(as_polydata(plain), color=COLORS[kind], name=kind, **light, **edges)
        if painted and look is not None and look.field == "patch":
            _add_patches(plotter, painted, light | edges)
        elif painted and look is not None:
            scale = plotter.window_size[1] / 800
            n_steps = round(limits[1] - limits[0]) if look.field == "block" else 256
            bar = {"title": f"{look.label}\n", "color": "black", "n_labels": 5, "title_font_size": round(18 * scale)}
            bar |= {"fmt": "%.0f" if look.field == "block" else "%.2g", "label_font_size": round(15 * scale)}
            bar |= {"width": 0.5, "position_x": 0.25, "height": 0.07, "position_y": 0.02}
            plotter.add_mesh(
                as_polydata(painted, look.field),
                scalars=look.field,
                cmap=look.colors,
                n_colors=n_steps,
                clim=limits,
                nan_color="#dddddd",
                scalar_bar_args=bar,
                lighting=False,
                name=f"{kind}, {look.field}",
                **edges,
            )


def _add_patches(plotter, sheets: Sequence[Sheet], style: dict) -> None:
    """Add every patch in a colour of its own, and a legend."""
    colors = require("matplotlib").colormaps["tab20"]
    for name in dict.fromkeys(sheet.name for sheet in sheets):
        own = [sheet for sheet in sheets if sheet.name == name]
        number = max(int(sheet.values["patch"].max()) for sheet in own)
        plotter.add_mesh(as_polydata(own), color=colors((number - 1) % 20)[:3], label=name, name=name, **style)
    plotter.add_legend(bcolor="white", border=True, size=(0.22, 0.2), face="rectangle")


def as_polydata(sheets: Sequence[Sheet], field: str | None = None):
    """Join sheets to one mesh of PyVista, with the values of a field on its faces."""
    ends = np.cumsum([0, *(sheet.points.size // 3 for sheet in sheets)])
    quads = []
    for start, sheet in zip(ends, sheets):
        ids = start + np.arange(sheet.points.size // 3).reshape(sheet.points.shape[:2])
        quads.append(np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1).reshape(-1, 4))
    points = np.concatenate([sheet.points.reshape(-1, 3) for sheet in sheets])
    mesh = require("pyvista").PolyData(points, np.insert(np.concatenate(quads), 0, 4, axis=1).ravel())
    if field is not None:
        mesh.cell_data[field] = np.concatenate([np.ravel(sheet.values[field]) for sheet in sheets])
    return mesh


def _show(plotter):
    """Show a plotter: in a notebook, in a window, or nowhere, which is said."""
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
    """Tell whether windows can be opened."""
    import os

    return sys.platform in ("win32", "darwin") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _has_trame() -> bool:
    """Whether PyVista has its interactive backend: a package of its own, trame-pyvista, from PyVista 0.48 on."""
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


def _draw(path: Path, panels, camera: Camera, look: FieldLook | None, limits, size) -> None:
    """Draw panels by matplotlib, where PyVista does not render."""
    inches = (size[0] / 200, size[1] / 200)
    with figure(path.parent, path.stem, inches) as canvas:
        columns = canvas.subplots(1, len(panels), squeeze=False)[0]
        for axes, panel in zip(columns, panels):
            draw_panel(axes, panel, camera, look, limits, (inches[0] / len(panels), inches[1]))
            if len(panels) > 1:
                axes.set_title(panel.title)


def draw_panel(axes, panel, camera: Camera, look: FieldLook | None, limits, inches) -> None:
    """Draw the sheets of a panel into empty axes by matplotlib's polygons."""
    painted = [sheet for sheet in panel.sheets if look is not None and look.field in sheet.values]
    rest = [sheet for sheet in panel.sheets if not any(sheet is other for other in painted)]
    walls = [sheet.points for sheet in rest if sheet.kind == "wall"]
    planes = [sheet.points for sheet in rest if sheet.kind not in ("wall", "control mesh")]
    points = [sheet.points.reshape(-1, 3) for sheet in rest if sheet.kind == "control mesh"]
    marks = np.concatenate([panel.marks, *points])
    paint = _paint(painted, look, limits) if painted and look is not None else None
    scene = Scene(walls, planes, marks, line_width=0.2, paint=paint)
    draw_scene(axes, scene, camera, inches, by_matplotlib=True)
    if paint is not None and look is not None:
        axes.figure.colorbar(paint.mappable(), ax=axes, label=look.label, shrink=0.7)


def _paint(sheets: Sequence[Sheet], look: FieldLook, limits) -> Paint:
    """Faces of sheets in the colours of a field."""
    mesh = [sheet.points for sheet in sheets]
    ends = np.cumsum([0, *(points.size // 3 for points in mesh)])
    quads = []
    for start, points in zip(ends, mesh):
        ids = start + np.arange(points.size // 3).reshape(points.shape[:2])
        quads.append(np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1).reshape(-1, 4))
    values = np.concatenate([np.ravel(sheet.values[look.field]) for sheet in sheets]).astype(float)
    points = np.concatenate([points.reshape(-1, 3) for points in mesh])
    return Paint(points, np.concatenate(quads), values, limits, look.colors)
