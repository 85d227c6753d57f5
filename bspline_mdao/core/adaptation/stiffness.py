"""Variables in which control points move together, for a search aware of cell shear.

A displacement that changes from one control point to the next by a fraction of their distance strains the cells between
by as much, even by a thousandth of a chord for cells on a wall. With the sum of squares of these fractions over all
edges of the control mesh and of the values themselves,

    w^T K w = sum_edges (d_a - d_b)^2 / l_ab^2 + w^T w ,      K = C C^T ,

the values are ``r tanh(w / r)`` with ``w = w_0 + C^-T u``: steps of equal length in u strain the grid equally, and no
value leaves its bounds, -r and r.

Theory: ``docs/theory/adaptation.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import splu, spsolve_triangular

from ..design.interior_points import InteriorShift
from ..model.fitted_model import FittedModel

__all__ = ["StiffValues"]

LARGEST = 1.0 - 1e-9
"""Largest values, relative to their bounds, from which steps start."""


@dataclass(frozen=True, eq=False)
class StiffValues:
    """The change of variables. Made by `of`, and restarted from other values by `at`."""

    upper: csr_array  # (n_values, n_values), ``C^T``, its columns in another order
    order: np.ndarray  # (n_values,) of int, that order
    reach: float  # largest value
    start: np.ndarray  # (n_values,), ``w_0``

    @classmethod
    def of(cls, model: FittedModel, shift: InteriorShift) -> StiffValues:
        """Factor the edge matrix of a control mesh, for steps from zero displacement."""
        matrix = shift.matrix
        strains = [_strains(model) @ matrix[axis::3] for axis in range(3)]
        stiffness = csc_array(sum(part.T @ part for part in strains) + eye_array(shift.n_values))
        plain = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
        factor = splu(stiffness, **plain)
        upper = csr_array(diags_array(factor.U.diagonal() ** -0.5) @ factor.U)
        return cls(upper, np.argsort(factor.perm_c), shift.reach, shift.initial)

    def at(self, values: np.ndarray) -> StiffValues:
        """Start from values, shape (n_values,)."""
        parts = np.clip(values / self.reach, -LARGEST, LARGEST)
        return replace(self, start=self.reach * np.arctanh(parts))

    def values(self, steps: np.ndarray) -> np.ndarray:
        """Values at steps u, shape (n_values,)."""
        moved = np.empty_like(steps)
        moved[self.order] = spsolve_triangular(self.upper, steps, lower=False)
        return self.reach * np.tanh((self.start + moved) / self.reach)

    def vjp(self, values: np.ndarray, bar: np.ndarray) -> np.ndarray:
        """Derivative with respect to the steps, from the derivative with respect to the values."""
        slopes = 1.0 - (values / self.reach) ** 2
        return spsolve_triangular(csr_array(self.upper.T), (slopes * bar)[self.order], lower=True)


def _strains(model: FittedModel) -> csr_array:
    """Differences between the ends of all edges of the control mesh, divided by their lengths (n_edges, n_points)."""
    points, ends = model.control_points, []
    for ids in model.mesh.control_ids:
        for d in range(3):
            first, last = (np.take(ids, range(n, ids.shape[d] - 1 + n), axis=d).ravel() for n in (0, 1))
            ends.append(np.stack([first, last]))
    first, last = np.concatenate(ends, axis=1)
    lengths = np.linalg.norm(points[last] - points[first], axis=1)
    kept = lengths > 1e-12 * np.ptp(points, axis=0).max()
    first, last, weights = first[kept], last[kept], 1.0 / lengths[kept]
    rows = np.arange(len(weights))
    return csr_array(
        (np.concatenate([weights, -weights]), (np.tile(rows, 2), np.concatenate([last, first]))),
        shape=(len(weights), len(points)),
    )
