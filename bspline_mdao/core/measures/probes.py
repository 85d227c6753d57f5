"""Probes: points fixed in the parameters of a surface, found where straight lines cross it.

A probe is a weighted mean of the corners of a quad, bilinear in its baseline position. It moves with the material of
the surface: a constant sparse linear map of the nodes. Theory: ``docs/theory/geometry.rst``, "Probes".

References
----------
S. D. Ramsey, K. Potter and C. Hansen, Ray bilinear patch intersections, *Journal of Graphics Tools* 9(3), 2004: the
quadratic equation of a crossing.

W. H. Press et al., *Numerical Recipes*, section 5.6: its roots without cancellation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from ...base.checks import as_numbers
from ...base.numerics.vectors import cross_2d, lengths
from ...errors import InputError
from ..mesh.surface import SurfaceGrid

__all__ = [
    "FLAT",
    "ROUND_OFF",
    "Crossings",
    "Probes",
    "as_points",
    "body_intervals",
    "find_crossings",
    "opposite_probes",
]

_TOUCH = 1e-9
"""Distance, relative to the diagonal of the surface's box, at which a line still meets a quad: lines through a seam of
the grid or in a symmetry plane must not slip between quads."""

_GRAZE = 1e-9
"""Sine of the angle below which a line runs along a quad instead of crossing it: it neither enters nor leaves there."""

FLAT = 1e-9
"""Length, relative to the diagonal of the surface's box, that counts as zero."""

ROUND_OFF = 1e-13
"""Thickness, relative to the same diagonal, that has no direction."""


@dataclass(frozen=True, eq=False)
class Probes:
    """Points of a surface that are fixed weighted means of its nodes."""

    nodes: np.ndarray  # int (n, m), nodes of each, possibly repeated
    weights: np.ndarray  # (n, m), weights of the nodes, of sum 1

    @property
    def n_probes(self) -> int:
        """Number of probes."""
        return len(self.nodes)

    def at(self, points: np.ndarray) -> np.ndarray:
        """Positions of the probes, shape (n, 3), from nodes, shape (n_points, 3); real or complex."""
        return np.einsum("nm,nmd->nd", self.weights, points[self.nodes])

    def matrix(self, n_points: int) -> csr_array:
        """The map from nodes to probes, shape (n, n_points)."""
        rows = np.repeat(np.arange(self.n_probes), self.nodes.shape[1])
        return csr_array((self.weights.ravel(), (rows, self.nodes.ravel())), shape=(self.n_probes, n_points))

    def take(self, rows: np.ndarray | slice) -> Probes:
        """Some of the probes, in the order of ``rows``."""
        return Probes(self.nodes[rows], self.weights[rows])

    @classmethod
    def on_quads(cls, quads: np.ndarray, parameters: np.ndarray) -> Probes:
        """Probes on quads, shape (n, 4), at their parameters, shape (n, 2), from 0 to 1."""
        s, t = parameters.T
        return cls(quads, np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=1))


def opposite_probes(
    surface: SurfaceGrid,  # the surface, on its baseline
    points: np.ndarray,  # (n, 3), a point of each line (m): inside the body, or near it
    directions: np.ndarray,  # (3,) or (n, 3), directions of the lines, of any length
    what: str = "probes",  # purpose of the probes, for messages
) -> tuple[Probes, Probes]:
    """Find where lines through points enter and leave a body."""
    # Lines enter where they run against the normal into the fluid and leave where they run along it. Quads grazed by a
    # line, within 1e-9 rad, are ignored.
    # `InputError` if an array has the wrong shape, a direction has zero length, or a line does not cross the body
    # returns entries, exits: ends of the part of each line within the body that contains its point, or else is nearest
    # to it. A line through a seam of the grid gets the quad with the lowest number
    points, directions = as_points(points, what), _as_directions(directions, len(points), what)
    found = find_crossings(surface, points, directions)
    entries, exits = body_intervals(found, FLAT * surface.size)
    _require_all(entries.line, points, what)
    first, last = (Probes.on_quads(surface.quads[ends.quad], ends.parameters) for ends in (entries, exits))
    return first, last


