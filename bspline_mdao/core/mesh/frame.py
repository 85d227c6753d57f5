"""Directions of a surface: along the stream, normal to it, and along the span.

Theory: ``docs/theory/deformations.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from .moving_mesh import MovingMesh

__all__ = ["Frame", "Plane", "mesh_frame", "mesh_planes", "surface_frame"]

_BINS = 8
"""Number of slices of the span, each of which gives one point of the middle line."""

_FLAT = 1e-9
"""Least extent along the span, relative to the size of the surface, that counts as a span."""

TOUCHED = 1e-3
"""A surface that ends this near to a plane of symmetry, relative to its extent along the normal, ends on it: control
points and nodes are off by the error of the fit and by roughness."""


@dataclass(frozen=True, eq=False)
class Plane(OneLine):
    """A plane of symmetry."""

    normal: np.ndarray  # (3,), unit normal
    offset: float  # distance from the origin along the normal (m)
    roughness: float = 0.0  # largest distance of a node in it (m)


@dataclass(frozen=True, eq=False)
class Frame(OneLine):
    """Coordinates along the stream, normal to it and along the span."""

    origin: np.ndarray  # (3,), upstream end of the root (m)
    axes: np.ndarray  # (3, 3), orthonormal rows: stream, normal, span
    # chord, span: extent of the surface along the stream and along the span (m)
    chord: float
    span: float
    # (2, 2), stream and normal coordinate of the middle line at the root, and their slopes along the span
    middle: np.ndarray

    def to_local(self, points: np.ndarray) -> np.ndarray:
        """Coordinates along stream, normal and span, shape (n, 3), of points, shape (n, 3), in metres."""
        return (points - self.origin) @ self.axes.T

    def to_space(self, local: np.ndarray) -> np.ndarray:
        """Points, shape (n, 3), from coordinates along stream, normal and span."""
        return local @ self.axes + self.origin

    def middle_at(self, span: Any) -> tuple[Any, Any]:
        """Stream and normal coordinates of the middle line at places along the span (m)."""
        (stream, normal), (stream_slope, normal_slope) = self.middle
        return stream + stream_slope * span, normal + normal_slope * span


def surface_frame(
    points: np.ndarray,  # (n, 3), points of the surface (m)
    planes: tuple[Plane, ...] = (),  # planes of symmetry
) -> Frame:
    """Find the directions of a surface from its box and its planes of symmetry.

    Examples
    --------
    >>> wing = np.array([[0.0, 0, 0], [1, 0.1, 0], [0, 0, 3], [1, 0, 3]])
    >>> surface_frame(wing).axes.tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    # `InputError` if the surface has no span. The span is normal to a plane of symmetry, and starts there, or where the
    # surface begins if it does not reach the plane. With several planes, the one along whose normal the surface is
    # longest counts. Without one the span is the longest side of the box and starts at its low end. The stream is the
    # longer of the other two sides. The middle line joins the centres of the boxes of slices of the surface.
    span_axis, root = _span_axis(points, planes)
    others = _across(span_axis)
    others = others[np.argsort(-np.ptp(points @ others.T, axis=0), kind="stable")]
    axes = np.stack([*others, span_axis])
    local = points @ axes.T
    low, high = local.min(axis=0), local.max(axis=0)
    low[2] = root
    if not high[2] - root > _FLAT * (high - low).max():
        raise InputError("deformation: the surface has no extent along its span; check its symmetry patches")
    return Frame(low @ axes, axes, float(high[0] - low[0]), float(high[2] - low[2]), _middle_line(local - low))


def mesh_frame(mesh: MovingMesh) -> Frame:
    """Find the directions of the surface of a control mesh, along the stream, normal to it and along the span.

    The span is normal to a plane of symmetry that the surface ends on, and starts there. Without one it is the longest
    side of the box around the surface. The stream is the longer of the other two sides.

    Parameters
    ----------
    mesh : MovingMesh
        The control mesh.

    Returns
    -------
    Frame
        Its ``chord`` and ``span`` are in m; ``to_local`` and ``to_space`` transform points.

    Raises
    ------
    InputError
        If the surface has no span.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.movers import mesh_frame, moving_mesh
    >>> frame = mesh_frame(moving_mesh(fit_grid(onera_m6_grid((9, 8, 7)))))
    >>> frame.axes[2].round(6).tolist()
    [0.0, 0.0, 1.0]
    """
    return surface_frame(mesh.points[mesh.surface_ids], mesh_planes(mesh))


def mesh_planes(mesh: MovingMesh) -> tuple[Plane, ...]:
    """Planes of symmetry that the surface of a mesh ends on; without one, the other planes in which points slide."""
    places = mesh.points[mesh.surface_ids[mesh.in_plane_rows]]
    found = list(zip(mesh.in_plane_normals, np.sum(places * mesh.in_plane_normals, axis=1)))
    planes: list[Plane] = []
    for normal, offset in found or mesh.planes:
        if not any(_coincide(plane, normal, offset, mesh.size) for plane in planes):
            planes.append(Plane(normal, float(offset)))
    return tuple(planes)


def _span_axis(points: np.ndarray, planes: tuple[Plane, ...]) -> tuple[np.ndarray, float]:
    """Direction of the span, away from the plane it starts on, and where it starts."""
    if not planes:
        axis = int(np.argmax(np.ptp(points, axis=0)))
        return np.eye(3)[axis], points[:, axis].min()
    plane = max(planes, key=lambda plane: np.ptp(points @ plane.normal))
    side = 1.0 if np.mean(points @ plane.normal) >= plane.offset else -1.0
    places, root = side * (points @ plane.normal), side * plane.offset
    is_met = places.min() - root <= TOUCHED * np.ptp(places)
    return side * plane.normal, float(root if is_met else places.min())


def _across(axis: np.ndarray) -> np.ndarray:
    """Two directions normal to an axis, each as close to a coordinate axis as possible; shape (2, 3)."""
    main = int(np.argmax(np.abs(axis)))
    rows: list[np.ndarray] = []
    for candidate in np.delete(np.eye(3), main, axis=0):
        for row in (axis, *rows):
            candidate = candidate - (candidate @ row) * row
        rows.append(candidate / np.linalg.norm(candidate))
    return np.array(rows)


def _middle_line(local: np.ndarray) -> np.ndarray:
    """Straight line through the centres of slices of the span."""
    span = local[:, 2]
    number = np.minimum((_BINS * span / span.max()).astype(int), _BINS - 1)
    slices = [local[number == n] for n in np.unique(number[number >= 0])]
    middles = np.array([0.5 * (part.min(axis=0) + part.max(axis=0)) for part in slices])
    if len(middles) == 1:
        return np.array([middles[0, :2], [0.0, 0.0]])
    return np.polynomial.polynomial.polyfit(middles[:, 2], middles[:, :2], 1)


def _coincide(plane: Plane, normal: np.ndarray, offset: float, size: float) -> bool:
    """Whether a plane has this normal and offset up to round-off and sign."""
    sign = np.sign(plane.normal @ normal)
    is_parallel = np.abs(sign * normal - plane.normal).max() < 1e-6
    return is_parallel and abs(sign * offset - plane.offset) < 1e-6 * size
