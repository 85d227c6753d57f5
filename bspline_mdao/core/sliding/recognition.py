"""The surface that the nodes of a patch lie on: a cylinder, cone, sphere or surface of revolution about x, y or z.

The normals of the faces between nodes give a first guess: a cylinder's are normal to its axis, a cone's have one angle
to it, and its tangent planes meet at the apex. The Gauss-Newton method then moves the surface as a rigid body, and
changes its radius or angle, until the distances of the nodes are least.

Theory: ``docs/theory/sliding.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import make_lsq_spline

from ...base.numerics.vectors import nearest_plane
from ...errors import InputError, MovementError
from .fixed_surface import Cone, Cylinder, FixedSurface, Revolution, Sphere

__all__ = ["recognised_surface"]

N_STEPS = 20
"""Gauss-Newton steps: the guess is near, and five give most of the digits."""

N_PER_INTERVAL = 8
"""Nodes for each interval of a profile that is fitted to nodes not lying in rings."""


def recognised_surface(
    faces: Sequence[np.ndarray],  # each (ni, nj, 3), nodes of every side of the patch (m)
    near: float,  # largest distance of nodes (m)
    what: str,  # the patch, for messages
) -> FixedSurface:
    """Surface that all nodes of a patch lie on; `InputError` where there is none."""
    nodes = np.concatenate([face.reshape(-1, 3) for face in faces])
    tried = {"its plane": float(nearest_plane(nodes)[1].max())}
    for name, candidates in _KINDS.items():
        best = np.inf
        for surface in candidates(nodes, faces, near):
            best = min(best, _distance(surface, nodes))
            if best <= near:
                return surface
        tried[name] = best
    found = ", ".join(f"{name} by {distance:.3g} m" for name, distance in tried.items() if np.isfinite(distance))
    raise InputError(
        f"{what} is to slide, but leaves {found}, and surfaces of revolution about x, y and z; give its surface "
        f"(sliding={{patch: Cylinder(...)}}), or fix or release it"
    )


def _distance(surface: FixedSurface, nodes: np.ndarray) -> float:
    """Largest distance of nodes; infinite where one is on the axis."""
    try:
        return float(surface.distances(nodes).max())
    except MovementError:
        return np.inf


def _normals(faces: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Centres and unit normals, each (n, 3), of the quads between nodes that have an area."""
    middles, normals = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for face in faces:
        corners = face[:-1, :-1], face[1:, :-1], face[1:, 1:], face[:-1, 1:]
        middles.append(np.mean(corners, axis=0).reshape(-1, 3))
        normals.append(np.cross(corners[2] - corners[0], corners[3] - corners[1]).reshape(-1, 3))
    middle, normal = np.concatenate(middles), np.concatenate(normals)
    area = np.linalg.norm(normal, axis=1)
    is_there = area > 1e-12 * area.max(initial=0.0)
    return middle[is_there], normal[is_there] / area[is_there, None]


def _cylinders(nodes: np.ndarray, faces: Sequence[np.ndarray], near: float) -> Iterator[FixedSurface]:
    """The cylinder whose axis is normal to the faces' normals."""
    _, normals = _normals(faces)
    along = np.linalg.svd(normals, full_matrices=False)[2][2] if len(normals) > 2 else np.eye(3)[0]
    across = np.linalg.svd(along[None])[2][1:]
    center, radius = _circle(nodes @ across.T)
    yield from _refined(Cylinder(center @ across, along, radius), nodes)


def _cones(nodes: np.ndarray, faces: Sequence[np.ndarray], near: float) -> Iterator[FixedSurface]:
    """The cone whose apex is in the tangent planes."""
    middles, normals = _normals(faces)
    if len(normals) > 3:
        apex = np.linalg.lstsq(normals, (normals * middles).sum(axis=1), rcond=None)[0]
        along = np.linalg.svd(normals - normals.mean(axis=0), full_matrices=False)[2][2]
        along *= np.sign((nodes.mean(axis=0) - apex) @ along) or 1.0
        x = (nodes - apex) @ along
        r = np.linalg.norm(nodes - apex - x[:, None] * along, axis=1)
        angle = float(np.arctan2(r.mean(), x.mean()))
        if 0.0 < angle < 0.5 * np.pi:
            yield from _refined(Cone(apex, along, angle), nodes)


def _spheres(nodes: np.ndarray, faces: Sequence[np.ndarray], near: float) -> Iterator[FixedSurface]:
    """The sphere through the nodes."""
    center, radius = _circle(nodes)
    yield from _refined(Sphere(center, radius), nodes)


def _revolutions(nodes: np.ndarray, faces: Sequence[np.ndarray], near: float) -> Iterator[FixedSurface]:
    """Surfaces of revolution about the coordinate axes."""
    for axis in range(3):
        places = [face[..., axis] for face in faces]
        radii = [np.linalg.norm(np.delete(face, axis, axis=-1), axis=-1) for face in faces]
        profile = _profile(places, radii, near)
        if profile is not None and profile[:, 1].min() > near:
            yield Revolution((0.0, 0.0, 0.0), np.eye(3)[axis], profile)


