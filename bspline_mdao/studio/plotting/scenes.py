"""Surfaces with their grid lines, seen in space: rendered by PyVista if possible, otherwise drawn by matplotlib."""

from __future__ import annotations

import functools
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ...base.extras import INSTALL
from ...core.model.fitted_model import FittedModel
from ...grids.topology.index_space import Window
from .color_ranges import color_map_about_zero
from .figures import RED, net_quads, require

__all__ = ["Camera", "Faces", "Paint", "Scene", "draw_scene", "has_renderer", "patch_faces", "polygons"]

WALL, PLANE = ("#9fc3e3", "#2b3238"), ("#fbfbfb", "#5d666e")
"""Colours of the body and of the symmetry plane, each with the colour of its lines."""

LIGHT = np.array([-0.35, 0.8, 0.5])
"""Direction towards the light of pictures by matplotlib; PyVista has its own."""

DISC = np.exp(2j * np.pi * np.arange(16) / 16)
"""Corners of a mark, as complex numbers."""

DPI = 200
"""Dots per inch of rendered pictures, the same as in the files of `figure`."""

MARK = 0.0075
"""Radius of a mark, relative to the height of the picture."""


class Faces(NamedTuple):
    """Unstructured faces."""

    points: np.ndarray  # (n, 3), their points (m)
    quads: np.ndarray  # int (m, 4), corners of each; triangles repeat their last corner


@dataclass(frozen=True)
class Paint:
    """Faces coloured by a scalar.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Corners (m).
    quads : ndarray of int, shape (m, 4)
        Numbers of the corners of each face.
    values : ndarray, shape (m,)
        The scalar.
    limits : tuple of float
        Range of the colours.
    colors : str or matplotlib.colors.Colormap, optional
        Colour map of matplotlib; by default blue below zero, white at zero and red above.
    """

    points: np.ndarray
    quads: np.ndarray
    values: np.ndarray
    limits: tuple[float, float]
    colors: Any = None

    def color_map(self) -> Any:
        """Return the colour map of matplotlib, or its name."""
        return color_map_about_zero(self.limits) if self.colors is None else self.colors

    def mappable(self) -> Any:
        """Make the argument of matplotlib's ``colorbar``."""
        return require("matplotlib.cm").ScalarMappable(
            require("matplotlib.colors").Normalize(*self.limits), self.color_map()
        )


@dataclass(frozen=True)
class Scene:
    """Surfaces of a body and a plane of symmetry, with marks and colours.

    Parameters
    ----------
    walls, planes : list of ndarray, each of shape (n, m, 3), or of Faces
        Nets of points on the body and on the symmetry plane (m), or faces there.
    marks : ndarray, shape (n, 3)
        Points that are marked with red spheres (m).
    line_width : float
        Width of the lines of the nets, in points.
    paint : Paint, optional
        Faces in the colours of a scalar.
    """

    walls: Sequence[np.ndarray | Faces]
    planes: Sequence[np.ndarray | Faces]
    marks: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    line_width: float = 0.3
    paint: Paint | None = None


@dataclass(frozen=True)
class Camera:
    """Viewpoint of a scene, in parallel projection.

    Parameters
    ----------
    focus : tuple of float
        Point at the centre of the picture (m).
    direction : tuple of float
        From there towards the camera.
    height : float
        Height of the visible part (m).
    up : tuple of float
        Upward direction of the picture; y by default.
    """

    focus: tuple[float, float, float]
    direction: tuple[float, float, float]
    height: float
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)

    def axes(self) -> np.ndarray:
        """Directions to the right, upwards and towards the camera, as rows."""
        towards = np.array(self.direction) / np.linalg.norm(self.direction)
        right = np.cross(self.up, towards)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(towards, right), towards])

    def project(self, points: np.ndarray) -> np.ndarray:
        """Coordinates to the right, upwards and towards the camera from the focus."""
        return (points - np.array(self.focus)) @ self.axes().T


