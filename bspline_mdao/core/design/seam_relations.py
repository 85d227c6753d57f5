"""Relations between derivatives at seams and poles that keep a surface smooth, at many places along every seam.

Theory: ``docs/theory/linear_constraints.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, vstack

from ...base.display import OneLine
from ...base.numerics.vectors import dots, lengths, unit_vectors
from ..mesh.seams import Pole, Seam

__all__ = ["SeamRelations", "pole_relations", "relations_along"]

NO_LENGTH = 1e-12
"""Length of a derivative, relative to the mesh, that counts as zero: the edge has collapsed."""

PARALLEL = 1e-9
"""Sine of the angle between derivatives that counts as zero: there is no tangent plane."""


@dataclass(frozen=True, eq=False)
class SeamRelations(OneLine):
    """Combinations of control points that vanish where a surface is smooth, and have to stay zero."""

    # Each is ``L + r R + s T`` at a place of a seam, or of the legs of a pole, in units of a displacement.

    weights: csr_array  # (n, n_surface), weights of surface control points
    at: np.ndarray  # int (n,), row of the nearest control point of each
    sizes: np.ndarray  # (n,), square root of the fraction of a control point's surroundings represented by each
    normals: np.ndarray  # (n, 3), unit normals of the mean tangent plane
    kinks: np.ndarray  # (n,), angles between both tangent planes, or at a pole between a leg and the plane of all (deg)
    # unit normals of the symmetry planes within which a combination vanishes, next to the mirror image of a side; zero
    # elsewhere
    mirrors: np.ndarray  # (n, 3)

    def part(self, chosen: np.ndarray) -> SeamRelations:
        """Return some of them."""
        return SeamRelations(
            csr_array(self.weights[chosen]),
            self.at[chosen],
            self.sizes[chosen],
            self.normals[chosen],
            self.kinks[chosen],
            self.mirrors[chosen],
        )

    @staticmethod
    def joined(parts: Sequence[SeamRelations], n_surface: int) -> SeamRelations:
        """Return all relations of several seams and poles."""
        none = np.zeros(0)
        return SeamRelations(
            vstack([csr_array((0, n_surface)), *(part.weights for part in parts)], format="csr"),
            np.concatenate([none.astype(np.int64), *(part.at for part in parts)]),
            np.concatenate([none, *(part.sizes for part in parts)]),
            np.concatenate([np.zeros((0, 3)), *(part.normals for part in parts)]),
            np.concatenate([none, *(part.kinks for part in parts)]),
            np.concatenate([np.zeros((0, 3)), *(part.mirrors for part in parts)]),
        )


def relations_along(
    seam: Seam,
    points: np.ndarray,  # (n_surface, 3), surface control points (m)
    size: float,  # size of the mesh (m). Places where a derivative vanishes are left out
) -> SeamRelations:
    """Find ``L + r R + s T`` of a surface along a seam, with r and s from the mean tangent plane."""
    # Next to a mirror image R is the image of L, and r is one: the sum L + R has no component across the symmetry
    # plane, and its component in the plane is the one of ``2 L``, whose weights are used. Splines are evaluated at
    # order plus one Gauss points in every span; quads between points, which are smooth nowhere else, at the points.
    t, parts = _places(seam)
    left, right, tangent = derivatives(seam, t, points)
    is_there = np.min([lengths(left), lengths(right), lengths(tangent)], axis=0) > NO_LENGTH * size
    t, parts, left, right, tangent = (x[is_there] for x in (t, parts, left, right, tangent))
    normals = _unit_normals(left, tangent), _unit_normals(tangent, right)
    kinks = np.degrees(np.arctan2(lengths(np.cross(*normals)), dots(*normals)))
    kinks = np.where(np.min([lengths(n) for n in normals], axis=0) > 0.5, kinks, 180.0)
    middle = unit_vectors(normals[0] + normals[1], normals[0], NO_LENGTH)
    speed = lengths(tangent)[:, None]
    across = np.cross(tangent / speed, middle)  # in the mean plane, perpendicular to the seam
    ratios = -dots(left, across) / np.where(kinks < 90.0, dots(right, across), 1.0)
    along = -dots(left + ratios[:, None] * right, tangent / speed) / speed[:, 0]
    weights = _weights(seam, t, ratios, along, len(points))
    greville = seam.first.greville()
    at = seam.first.line(0)[np.abs(t[:, None] - greville).argmin(axis=1)]
    mirrors = np.tile(np.zeros(3) if seam.mirror is None else seam.mirror, (len(t), 1))
    return SeamRelations(weights, at, np.sqrt(parts * len(greville)), middle, kinks, mirrors)


def derivatives(seam: Seam, t: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives into the first and the second side, and along the seam, each of shape (n, 3)."""
    on_line, found = points[seam.first.line(0)], []
    for edge in (seam.first, seam.second):
        inner, on, _ = edge.weights(t)
        found.append(inner @ points[edge.line(1)] + on @ on_line)
    if seam.mirror is not None:
        found[1] -= 2.0 * np.outer(found[1] @ seam.mirror, seam.mirror)
    return found[0], found[1], seam.first.weights(t)[2] @ on_line


