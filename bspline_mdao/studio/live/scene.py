"""The drawing of a shape as VTK objects: the browser draws it, and nothing is rendered here."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...base.extras import library
from ...core.mesh.frame import surface_frame
from ...errors import InputError
from .drawn import Drawn
from .part import Part
from .shape import LiveModel, Shape

__all__ = ["COLOURS", "Camera", "Scene", "View", "vtk_library"]

COLOURS = {
    "quality": ("orthogonality Q", (0.0, 1.0)),
    "corner": ("smallest corner", (0.0, 1.0)),
    "heights": ("height of first cells, relative to before", (0.8, 1.2)),
    "displacement": ("displacement", None),
}
"""Fields that may colour the drawing: a label, and the range of the colours if it is fixed."""

_STOPS = (
    ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)),  # viridis
    ((178, 24, 43), (244, 165, 130), (247, 247, 247), (146, 197, 222), (33, 102, 172)),  # both sides of 1
)
"""Colours at equal fractions of the range: for quality and displacement, and for ratios."""

_N_COLOURS = 128
_NEAR = 24.0
"""Pixels from a click within which a control point is picked."""


_NEED = "the command live needs trame and VTK"

_OF_VTK = {
    "vtkCommonCore": ("vtkLookupTable", "vtkPoints"),
    "vtkCommonDataModel": ("vtkCellArray", "vtkPolyData"),
    "vtkRenderingCore": ("vtkActor", "vtkPolyDataMapper", "vtkRenderer"),
    "vtkRenderingUI": ("vtkGenericRenderWindowInteractor",),
    "vtkRenderingOpenGL2": ("vtkGenericOpenGLRenderWindow",),  # needs no window system
}
"""What is imported from VTK: all of it takes seconds."""


def vtk_library() -> SimpleNamespace:
    """Import VTK's classes; `InputError` with the install command if VTK is missing."""
    found = {}
    for module, names in _OF_VTK.items():
        of = library(f"vtkmodules.{module}", _NEED, "live")
        found.update({name: getattr(of, name) for name in names})
    return SimpleNamespace(**found, numpy=library("vtkmodules.util.numpy_support", _NEED, "live"))