def patch_faces(model: FittedModel, name: str, arrays: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Cut the faces of patches out of one array per block.

    Parameters
    ----------
    model : FittedModel
        The fitted grid, with patches.
    name : str
        Beginning of the names of the patches.
    arrays : sequence of ndarray, one per block
        At any resolution: nodes of the blocks, control points by ``model.mesh.nets``, or their ids.

    Returns
    -------
    list of ndarray
        One face per window of the patches.
    """
    windows = [w for patch in model.header.patches if patch.name.startswith(name) for w in patch.windows]
    return [_cut_face(arrays[window.block], window) for window in windows]


def draw_scene(axes: Any, scene: Scene, camera: Camera, size: tuple[float, float], by_matplotlib: bool = False) -> str:
    """Draw a scene into empty axes of a figure.

    Parameters
    ----------
    axes : matplotlib axes
        Where to draw.
    scene : Scene
        What to draw.
    camera : Camera
        Where it is seen from.
    size : tuple of float
        Width and height of the picture in inches.
    by_matplotlib : bool
        Draw polygons, which is fast for small scenes, even if PyVista can render.

    Returns
    -------
    str
        The library that drew it, ``"pyvista"`` or ``"matplotlib"``.

    Raises
    ------
    InputError
        If matplotlib is not installed.
    """
    require()
    axes.set(xticks=[], yticks=[], aspect="equal")
    height, width = camera.height, camera.height * size[0] / size[1]
    axes.set(xlim=(-width / 2, width / 2), ylim=(-height / 2, height / 2))
    if not by_matplotlib and has_renderer():
        image = _rendered(scene, camera, size)
        axes.imshow(image, extent=(-width / 2, width / 2, -height / 2, height / 2), interpolation="lanczos")
        return "pyvista"
    _draw_polygons(axes, scene, camera)
    return "matplotlib"


@functools.cache
def has_renderer() -> bool:
    """Return whether PyVista renders here: another process tries once, as PyVista ends its process without OpenGL."""
    trial = "import pyvista; p = pyvista.Plotter(off_screen=True); p.add_mesh(pyvista.Sphere()); p.screenshot()"
    done = subprocess.run([sys.executable, "-c", trial], capture_output=True, text=True)
    if done.returncode == 0:
        return True
    reason = (
        INSTALL.format(extra="pictures")
        if "ModuleNotFoundError" in done.stderr
        else "install libegl1 and libgl1-mesa-dri"
    )
    print(f"drawn with matplotlib; for rendered pictures {reason}", file=sys.stderr)
    return False


def _rendered(scene: Scene, camera: Camera, size: tuple[float, float]) -> np.ndarray:
    """Image of a scene by PyVista, off screen."""
    pyvista = require("pyvista")

    pyvista.vtk_verbosity("off")
    plotter = pyvista.Plotter(off_screen=True, window_size=[round(DPI * inches) for inches in size])
    lines = {"show_edges": True, "line_width": scene.line_width * DPI / 72}
    for net in scene.planes:
        plotter.add_mesh(_surface(net), color=PLANE[0], edge_color=PLANE[1], lighting=False, **lines)
    for net in scene.walls:
        plotter.add_mesh(_surface(net), color=WALL[0], edge_color=WALL[1], ambient=0.35, diffuse=0.7, **lines)
    if len(scene.marks):
        sphere = pyvista.Sphere(radius=MARK * camera.height)
        marks = pyvista.PolyData(scene.marks).glyph(geom=sphere, scale=False, orient=False)
        plotter.add_mesh(marks, color=RED, smooth_shading=True, specular=0.3)
    if scene.paint is not None:
        _add_paint(plotter, scene.paint)
    focus, direction = np.array(camera.focus), camera.axes()[2]
    plotter.camera_position = [focus + 4.0 * camera.height * direction, focus, camera.up]
    plotter.camera.parallel_projection = True
    plotter.camera.parallel_scale = 0.5 * camera.height
    plotter.enable_anti_aliasing("ssaa")
    image = plotter.screenshot(return_img=True)
    plotter.close()
    return image


def polygons(quads: np.ndarray) -> np.ndarray:
    """Faces as PyVista takes them: the number of corners of each, followed by the corners."""
    n = np.where(quads[:, 2] == quads[:, 3], 3, 4)
    rows = np.column_stack([n, quads])
    return rows[np.arange(5) <= n[:, None]]


def _surface(net: np.ndarray | Faces) -> Any:
    """Turn a net or faces into a mesh of PyVista."""
    if isinstance(net, Faces):
        return require("pyvista").PolyData(net.points, polygons(net.quads))
    return require("pyvista").StructuredGrid(*np.moveaxis(net[:, :, None], -1, 0))


def _add_paint(plotter: Any, paint: Paint) -> None:
    """Add faces in colours that change smoothly from one to the next."""
    mesh = require("pyvista").PolyData(paint.points, polygons(paint.quads))
    mesh.cell_data["scalar"] = paint.values
    mesh = mesh.cell_data_to_point_data()
    look = {"cmap": paint.color_map(), "clim": paint.limits, "show_scalar_bar": False}
    plotter.add_mesh(mesh, scalars="scalar", lighting=False, n_colors=256, **look)


def _draw_polygons(axes: Any, scene: Scene, camera: Camera) -> None:
    """Draw everything as polygons, the farthest first."""
    parts = [_quads(net, camera, *PLANE, lit=0.0) for net in scene.planes]
    parts += [_quads(net, camera, *WALL, lit=0.45) for net in scene.walls]
    parts.append(_discs(scene.marks, camera))
    if scene.paint is not None:
        parts.append(_painted(scene.paint, camera))
    polygons = [polygon for part in parts for polygon in part[0]]
    depth, faces, edges = (np.concatenate(arrays) for arrays in list(zip(*parts))[1:])
    order = np.argsort(depth, kind="stable")
    collection = require("matplotlib.collections").PolyCollection(
        [polygons[n] for n in order], facecolors=faces[order], edgecolors=edges[order]
    )
    collection.set(linewidth=scene.line_width, rasterized=True)
    axes.add_collection(collection, autolim=False)


def _quads(net: np.ndarray | Faces, camera: Camera, face: str, edge: str, lit: float) -> tuple[np.ndarray, ...]:
    """Quadrilaterals of a net on the picture, their depths and the colours of their faces and edges."""
    corners = net.points[net.quads] if isinstance(net, Faces) else net_quads(net)
    flat = camera.project(corners)
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-300
    normal *= np.where(normal @ camera.axes()[2] < 0.0, -1.0, 1.0)[:, None]  # the visible side
    to_rgb = require("matplotlib.colors").to_rgb
    shade = 1.0 - lit * (1.0 - np.clip(normal @ (LIGHT / np.linalg.norm(LIGHT)), 0.0, 1.0))
    faces = shade[:, None] * np.array(to_rgb(face))
    return flat[..., :2], flat[..., 2].mean(axis=1), faces, np.broadcast_to(to_rgb(edge), faces.shape)


def _painted(paint: Paint, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Faces on the picture, their depths, and the colours of faces and edges."""
    flat = camera.project(paint.points[paint.quads])
    colors = paint.mappable().to_rgba(paint.values)[:, :3]
    return flat[..., :2], flat[..., 2].mean(axis=1), colors, colors


def _discs(marks: np.ndarray, camera: Camera) -> tuple[np.ndarray, ...]:
    """Discs at the marks, their depths and the colours of their faces and edges."""
    flat, radius = camera.project(marks), MARK * camera.height
    polygons = flat[:, None, :2] + radius * np.stack([DISC.real, DISC.imag], axis=-1)
    faces = np.broadcast_to(require("matplotlib.colors").to_rgb(RED), (len(marks), 3))
    return polygons, flat[:, 2] + 3.0 * radius, faces, 0.6 * faces


def _cut_face(array: np.ndarray, window: Window) -> np.ndarray:
    """Cut the face that contains a window of the grid out of an array of any resolution."""
    flat = next(d for d in range(3) if window.lo[d] == window.hi[d])
    return np.take(array, 0 if window.lo[flat] == 0 else -1, axis=flat)