def pole_relations(
    pole: Pole,
    points: np.ndarray,  # (n_surface, 3), surface control points (m)
    size: float,  # size of the mesh (m)
    *,
    # relations that keep m legs in some plane: m - 2 of their combinations. Otherwise the legs themselves, whose normal
    # components are to vanish
    is_linear: bool,
) -> SeamRelations:
    """Find relations between the legs from a pole to the control points around it that keep these in one plane."""
    ring = pole.ring[lengths(points[pole.ring] - points[pole.at]) > NO_LENGTH * size]
    legs = points[ring] - points[pole.at]
    length = lengths(legs)
    unit = legs / length[:, None]
    _, _, axes = np.linalg.svd(unit, full_matrices=False)
    normal = axes[-1] if len(axes) == 3 else np.zeros(3)
    kink = np.degrees(np.arcsin(np.abs(unit @ normal).clip(0.0, 1.0))).max(initial=0.0)
    combined = np.eye(len(ring))
    if is_linear:  # combinations orthogonal to both coordinates of the legs in the plane
        combined = np.linalg.svd(unit @ axes[:2].T)[0][:, 2:].T
    rows = np.zeros((len(combined), len(points)))
    rows[:, ring] = combined / length * length.mean()
    rows[:, pole.at] = -rows.sum(axis=1)
    n = len(rows)
    normals, at, kinks = np.tile(normal, (n, 1)), np.full(n, pole.at), np.full(n, kink)
    return SeamRelations(csr_array(rows), at, np.ones(n), normals, kinks, np.zeros((n, 3)))


def _places(seam: Seam) -> tuple[np.ndarray, np.ndarray]:
    """Places along a seam, and the fraction of it represented by each."""
    knots = seam.first.side.edge_knots(1 - seam.first.axis, seam.first.end)
    if knots.order < 3:
        t = seam.first.greville()
        return t, np.full(len(t), 1.0 / len(t))
    x, w = np.polynomial.legendre.leggauss(knots.order + 1)
    spans = np.unique(knots.knots)
    starts, widths = spans[:-1, None], np.diff(spans)[:, None]
    t, parts = (starts + 0.5 * widths * (x + 1.0)).ravel(), (0.5 * widths * w).ravel()
    return (1.0 - t[::-1], parts[::-1]) if seam.first.is_reversed else (t, parts)


def _weights(seam: Seam, t: np.ndarray, ratios: np.ndarray, along: np.ndarray, n_surface: int) -> csr_array:
    """Weights of surface control points in ``L + r R + s T``, scaled such that weights of inner lines sum to one."""
    first, second = seam.first.weights(t), seam.second.weights(t)
    ratio, slope = ratios[:, None], along[:, None]
    scale = 1.0 / np.maximum(first[0].sum(axis=1) + ratios * second[0].sum(axis=1), first[0].sum(axis=1))[:, None]
    found = csr_array((len(t), n_surface))
    for columns, weights in (
        (seam.first.line(1), first[0]),
        (seam.second.line(1), ratio * second[0]),
        (seam.first.line(0), first[1] + ratio * second[1] + slope * first[2]),
    ):
        rows, places = weights.nonzero()
        entries = ((weights * scale)[rows, places], (rows, columns[places]))
        found = found + coo_array(entries, shape=found.shape).tocsr()
    return csr_array(found)


def _unit_normals(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Unit normals to pairs of vectors, shape (n, 3); zero if they are parallel."""
    crossed = np.cross(a / lengths(a)[:, None], b / lengths(b)[:, None])
    return unit_vectors(crossed, np.zeros(3), PARALLEL)
