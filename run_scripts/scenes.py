"""Pictures of surfaces with their grid lines, seen in space: with PyVista where it can render, else with matplotlib."""

from __future__ import annotations

import functools
import subprocess
import sys
from dataclasses import dataclass, field

import numpy as np
from common import RED
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgb

from bspline_mdao import FittedModel

WALL, PLANE = ("#9fc3e3", "#2b3238"), ("#fbfbfb", "#5d666e")
"""Colours of the body and of the symmetry plane, each with that of its lines."""

_LIGHT = np.array([-0.35, 0.8, 0.5])
_DISC = np.exp(2j * np.pi * np.arange(16) / 16)
_DPI = 200


@dataclass(frozen=True)
class Paint:
    """Faces in the colours of a scalar.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Corners (m).
    quads : ndarray of int, shape (m, 4)
        Numbers of the corners of each face.
    values : ndarray, shape (m,)
        The scalar.
    norm : matplotlib.colors.Normalize
        Range of the colours.
    """

    points: np.ndarray
    quads: np.ndarray
    values: np.ndarray
    norm: Normalize
    colors = "RdYlBu_r"

    def mappable(self) -> ScalarMappable:
        """What a colour bar is made of."""
        return ScalarMappable(self.norm, self.colors)


@dataclass(frozen=True)
class Scene:
    """What is drawn.

    Parameters
    ----------
    walls, planes : list of ndarray, each of shape (n, m, 3)
        Nets of points on the body and on the symmetry plane (m).
    marks : ndarray, shape (n, 3)
        Points that are marked with red spheres (m).
    line_width : float
        Of the lines of the nets, in points.
    paint : Paint, optional
        Faces in the colours of a scalar.
    """

    walls: list[np.ndarray]
    planes: list[np.ndarray]
    marks: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    line_width: float = 0.3
    paint: Paint | None = None


@dataclass(frozen=True)
class Camera:
    """Where a scene is seen from, in parallel projection with y upwards.

    Parameters
    ----------
    focus : tuple of float
        Point in the middle of the picture (m).
    direction : tuple of float
        From there towards the camera.
    height : float
        Of what the picture shows (m).
    """

    focus: tuple[float, float, float]
    direction: tuple[float, float, float]
    height: float

    def axes(self) -> np.ndarray:
        """Directions to the right, upwards and towards the camera, as rows."""
        towards = np.array(self.direction) / np.linalg.norm(self.direction)
        right = np.cross([0.0, 1.0, 0.0], towards)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(towards, right), towards])

    def project(self, points: np.ndarray) -> np.ndarray:
        """Coordinates to the right, upwards and towards the camera from the focus."""
        return (points - np.array(self.focus)) @ self.axes().T


def faces_of(model: FittedModel, name: str, arrays) -> list[np.ndarray]:
    """Cut the faces of the patches whose name begins with ``name`` out of one array per block.

    The arrays may have any resolution, that of the grid or of the control mesh.
    """
    windows = [w for patch in model.header.patches if patch.name.startswith(name) for w in patch.windows]
    return [_face_of(arrays[window.block], window) for window in windows]


