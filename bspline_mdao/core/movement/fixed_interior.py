"""The mover that moves only the surface: the first one of the paper's section III.A.

Theory: ``docs/theory/movers.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mesh.moving_mesh import MovingMesh
from .increments import IncrementalMover
from .interpolation import InterpolatedStep, interpolated_step


@dataclass(frozen=True, eq=False)
class _NoDisplacement:
    """Interpolation that displaces no point."""

    values: np.ndarray
    n_surface: int

    def jvp(self, d_points: np.ndarray, d_displacement: np.ndarray) -> np.ndarray:
        return np.zeros_like(d_points)

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros_like(bar), np.zeros((self.n_surface, 3), dtype=bar.dtype)


@dataclass(frozen=True)
class FixedInterior(IncrementalMover):
    """Keep all points in place except the points of the surface.

    Parameters
    ----------
    mesh : MovingMesh
        Mesh to move.
    n_increments : int
        Increments of the move; they only change the report.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import FixedInterior, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> movement = FixedInterior(mesh).move(mesh.points, mesh.points[mesh.surface_ids] * [1.0, 1.2, 1.0])
    >>> bool((movement.points[mesh.is_free.all(axis=1)] == mesh.points[mesh.is_free.all(axis=1)]).all())
    True
    """

    mesh: MovingMesh
    n_increments: int = 1

    def _step(self, initial: np.ndarray, before: np.ndarray, surface: np.ndarray) -> InterpolatedStep:
        nothing = _NoDisplacement(np.zeros_like(before), len(surface))
        return interpolated_step(self.mesh, before, surface, nothing)
