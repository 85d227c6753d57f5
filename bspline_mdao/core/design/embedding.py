"""B-spline volumes that move what is embedded in them, and the weights of this motion.

Each embedded point has parameters in one of the volumes, found once on the baseline, and moves by ``B (L_new - L_old)``
with the basis functions B there and the points L of the volumes. So nothing moves unless these do, and a motion of all
of them, such as an affine one, moves everything embedded in the same way to round-off. Surface control points, points
of reference axes and child lattices are embedded. Theory: ``docs/theory/free_form.rst``.

References
----------
T. W. Sederberg and S. R. Parry, Free-form deformation of solid geometric models, *Computer Graphics (SIGGRAPH)* 20(4),
1986.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_array, eye_array, kron, vstack

from ...base.display import OneLine
from ...errors import InputError
from ..evaluation.inversion import PointInversion, embed_points, invert_points
from ..measures.edge_cuts import edges_of_quads
from ..mesh.control_net import surface_quads
from ..splines.mesh import BSplineMesh
from .selection import Selection
from .variable import DesignMap, Layout, MapPartials, product_on_pattern, sum_on_pattern

__all__ = ["Embedding", "ExtendedMap", "FreeFormVolumes", "fixed_points"]

ON_SIDE = 1e-9
"""Parameter up to which a point counts as on a side: the tolerance of the search for parameters."""

BISECTIONS = 16
"""Bisections of edges that leave the volumes, which find the side they pass to 1e-5 of their length."""


class FreeFormVolumes(OneLine, ABC):
    """B-spline volumes whose points are moved together with everything inside: a lattice of one or more volumes."""

    parent: FreeFormVolumes | None  # the volumes that contain and move these
    moves: Selection | None  # the embedded surface control points, all of them inside; by default all inside
    continuity: int  # number of continuous derivatives where the surface leaves the volumes; -1 fixes nothing

    @property
    @abstractmethod
    def points(self) -> np.ndarray:
        """Their points on the baseline (m), shape (n, 3)."""

    @property
    @abstractmethod
    def mesh(self) -> BSplineMesh:
        """The volumes, to which the evaluation and the inversion of fitted grids apply."""

    @abstractmethod
    def chosen(self, where: Any) -> np.ndarray:
        """Whether each of the points is chosen, bool (n,); `IndexError` if ``where`` does not match."""

    @abstractmethod
    def place_of(self, point: int) -> str:
        """Describe a point by its number, from 1."""

    @property
    def auxiliary(self) -> tuple[FreeFormVolumes, ...]:
        """These, their parent, its parent and so on: what a variable that uses them must list."""
        return (self,) if self.parent is None else (self, *self.parent.auxiliary)

    def within(
        self,
        low: Sequence[float | None] = (None, None, None),
        high: Sequence[float | None] = (None, None, None),
    ) -> np.ndarray:
        """Choose points in a box on the baseline.

        Parameters
        ----------
        low, high : sequence of (float or None)
            Limits of x, y and z (m), themselves within; None where there is none.

        Returns
        -------
        ndarray of bool, shape (n,)
            For ``where`` of `FreeForm`; masks combine with ``&``, ``|`` and ``~``.

        Examples
        --------
        >>> from bspline_mdao.design import Lattice
        >>> lattice = Lattice.box([[0.0, 0.0, 0.0], [1.0, 0.2, 2.0]], n=(4, 2, 3), margin=0.0)
        >>> int(lattice.within(low=(None, None, 0.5)).sum())
        16
        """
        limits = np.array([low, high], dtype=float)  # None becomes nan, and nothing compares as outside it
        if limits.shape != (2, 3):
            raise InputError(f"lattice: limits {low} and {high}; give three numbers each, or None")
        near = 1e-9 * self.size
        return ~((self.points < limits[0] - near) | (self.points > limits[1] + near)).any(axis=1)

    def find(self, points: np.ndarray) -> PointInversion:
        """Find the volumes and parameters of points, shape (n, 3), in metres, on the baseline."""
        return invert_points(self.mesh, self.points, points)

    def weights(self, points: np.ndarray, mask: np.ndarray) -> csr_array:
        """Basis functions at points inside on the baseline.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points (m).
        mask : ndarray of bool, shape (n,)
            Relevant points; the rows of the others are empty.

        Returns
        -------
        csr_array, shape (n, n_points)
            Rows that sum to one.
        """
        rows = np.flatnonzero(mask)
        if not len(rows):
            return csr_array((len(points), len(self.points)))
        found = csr_array(embed_points(self.mesh, self.find(points[rows])).matrix())
        placed = csr_array((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(len(points), len(rows)))
        return csr_array(placed @ found)

    def extend(self, layout: Layout, design_map: DesignMap) -> DesignMap:
        """Return a map that moves the points like a map of all rows, together with everything embedded.

        Parameters
        ----------
        layout : Layout
            The rows, including these points.
        design_map : DesignMap
            The map, of which only the effect on these points' rows counts.

        Returns
        -------
        DesignMap
            Points that are fixed for continuity stay.
        """
        return ExtendedMap(layout.rows(self), Embedding.of(self, layout).transfer, design_map)

    @property
    def counts(self) -> str:
        """Numbers of points of the volumes in each direction, for messages."""
        return ", ".join(str(volume.n_control) for volume in self.mesh.volumes)

    @property
    def size(self) -> float:
        """Diagonal of the box around the points (m)."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    def require_inside(self, parent: FreeFormVolumes) -> None:
        """Refuse points outside of the parent."""
        is_inside = parent.find(self.points).is_inside
        if not is_inside.all():
            raise InputError(
                f"lattice: {np.count_nonzero(~is_inside)} points lie outside the parent, the first is point "
                f"{self.place_of(int(np.argmin(is_inside)))}; make the child smaller"
            )


