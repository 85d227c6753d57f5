"""Seams between sides of blocks stay smooth: one tangent plane on either side (G1), as linear equations.

Theory: ``docs/theory/linear_constraints.rst``.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, eye_array, kron, vstack
from scipy.sparse.linalg import lsqr

from ..errors import InputError
from ..mesh.moving_mesh import MovingMesh
from ..mesh.seams import Seam, seams_of_mesh
from ..numerics.vectors import dots, lengths, unit_vectors
from ..shown import OneLine
from .elimination import Equations
from .selection import Where, rows_of

__all__ = ["TangentContinuity"]

SAME_RELATION = 0.1
"""Where seams meet, their relations between unit vectors count as one where they differ by less than this part."""

NO_LENGTH = 1e-12
"""Length of a derivative, relative to the mesh, that is none: the edge has collapsed."""

PARALLEL = 1e-9
"""Sine of an angle between derivatives that is none: there is no tangent plane."""

DIGITS = 1e-14
"""Relative accuracy of the least change of the points that makes seams smooth."""


@dataclass(frozen=True, eq=False)
class TangentContinuity(OneLine):
    """Seams between sides of blocks keep one tangent plane (G1), at noses as well as within a surface.

    At as many places along a seam as it has control points, the derivatives into both sides and the one along the seam
    keep the relation ``L + r R + s T = 0`` that they have on the baseline. The points on the seam follow those on
    either side, where nothing else constrains them.

    Parameters
    ----------
    where : Selection, array_like of int or None
        Points on seams, as rows of ``mesh.surface_ids`` in case of numbers; what else is selected does not count. By
        default all at which the baseline is smooth.
    max_kink : float
        Largest angle between the tangent planes of the baseline at which it counts as smooth (deg).
    name : str
        For messages.

    Examples
    --------
    >>> from bspline_mdao import TangentContinuity, ball_grid, fit_grid, moving_mesh
    >>> mesh = moving_mesh(fit_grid(ball_grid((5, 5, 5, 5))))
    >>> smooth = TangentContinuity(max_kink=30.0)
    >>> smooth.equations(mesh, mesh.points[mesh.surface_ids]).matrix.shape[1] == 3 * mesh.surface_ids.size
    True
    """

    where: Where | None = None
    max_kink: float = 5.0
    name: str = "tangent continuity"

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations ``L + r R + s T = 0`` on the derivatives of displacements, at every smooth place of a seam.

        Raises
        ------
        InputError
            If no point is on a seam, or the baseline has a kink at one that was asked for.
        """
        wanted = None if self.where is None else rows_of(self.where, mesh, f"linear constraint '{self.name}'")
        places = [_Places.of(seam, points, NO_LENGTH * mesh.size, wanted) for seam in seams_of_mesh(mesh)]
        self._check(mesh, places)
        smooth = [place.part(place.kinks <= self.max_kink) for place in places]
        matrices = [place.matrix(len(points)) for place in smooth]
        at = [place.at[place.is_inside] for place in smooth]
        corners, corners_at = _corner_relations(smooth, points)
        weights = vstack([*matrices, corners], format="csr")
        rows = np.concatenate([*at, corners_at]).astype(np.int64)
        preferred = (3 * rows[:, None] + np.arange(3)).ravel()
        return Equations(csr_array(kron(weights, eye_array(3), format="csr")), np.repeat(rows, 3), preferred)

    def snapped(self, mesh: MovingMesh, points: np.ndarray) -> np.ndarray:
        """Points whose seams are smooth: the least change (in the sum of squares) that takes away what kinks there are.

        A fit has small kinks, which the equations keep: they are about displacements. Begin from these points instead.

        Parameters
        ----------
        mesh : MovingMesh
            The control mesh, whose symmetry planes keep their points.
        points : ndarray, shape (n_surface, 3)
            Surface control points (m).

        Returns
        -------
        ndarray, shape (n_surface, 3)
        """
        matrix = self.equations(mesh, points).matrix
        planes = Equations.of(len(points), mesh.in_plane_rows[:, None], mesh.in_plane_normals[:, None, None]).matrix
        right = np.concatenate([-(matrix @ points.ravel()), np.zeros(planes.shape[0])])
        everything = vstack([matrix, planes], format="csr")
        change = lsqr(everything, right, atol=DIGITS, btol=DIGITS, iter_lim=20 * everything.shape[1])[0]
        return points + change.reshape(-1, 3)

    def _check(self, mesh: MovingMesh, places: list[_Places]) -> None:
        """Refuse to be about nothing, and kinks where smoothness was asked for."""
        kinks = np.concatenate([np.zeros(0), *(place.kinks for place in places)])
        if not len(kinks) or (self.where is None and not (kinks <= self.max_kink).any()):
            raise InputError(
                f"linear constraint '{self.name}': no point is on a seam at which the surface is smooth; leave it out"
            )
        if self.where is not None and not (kinks <= self.max_kink).all():
            worst = np.argmax(kinks)
            place = mesh.place_of_surface_point(np.concatenate([place.at for place in places])[worst])
            raise InputError(
                f"linear constraint '{self.name}': the surface has a kink of {kinks[worst]:.3g} deg at "
                f"{place}; leave it out, or raise max_kink from {self.max_kink:g}"
            )