def as_points(points: ArrayLike, what: str) -> np.ndarray:
    """Return finite points as an array of shape (n, 3)."""
    points = np.atleast_2d(as_numbers(points, what))
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise InputError(f"{what}: points of shape {points.shape}; give shape (n, 3)")
    if not np.isfinite(points).all():
        raise InputError(
            f"{what}: point {int(np.argmin(np.isfinite(points).all(axis=1))) + 1} is not finite; repair it"
        )
    return points


def _as_directions(directions: ArrayLike, n: int, what: str) -> np.ndarray:
    directions = as_numbers(directions, f"{what}: directions")
    if directions.shape not in ((3,), (n, 3)):
        raise InputError(f"{what}: directions of shape {directions.shape}; give shape (3,) or ({n}, 3)")
    directions = np.broadcast_to(directions, (n, 3))
    if not (np.isfinite(directions).all() and (lengths(directions) > 0.0).all()):
        raise InputError(f"{what}: a direction has no length, or is not finite; correct it")
    return directions


def _require_all(lines: np.ndarray, points: np.ndarray, what: str) -> None:
    """Refuse lines that do not cross the body."""
    missed = np.setdiff1d(np.arange(len(points)), lines)
    if len(missed):
        x, y, z = points[missed[0]]
        raise InputError(
            f"{what}: the line of probe {missed[0] + 1} of {len(points)}, through ({x:g}, {y:g}, {z:g}), does not "
            f"cross the surface from one side to the other; move it inside the surface, or turn it"
        )


class Crossings(NamedTuple):
    """Crossings of lines with quads, line by line."""

    # line and quad of each
    line: np.ndarray  # int (n,)
    quad: np.ndarray  # int (n,)
    parameters: np.ndarray  # (n, 2), position in the quad, from 0 to 1
    depth: np.ndarray  # (n,), distance along the line from its point (m)
    is_exit: np.ndarray  # bool (n,), whether the line runs along the normal of the quad, not against it

    def take(self, rows: np.ndarray) -> Crossings:
        """Some of them, in the order of ``rows``."""
        return Crossings(*(values[rows] for values in self))


def find_crossings(
    surface: SurfaceGrid,  # the surface, on its baseline
    # a point of each line (m), and its direction
    points: np.ndarray,  # (n, 3)
    directions: np.ndarray,  # (n, 3)
) -> Crossings:
    """Find all crossings of lines with the bilinear quads of a surface."""
    # 1. Quads whose box, seen along a line, contains the line are candidates.
    # 2. Their corners are seen along the line, which becomes the third axis through the origin.
    # 3. Two pairs of parameters may place the origin of the first two coordinates in a quad.
    # 4. The ones that do so within a tolerance are crossings, unless the line grazes the quad.
    # 5. Crossings are sorted by lines and quads.
    frames = _frames(directions)
    touch = _TOUCH * surface.size
    # step 1
    near = [_near_line(surface.points, surface.quads, *line, touch) for line in zip(points, frames)]
    line, quad = np.repeat(np.arange(len(points)), [len(ids) for ids in near]), np.concatenate(near)
    # step 2
    corners = np.einsum("ncd,ned->nce", surface.points[surface.quads[quad]] - points[line, None], frames[line])
    # steps 3 and 4
    pairs = [_crossing(corners, parameters, touch) for parameters in _meeting(corners[..., :2])]
    found = [Crossings(line[is_met], quad[is_met], *(x[is_met] for x in rest)) for is_met, *rest in pairs]
    # step 5
    joined = Crossings(*map(np.concatenate, zip(*found)))
    return joined.take(np.lexsort((joined.quad, joined.line)))