_KINDS: dict[str, Callable[..., Iterator[FixedSurface]]] = {
    "a cylinder": _cylinders,
    "a cone": _cones,
    "a sphere": _spheres,
    "one of revolution": _revolutions,
}
"""In this order: two equal circles, as in a grid one cell deep, are on a cylinder and on a sphere."""


def _circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of the circle or sphere nearest to points, shape (n, d), in the least-squares sense."""
    middle = points.mean(axis=0)
    away = points - middle
    matrix = np.column_stack([2.0 * away, np.ones(len(away))])
    *center, rest = np.linalg.lstsq(matrix, (away * away).sum(axis=1), rcond=None)[0]
    return middle + center, float(np.sqrt(max(rest + np.dot(center, center), np.finfo(float).tiny)))


def _refined(surface: Cylinder | Cone | Sphere, nodes: np.ndarray) -> Iterator[FixedSurface]:
    """The surface of the same kind nearest to the nodes; the best so far if an iterate is not of the kind."""
    middle, size = nodes.mean(axis=0), float(np.linalg.norm(np.ptp(nodes, axis=0)))
    best = surface, _distance(surface, nodes)
    try:
        for _ in range(N_STEPS):
            values, gradients, _ = surface.levels(nodes)
            turns = np.cross(nodes - middle, gradients) / size
            columns = np.column_stack([-gradients, -turns, _shape_rates(surface, nodes)])
            step = np.linalg.lstsq(columns, -values, rcond=1e-12)[0]
            surface = _moved(surface, step[:3], step[3:6] / size, float(step[6]), middle)
            best = min(best, (surface, _distance(surface, nodes)), key=lambda found: found[1])
    except (InputError, MovementError):
        pass  # as for points in a plane: the previous surface counts
    yield best[0]


def _shape_rates(surface: Cylinder | Cone | Sphere, nodes: np.ndarray) -> np.ndarray:
    """Derivatives of the distances, shape (n,), with respect to the radius or half angle."""
    if not isinstance(surface, Cone):
        return np.full(len(nodes), -1.0)
    x = (nodes - surface.origin) @ surface.direction
    r = np.linalg.norm(nodes - surface.origin - x[:, None] * np.asarray(surface.direction), axis=1)
    return -r * np.sin(surface.half_angle) - x * np.cos(surface.half_angle)


def _moved(
    surface: Cylinder | Cone | Sphere, shift: np.ndarray, turn: np.ndarray, change: float, middle: np.ndarray
) -> Cylinder | Cone | Sphere:
    """Shift a surface, turn it about a point by a small angle (rad), and change its radius or half angle."""
    if isinstance(surface, Sphere):
        center = surface.center + shift + np.cross(turn, surface.center - middle)
        return replace(surface, center=center, radius=surface.radius + change)
    origin = surface.origin + shift + np.cross(turn, surface.origin - middle)
    along = surface.direction + np.cross(turn, surface.direction)
    along /= np.linalg.norm(along)
    if isinstance(surface, Cone):
        return replace(surface, origin=origin, direction=along, half_angle=surface.half_angle + change)
    return replace(surface, origin=origin, direction=along, radius=surface.radius + change)


def _profile(places: Sequence[np.ndarray], radii: Sequence[np.ndarray], near: float) -> np.ndarray | None:
    """Places along an axis and radii, shape (m, 2), of a smooth curve; None if there is none."""
    # the places and radii of the nodes of each face are arrays (ni, nj)
    stations = [_stations(*of_face, near) for of_face in zip(places, radii)]
    rings = [of_face for of_face in stations if of_face is not None]
    if len(rings) == len(stations):
        return _merged(np.concatenate(rings), near)
    x, r = (np.concatenate([values.ravel() for values in parts]) for parts in (places, radii))
    order = np.argsort(x)
    x, r, n = x[order], r[order], 4
    while N_PER_INTERVAL * n <= len(x):
        inner = x[np.arange(1, n) * len(x) // n]
        try:
            spline = make_lsq_spline(x, r, np.concatenate([[x[0]] * 4, inner, [x[-1]] * 4]))
        except (ValueError, np.linalg.LinAlgError):
            return None  # nodes are spread too unevenly for so many intervals
        if np.abs(spline(x) - r).max() <= 0.5 * near:
            knots = np.concatenate([x[:1], inner, x[-1:]])
            between = np.unique(np.concatenate([knots, 0.5 * (knots[1:] + knots[:-1])]))
            return np.column_stack([between, spline(between)])
        n *= 2
    return None


def _stations(x: np.ndarray, r: np.ndarray, near: float) -> np.ndarray | None:
    """Places and radii, shape (n, 2), of the rings that grid lines of a face are; None if they are not rings."""
    for direction in (0, 1):
        if max(np.ptp(values, axis=direction).max() for values in (x, r)) <= near:
            return np.column_stack([values.mean(axis=direction) for values in (x, r)])
    return None


def _merged(stations: np.ndarray, near: float) -> np.ndarray | None:
    """Stations in order, coincident ones merged; None if they are too few for a curve."""
    stations = stations[np.argsort(stations[:, 0])]
    firsts = np.concatenate([[0], np.flatnonzero(np.diff(stations[:, 0]) > near) + 1])
    counts = np.diff(np.append(firsts, len(stations)))
    return np.add.reduceat(stations, firsts) / counts[:, None] if len(firsts) >= 4 else None
