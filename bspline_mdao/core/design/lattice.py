"""Lattices: B-spline volumes around the surface control points, moved by their own points.

How they move their contents is in `bspline_mdao.core.design.embedding`. Theory: ``docs/theory/free_form.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...base.checks import as_numbers
from ...errors import InputError
from ..evaluation.inversion import INSIDE, PointInversion
from ..mesh.control_net import surface_quads
from ..mesh.frame import mesh_frame
from ..mesh.moving_mesh import MovingMesh
from ..splines.greville import greville_abscissae
from ..splines.knots import ConstantKnots, Knots
from ..splines.mesh import BSplineMesh
from ..splines.volume import Volume, evaluate
from .embedding import FreeFormVolumes
from .reference_axis import chord_lines
from .selection import Selection

__all__ = ["Lattice", "lattice_points", "uniform_volume"]

BOX = 1e-12
"""Distance, relative to the diagonal, up to which control points count as forming a box: round-off of the user's
arithmetic. In a box coordinates are found by a product instead of a search."""

SECTIONS = 9
"""Number of wing sections that give the sides of a lattice around it their slopes."""

CUBIC = 4
"""Default order of a lattice in each direction."""


@dataclass(frozen=True, eq=False)
class Lattice(FreeFormVolumes):
    """A B-spline volume that moves everything inside it.

    The surface control points inside, or the ones in ``moves``, are embedded, and so are points of reference axes
    inside and the points of child lattices. Everything outside stays.

    Parameters
    ----------
    control_points : array_like, shape (n0, n1, n2, 3)
        Points of the lattice on the baseline (m), at least two in each direction.
    orders : int or sequence of three int, optional
        Order p (degree plus one) in each direction, with evenly spaced knots. By default 4, or the number of points if
        that is less. In a Bezier volume the order equals the number of points.
    parent : Lattice or LatticeBlocks, optional
        The lattice that contains this one and moves it.
    moves : Selection, optional
        The embedded surface control points; all of them must be inside.
    continuity : int
        Number of continuous derivatives of the displacement where the surface leaves the lattice through a side: the
        lattice's own variables do not move that side and as many layers behind it. -1 fixes nothing.
    knots : sequence of three Knots, optional
        Knots in each direction, if they are not evenly spaced; they define the orders.

    Raises
    ------
    InputError
        If the points do not form a lattice, the orders do not suit their number, or points lie outside the parent.

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
    parent: FreeFormVolumes | None = None
    moves: Selection | None = None
    continuity: int = 1
    knots: Sequence[Knots] | None = None

    def __post_init__(self) -> None:
        points = lattice_points(self.control_points, "lattice")
        object.__setattr__(self, "control_points", points)
        if self.knots is not None:
            self._require_knots(self.knots)
            object.__setattr__(self, "orders", tuple(knots.order for knots in self.knots))
        object.__setattr__(self, "orders", _orders(points.shape[:3], self.orders))
        self.volume  # noqa: B018  # refuses orders that do not suit the number of points
        if self.parent is not None:
            self.require_inside(self.parent)

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
        """Make a box-shaped lattice, in which coordinates are proportional to lengths.

        Parameters
        ----------
        around : MovingMesh or array_like, shape (n_points, 3)
            The mesh whose surface it surrounds, or the points (m); two opposite corners suffice.
        n : sequence of three int
            Points in each direction.
        orders : int or sequence of three int, optional
            As for `Lattice`.
        margin : float
            Fraction of each extent by which the box is larger at both ends.
        axes : array_like, shape (3, 3), optional
            Its directions, one per row, of any length, possibly oblique; the coordinate axes by default.
        **options
            ``parent``, ``moves`` and ``continuity`` of the lattice.

        Returns
        -------
        Lattice

        Raises
        ------
        InputError
            If the directions lie in one plane, or the box has no extent along one of them.
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
    def swept(
        cls,
        around: MovingMesh,
        n: Sequence[int] = (4, 2, 5),
        orders: int | Sequence[int] | None = None,
        margin: float = 0.05,
        **options: Any,
    ) -> Lattice:
        """Make a lattice whose sides follow the sweep, taper and dihedral of a wing.

        Along the stream and normal to it, its sides have the slopes of the section edges, by least squares along the
        span, and touch the surface; then they are moved out by the margin.

        Parameters
        ----------
        around : MovingMesh
            The mesh whose surface it surrounds, a wing along its span (`mesh_frame`).
        n : sequence of three int
            Points along the stream, normal to it, and along the span.
        orders : int or sequence of three int, optional
            As for `Lattice`.
        margin : float
            Fraction of each extent by which it is larger at both ends.
        **options
            ``parent``, ``moves`` and ``continuity`` of the lattice.

        Returns
        -------
        Lattice

        Raises
        ------
        InputError
            If the surface has no span, or a section of it no chord.

        Examples
        --------
        >>> from bspline_mdao import fit_grid
        >>> from bspline_mdao.generators import onera_m6_grid
        >>> from bspline_mdao.movers import moving_mesh
        >>> mesh = moving_mesh(fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4)))
        >>> lattice = Lattice.swept(mesh, margin=0.0)
        >>> edge = lattice.control_points[0, 0, [0, -1]]  # upstream, at the root and at the tip
        >>> bool(edge[1, 0] - edge[0, 0] > 0.7)
        True
        """
        frame, points = mesh_frame(around), around.points[around.surface_ids]
        local = frame.to_local(points)
        at, quads = np.linspace(0.0, frame.span, SECTIONS), surface_quads(around)
        lines = chord_lines(points, quads, local[:, 2], at, frame.axes[0])
        ends = np.stack([frame.to_local(lines.leading), frame.to_local(lines.trailing)])
        span = np.array([local[:, 2].min(), local[:, 2].max()])
        span += margin * np.ptp(span) * np.array([-1.0, 1.0])
        sides = [_bounds(local[:, 0], local[:, 2], [np.polyfit(at, end[:, 0], 1)[0] for end in ends], span, margin)]
        dihedral = np.polyfit(at, ends[..., 1].mean(axis=0), 1)[0]
        taper = np.polyfit(at, _thicknesses(local, at), 1)[0]
        sides.append(_bounds(local[:, 1], local[:, 2], dihedral + taper * np.array([-0.5, 0.5]), span, margin))
        corners = np.empty((2, 2, 2, 3))
        corners[..., 0] = sides[0][:, None, :]
        corners[..., 1] = sides[1][None, :, :]
        corners[..., 2] = span
        return cls.hexahedron(frame.to_space(corners), n, orders, **options)

    @classmethod
    def hexahedron(
        cls,
        corners: np.ndarray,
        n: Sequence[int] = (4, 3, 3),
        orders: int | Sequence[int] | None = None,
        **options: Any,
    ) -> Lattice:
        """Make a lattice between eight corners, with trilinear coordinates, for a swept and tapered wing.

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
        places = greville_abscissae(uniform_volume(n, orders))
        linear, corners = uniform_volume((2, 2, 2), 2), as_numbers(corners, "lattice: corners")
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
        return (
            uniform_volume(self.control_points.shape[:3], self.orders) if self.knots is None else Volume.of(*self.knots)
        )

    def _require_knots(self, knots: Sequence[Knots]) -> None:
        """Refuse knots together with orders, or knots for another number of points."""
        n = tuple(each.n_control for each in knots)
        if self.orders is not None or n != self.control_points.shape[:3]:
            raise InputError(
                f"lattice: knots of {n} points, for {self.control_points.shape[:3]}; give theirs, and no orders"
            )

    def locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find the lattice coordinates of points on the baseline.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points (m).

        Returns
        -------
        parameters : ndarray, shape (n, 3)
            In [0, 1]; points outside get the parameters of a nearby boundary point.
        is_inside : ndarray of bool, shape (n,)
            Whether the points are inside, up to 1e-9 of the lattice's diagonal.
        """
        found = self.find(points)
        return found.parameters, found.is_inside

    def find(self, points: np.ndarray) -> PointInversion:
        """Find the parameters of points, shape (n, 3), in metres, on the baseline: in a box by a product."""
        if self._box is None:
            return super().find(points)
        origin, inverse = self._box
        exact = (points - origin) @ inverse
        parameters = exact.clip(0.0, 1.0)
        distance = np.linalg.norm((exact - parameters) @ np.linalg.inv(inverse), axis=1)
        return PointInversion(np.zeros(len(points), dtype=int), parameters, distance, distance <= INSIDE * self.size)

    def chosen(self, where: Any) -> np.ndarray:
        """Whether an index expression, or a mask of all points, chooses each point; bool (n0 n1 n2,)."""
        is_chosen = np.zeros(len(self.points), dtype=bool)
        at = is_chosen if np.shape(where) == is_chosen.shape else is_chosen.reshape(self.control_points.shape[:3])
        at[where] = True
        return is_chosen

    def place_of(self, point: int) -> str:
        """Describe a point by its number in each direction, from 1."""
        return str(tuple(int(i) + 1 for i in np.unravel_index(point, self.control_points.shape[:3])))

    @cached_property
    def mesh(self) -> BSplineMesh:
        """The volume as a mesh, for the evaluation and inversion of fitted grids."""
        ids = np.arange(len(self.points)).reshape(self.volume.n_control)
        return BSplineMesh((self.volume,), (ids,), len(self.points))

    @cached_property
    def _box(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Origin, and matrix from lengths to coordinates, if the lattice is a box, upright or oblique."""
        points = self.control_points
        edges = np.array([points[-1, 0, 0], points[0, -1, 0], points[0, 0, -1]]) - points[0, 0, 0]
        places = greville_abscissae(self.volume)
        is_box = np.abs(points[0, 0, 0] + places @ edges - points).max() <= BOX * self.size
        is_flat = abs(np.linalg.det(edges)) <= INSIDE**2 * self.size**3
        return (points[0, 0, 0], np.linalg.inv(edges)) if is_box and not is_flat else None


