"""One increment of a mover that interpolates the displacement of its surface.

What such movers have in common: the displacement of the surface is carried to all points by some interpolation, points
take of it what they may do, and the surface itself is put where it was asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..mesh.moving_mesh import MovingMesh
from .mover import SolveReport

__all__ = ["InterpolatedStep", "Interpolation", "interpolated_step"]


class Interpolation(Protocol):
    """Displacements of all points from those of the surface; held points count as not displaced.

    The values at surface and held points do not matter: these points are known.
    """

    values: np.ndarray
    """Displacements, shape (n_points, 3), in metres."""

    def jvp(self, d_points: np.ndarray, d_displacement: np.ndarray) -> np.ndarray:
        """Change of the values for changes of the points, (n_points, 3), and of the surface's displacement."""

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""


@dataclass(frozen=True, eq=False)
class InterpolatedStep:
    """An increment that was made.

    Parameters
    ----------
    mesh : MovingMesh
        What was moved.
    points : ndarray, shape (n_points, 3)
        Points after the increment (m).
    interpolation : Interpolation
        What carried the displacement of the surface.
    report : SolveReport or None
        How the interpolation was solved for, where it had to be.
    """

    mesh: MovingMesh
    points: np.ndarray
    interpolation: Interpolation
    report: SolveReport | None = None

    def jvp(self, d_initial: np.ndarray, d_before: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the points after the increment, shape (n_points, 3); ``d_initial`` plays no part."""
        surface_ids = self.mesh.surface_ids
        change = self.interpolation.jvp(d_before, d_surface - d_before[surface_ids])
        d_points = d_before + self.mesh.slide(change)
        d_points[surface_ids] = d_surface
        return d_points

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `jvp`: derivatives with respect to initial points, points before and surface."""
        surface_ids = self.mesh.surface_ids
        points_bar, displacement_bar = self.interpolation.vjp(self.mesh.slide(bar))
        before_bar = bar + points_bar
        before_bar[surface_ids] = points_bar[surface_ids] - displacement_bar
        return np.zeros_like(bar), before_bar, bar[surface_ids] + displacement_bar


def interpolated_step(
    mesh: MovingMesh,
    before: np.ndarray,
    surface: np.ndarray,
    interpolation: Interpolation,
    report: SolveReport | None = None,
) -> InterpolatedStep:
    """Take of an interpolation what every point may do.

    Parameters
    ----------
    mesh : MovingMesh
        What is moved.
    before : ndarray, shape (n_points, 3)
        Points before the increment (m).
    surface : ndarray, shape (n_surface, 3)
        Surface points after it (m).
    interpolation : Interpolation
        What carries the displacement of the surface.
    report : SolveReport, optional
        How it was solved for.

    Returns
    -------
    InterpolatedStep
    """
    points = before + mesh.slide(interpolation.values)
    points[mesh.surface_ids] = surface
    return InterpolatedStep(mesh, points, interpolation, report)
