"""Surface control points moved by a coarser net, which is refined by knot insertion without changing the shape.

Only some of the surface's inner knots are kept. The displacements of the control points are a spline on the kept knots,
brought to all knots by knot insertion. That takes fewer values, and each further knot adds some. A finer net reproduces
every shape of a coarser one to round-off, on curved knots too. Theory: ``docs/theory/progressive.rst``.

References
----------
X. Han and D. W. Zingg, An adaptive geometry parametrization for aerodynamic shape optimization, *Optimization and
Engineering* 15, 2014.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array, csr_array, eye_array, kron

from ...base.display import OneLine
from ...base.numerics.vectors import lengths
from ...errors import InputError
from ..mesh.control_net import surface_quads
from ..mesh.moving_mesh import MovingMesh
from ..model.fitted_model import FittedModel
from ..splines.knot_insertion import insertion_matrix
from ..splines.knots import ConstantKnots
from .displacement import Displacement, Local
from .surface_strips import SurfaceStrips, face_edges
from .variable import AuxiliaryPoints, Layout

__all__ = ["CoarseNet", "Refinement"]

SAME = 1e-12
"""Difference in weights up to which two faces agree on a shared control point."""

Knot = tuple[int, int]
"""An inner knot of the surface: number of its strip, and its number among the strip's inner knots, both from 0."""