def _bounds(
    across: np.ndarray, span: np.ndarray, slopes: Sequence[float] | np.ndarray, ends: np.ndarray, margin: float
) -> np.ndarray:
    """Lower and upper side, straight along the span with given slopes, that enclose all points: (2, 2)."""
    low, high = (across - slope * span for slope in slopes)
    sides = np.array([low.min() + slopes[0] * ends, high.max() + slopes[1] * ends])
    width = sides[1] - sides[0]
    return sides + margin * width * np.array([[-1.0], [1.0]])


def _thicknesses(local: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Heights (m) of slices of a wing at places along its span."""
    number = np.abs(local[:, 2:] - at).argmin(axis=1)
    found = np.array([np.ptp(local[number == k, 1]) if (number == k).any() else np.nan for k in range(len(at))])
    return np.interp(at, at[~np.isnan(found)], found[~np.isnan(found)])


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


def lattice_points(points: ArrayLike, what: str) -> np.ndarray:
    """Points of a lattice, shape (n0, n1, n2, 3); ``what`` is for messages."""
    points = np.array(points, dtype=float)
    if points.ndim != 4 or points.shape[3] != 3 or min(points.shape) < 2:
        raise InputError(f"{what}: points of shape {points.shape}; give (n0, n1, n2, 3) with two or more each way")
    if not np.isfinite(points).all():
        index = tuple(int(i) + 1 for i in np.argwhere(~np.isfinite(points).all(axis=-1))[0])
        raise InputError(f"{what}: point {index} is not finite; correct it")
    return points


def uniform_volume(n: Sequence[int], orders: int | Sequence[int] | None) -> Volume:
    """Volume with evenly spaced knots."""
    orders = _orders(n, orders)
    if min(orders) < 2:
        raise InputError(f"lattice: orders {orders}; give 2 (linear) at least")
    return Volume.of(*(ConstantKnots.uniform(int(m), order) for m, order in zip(n, orders)))
