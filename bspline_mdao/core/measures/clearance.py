"""Distances of patches from other patches, points and planes: smooth lower bounds.

Theory: ``docs/theory/geometry.rst``, "Clearance".

References
----------
G. Kreisselmeier and R. Steinhauser, Systematic control design by optimizing a vector performance index, *IFAC
Symposium on Computer Aided Design of Control Systems*, 1979: the bound, see `bspline_mdao.grids.cells.aggregates`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.sparse import csr_array

from ...base.checks import as_direction, as_vector
from ...base.display import OneLine
from ...base.numerics.vectors import add_to, dot, less, row, scaled
from ...errors import InputError
from ...grids.cells.aggregates import KreisselmeierSteinhauser, Part
from ..mesh.frame import Plane
from ..mesh.surface import SurfaceGrid
from .measure import row_at

__all__ = ["Clearance", "PlaneClearance", "nodes_of"]

_NEGLIGIBLE = 60.0
"""Exponent from which a term of the sum is negligible: 1e10 such terms together are less than round-off."""


@dataclass(frozen=True, eq=False)
class Clearance(OneLine):
    """Kreisselmeier-Steinhauser bound of the distances between the nodes of a patch and other nodes, or fixed points.

    The bound is below the smallest distance by at most ln(n) / rho for n pairs, and smooth whichever pair is nearest.
    Surfaces can be nearer to each other than their nodes, by `reach` on the baseline. Distances are never negative: the
    clearance cannot detect surfaces that have passed through each other. Make it by `between` or `from_points`.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    ids : ndarray of int, shape (n,)
        Nodes of the patch.
    other_ids : ndarray of int, shape (m,)
        Nodes of the other patch.
    fixed : ndarray, shape (k, 3)
        Points that do not move (m).
    rule : KreisselmeierSteinhauser
        Smooth bound of the smallest.
    name : str
        Name of the output.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import Clearance, SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> clearance = Clearance.from_points(surface, "body", np.array([[0.5, 1.0, 0.5]]))
    >>> clearance.evaluate(surface.points).round(2)
    array([0.5])
    """

    surface: SurfaceGrid
    ids: np.ndarray
    other_ids: np.ndarray
    fixed: np.ndarray
    rule: KreisselmeierSteinhauser
    name: str

    shape = (1,)
    """One number."""

    units = "m"
    """Units of the distance."""

    @classmethod
    def between(
        cls,
        surface: SurfaceGrid,
        patches: str | Sequence[str],
        others: str | Sequence[str],
        *,
        rho: float = 200.0,
        name: str = "clearance",
    ) -> Clearance:
        """Measure the clearance between patches and other patches.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        patches, others : str or sequence of str
            Names of the patches on either side.
        rho : float
            Sharpness, in inverse baseline clearances: with 1e6 pairs the bound is below the smallest distance by at
            most 13.8 / rho of it.
        name : str
            Name of the output.

        Raises
        ------
        InputError
            If a patch does not exist, the two touch, or rho is not positive.
        """
        return cls._of(surface, nodes_of(surface, patches), nodes_of(surface, others), np.empty((0, 3)), rho, name)

    @classmethod
    def from_points(
        cls,
        surface: SurfaceGrid,
        patches: str | Sequence[str],
        points: np.ndarray,
        *,
        rho: float = 200.0,
        name: str = "clearance",
    ) -> Clearance:
        """Measure the clearance between patches and fixed points.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        patches : str or sequence of str
            Names of the patches.
        points : ndarray, shape (k, 3)
            The points (m).
        rho : float
            Sharpness; see `between`.
        name : str
            Name of the output.

        Raises
        ------
        InputError
            If a patch does not exist or touches a point, the points have the wrong shape, or rho is not positive.
        """
        points = np.atleast_2d(np.asarray(points, dtype=float))
        if points.shape[-1] != 3 or points.ndim != 2 or not np.isfinite(points).all() or not len(points):
            raise InputError(f"clearance: points of shape {points.shape}; give finite ones of shape (n, 3)")
        return cls._of(surface, nodes_of(surface, patches), np.empty(0, dtype=int), points, rho, name)

    @classmethod
    def _of(
        cls, surface: SurfaceGrid, ids: np.ndarray, other_ids: np.ndarray, fixed: np.ndarray, rho: float, name: str
    ) -> Clearance:
        others = np.concatenate([surface.points[other_ids], fixed])
        smallest = np.sqrt(_nearest_square(surface.points[ids], others))
        if not smallest > 1e-9 * surface.size:  # adjacent patches share nodes, equal to round-off
            raise InputError("clearance: the two sides touch on the baseline; leave patches that join out")
        return cls(surface, ids, other_ids, fixed, KreisselmeierSteinhauser(rho / smallest), name)

    @property
    def reach(self) -> float:
        """Largest distance (m) of a point on the baseline surfaces from the nearest node, summed over both sides.

        Half the longest diagonal of each side's quads; zero for fixed points.
        """
        return sum(_half_diagonal(self.surface, ids) for ids in (self.ids, self.other_ids))

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Clearance (m), shape (1,), from nodes, shape (n_points, 3); real or complex."""
        return np.atleast_1d(self._bound(*self._sides(points)))

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`, shape (1, 3 n_points), with entries for the nodes of both sides."""
        sides = self._sides(points)
        bars = _bars(*sides, self.rule.rho, self._bound(*sides))
        gradient = np.concatenate([bars[0], bars[1][: len(self.other_ids)]])
        return row_at(np.concatenate([self.ids, self.other_ids]), gradient, len(points))

    def _sides(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return points[self.ids], np.concatenate([points[self.other_ids], self.fixed.astype(points.dtype)])

    def _bound(self, side: np.ndarray, other: np.ndarray) -> float:
        smallest = np.sqrt(_nearest_square(side, other))
        return self.rule.value(Part(smallest, _total(side, other, self.rule.rho, smallest)))


@dataclass(frozen=True, eq=False)
class PlaneClearance(OneLine):
    """Kreisselmeier-Steinhauser bound of the distances of patches from a plane, negative behind it. Made by `of`.

    Since quads lie between their corners, it also bounds the distance of the bilinear quads.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    ids : ndarray of int, shape (n,)
        Nodes of the patches.
    plane : Plane
        The plane; its normal points to the side where the surface should be.
    rule : KreisselmeierSteinhauser
        Smooth bound of the smallest.
    name : str
        Name of the output.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import PlaneClearance, SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> clearance = PlaneClearance.of(surface, "body", origin=(0.0, -1.0, 0.0), normal=(0.0, 1.0, 0.0))
    >>> clearance.evaluate(surface.points).round(3)
    array([0.494])
    """

    surface: SurfaceGrid
    ids: np.ndarray
    plane: Plane
    rule: KreisselmeierSteinhauser
    name: str

    shape = (1,)
    """One number."""

    units = "m"
    """Units of the distance."""

    @classmethod
    def of(
        cls,
        surface: SurfaceGrid,
        patches: str | Sequence[str],
        origin: Sequence[float],
        normal: Sequence[float],
        *,
        rho: float = 1000.0,
        name: str = "clearance",
    ) -> PlaneClearance:
        """Measure the clearance of patches on one side of a plane.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        patches : str or sequence of str
            Names of the patches.
        origin, normal : sequence of float
            A point of the plane (m), and its normal, of any length, towards the surface.
        rho : float
            Sharpness: the bound is below the smallest distance by at most ln(n) / rho of the surface's size.
        name : str
            Name of the output.

        Raises
        ------
        InputError
            If a patch does not exist, the normal has zero length, or rho is not positive.
        """
        towards = as_direction(normal, "clearance: the normal of the plane")
        plane = Plane(towards, float(as_vector(origin, "clearance: the origin of the plane") @ towards))
        return cls(surface, nodes_of(surface, patches), plane, KreisselmeierSteinhauser(rho / surface.size), name)

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Clearance (m), shape (1,), from nodes, shape (n_points, 3); real or complex."""
        return np.atleast_1d(self.rule.value(self.rule.part(self._distances(points))))

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`, shape (1, 3 n_points), with entries for the nodes of the patches."""
        weights = self.rule.weights(self._distances(points), self.evaluate(points)[0])
        return row_at(self.ids, np.outer(weights, self.plane.normal), len(points))

    def _distances(self, points: np.ndarray) -> np.ndarray:
        return points[self.ids] @ self.plane.normal - self.plane.offset


def nodes_of(surface: SurfaceGrid, patches: str | Sequence[str]) -> np.ndarray:
    """Nodes of patches by name, ascending."""
    return np.unique(np.concatenate([surface.parts[number].ravel() for number in surface.part(patches)]))


def _half_diagonal(surface: SurfaceGrid, ids: np.ndarray) -> float:
    """Half the longest diagonal of the quads between given nodes (m); 0 if there are none."""
    corners = surface.points[surface.quads[np.isin(surface.quads, ids).all(axis=1)]]
    diagonals = corners[:, 2:] - corners[:, :2]
    return 0.5 * np.linalg.norm(diagonals, axis=2).max(initial=0.0)


@njit(cache=True)
def _nearest_square(side, other):
    """Smallest squared distance between two sets of points, by its real part."""
    smallest = np.inf
    for i in range(len(side)):
        for j in range(len(other)):
            along = less(row(side, i), row(other, j))
            smallest = min(smallest, dot(along, along).real)
    return smallest


@njit(cache=True)
def _total(side, other, rho, smallest):
    """Sum of ``exp(-rho (distance - smallest))`` over all pairs."""
    total = 0.0 * side[0, 0]
    farthest = (smallest + _NEGLIGIBLE / rho) ** 2
    for i in range(len(side)):
        for j in range(len(other)):
            along = less(row(side, i), row(other, j))
            square = dot(along, along)
            if square.real < farthest:
                total += np.exp(-rho * (np.sqrt(square) - smallest))
    return total


@njit(cache=True)
def _bars(side, other, rho, bound):
    """Derivatives of the bound with respect to the points of both sides."""
    side_bar, other_bar = np.zeros_like(side), np.zeros_like(other)
    # the bound is below the smallest distance, hence twice the reach
    farthest = (bound + 2.0 * _NEGLIGIBLE / rho) ** 2
    for i in range(len(side)):
        for j in range(len(other)):
            along = less(row(side, i), row(other, j))
            square = dot(along, along)
            if 0.0 < square < farthest:
                distance = np.sqrt(square)
                pull = scaled(np.exp(-rho * (distance - bound)) / distance, along)
                add_to(side_bar, i, pull)
                add_to(other_bar, j, scaled(-1.0, pull))
    return side_bar, other_bar