@dataclass(frozen=True, eq=False)
class Refinement(OneLine):
    """Map from the values of a coarse net to the values of a finer one."""

    matrix: csr_array  # (n_fine, n_coarse), knot insertion, without negative entries

    def values(self, coarse: np.ndarray) -> np.ndarray:
        """Values of the finer net, shape (n_fine,), that move the surface like the coarse values."""
        return self.matrix @ np.asarray(coarse)

    def bounds(
        self,
        # bounds of the coarse values; infinite if there is none
        lower: ArrayLike,  # float or array_like (n_coarse,)
        upper: ArrayLike,  # float or array_like (n_coarse,)
    ) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the finer values that contain every shape within the coarse bounds."""
        # returns lower, upper (n_fine,): next to fixed points, too, as wide as the bounds of the points that are
        # followed
        low, high = (np.broadcast_to(np.asarray(b, dtype=float), self.matrix.shape[1]) for b in (lower, upper))
        if np.isnan(low).any() or np.isnan(high).any() or (low > high).any():
            raise InputError("refinement: a lower bound is above the upper one, or a bound is not a number; correct it")
        with np.errstate(invalid="ignore"):
            return -self._of_bound(-low), self._of_bound(high)

    def _of_bound(self, bound: np.ndarray) -> np.ndarray:
        """An upper bound: weighted, and at least the mean of the bounds of the points followed."""
        is_none = bound == np.inf
        sums = self.matrix @ np.where(is_none, 0.0, bound)
        sums = np.maximum(sums, sums / (self.matrix @ np.ones(len(bound))))
        sums[self.matrix @ is_none.astype(float) > 0.0] = np.inf
        return sums


@dataclass(frozen=True, eq=False)
class CoarseNet(OneLine):
    """A `Local` variable moved by fewer control points. Made by `CoarseNet.of`, refined by `refine`.

    The values belong to the points of the coarse net, as many per point as `Local` has for a control point. Points that
    would move control points not selected by `Local` are left out.

    Parameters
    ----------
    variable : Local
        The moved control points, their directions, and the name.
    surface : SurfaceStrips
        Faces of the surface, and the strips of their knots.
    mesh : MovingMesh
        The control mesh.
    kept : tuple of ndarray of bool
        For each strip, which of its inner knots belong to the net.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import CoarseNet, Local, OnPatch, Parametrization
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> model = fit_grid(onera_m6_grid((9, 9, 7)), n_control=(7, 5, 6))
    >>> mesh = moving_mesh(model)
    >>> net = CoarseNet.of(model, mesh, Local("bumps", OnPatch(model, "wing_upper"), "y"), n=4)
    >>> finer = net.refine(net.halves())
    >>> [Parametrization(mesh, [each]).initial["bumps"].size for each in (net, finer)]
    [6, 12]
    >>> values = net.to(finer).values([0.01, 0.0, 0.0, 0.01, 0.0, 0.0])  # of the same shape
    >>> values.shape, values.max().round(6).item()
    ((12,), 0.01)
    """

    variable: Local
    surface: SurfaceStrips
    mesh: MovingMesh
    kept: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, model: FittedModel, mesh: MovingMesh, variable: Local, n: int | Sequence[int] = 4) -> CoarseNet:
        """Make a net of evenly chosen knots.

        Parameters
        ----------
        model : FittedModel
            The fitted grid.
        mesh : MovingMesh
            Its control mesh.
        variable : Local
            The moved control points and their directions.
        n : int or sequence of int
            Number of net points along each strip of faces, at least the order of the splines, 4 for cubics; one number
            for each of ``net.surface.strips``, or one for all. If there are fewer control points, all of them.

        Returns
        -------
        CoarseNet

        Raises
        ------
        InputError
            If there are fewer points than the order, or no point is left to move.
        """
        surface = SurfaceStrips.of(model, mesh)
        strips = surface.strips
        if np.shape(n) not in ((), (len(strips),)):
            raise InputError(f"'{variable.name}': n is {n}; give one number, or one for each of {len(strips)} strips")
        kept = []
        for number, (strip, count) in enumerate(zip(strips, np.broadcast_to(n, len(strips)).tolist())):
            if count < strip.knots.order:
                raise InputError(
                    f"'{variable.name}': {count} points along strip {number + 1}; give {strip.knots.order} at least, "
                    f"the order of its splines"
                )
            n_kept = min(count - strip.knots.order, strip.n_inner)
            mask = np.zeros(strip.n_inner, dtype=bool)
            mask[np.rint(np.arange(1, n_kept + 1) * (strip.n_inner + 1) / (n_kept + 1)).astype(int) - 1] = True
            kept.append(mask | mask[::-1] if strip.is_symmetric else mask)
        net = cls(variable, surface, mesh, tuple(kept))
        net.weights  # noqa: B018 - refuses a net without a movable point
        return net

    @property
    def name(self) -> str:
        """Name of the variable."""
        return self.variable.name

    @property
    def units(self) -> str | None:
        """Units of the values."""
        return self.variable.units

    @property
    def auxiliary(self) -> tuple[AuxiliaryPoints, ...]:
        """None."""
        return ()

    @property
    def n_values(self) -> int:
        """Number of values."""
        return self.weights.shape[1]

    def bind(self, layout: Layout) -> Displacement:
        """Find the directions on the baseline.

        Raises
        ------
        InputError
            As `Local`.
        """
        return Displacement(csr_array(self.variable.bind(layout).matrix @ self.weights))

    @cached_property
    def weights(self) -> csr_array:
        """Map from the values of the net to all values of ``variable``, shape (n_all, n_values)."""
        rows = self._rows
        points = csr_array(self._all_weights[rows][:, self._used])
        return csr_array(kron(points, eye_array(self._n_each), format="csr"))

    def refine(self, knots: Iterable[Knot]) -> CoarseNet:
        """Insert knots, which keeps all shapes and adds more.

        Parameters
        ----------
        knots : iterable of (int, int)
            Strip and number among its inner knots, as from `halves` and `where_to_refine`.

        Raises
        ------
        InputError
            If there is no such knot.
        """
        kept = [mask.copy() for mask in self.kept]
        for strip, knot in knots:
            if strip not in range(len(kept)) or knot not in range(len(kept[strip])):
                raise InputError(
                    f"'{self.name}': no inner knot {knot} of strip {strip}; there are "
                    f"{', '.join(f'{len(mask)} of strip {s}' for s, mask in enumerate(kept))}, counted from 0"
                )
            kept[strip][knot] = True
            if self.surface.strips[strip].is_symmetric:
                kept[strip][-1 - knot] = True
        return replace(self, kept=tuple(kept))

    def halves(self) -> list[Knot]:
        """Return the middle knot of every interval between knots of the net; none in intervals that have all."""
        found = []
        for strip, mask in enumerate(self.kept):
            ends = np.concatenate([[-1], np.flatnonzero(mask), [len(mask)]])
            middles = (ends[:-1] + ends[1:]) // 2
            found += [(strip, int(knot)) for knot in middles[np.diff(ends) > 1]]
        return [(strip, knot) for strip, knot in found if strip in self._strips_used]

    def to(self, finer: CoarseNet) -> Refinement:
        """Return the map of values and bounds to a net made from this one by `refine`.

        Raises
        ------
        InputError
            If the other net lacks a knot of this one, or is of another variable.
        """
        is_of_it = finer.surface is self.surface and finer.variable is self.variable
        if not is_of_it or any((a & ~b).any() for a, b in zip(self.kept, finer.kept)):
            raise InputError(f"'{self.name}': the other net was not made of this one; make it with refine(knots)")
        points = self._matrix(self._numbers, finer._numbers, finer._knots, len(finer._order))
        points = csr_array(points)[finer._used][:, self._used]
        return Refinement(csr_array(kron(points, eye_array(self._n_each), format="csr")))

    def where_to_refine(self, gradient: np.ndarray, n_knots: int = 1, metric: np.ndarray | None = None) -> list[Knot]:
        """Choose knots by the gradient that the net cannot follow.

        Knots are chosen one by one, each to add most to the squared norm of the gradient on the net.

        Parameters
        ----------
        gradient : ndarray, shape (n_all,)
            Derivative of the Lagrangian with respect to the values of all control points of ``variable``: see
            `unused_gradient`.
        n_knots : int
            Maximum number of knots.
        metric : ndarray, shape (n_all, n_all), optional
            Symmetric positive definite: the size of a change of the values is ``sqrt(v^T metric v)``. By default it is
            the root mean square of the displacement over the area of the surface.

        Returns
        -------
        list of (int, int)
            Knots for `refine`, best first; fewer if no further knot adds anything.

        Raises
        ------
        InputError
            If the gradient or the metric has a wrong shape.
        """
        gradient = self._checked(gradient)
        chosen: list[Knot] = []
        net, size = self, self._norm(gradient, metric)
        while len(chosen) < n_knots:
            sizes = {knot: net.refine([knot])._norm(gradient, metric) for knot in net.missing()}
            best = max(sizes, key=sizes.__getitem__, default=None)
            if best is None or not sizes[best] > size * (1.0 + SAME):
                break
            chosen.append(best)
            net, size = net.refine([best]), sizes[best]
        return chosen

    def part_used(self, gradient: np.ndarray, metric: np.ndarray | None = None) -> float:
        """Return the fraction of the gradient's squared norm that the net can follow, from 0 to 1.

        Parameters
        ----------
        gradient, metric
            As for `where_to_refine`.
        """
        gradient = self._checked(gradient)
        every = [(s, k) for s, mask in enumerate(self.kept) for k in range(len(mask))]
        whole = self.refine(every)._norm(gradient, metric)
        return self._norm(gradient, metric) / whole if whole > 0.0 else 1.0

    def mass(self, metric: np.ndarray | None = None) -> np.ndarray:
        """Metric of the values of the net, shape (n_values, n_values).

        Parameters
        ----------
        metric : ndarray, shape (n_all, n_all), optional
            As for `where_to_refine`.
        """
        weights, n = self.weights, self.weights.shape[0]
        if metric is None:
            return (weights.T @ (weights * self._areas[:, None])).toarray()
        if np.shape(metric) != (n, n):
            raise InputError(f"'{self.name}': a metric of shape {np.shape(metric)}; give shape ({n}, {n})")
        return weights.T @ (weights.T @ np.asarray(metric)).T

    def _checked(self, gradient: np.ndarray) -> np.ndarray:
        gradient, n = np.asarray(gradient, dtype=float), self.weights.shape[0]
        if gradient.shape != (n,) or not np.isfinite(gradient).all():
            raise InputError(
                f"'{self.name}': a gradient of shape {gradient.shape}; give finite numbers of shape ({n},)"
            )
        return gradient

    def _norm(self, gradient: np.ndarray, metric: np.ndarray | None) -> float:
        """Squared norm of the gradient on the net: ``g^T M^-1 g``, both for the values of the net."""
        here = self.weights.T @ gradient
        return float(here @ np.linalg.solve(self.mass(metric), here))

    def missing(self) -> list[Knot]:
        """Return all knots that can be inserted, one of each symmetric pair."""
        found = []
        for number in sorted(self._strips_used):
            knots = np.flatnonzero(~self.kept[number])
            if self.surface.strips[number].is_symmetric:
                knots = knots[2 * knots < len(self.kept[number])]
            found += [(number, int(knot)) for knot in knots]
        return found

    @cached_property
    def _directed(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the movable control points, and their directions."""
        return self.variable.directed(self.mesh)

    @property
    def _rows(self) -> np.ndarray:
        return self._directed[0]

    @property
    def _n_each(self) -> int:
        """Number of values of each point."""
        return self._directed[1].shape[2]

    @cached_property
    def _areas(self) -> np.ndarray:
        """Area around the control point of each value of ``variable``, times the square of its displacement."""
        quads = surface_quads(self.mesh)
        x = self.mesh.points[self.mesh.surface_ids][quads]
        area = 0.125 * lengths(np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]))
        areas = np.bincount(quads.ravel(), np.repeat(area, 4), self.surface.n_surface)
        areas = np.maximum(areas, 1e-6 * areas.mean()) / areas.sum()  # not zero where the surface collapses
        return (areas[self._rows, None] * (self._directed[1] ** 2).sum(axis=1)).ravel()

    @cached_property
    def _knots(self) -> tuple[ConstantKnots, ...]:
        """Knots of the net for each strip."""
        return tuple(_chosen(strip.knots, mask) for strip, mask in zip(self.surface.strips, self.kept))

    @cached_property
    def _all_weights(self) -> csr_array:
        """Map from displacements of all net points to displacements of all surface control points."""
        full = tuple(strip.knots for strip in self.surface.strips)
        return self._matrix(self._numbers, [face.rows for face in self.surface.faces], full, self.surface.n_surface)

    @cached_property
    def _used(self) -> np.ndarray:
        """Numbers of the net points that move only movable control points."""
        weights, may_move = self._all_weights, np.zeros(self.surface.n_surface, dtype=bool)
        may_move[self._rows] = True
        used = np.flatnonzero(weights.T @ (~may_move).astype(float) == 0.0)
        if not len(used):
            raise InputError(
                f"'{self.name}': every point of the coarse net would move control points that are not selected; give "
                f"it more points, or select more"
            )
        return used

    @cached_property
    def _strips_used(self) -> set[int]:
        """Strips of the faces with movable control points."""
        return {s for face in self.surface.faces if np.isin(face.rows, self._rows).any() for s in face.strips}

    @cached_property
    def _order(self) -> np.ndarray:
        """New number of each net point, in the order of the control points that follow it most."""
        faces, n = self._first_numbers
        full = tuple(strip.knots for strip in self.surface.strips)
        weights = self._matrix(faces, [face.rows for face in self.surface.faces], full, self.surface.n_surface, n)
        order = np.empty(n, dtype=np.int64)
        order[np.argsort(weights.tocsc().argmax(axis=0), kind="stable")] = np.arange(n)
        return order

    @cached_property
    def _numbers(self) -> list[np.ndarray]:
        """Number of every point of the net on each face."""
        return [self._order[numbers] for numbers in self._first_numbers[0]]

    @cached_property
    def _first_numbers(self) -> tuple[list[np.ndarray], int]:
        """Numbers in the order of faces: corners, edges and interiors; and how many there are."""
        corners: dict[int, int] = {}
        edges: dict[tuple, np.ndarray] = {}
        n, found = 0, []
        for face in self.surface.faces:
            shape = tuple(self._knots[strip].n_control for strip in face.strips)
            numbers = np.full(shape, -1)
            for direction, edge, where in face_edges(face.rows):
                for end in (0, -1):
                    n += int(edge[end] not in corners)
                    corners.setdefault(int(edge[end]), n - 1)
                if (edge == edge[0]).all():  # collapsed: one point
                    numbers[where] = corners[int(edge[0])]
                    continue
                ahead, back = tuple(edge.tolist()), tuple(edge[::-1].tolist())
                key, inner = min(ahead, back), shape[direction] - 2
                if key not in edges:
                    edges[key] = n + np.arange(inner)
                    if ahead == back:  # folded: its halves are one
                        edges[key] = n + np.minimum(np.arange(inner), np.arange(inner)[::-1])
                    n += len(np.unique(edges[key]))
                line = edges[key] if key == ahead else edges[key][::-1]
                numbers[where] = np.concatenate([[corners[int(edge[0])]], line, [corners[int(edge[-1])]]])
            inside = numbers[1:-1, 1:-1]
            inside[:] = n + np.arange(inside.size).reshape(inside.shape)
            n += inside.size
            found.append(numbers)
        return found, n

    def _matrix(
        self,
        columns: Sequence[np.ndarray],
        rows: Sequence[np.ndarray],
        knots: tuple[ConstantKnots, ...],
        n_rows: int,
        n_columns: int | None = None,
    ) -> csr_array:
        """Weights of the net points (numbered by ``columns`` on each face) at finer points (numbered by ``rows``)."""
        n_columns = len(self._order) if n_columns is None else n_columns
        along = [insertion_matrix(old, new) for old, new in zip(self._knots, knots)]
        blocks = []
        for face, face_columns, face_rows in zip(self.surface.faces, columns, rows):
            a, b = (along[s][::-1, ::-1] if r else along[s] for s, r in zip(face.strips, face.is_reversed))
            weights = coo_array(np.kron(a, b))
            where = face_rows.ravel()[weights.row], face_columns.ravel()[weights.col]
            blocks.append(csr_array(coo_array((weights.data, where), shape=(n_rows, n_columns))))
            counts = np.bincount(face_rows.ravel(), minlength=n_rows)
            blocks[-1] = csr_array(blocks[-1] * (1.0 / np.maximum(counts, 1))[:, None])  # where the face is collapsed
        counts = sum((np.diff(block.indptr) > 0).astype(float) for block in blocks)
        matrix = csr_array(sum(blocks) * (1.0 / np.maximum(counts, 1.0))[:, None])
        for face, face_rows, block in zip(self.surface.faces, rows, blocks):
            wrong = abs(block - matrix)[np.unique(face_rows)].max(axis=1).toarray().ravel() > SAME
            if wrong.any():
                place = self.mesh.place_of_surface_point(int(face.rows.flat[0]))
                raise InputError(
                    f"'{self.name}': the face of {place} shares a part of an edge with another one, so that they "
                    f"have no common coarse net; split blocks there, or use Local"
                )
        return matrix


def _chosen(knots: ConstantKnots, kept: np.ndarray) -> ConstantKnots:
    """The knots of a net: the ends and the kept inner ones."""
    p, inner = knots.order, knots.knots[knots.order : knots.n_control]
    return ConstantKnots(np.concatenate([np.zeros(p), inner[kept], np.ones(p)]), p)