def _unit_normals(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Unit normals of vectors, shape (n, 3); zero where these are parallel."""
    crossed = np.cross(a / lengths(a)[:, None], b / lengths(b)[:, None])
    return unit_vectors(crossed, np.zeros(3), PARALLEL)


@dataclass(frozen=True, eq=False)
class _Places:
    """Places of a seam: the relation of the derivatives there, and the angle between the two tangent planes.

    Parameters
    ----------
    seam : Seam
        The seam.
    t : ndarray, shape (n,)
        The places.
    at : ndarray of int, shape (n,)
        Row of the control point that each belongs to.
    relations : ndarray, shape (n, 3)
        Factors 1, r and s of the derivatives into the first and the second side, and along the seam.
    kinks : ndarray, shape (n,)
        Angles (deg).
    """

    seam: Seam
    t: np.ndarray
    at: np.ndarray
    relations: np.ndarray
    kinks: np.ndarray

    @classmethod
    def of(cls, seam: Seam, points: np.ndarray, smallest: float, wanted: np.ndarray | None) -> _Places:
        """Look at the baseline; places at which a derivative vanishes, or that nobody wants, are left out."""
        t, at = seam.first.greville(), seam.first.line(0)
        left, right, tangent = _derivatives(seam, t, points)
        is_there = np.min([lengths(left), lengths(right), lengths(tangent)], axis=0) > smallest
        is_there &= np.ones(len(t), dtype=bool) if wanted is None else np.isin(at, wanted)
        t, at, left, right, tangent = (x[is_there] for x in (t, at, left, right, tangent))
        normals = _unit_normals(left, tangent), _unit_normals(tangent, right)
        kinks = np.degrees(np.arctan2(lengths(np.cross(*normals)), dots(*normals)))
        kinks = np.where(np.min([lengths(n) for n in normals], axis=0) > 0.5, kinks, 180.0)
        middle = unit_vectors(normals[0] + normals[1], normals[0], NO_LENGTH)
        size = lengths(tangent)[:, None]
        across = np.cross(tangent / size, middle)  # in the mean plane, at right angles to the seam
        ratios = -dots(left, across) / np.where(kinks < 90.0, dots(right, across), 1.0)
        along = -dots(left + ratios[:, None] * right, tangent / size) / size[:, 0]
        return cls(seam, t, at, np.stack([np.ones_like(ratios), ratios, along], axis=1), kinks)

    @property
    def is_inside(self) -> np.ndarray:
        """Whether each is not an end of the seam, where others may meet it."""
        return (self.t > 0.0) & (self.t < 1.0)

    def part(self, chosen: np.ndarray) -> _Places:
        return _Places(self.seam, self.t[chosen], self.at[chosen], self.relations[chosen], self.kinks[chosen])

    def matrix(self, n_surface: int) -> csr_array:
        """Weights of surface control points in the relations inside, each row scaled by that of its own point."""
        inside = self.part(self.is_inside)
        found = csr_array((len(inside.t), n_surface))
        for columns, weights in _terms(self.seam, inside.t, inside.relations):
            rows, places = weights.nonzero()
            entries = (weights[rows, places], (rows, columns[places]))
            found = found + coo_array(entries, shape=found.shape).tocsr()
        own = np.abs(found[np.arange(len(inside.t)), inside.at]) if len(inside.t) else np.zeros(0)
        return csr_array(found.multiply((1.0 / np.asarray(own).ravel())[:, None]))


def _terms(seam: Seam, t: np.ndarray, relations: np.ndarray):
    """Lines of control points, and their weights in ``L + r R + s T``."""
    first, second = seam.first.weights(t), seam.second.weights(t)
    one, ratio, along = relations.T[..., None]
    yield seam.first.line(1), one * first[0]
    yield seam.second.line(1), ratio * second[0]
    yield seam.first.line(0), one * first[1] + ratio * second[1] + along * first[2]


def _derivatives(seam: Seam, t: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives into the first and the second side, and along the seam, each of shape (n, 3)."""
    own, found = points[seam.first.line(0)], []
    for edge in (seam.first, seam.second):
        inner, on, _ = edge.weights(t)
        found.append(inner @ points[edge.line(1)] + on @ own)
    return found[0], found[1], seam.first.weights(t)[2] @ own


def _corner_relations(places: list[_Places], points: np.ndarray) -> tuple[csr_array, np.ndarray]:
    """Relations at the ends of seams: those of all that meet in a point, without those that follow from others.

    There derivatives are along the first legs of control polygons. Seams that cross ask for relations between the same
    legs, which agree where the baseline is smooth: of unit legs, singular vectors of all relations that meet are kept
    where they are not small.
    """
    legs: dict[int, list[dict[int, float]]] = defaultdict(list)
    for place in places:
        for n in np.flatnonzero(~place.is_inside):
            relation: dict[int, float] = defaultdict(float)
            for columns, weights in _terms(place.seam, place.t[[n]], place.relations[[n]]):
                for column in np.flatnonzero(weights[0]):
                    relation[int(columns[column])] += weights[0, column]
            legs[int(place.at[n])].append(relation)
    rows, at = [], []
    for corner, relations in legs.items():
        others = sorted({leg for relation in relations for leg in relation if leg != corner})
        size = lengths(points[others] - points[corner])
        table = np.array([[relation.get(leg, 0.0) for leg in others] for relation in relations]) * size
        table /= lengths(table)[:, None]
        _, singular, vectors = np.linalg.svd(table, full_matrices=False)
        for vector in vectors[singular > SAME_RELATION * singular[0]]:
            factors = vector / size
            row = np.zeros(len(points))
            row[others], row[corner] = factors, -factors.sum()
            rows.append(row / np.abs(row).max())
            at.append(corner)
    return csr_array(np.array(rows).reshape(-1, len(points))), np.array(at, dtype=np.int64)
