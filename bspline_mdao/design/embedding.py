"""What a lattice moves: surface control points, reference axes and child lattices, by constant weights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array, eye_array, kron, vstack

from ..errors import InputError
from ..measures.edge_cuts import edges_of_quads
from .pattern import product_on_pattern, sum_on_pattern
from .surface_net import surface_quads
from .variable import DesignMap, Layout, MapPartials

if TYPE_CHECKING:
    from .lattice import Lattice

__all__ = ["Embedding", "Led", "held_points"]

ON_SIDE = 1e-9
"""Lattice coordinate up to which a point counts as on a side."""

BISECTIONS = 16
"""Halvings of the edges that leave a lattice."""


@dataclass(frozen=True, eq=False)
class Led:
    """A map that acts on the points of a lattice, and moves what is embedded along.

    Parameters
    ----------
    rows : slice
        Rows of the lattice.
    transfer : csr_array, shape (3 n_rows, 3 n_points)
        Displacements of all rows, by displacements of the lattice's points.
    design_map : DesignMap
        The map.
    """

    rows: slice
    transfer: csr_array
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
        before, after = self._fixed
        moved = product_on_pattern(self.transfer, inner.points[self._coordinates])
        return MapPartials(
            sum_on_pattern(before, after, moved), product_on_pattern(self.transfer, inner.values[self._coordinates])
        )

    @property
    def _coordinates(self) -> slice:
        return slice(3 * self.rows.start, 3 * self.rows.stop)

    @cached_property
    def _fixed(self) -> tuple[csr_array, csr_array]:
        """What does not depend on the map: the rows before, and the lattice before, which its new place replaces."""
        n = self.transfer.shape[0]
        identity = eye_array(n, format="csr")
        return identity, -(self.transfer @ identity[self._coordinates])


@dataclass(frozen=True, eq=False)
class Embedding:
    """What a lattice moves, and by how much.

    Parameters
    ----------
    weights : csr_array, shape (n_rows, n_points)
        Weights of the lattice's points in the displacement of every row: ones for the rows of the lattice itself. Every
        other row sums to one, or is empty where nothing is embedded.
    is_held : ndarray of bool, shape (n0, n1, n2)
        Points that the lattice's own variables leave alone, see `held_points`.
    """

    weights: csr_array
    is_held: np.ndarray

    @classmethod
    def of(cls, lattice: Lattice, layout: Layout) -> Embedding:
        """Find the lattice coordinates of all rows on the baseline.

        Raises
        ------
        InputError
            If no surface control point is embedded, or one that is asked for lies outside.
        """
        surface = layout.points[layout.rows()]
        parts = [lattice.weights(surface, _embedded_surface(lattice, layout))]
        parts += [_weights_of(lattice, item) for item in layout.carried]
        return cls(vstack(parts, format="csr"), held_points(lattice, layout))

    @cached_property
    def transfer(self) -> csr_array:
        """Displacement of all rows by those of the points that are not held, shape (3 n_rows, 3 n_points)."""
        kept = csr_array(self.weights * ~self.is_held.ravel())
        kept.eliminate_zeros()
        return kron(kept, eye_array(3), format="csr")


def _weights_of(lattice: Lattice, item) -> csr_array:
    """Weights for something that is carried: the lattice, a child of it, an axis, or a lattice of its own."""
    if item is lattice:
        return eye_array(len(lattice.points), format="csr")
    carried = getattr(item, "carried", (lattice,))  # only lattices have one; axes go along
    goes_along = any(lattice is ancestor for ancestor in carried)
    return lattice.weights(item.points, lattice.locate(item.points)[1] & goes_along)


def _embedded_surface(lattice: Lattice, layout: Layout) -> np.ndarray:
    """Whether each surface control point is embedded, shape (n_surface,)."""
    mesh, (_, is_inside) = layout.mesh, lattice.locate(layout.points[layout.rows()])
    if lattice.moves is None:
        if not is_inside.any():
            raise InputError("lattice: no surface control point is inside; check its place and its units")
        return is_inside
    rows = lattice.moves.rows(mesh)
    outside = rows[~is_inside[rows]]
    if len(outside):
        place = mesh.place_of_point(mesh.surface_ids[outside[0]])
        raise InputError(
            f"lattice: {len(outside)} of the {len(rows)} points it is to move lie outside, the first is {place}; "
            f"make it larger, or let it move fewer"
        )
    return lattice.moves.mask(mesh)


def held_points(lattice: Lattice, layout: Layout) -> np.ndarray:
    """Points that a lattice's own variables leave alone, so that the surface stays continuous.

    The surface leaves the lattice through the sides that straight edges of its net go through, from one end inside to
    one outside. Held are the points on these sides and as many layers behind as derivatives are to be continuous.

    Parameters
    ----------
    lattice : Lattice
        The lattice.
    layout : Layout
        The rows.

    Returns
    -------
    ndarray of bool, shape (n0, n1, n2)
    """
    exits = _exits(lattice, layout)
    held, n_layers = np.zeros(lattice.control_points.shape[:3], dtype=bool), lattice.continuity + 1
    for direction in range(3):
        layers = np.moveaxis(held, direction, 0)
        layers[:n_layers] |= (exits[:, direction] <= ON_SIDE).any()
        layers[max(len(layers) - n_layers, 0) :] |= (exits[:, direction] >= 1.0 - ON_SIDE).any()
    return held


def _exits(lattice: Lattice, layout: Layout) -> np.ndarray:
    """Lattice coordinates of the places where edges of the surface's net leave the lattice, by bisection."""
    points, edges = layout.points[layout.rows()], edges_of_quads(surface_quads(layout.mesh))
    is_inside = lattice.locate(points)[1][edges]
    edges, is_inside = (part[is_inside[:, 0] != is_inside[:, 1]] for part in (edges, is_inside))
    inner, outer = points[edges[is_inside]], points[edges[~is_inside]]
    for _ in range(BISECTIONS):
        middle = 0.5 * (inner + outer)
        is_in = lattice.locate(middle)[1][:, None]
        inner, outer = np.where(is_in, middle, inner), np.where(is_in, outer, middle)
    return lattice.locate(outer)[0]