@dataclass(frozen=True, eq=False)
class Camera:
    """Where the browser looks from."""

    position: np.ndarray  # (3,), in metres
    focal_point: np.ndarray  # (3,)
    up: np.ndarray  # (3,)
    angle: float  # between the lower and the upper edge (deg)

    @property
    def axes(self) -> np.ndarray:
        """Unit vectors to the right, up and into the picture, shape (3, 3)."""
        into = self.focal_point - self.position
        into = into / np.linalg.norm(into)
        right = np.cross(into, self.up)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(right, into), into])

    def project(self, points: np.ndarray, shape: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
        """Pixels from the upper left corner, shape (n, 2), and depths (m) of points in a picture of (width, height)."""
        right, up, depths = self.axes @ (points - self.position).T
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = np.stack([right, -up], axis=1) / (depths * self._extent(shape))[:, None]
        return pixels + 0.5 * np.array(shape), depths

    def displacement(self, place: np.ndarray, pixels: np.ndarray, shape: tuple[float, float]) -> np.ndarray:
        """Displacement (m) across the line of sight that moves the point at a place by pixels, shape (2,)."""
        right, up, into = self.axes
        return (pixels[0] * right - pixels[1] * up) * ((place - self.position) @ into) * self._extent(shape)

    def _extent(self, shape: tuple[float, float]) -> float:
        """Size of a pixel, by its depth."""
        return 2.0 * np.tan(0.5 * np.radians(self.angle)) / shape[1]


@dataclass(frozen=True)
class View:
    """What is visible."""

    colour: str = "quality"  # out of `COLOURS`
    has_points: bool = True  # whether control points of the surface are drawn
    has_symmetry: bool = False  # whether planes of symmetry are drawn
    direction: int | None = None  # direction of the grid planes that are drawn off the walls; None for none
    part: float = 0.5  # where these are, by index


class Scene:
    """A window with a shape in it: surfaces with their grid lines, control points, and the worst cells."""

    def __init__(self, live: LiveModel) -> None:
        vtk = vtk_library()
        self.vtk, self.live = vtk, live
        self.numpy = vtk.numpy
        self.size = live.surface.size
        self.window, self._renderer = vtk.vtkGenericOpenGLRenderWindow(), vtk.vtkRenderer()
        self.window.AddRenderer(self._renderer)
        self._interactor = vtk.vtkGenericRenderWindowInteractor()  # trame needs one
        self._interactor.SetRenderWindow(self.window)
        self._renderer.SetBackground(1.0, 1.0, 1.0)
        self._drawn = Drawn.of(live.model.topology)
        self._drawn_as: tuple[bool, int | None, float] = (False, None, 0.5)
        self._part: tuple[Drawn, Part] | None = None
        self._sheets, self._mapper = self._surfaces()
        self._control = self._markers((0.10, 0.10, 0.12), 6.0)
        self._worst = self._markers((0.84, 0.10, 0.11), 13.0)
        self._picked = self._markers((1.0, 0.55, 0.0), 16.0)
        self._tables = [self._table(stops) for stops in _STOPS]
        self.surface = live.model.control_points[live.mesh.surface_ids]
        self._set_camera()

    def _surfaces(self) -> tuple[Any, Any]:
        """Data of the surfaces and their mapper."""
        data, mapper, actor = self.vtk.vtkPolyData(), self.vtk.vtkPolyDataMapper(), self.vtk.vtkActor()
        data.SetPoints(self.vtk.vtkPoints())
        mapper.SetInputData(data)
        actor.SetMapper(mapper)
        look = actor.GetProperty()
        look.EdgeVisibilityOn()
        look.SetEdgeColor(0.25, 0.27, 0.30)
        look.SetInterpolationToFlat()
        look.SetAmbient(0.55)
        look.SetDiffuse(0.5)
        self._renderer.AddActor(actor)
        return data, mapper

    def _markers(self, colour: tuple[float, float, float], size: float) -> tuple[Any, Any]:
        """Points of one colour: their data and their actor."""
        data, mapper, actor = self.vtk.vtkPolyData(), self.vtk.vtkPolyDataMapper(), self.vtk.vtkActor()
        data.SetPoints(self.vtk.vtkPoints())
        mapper.SetInputData(data)
        mapper.ScalarVisibilityOff()
        actor.SetMapper(mapper)
        actor.GetProperty().SetColor(*colour)
        actor.GetProperty().SetPointSize(size)
        actor.GetProperty().LightingOff()
        self._renderer.AddActor(actor)
        return data, actor

    def _table(self, stops: tuple[tuple[int, int, int], ...]) -> Any:
        table = self.vtk.vtkLookupTable()
        table.SetNumberOfTableValues(_N_COLOURS)
        at, places = np.linspace(0.0, 1.0, _N_COLOURS), np.linspace(0.0, 1.0, len(stops))
        channels = np.array(stops).T / 255.0
        for n, colour in enumerate(zip(*(np.interp(at, places, channel).tolist() for channel in channels))):
            table.SetTableValue(n, *colour, 1.0)
        table.Build()
        return table

    def _set_camera(self) -> None:
        """Look at the surface from above, upstream and outboard."""
        points = self.live.surface.points
        try:
            frame = surface_frame(points, self.live.surface.planes)
            stream, up, span = frame.axes
        except InputError:
            stream, up, span = np.eye(3)
        centre, camera = 0.5 * (points.min(axis=0) + points.max(axis=0)), self._renderer.GetActiveCamera()
        away = -0.55 * stream + 0.75 * up + 0.25 * span
        distance = 2.4 * self.size
        camera.SetFocalPoint(*centre)
        camera.SetPosition(*(centre + distance * away / np.linalg.norm(away)))
        camera.SetViewUp(*up)
        camera.SetViewAngle(30.0)
        camera.SetClippingRange(0.01 * distance, 100.0 * distance)

    def show(self, shape: Shape, view: View) -> tuple[float, float]:
        """Draw a shape; return the range of the colours."""
        self._lay_out(view)
        rows, live = self._drawn.rows, self.live
        self._put(self._sheets, shape.nodes[rows])
        values, is_of_cells, ends = self._values(shape, view.colour)
        array = self.numpy.numpy_to_vtk(np.ascontiguousarray(values, dtype=np.float32), deep=1)
        array.SetName(view.colour)
        self._sheets.GetCellData().SetScalars(array if is_of_cells else None)
        self._sheets.GetPointData().SetScalars(None if is_of_cells else array)
        (self._mapper.SetScalarModeToUseCellData if is_of_cells else self._mapper.SetScalarModeToUsePointData)()
        self._mapper.SetLookupTable(self._tables[view.colour == "heights"])
        for table in self._tables:
            table.SetRange(*ends)
        self._mapper.SetScalarRange(*ends)
        self._mapper.UseLookupTableScalarRangeOff()
        self.surface = shape.control_points[live.mesh.surface_ids]
        self._put_markers(self._control, self.surface, view.has_points)
        self._put_markers(self._worst, live.middles(shape.nodes, shape.worst))
        return ends

    def part(self, view: View) -> Part:
        """Part of the grid that a view needs, made once for all shapes."""
        self._lay_out(view)
        if self._part is None or self._part[0] is not self._drawn:
            self._part = self._drawn, self.live.part_of(self._drawn.cells)
        return self._part[1]

    def _values(self, shape: Shape, colour: str) -> tuple[np.ndarray, bool, tuple[float, float]]:
        """Values of what is drawn, whether they are per cell, and their range."""
        drawn, (_, ends) = self._drawn, COLOURS[colour]
        if colour == "heights":
            found = drawn.of_nodes(self.live.quality.first_cells.wall_rows, shape.heights, 1.0)
            return found, False, ends or (0.0, 1.0)
        if colour == "displacement":
            found = np.linalg.norm(shape.nodes[drawn.rows] - self.live.baseline[drawn.rows], axis=1)
            return found, False, (0.0, max(float(found.max()), 1e-9 * self.size))
        return (shape.q if colour == "quality" else shape.corners)[drawn.cells], True, ends or (0.0, 1.0)

    def _lay_out(self, view: View) -> None:
        """Take other surfaces if the view has changed."""
        asked = view.has_symmetry, view.direction, view.part
        if asked != self._drawn_as or not self._sheets.GetNumberOfPolys():
            self._drawn, self._drawn_as = Drawn.of(self.live.model.topology, *asked), asked
            cells = self.vtk.vtkCellArray()
            corners = self._drawn.quads.astype(np.int64).ravel()
            cells.SetData(4, self.numpy.numpy_to_vtkIdTypeArray(corners, deep=1))
            self._sheets.SetPolys(cells)

    def _put(self, data: Any, points: np.ndarray) -> None:
        data.GetPoints().SetData(self.numpy.numpy_to_vtk(np.ascontiguousarray(points, dtype=np.float32), deep=1))
        data.GetPoints().Modified()
        data.Modified()

    def _put_markers(self, markers: tuple[Any, Any], points: np.ndarray, is_seen: bool = True) -> None:
        """Put markers at points, at least one: browsers draw nothing that starts empty."""
        data, actor = markers
        actor.SetVisibility(is_seen)
        self._put(data, points)
        if data.GetNumberOfVerts() != len(points):
            cells = self.vtk.vtkCellArray()
            cells.SetData(1, self.numpy.numpy_to_vtkIdTypeArray(np.arange(len(points), dtype=np.int64), deep=1))
            data.SetVerts(cells)

    def pick(self, row: int | None) -> None:
        """Mark a control point of the surface by its row; none with None."""
        at = row or 0
        self._put_markers(self._picked, self.surface[at : at + 1], row is not None)

    @property
    def camera(self) -> Camera:
        """The initial camera."""
        camera = self._renderer.GetActiveCamera()
        position, focal_point = np.array(camera.GetPosition()), np.array(camera.GetFocalPoint())
        return Camera(position, focal_point, np.array(camera.GetViewUp()), camera.GetViewAngle())

    def nearest(self, camera: Camera, pixel: np.ndarray, shape: tuple[float, float]) -> int | None:
        """Row of the control point at a click, the front one of those nearby; None if none is near."""
        pixels, depths = camera.project(self.surface, shape)
        distances = np.where(depths > 0.0, np.linalg.norm(pixels - pixel, axis=1), np.inf)
        near = np.flatnonzero(distances <= min(_NEAR, distances.min() + 0.25 * _NEAR))
        return int(near[np.argmin(depths[near])]) if len(near) else None
