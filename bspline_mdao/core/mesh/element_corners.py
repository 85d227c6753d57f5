"""The worst corner of a control mesh as a smooth function of its points, for a constraint.

It is the aggregate ``corner_ks`` of grids, taken over the elements of a mesh whose blocks share points. Theory:
``docs/theory/quality.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...grids.cells.aggregates import KreisselmeierSteinhauser
from ...grids.cells.hexahedron import element_measures, element_measures_vjp
from .moving_mesh import MovingMesh

__all__ = ["ElementCorners"]


@dataclass(frozen=True, eq=False)
class ElementCorners(OneLine):
    """Smooth lower bound of the corner triple products of the elements that are valid on the baseline.

    Parameters
    ----------
    elements : ndarray of int, shape (n_e, 8)
        Corners of these elements.
    handedness : ndarray, shape (n_e,)
        Sign of the block of each on the baseline.
    degenerate_corners : ndarray of uint8, shape (n_e,)
        Corners with a collapsed edge on the baseline, as bits: they do not count.
    n_points : int
        Points of the mesh.
    rule : KreisselmeierSteinhauser
        How corners become one number.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> corners = ElementCorners.of(mesh, rho=100.0)
    >>> corners.value(mesh.points) < mesh.tangled(mesh.points).min_corner
    True
    """

    elements: np.ndarray
    handedness: np.ndarray
    degenerate_corners: np.ndarray
    n_points: int
    rule: KreisselmeierSteinhauser

    @classmethod
    def of(
        cls,
        mesh: MovingMesh,  # the mesh; its points decide which elements are valid
        rho: float,  # sharpness: the bound is below the smallest corner by at most ``ln(8 n_e) / rho``
    ) -> ElementCorners:
        """Take the elements of a mesh."""
        valid = np.flatnonzero(mesh.is_valid)
        fields = (mesh.elements[valid], mesh.handedness[valid], mesh.degenerate_corners[valid])
        return cls(*fields, mesh.n_points, KreisselmeierSteinhauser(rho))

    def value(self, points: np.ndarray) -> float:
        """Bound with points (n_points, 3); 1 where no element is valid on the baseline."""
        return self.rule.value(self.rule.part(self._triples(points)))

    def gradient(self, points: np.ndarray) -> np.ndarray:
        """Derivative of the bound with respect to points (n_points, 3), of their shape."""
        triples = self._triples(points)
        weights = self.rule.weights(triples, self.rule.value(self.rule.part(triples)))
        place = points[self.elements], self.handedness, self.degenerate_corners
        bars = element_measures_vjp(*place, weights, np.zeros(len(weights))).reshape(-1, 3)
        ids = self.elements.ravel()
        return np.stack([np.bincount(ids, bars[:, c], minlength=self.n_points) for c in range(3)], axis=1)

    def _triples(self, points: np.ndarray) -> np.ndarray:
        return element_measures(points[self.elements], self.handedness, self.degenerate_corners).triples
