"""Distance that patches keep from a plane: a smooth lower bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ..cells.aggregates import KreisselmeierSteinhauser
from ..checks import as_direction, as_vector
from ..mesh.frame import Plane
from ..mesh.surface import SurfaceGrid
from .clearance import nodes_of
from .scalars import row_at

__all__ = ["PlaneClearance"]


@dataclass(frozen=True, eq=False)
class PlaneClearance:
    """Kreisselmeier-Steinhauser bound of the distances of patches from a plane, negative behind it. Make it by `of`.

    As quads lie between their corners, it also bounds the distance of the surface of bilinear quads.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    ids : ndarray of int, shape (n,)
        Nodes of the patches.
    plane : Plane
        The plane; its normal points to where the surface is to be.
    rule : KreisselmeierSteinhauser
        How the smallest is bounded.
    name : str
        Name of the output.
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
        """Keep patches on one side of a plane.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        patches : str or sequence of str
            Names of the patches.
        origin, normal : sequence of float
            A point of the plane (m), and its normal, of any length, to the side of the surface.
        rho : float
            Sharpness: the bound is below the smallest distance by ln(n) / rho of the surface's size at most.
        name : str
            Name of the output.

        Raises
        ------
        InputError
            If a patch does not exist, the normal has no length, or rho is not positive.
        """
        normal = as_direction(normal, "clearance: the normal of the plane")
        plane = Plane(normal, float(as_vector(origin, "clearance: the origin of the plane") @ normal))
        return cls(surface, nodes_of(surface, patches), plane, KreisselmeierSteinhauser(rho / surface.size), name)

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Clearance (m), shape (1,), of nodes, shape (n_points, 3); real or complex."""
        return np.atleast_1d(self.rule.value(self.rule.part(self._distances(points))))

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`, shape (1, 3 n_points), on the nodes of the patches."""
        weights = self.rule.weights(self._distances(points), self.evaluate(points))
        return row_at(self.ids, np.outer(weights, self.plane.normal), len(points))

    def _distances(self, points):
        return points[self.ids] @ self.plane.normal - self.plane.offset
