"""B-spline volumes that move what is in them, and the weights by which they do.

Each embedded point has parameters in one of the volumes, found once on the baseline, and moves by
``B (L_new - L_old)``, B being the basis functions there and L the points of the volumes. So nothing moves while these
do not, and what holds for them as a whole, such as an affine motion, holds for what is embedded to round-off. Embedded
are surface control points, points of reference axes and children. Theory: ``docs/theory/free_form.rst``.

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
"""Halvings of the edges that leave the volumes: which side they pass is found to 1e-5 of their length."""


class FreeFormVolumes(OneLine, ABC):
    """B-spline volumes whose points are moved, and what is in them along: a lattice of one volume, or of several."""

    parent: FreeFormVolumes | None  # the volumes that these are in, and move with
    moves: Selection | None  # the surface control points that are embedded, all of them inside; those inside by default
    continuity: int  # derivatives that are continuous where the surface leaves the volumes; -1 fixes nothing

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
        """Whether each of the points is chosen, bool (n,); `IndexError` where ``where`` does not fit."""

    @abstractmethod
    def place_of(self, point: int) -> str:
        """Say which of the points one is, from 1."""

    @property
    def auxiliary(self) -> tuple[FreeFormVolumes, ...]:
        """These, their parent, the parent of that and so on: what a variable that uses them has to list."""
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
        limits = np.array([low, high], dtype=float)  # None becomes nan, beside which nothing is outside
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
            Points that matter; the rows of the others are empty.

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
        """Return a map that moves the points as a map of all rows does, and what is embedded along.

        Parameters
        ----------
        layout : Layout
            The rows, those of the points among them.
        design_map : DesignMap
            The map, of which only what it does to the rows of the points counts.

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

    # weights of the lattice's points in the displacement of every row: ones for the rows of the lattice itself. Every
    # other row sums to one, or is empty where nothing is embedded
    weights: csr_array  # (n_rows, n_points)
    is_fixed: np.ndarray  # bool (n_points,), points that the lattice's own variables leave alone, see `fixed_points`

    @classmethod
    def of(cls, lattice: FreeFormVolumes, layout: Layout) -> Embedding:
        """Find the lattice coordinates of all rows on the baseline."""
        # `InputError` if no surface control point is embedded, or one that is asked for lies outside
        surface = layout.points[layout.rows()]
        parts = [lattice.weights(surface, _embedded_surface(lattice, layout))]
        parts += [_weights_of(lattice, item) for item in layout.auxiliary]
        return cls(vstack(parts, format="csr"), fixed_points(lattice, layout))

    @cached_property
    def transfer(self) -> csr_array:
        """Displacement of all rows by those of the points that are not fixed, shape (3 n_rows, 3 n_points)."""
        kept = csr_array(self.weights * ~self.is_fixed)
        kept.eliminate_zeros()
        return kron(kept, eye_array(3), format="csr")


@dataclass(frozen=True, eq=False)
class ExtendedMap:
    """A map of lattice points, extended to all that is embedded."""

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
        """Constant terms: the rows before, less the lattice before, which its new place replaces."""
        n = self.transfer.shape[0]
        identity = eye_array(n, format="csr")
        return identity, -(self.transfer @ identity[self._coordinates])


def _weights_of(lattice: FreeFormVolumes, item: Any) -> csr_array:
    """Weights for the points of an auxiliary object: the lattice, a child of it, an axis, or another lattice."""
    if item is lattice:
        return eye_array(len(lattice.points), format="csr")
    # what is no lattice, such as an axis, follows
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
    """Find the points that the variables of a lattice leave alone, so that the surface stays continuous."""
    # 1. Edges of the control net with one end inside and one outside leave the lattice; where, bisection finds.
    # 2. The sides on which these places lie are those that the surface passes.
    # 3. Fixed are the points on these sides and as many layers behind as derivatives are to be continuous.
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
                is_outer = (n_volumes[layers[0]] == 1).any()  # a side between two volumes is passed by none
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