@dataclass(frozen=True, eq=False)
class Embedding:
    """Weights by which a lattice moves all rows."""

    # weights of the lattice's points in the displacement of every row: ones for the lattice's own rows. Every other row
    # sums to one, or is empty if it is not embedded
    weights: csr_array  # (n_rows, n_points)
    is_fixed: np.ndarray  # bool (n_points,), points that the lattice's own variables do not move, see `fixed_points`

    @classmethod
    def of(cls, lattice: FreeFormVolumes, layout: Layout) -> Embedding:
        """Find the lattice coordinates of all rows on the baseline."""
        # `InputError` if no surface control point is embedded, or a requested one lies outside
        surface = layout.points[layout.rows()]
        parts = [lattice.weights(surface, _embedded_surface(lattice, layout))]
        parts += [_weights_of(lattice, item) for item in layout.auxiliary]
        return cls(vstack(parts, format="csr"), fixed_points(lattice, layout))

    @cached_property
    def transfer(self) -> csr_array:
        """Map from displacements of the free points to displacements of all rows, shape (3 n_rows, 3 n_points)."""
        kept = csr_array(self.weights * ~self.is_fixed)
        kept.eliminate_zeros()
        return kron(kept, eye_array(3), format="csr")


@dataclass(frozen=True, eq=False)
class ExtendedMap:
    """A map of lattice points, extended to everything embedded."""

    rows: slice  # rows of the lattice
    transfer: csr_array  # (3 n_rows, 3 n_points), displacements of all rows from displacements of the lattice's points
    design_map: DesignMap

    @property
    def initial(self) -> np.ndarray:
        """Values at which nothing moves, shape (n_values,)."""
        return self.design_map.initial

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres; real or complex."""
        displacement = (self.design_map.apply(points, values) - points)[self.rows]
        return points + (self.transfer @ displacement.reshape(-1)).reshape(-1, 3)

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`."""
        inner = self.design_map.partials(points, values)
        before, after = self._constant
        moved = product_on_pattern(self.transfer, inner.points[self._coordinates])
        return MapPartials(
            sum_on_pattern(before, after, moved), product_on_pattern(self.transfer, inner.values[self._coordinates])
        )

    @property
    def _coordinates(self) -> slice:
        return slice(3 * self.rows.start, 3 * self.rows.stop)

    @cached_property
    def _constant(self) -> tuple[csr_array, csr_array]:
        """Constant terms: the rows before, less the lattice before, which its new position replaces."""
        n = self.transfer.shape[0]
        identity = eye_array(n, format="csr")
        return identity, -(self.transfer @ identity[self._coordinates])