def draw_scene(axes, scene: Scene, camera: Camera, size: tuple[float, float]) -> str:
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

    Returns
    -------
    str
        What drew it, ``"pyvista"`` or ``"matplotlib"``.
    """
    axes.set(xticks=[], yticks=[], aspect="equal")
    height, width = camera.height, camera.height * size[0] / size[1]
    axes.set(xlim=(-width / 2, width / 2), ylim=(-height / 2, height / 2))
    if has_renderer():
        image = _rendered(scene, camera, size)
        axes.imshow(image, extent=(-width / 2, width / 2, -height / 2, height / 2), interpolation="lanczos")
        return "pyvista"
    _draw_polygons(axes, scene, camera)
    return "matplotlib"


@functools.cache
def has_renderer() -> bool:
    """Tell whether PyVista renders here: without an OpenGL library it ends the process, so another one tries."""
    trial = "import pyvista; p = pyvista.Plotter(off_screen=True); p.add_mesh(pyvista.Sphere()); p.screenshot()"
    done = subprocess.run([sys.executable, "-c", trial], capture_output=True, text=True)
    if done.returncode == 0:
        return True
    reason = "pip install pyvista" if "ModuleNotFoundError" in done.stderr else "install libegl1 and libgl1-mesa-dri"
    print(f"drawn with matplotlib; for rendered pictures {reason}", file=sys.stderr)
    return False


def _rendered(scene, camera, size) -> np.ndarray:
    """Image of a scene by PyVista, off screen."""
    import pyvista

    pyvista.vtk_verbosity("off")
    plotter = pyvista.Plotter(off_screen=True, window_size=[round(_DPI * inches) for inches in size])
    lines = {"show_edges": True, "line_width": scene.line_width * _DPI / 72}
    for net in scene.planes:
        plotter.add_mesh(_surface(net), color=PLANE[0], edge_color=PLANE[1], lighting=False, **lines)
    for net in scene.walls:
        plotter.add_mesh(_surface(net), color=WALL[0], edge_color=WALL[1], ambient=0.35, diffuse=0.7, **lines)
    if len(scene.marks):
        sphere = pyvista.Sphere(radius=_mark_radius(camera))
        marks = pyvista.PolyData(scene.marks).glyph(geom=sphere, scale=False, orient=False)
        plotter.add_mesh(marks, color=RED, smooth_shading=True, specular=0.3)
    if scene.paint is not None:
        _add_paint(plotter, scene.paint)
    focus, direction = np.array(camera.focus), camera.axes()[2]
    plotter.camera_position = [focus + 4.0 * camera.height * direction, focus, (0.0, 1.0, 0.0)]
    plotter.camera.parallel_projection = True
    plotter.camera.parallel_scale = 0.5 * camera.height
    plotter.enable_anti_aliasing("ssaa")
    image = plotter.screenshot(return_img=True)
    plotter.close()
    return image


def _surface(net: np.ndarray):
    """A net as PyVista takes it."""
    import pyvista

    return pyvista.StructuredGrid(*np.moveaxis(net[:, :, None], -1, 0))


def _add_paint(plotter, paint: Paint) -> None:
    """Add faces in colours that change smoothly from one to the next."""
    import pyvista

    faces = np.insert(paint.quads, 0, 4, axis=1)
    mesh = pyvista.PolyData(paint.points, faces.ravel())
    mesh.cell_data["scalar"] = paint.values
    mesh = mesh.cell_data_to_point_data()
    look = {"cmap": paint.colors, "clim": (paint.norm.vmin, paint.norm.vmax), "show_scalar_bar": False}
    plotter.add_mesh(mesh, scalars="scalar", lighting=False, n_colors=256, **look)


def _mark_radius(camera: Camera) -> float:
    return 0.0075 * camera.height


def _draw_polygons(axes, scene, camera) -> None:
    """Draw everything as polygons, the farthest first."""
    from matplotlib.collections import PolyCollection

    parts = [_quads(net, camera, *PLANE, lit=0.0) for net in scene.planes]
    parts += [_quads(net, camera, *WALL, lit=0.45) for net in scene.walls]
    parts.append(_discs(scene.marks, camera))
    if scene.paint is not None:
        parts.append(_painted(scene.paint, camera))
    polygons = [polygon for part in parts for polygon in part[0]]
    depth, faces, edges = (np.concatenate(arrays) for arrays in list(zip(*parts))[1:])
    order = np.argsort(depth, kind="stable")
    collection = PolyCollection([polygons[n] for n in order], facecolors=faces[order], edgecolors=edges[order])
    collection.set(linewidth=scene.line_width, rasterized=True)
    axes.add_collection(collection, autolim=False)


def _quads(net, camera, face, edge, lit):
    """Quadrilaterals of a net on the picture, their depths and the colours of their faces and edges."""
    corners = np.stack([net[:-1, :-1], net[1:, :-1], net[1:, 1:], net[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    flat = camera.project(corners)
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-300
    normal *= np.where(normal @ camera.axes()[2] < 0.0, -1.0, 1.0)[:, None]  # the side that is seen
    shade = 1.0 - lit * (1.0 - np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0))
    faces = shade[:, None] * np.array(to_rgb(face))
    return flat[..., :2], flat[..., 2].mean(axis=1), faces, np.broadcast_to(to_rgb(edge), faces.shape)


def _painted(paint: Paint, camera):
    """Faces on the picture, their depths and their colours, which are those of their edges too."""
    flat = camera.project(paint.points[paint.quads])
    colors = paint.mappable().to_rgba(paint.values)[:, :3]
    return flat[..., :2], flat[..., 2].mean(axis=1), colors, colors


def _discs(marks, camera):
    """Discs in the places of the marks, their depths and the colours of their faces and edges."""
    flat, radius = camera.project(marks), _mark_radius(camera)
    polygons = flat[:, None, :2] + radius * np.stack([_DISC.real, _DISC.imag], axis=-1)
    faces = np.broadcast_to(to_rgb(RED), (len(marks), 3))
    return polygons, flat[:, 2] + 3.0 * radius, faces, 0.6 * faces


def _face_of(array: np.ndarray, window) -> np.ndarray:
    flat = next(d for d in range(3) if window.lo[d] == window.hi[d])
    return np.take(array, 0 if window.lo[flat] == 0 else -1, axis=flat)
