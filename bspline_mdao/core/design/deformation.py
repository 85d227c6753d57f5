"""Deformations of the surface points of a mesh: successive point maps that preserve symmetry planes.

Each map is a frozen dataclass with an ``amount`` (an angle in radians, a factor or a height in metres) and one method
``apply``. A map moves each point independently, by a formula that also holds for complex numbers, so complex steps give
all derivatives exactly: with respect to the points and to the amount, `jvp`, `vjp` and `amount_jvp`. The formulas for
wing sections are in `section_maps`, shared with the design variables of `planform`. Theory:
``docs/theory/deformations.rst``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, ClassVar, Protocol

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from ..mesh.frame import Frame, Plane
from ..mesh.moving_mesh import MovingMesh
from ..movement.mover import PLANE_TOLERANCE
from .hinge import RotatedPart, about_axis
from .section_maps import order_notes, rotation, scaling, shear

__all__ = [
    "Bend",
    "Bumps",
    "Deformation",
    "Pitch",
    "PointMap",
    "PrescribedPoints",
    "Rotate",
    "RotateSections",
    "ScaleChord",
    "ScaleThickness",
    "ShearDownstream",
    "ShearUpwards",
    "Stretch",
    "Translate",
    "amount_jvp",
    "jvp",
    "random_bumps",
    "vjp",
]

_N_WAVES = 32
"""Number of waves in bumps: enough that no direction stands out."""

_STEP = 1e-40
"""Complex step: nothing is subtracted, so it may be so small that its square vanishes relative to one."""

_SMALL = 1e-2
"""Angle (rad) below which sin(a) / a and (1 - cos(a)) / a are computed from their series, which are accurate to
round-off there and avoid division by zero."""


@dataclass(frozen=True, eq=False)
class Deformation(OneLine):
    """New positions for the surface points of a mesh."""

    mesh: MovingMesh  # the control mesh whose surface is deformed
    maps: tuple[PointMap, ...]  # maps of the points, applied one after the other

    @property
    def notes(self) -> tuple[str, ...]:
        """Lines in reports: from maps that know more than their amounts, and on an order that changes angles."""
        notes = tuple(point_map.note for point_map in self.maps if hasattr(point_map, "note"))
        return (*notes, *order_notes(self.maps))

    def apply(
        self,
        points: np.ndarray,  # (n_surface, 3), surface points (m), in the order of ``mesh.surface_ids``
    ) -> np.ndarray:  # (n_surface, 3), moved points (m). Points on symmetry planes are exactly in them
        """Move surface points."""
        if points.shape != (len(self.mesh.surface_ids), 3):
            raise InputError(
                f"deformation: surface points of shape {points.shape}; give shape ({len(self.mesh.surface_ids)}, 3)"
            )
        return self._keep_in_planes(points, apply_maps(self.maps, points))

    def apply_to_nodes(
        self,
        nodes: np.ndarray,  # (n, 3), nodes of the surface (m), such as those of a `bspline_mdao.measures.SurfaceGrid`
        # nodes on symmetry planes, and the planes' unit normals
        planes: Sequence[tuple[np.ndarray, np.ndarray]] = (),
    ) -> np.ndarray:  # (n, 3), moved nodes (m). Nodes on the planes stay exactly in them
        """Move surface nodes in the same way as control points."""
        displacement = apply_maps(self.maps, nodes) - nodes
        for ids, normal in planes:
            displacement[ids] -= np.outer(displacement[ids] @ normal, normal)
        return nodes + displacement

    def jvp(self, points: np.ndarray, d_points: np.ndarray) -> np.ndarray:
        """Differentiate `apply` along a direction in the points, shape (n_surface, 3)."""
        d_moved = d_points
        for point_map in self.maps:
            points, d_moved = point_map.apply(points), jvp(point_map, points, d_moved)
        return d_points + self.slide(d_moved - d_points)

    def vjp(self, points: np.ndarray, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`: shape (n_surface, 3), of shape (n_surface, 3)."""
        before = [points]
        for point_map in self.maps[:-1]:
            before.append(point_map.apply(before[-1]))
        slid = self.slide(bar)
        points_bar = slid
        for point_map, at in zip(self.maps[::-1], before[::-1]):
            points_bar = vjp(point_map, at, points_bar)
        return points_bar + bar - slid

    def _keep_in_planes(self, points: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """Refuse points that leave a symmetry plane, and remove round-off."""
        rows, normals = self.mesh.in_plane_rows, self.mesh.in_plane_normals
        off = np.abs(np.sum((moved - points)[rows] * normals, axis=1))
        if len(rows) and off.max() > PLANE_TOLERANCE * self.mesh.size:
            place = self.mesh.place_of_surface_point(rows[np.argmax(off)])
            raise InputError(
                f"deformation: {place} would leave its plane of symmetry by {off.max():.3g} "
                f"m; choose one that keeps the plane"
            )
        kept = moved.copy()
        kept[rows] = (points + self.slide(moved - points))[rows]
        return kept

    def slide(self, displacement: np.ndarray) -> np.ndarray:
        """Remove the normal part of displacements (n_surface, 3) of points on symmetry planes; its own transpose."""
        rows, normals = self.mesh.in_plane_rows, self.mesh.in_plane_normals
        slid = displacement.copy()
        np.subtract.at(slid, rows, np.sum(displacement[rows] * normals, axis=1)[:, None] * normals)
        return slid


class PointMap(Protocol):
    """A dataclass that moves each point independently, by an amount that may be replaced."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def amount(self) -> complex:
        """Amount of the deformation: an angle (rad), a factor or a height (m)."""

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Moved points, shape (n, 3), of points, shape (n, 3), in metres."""


def apply_maps(maps: Sequence[PointMap], points: np.ndarray) -> np.ndarray:
    """Apply maps to points, shape (n, 3), one after the other."""
    return reduce(lambda moved, point_map: point_map.apply(moved), maps, points)


def jvp(point_map: PointMap, points: np.ndarray, d_points: np.ndarray) -> np.ndarray:
    """Differentiate a map along a direction in the points, shape (n, 3)."""
    return point_map.apply(points + 1j * _STEP * d_points).imag / _STEP


def vjp(point_map: PointMap, points: np.ndarray, bar: np.ndarray) -> np.ndarray:
    """Transpose of `jvp`: cotangent of the points, shape (n, 3), from the cotangent of the moved points."""
    columns = [jvp(point_map, points, np.broadcast_to(axis, points.shape)) for axis in np.eye(3)]
    return np.stack([np.sum(column * bar, axis=1) for column in columns], axis=1)


def amount_jvp(point_map: PointMap, points: np.ndarray) -> np.ndarray:
    """Differentiate a map with respect to its amount; shape (n, 3)."""
    return replace(point_map, amount=point_map.amount + 1j * _STEP).apply(points).imag / _STEP


@dataclass(frozen=True)
class InFrame(ABC):
    """A map in coordinates along the stream, normal to it and along the span."""

    # amount: see each map

    frame: Frame  # directions of the surface
    amount: float

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Moved points, shape (n, 3), of points, shape (n, 3), in metres."""
        return self.frame.to_space(np.stack(self._moved(*self.frame.to_local(points).T), axis=1))

    @abstractmethod
    def _moved(
        self, stream: np.ndarray, normal: np.ndarray, span: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stream, normal and span coordinates of the moved points, from the coordinates of the points."""


class RotateSections(InFrame):
    """Rotate sections about the middle line, in proportion to the distance from the root."""

    # ``amount`` is the angle at the tip (rad), upstream end up positive.

    turns = "stream", "normal"

    def _moved(
        self, stream: np.ndarray, normal: np.ndarray, span: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        centre = self.frame.middle_at(span)
        return *_about(centre, rotation(self.amount * span / self.frame.span), stream, normal), span


@dataclass(frozen=True)
class Pitch(InFrame):
    """Rotate the whole surface about an axis along the span."""

    # ``amount`` is the angle (rad), upstream end up positive.

    turns = "stream", "normal"

    at: float = 0.25  # position of the axis between the upstream (0) and downstream end (1) of the surface's box

    def _moved(
        self, stream: np.ndarray, normal: np.ndarray, span: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        centre = self.at * self.frame.chord, self.frame.middle_at(0.0)[1]
        return *_about(centre, rotation(self.amount), stream, normal), span


@dataclass(frozen=True)
class Bend(InFrame):
    """Bend the span upwards along a circular arc, and continue straight."""

    # Sections stay perpendicular to the bent span, and lengths along the middle are preserved. ``amount`` is the angle
    # beyond the arc (rad), upwards positive.

    turns = ("normal",)

    at: float = 0.7  # span fraction at which the arc begins
    length: float = 0.15  # length of the arc as a fraction of the span

    def height(self, normal: np.ndarray) -> np.ndarray:
        """Height of normal coordinates (m) above the middle line at the beginning of the arc."""
        return normal - self.frame.middle_at(self.at * self.frame.span)[1]

    def _moved(
        self, stream: np.ndarray, normal: np.ndarray, span: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        start, length, height = self.at * self.frame.span, self.length * self.frame.span, self.height(normal)
        on_arc, outboard = _clip(span - start, 0.0, length), _clip(span - start - length, 0.0, np.inf)
        angle = self.amount * on_arc / length
        up = on_arc * _versine_ratio(angle) + outboard * np.sin(angle) + height * (np.cos(angle) - 1.0)
        out = _clip(span, -np.inf, start) + on_arc * _sine_ratio(angle) + outboard * np.cos(angle)
        return stream, normal + up, out - height * np.sin(angle)


class Stretch(InFrame):
    """Scale the span from the root; ``amount`` is the factor."""

    def _moved(
        self, stream: np.ndarray, normal: np.ndarray, span: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return stream, normal, self.amount * span


class ScaleChord(InFrame):
    """Scale lengths along the stream about the middle line; ``amount`` is the factor."""

    scales = ("stream",)

    def _moved(
        self, stream: np.ndarray, normal: np.ndarray, span: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return *_about(self.frame.middle_at(span), scaling(self.amount, 1.0), stream, normal), span


class ScaleThickness(InFrame):
    """Scale lengths normal to stream and span about the middle line; ``amount`` is the factor."""

    scales = ("normal",)

    def _moved(
        self, stream: np.ndarray, normal: np.ndarray, span: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return *_about(self.frame.middle_at(span), scaling(1.0, self.amount), stream, normal), span


class ShearDownstream(InFrame):
    """Shear the surface downstream in proportion to the distance from the root; ``amount`` is the angle (rad)."""

    def _moved(
        self, stream: np.ndarray, normal: np.ndarray, span: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return stream + shear(self.amount) * span, normal, span


class ShearUpwards(InFrame):
    """Shear the surface upwards in proportion to the distance from the root; ``amount`` is the angle (rad)."""

    def _moved(
        self, stream: np.ndarray, normal: np.ndarray, span: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return stream, normal + shear(self.amount) * span, span


@dataclass(frozen=True, eq=False)
class Rotate:
    """Rotate points about an axis by any angle; ``amount`` is the angle (rad), by the right-hand rule."""

    turns = "stream", "normal"

    hinge: np.ndarray  # (2, 3), two points of the axis (m)
    amount: float
    part: RotatedPart  # what rotates, and by how much

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points (n, 3), in metres."""
        return about_axis(points, self.hinge, self.amount * self.part.weights(points))


@dataclass(frozen=True, eq=False)
class Translate:
    """Move all points by ``amount`` times a vector, shape (3,), in metres."""

    vector: np.ndarray
    amount: float = 1.0

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points (n, 3), in metres."""
        return points + self.amount * self.vector


@dataclass(frozen=True, eq=False)
class PrescribedPoints:
    """Move points towards prescribed positions, by the fraction ``amount`` of the way."""

    points: np.ndarray  # (n, 3), new positions (m)
    amount: float = 1.0  # fraction of the way: 1 to the prescribed positions, 0 leaves the points where they are

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points (n, 3), in metres."""
        return self.amount * self.points + (1.0 - self.amount) * points


@dataclass(frozen=True, eq=False)
class Bumps:
    """Move points by a smooth vector field of position: a sum of plane waves."""

    # A field moves both sides of a thin wing equally and keeps closed edges closed. Towards a symmetry plane its normal
    # component fades as ``1 - exp(-(d / reach)^2)`` with the distance d.

    amount: float  # height (m)
    # wave vectors (rad/m) and phases (rad)
    waves: np.ndarray  # (n, 3) and (n,)
    phases: np.ndarray  # (n, 3) and (n,)
    directions: np.ndarray  # (n, 3), displacement at the crest of each wave, relative to the height
    reach: float  # distance from a symmetry plane over which bumps fade (m)
    planes: tuple[Plane, ...] = ()  # symmetry planes, perpendicular or parallel to each other

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points (n, 3), in metres."""
        field = np.cos(points @ self.waves.T + self.phases) @ self.directions
        for plane in self.planes:
            faded = np.exp(-(((points @ plane.normal - plane.offset) / self.reach) ** 2))
            field = field - (faded * (field @ plane.normal))[:, None] * plane.normal
        return points + self.amount * field


def random_bumps(
    points: np.ndarray,  # (n, 3), points of the surface (m)
    height: float,  # largest displacement of these points (m)
    wavelength: float,  # shortest wavelength (m); the longest is twice that
    seed: int,  # seed of the random numbers
    planes: tuple[Plane, ...] = (),  # planes of symmetry
) -> Bumps:
    """Draw random bumps."""
    rng = np.random.default_rng(seed)
    waves, directions = _directions(rng), _directions(rng)
    waves *= 2.0 * np.pi / wavelength * rng.uniform(0.5, 1.0, (_N_WAVES, 1))
    phases = rng.uniform(0.0, 2.0 * np.pi, _N_WAVES)
    reach = 0.25 * wavelength
    unit = Bumps(1.0, waves, phases, directions, reach, planes)
    largest = np.linalg.norm(unit.apply(points) - points, axis=1).max()
    if not largest > 0.0:
        raise InputError("deformation: bumps move no point of this surface; all of it is on planes of symmetry")
    return Bumps(height, waves, phases, directions / largest, reach, planes)


def _directions(rng: np.random.Generator) -> np.ndarray:
    """Isotropic random directions, shape (n, 3)."""
    vectors = rng.standard_normal((_N_WAVES, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def _about(
    centre: Sequence[Any], matrix: np.ndarray, stream: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Apply matrices (..., 2, 2) to stream and normal coordinates about a centre."""
    along, above = centre
    x, y = stream - along, normal - above
    return (
        along + matrix[..., 0, 0] * x + matrix[..., 0, 1] * y,
        above + matrix[..., 1, 0] * x + matrix[..., 1, 1] * y,
    )


def _clip(x: np.ndarray, low: float, high: float) -> np.ndarray:
    """Clip numbers, real or complex, to bounds on their real part."""
    return np.where(x.real < low, low, np.where(x.real > high, high, x))


def _sine_ratio(angle: np.ndarray) -> np.ndarray:
    """Return sin(a) / a, 1 at zero."""
    return _ratio(angle, np.sin, lambda a: 1.0 - a**2 / 6.0 * (1.0 - a**2 / 20.0 * (1.0 - a**2 / 42.0)))


def _versine_ratio(angle: np.ndarray) -> np.ndarray:
    """Return (1 - cos(a)) / a, 0 at zero."""
    series = lambda a: a / 2.0 * (1.0 - a**2 / 12.0 * (1.0 - a**2 / 30.0 * (1.0 - a**2 / 56.0)))  # noqa: E731
    return _ratio(angle, lambda a: 2.0 * np.sin(0.5 * a) ** 2, series)


def _ratio(angle: np.ndarray, numerator: Callable, series: Callable) -> np.ndarray:
    is_small = np.abs(angle) < _SMALL
    return np.where(is_small, series(angle), numerator(angle) / np.where(is_small, 1.0, angle))