def _weights_of(lattice: FreeFormVolumes, item: Any) -> csr_array:
    """Weights for the points of an auxiliary object: the lattice, a child of it, an axis, or another lattice."""
    if item is lattice:
        return eye_array(len(lattice.points), format="csr")
    # anything that is not a lattice, such as an axis, follows
    ancestors = item.auxiliary if isinstance(item, FreeFormVolumes) else (lattice,)
    follows = any(lattice is ancestor for ancestor in ancestors)
    return lattice.weights(item.points, lattice.find(item.points).is_inside & follows)


def _embedded_surface(lattice: FreeFormVolumes, layout: Layout) -> np.ndarray:
    """Whether each surface control point is embedded, shape (n_surface,)."""
    mesh, found = layout.mesh, lattice.find(layout.points[layout.rows()])
    is_inside = found.is_inside
    if lattice.moves is None:
        if not is_inside.any():
            raise InputError("lattice: no surface control point is inside; check its place and its units")
        return is_inside
    rows = lattice.moves.rows(mesh)
    outside = rows[~is_inside[rows]]
    if len(outside):
        place = mesh.place_of_surface_point(outside[0])
        raise InputError(
            f"lattice: {len(outside)} of the {len(rows)} points it is to move lie outside, by up to "
            f"{found.distance[outside].max():.3g} m, the first is {place}; make it larger, or let it move fewer"
        )
    return lattice.moves.mask(mesh)


def fixed_points(
    lattice: FreeFormVolumes,
    layout: Layout,  # the rows
) -> np.ndarray:  # bool (n_points,)
    """Find the points that the variables of a lattice must not move, so that the surface stays continuous."""
    # 1. Edges of the control net with one end inside and one outside leave the lattice, at places found by bisection.
    # 2. The sides on which these places lie are crossed by the surface.
    # 3. The points on these sides are fixed, and as many layers behind as there are continuous derivatives.
    exits, all_ids = _exits(lattice, layout), lattice.mesh.control_ids  # step 1
    n_volumes = np.bincount(np.concatenate([np.unique(ids) for ids in all_ids]))
    fixed, n_layers = np.zeros(len(lattice.points), dtype=bool), lattice.continuity + 1
    # steps 2 and 3
    for number, ids in enumerate(all_ids):
        parameters = exits.parameters[exits.volume == number]
        for direction in range(3):
            for layers, parts in (
                (np.moveaxis(ids, direction, 0), parameters[:, direction]),
                (np.moveaxis(ids, direction, 0)[::-1], 1.0 - parameters[:, direction]),
            ):
                is_outer = (n_volumes[layers[0]] == 1).any()  # a side between two volumes is never crossed
                if is_outer and (parts <= ON_SIDE).any():
                    fixed[layers[:n_layers]] = True
    return fixed


def _exits(lattice: FreeFormVolumes, layout: Layout) -> PointInversion:
    """Places where edges of the surface's net leave the lattice, by bisection."""
    points, edges = layout.points[layout.rows()], edges_of_quads(surface_quads(layout.mesh))
    is_inside = lattice.find(points).is_inside[edges]
    edges, is_inside = (part[is_inside[:, 0] != is_inside[:, 1]] for part in (edges, is_inside))
    inner, outer = points[edges[is_inside]], points[edges[~is_inside]]
    for _ in range(BISECTIONS):
        middle = 0.5 * (inner + outer)
        is_in = lattice.find(middle).is_inside[:, None]
        inner, outer = np.where(is_in, middle, inner), np.where(is_in, outer, middle)
    return lattice.find(outer)