def body_intervals(
    found: Crossings,  # all crossings
    tolerance: float,  # thickness (m) that counts as zero: there the line enters before it leaves
) -> tuple[Crossings, Crossings]:  # entries, exits: the ends of the parts, one for every line with a part
    """Find the part of every line within the body that contains the point of the line, or else is nearest to it."""
    # along each line; entries count as nearer by the tolerance, so a flat body is entered before it is left
    found = found.take(np.lexsort((found.quad, found.depth - tolerance * ~found.is_exit, found.line)))
    inside = np.flatnonzero((np.diff(found.line) == 0) & ~found.is_exit[:-1] & found.is_exit[1:])
    miss = np.maximum(np.maximum(found.depth[inside], -found.depth[inside + 1]), 0.0)
    inside = inside[np.lexsort((miss, found.line[inside]))]
    chosen = inside[np.unique(found.line[inside], return_index=True)[1]]
    return found.take(chosen), found.take(chosen + 1)


def _frames(directions: np.ndarray) -> np.ndarray:
    """Two directions across each line and the unit direction along it, as rows, shape (n, 3, 3)."""
    along = directions / np.linalg.norm(directions, axis=1)[:, None]
    start = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    across = np.cross(along, start)
    across /= np.linalg.norm(across, axis=1)[:, None]
    return np.stack([across, np.cross(along, across), along], axis=1)


@njit(cache=True)
def _near_line(points, quads, origin, frame, touch):
    """Quads whose box, seen along a line, contains the line: they have corners on all four sides of it."""
    sides = np.empty(len(points), dtype=np.uint8)
    for n in range(len(points)):
        x, y, z = points[n, 0] - origin[0], points[n, 1] - origin[1], points[n, 2] - origin[2]
        a = x * frame[0, 0] + y * frame[0, 1] + z * frame[0, 2]
        b = x * frame[1, 0] + y * frame[1, 1] + z * frame[1, 2]
        sides[n] = (a <= touch) | (a >= -touch) << 1 | (b <= touch) << 2 | (b >= -touch) << 3
    is_near = np.empty(len(quads), dtype=np.bool_)
    for q in range(len(quads)):
        is_near[q] = (sides[quads[q, 0]] | sides[quads[q, 1]] | sides[quads[q, 2]] | sides[quads[q, 3]]) == 15
    return np.flatnonzero(is_near)


def _meeting(corners: np.ndarray) -> Iterator[np.ndarray]:
    """Two pairs of parameters, each shape (n, 2), at which plane quads, shape (n, 4, 2), may contain the origin."""
    # With ``x = a + b s + c t + d s t`` the first parameter drops out of ``(a + c t) x (b + d t) = 0``.
    a, b, c = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    d = corners[:, 2] - corners[:, 3] - b
    for t in _roots(cross_2d(c, d), cross_2d(a, d) + cross_2d(c, b), cross_2d(a, b)):
        t = np.clip(t, 0.0, 1.0)[:, None]
        side = b + d * t
        length = np.sum(side * side, axis=1)
        s = -np.sum((a + c * t) * side, axis=1) / np.where(length > 0.0, length, 1.0)
        yield np.column_stack([np.clip(s, 0.0, 1.0), t])


def _roots(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both roots c / q and q / a of ``a t^2 + b t + c``, 0 if there is none (Numerical Recipes, section 5.6)."""
    # one sign of the root: b and the root do not cancel
    q = -0.5 * (b + np.copysign(np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0)), b))
    return _ratio(c, q), _ratio(q, a)


def _ratio(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """``p / q`` if it is a parameter of a quad or near one, else 0."""
    is_small = np.abs(p) < 2.0 * np.abs(q)
    return np.where(is_small, p, 0.0) / np.where(is_small, q, 1.0)


def _crossing(
    corners: np.ndarray, parameters: np.ndarray, touch: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Whether lines meet quads at parameters, the parameters, depths, and whether the lines leave there."""
    # Corners, shape (n, 4, 3), are seen along the line, which is the third axis.
    s, t = parameters.T[..., None]
    a, b, c, d = np.moveaxis(corners, 1, 0)
    place = (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * d + s * c)
    normal = np.cross((1 - t) * (b - a) + t * (c - d), (1 - s) * (d - a) + s * (c - b))
    is_met = np.abs(place[:, :2]).max(axis=1) <= touch
    is_met &= np.abs(normal[:, 2]) > _GRAZE * np.linalg.norm(normal, axis=1)
    return is_met, parameters, place[:, 2], normal[:, 2] > 0.0
