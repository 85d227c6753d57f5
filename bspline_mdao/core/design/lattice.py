"""Lattices: B-spline volumes around the surface control points, which go where their own points go.

Each embedded point has lattice coordinates, found once on the baseline, and moves by ``B (L_new - L_old)``, B being the
basis functions there and L the points of the lattice. So nothing moves while the lattice does not, and what holds for
the lattice as a whole, such as an affine motion, holds for what is embedded to round-off. Embedded are surface control
points, points of reference axes and child lattices. Theory: ``docs/theory/free_form.rst``.

References
----------
T. W. Sederberg and S. R. Parry, Free-form deformation of solid geometric models, *Computer Graphics (SIGGRAPH)* 20(4),
1986.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array, eye_array, kron, vstack

from ...base.checks import as_numbers
from ...base.display import OneLine
from ...errors import InputError
from ..evaluation.evaluator import Evaluator
from ..evaluation.inversion import INSIDE, invert_points
from ..measures.edge_cuts import edges_of_quads
from ..mesh.control_net import surface_quads
from ..mesh.moving_mesh import MovingMesh
from ..splines.greville import greville_abscissae
from ..splines.knots import ConstantKnots
from ..splines.mesh import BSplineMesh
from ..splines.volume import Volume, evaluate
from .selection import Selection
from .variable import DesignMap, Layout, MapPartials, product_on_pattern, sum_on_pattern

__all__ = ["Embedding", "ExtendedMap", "Lattice", "fixed_points"]

ON_SIDE = 1e-9
"""Lattice coordinate up to which a point counts as on a side: the tolerance of the search for coordinates."""

BISECTIONS = 16
"""Halvings of the edges that leave a lattice: which side they pass is found to 1e-5 of their length."""

BOX = 1e-12
"""Distance, relative to the diagonal, up to which control points count as those of a box: round-off of the user's
arithmetic. In a box coordinates are found by a product instead of a search."""

CUBIC = 4
"""Order of a lattice in each direction by default."""


@dataclass(frozen=True, eq=False)
class Lattice(OneLine):
    """A B-spline volume that moves what is in it.

    Embedded are the surface control points inside, or those of ``moves``; the points of reference axes inside; and the
    points of its child lattices. What is outside stays.

    Parameters
    ----------
    control_points : array_like, shape (n0, n1, n2, 3)
        Points of the lattice on the baseline (m), two at least in each direction.
    orders : int or sequence of three int, optional
        Order p (degree plus one) in each direction, of knots that are evenly spaced. By default 4, or the number of
        points where that is less. A Bezier volume has as many as it has points.
    parent : Lattice, optional
        The lattice that this one is in, and moves with.
    moves : Selection, optional
        The surface control points that are embedded; all of them have to be inside.
    continuity : int
        Where the surface leaves the lattice through a side, its displacement ends with this many continuous
        derivatives: the lattice's own variables leave that side and as many layers behind it alone. -1 fixes nothing.

    Raises
    ------
    InputError
        If the points do not make a lattice, the orders do not suit their number, or points lie outside the parent.

    Examples
    --------
    >>> lattice = Lattice.box([[0.0, 0.0, 0.0], [1.0, 0.2, 2.0]], n=(4, 2, 3), margin=0.0)
    >>> lattice.control_points.shape, lattice.orders
    ((4, 2, 3, 3), (4, 2, 3))
    >>> lattice.points[-1].tolist()
    [1.0, 0.2, 2.0]
    """

    control_points: np.ndarray
    orders: int | Sequence[int] | None = None
    parent: Lattice | None = None
    moves: Selection | None = None
    continuity: int = 1

    def __post_init__(self) -> None:
        points = np.array(self.control_points, dtype=float)
        if points.ndim != 4 or points.shape[3] != 3 or min(points.shape) < 2:
            raise InputError(f"lattice: points of shape {points.shape}; give (n0, n1, n2, 3) with two or more each way")
        if not np.isfinite(points).all():
            index = tuple(int(i) + 1 for i in np.argwhere(~np.isfinite(points).all(axis=-1))[0])
            raise InputError(f"lattice: point {index} is not finite; correct it")
        object.__setattr__(self, "control_points", points)
        object.__setattr__(self, "orders", _orders(points.shape[:3], self.orders))
        _volume(points.shape[:3], self.orders)  # refuses orders that do not suit the number of points
        if self.parent is not None:
            self._require_inside(self.parent)

    @classmethod
    def box(
        cls,
        around: MovingMesh | np.ndarray,
        n: Sequence[int] = (4, 3, 3),
        orders: int | Sequence[int] | None = None,
        margin: float = 0.05,
        axes: np.ndarray | None = None,
        **options: Any,
    ) -> Lattice:
        """Make a lattice in the form of a box, in which coordinates are proportional to lengths.

        Parameters
        ----------
        around : MovingMesh or array_like, shape (n_points, 3)
            The mesh whose surface, or the points (m), that it surrounds; two opposite corners will do.
        n : sequence of three int
            Points in each direction.
        orders : int or sequence of three int, optional
            As for `Lattice`.
        margin : float
            Part of each extent by which the box is larger at both ends.
        axes : array_like, shape (3, 3), optional
            Its directions, one per row, of any length; the coordinate axes by default. They may be oblique.
        **options
            ``parent``, ``moves`` and ``continuity`` of the lattice.

        Returns
        -------
        Lattice

        Raises
        ------
        InputError
            If the directions lie in one plane, or the box has no extent in one of them.
        """
        points = _corners(around)
        axes = np.eye(3) if axes is None else _box_axes(axes)
        local = points @ np.linalg.inv(axes)
        low, extent = local.min(axis=0), np.ptp(local, axis=0)
        if not extent.min() > INSIDE * extent.max():
            thin = np.argmin(extent) + 1
            raise InputError(f"lattice: no extent along axis {thin}; give two opposite corners of the box instead")
        ends = (1.0 + 2.0 * margin) * np.moveaxis(np.indices((2, 2, 2)), 0, -1) - margin
        return cls.hexahedron((low + extent * ends) @ axes, n, orders, **options)

    @classmethod
    def hexahedron(
        cls,
        corners: np.ndarray,
        n: Sequence[int] = (4, 3, 3),
        orders: int | Sequence[int] | None = None,
        **options: Any,
    ) -> Lattice:
        """Make a lattice between eight corners, in which coordinates are trilinear: around a swept and tapered wing.

        Parameters
        ----------
        corners : array_like, shape (2, 2, 2, 3)
            Corner ``[a, b, c]`` is at the low (0) or high (1) end of each direction (m).
        n, orders, **options
            As for `box`.

        Returns
        -------
        Lattice
        """
        orders = _orders(n, orders)
        places = greville_abscissae(_volume(n, orders))
        linear, corners = _volume((2, 2, 2), 2), as_numbers(corners, "lattice: corners")
        if corners.shape != (2, 2, 2, 3):
            raise InputError(f"lattice: corners of shape {corners.shape}; give shape (2, 2, 2, 3)")
        points = evaluate(linear, corners, places.reshape(-1, 3))
        return cls(points.reshape(places.shape), orders, **options)

    @property
    def points(self) -> np.ndarray:
        """The points of the lattice on the baseline (m), shape (n0 n1 n2, 3), in C order."""
        return self.control_points.reshape(-1, 3)

    @cached_property
    def volume(self) -> Volume:
        """The B-spline volume: orders and knots in each direction."""
        return _volume(self.control_points.shape[:3], self.orders)

    @property
    def auxiliary(self) -> tuple[Lattice, ...]:
        """The lattice, its parent, the parent of that and so on: what a variable that uses the lattice has to list."""
        return (self,) if self.parent is None else (self, *self.parent.auxiliary)

    def locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find the lattice coordinates of points on the baseline.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points (m).

        Returns
        -------
        parameters : ndarray, shape (n, 3)
            In [0, 1]; those of points outside belong to a nearby point of the boundary.
        is_inside : ndarray of bool, shape (n,)
            Whether the points are inside, up to 1e-9 of the lattice's diagonal.
        """
        if self._box is None:
            found = invert_points(self._mesh, self.points, points)
            return found.parameters, found.is_inside
        origin, inverse = self._box
        exact = (points - origin) @ inverse
        parameters = exact.clip(0.0, 1.0)
        distance = np.linalg.norm((exact - parameters) @ np.linalg.inv(inverse), axis=1)
        return parameters, distance <= INSIDE * self._diagonal

    def weights(self, points: np.ndarray, mask: np.ndarray) -> csr_array:
        """Basis functions at points inside the lattice on the baseline.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points (m).
        mask : ndarray of bool, shape (n,)
            Points that matter; the rows of the others are empty.

        Returns
        -------
        csr_array, shape (n, n0 n1 n2)
            Rows that sum to one.
        """
        rows = np.flatnonzero(mask)
        if not len(rows):
            return csr_array((len(points), len(self.points)))
        parameters = np.ascontiguousarray(self.locate(points[rows])[0])
        return Evaluator.build(self._mesh, [parameters], [rows], len(points)).matrix()

    def extend(self, layout: Layout, design_map: DesignMap) -> DesignMap:
        """Return a map that moves the points of the lattice as a map of all rows does, and what is embedded along.

        Parameters
        ----------
        layout : Layout
            The rows, those of the lattice among them.
        design_map : DesignMap
            The map, of which only what it does to the rows of the lattice counts.

        Returns
        -------
        DesignMap
            Points of the lattice that are fixed for continuity stay.
        """
        return ExtendedMap(layout.rows(self), Embedding.of(self, layout).transfer, design_map)

    @cached_property
    def _mesh(self) -> BSplineMesh:
        """The volume as a mesh, to which the evaluation and the inversion of fitted grids apply."""
        ids = np.arange(len(self.points)).reshape(self.volume.n_control)
        return BSplineMesh((self.volume,), (ids,), len(self.points))

    @property
    def _diagonal(self) -> float:
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @cached_property
    def _box(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Origin, and matrix from lengths to coordinates, where the lattice is a box, upright or oblique."""
        points = self.control_points
        edges = np.array([points[-1, 0, 0], points[0, -1, 0], points[0, 0, -1]]) - points[0, 0, 0]
        places = greville_abscissae(self.volume)
        is_box = np.abs(points[0, 0, 0] + places @ edges - points).max() <= BOX * self._diagonal
        is_flat = abs(np.linalg.det(edges)) <= INSIDE**2 * self._diagonal**3
        return (points[0, 0, 0], np.linalg.inv(edges)) if is_box and not is_flat else None

    def _require_inside(self, parent: Lattice) -> None:
        """Refuse points outside of the parent."""
        _, is_inside = parent.locate(self.points)
        if not is_inside.all():
            index = tuple(int(i) + 1 for i in np.unravel_index(np.argmin(is_inside), self.control_points.shape[:3]))
            raise InputError(
                f"lattice: {np.count_nonzero(~is_inside)} points lie outside the parent, the first is point {index}; "
                f"make the child smaller"
            )


def _corners(around: MovingMesh | ArrayLike) -> np.ndarray:
    """Points that a box surrounds."""
    if isinstance(around, MovingMesh):
        return around.points[around.surface_ids]
    points = as_numbers(around, "lattice: around")
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError(f"lattice: around points of shape {points.shape}; give a mesh, or finite ones of shape (n, 3)")
    return points


def _box_axes(axes: ArrayLike) -> np.ndarray:
    """Unit vectors along the edges of a box."""
    axes = as_numbers(axes, "lattice: axes")
    lengths = np.linalg.norm(axes, axis=-1, keepdims=True)
    if axes.shape != (3, 3) or not (lengths > 0.0).all() or not abs(np.linalg.det(axes / lengths)) > INSIDE:
        raise InputError(f"lattice: axes {axes.tolist()}; give three directions that do not lie in one plane")
    return axes / lengths


def _orders(n: Sequence[int], orders: int | Sequence[int] | None) -> tuple[int, int, int]:
    """Orders of the three directions."""
    if orders is None:
        orders = [min(m, CUBIC) for m in n]
    if np.shape(n) != (3,) or np.shape(orders) not in ((), (3,)):
        raise InputError(f"lattice: {n} points and orders {orders}; give numbers for three directions")
    if min(n) < 2:
        raise InputError(f"lattice: {n} points; give two or more in each direction")
    i, j, k = np.broadcast_to(orders, 3).tolist()
    return int(i), int(j), int(k)


def _volume(n: Sequence[int], orders: int | Sequence[int] | None) -> Volume:
    """Volume with evenly spaced knots."""
    orders = _orders(n, orders)
    if min(orders) < 2:
        raise InputError(f"lattice: orders {orders}; give 2 (linear) at least")
    return Volume.of(*(ConstantKnots.uniform(int(m), order) for m, order in zip(n, orders)))


@dataclass(frozen=True, eq=False)
class Embedding:
    """Weights by which a lattice moves all rows."""

    # weights of the lattice's points in the displacement of every row: ones for the rows of the lattice itself. Every
    # other row sums to one, or is empty where nothing is embedded
    weights: csr_array  # (n_rows, n_points)
    is_fixed: np.ndarray  # bool (n0, n1, n2), points that the lattice's own variables leave alone, see `fixed_points`

    @classmethod
    def of(cls, lattice: Lattice, layout: Layout) -> Embedding:
        """Find the lattice coordinates of all rows on the baseline."""
        # `InputError` if no surface control point is embedded, or one that is asked for lies outside
        surface = layout.points[layout.rows()]
        parts = [lattice.weights(surface, _embedded_surface(lattice, layout))]
        parts += [_weights_of(lattice, item) for item in layout.auxiliary]
        return cls(vstack(parts, format="csr"), fixed_points(lattice, layout))

    @cached_property
    def transfer(self) -> csr_array:
        """Displacement of all rows by those of the points that are not fixed, shape (3 n_rows, 3 n_points)."""
        kept = csr_array(self.weights * ~self.is_fixed.ravel())
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


def _weights_of(lattice: Lattice, item: Any) -> csr_array:
    """Weights for the points of an auxiliary object: the lattice, a child of it, an axis, or another lattice."""
    if item is lattice:
        return eye_array(len(lattice.points), format="csr")
    ancestors = (
        item.auxiliary if isinstance(item, Lattice) else (lattice,)
    )  # what is no lattice, such as an axis, follows
    follows = any(lattice is ancestor for ancestor in ancestors)
    return lattice.weights(item.points, lattice.locate(item.points)[1] & follows)


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
        place = mesh.place_of_surface_point(outside[0])
        raise InputError(
            f"lattice: {len(outside)} of the {len(rows)} points it is to move lie outside, the first is {place}; "
            f"make it larger, or let it move fewer"
        )
    return lattice.moves.mask(mesh)


def fixed_points(
    lattice: Lattice,
    layout: Layout,  # the rows
) -> np.ndarray:  # bool (n0, n1, n2)
    """Find the points that a lattice's own variables leave alone, so that the surface stays continuous."""
    # 1. Edges of the control net with one end inside and one outside leave the lattice; where, bisection finds.
    # 2. The sides on which these places lie are those that the surface passes.
    # 3. Fixed are the points on these sides and as many layers behind as derivatives are to be continuous.
    exits = _exits(lattice, layout)  # step 1
    fixed, n_layers = np.zeros(lattice.control_points.shape[:3], dtype=bool), lattice.continuity + 1
    # steps 2 and 3
    for direction in range(3):
        layers = np.moveaxis(fixed, direction, 0)
        layers[:n_layers] |= (exits[:, direction] <= ON_SIDE).any()
        layers[max(len(layers) - n_layers, 0) :] |= (exits[:, direction] >= 1.0 - ON_SIDE).any()
    return fixed


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
